"""Which code draws: chosen by the device that the tensors are on."""

import logging
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Literal

import torch

from slideframe.errors import InputError, MissingDependency
from slideframe_gs_torch.reference import PlaneDrawing, composite_exactly

_log = logging.getLogger("slideframe")

Backend = Literal["numba", "torch", "gsplat", "warp"]
Draw = Callable[..., PlaneDrawing]
# Where each backend's tensors may be.
DEVICES: dict[Backend, tuple[str, ...]] = {
    "numba": ("cpu",), "torch": ("cpu",), "gsplat": ("cuda",), "warp": ("cpu", "cuda")
}  # fmt: skip


def choose_backend(device: torch.device) -> Backend:
    """Return the backend for a device: `numba`; on a card `gsplat` where it can be compiled, else `warp`."""
    if device.type == "cpu":
        return "numba"
    return "gsplat" if gsplat_works(device) else "warp"


def draw_with(backend: Backend, device: torch.device) -> Draw:
    """Return the backend's drawing function, whose arguments are those of `composite_exactly`.

    Raises:
        InputError: there is no such backend, or it can't work with tensors on this device.
        MissingDependency: what it needs is not installed.
    """
    if backend not in DEVICES:
        raise InputError(f"there is no backend '{backend}'", cure=f"name one of {', '.join(DEVICES)}, or none")
    if device.type not in DEVICES[backend]:
        raise InputError(
            f"the backend '{backend}' can't draw tensors on '{device.type}'",
            cure=f"move them to {' or '.join(DEVICES[backend])}, or leave the backend to be chosen",
        )
    if backend == "torch":
        return composite_exactly
    if backend == "numba":
        from slideframe_gs_torch.boundary import draw_compiled

        return draw_compiled
    if backend == "gsplat":
        _require("gsplat", "cuda")
        from slideframe_gs_torch.gsplat_backend import draw_gsplat

        return draw_gsplat
    _require("warp", "warp")
    from slideframe_gs_torch.warp_backend import draw_warp

    return draw_warp


def _require(module: str, extra: str) -> None:
    if find_spec(module) is None:
        raise MissingDependency(
            f"drawing splats with '{module}' needs a package that is not installed",
            where=f"module {module}",
            cure=f"pip install 'slideframe-gs-torch[{extra}]'",
        )


@cache
def gsplat_works(device: torch.device) -> bool:
    """Draw one splat: gsplat's wheel holds no kernels, and compiles them at first use, which needs nvcc."""
    if find_spec("gsplat") is None:
        return False
    from slideframe_gs_torch.gsplat_backend import draw_one_splat

    try:
        draw_one_splat(device)
    except Exception as error:
        # whatever it is that it lacks: a compiler, a header, a card it knows
        reason = next(iter(str(error).splitlines()), "")
        _log.warning(
            "gsplat is installed but can't draw on %s, so Warp does: %s: %s", device, type(error).__name__, reason
        )
        return False
    return True
