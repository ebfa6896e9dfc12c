"""From frames of particles to pictures, one at a time."""

import time
from collections.abc import Iterable, Iterator, Sequence, Sized
from itertools import islice

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.coupling import Coupling
from slideframe.errors import InputError
from slideframe.problem import Shot, View
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey
from slideframe.showing import soil_bounds
from slideframe.stages import Context
from slideframe_render_gs.drawing import draw, enlarge
from slideframe_render_gs.moving_scene import MovingScene

# Splats seen from farther beside every photograph than this, degrees, show what no photograph held in check.
FARTHEST_BESIDE = 25.0
LOOKS_ON_THE_WAY = 9


def pictures(
    survey: Survey,
    splats: SplatCloud,
    filling: Filling,
    motion: Iterable[ParticleFrame],
    view: View,
    context: Context,
) -> Iterator[Picture]:
    """Yield one picture per frame; memory is that of one frame.

    The camera goes its way over the film where the motion knows its length; else it stands still. No picture
    depends on those before it, so a film that broke off goes on after what is stored.

    Raises:
        InputError: the camera sees no splat of the first frame.
    """
    coupling = Coupling(splats, filling)
    scene = MovingScene(coupling)
    bounds = soil_bounds(filling)
    shot = view.shot(survey, bounds)
    count = len(motion) if isinstance(motion, Sized) else 0
    _warn_of(shot, count, _farthest_beside(shot, survey, bounds.mean(axis=0)), context)
    context.figure("splats", len(coupling))
    seconds, blind = 0.0, 0
    context.resume(context.stored)
    for index, frame in _frames_from(motion, context.first_item):
        began = time.perf_counter()
        camera, pose = shot(index / max(count - 1, 1) if count else 0.0)
        moved = scene.at(frame, enlarge(camera, view.supersampling), pose)
        fields, shows_any = draw(moved, camera, pose, view)
        if not shows_any and index == 0:
            raise InputError("the camera sees nothing of the scene", where="view", cure=_where_splats_are(splats))
        blind += not shows_any
        picture = Picture(time=frame.time, **fields)
        seconds += time.perf_counter() - began
        context.figure("frames_per_second", (index + 1 - context.first_item) / seconds)
        context.progress(index + 1, max(count, index + 1))
        yield picture
    if blind:
        context.warn(f"the camera sees nothing of the scene in {blind} pictures")


def _frames_from(motion: Iterable[ParticleFrame], first: int) -> Iterator[tuple[int, ParticleFrame]]:
    """Give the frames from `first` on with their numbers, reading no earlier ones where the motion allows it."""
    if isinstance(motion, Sequence):
        return ((index, motion[index]) for index in range(first, len(motion)))
    return islice(enumerate(motion), first, None)


def _warn_of(shot: Shot, count: int, beside: float, context: Context) -> None:
    """Tell what will not be as one would wish: a camera that can't go its way, or sees what no photograph saw."""
    if not count and _moves(shot):
        context.warn("the length of the film is not known beforehand, so the camera stands still")
    if beside > FARTHEST_BESIDE:
        context.warn(
            f"the camera looks at the mass from up to {beside:.0f} degrees beside the nearest photograph: what none "
            "showed from there is haze"
        )


def _moves(shot: Shot) -> bool:
    return not np.array_equal(shot(0.0)[1], shot(1.0)[1])


def _farthest_beside(shot: Shot, survey: Survey, target: Float64Array) -> float:
    """Return the largest angle, degrees, at the target between the film's camera and the photograph nearest to it."""
    places = [shot(float(share))[1][:, 3] for share in np.linspace(0, 1, LOOKS_ON_THE_WAY)]
    film, taken = (
        way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        for way in (np.array(places) - target, survey.world_from_camera[:, :, 3] - target)
    )
    return float(np.degrees(np.arccos((film @ taken.T).max(axis=1).clip(-1, 1).min())))


def _where_splats_are(splats: SplatCloud) -> str:
    low, high = np.percentile(splats.centers, [1, 99], axis=0)
    return (
        f"the splats reach over x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}, "
        f"z {low[2]:.1f} to {high[2]:.1f} m: put the camera where it looks at them"
    )
