"""`slideframe doctor`: what this machine offers, what it lacks, and the cure."""

import importlib
import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import packages_distributions, version
from pathlib import Path

import tyro

from slideframe import catalogue, registry
from slideframe.device import cuda_device_count
from slideframe.errors import SlideframeError


@dataclass(frozen=True)
class DoctorOptions:
    """Report what this machine offers and lacks. Imports every plugin and its backend."""


@dataclass(frozen=True)
class Finding:
    """One line of the report."""

    what: str
    healthy: bool
    detail: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.healthy else 'LACK'} {self.what:<24} {self.detail}"


def main(arguments: Sequence[str]) -> int:
    """Print the report; exit 3 when something needed is lacking."""
    tyro.cli(DoctorOptions, args=list(arguments), prog="slideframe doctor")
    sick = False
    for finding in (*_machine(), *_plugins(), *_packages()):
        print(finding)
        sick |= not finding.healthy
    return 3 if sick else 0


def _machine() -> Iterator[Finding]:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    yield Finding("python", True, f"{platform.python_version()} on {platform.platform()}")
    yield Finding("processors, memory", True, f"{os.cpu_count()}, {memory:.1f} GiB")
    yield Finding("disk here", True, f"{shutil.disk_usage(Path.cwd()).free / 2**30:.1f} GiB free")
    yield Finding("CUDA", True, f"{cuda_device_count()} card(s); none is needed")


def _plugins() -> Iterator[Finding]:
    for listing in catalogue.installed():
        try:
            stage = registry.load([listing.name])[listing.name]
            registry.require_backend(stage, listing)
        except SlideframeError as error:
            yield Finding(listing.name, False, str(error))
            continue
        for package in stage.backend:
            yield _package(f"{listing.name}: {package}", package)


def _packages() -> Iterator[Finding]:
    yield _package("recording: rerun", "rerun")
    yield _package("film: av", "av", cure='pip install "slideframe[video]"')


def _package(label: str, package: str, cure: str = "") -> Finding:
    try:
        importlib.import_module(package)
    except (ImportError, OSError) as error:  # OSError: a system library that a wheel links against
        hint = cure or "open3d needs: apt-get install libusb-1.0-0 libgl1 libgomp1" * (package == "open3d")
        return Finding(label, False, f"{error}; {hint or 'pip install ' + package}")
    return Finding(label, True, _version_of(package))


def _version_of(package: str) -> str:
    distributions = packages_distributions().get(package, [])
    return version(distributions[0]) if distributions else ""
