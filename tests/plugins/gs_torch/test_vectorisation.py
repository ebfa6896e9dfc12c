"""The compositing kernels run in vectors: a signed index or a second buffer would cost five times the time."""

import platform
import re

import numba
import pytest
import torch

from slideframe.products import Camera
from slideframe_gs_torch import compositing_kernels
from slideframe_gs_torch.rasterize import rasterize

CAMERA = Camera(width=64, height=64, focal_x=60.0, focal_y=60.0, principal_x=32.0, principal_y=32.0)
# The exponential alone takes eight packed multiplications; the loops that don't vectorise have none.
LEAST_PACKED = {"composite": 15, "composite_backward": 25}


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="looks for x86 instructions")
@pytest.mark.parametrize("name", LEAST_PACKED)
def test_inner_loops_are_vectors(name):
    kernel = getattr(compositing_kernels, name)
    if not kernel.signatures:
        center = torch.tensor([[0.0, 0.0, 3.0]], requires_grad=True)
        shape = [torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 0.2), torch.tensor([0.5]), torch.ones(1, 3)]
        rasterize(center, *shape, camera=CAMERA, world_from_camera=torch.eye(3, 4)).colour.sum().backward()
    # what comes from the cache on disk has no assembly to look at
    fresh = numba.njit(nogil=True, fastmath=True, error_model="numpy")(kernel.py_func)
    fresh.compile(kernel.signatures[0])
    assembly = fresh.inspect_asm(kernel.signatures[0])
    packed = re.findall(r"^\s+v?(?:fn?m(?:add|sub)\d*|mul)ps\s", assembly, re.MULTILINE)
    assert len(packed) >= LEAST_PACKED[name]
