"""The reconstructor stage: splats from a file, in the survey's frame."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from slideframe.arrays import Float64Array
from slideframe.device import Device
from slideframe.errors import InputError
from slideframe.formats.camera_file import read_views
from slideframe.formats.posed_camera import PosedCamera, posed_cameras
from slideframe.formats.splat_file import read_splats, require_reader
from slideframe.harmonics import rotate_harmonics
from slideframe.problem import ProblemModel
from slideframe.products import SplatCloud, Survey
from slideframe.rotations import quaternions_of, rotation_matrices
from slideframe.stages import Context, Reconstructor
from slideframe_gs_import.similarity import Similarity, between_cameras, spread

FEWEST_CAMERAS = 3
# Two solutions of one flight agree to a few centimetres over tens of metres. Beyond this share of the flight's extent
# the cameras aren't those of the same photographs.
LARGEST_RESIDUAL_SHARE = 0.05


class ImportedSplats(Reconstructor):
    """Takes splats that nerfstudio, gsplat, Postshot or another program trained on the same photographs."""

    name: ClassVar[str] = "gs_import"

    splats: Path = Field(description="3DGS .ply, PlayCanvas .compressed.ply or Niantic .spz")
    cameras: Path | None = Field(
        default=None,
        description="cameras in the splats' own frame, by which they are brought into the survey's: a COLMAP model's "
        "folder or a transforms.json; none: the splats are in the survey's local frame, in metres",
    )

    def preflight(self, problem: ProblemModel, device: Device) -> None:
        """Refuse files that aren't there, or that nothing here reads."""
        for option, path in (("splats", self.splats), ("cameras", self.cameras)):
            if path is not None and not path.exists():
                raise InputError("there is no such file", where=f"[plugins.gs_import] {option} = {path}")
        require_reader(self.splats)

    def reconstruct(self, survey: Survey, context: Context) -> SplatCloud:
        """Return the splats of the file in the survey's local frame."""
        splats = read_splats(self.splats)
        context.progress(1, 2, splats=float(len(splats)))
        if self.cameras is not None:
            similarity = self._similarity(survey, context)
            splats = moved(splats, similarity)
        context.figure("splats", len(splats))
        self._require_overlap(splats, survey)
        context.progress(2, 2)
        return splats

    def _similarity(self, survey: Survey, context: Context) -> Similarity:
        """Fit the splats' frame to the survey's by the photographs that both name."""
        assert self.cameras is not None
        theirs, ours = matched(read_views(self.cameras), posed_cameras(survey), self.cameras)
        similarity = between_cameras(theirs, ours)
        residuals = similarity.apply(theirs[:, :, 3]) - ours[:, :, 3]
        residual = float(np.sqrt((residuals**2).sum(axis=1).mean()))
        context.figure("matched_cameras", len(ours))
        context.figure("scale_m_per_unit", similarity.scale)
        context.figure("camera_residual_m", residual)
        if residual > LARGEST_RESIDUAL_SHARE * spread(ours):
            raise InputError(
                "the cameras that the splats were trained with don't fit those of the survey: "
                f"after the best shift, turn and scale they are {residual:.2f} m off on average",
                where=str(self.cameras),
                cure="give the cameras of the same photographs, exported together with the splats",
            )
        return similarity

    def _require_overlap(self, splats: SplatCloud, survey: Survey) -> None:
        """Refuse splats that lie apart from the survey: a frame that was taken for the survey's."""
        points = survey.sparse_points
        if not len(points) or not len(splats):
            return
        low, high = np.percentile(points, [5, 95], axis=0)
        inside = ((splats.centers >= low) & (splats.centers <= high)).all(axis=1)
        if not inside.any():
            found = np.percentile(splats.centers, [5, 95], axis=0).round(1).tolist()
            raise InputError(
                f"the splats span {found[0]} to {found[1]}, apart from the survey's points, which span "
                f"{low.round(1).tolist()} to {high.round(1).tolist()} m",
                where=str(self.splats),
                cure="give 'cameras', a file of the cameras that they were trained with",
            )


def matched(theirs: list[PosedCamera], ours: list[PosedCamera], where: Path) -> tuple[Float64Array, Float64Array]:
    """Return the poses (camera, 3, 4) of the photographs that both name, whatever their folders and extensions.

    Raises:
        InputError: they share fewer than FEWEST_CAMERAS, or all of them stand in one place.
    """
    there = {Path(view.name).stem.lower(): view for view in theirs}
    pairs = [(there[stem], view) for view in ours if (stem := Path(view.name).stem.lower()) in there]
    if len(pairs) < FEWEST_CAMERAS:
        raise InputError(
            f"{len(pairs)} of its {len(theirs)} cameras bear the name of one of the survey's {len(ours)} photographs",
            where=str(where),
            cure=f"at least {FEWEST_CAMERAS} are needed: keep the photographs' names when training elsewhere",
        )
    poses = tuple(np.stack([pair[side].world_from_camera for pair in pairs]) for side in (0, 1))
    if min(map(spread, poses)) == 0:
        raise InputError("all cameras stand in one place, which leaves the scale open", where=str(where))
    return poses[0], poses[1]


def moved(splats: SplatCloud, similarity: Similarity) -> SplatCloud:
    """Return the splats carried into another frame: places, turns, sizes and the directions of their colours."""
    turns = similarity.rotation @ rotation_matrices(splats.rotations.astype(np.float64))
    return SplatCloud(
        centers=similarity.apply(splats.centers.astype(np.float64)).astype(np.float32),
        rotations=quaternions_of(turns).astype(np.float32),
        scales=(similarity.scale * splats.scales).astype(np.float32),
        opacities=splats.opacities,
        harmonics=rotate_harmonics(splats.harmonics, similarity.rotation),
    )
