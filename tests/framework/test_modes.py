"""A mode presets keys, what is given wins, and the two are told apart."""

import tomllib
from pathlib import Path

import pytest

from slideframe.cli import main
from slideframe.commands.run import RunOptions, read_config
from slideframe.config import RunConfig, read_toml, validate
from slideframe.errors import ConfigurationError
from slideframe.modes import apply_mode, chosen
from slideframe.run_folder import mode_of, result_table

CONFIGS = Path(__file__).parents[2] / "configs"
BARE = """
[site]
photographs = "photos"
[region]
x_min = 0.0
x_max = 9.0
y_min = 0.0
y_max = 9.0
z_min = -5.0
[simulation]
duration = 1.0
grid_spacing = 1.0
"""


def config_of(mode, **tables) -> RunConfig:
    content = tomllib.loads(BARE) | {"mode": mode}
    for name, table in tables.items():
        content[name] = content.get(name, {}) | table
    return validate(RunConfig, apply_mode(content), "case")


def test_paper_is_the_papers_card_and_box():
    config = config_of("paper")
    sand = config.material
    assert (sand.kind, sand.friction_match) == ("sand", "triaxial_compression")
    card = (sand.friction_angle, sand.density, sand.youngs_modulus, sand.poisson_ratio)
    assert card == (22.0, 2000.0, 5e7, 0.3)
    boundary = config.boundary
    assert (boundary.sides.kind, boundary.floor.kind, boundary.terrain.kind) == ("slip", "slip", "open")
    assert boundary.domain.extent == "region"
    assert config.simulation.gravity == (0.0, 0.0, -9.8)
    assert (config.simulation.initial_stress, config.simulation.stop) == ("none", "duration")
    assert config.plugins["fill_poisson"] == {"mode": "paper", "placement": "lattice", "color_neighbours": 1}


def test_engineering_runs_out_over_the_ground_from_equilibrium():
    config = config_of("engineering", material={"friction_angle": 35.0})
    soil = config.material
    assert (soil.kind, soil.friction_match, soil.friction_angle) == ("drucker_prager", "mohr_coulomb", 35.0)
    boundary = config.boundary
    assert (boundary.sides.kind, boundary.floor.kind, boundary.domain.extent) == ("open", "open", "terrain")
    assert (boundary.terrain.kind, boundary.terrain.friction_angle) == ("friction", 35.0)
    assert (config.simulation.initial_stress, config.simulation.stop) == ("ramp", "rest")
    assert config.plugins["fill_poisson"] == {"mode": "engineering"}


def test_engineering_guesses_no_friction_angle():
    with pytest.raises(ConfigurationError, match="doesn't guess") as refused:
        config_of("engineering")
    assert refused.value.where == "material.friction_angle"


def test_what_is_given_wins():
    config = config_of(
        "paper",
        material={"density": 1700.0},
        boundary={"floor": {"kind": "friction", "friction_angle": 30.0}, "terrain": {"kind": "stick"}},
        simulation={"initial_stress": "k0", "transfer": {"kind": "asflip"}},
        plugins={"fill_poisson": {"color_neighbours": 8}},
    )
    assert (config.material.density, config.material.friction_angle) == (1700.0, 22.0)
    assert (config.boundary.floor.friction_angle, config.boundary.terrain.kind) == (30.0, "stick")
    assert (config.simulation.initial_stress, config.simulation.transfer.kind) == ("k0", "asflip")
    assert config.plugins["fill_poisson"]["color_neighbours"] == 8
    assert config.plugins["fill_poisson"]["mode"] == "paper"


def test_another_kind_takes_only_what_it_has_itself():
    elastic = config_of("paper", material={"kind": "elastic"})
    assert (elastic.material.kind, elastic.material.youngs_modulus) == ("elastic", 5e7)
    smooth = config_of("engineering", material={"friction_angle": 30.0}, boundary={"terrain": {"kind": "slip"}})
    assert (smooth.boundary.terrain.kind, smooth.boundary.terrain.friction_angle) == ("slip", 0.0)
    held = config_of("engineering", material={"kind": "elastic"})
    assert held.boundary.terrain.kind == "stick"


def test_a_friction_wall_without_its_angle_takes_the_presets():
    config = config_of("engineering", material={"friction_angle": 30.0}, boundary={"terrain": {"kind": "friction"}})
    assert config.boundary.terrain.friction_angle == 30.0


def test_an_unknown_mode_is_told():
    with pytest.raises(ConfigurationError, match="mode: Input should be 'paper' or 'engineering'"):
        config_of("sloppy", material={"friction_angle": 30, "density": 1, "youngs_modulus": 1, "poisson_ratio": 0})


def test_the_result_page_tells_the_modes_values_from_the_configs():
    config = config_of("paper", material={"density": 1700.0})
    table = result_table({"outputs": {"mode": mode_of(config)}}, [])
    assert "## mode: paper" in table
    assert "| material.density | 1700.0 | the config; the mode has 2000.0 |" in table
    assert "| material.youngs_modulus | 50000000.0 | the mode |" in table
    assert "| plugins.fill_poisson.mode | paper | the mode |" in table
    assert {option.key for option in chosen(config)} >= {"boundary.sides.kind", "simulation.stop"}


def test_a_resolved_config_keeps_its_values_under_its_mode():
    config = config_of("engineering", material={"friction_angle": 35.0})
    assert validate(RunConfig, apply_mode(config.model_dump(mode="json")), "again") == config


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
@pytest.mark.parametrize("mode", ["paper", "engineering"])
def test_every_config_runs_in_both_modes(path, mode):
    content = read_toml(path)
    config = read_config(RunOptions(config=path, mode=mode))
    assert config.mode == mode
    assert config.material.friction_angle == content["material"]["friction_angle"]
    assert config.simulation.initial_stress == {"paper": "none", "engineering": "ramp"}[mode]


def test_the_template_of_init_is_sound(tmp_path):
    assert main(["init", str(tmp_path / "site.toml"), "--photographs", str(tmp_path)]) == 0
    config = read_config(RunOptions(config=tmp_path / "site.toml"))
    assert (config.mode, config.boundary.terrain.friction_angle) == ("engineering", config.material.friction_angle)
    assert read_config(RunOptions(config=tmp_path / "site.toml", mode="paper")).material.kind == "sand"
