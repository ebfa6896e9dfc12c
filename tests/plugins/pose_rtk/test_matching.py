import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slideframe.products import Camera
from slideframe_pose_rtk.lens import adjustable_lens, camera_from_lens, exact_lens
from slideframe_pose_rtk.matching import FARTHEST, RATIO, UNIT, match_descriptors


def descriptors(generator: np.random.Generator, count: int) -> np.ndarray:
    raw = generator.exponential(size=(count, 128))
    return np.round(512 * raw / np.linalg.norm(raw, axis=1, keepdims=True)).clip(0, 255).astype(np.uint8)


def exhaustive(first: np.ndarray, second: np.ndarray) -> set[tuple[int, int]]:
    """The same rules, one pair at a time in whole numbers."""
    product = first.astype(np.int64) @ second.astype(np.int64).T
    found = set()
    for i, row in enumerate(product):
        j = int(row.argmax())
        near, far = np.arccos(np.minimum(np.sort(row)[::-1][:2] / UNIT, 1.0))
        if product[:, j].max() == row[j] and near < RATIO * far and near < FARTHEST:
            found.add((i, j))
    return found


@given(st.integers(0, 2**32 - 1), st.integers(2, 700), st.integers(2, 90))
def test_equals_exhaustive_search(seed: int, first_count: int, second_count: int) -> None:
    generator = np.random.default_rng(seed)
    first, second = descriptors(generator, first_count), descriptors(generator, second_count)
    shared = min(first_count, second_count) // 2
    order = generator.permutation(first_count)[:shared]
    second[:shared] = np.clip(
        first[order] + generator.integers(0, 6, (shared, 128)), 0, 255
    )  # the same spots, seen again
    matches = {(int(i), int(j)) for i, j in match_descriptors(first, second)}
    assert matches == exhaustive(first, second)
    assert {(int(i), j) for j, i in enumerate(order)} <= matches


def test_nothing_matches_nothing() -> None:
    empty = np.empty((0, 128), np.uint8)
    assert match_descriptors(empty, descriptors(np.random.default_rng(0), 3)).shape == (0, 2)


MEASURED = Camera(
    width=1600,
    height=1300,
    focal_x=1973.09,
    focal_y=1955.65,
    principal_x=780.96,
    principal_y=638.58,
    distortion=(-0.42275, 0.369101, 0.0040638, 0.0040638, -0.264306),
)
FIT_PIXELS = 2.0  # what two radial coefficients can't follow of three, in a corner; the adjustment starts from there


def test_the_exact_lens_is_opencvs() -> None:
    lens = exact_lens(MEASURED, 1)
    assert camera_from_lens(lens) == MEASURED
    x, y = 0.31, -0.27
    k1, k2, p1, p2, k3 = MEASURED.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    expected = [MEASURED.focal_x * u + MEASURED.principal_x, MEASURED.focal_y * v + MEASURED.principal_y]
    np.testing.assert_allclose(lens.img_from_cam(np.array([[x, y, 1.0]]))[0], expected, atol=1e-9)


def test_the_adjustable_lens_starts_close_to_the_exact_one() -> None:
    columns, rows = np.meshgrid(np.linspace(0, 1600, 9), np.linspace(0, 1300, 9))
    rays = np.column_stack([(columns.ravel() - 780.96) / 1973.09, (rows.ravel() - 638.58) / 1955.65, np.ones(81)])
    exact, adjustable = exact_lens(MEASURED, 1), adjustable_lens(MEASURED, 1)
    assert np.abs(exact.img_from_cam(rays) - adjustable.img_from_cam(rays)).max() < FIT_PIXELS
    assert camera_from_lens(adjustable).distortion[4] == 0.0
