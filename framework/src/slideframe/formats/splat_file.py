"""Splats in and out, whatever form the file has: INRIA .ply, PlayCanvas .compressed.ply, Niantic .spz.

The two compressed forms are read and written by gsply (extra `compressed`). They quantise: SPZ keeps positions to
0.24 mm within 2 km of the origin, compressed PLY to 1/2048 (1/1024 in height) of the extent of each 256 splats.
"""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from slideframe.errors import InputError, MissingDependency
from slideframe.formats.splat_ply import OPACITY_MARGIN, read_splat_ply, stored_splats, write_splat_ply
from slideframe.products import SplatCloud

COMPRESSED = (".compressed.ply", ".spz")


def read_splats(path: Path) -> SplatCloud:
    """Read splats; the form follows from the name.

    Raises:
        InputError: the file is missing, damaged or of another form.
        MissingDependency: the form needs gsply.
    """
    require_reader(path)
    if not _is_compressed(path):
        return read_splat_ply(path)
    gsply = _gsply(path)
    try:
        data = gsply.read_spz(path) if path.suffix.lower() == ".spz" else gsply.plyread(path)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"splats can't be read: {error}", where=str(path), cure="export the file again") from error
    base = np.asarray(data.sh0, np.float32)[:, None, :]
    rest = base[:, :0] if data.shN is None else np.asarray(data.shN, np.float32).reshape(len(base), -1, 3)
    return stored_splats(
        path,
        centers=np.asarray(data.means, np.float32),
        rotations=np.asarray(data.quats, np.float32),
        log_scales=np.asarray(data.scales, np.float32),
        logits=np.asarray(data.opacities, np.float32).reshape(-1),
        harmonics=np.concatenate([base, rest], axis=1),
    )


def write_splats(splats: SplatCloud, path: Path) -> None:
    """Write splats in the form of the name; coordinates stay in metres in the survey's local frame.

    Raises:
        InputError: the name has none of the known endings.
        MissingDependency: the form needs gsply.
    """
    require_reader(path)
    if not _is_compressed(path):
        write_splat_ply(splats, path)
        return
    gsply = _gsply(path)
    opacities = splats.opacities.astype(np.float64).clip(OPACITY_MARGIN, 1 - OPACITY_MARGIN)
    fields: dict[str, Any] = {
        "scales": np.log(splats.scales),
        "quats": splats.rotations,
        "opacities": np.log(opacities / (1 - opacities)).astype(np.float32),
        "sh0": splats.harmonics[:, 0],
        "shN": np.ascontiguousarray(splats.harmonics[:, 1:]),
    }
    if path.suffix.lower() == ".spz":
        gsply.write_spz(path, gsply.GSData(means=splats.centers, masks=None, **fields))
    else:
        gsply.plywrite(path, splats.centers, compressed=True, **fields)


def require_reader(path: Path) -> None:
    """Refuse a name of an unknown form, or of a form whose library is absent, before long work.

    Raises:
        InputError, MissingDependency: as `read_splats`.
    """
    if path.suffix.lower() not in (".ply", ".spz"):
        raise InputError(
            f"'{path.suffix}' is no form of splats that is read or written here",
            where=str(path),
            cure="use .ply, .compressed.ply or .spz",
        )
    if _is_compressed(path):
        _gsply(path)


def _is_compressed(path: Path) -> bool:
    return path.name.lower().endswith(COMPRESSED)


def _gsply(path: Path) -> ModuleType:
    try:
        import gsply
    except ImportError as error:
        raise MissingDependency(
            "compressed splats need gsply", where=str(path), cure="pip install 'slideframe[compressed]'"
        ) from error
    module: ModuleType = gsply
    return module
