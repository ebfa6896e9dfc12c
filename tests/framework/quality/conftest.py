"""A level field photographed from known places, where every figure can be worked out by hand."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slideframe.products import Camera, Georeference, Photograph, Survey

SIDE, FOCAL = 1000, 1000.0
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def survey_from(places: Sequence[Sequence[float]], looks: Sequence[np.ndarray] | None = None, **fields) -> Survey:
    """Photograph the level square of 40 m around the origin; `fields` override each photograph's or the survey's."""
    per_photograph = {name: fields.pop(name) for name in ("fix", "stated_position", "fault") if name in fields}
    x, y = np.meshgrid(np.linspace(-20, 20, 81), np.linspace(-20, 20, 81))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float32)
    rotations = looks or [DOWN] * len(places)
    photographs = tuple(
        Photograph(
            path=Path(f"{index:03d}.jpg"),
            camera=0,
            sha256="",
            **{name: values[index] for name, values in per_photograph.items()},
        )
        for index in range(len(places))
    )
    return Survey(
        **{
            "georeference": Georeference(latitude=45.0, longitude=7.0, ellipsoidal_height=300.0),
            "cameras": (
                Camera(
                    width=SIDE, height=SIDE, focal_x=FOCAL, focal_y=FOCAL, principal_x=SIDE / 2, principal_y=SIDE / 2
                ),
            ),
            "photographs": photographs,
            "world_from_camera": np.array(
                [np.column_stack([turn, place]) for turn, place in zip(rotations, places, strict=True)], np.float64
            ),
            "position_sigma": np.full((len(places), 3), 0.02),
            "sparse_points": points,
            "sparse_colors": np.zeros((len(points), 3), np.uint8),
            "sparse_errors": np.full(len(points), 0.4, np.float32),
            **fields,
        }
    )


@pytest.fixture
def field() -> Callable[..., Survey]:
    """Return a maker of such surveys."""
    return survey_from
