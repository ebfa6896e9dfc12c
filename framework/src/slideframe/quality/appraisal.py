"""The figures of a survey's quality, and the verdict whether to fly again."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.products import LeftOut, Photograph, Survey
from slideframe.quality.ground import Bounds, GroundCoverage, cover_ground

Level = Literal["good", "usable with reservations", "fly again"]

LEAST_VIEWS = 3  # two rays always meet somewhere; only the third shows that they met at the right place
GOOD_VIEWS = 5  # what photogrammetric reports colour green
ENOUGH_GROUND = 0.90  # of the mapped ground in `LEAST_VIEWS` views; its rim always has fewer
# The paper's two principles of acquisition: several distances, several viewing angles (section 3.1).
GOOD_ANGLE = 30.0  # degrees between views of the same ground; depth errors double below, and steep faces stay hidden
GOOD_DISTANCE_RATIO = 1.5  # farthest over closest view
ENOUGH_REGISTERED = 0.90
ENOUGH_FIXED, FEWEST_FIXED = 0.95, 0.50  # share of RTK fixed positions for "good", and for less than "fly again"
MOST_FAULTY = 0.10  # share of blurred or covered photographs
GOOD_REPROJECTION, WORST_REPROJECTION = 1.0, 2.0  # px
# A residual beyond this many sigmas happens once in 15,000 normal ones.
OUTLIER_SIGMAS = 4.0
LEAST_OUTLIER = 0.10  # m; what stays below doesn't matter, however small the stated sigma
FOCAL_LENGTH_DOUBT = 0.01  # of the focal length, for the statement of what it does to heights


@dataclass(frozen=True)
class Verdict:
    """Whether an engineer in the field may pack up, and why not."""

    level: Level
    reasons: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.level}: {'; '.join(self.reasons)}" if self.reasons else self.level


@dataclass(frozen=True, eq=False)
class Appraisal:
    """A survey with what it covers and how well it is held."""

    survey: Survey
    coverage: GroundCoverage

    @cached_property
    def residuals(self) -> Float64Array:
        """Adjusted minus stated position (photograph, 3), m, NaN where none is stated."""
        stated = np.array(
            [photograph.stated_position or (np.nan,) * 3 for photograph in self.survey.photographs], np.float64
        ).reshape(-1, 3)
        return self.survey.world_from_camera[:, :, 3] - stated

    @cached_property
    def outliers(self) -> npt.NDArray[np.int64]:
        """Photographs whose stated position the others contradict."""
        offset = np.abs(np.nan_to_num(self.residuals))
        beyond = (offset > OUTLIER_SIGMAS * self.survey.position_sigma) & (offset > LEAST_OUTLIER)
        return np.flatnonzero(beyond.any(axis=1))

    @cached_property
    def figures(self) -> dict[str, float | int]:
        """Measured results by name, units in the name; only finite ones."""
        coverage, survey = self.coverage, self.survey
        held = np.delete(self.residuals, self.outliers, axis=0)
        figures: dict[str, float | int] = {
            "mapped_ground_m2": float(coverage.mapped.sum() * coverage.cell**2),
            "median_views": _median(coverage.views[coverage.mapped]),
            f"ground_in_{LEAST_VIEWS}_views_share": coverage.share_seen_by(LEAST_VIEWS),
            f"ground_in_{GOOD_VIEWS}_views_share": coverage.share_seen_by(GOOD_VIEWS),
            "median_viewing_angle_deg": _median(coverage.angle),
            "median_distance_ratio": _median(coverage.distance_ratio),
            "ground_sampling_distance_m": _median(coverage.sampling),
            "position_outliers": len(self.outliers),
            "faulty_photographs": len(self.faulty),
            "left_out_photographs": len(survey.left_out),
        }
        for axis, values in zip(("east", "north", "up"), held.T, strict=True):
            figures[f"position_residual_{axis}_m"] = _root_mean_square(values)
        for role in ("control", "check"):
            for axis, values in zip(("east", "north", "up"), self.ground_residuals(role).T, strict=True):
                figures[f"{role}_residual_{axis}_m"] = _root_mean_square(values)
        figures["height_sensitivity_m"] = self.height_sensitivity
        return {name: value for name, value in figures.items() if math.isfinite(value)}

    @property
    def faulty(self) -> list[str]:
        """Names of blurred and covered photographs, used or left out."""
        return [item.name for item in self._all_photographs() if item.fault]

    @property
    def height_sensitivity(self) -> float:
        """What 1 % of the focal length does to heights: dH = H df / f, m, with the median height above ground."""
        heights = self.coverage.height[self.coverage.mapped]
        if not len(heights):
            return math.nan
        above = np.median(self.survey.world_from_camera[:, 2, 3]) - np.median(heights)
        return float(abs(above) * FOCAL_LENGTH_DOUBT)

    def ground_residuals(self, role: str) -> Float64Array:
        """Return (point, 3) m of the control or check points that the photographs determine."""
        found = [point.residual for point in self.survey.ground_points if point.role == role and point.residual]
        return np.array(found, np.float64).reshape(-1, 3)

    def fix_counts(self) -> dict[str, int]:
        """Return how many photographs, used or left out, have each kind of satellite position."""
        fixes = [item.fix for item in self._all_photographs() if item.fix]
        return {fix: fixes.count(fix) for fix in ("fixed", "float", "single", "none") if fix in fixes}

    def _all_photographs(self) -> list[Photograph | LeftOut]:
        return [*self.survey.photographs, *self.survey.left_out]

    @cached_property
    def verdict(self) -> Verdict:
        """Weigh coverage, registration, positions, pictures and reprojection error."""
        severe = [reason for severe, reason in self._findings() if severe]
        slight = [reason for severe, reason in self._findings() if not severe]
        if severe:
            return Verdict("fly again", (*severe, *slight))
        return Verdict("usable with reservations", tuple(slight)) if slight else Verdict("good", ())

    def _findings(self) -> list[tuple[bool, str]]:
        """Return what speaks against the survey, each with whether it is severe."""
        return [*self._about_ground(), *self._about_photographs(), *self._about_positions()]

    def _about_ground(self) -> list[tuple[bool, str]]:
        findings, figures = [], self.figures
        share = figures[f"ground_in_{LEAST_VIEWS}_views_share"]
        if not self.coverage.mapped.any():
            return [(True, "no ground could be mapped")]
        if share < ENOUGH_GROUND:
            findings.append((True, f"{1 - share:.0%} of the ground is in fewer than {LEAST_VIEWS} photographs"))
        if figures["median_views"] < GOOD_VIEWS:
            findings.append((True, f"half of the ground is in fewer than {GOOD_VIEWS} photographs"))
        angle = figures.get("median_viewing_angle_deg", 0.0)
        if angle < GOOD_ANGLE:
            findings.append((False, f"views of the same ground differ by only {angle:.0f} degrees: add oblique views"))
        ratio = figures.get("median_distance_ratio", 1.0)
        if ratio < GOOD_DISTANCE_RATIO:
            findings.append((False, f"all views come from about one distance (ratio {ratio:.1f}): add close views"))
        return findings

    def _about_photographs(self) -> list[tuple[bool, str]]:
        findings = []
        survey = self.survey
        count = len(survey.photographs) + len(survey.left_out)
        share = len(survey.photographs) / max(count, 1)
        if survey.left_out:
            findings.append((share < ENOUGH_REGISTERED, f"{len(survey.left_out)} of {count} photographs are left out"))
        if faulty := self.faulty:
            named = ", ".join(faulty[:3]) + (" ..." if len(faulty) > 3 else "")
            findings.append((len(faulty) > MOST_FAULTY * count, f"{len(faulty)} blurred or covered ({named})"))
        placed = [item.name for item in survey.photographs if item.pose == "metadata"]
        if 0 < len(placed) < len(survey.photographs):
            named = ", ".join(placed[:3]) + (" ..." if len(placed) > 3 else "")
            findings.append((False, f"{len(placed)} placed by their metadata alone ({named})"))
        error = _mean(survey.sparse_errors)
        if error > GOOD_REPROJECTION:
            findings.append((error > WORST_REPROJECTION, f"reprojection error {error:.1f} px"))
        return findings

    def _about_positions(self) -> list[tuple[bool, str]]:
        findings = []
        counts = self.fix_counts()
        controlled = len(self.ground_residuals("control")) >= 3
        if counts:
            share = counts.get("fixed", 0) / sum(counts.values())
            if share < ENOUGH_FIXED:
                kinds = ", ".join(f"{count} {fix}" for fix, count in counts.items())
                findings.append((share < FEWEST_FIXED and not controlled, f"RTK fixed on {share:.0%} only ({kinds})"))
        elif not controlled:
            findings.append((False, "no photograph states the quality of its position"))
        if len(self.outliers):
            named = ", ".join(self.survey.photographs[index].name for index in self.outliers[:3])
            findings.append((False, f"{len(self.outliers)} positions contradict the others ({named})"))
        return findings


def appraise(survey: Survey, bounds: Bounds | None = None) -> Appraisal:
    """Appraise a survey, or the part of its ground within (x_min, x_max, y_min, y_max), m."""
    return Appraisal(survey, cover_ground(survey, bounds))


def _median(values: npt.NDArray[np.float64] | npt.NDArray[np.int64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _mean(values: npt.NDArray[np.float32]) -> float:
    return float(np.mean(values)) if values.size else 0.0


def _root_mean_square(values: Float64Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan
