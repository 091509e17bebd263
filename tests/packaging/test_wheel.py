"""sdist and wheel: what is in them, and `archfrag init` from the wheel alone."""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import xarray as xr
import yaml

import archfrag

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """A wheel built from the sdist, as an installation would lay it out; the sdist is checked."""
    dist, folder = (tmp_path_factory.mktemp(name) for name in ("dist", "installed"))
    wheel, sdist = build(ROOT, dist)
    with zipfile.ZipFile(wheel) as opened:
        opened.extractall(folder)
    with tarfile.open(sdist) as opened:
        folders = {"/".join(name.split("/")[1:3]) for name in opened.getnames()}
    assert not [
        name for name in folders if name.startswith(("tests", "pipeline/archbench"))
    ]
    assert {
        "pipeline/archfrag",
        "records/near_source",
        "configs/shipped.yaml",
    } <= folders
    return folder


def build(source, dist, mask=-1):
    """The wheel and the sdist of a folder, built under a mask of rights."""
    done = subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "-o", str(dist), str(source)],
        capture_output=True,
        text=True,
        umask=mask,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    wheel, sdist = dist.glob("*.whl"), dist.glob("*.tar.gz")
    return next(wheel), next(sdist)


def test_two_clones_are_built_to_the_same_bytes(tmp_path):
    made = []
    for name, mask in (("first", 0o022), ("une deuxième", 0o077)):
        folder = tmp_path / name
        git("clone", "--quiet", str(ROOT), str(folder))
        made.append(
            [file.read_bytes() for file in build(folder, folder / "dist", mask)]
        )
    assert made[0] == made[1]


def run(unpacked, cwd, *command):
    """`archfrag` of the wheel, out of reach of the checkout."""
    return subprocess.run(
        [sys.executable, "-P", "-m", "archfrag", *command],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(unpacked)},
        capture_output=True,
        text=True,
    )


def git(*command):
    return subprocess.run(
        ["git", *command], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()


def test_the_wheel_has_the_whole_package_and_nothing_else_and_knows_its_commit(
    unpacked,
):
    names = {"archfrag", f"archfrag-{archfrag.__version__}.dist-info"}
    assert {path.name for path in unpacked.iterdir()} == names
    files = [
        name for name in git("ls-files", "pipeline/archfrag") if (ROOT / name).exists()
    ]
    assert [
        n for n in files if not (unpacked / n.removeprefix("pipeline/")).exists()
    ] == []
    (head,) = git("rev-parse", "HEAD")
    assert (unpacked / "archfrag" / "commit.txt").read_text().startswith(head)
    assert head in run(unpacked, unpacked, "--version").stdout


def test_a_copied_study_runs_without_the_checkout(unpacked, tmp_path):
    """The shipped study, at fewer levels, with the kernels and records of the wheel."""
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    records = unpacked / "archfrag" / "workflow" / "records"
    shutil.copytree(records, tmp_path / "records")
    fewer = ["--set", "intensity.levels={start: 0.3, stop: 0.5, count: 2}"]
    done = run(unpacked, tmp_path, "run", "configs/shipped.yaml", *fewer)
    assert done.returncode == 0, done.stderr
    with xr.open_dataset(tmp_path / "results" / "shipped" / "cube.nc") as cube:
        assert cube.sizes["record"] == 24
        assert (
            json.loads(cube.attrs["archfrag_versions"])["archfrag"]
            == archfrag.__version__
        )
        assert cube.attrs["archfrag_commit"].startswith(git("rev-parse", "HEAD")[0])


class TestInit:
    def test_writes_a_study_that_is_valid(self, unpacked, tmp_path):
        done = run(unpacked, tmp_path, "init", "mine")
        assert done.returncode == 0, done.stderr
        assert "archfrag run mine/study.yaml" in done.stdout
        assert len(list((tmp_path / "mine" / "records" / "synthetic").iterdir())) == 24
        study = yaml.safe_load((tmp_path / "mine" / "study.yaml").read_text())
        assert study["motions"] == {"index": "records/index.csv"}
        checked = run(unpacked, tmp_path, "validate", "mine/study.yaml")
        assert checked.returncode == 0, checked.stderr

    @pytest.mark.parametrize("name", ["study.yaml", "study.schema.json", "records"])
    def test_overwrites_nothing(self, unpacked, tmp_path, name):
        (tmp_path / name).write_text("mine")
        done = run(unpacked, tmp_path, "init")
        assert done.returncode == 4
        assert str(name) in done.stderr
        assert [path.name for path in tmp_path.iterdir()] == [name]
        assert (tmp_path / name).read_text() == "mine"


def test_citation_has_the_package_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == archfrag.__version__
    assert f"## {archfrag.__version__}" in (ROOT / "CHANGELOG.md").read_text()


CONDA_NAMES = {"dask": "dask-core", "matplotlib": "matplotlib-base"}


def test_conda_recipe_has_the_dependencies_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "configs" / "conda" / "recipe.yaml").read_text()
    recipe = yaml.safe_load(text)
    least = f">={recipe['context']['python_min']}"
    assert project["requires-python"] == least
    wanted = {"python >=${{ python_min }}"}
    for dependency in project["dependencies"]:
        name, least = dependency.split(">=")
        wanted.add(f"{CONDA_NAMES.get(name.lower(), name.lower())} >={least}")
    assert set(recipe["requirements"]["run"]) == wanted
    assert recipe["context"]["version"] == archfrag.__version__
