"""Splats as a binary PLY file in the layout of Kerbl et al. 2023, which splat viewers read.

Scales are stored as logarithms, opacities as logits, harmonics as `f_dc_*` and then `f_rest_*` with all
coefficients of red before those of green; normals are there and zero.
"""

import logging
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array
from slideframe.errors import InputError
from slideframe.products import SplatCloud

_log = logging.getLogger("slideframe")

# Opacities are kept this far from 0 and 1, where their logit is infinite.
OPACITY_MARGIN = 1e-6
_LITTLE_FLOAT = "<f4"
_LONGEST_HEADER = 1 << 16
_KINDS = {
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
    "uchar": "u1",
    "uint8": "u1",
    "int": "<i4",
}


def write_splat_ply(splats: SplatCloud, path: Path) -> None:
    """Write the splats; coordinates stay in metres in the survey's local frame."""
    rest = splats.harmonics[:, 1:].transpose(0, 2, 1).reshape(len(splats), -1)
    opacities = splats.opacities.astype(np.float64).clip(OPACITY_MARGIN, 1 - OPACITY_MARGIN)
    table = np.hstack(
        [
            splats.centers,
            np.zeros_like(splats.centers),
            splats.harmonics[:, 0],
            rest,
            np.log(opacities / (1 - opacities))[:, None],
            np.log(splats.scales),
            splats.rotations,
        ]
    ).astype(_LITTLE_FLOAT)
    properties = "".join(f"property float {name}\n" for name in _column_names(rest.shape[1]))
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(splats)}\n{properties}end_header\n"
    path.write_bytes(header.encode("ascii") + table.tobytes())


def read_splat_ply(path: Path) -> SplatCloud:
    """Read splats in that layout; further columns are passed over.

    Raises:
        InputError: the file is missing, cut short, not a splat file, or has no splats.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"splats can't be read: {error}", where=str(path)) from error
    names, table = _parse(path, data)
    rest_count = sum(name.startswith("f_rest_") for name in names)
    missing = set(_column_names(rest_count)) - {"nx", "ny", "nz"} - set(names)
    if missing or rest_count not in (0, 9, 24, 45):
        raise _not_splats(path, f"it lacks the columns {', '.join(sorted(missing)) or 'f_rest_* of a whole degree'}")

    def columns(*wanted: str) -> Float32Array:
        return np.stack([table[name].astype(np.float32) for name in wanted], axis=1)

    rest = [f"f_rest_{i}" for i in range(rest_count)]
    harmonics = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None, :]
    if rest and len(table):
        harmonics = np.concatenate([harmonics, columns(*rest).reshape(len(table), 3, -1).transpose(0, 2, 1)], axis=1)
    return stored_splats(
        path,
        centers=columns("x", "y", "z"),
        rotations=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        log_scales=columns("scale_0", "scale_1", "scale_2"),
        logits=columns("opacity")[:, 0],
        harmonics=harmonics,
    )


def stored_splats(
    path: Path,
    *,
    centers: Float32Array,
    rotations: Float32Array,
    log_scales: Float32Array,
    logits: Float32Array,
    harmonics: Float32Array,
) -> SplatCloud:
    """Turn what files keep into splats: logarithms of scales, logits of opacities, quaternions of any length.

    Trained splats may hold a few that are no numbers, which viewers pass over: they are left out with a warning.

    Raises:
        InputError: there are no others.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        fields = {
            "centers": centers,
            "rotations": rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
            "scales": np.exp(log_scales),
            "opacities": 1 / (1 + np.exp(-logits)),
            "harmonics": harmonics,
        }
    sound = (fields["scales"] > 0).all(axis=1)
    for field in fields.values():
        sound &= np.isfinite(field).all(axis=tuple(range(1, field.ndim)))
    if not sound.any():
        raise _not_splats(path, f"none of its {len(sound)} splats has a place, a size and a colour")
    if not sound.all():
        _log.warning("%s: %d of %d splats are left out: they hold what is no number", path, (~sound).sum(), len(sound))
        fields = {name: field[sound] for name, field in fields.items()}
    return SplatCloud(**fields)


def _column_names(rest_count: int) -> list[str]:
    return [
        *("x", "y", "z", "nx", "ny", "nz"),
        *(f"f_dc_{i}" for i in range(3)),
        *(f"f_rest_{i}" for i in range(rest_count)),
        "opacity",
        *(f"scale_{i}" for i in range(3)),
        *(f"rot_{i}" for i in range(4)),
    ]


def _parse(path: Path, data: bytes) -> tuple[list[str], npt.NDArray[np.void]]:
    end = data.find(b"end_header\n", 0, _LONGEST_HEADER)
    lines = data[:end].decode("ascii", "replace").splitlines() if end >= 0 else []
    if not lines or lines[0] != "ply" or "format binary_little_endian 1.0" not in lines:
        raise _not_splats(path, "it is no binary little-endian PLY file")
    words = [line.split() for line in lines if line.strip()]
    elements = [word for word in words if word[0] == "element"]
    if not elements or elements[0][1:2] != ["vertex"]:
        raise _not_splats(path, "its first element is not 'vertex'")
    first = words.index(elements[0])
    stop = words.index(elements[1]) if len(elements) > 1 else len(words)
    properties = [word for word in words[first + 1 : stop] if word[0] == "property"]
    if any(len(word) != 3 or word[1] not in _KINDS for word in properties):
        raise _not_splats(path, "its vertices have properties of another kind than numbers")
    if len({word[2] for word in properties}) < len(properties):
        raise _not_splats(path, "two properties of its vertices have one name")
    if len(elements[0]) != 3 or not elements[0][2].isdecimal():
        raise _not_splats(path, "it doesn't say how many splats it has")
    layout = np.dtype([(word[2], _KINDS[word[1]]) for word in properties])
    count, body = int(elements[0][2]), memoryview(data)[end + len(b"end_header\n") :]
    if len(body) < count * layout.itemsize:
        raise _not_splats(path, f"it ends before its {count} splats do")
    return [word[2] for word in properties], np.frombuffer(body, layout, count)


def _not_splats(path: Path, why: str) -> InputError:
    return InputError(
        f"not a splat file: {why}",
        where=str(path),
        cure="export it as 3D Gaussian splats in binary PLY ('INRIA') format",
    )
