import tomllib

import pytest

from slideframe.bench import _named_files
from slideframe.config import RunConfig, absolute, apply_override, read_toml, validate, write_toml
from slideframe.errors import ConfigurationError

MINIMAL = """
[site]
photographs = "photos"
[region]
x_min = 0.0
x_max = 9.0
y_min = 0.0
y_max = 9.0
z_min = -5.0
[material]
friction_angle = 22
density = 2000
youngs_modulus = 5e7
poisson_ratio = 0.3
[simulation]
duration = 1.0
grid_spacing = 1.0
"""


def content():
    return tomllib.loads(MINIMAL)


def faults(raw) -> str:
    with pytest.raises(ConfigurationError) as caught:
        validate(RunConfig, raw, "case.toml")
    assert caught.value.exit_code == 2
    return str(caught.value)


def test_photographs_are_meant_from_the_file(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(MINIMAL)
    assert read_toml(path)["site"]["photographs"] == str(tmp_path / "photos")


def test_unknown_key_names_the_nearest_known_one():
    raw = content()
    raw["material"]["frction_angle"] = 30
    assert "material.frction_angle: unknown key, did you mean 'friction_angle'?" in faults(raw)


def test_a_kind_that_there_is_none_of_is_told_with_those_that_there_are():
    raw = content()
    raw["simulation"]["transfer"] = {"kind": "flip"}
    assert "simulation.transfer: kind 'flip' is none of 'apic', 'pic_flip', 'asflip'" in faults(raw)
    raw["simulation"]["transfer"] = "asflip"
    assert "simulation.transfer: a table with its kind is wanted" in faults(raw)


def test_every_fault_is_told_at_once_with_key_and_rule():
    raw = content()
    raw["simulation"]["duration"] = "long"
    raw["material"]["density"] = -3
    del raw["region"]["x_min"]
    text = faults(raw)
    assert "simulation.duration: Input should be a valid number" in text
    assert "material.density: Input should be greater than 0 (got -3)" in text
    assert "material.density takes more than 0: kg/m3, in place; soil has 1400 to 2300" in text
    assert "region.x_min: required but absent" in text
    assert "case.toml" in text


@pytest.mark.parametrize(
    ("table", "key", "value", "told"),
    [
        ("material", "youngs_modulus", 5e13, "youngs_modulus in Pa (5e7 is usual)"),
        ("material", "poisson_ratio", 0.4999999, "keep poisson_ratio below 0.49"),
        ("material", "friction_angle", 90, "friction_angle takes more than 0 and less than 90: degrees"),
        ("simulation", "gravity", [0, 0, -1e7], "gravity has 1e+07 m/s2, and the Earth's 9.81"),
    ],
)
def test_what_no_soil_and_no_world_has_is_refused_with_what_is_usual(table, key, value, told):
    raw = content()
    raw[table][key] = value
    text = faults(raw)
    assert told in text
    assert "(got {" not in text


def test_meshes_are_meant_from_the_file_and_survive_the_resolved_config(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(MINIMAL + '[[boundary.meshes]]\npath = "wall.ply"\nkind = "stick"\n')
    config = validate(RunConfig, read_toml(path), "case")
    assert config.boundary.meshes[0].path == tmp_path / "wall.ply"
    write_toml(config, tmp_path / "run.toml")
    assert validate(RunConfig, read_toml(tmp_path / "run.toml"), "again").boundary == config.boundary
    assert list(_named_files(config.simulation_problem)) == [tmp_path / "wall.ply"]


def test_paths_of_the_command_line_are_meant_from_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    raw = content()
    apply_override(raw, "boundary.meshes=[{path = 'wall.ply'}]")
    assert absolute(validate(RunConfig, raw, "case")).boundary.meshes[0].path == tmp_path / "wall.ply"


def test_a_fault_in_a_mesh_names_its_place():
    raw = content()
    raw["boundary"] = {"meshes": [{"path": "a.ply", "frction_angle": 3}, {"path": "b.ply", "kind": "open"}]}
    text = faults(raw)
    assert "boundary.meshes.0.frction_angle: unknown key, did you mean 'friction_angle'?" in text
    assert "boundary.meshes.1: a mesh of kind = 'open' would do nothing" in text


def test_a_box_has_one_base():
    raw = content()
    del raw["region"]["z_min"]
    assert "region: give z_min for a flat base, or a table base for any other" in faults(raw)
    raw["region"]["base"] = {"kind": "constant_depth", "depth": -1}
    assert "region.base.depth: Input should be greater than 0" in faults(raw)


def test_not_toml_names_the_line(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("[site\n")
    with pytest.raises(ConfigurationError, match=r"not TOML: .*line 1"):
        read_toml(path)


def test_absent_file(tmp_path):
    with pytest.raises(ConfigurationError, match="can't be read"):
        read_toml(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("assignment", "value"),
    [
        ("a.b=3", 3),
        ("a.b = 1.5", 1.5),
        ("a.b=true", True),
        ("a.b=plane_strain", "plane_strain"),
        ("a.b=[1, 2]", [1, 2]),
    ],
)
def test_override_reads_the_value_as_toml_else_as_text(assignment, value):
    raw = {}
    apply_override(raw, assignment)
    assert raw == {"a": {"b": value}}


@pytest.mark.parametrize("assignment", ["nothing", "=3", "seed.x=3"])
def test_bad_override(assignment):
    with pytest.raises(ConfigurationError):
        apply_override({"seed": 1}, assignment)


def test_resolved_config_runs_the_same_again(tmp_path):
    config = validate(RunConfig, content() | {"plugins": {"mpm_warp": {"x": 1}}}, "case")
    write_toml(config, tmp_path / "run.toml")
    assert validate(RunConfig, read_toml(tmp_path / "run.toml"), "again").model_dump() == (
        config.model_dump() | {"site": {"photographs": tmp_path / "photos", "masks": None}}
    )
