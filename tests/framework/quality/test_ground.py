import numpy as np
import pytest

from slideframe.quality.ground import cover_ground

HEIGHT = 30.0
CHORD_TOLERANCE = 0.035  # the directions along which chords are measured are that coarse


def test_two_views_of_one_place_are_counted_with_their_angle_and_distances(field) -> None:
    """Cameras 30 m above the field, 20 m apart, and one twice as high: at the field's middle all is known."""
    coverage = cover_ground(field([(-10, 0, HEIGHT), (10, 0, HEIGHT), (0, 0, 2 * HEIGHT)]))
    row, column = (int((0 - low) / coverage.cell) for low in (coverage.south, coverage.west))
    assert coverage.views[row, column] == 3
    true_angle = 2 * np.degrees(np.arctan(10 / HEIGHT))
    assert coverage.angle[row, column] == pytest.approx(true_angle, rel=CHORD_TOLERANCE + 0.02)
    near, far = np.hypot(10, HEIGHT), 2 * HEIGHT
    assert coverage.distance_ratio[row, column] == pytest.approx(far / near, rel=0.02)
    assert coverage.sampling[row, column] == pytest.approx(HEIGHT / 1000, rel=0.02)


def test_only_ground_within_the_picture_counts(field) -> None:
    """One camera 30 m up with a field of view of 53 degrees sees 15 m to every side."""
    coverage = cover_ground(field([(0, 0, HEIGHT)]))
    rows, columns = np.indices(coverage.height.shape) + 0.5
    east, north = coverage.west + columns * coverage.cell, coverage.south + rows * coverage.cell
    inside = np.maximum(abs(east), abs(north)) < HEIGHT / 2
    assert np.array_equal(coverage.views == 1, inside & coverage.mapped)
    assert coverage.share_seen_by(1) == pytest.approx((30 / 40) ** 2, abs=0.05)
    assert not np.isfinite(coverage.angle[coverage.views == 0]).any()


def test_a_barrel_lens_sees_more_than_its_pinhole(field) -> None:
    """With k1 = -0.4 the middle of the picture's side shows the slope s with s (1 - 0.4 s^2) = 0.5."""
    survey = field([(0, 0, HEIGHT)])
    barrel = survey.cameras[0].model_copy(update={"distortion": (-0.4, 0.0, 0.0, 0.0, 0.0)})
    coverage = cover_ground(survey.model_copy(update={"cameras": (barrel,)}))
    true_slope = min(root.real for root in np.roots([-0.4, 0, 1, -0.5]) if abs(root.imag) < 1e-9 and root.real > 0)
    middle = coverage.views[int(-coverage.south / coverage.cell)]
    assert middle.sum() * coverage.cell == pytest.approx(2 * HEIGHT * true_slope, abs=2 * coverage.cell)
    assert true_slope > 0.55


def test_bounds_limit_what_is_looked_at(field) -> None:
    coverage = cover_ground(field([(0, 0, HEIGHT)]), bounds=(-5, 5, -5, 5))
    assert coverage.share_seen_by(1) == 1
    assert coverage.mapped.sum() * coverage.cell**2 == pytest.approx(100, rel=0.15)


def test_small_gaps_are_bridged_and_large_ones_are_not(field) -> None:
    survey = field([(0, 0, 60)])
    points = np.asarray(survey.sparse_points)
    cell = cover_ground(survey).cell
    without = points[(np.abs(points[:, :2]) > 0.6 * cell).any(axis=1)]
    hole = points[(np.abs(points[:, :2] - 5) > 6 * cell).any(axis=1)]

    def mapped_at(kept: np.ndarray, place: float) -> bool:
        changed = survey.model_copy(update={"sparse_points": kept})
        coverage = cover_ground(changed)
        return bool(
            coverage.mapped[int((place - coverage.south) / coverage.cell), int((place - coverage.west) / coverage.cell)]
        )

    assert mapped_at(without, 0.0)
    assert not mapped_at(hole, 5.0)


def test_a_survey_without_points_maps_nothing(field) -> None:
    survey = field([(0, 0, HEIGHT)])
    empty = survey.model_copy(update={"sparse_points": np.empty((0, 3), np.float32)})
    assert cover_ground(empty).share_seen_by(1) == 0
