"""The `--device` option, parsed once; each plugin converts it at its own edge."""

import ctypes
import re
from dataclasses import dataclass
from functools import cache
from typing import Literal

from slideframe.errors import ConfigurationError, MissingDependency


@dataclass(frozen=True)
class Device:
    """Where a stage computes."""

    kind: Literal["cpu", "cuda"] = "cpu"
    index: int = 0

    def __str__(self) -> str:
        return "cpu" if self.kind == "cpu" else f"cuda:{self.index}"


def parse_device(text: str) -> Device:
    """Read `cpu`, `cuda`, `cuda:N` or `auto` (CUDA where a driver and a card are there, else the CPU).

    Raises:
        ConfigurationError: the text is none of these.
        MissingDependency: CUDA was asked for by name and that card is not there.
    """
    if text == "auto":
        return Device("cuda") if cuda_device_count() else Device()
    if text == "cpu":
        return Device()
    match = re.fullmatch(r"cuda(?::(\d+))?", text)
    if not match:
        raise ConfigurationError(f"unknown device '{text}'", where="--device", cure="use auto, cpu, cuda or cuda:N")
    index = int(match[1] or 0)
    if index >= cuda_device_count():
        raise MissingDependency(
            f"device '{text}' is not there: the NVIDIA driver reports {cuda_device_count()} card(s)",
            where="--device",
            cure="use --device cpu, or install the NVIDIA driver",
        )
    return Device("cuda", index)


@cache
def cuda_device_count() -> int:
    """Ask the NVIDIA driver itself, so that no framework need be imported."""
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return 0
    count = ctypes.c_int()
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return 0
    return count.value
