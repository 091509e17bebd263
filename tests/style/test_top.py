"""Nothing is at the top of the repository that is not meant to be, and lists name what exists."""

import csv
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
TOP = {
    ".ci",
    ".git",
    ".gitattributes",
    ".github",
    ".gitignore",
    ".pre-commit-config.yaml",
    "CHANGELOG.md",
    "CITATION.cff",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "LICENSE",
    "README.md",
    "SECURITY.md",
    "Snakefile",
    "configs",
    "docs",
    "noxfile.py",
    "pipeline",
    "pyproject.toml",
    "records",
    "tests",
}


def test_nothing_else_at_the_top_level():
    listed = subprocess.check_output(
        ["git", "ls-files"], cwd=ROOT, text=True
    ).splitlines()
    found = {name.split("/")[0] for name in listed}
    assert found <= TOP, f"not meant to be here: {sorted(found - TOP)}"


def test_each_test_that_is_called_slow_exists():
    with (ROOT / "tests" / "slow.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 30
    for row in rows:
        path, *names = row["test"].partition("[")[0].split("::")
        text = (ROOT / path).read_text("utf-8")
        assert all(
            f"def {name}(" in text or f"class {name}" in text for name in names
        ), row
        assert float(row["cpu_seconds"]) >= 2.0
