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
    from slideframe.quality.pictures import PictureQuality
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
    origin: Georeference | None = Field(default=None, description="of the local frame; none: the mean of the positions")

    @model_validator(mode="after")
    def _one_undulation(self) -> "RtkPoses":
        if self.geoid_offset is not None and self.geoid_grid is not None:
            raise ValueError("give geoid_offset or geoid_grid, not both")
        return self

    def input_files(self, site: Site) -> Sequence[Path]:
        """Return the JPEG files under the site's folder, and what else the cameras are taken from."""
        from slideframe.formats.models import posed_model_files
        from slideframe_pose_rtk.intake import photograph_files

        photographs = photograph_files(site.photographs)
        model = posed_model_files(self.model) if self.model else ()
        return [*photographs, *self._sources().paths(photographs), *model]

    def preflight(self, problem: ProblemModel, device: Device) -> None:
        """Require a folder with at least three photographs that tell where they were taken."""
        from slideframe_pose_rtk.intake import photograph_files, require_some_located

        assert isinstance(problem, Site)
        require_some_located(photograph_files(problem.photographs), problem.photographs, self._sources())
        if self.model:
            from slideframe.formats.models import read_posed_model

            read_posed_model(self.model)

    def locate(self, site: Site, context: Context) -> Survey:
        """Read the metadata, place the cameras in the local frame, and refine them."""
        from slideframe_pose_rtk import solution
        from slideframe_pose_rtk.flight import plan_flight, require_orientations
        from slideframe_pose_rtk.intake import LEAST_PHOTOGRAPHS, admit, photograph_files, require_baseline
        from slideframe_pose_rtk.report import report, survey_of

        folder = site.photographs
        files = photograph_files(folder)
        records, digests = admit(files, folder, context, self._sources())
        flight = plan_flight(records, folder, self.origin, context)
        require_baseline(flight.positions, folder)
        require_orientations(flight, LEAST_PHOTOGRAPHS)
        if self.model is None:
            solved, qualities = self._solve(flight, digests, context)
        else:
            solved, qualities = self._take_over(self.model, flight, context)
        solution.warn_of_unregistered(flight, solved, context)
        survey = survey_of(flight, solved, files, digests, qualities)
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
                Heights(geoid_offset=self.geoid_offset, geoid_grid=self.geoid_grid), self.unstated_altitude
            ),
            calibration=self.calibration,
        )

    def _solve(self, flight: "Flight", digests: list[str], context: Context) -> "tuple[Solution, Qualities]":
        from slideframe_pose_rtk import solution
        from slideframe_pose_rtk.features import FeatureOptions

        freedom = solution.choose_freedom(flight, self.focal_length) if self.refine else solution.HELD
        solve = solution.solve_by_refinement if self.refine else solution.solve_from_metadata
        options = FeatureOptions(self.feature_limit, self.image_size_limit)
        with solution.quiet_colmap():
            found = solution.Correspondences(flight, digests, freedom, options, self.partners, context)
            return solve(found), [features.quality for features in found.features]

    def _take_over(self, model: Path, flight: "Flight", context: Context) -> "tuple[Solution, Qualities]":
        from slideframe.formats.models import read_posed_model
        from slideframe_pose_rtk.features import inspect_pictures
        from slideframe_pose_rtk.imported import solve_from_model

        solved = solve_from_model(flight, read_posed_model(model), context)
        return solved, inspect_pictures([record.path for record in flight.records], context)
