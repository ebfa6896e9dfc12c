"""OpenDroneMap's gcp_list.txt: the coordinate system in the first line, then `x y z column row photograph [name]`.

See https://docs.opendronemap.org/gcp/. Its heights' level isn't stated.
"""

import re
from pathlib import Path

from slideframe.errors import InputError

FILE = "gcp_list.txt"
CURE = "write the coordinate system as EPSG:CODE in the first line, then x y z column row photograph name in each"
WGS84 = 4326

Row = dict[str, str]


def read_gcp_list(path: Path) -> tuple[int | None, list[tuple[int, Row]]]:
    """Return the EPSG code (None: degrees of WGS84), and each line's number with its fields as `control` names them.

    Raises:
        InputError: the system can't be told, or a line has too few fields.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the surveyed points can't be read: {error}", where=str(path), cure=CURE) from error
    numbered = [(number, line.strip()) for number, line in enumerate(lines, 1)]
    numbered = [(number, line) for number, line in numbered if line and not line.startswith("#")]
    if not numbered:
        raise InputError("the file of surveyed points is empty", where=str(path), cure=CURE)
    epsg = _system(numbered[0][1], path)
    x, y = ("easting", "northing") if epsg else ("longitude", "latitude")
    rows = []
    for number, line in numbered[1:]:
        fields = line.split()
        if len(fields) < 6:
            raise InputError(f"line {number} has {len(fields)} fields, not 6 or 7", where=str(path), cure=CURE)
        name = fields[6] if len(fields) > 6 else " ".join(fields[:3])
        columns = (x, y, "ellipsoidal_height", "column", "row", "photograph")
        rows.append((number, {"name": name, **dict(zip(columns, fields, strict=False))}))
    return epsg, rows


def _system(text: str, path: Path) -> int | None:
    """Read EPSG:32632, WGS84 UTM 32N, or +proj=utm +zone=32 [+south]."""
    if match := re.fullmatch(r"EPSG:\s*(\d+)", text, re.IGNORECASE):
        code = int(match[1])
        return None if code == WGS84 else code
    if match := re.fullmatch(r"WGS\s*84\s+UTM\s+(\d{1,2})\s*([NS])", text, re.IGNORECASE):
        return (32600 if match[2].upper() == "N" else 32700) + int(match[1])
    is_utm = re.search(r"\+proj=utm\b", text) and not re.search(r"\+(datum|ellps)=(?!WGS84)", text)
    if is_utm and (match := re.search(r"\+zone=(\d{1,2})\b", text)):
        return (32700 if "+south" in text else 32600) + int(match[1])
    raise InputError(f"the coordinate system '{text}' can't be told", where=str(path), cure=CURE)
