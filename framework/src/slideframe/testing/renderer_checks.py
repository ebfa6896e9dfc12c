"""What every renderer must hold, on a hillside that stands still or slides."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.transforms_json import write_transforms_json
from slideframe.problem import FileView, FlightView, OrbitView, SurveyView, View
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey
from slideframe.showing import soil_bounds
from slideframe.stages import Context, Renderer
from slideframe.testing.evidence import assert_same, assert_valid, digest, fresh_context
from slideframe.testing.ground_scenes import (
    hillside_filling,
    hillside_height,
    hillside_splats,
    hillside_survey,
    moving_frames,
)

# Levels of 255 between pictures of one scene from one camera that was named in two ways.
SAME_VIEW = 0.5
# The hillside's splats are 0.15 m thick and lie 0.6 m apart on a slope of up to 1 in 2.
DEPTH_TOLERANCE = 0.5
# Two pictures of a mass that moved by metres differ in at least this share of the pixels.
CHANGED_SHARE = 0.02
VIEW = OrbitView(width=160, height=90)


def check_one_picture_per_frame(stage: Renderer, scratch: Path) -> None:
    """There is a valid picture of the asked size for each frame, in order, at the frame's time."""
    pictures = _render(stage, scratch, step=0.5)
    times = [picture.time for picture in pictures]
    assert times == [0.0, 0.1, 0.2], f"pictures at {times} s for frames at 0, 0.1 and 0.2 s"
    for picture in pictures:
        assert_valid(picture)
        assert picture.pixels.shape == (90, 160, 3), f"a picture has shape {picture.pixels.shape}, not (90, 160, 3)"


def check_frames_are_read_as_they_come(stage: Renderer, scratch: Path) -> None:
    """Each frame is read once, and not long before its picture: films are longer than memory."""
    filling = hillside_filling()
    read: list[float] = []

    def motion() -> Iterator[ParticleFrame]:
        for frame in moving_frames(filling, frame_count=6, step=0.1):
            read.append(frame.time)
            yield frame

    pictures = stage.render(hillside_survey(), hillside_splats(), filling, motion(), VIEW, fresh_context(scratch))
    next(iter(pictures))
    assert len(read) <= 3, f"{len(read)} frames were read before the first picture came"


def check_still_scene_stays_the_same(stage: Renderer, scratch: Path) -> None:
    """While nothing moves, every picture is the same, bit for bit."""
    pictures = _render(stage, scratch, step=0.0)
    for picture in pictures[1:]:
        assert np.array_equal(picture.pixels, pictures[0].pixels), f"the picture at {picture.time} s differs"


def check_moving_mass_is_seen(stage: Renderer, scratch: Path) -> None:
    """The scene fills part of the picture, and its motion changes it."""
    pictures = _render(stage, scratch, step=1.0)
    background = np.round(255 * np.array(VIEW.background))
    drawn = (np.abs(pictures[0].pixels - background).max(axis=2) > 8).mean()
    assert drawn > 0.1, f"only {drawn:.1%} of the picture shows anything"
    changed = (pictures[0].pixels != pictures[-1].pixels).any(axis=2).mean()
    assert changed > CHANGED_SHARE, f"only {changed:.1%} of the picture changed while the mass moved by 2 m"


def check_pictures_own_their_pixels(stage: Renderer, scratch: Path) -> None:
    """A picture doesn't change when the next one is asked for."""
    filling, kept, digests = hillside_filling(), [], []
    frames = moving_frames(filling, frame_count=3, step=0.5)
    for picture in stage.render(hillside_survey(), hillside_splats(), filling, frames, VIEW, fresh_context(scratch)):
        kept.append(picture)
        digests.append(digest(picture))
    for picture, before in zip(kept, digests, strict=True):
        assert digest(picture) == before, f"the picture at {picture.time} s changed after a later one was made"


def check_input_is_untouched(stage: Renderer, scratch: Path) -> None:
    """Splats, filling and frames have the same bits after rendering."""
    splats, filling = hillside_splats(), hillside_filling()
    frames = moving_frames(filling, frame_count=2, step=0.5)
    before = [digest(product) for product in (splats, filling, *frames)]
    for _ in stage.render(hillside_survey(), splats, filling, frames, VIEW, fresh_context(scratch)):
        pass
    after = [digest(product) for product in (splats, filling, *frames)]
    assert after == before, "the renderer wrote into its inputs' arrays"


def check_two_runs_are_equal(stage: Renderer, scratch: Path) -> None:
    """Rendering the same motion again gives the same bits."""
    first = _render(stage, scratch, step=0.5, name="first")
    for one, other in zip(first, _render(stage, scratch, step=0.5, name="second"), strict=True):
        assert_same(one, other, f"picture at {one.time} s")


def check_every_kind_of_view(stage: Renderer, scratch: Path) -> None:
    """A flight's and a file's view from the orbit's place show what the orbit shows; a photograph's is its camera's."""
    bounds = soil_bounds(hillside_filling())
    camera, pose = VIEW.shot(hillside_survey(), bounds)(0.0)
    scratch.mkdir(parents=True, exist_ok=True)
    write_transforms_json([PosedCamera("orbit", camera, pose)], scratch / "transforms.json")
    size = {"width": VIEW.width, "height": VIEW.height}
    place, target = tuple(map(float, pose[:, 3])), tuple(map(float, bounds.mean(axis=0)))
    expected = _first(stage, scratch, VIEW, "orbit").pixels.astype(float)
    for view in (
        FlightView(positions=(place,), targets=(target,), **size),
        FileView(path=scratch / "transforms.json", **size),
    ):
        found = np.abs(_first(stage, scratch, view, view.kind).pixels - expected).mean()
        assert found < SAME_VIEW, f"the {view.kind} view differs from the orbit's by {found:.1f} levels on the mean"
    survey = _named_survey()
    above = survey.world_from_camera[0]
    photograph = SurveyView(photographs=(survey.photographs[0].name,), field_of_view=77.0, **size)
    flight = FlightView(
        positions=(tuple(map(float, above[:, 3])),),
        targets=(tuple(map(float, above[:, 3] + 10 * above[:, 2])),),
        field_of_view=77.0,
        **size,
    )
    one, other = (_first(stage, scratch, view, f"above-{view.kind}").pixels for view in (photograph, flight))
    found = np.abs(one.astype(float) - other).mean()
    assert found < SAME_VIEW, f"the photograph's view differs from its camera's by {found:.1f} levels on the mean"
    assert np.abs(one - expected).mean() > 10 * SAME_VIEW, "from above the hillside looks as from the orbit"


def check_maps_are_what_they_say(stage: Renderer, scratch: Path) -> None:
    """Depth, alpha and normals that a view asks for are those of the hillside; others are empty."""
    size = {"width": 96, "height": 96, "field_of_view": 40.0}
    down = FlightView(positions=((0, 0, 30),), targets=((0, 0, 0),), maps=("depth", "alpha", "normal"), **size)
    picture = _first(stage, scratch, down, "maps")
    slopes = (np.arange(96) + 0.5 - 48) * 2 * np.tan(np.radians(20)) / 96
    depth = picture.depth.astype(float)
    x, y = slopes * depth, -slopes[:, None] * depth
    error = np.abs(depth - (30 - hillside_height(x, y)))[24:72, 24:72]
    assert np.median(error) < DEPTH_TOLERANCE, f"the depth map is off by {np.median(error):.2f} m on the median"
    assert picture.alpha[24:72, 24:72].min() > 0.5, "the ground lets more than half of the light through"
    normals = picture.normal[24:72, 24:72]
    assert np.allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-3), "normals are not of length 1"
    assert np.median(normals[..., 2]) > 0.8, "normals of gentle ground don't point up"
    plain = _first(stage, scratch, VIEW, "plain")
    assert not plain.depth.size + plain.alpha.size + plain.normal.size, "maps are given that nobody asked for"


def check_the_scar_is_seen_once_it_is_bare(stage: Renderer, scratch: Path) -> None:
    """Splats of the scar don't show through the ground that lies on them, and do where it has left."""
    plain = hillside_filling()
    base = plain.particle_positions[plain.particle_positions[:, 2] < 0.5]
    scar = SplatCloud(
        centers=base - np.array([0, 0, 0.3], np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (len(base), 1)),
        scales=np.tile(np.array([0.4, 0.4, 0.1], np.float32), (len(base), 1)),
        opacities=np.full(len(base), 0.99, np.float32),
        harmonics=np.tile(np.array([[1.5, -1.5, 1.5]], np.float32), (len(base), 1, 1)),  # purple
    )
    without, bared = (
        _film(stage, scratch, filling, step=6.0, name=name)
        for name, filling in (("plain", plain), ("scar", plain.model_copy(update={"scar": scar})))
    )
    hidden = np.abs(without[0].pixels.astype(float) - bared[0].pixels).mean()
    assert hidden < SAME_VIEW, f"the scar shows through the ground at t = 0, by {hidden:.1f} levels on the mean"
    purple = (bared[-1].pixels[..., 2].astype(int) - bared[-1].pixels[..., 1] > 100).mean()
    assert purple > CHANGED_SHARE, f"the bare scar covers only {purple:.1%} of the picture"


def check_a_film_that_broke_off_goes_on(stage: Renderer, scratch: Path) -> None:
    """A renderer that resumes gives the same pictures after those that are stored; one that doesn't gives all again."""
    filling = hillside_filling()
    frames = moving_frames(filling, frame_count=4, step=0.5)
    whole = list(_render_with(stage, filling, frames, VIEW, fresh_context(scratch, "whole")))
    context = replace(fresh_context(scratch, "rest"), stored=2)
    rest = list(_render_with(stage, filling, frames, VIEW, context))
    expected = whole[context.first_item :]
    assert len(rest) == len(expected), f"{len(rest)} pictures from number {context.first_item} on of {len(whole)}"
    for one, other in zip(rest, expected, strict=True):
        assert_same(one, other, f"picture at {other.time} s of a film that went on")


def _named_survey() -> Survey:
    """Return the hillside's survey with a name for each photograph."""
    survey = hillside_survey()
    photographs = tuple(
        photograph.model_copy(update={"path": photograph.path.with_name(f"hillside-{index}.png")})
        for index, photograph in enumerate(survey.photographs)
    )
    return survey.model_copy(update={"photographs": photographs})


def _first(stage: Renderer, scratch: Path, view: View, name: str) -> Picture:
    filling = hillside_filling()
    frames = moving_frames(filling, frame_count=1, step=0.0)
    return next(iter(_render_with(stage, filling, frames, view, fresh_context(scratch, name))))


def _film(stage: Renderer, scratch: Path, filling: Filling, *, step: float, name: str) -> list[Picture]:
    frames = moving_frames(filling, frame_count=3, step=step)
    return list(_render_with(stage, filling, frames, VIEW, fresh_context(scratch, name)))


def _render_with(
    stage: Renderer, filling: Filling, frames: Sequence[ParticleFrame], view: View, context: Context
) -> Iterator[Picture]:
    return stage.render(_named_survey(), hillside_splats(), filling, frames, view, context)


def _render(stage: Renderer, scratch: Path, *, step: float, name: str = "run") -> list[Picture]:
    filling = hillside_filling()
    frames = moving_frames(filling, frame_count=3, step=step)
    return list(stage.render(hillside_survey(), hillside_splats(), filling, frames, VIEW, fresh_context(scratch, name)))
