"""The docs name everything that exists, and what they show is what the program prints."""

import contextlib
import io
import re
from pathlib import Path

import pytest

from slideframe import hookspecs
from slideframe.catalogue import installed
from slideframe.cli import COMMANDS, main
from slideframe.config import STAGE_KINDS

DOCS = Path(__file__).parents[2] / "docs"
README = DOCS.parent / "README.md"
FIRST_PARTY = {"pose_rtk", "gs_torch", "gs_import", "render_gs", "fill_poisson", "mpm_warp", "mpm_taichi"}


def printed(*arguments: str) -> str:
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        main(arguments)
    return re.sub(r"\x1b\[[0-9;]*m", "", output.getvalue())


@pytest.mark.skipif(
    {listing.name for listing in installed()} != FIRST_PARTY,
    reason="other plugins are installed: the page would differ",
)
def test_the_options_page_is_what_schema_prints():
    page = (DOCS / "options.md").read_text()
    assert page[page.index("## ") :].strip() == printed("schema", "--markdown").strip(), (
        "renew docs/options.md, see its head"
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_every_flag_stands_in_the_command_line_page(command):
    page = (DOCS / "command_line.md").read_text()
    assert f"slideframe {command}" in page
    # dotted flags are the config's keys: the options page has them
    flags = set(re.findall(r"--[a-z][a-z-]*(?=[\s,|]|$)", printed(command, "--help")))
    missing = {flag for flag in flags if flag not in page}
    assert not missing


def test_the_hook_and_the_interfaces_stand_in_the_plugin_guide():
    guide = (DOCS / "writing_a_plugin.md").read_text()
    names = [name for name in vars(hookspecs) if name.startswith("slideframe_")]
    assert names
    for name in (*names, *STAGE_KINDS, "PoseSource", "Reconstructor", "VolumeFiller", "Solver", "Renderer", "Context"):
        assert name in guide, name


@pytest.mark.parametrize("page", [README, *sorted(DOCS.rglob("*.md"))], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_the_readmes_commands_are_those_of_the_makefile():
    makefile = (DOCS.parent / "Makefile").read_text()
    for target in re.findall(r"`make (\w+)`", README.read_text()):
        assert f"\n{target}:" in makefile
