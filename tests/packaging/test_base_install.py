"""The README's lines and the home page's commands, with what the base install brings alone."""

import contextlib
import itertools
import os
import re
import shlex
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import archfrag as af
from tests.arch.test_drawing import draw_arch
from tests.study.small import write_at2

ROOT = Path(__file__).parents[2]
# Of every process of the test: what the base install does not bring cannot be imported.
BLOCK = """
import sys
class Blocked:
    names = {names}
    def find_spec(self, name, path=None, target=None):
        if name in self.names:
            raise ModuleNotFoundError(f"No module named {{name!r}}: no part of the base install")
sys.meta_path.insert(0, Blocked())
"""


def brought(lines):
    """Names of the distributions that requirements bring, the markers of this machine applied."""
    found = set()
    waiting = [(line, "") for line in lines]
    while waiting:
        line, extra = waiting.pop()
        wanted = Requirement(line)
        if wanted.marker is not None and not wanted.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(wanted.name)
        for own in {"", *wanted.extras}:
            if (name, own) not in found:
                found.add((name, own))
                with contextlib.suppress(PackageNotFoundError):
                    waiting += [(more, own) for more in requires(name) or []]
    return {name for name, _ in found}


def code_of(page, language):
    """Blocks of code of a page, in order."""
    return re.findall(
        rf"^```{language}\n(.*?)^```", (ROOT / page).read_text("utf-8"), re.M | re.S
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a drawing, records and the study file of the page on bridges."""
    folder = tmp_path_factory.mktemp("base")
    arch = af.Arch.segmental(
        span=10.0, rise=2.5, thickness=0.6, voussoirs=9, friction=0.6
    )
    draw_arch(folder / "bridge.dxf", arch, 0.001, 4)
    (folder / "records").mkdir()
    time = np.arange(300) * 0.01
    for name, frequency in (
        ("ELC180", 0.6),
        ("ELC-UP", 3.0),
        ("DZC180", 0.8),
        ("DZC-UP", 3.0),
    ):
        wave = 0.3 * np.sin(2 * np.pi * frequency * time) * np.sin(np.pi * time / 3.0)
        write_at2(folder / "records" / f"{name}.AT2", wave, 0.01, name[3:].strip("-"))
    page = (ROOT / "docs" / "howto" / "bridge.md").read_text("utf-8")
    for name, text in re.findall(r"^%%writefile (\S+)\n(.*?)^```", page, re.M | re.S):
        (folder / name).write_text(text.replace("samples: 4", "samples: 2"))
    return folder


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Environment in which only what the base install brings can be imported."""
    path = tmp_path_factory.mktemp("site")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    base = brought(project["dependencies"]) | {"archfrag"}
    assert {"ezdxf", "shapely"} <= base
    assert not {"snakemake", "sphinx", "pytest"} & base
    names = {
        module
        for module, owners in packages_distributions().items()
        if not any(canonicalize_name(owner) in base for owner in owners)
    }
    assert {"snakemake", "sphinx", "pygmm"} <= names
    (path / "sitecustomize.py").write_text(
        BLOCK.format(names=names - {"pip", "setuptools"})
    )
    above = f"{path}:{ROOT / 'pipeline'}:{os.environ.get('PYTHONPATH', '')}"
    return {**os.environ, "PYTHONPATH": above}


def run(folder, alone, *words):
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=alone, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_what_is_no_part_of_the_base_install_is_out_of_reach(folder, alone):
    code = "import importlib.util as u\ntry: import snakemake\nexcept ImportError as e: print(e)"
    assert "no part of the base install" in run(folder, alone, "-c", code)


def test_the_lines_of_the_readme(folder, alone):
    (lines,) = code_of("README.md", "python")
    assert len([line for line in lines.splitlines() if line]) == 6
    fewer = lines.replace('"samples": 16', '"samples": 2').replace(
        '"count": 12', '"count": 4'
    )
    assert fewer != lines
    run(folder, alone, "-W", "error::DeprecationWarning:__main__", "-c", fewer)
    assert "bridge" in (folder / "bridge.xml").read_text()


def test_the_commands_of_the_home_page(folder, alone):
    first, second = code_of("docs/index.md", "sh")
    commands = [
        shlex.split(line, comments=True) for line in (first + second).splitlines()
    ]
    ours = [words[1:] for words in commands if words[0] == "archfrag"]
    assert len(ours) == 7
    for command, *words in ours:
        if words[0].startswith("configs"):  # a run takes long, and the next ones run
            command = "validate"
            words = [str(ROOT / words[0])]
        given = [
            sorted(map(str, folder.glob(word))) if "*" in word else [word]
            for word in words
        ]
        run(folder, alone, "-m", "archfrag", command, *itertools.chain(*given))
    for name in ("mine/study.yaml", "results/bridge/report.html"):
        assert (folder / name).is_file()
    assert list((folder / "results" / "bridge" / "export").glob("*.xml"))
