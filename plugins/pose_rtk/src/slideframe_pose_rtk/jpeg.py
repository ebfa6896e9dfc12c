"""The marker segments of a JPEG file (ISO/IEC 10918-1, annex B)."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

START_OF_IMAGE = b"\xff\xd8"
END_OF_IMAGE = b"\xff\xd9"
APP1 = 0xE1
START_OF_SCAN = 0xDA
# Programs and cameras append other pictures, thumbnails or maker's data; each picture among them ends in the same mark.
TAIL = 65_536  # bytes


def app1_segments(file: BinaryIO) -> Iterator[bytes]:
    """Yield the APP1 payloads before the picture's data; a file that isn't a JPEG has none."""
    file.seek(0)
    if file.read(2) != START_OF_IMAGE:
        return
    while len(header := file.read(4)) == 4:
        mark, marker, length = struct.unpack(">BBH", header)
        if mark != 0xFF or marker == START_OF_SCAN or length < 2:
            file.seek(-4, os.SEEK_CUR)
            return
        if marker != APP1:
            file.seek(length - 2, os.SEEK_CUR)
            continue
        yield file.read(length - 2)


def lacks_its_end(path: Path) -> bool:
    """Tell whether the last bytes hold no end-of-image mark, as in a file whose copying broke off.

    In the picture's data that mark can't occur otherwise: there, a zero follows each 0xFF.
    """
    with path.open("rb") as file:
        for _ in app1_segments(file):
            pass
        data = file.tell()
        end = file.seek(0, os.SEEK_END)
        file.seek(max(data, end - TAIL))
        return END_OF_IMAGE not in file.read()
