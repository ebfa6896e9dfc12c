"""Against the projection of the Metashape manual's appendix, written out here a second time."""

from pathlib import Path

import numpy as np
import pytest

from slideframe.errors import InputError
from slideframe.formats.colmap import rotation_of
from slideframe.formats.metashape import read_metashape
from slideframe.geodesy import ecef_from_geodetic, enu_from_geodetic
from slideframe.photographs import distort

WIDTH, HEIGHT = 1600, 1300
LENS = {
    "f": 1973.0, "cx": -19.0, "cy": -11.4, "b1": 2.5, "b2": 0.0,
    "k1": -0.1, "k2": 0.02, "k3": 0.003, "p1": 1e-3, "p2": -2e-3,
}  # fmt: skip
PLACE = np.array([[45.0315, 7.6206, 349.5]])
SCALE = 12.5


def transform(rotation: np.ndarray, translation: np.ndarray) -> str:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return " ".join(repr(float(value)) for value in matrix.ravel())


class Chunk:
    """A chunk in its own frame, and how it lies in the world."""

    def __init__(self, folder: Path, *, georeferenced: bool = True, lens: dict | None = None) -> None:
        generator = np.random.default_rng(4)
        self.rotations = [rotation_of(generator.normal(size=4)) for _ in range(3)]
        self.places = generator.normal(size=(3, 3))
        self.turn = rotation_of(generator.normal(size=4))
        self.shift = ecef_from_geodetic(PLACE)[0] if georeferenced else np.array([5.0, 6.0, 7.0])
        self.lens = LENS | (lens or {})
        cameras = "".join(
            f'<camera id="{i}" sensor_id="0" component_id="0" label="DJI_{i}"><transform>{transform(r, p)}</transform>'
            "</camera>"
            for i, (r, p) in enumerate(zip(self.rotations, self.places, strict=True))
        )
        values = "".join(f"<{name}>{value}</{name}>" for name, value in self.lens.items())
        turn = " ".join(map(repr, map(float, self.turn.ravel())))
        shift = " ".join(map(repr, map(float, self.shift)))
        self.path = folder / "cameras.xml"
        self.path.write_text(
            '<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="Chunk 1" enabled="true">'
            f'<sensors next_id="1"><sensor id="0" label="FC6360" type="frame"><resolution width="{WIDTH}"'
            f' height="{HEIGHT}"/><calibration type="frame" class="initial"><f>1</f></calibration>'
            f'<calibration type="frame" class="adjusted"><resolution width="{WIDTH}" height="{HEIGHT}"/>{values}'
            "</calibration></sensor></sensors>"
            f'<cameras next_id="4">{cameras}<camera id="9" sensor_id="0" label="lost"/></cameras>'
            f'<transform><rotation locked="false">{turn}</rotation><translation locked="false">{shift}</translation>'
            f'<scale locked="false">{SCALE}</scale></transform></chunk></document>'
        )

    def project(self, index: int, in_chunk: np.ndarray) -> np.ndarray:
        """Follow the manual from a point of the chunk to a pixel."""
        x, y, z = self.rotations[index].T @ (in_chunk - self.places[index])
        x, y = x / z, y / z
        square = x * x + y * y
        radial = 1 + self.lens["k1"] * square + self.lens["k2"] * square**2 + self.lens["k3"] * square**3
        p1, p2 = self.lens["p1"], self.lens["p2"]
        across = x * radial + p1 * (square + 2 * x * x) + 2 * p2 * x * y
        down = y * radial + p2 * (square + 2 * y * y) + 2 * p1 * x * y
        u = WIDTH * 0.5 + self.lens["cx"] + across * self.lens["f"] + across * self.lens["b1"]
        return np.array([u, HEIGHT * 0.5 + self.lens["cy"] + down * self.lens["f"]])

    def world(self, in_chunk: np.ndarray) -> np.ndarray:
        return SCALE * self.turn @ in_chunk + self.shift


@pytest.mark.parametrize("georeferenced", [True, False])
def test_a_point_falls_where_metashape_puts_it(tmp_path: Path, georeferenced: bool) -> None:
    chunk = Chunk(tmp_path, georeferenced=georeferenced)
    model = read_metashape(chunk.path)
    assert [view.name for view in model.views] == ["DJI_0", "DJI_1", "DJI_2"]
    assert (model.georeference is not None) == georeferenced
    for index, view in enumerate(model.views):
        in_chunk = chunk.places[index] + chunk.rotations[index] @ np.array([0.3, -0.2, 1.0])
        world = chunk.world(in_chunk)
        if georeferenced:
            from slideframe.geodesy import geodetic_from_ecef

            world = enu_from_geodetic(geodetic_from_ecef(world[None]), model.georeference)[0]
        x, y, z = (world - view.world_from_camera[:, 3]) @ view.world_from_camera[:, :3]
        assert z > 0
        camera = view.camera
        slopes = distort(np.array([x / z, y / z]), camera.distortion)
        pixel = slopes * [camera.focal_x, camera.focal_y] + [camera.principal_x, camera.principal_y]
        # earth-centred coordinates are 6.4e6 m large: 1e-9 m of rounding, times the focal length
        np.testing.assert_allclose(pixel, chunk.project(index, in_chunk), atol=1e-5 if georeferenced else 1e-9)


def test_small_shear_is_told_and_more_is_refused(tmp_path: Path) -> None:
    assert "b2" in read_metashape(Chunk(tmp_path, lens={"b2": 0.7}).path).remarks[0]
    for lens in ({"b2": 9.0}, {"k4": 0.1}):
        with pytest.raises(InputError, match="can't be read"):
            read_metashape(Chunk(tmp_path, lens=lens).path)


@pytest.mark.parametrize(
    "text",
    ["no xml", "<document/>", '<!DOCTYPE d [<!ENTITY a "b">]><document><chunk>&a;</chunk></document>'],
    ids=["text", "empty", "entities"],
)
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "cameras.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"XML|aligned"):
        read_metashape(path)
