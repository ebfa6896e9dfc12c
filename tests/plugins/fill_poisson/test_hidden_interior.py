"""What the survey's cameras see of a filled scene before anything moves."""

import numpy as np
import pytest

from slideframe.coupling import Coupling
from slideframe.products import ParticleFrame, SplatCloud
from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_gs_torch.rasterize import rasterize

torch = pytest.importorskip("torch")
MOST_CHANGE_DB = 0.1
PHOTOGRAPH_NOISE = 0.05  # 26 dB, what a good reconstruction leaves


def slope(x, y):
    return 3 + 0.5 * y + 0.4 * np.sin(x) * np.cos(y)


@pytest.fixture(scope="module")
def scene(scatter):
    """Opaque, overlapping splats in smooth colours, as a reconstruction has them."""
    centers = scatter(slope, spacing=0.25, reach=12)
    count = len(centers)
    x, y, _ = centers.T
    colors = np.column_stack([0.5 + 0.2 * np.sin(x), 0.4 + 0.2 * np.cos(y / 2), np.full(count, 0.3)])
    return SplatCloud(
        centers=centers.astype(np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        scales=np.tile(np.float32([0.22, 0.22, 0.08]), (count, 1)),
        opacities=np.full(count, 0.95, np.float32),
        harmonics=((colors - 0.5) / 0.28209479)[:, None].astype(np.float32),
    )


def drawn(survey, clouds):
    """Return every photograph's view of the splats (photograph, row, column, 3), a third as wide."""
    names = ("centers", "rotations", "scales", "opacities", "harmonics")
    fields = [torch.from_numpy(np.concatenate([getattr(cloud, name) for cloud in clouds])) for name in names]
    camera = survey.cameras[0].model_copy(
        update={"width": 200, "height": 150, "focal_x": 150, "focal_y": 150, "principal_x": 100, "principal_y": 75}
    )
    pictures = []
    for pose in survey.world_from_camera[::3]:
        pictures.append(rasterize(*fields, camera=camera, world_from_camera=pose).colour.clamp(0, 1))
    return np.stack([picture.numpy() for picture in pictures])


def decibels(pictures, photographs):
    return float(np.mean(-10 * np.log10(((pictures - photographs) ** 2).mean(axis=(1, 2, 3)))))


def test_nothing_shows_before_the_ground_opens(survey, scene, box, make_context):
    """Engineering mode changes the photographs' PSNR by less than 0.1 dB even with nothing hidden; paper mode more."""
    scan = drawn(survey, [scene])
    photographs = scan + np.random.default_rng(1).normal(0, PHOTOGRAPH_NOISE, scan.shape)
    before = decibels(scan, photographs)
    assert before == pytest.approx(26, abs=0.1)
    change = {}
    for mode in ("engineering", "paper"):
        filling = PoissonFiller(mode=mode).fill(survey, scene, box(half=4.0), make_context())
        change[mode] = decibels(drawn(survey, [scene, filling.interior, filling.scar]), photographs) - before
        count = len(filling.particle_positions)
        still = ParticleFrame(
            time=0.0,
            positions=filling.particle_positions,
            velocities=np.zeros((count, 3), np.float32),
            deformation_gradients=np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
        )
        # the film hides what is inferred until the ground has moved
        film = Coupling(scene, filling).at(still)
        assert abs(decibels(drawn(survey, [film]), photographs) - before) < 1e-3
    assert abs(change["engineering"]) < MOST_CHANGE_DB
    assert change["paper"] < 2 * change["engineering"] - 0.05
