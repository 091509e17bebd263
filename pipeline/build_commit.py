"""Build hook: puts the commit that sdist and wheel are built from into them as commit.txt."""

import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface):
    """Adds archfrag/commit.txt; an sdist's own is taken over by the wheel made from it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        root = Path(self.root)
        if version == "editable" or not (root / ".git").exists():
            return
        described = subprocess.run(
            ["git", "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"],
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
        )
        made = Path(tempfile.mkdtemp()) / "commit.txt"
        made.write_text(described.stdout, encoding="utf-8", newline="\n")
        folder = "pipeline/archfrag" if self.target_name == "sdist" else "archfrag"
        build_data["force_include"][str(made)] = f"{folder}/commit.txt"
