"""The pose source: drone photographs with RTK metadata to a georeferenced survey."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field, model_validator

from slideframe.device import Device
from slideframe.problem import ProblemModel, Site
from slideframe.products import Georeference, Survey
from slideframe.stages import Context, PoseSource

if TYPE_CHECKING:
    from slideframe.formats.posed_model import PosedModel
    from slideframe.quality.pictures import PictureQuality
    from slideframe_pose_rtk.control import ControlFile, Target
    from slideframe_pose_rtk.features import PictureFile
    from slideframe_pose_rtk.flight import Flight
    from slideframe_pose_rtk.intake import Sources
    from slideframe_pose_rtk.solution import Solution

    Qualities = list[PictureQuality | None]


class RtkPoses(PoseSource):
    """Cameras from EXIF and XMP, refined by bundle adjustment with the RTK positions as priors."""

    name = "pose_rtk"
    backend: ClassVar[tuple[str, ...]] = ("defusedxml", "exifread", "pyproj", "pycolmap")

    refine: bool = Field(
        default=True,
        description="improve the poses by bundle adjustment; false: metadata's poses alone, as in the paper",
    )
    model: Path | None = Field(
        default=None,
        description="cameras that another program found: a COLMAP model, OpenSfM's or ODM's reconstruction.json, a"
        " transforms.json, Metashape's cameras.xml, or the folder of one; none: find them",
    )
    focal_length: Literal["auto", "held", "free"] = Field(
        default="auto",
        description="auto: adjust it, and the principal point, where oblique views or several heights determine them",
    )
    unregistered: Literal["left_out", "metadata"] = Field(
        default="left_out",
        description="photographs that show too little in common with others: leave them out, or place them by their"
        " metadata, without their flight's bias",
    )
    feature_limit: int = Field(default=4096, ge=500, le=50_000, description="features sought in a photograph")
    image_size_limit: int = Field(
        default=3200, ge=400, le=20_000, description="px; larger photographs are reduced for features"
    )
    partners: int = Field(default=10, ge=2, le=200, description="photographs that each one is compared with")
    calibration: Path | None = Field(
        default=None, description="TOML file of calibrated cameras, see docs/survey.md; none: the photographs' metadata"
    )
    positions: Path | None = Field(
        default=None, description="CSV of positions that override all others, see docs/survey.md"
    )
    positions_epsg: int | None = Field(
        default=None, description="coordinate system of the CSV's easting and northing; none: it has degrees of WGS84"
    )
    position_files: bool = Field(
        default=True, description="use DJI's .MRK and RTKLIB's .pos files beside the photographs"
    )
    unstated_altitude: Literal["unknown", "ellipsoidal", "orthometric"] = Field(
        default="unknown", description="what heights are that the photographs don't state the level of"
    )
    geoid_offset: float | None = Field(
        default=None,
        description="sea level above the WGS84 ellipsoid at the site, m; makes orthometric heights ellipsoidal",
    )
    geoid_grid: Path | None = Field(default=None, description="the same from a grid that PROJ reads (.tif, .gtx)")
    control: Path | None = Field(
        default=None,
        description="CSV of surveyed control and check points, see docs/survey.md; none: gcp_list.txt beside the"
        " photographs, where there is one",
    )
    control_epsg: int | None = Field(
        default=None, description="coordinate system of their easting and northing; none: they have degrees of WGS84"
    )
    origin: Georeference | None = Field(default=None, description="of the local frame; none: the mean of the positions")

    @model_validator(mode="after")
    def _one_undulation(self) -> "RtkPoses":
        if self.geoid_offset is not None and self.geoid_grid is not None:
            raise ValueError("give geoid_offset or geoid_grid, not both")
        return self

    def input_files(self, site: Site) -> Sequence[Path]:
        """Return the JPEG files under the site's folder, and what else the cameras are taken from."""
        from slideframe.formats.models import posed_model_files
        from slideframe.masks import mask_files

        photographs = _photographs(site)
        model = posed_model_files(self.model) if self.model else ()
        control = self._control_file(site)
        masks = mask_files(site.masks) if site.masks else []
        return [*photographs, *self._sources().paths(photographs), *model, *([control.path] if control else ()), *masks]

    def preflight(self, problem: ProblemModel, device: Device) -> None:
        """Require a folder with at least three photographs that tell where they were taken, and whole files beside."""
        from slideframe.formats.models import read_posed_model
        from slideframe.masks import find_masks, mask_files
        from slideframe_pose_rtk.control import require_readable
        from slideframe_pose_rtk.intake import require_some_located

        assert isinstance(problem, Site)
        photographs = _photographs(problem)
        model = read_posed_model(self.model) if self.model else None
        require_some_located(photographs, problem.photographs, self._sources(), model)
        if problem.masks:
            find_masks(photographs, mask_files(problem.masks))
        if control := self._control_file(problem):
            require_readable(control)

    def locate(self, site: Site, context: Context) -> Survey:
        """Read the metadata, place the cameras in the local frame, and refine them."""
        from slideframe.formats.models import read_posed_model
        from slideframe_pose_rtk import solution
        from slideframe_pose_rtk.control import read_targets
        from slideframe_pose_rtk.flight import picture_files, plan_flight, require_orientations
        from slideframe_pose_rtk.intake import LEAST_PHOTOGRAPHS, admit, require_baseline
        from slideframe_pose_rtk.report import report, survey_of

        folder, files = site.photographs, _photographs(site)
        model = read_posed_model(self.model) if self.model else None
        records, digests = admit(files, folder, context, self._sources(), model)
        flight = plan_flight(records, folder, self.origin, context)
        require_baseline(flight.positions, folder)
        if model is None:
            require_orientations(flight, LEAST_PHOTOGRAPHS)
        pictures = picture_files(flight, digests, site.masks)
        control = self._control_file(site)
        targets = read_targets(control, flight) if control else ()
        context.figure("surveyed_points", len(targets))
        if model is None:
            solved, qualities = self._solve(flight, pictures, targets, context)
        else:
            solved, qualities = self._take_over(model, flight, targets, context)
        if self.unregistered == "metadata":
            solved = solution.with_unregistered(flight, solved, qualities, context)
        solution.warn_of_unregistered(flight, solved, context)
        survey = survey_of(flight, solved, files, pictures, qualities)
        report(flight, solved, survey, context)
        return survey

    def _sources(self) -> "Sources":
        from slideframe.georeferencing import Heights
        from slideframe_pose_rtk.altitude import AltitudeRules
        from slideframe_pose_rtk.intake import Sources
        from slideframe_pose_rtk.positions import PositionFiles

        return Sources(
            positions=PositionFiles(self.positions, self.positions_epsg, self.position_files),
            altitudes=AltitudeRules(
                Heights(geoid_offset=self.geoid_offset, geoid_grid=self.geoid_grid),
                self.unstated_altitude,
                mixed_refused=not self.refine and self.model is None,
            ),
            calibration=self.calibration,
        )

    def _control_file(self, site: Site) -> "ControlFile | None":
        """Return the file of surveyed points that is named, or lies beside the photographs."""
        from slideframe.georeferencing import Heights
        from slideframe_pose_rtk.control import ControlFile
        from slideframe_pose_rtk.gcp_list import FILE

        beside = site.photographs / FILE
        path = self.control or (beside if beside.is_file() else None)
        if path is None:
            return None
        geoid = Heights(geoid_offset=self.geoid_offset, geoid_grid=self.geoid_grid)
        return ControlFile(path, self.control_epsg if path == self.control else None, geoid)

    def _solve(
        self, flight: "Flight", pictures: "list[PictureFile]", targets: "tuple[Target, ...]", context: Context
    ) -> "tuple[Solution, Qualities]":
        from slideframe_pose_rtk.correspondences import correspond
        from slideframe_pose_rtk.features import FeatureOptions
        from slideframe_pose_rtk.freedom import HELD, choose_freedom
        from slideframe_pose_rtk.solution import quiet_colmap, solve_by_refinement, solve_from_metadata
        from slideframe_pose_rtk.turned import warn_of_turned

        control_count = sum(target.role == "control" for target in targets)
        freedom = choose_freedom(flight, self.focal_length, control_count) if self.refine else HELD
        options = FeatureOptions(self.feature_limit, self.image_size_limit)
        with quiet_colmap():
            found = correspond(flight, pictures, freedom, targets, options, self.partners, self.refine, context)
            solved = solve_by_refinement(found) if self.refine else solve_from_metadata(found)
        warn_of_turned(found.flight, solved.poses, context)
        return solved, [features.quality for features in found.features]

    def _take_over(
        self, model: "PosedModel", flight: "Flight", targets: "tuple[Target, ...]", context: Context
    ) -> "tuple[Solution, Qualities]":
        from slideframe_pose_rtk.features import inspect_pictures
        from slideframe_pose_rtk.imported import solve_from_model
        from slideframe_pose_rtk.turned import warn_of_turned

        solved = solve_from_model(flight, model, targets, context)
        warn_of_turned(flight, solved.poses, context)
        return solved, inspect_pictures([record.path for record in flight.records], context)


def _photographs(site: Site) -> list[Path]:
    """Return the JPEG files under the site's folder that aren't masks."""
    from slideframe_pose_rtk.intake import photograph_files

    return [path for path in photograph_files(site.photographs) if site.masks not in path.parents]
