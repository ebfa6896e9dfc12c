"""The sloping local base level against what it must be on a plane, and what it may never do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe.release.plan import Plan
from slideframe.release.slbl import base_level
from slideframe.release.slip_surface import axes_over

# Paraboloid by trapezoids on 60 cells across, and a depth found to 0.1 %.
VOLUME_TOLERANCE = 0.005


def circle(diameter, corners=180):
    angle = 2 * np.pi * np.arange(corners) / corners
    return Plan((diameter / 2 * np.column_stack([np.cos(angle), np.sin(angle)]),))


def on_grid(plan, cells=60):
    x, y = axes_over(plan.bounds, float((plan.bounds[1] - plan.bounds[0]).max()) / cells)
    across, along = np.meshgrid(x, y, indexing="ij")
    inside = plan.contains(across.ravel(), along.ravel()).reshape(across.shape)
    return x, y, across, along, inside


@given(
    diameter=st.floats(5, 200),
    depth_share=st.floats(0.02, 0.3),
    slope=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
@settings(max_examples=10)
def test_on_a_plane_it_is_a_paraboloid(diameter, depth_share, slope):
    """Depth z_max, curvature 16 z_max / L^2 and volume pi z_max L^2 / 8."""
    depth = depth_share * diameter
    x, y, across, along, inside = on_grid(circle(diameter))
    ground = 10 + slope[0] * across + slope[1] * along
    surface, curvature = base_level(x, y, ground, circle(diameter), depth)
    below = np.where(inside, ground - surface, 0.0)
    assert below.max() == pytest.approx(depth, rel=0.002)
    assert curvature == pytest.approx(16 * depth / diameter**2, rel=0.005)
    volume = below.sum() * (x[1] - x[0]) * (y[1] - y[0])
    assert volume == pytest.approx(np.pi * depth * diameter**2 / 8, rel=VOLUME_TOLERANCE)
    paraboloid = depth * (1 - 4 * (across**2 + along**2) / diameter**2)
    assert np.abs(below - paraboloid)[inside].max() < 0.01 * depth


def test_on_rough_ground_it_stays_below_and_keeps_its_curvature():
    x, y, across, along, inside = on_grid(circle(40))
    ground = 0.5 * across + 2 * np.sin(across / 3) * np.cos(along / 4)
    surface, curvature = base_level(x, y, ground, circle(40), 5.0)
    assert (surface <= ground + 1e-9).all()
    assert (ground - surface)[inside].max() == pytest.approx(5, rel=0.002)
    np.testing.assert_array_equal(surface[~inside], ground[~inside])
    # away from the outline and where it doesn't touch the ground, the five-point Laplacian is the curvature
    step = x[1] - x[0], y[1] - y[0]
    middle = surface[1:-1, 1:-1]
    laplacian = (surface[2:, 1:-1] - 2 * middle + surface[:-2, 1:-1]) / step[0] ** 2
    laplacian += (surface[1:-1, 2:] - 2 * middle + surface[1:-1, :-2]) / step[1] ** 2
    free = (np.hypot(across, along) < 17)[1:-1, 1:-1] & (ground - surface > 0.05)[1:-1, 1:-1]
    assert free.sum() > 500
    np.testing.assert_allclose(laplacian[free], curvature, rtol=0.02)


def test_the_grid_doesn_t_matter():
    volumes = []
    for cells in (40, 80):
        x, y, across, along, _ = on_grid(circle(30), cells)
        ground = 0.4 * along + np.sin(across / 4)
        surface, _ = base_level(x, y, ground, circle(30), 4.0)
        volumes.append((ground - surface).sum() * (x[1] - x[0]) * (y[1] - y[0]))
    assert volumes[0] == pytest.approx(volumes[1], rel=0.01)
