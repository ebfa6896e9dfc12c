import subprocess
import sys

import pytest

from slideframe import catalogue, registry
from slideframe.errors import MissingDependency, PluginConflict, PluginError, PluginNotFound

GOOD = """
from slideframe.hookspecs import hookimpl
from slideframe.stages import Renderer


class Stage(Renderer):
    name = "{name}"
    backend = {backend}

    def render(self, splats, filling, motion, problem, context):
        yield from ()


@hookimpl
def slideframe_stage():
    return Stage
"""


def good(name: str, backend: tuple[str, ...] = ()) -> str:
    return GOOD.format(name=name, backend=backend)


def test_listing_imports_nothing_of_a_plugin(install):
    install("explosive", {"explosive": "explosive_module"}, {"explosive_module": "raise SystemExit('imported')"})
    assert "explosive" in {listing.name for listing in catalogue.installed()}


def test_a_broken_neighbour_harms_no_run(install):
    install("neighbour", {"broken_one": "broken_module"}, {"broken_module": "import not_there"})
    install("healthy", {"healthy_one": "healthy_module"}, {"healthy_module": good("healthy_one")})
    assert registry.load(["healthy_one"])["healthy_one"].name == "healthy_one"


def test_a_broken_plugin_is_named_with_its_distribution_and_the_cause(install):
    install("neighbour", {"broken_one": "broken_module2"}, {"broken_module2": "import not_there"})
    with pytest.raises(
        PluginError, match=r"'broken_one' of distribution neighbour 1.0 .*No module named 'not_there'"
    ) as error:
        registry.load(["broken_one"])
    assert isinstance(error.value.__cause__, ModuleNotFoundError)


def test_a_name_conflict_names_both_distributions(install):
    install("first-claim", {"same": "a_module"})
    install("second-claim", {"same": "b_module"})
    with pytest.raises(PluginConflict, match=r"first-claim 1.0 and second-claim 1.0"):
        registry.load(["same"])


def test_an_unknown_name_suggests_the_nearest(install):
    install("healthy", {"healthy_one": "healthy_module"})
    with pytest.raises(PluginNotFound, match="did you mean 'healthy_one'"):
        registry.load(["healthy_on"])


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("x = 1", "has no hook 'slideframe_stage'"),
        (good("another_name"), "must equal the entry point's name"),
        (good("odd").replace("return Stage", "return Stage()"), "which is no Stage class"),
        (good("odd").replace("def render(", "def rendr("), "leaves abstract: render"),
        (good("odd").replace("return Stage", "import not_there"), "fails in its hook: ModuleNotFoundError"),
        (good("odd").replace("def slideframe_stage():", "def slideframe_stage(extra):"), "can't be imported"),
    ],
)
def test_a_breach_of_the_contract_is_told(install, source, complaint, request):
    module = f"breach_{abs(hash(source))}"
    install("breach", {"odd": module}, {module: source})
    with pytest.raises(PluginError, match=complaint):
        registry.load(["odd"])


def test_a_missing_backend_is_told_with_its_cure(install):
    install("needy", {"needy": "needy_module"}, {"needy_module": good("needy", ("not_installed_package",))})
    stage = registry.load(["needy"])["needy"]
    with pytest.raises(MissingDependency, match=r"needs the package 'not_installed_package'(.|\n)*pip install .*needy"):
        registry.require_backend(stage, catalogue.find("needy"))


def test_the_first_party_plugins_are_listed_with_their_kinds():
    kinds = {listing.name: listing.kind for listing in catalogue.installed()}
    assert (
        kinds.items()
        >= {
            "pose_rtk": "pose_source",
            "gs_torch": "reconstructor",
            "gs_import": "reconstructor",
            "fill_poisson": "volume_filler",
            "mpm_warp": "solver",
            "mpm_taichi": "solver",
            "render_gs": "renderer",
        }.items()
    )


def test_the_listed_kind_is_the_stages_own():
    for listing in catalogue.installed():
        if listing.distribution.startswith("slideframe-"):
            assert registry.load([listing.name])[listing.name].kind == listing.kind


def test_python_can_list_without_numpy():
    code = "import slideframe.catalogue as c, sys; c.installed(); sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
