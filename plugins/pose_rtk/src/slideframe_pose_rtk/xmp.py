"""XMP packets of a JPEG file, read from its APP1 segments and parsed without trusting them.

Segment layout: ISO 10918-1 annex B; packets and their extension: Adobe XMP specification part 3, section 1.1.3.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from xml.etree.ElementTree import Element, ParseError

from slideframe.errors import InputError

APP1 = 0xE1
START_OF_SCAN = 0xDA
PACKET = b"http://ns.adobe.com/xap/1.0/\x00"
EXTENSION = b"http://ns.adobe.com/xmp/extension/\x00"
EXTENSION_HEADER = len(EXTENSION) + 32 + 4  # signature, GUID, full length; then the offset of this part

RDF_DESCRIPTION = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description"
# Drone makers' own namespaces; standard ones (exif, tiff, dc) repeat EXIF in other notations.
MAKER_NAMESPACES = ("dji", "autel")


def read_xmp(path: Path) -> dict[str, str]:
    """Return the drone maker's properties by local name, from all packets; the first value of a name counts.

    Attributes (as cameras write them) and child elements (as editing programs rewrite them) read the same.

    Raises:
        InputError: a packet isn't XML, or holds entities or a document type that could expand or load anything.
    """
    properties: dict[str, str] = {}
    for packet in xmp_packets(path):
        for name, value in _properties(_parse(packet, path)):
            properties.setdefault(name, value)
    return properties


def xmp_packets(path: Path) -> list[bytes]:
    """Return the packets of a JPEG file: the standard ones in order, then the assembled extension, if any."""
    standard: list[bytes] = []
    parts: dict[int, bytes] = {}
    with path.open("rb") as file:
        for segment in _app1_segments(file):
            if segment.startswith(PACKET):
                standard.append(segment[len(PACKET) :])
            elif segment.startswith(EXTENSION) and len(segment) > EXTENSION_HEADER + 4:
                (offset,) = struct.unpack_from(">I", segment, EXTENSION_HEADER)
                parts[offset] = segment[EXTENSION_HEADER + 4 :]
    extension = b"".join(parts[offset] for offset in sorted(parts))
    return [*standard, extension] if extension else standard


def _app1_segments(file: BinaryIO) -> Iterator[bytes]:
    """Yield the APP1 payloads before the image data; a file that isn't a JPEG has none."""
    if file.read(2) != b"\xff\xd8":
        return
    while len(header := file.read(4)) == 4:
        mark, marker, length = struct.unpack(">BBH", header)
        if mark != 0xFF or marker == START_OF_SCAN or length < 2:
            return
        payload = file.read(length - 2)
        if marker == APP1:
            yield payload


def _parse(packet: bytes, path: Path) -> Element | None:
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    text = packet.strip(b"\x00 \t\r\n")
    if not text:
        return None
    try:
        return fromstring(text, forbid_dtd=True)  # type: ignore[no-any-return]
    except DefusedXmlException as error:
        raise InputError(
            "its XMP metadata holds an XML document type or entities, which real camera files never do",
            where=str(path),
            cure="don't open this file with other programs; remove it from the folder",
        ) from error
    except (ParseError, ValueError) as error:
        raise InputError(
            f"its XMP metadata isn't valid XML ({error})",
            where=str(path),
            cure="copy the photograph from the drone again",
        ) from error


def _properties(root: Element | None) -> Iterator[tuple[str, str]]:
    if root is None:
        return
    for description in root.iter(RDF_DESCRIPTION):
        for tag, value in description.attrib.items():
            yield from _property(tag, value)
        for child in description:
            yield from _property(child.tag, child.text or "")


def _property(tag: str, value: str) -> Iterator[tuple[str, str]]:
    namespace, _, name = tag[1:].partition("}")
    if name and value.strip() and any(maker in namespace.lower() for maker in MAKER_NAMESPACES):
        yield name, value.strip()
