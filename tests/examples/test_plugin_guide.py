"""docs/writing_a_plugin.md, followed to the letter: its files are written, its commands are run."""

import os
import re
import subprocess
import sys
from pathlib import Path

GUIDE = Path(__file__).parents[2] / "docs" / "writing_a_plugin.md"
FENCE = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


def test_the_guide_leads_to_a_passing_plugin(tmp_path):
    project, site = tmp_path / "slideframe-damped", tmp_path / "site"
    blocks = FENCE.findall(GUIDE.read_text())
    for _, text in blocks:
        named = re.match(r"# (\S+\.(?:toml|py))\n", text)
        if named:
            file = project / named[1]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text.removeprefix(named[0]))
    layout = next(text for language, text in blocks if language == "text")
    written = {str(file.relative_to(project)) for file in project.rglob("*.*") if file.is_file()}
    assert written == set(layout.split()[1:])

    (commands,) = [text.split("\n") for language, text in blocks if language == "sh"]
    # the same commands, but into a folder of the test's own and without a network
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target"]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    printed = {}
    for command in filter(None, commands):
        program, *arguments = command.split()
        started = {
            "pip": [*install, str(site), "."],
            "slideframe": ["-c", f"import sys; from slideframe.cli import main; sys.exit(main({arguments!r}))"],
            "pytest": ["-m", "pytest", "-q", *arguments],
        }[program]
        done = subprocess.run(
            [sys.executable, *started], cwd=project, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        printed[command] = done.stdout
    assert "damped" in printed["slideframe plugins"]
    assert "drag" in printed["slideframe check damped"]
    assert "passed" in printed["pytest tests"]
