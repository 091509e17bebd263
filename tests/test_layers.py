"""Layers of the code, style, types, and nothing at the top that is not meant."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOP = {
    ".ci", ".git", ".gitignore", "CHANGELOG.md", "CITATION.cff", "LICENSE", "README.md",
    "Snakefile", "configs", "docs", "pipeline", "pyproject.toml", "records", "tests",
}  # fmt: skip
BIN = Path(sys.executable).parent


@pytest.mark.parametrize(
    "command",
    [
        ["lint-imports", "--no-cache"],
        ["ruff", "check", "--no-cache", "."],
        ["mypy", "--no-incremental"],
    ],
    ids=lambda command: command[0] + command[1],
)
def test_command_finds_nothing(command):
    done = subprocess.run(
        [str(BIN / command[0]), *command[1:]], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-1000:]


def test_nothing_else_at_the_top_level():
    listed = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
    found = {name.split("/")[0] for name in listed}
    assert found <= TOP, f"not meant to be here: {sorted(found - TOP)}"
