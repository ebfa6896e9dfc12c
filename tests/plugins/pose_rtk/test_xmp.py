import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from slideframe.errors import InputError
from slideframe_pose_rtk.xmp import EXTENSION, PACKET, read_xmp, xmp_packets

Write = Callable[..., Path]
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
SKYDIO = "https://www.skydio.com/drone-skydio/1.0/"


def segment(body: bytes) -> bytes:
    return b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body


def with_segments(path: Path, *bodies: bytes) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[:2] + b"".join(map(segment, bodies)) + data[2:])
    return path


def extension(packet: bytes, guid: bytes, starts: tuple[int, ...]) -> list[bytes]:
    ends = {start: min([other for other in (*starts, len(packet)) if other > start]) for start in starts}
    return [EXTENSION + guid + struct.pack(">II", len(packet), start) + packet[start : ends[start]] for start in starts]


def described(inside: str, attributes: str = "") -> bytes:
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="{RDF}">'
        f'<rdf:Description rdf:about="" xmlns:s="{SKYDIO}" {attributes}>{inside}</rdf:Description>'
        "</rdf:RDF></x:xmpmeta>"
    ).encode()


def test_extended_packets_are_assembled_in_any_order(photograph: Write, packet_of: Callable, tmp_path: Path) -> None:
    more = packet_of({"GimbalYawDegree": "+12.5", "RtkFlag": "16"})
    path = with_segments(photograph(tmp_path / "a.jpg", {"RtkFlag": "50"}), *extension(more, b"0" * 32, (200, 100, 0)))
    assert xmp_packets(path)[1] == more
    assert read_xmp(path).properties["RtkFlag"] == "50", "the standard packet counts first"
    assert read_xmp(path).disagreements == ("RtkFlag",)


def test_the_extension_that_the_packet_names_counts(photograph: Write, packet_of: Callable, tmp_path: Path) -> None:
    named, other = b"A" * 32, b"B" * 32
    path = photograph(
        tmp_path / "a.jpg",
        packet=described("", 'xmlns:n="http://ns.adobe.com/xmp/note/" n:HasExtendedXMP="' + named.decode() + '"'),
    )
    with_segments(
        path,
        *extension(packet_of({"RtkFlag": "16"}), other, (0,)),
        *extension(packet_of({"RtkFlag": "50"}), named, (0,)),
    )
    assert read_xmp(path).properties["RtkFlag"] == "50"


def test_two_packets(photograph: Write, packet_of: Callable, tmp_path: Path) -> None:
    values = {"GpsLatitude": "22.3", "GpsLongitude": "114.2"}
    path = photograph(tmp_path / "a.jpg", values)
    with_segments(path, PACKET + packet_of(values | {"RtkFlag": "50"}))
    assert read_xmp(path).properties == values | {"RtkFlag": "50"}
    assert read_xmp(path).disagreements == ()


@pytest.mark.parametrize(
    "inside",
    [
        '<s:CameraOrientationNED s:Yaw="127.4" s:Pitch="-7.5" s:Roll="0.2"/>',
        '<s:CameraOrientationNED rdf:parseType="Resource"><s:Yaw>127.4</s:Yaw><s:Pitch>-7.5</s:Pitch>'
        "<s:Roll>0.2</s:Roll></s:CameraOrientationNED>",
        "<s:CameraOrientationNED><rdf:Description><s:Yaw>127.4</s:Yaw><s:Pitch>-7.5</s:Pitch><s:Roll>0.2</s:Roll>"
        "</rdf:Description></s:CameraOrientationNED>",
    ],
)
def test_structures_in_every_form(photograph: Write, tmp_path: Path, inside: str) -> None:
    properties = read_xmp(photograph(tmp_path / "a.jpg", packet=described(inside))).properties
    assert properties == {
        "skydio:CameraOrientationNED/Yaw": "127.4",
        "skydio:CameraOrientationNED/Pitch": "-7.5",
        "skydio:CameraOrientationNED/Roll": "0.2",
    }


BOMB = (
    b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/">&b;</x:xmpmeta>'
)
OUTSIDE = b'<!DOCTYPE l SYSTEM "file:///etc/passwd"><x:xmpmeta xmlns:x="adobe:ns:meta/"/>'


@pytest.mark.parametrize(
    ("packet", "what"),
    [
        (BOMB, "document type or entities"),
        (OUTSIDE, "document type or entities"),
        (b"<x:xmpmeta", "isn't valid XML"),
        (b'<?xml version="1.0" encoding="no-such"?><a/>', "isn't valid XML"),
    ],
)
def test_hostile_packets_are_refused_by_name(photograph: Write, tmp_path: Path, packet: bytes, what: str) -> None:
    path = photograph(tmp_path / "evil.jpg", packet=packet)
    with pytest.raises(InputError, match=what) as caught:
        read_xmp(path)
    assert "evil.jpg" in str(caught.value)


def test_an_empty_packet_is_none(photograph: Write, tmp_path: Path) -> None:
    assert read_xmp(photograph(tmp_path / "a.jpg", packet=b"  \x00\x00 ")).properties == {}
