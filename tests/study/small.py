"""A study of some fast runs, for the tests of study and workflow."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
import pytest
import xarray as xr
import yaml
from click.testing import CliRunner, Result

from archfrag.cli import main
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.fits import fit_cube
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import StudyKeys, load_study
from archfrag.study.provenance import write_stamp
from archfrag.study.runs.execute import run_batch

ROOT = Path(__file__).resolve().parents[2]
TEXT = Path(__file__).with_name("small.yaml").read_text()


def write_at2(
    path: Path, acceleration: np.ndarray, dt: float, component: str = "0"
) -> Path:
    """Record in PEER's AT2, samples in g; UP is a vertical component."""
    rows = "\n".join(f"{value: .7E}" for value in acceleration)
    path.write_text(
        f"PEER NGA STRONG MOTION DATABASE RECORD\nTest, 1/1/2000, Nowhere, {component}\n"
        f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS= {acceleration.size:5d}, DT= {dt:.4f} SEC\n"
        f"{rows}\n",
        encoding="ascii",
    )
    return path


def small_study(folder: Path, text: str = TEXT, name: str = "small.yaml") -> Path:
    """Write a study file and two records of a second and a half."""
    (folder / "records").mkdir(parents=True, exist_ok=True)
    time = np.arange(150) * 0.01
    for number, frequency in enumerate((1.3, 2.1)):
        wave = 0.3 * np.sin(2 * np.pi * frequency * time) * np.sin(np.pi * time / 1.5)
        write_at2(folder / "records" / f"wave{number}.AT2", wave, 0.01)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def command(*arguments, **options) -> Result:
    return CliRunner().invoke(
        main, [str(argument) for argument in arguments], **options
    )


def dumped(study: StudyKeys) -> str:
    """A study as the text of a study file, with absolute paths and defaults."""
    return yaml.safe_dump(study.model_dump(exclude_none=True), sort_keys=False)


def files_below(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def changed(study: StudyKeys, section: str, **keys: Any) -> StudyKeys:
    """The study with other values of some keys of a section."""
    other = getattr(study, section).model_copy(update=keys)
    return study.model_copy(update={section: other})


def make_runs(study: StudyKeys, quiet: bool = True) -> dict:
    """Make all runs that are missing, in this process; the entry of the log."""
    return run_batch(study, workers=1, quiet=quiet)[0]


def cube_of(study: StudyKeys, quiet: bool = True) -> tuple[dict, xr.Dataset]:
    """Make a study up to its cube: the entry of the log, and the cube."""
    prepare_motions(study)
    log = make_runs(study, quiet)
    return log, xr.load_dataset(write_cube(study))


class Made(NamedTuple):
    """A study with its cube and its curves, all up to date."""

    study: StudyKeys
    log: dict
    cube: xr.Dataset
    fits: dict


def made(path: Path) -> Made:
    study = load_study(path)
    return Made(study, *cube_of(study), fitted(study))


def fitted(study: StudyKeys) -> dict:
    fit_cube(study)
    for step in ("cube", "fit"):
        write_stamp(study, step)
    return json.loads((study.folder / "fits.json").read_text())


def assert_compliant(cube: Path, folder: Path) -> None:
    """The compliance checker, which writes its report to a folder, finds no error in a cube."""
    runner = pytest.importorskip("compliance_checker.runner")
    runner.CheckSuite.load_all_available_checkers()
    report = str(folder / "report.json")
    given = {"verbose": 0, "criteria": "normal", "output_format": "json"}
    checker = runner.ComplianceChecker.run_checker
    assert not checker(str(cube), ["cf:1.11"], output_filename=report, **given)[1]
    found = json.loads(Path(report).read_text())["cf:1.11"]
    assert found["high_count"] == 0, found["high_priorities"]
    checked = found["all_priorities"]
    assert len(checked) > 5
    assert all(e["weight"] != 3 or e["value"][0] == e["value"][1] for e in checked), (
        checked
    )
    with netCDF4.Dataset(cube) as opened:
        assert all(
            len(variable.long_name) > 5 for variable in opened.variables.values()
        )
