"""The filled volume in numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import Filling
from slideframe.record.drawing import spacing_of

# What a filler, or the comparison with a reference ground, may have measured: figure, name, how it is written.
MEASURED = (
    ("plan_area_m2", "plan area", "{:,.1f} m²"),
    ("mean_depth_m", "thickness: mean", "{:.2f} m"),
    ("maximum_depth_m", "… greatest", "{:.2f} m"),
    ("observed_share", "ground of the region: observed", "{:.1%}"),
    ("interpolated_share", "… interpolated", "{:.1%}"),
    ("extrapolated_share", "… extrapolated", "{:.1%}"),
    ("splat_spacing_m", "mean spacing of splats on the ground", "{:.3f} m"),
    ("reference_rmse_m", "surface off the reference ground: RMSE", "{:.3f} m"),
    ("reference_rmse_splat_spacings", "… in splat spacings", "{:.2f}"),
    ("reference_bias_m", "… mean (positive: too high)", "{:+.3f} m"),
    ("reference_p95_m", "… 95 % of it within", "{:.3f} m"),
    ("reference_covered_share", "… share of the region compared", "{:.1%}"),
    ("volume_rescaling_percent", "particles' volumes scaled by", "{:+.2f} %"),
)


def numbers_table(filling: Filling, depth: Float64Array, figures: Mapping[str, Any]) -> str:
    """Return a table in markdown.

    Args:
        filling: the soil.
        depth: of each particle below the ground (particle,), m.
        figures: measured by the filler, or by comparison with a reference ground.
    """
    volumes = filling.particle_volumes.astype(np.float64)
    rows = [("volume", f"{volumes.sum():,.1f} m³")]
    rows += [(name, form.format(figures[figure])) for figure, name, form in MEASURED if figure in figures]
    rows += [
        ("mean depth of the soil below ground", f"{np.average(depth, weights=volumes):.2f} m"),
        ("greatest depth of a particle (red; yellow: half; blue: none)", f"{depth.max(initial=0):.2f} m"),
        ("particles", f"{len(volumes):,}, {spacing_of(filling):.3g} m apart"),
        ("observed splats that move", f"{int((filling.surface_particles >= 0).sum()):,}"),
        ("inferred splats inside / on the slip surface", f"{len(filling.interior):,} / {len(filling.scar):,}"),
        *(() if "observed_share" in figures else _shares(filling)),
        ("terrain that stays", f"{len(filling.terrain_triangles):,} triangles"),
    ]
    return "| the moving mass | |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in rows)


def _shares(filling: Filling) -> list[tuple[str, str]]:
    """Return how much of the surface above the mass's extent was seen, by area."""
    corners = filling.surface_vertices[filling.surface_triangles].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    middle = corners.mean(axis=1)[:, :2]
    inside = ((middle >= filling.bounds[0, :2]) & (middle <= filling.bounds[1, :2])).all(axis=1)
    worst = filling.surface_support[filling.surface_triangles].max(axis=1)[inside]
    shares = [area[inside][worst == kind].sum() / max(area[inside].sum(), 1e-12) for kind in range(3)]
    names = ("surface around the mass: observed", "… interpolated", "… extrapolated")
    return [(name, f"{share:.1%}") for name, share in zip(names, shares, strict=True)]
