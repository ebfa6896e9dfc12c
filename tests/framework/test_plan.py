"""Soil seen from above."""

import numpy as np

from slideframe.plan import PlanGrid


def test_thickness_is_volume_over_area_and_north_is_above():
    positions = np.float32([[0.5, 0.5, 3], [0.6, 0.4, 9], [3.5, 2.5, 1]])
    grid = PlanGrid(west=0, north=3, cell=1, shape=(3, 4))
    thickness = grid.thickness(positions, np.float32([0.25, 0.5, 2]))
    assert thickness[2, 0] == 0.75  # south-west
    assert thickness[0, 3] == 2  # north-east
    assert thickness.sum() == 2.75


def test_the_grid_covers_all_but_outliers_and_loses_only_them():
    random = np.random.default_rng(0)
    cloud = random.uniform([-20, 5, 0], [30, 45, 10], (5000, 3)).astype(np.float32)
    away = np.concatenate([cloud, np.float32([[9000, 0, 0]])])
    grid = PlanGrid.covering((cloud, away), 2.0)
    assert grid.shape[0] * grid.cell < 60
    assert grid.shape[1] * grid.cell < 70
    volumes = np.ones(len(away), np.float32)
    assert grid.thickness(away, volumes).sum() * grid.cell**2 == len(cloud)
