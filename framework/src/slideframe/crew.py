"""The five chosen stages of a run, found, validated and preflighted before any of them computes."""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from slideframe import catalogue, registry
from slideframe.catalogue import Listing
from slideframe.config import STAGE_KINDS, RunConfig, StageChoice, validate
from slideframe.contact import require_sound_files
from slideframe.device import Device
from slideframe.errors import ConfigurationError
from slideframe.guards import check_spacing
from slideframe.problem import FileView
from slideframe.quality.surface import require_readable
from slideframe.stages import PoseSource, Reconstructor, Renderer, Solver, Stage, StageKind, VolumeFiller


@dataclass(frozen=True)
class Crew:
    """One stage of each kind, with the distributions that they came from."""

    pose_source: PoseSource
    reconstructor: Reconstructor
    volume_filler: VolumeFiller
    solver: Solver
    renderer: Renderer
    listings: Mapping[str, Listing]

    def stages(self) -> Iterator[Stage]:
        """Give the stages in the order of the pipeline."""
        for kind in STAGE_KINDS:
            yield getattr(self, kind)

    def preflight(self, config: RunConfig, device: Device) -> None:
        """Raise the first reason for which a stage could not do its part of this run."""
        if isinstance(config.view, FileView):
            config.view.require_files()
        if config.reference_ground is not None:
            require_readable(config.reference_ground)
        for stage in self.stages():
            registry.require_backend(stage, self.listings[stage.name])
            stage.preflight(config.problem_of(stage.kind), device_for(stage, device))
        self.solver.require_features(config.simulation_problem)
        require_sound_files(config.boundary)
        if config.region.plan_size:
            check_spacing(config.region.plan_size, config.simulation, self.solver.least_memory)


def device_for(stage: Stage, device: Device) -> Device:
    """Return the device, or the CPU for a stage that can't use it."""
    return device if device.kind in stage.devices else Device()


def load_classes(choice: StageChoice) -> dict[StageKind, type[Stage]]:
    """Import the chosen plugins and check that each is of the kind that it is chosen for."""
    names = choice.names()
    classes = registry.load(names.values())
    for kind, name in names.items():
        if classes[name].kind != kind:
            raise ConfigurationError(
                f"'{name}' is a {classes[name].kind}, not a {kind}",
                where=f"stages.{kind}",
                cure="see `slideframe plugins` for those of the right kind",
            )
    return {kind: classes[name] for kind, name in names.items()}


def assemble(config: RunConfig) -> Crew:
    """Load the chosen stages with their options; tables of plugins that are not chosen are left alone.

    Raises:
        ConfigurationError: a table's plugin is not installed, or an option is wrong.
    """
    known = {listing.name for listing in catalogue.installed()}
    for name in config.plugins:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            raise ConfigurationError(
                f"options are given for '{name}', but no plugin of that name is installed",
                where=f"[plugins.{name}]",
                cure=f"did you mean '{near[0]}'?" if near else "remove the table, or install the plugin",
            )
    stages: dict[str, Any] = {
        kind: validate(stage, config.plugins.get(stage.name, {}), f"[plugins.{stage.name}]")
        for kind, stage in load_classes(config.stages).items()
    }
    return Crew(**stages, listings={stage.name: catalogue.find(stage.name) for stage in stages.values()})
