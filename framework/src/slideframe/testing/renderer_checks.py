"""What every renderer must hold, on a hillside that stands still or slides."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slideframe.problem import OrbitView
from slideframe.products import ParticleFrame, Picture
from slideframe.stages import Renderer
from slideframe.testing.evidence import assert_same, assert_valid, digest, fresh_context
from slideframe.testing.ground_scenes import hillside_filling, hillside_splats, hillside_survey, moving_frames

# Two pictures of a mass that moved by metres differ in at least this share of the pixels.
CHANGED_SHARE = 0.02
VIEW = OrbitView(width=160, height=90)
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


def _render(stage: Renderer, scratch: Path, *, step: float, name: str = "run") -> list[Picture]:
    filling = hillside_filling()
    frames = moving_frames(filling, frame_count=3, step=step)
    return list(stage.render(hillside_survey(), hillside_splats(), filling, frames, VIEW, fresh_context(scratch, name)))
