"""The line that says where a figure was measured."""

import os
import platform
from importlib.metadata import version
from pathlib import Path


def print_machine(*packages: str) -> None:
    names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    processor = names[0].partition(": ")[2] if names else platform.processor()
    print(f"{processor}, {len(os.sched_getaffinity(0))} cores; Python {platform.python_version()}, ", end="")
    print(", ".join(f"{package} {version(package)}" for package in packages))
