"""XMP packets of a JPEG file, parsed without trusting them (Adobe XMP specification, parts 1 and 3)."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from slideframe.errors import InputError
from slideframe_pose_rtk.jpeg import app1_segments

PACKET = b"http://ns.adobe.com/xap/1.0/\x00"
EXTENSION = b"http://ns.adobe.com/xmp/extension/\x00"
GUID = slice(len(EXTENSION), len(EXTENSION) + 32)
EXTENSION_HEADER = len(EXTENSION) + 32 + 4 + 4  # signature, GUID, full length, offset of this part

RDF = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
# Which namespaces to read, by a part of their address, and the prefix their names get. The drone makers' that DJI's
# names come from or were taken over have none. EXIF's own properties repeat EXIF in other notations.
NAMESPACES = (
    ("dji", ""),
    ("autel", ""),
    ("parrot", "parrot:"),
    ("skydio", "skydio:"),
    ("pix4d.com/camera", "camera:"),
    ("sensefly.com/camera", "camera:"),
    ("adobe.com/tiff", "tiff:"),
    ("adobe.com/xmp/note", "note:"),
    ("/drone", ""),
)


@dataclass(frozen=True)
class Xmp:
    """Properties by name, from all packets of a file; `disagreements` names those that two packets tell differently.

    Names are local ones behind the prefix of `NAMESPACES`; a structure's members follow after a slash.
    """

    properties: dict[str, str]
    disagreements: tuple[str, ...] = ()


def read_xmp(path: Path) -> Xmp:
    """Return what the XMP packets say of drone, camera and place; the first value of a name counts.

    Attributes (as cameras write them) and child elements (as editing programs rewrite them) read the same.

    Raises:
        InputError: a packet isn't XML, or holds entities or a document type that could expand or load anything.
    """
    properties: dict[str, str] = {}
    disagreements: list[str] = []
    for packet in xmp_packets(path):
        for name, value in _properties(_parse(packet, path)):
            if properties.setdefault(name, value) != value and name not in disagreements:
                disagreements.append(name)
    return Xmp(properties, tuple(disagreements))


def xmp_packets(path: Path) -> list[bytes]:
    """Return the packets of a JPEG file: the standard ones in order, then the assembled extensions.

    An extension belongs to the standard packet that names its GUID; where none names any, all count.
    """
    standard: list[bytes] = []
    parts: dict[bytes, dict[int, bytes]] = {}
    with path.open("rb") as file:
        for segment in app1_segments(file):
            if segment.startswith(PACKET):
                standard.append(segment[len(PACKET) :])
            elif segment.startswith(EXTENSION) and len(segment) > EXTENSION_HEADER:
                (offset,) = struct.unpack_from(">I", segment, EXTENSION_HEADER - 4)
                parts.setdefault(segment[GUID], {})[offset] = segment[EXTENSION_HEADER:]
    named = [guid for guid in parts if any(guid in packet for packet in standard)]
    return standard + [b"".join(parts[guid][offset] for offset in sorted(parts[guid])) for guid in named or parts]


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
    except (ParseError, ValueError, LookupError) as error:
        raise InputError(
            f"its XMP metadata isn't valid XML ({error})",
            where=str(path),
            cure="copy the photograph from the drone again",
        ) from error


def _properties(root: Element | None) -> Iterator[tuple[str, str]]:
    if root is not None:
        for packet in root.iter(f"{RDF}RDF"):
            # not deeper: a structure may hold a description, which belongs to the structure
            for description in packet.iterfind(f"{RDF}Description"):
                yield from _members(description, "")


def _members(holder: Element, within: str) -> Iterator[tuple[str, str]]:
    """Yield the properties written as attributes and as child elements of a description or structure."""
    for tag, value in holder.attrib.items():
        yield from _property(tag, value, within)
    for child in holder:
        structure = child.find(f"{RDF}Description")
        holds = structure if structure is not None else child
        if len(holds) or holds.attrib.keys() - {f"{RDF}parseType"}:
            for name, _ in _property(child.tag, "-", within):
                yield from _members(holds, f"{name}/")
        yield from _property(child.tag, child.text or "", within)


def _property(tag: str, value: str, within: str) -> Iterator[tuple[str, str]]:
    namespace, _, name = tag[1:].partition("}")
    if not name or not value.strip():
        return
    address = namespace.lower()
    for part, prefix in NAMESPACES:
        if part in address:
            yield (f"{within}{name}" if within else f"{prefix}{name}"), value.strip()
            return
