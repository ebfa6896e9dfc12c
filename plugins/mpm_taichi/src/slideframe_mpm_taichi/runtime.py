"""The one owner of Taichi's global runtime: `ti.init` and `ti.reset` stand nowhere else.

`ti.init` destroys the memory of every simulation that still runs. So simulations on the same device in
the same precision share one runtime, and another one waits until the last of them has ended.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from io import StringIO

from slideframe.device import Device
from slideframe.errors import PluginError


@dataclass
class _Runtime:
    """What `ti.init` was last called with, and how many simulations rely on it."""

    settings: tuple[Device, str] | None = None
    users: int = 0


_runtime = _Runtime()


@contextmanager
def session(device: Device, precision: str) -> Iterator[None]:
    """Keep Taichi ready on `device`, with `precision` as its default type, while the block runs.

    Raises:
        PluginError: a simulation with other settings is still running in this process.
    """
    settings = (device, precision)
    if _runtime.settings != settings:
        if _runtime.users:
            raise PluginError(
                f"mpm_taichi can't start on {device} in {precision}: another simulation still runs in this process",
                where="mpm_taichi",
                cure="end the other simulation first (exhaust or close its generator), or use a second process",
            )
        _start(device, precision)
        _runtime.settings = settings
    _runtime.users += 1
    try:
        yield
    finally:
        _runtime.users -= 1


def _start(device: Device, precision: str) -> None:
    # Taichi prints a banner on import, to stdout, unless told otherwise
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
    import taichi as ti

    if device.kind == "cuda":
        # Taichi has no other way to choose a card
        os.environ.setdefault("CUDA_VISIBLE_DEVICES", str(device.index))
    # ti.init announces the architecture with print()
    with redirect_stdout(StringIO()):
        ti.reset()
        before = _threads()
        ti.init(
            arch=ti.cuda if device.kind == "cuda" else ti.cpu,
            default_fp=ti.f64 if precision == "float64" else ti.f32,
            # fast_math lets the compiler assume that NaN never happens, and the kernels test for it
            fast_math=False,
            enable_fallback=False,
            log_level=ti.ERROR,
        )
    if device.kind == "cpu" and (started := _threads() - before):
        _spread(started)


def _threads() -> set[int]:
    """Return the ids of this process's threads; none where the system doesn't list them, nor binds any."""
    try:
        return {int(name) for name in os.listdir("/proc/self/task")}
    except OSError:
        return set()


def _spread(threads: set[int]) -> None:
    """Bind Taichi's threads to the cores in turn, so that its workers, started one after another, have one each.

    They sleep between loops, a few milliseconds apart. Linux often wakes all of them on the core of the thread that
    waits for them, where they take turns while another core idles.
    """
    cores = sorted(os.sched_getaffinity(0))
    for place, thread in enumerate(sorted(threads)):
        with suppress(OSError):  # it has ended
            os.sched_setaffinity(thread, {cores[place % len(cores)]})
