"""Particles of one output time as a binary PLY file: a point cloud with scalars, as CloudCompare and MeshLab read."""

from pathlib import Path

import numpy as np

from slideframe.products import ParticleFrame

# columns beside x, y, z: of the frame's array, and by component where it has several
_COLUMNS = {
    "velocities": ("velocity_x", "velocity_y", "velocity_z"),
    "mean_stresses": ("mean_stress",),
    "deviatoric_stresses": ("deviatoric_stress",),
    "plastic_strains": ("plastic_strain",),
}


def write_particle_ply(frame: ParticleFrame, path: Path) -> None:
    """Write positions (m), velocities (m/s) and, where the frame carries them, stresses (Pa) and plastic strain."""
    names, columns = ["x", "y", "z"], [frame.positions]
    for field, titles in _COLUMNS.items():
        values = getattr(frame, field)
        if len(values):
            names += titles
            columns.append(values.reshape(len(frame.positions), -1))
    properties = "".join(f"property float {name}\n" for name in names)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(frame.positions)}\n{properties}end_header\n"
    path.write_bytes(header.encode("ascii") + np.hstack(columns).astype("<f4").tobytes())
