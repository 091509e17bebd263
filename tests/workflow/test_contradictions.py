"""Options and arguments that contradict each other are refused, and none is passed over."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from tests.study.small import ROOT, command, small_study

HAZARD = "PGA [g],rate\n0.01,0.1\n0.5,1e-3\n3,1e-5\n"
VERDICTS = "record,PGA [g],verdict\na,0.2,0\na,0.4,1\nb,0.3,0\nb,0.6,1\n"
RING = "--radius 10 --thickness 1.5 --embrace 157.5 --voussoirs 7 --friction 0.7"
SELECT = "records select flat.csv --out a.csv --count 1"
RISK = "risk small.yaml --hazard hazard.csv"
SIMULATE = f"simulate {RING} records/wave0.AT2"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("contradictions")
    assert command("run", small_study(folder), "--quiet").exit_code == 0
    for name, text in (
        ("hazard.csv", HAZARD),
        ("verdicts.csv", VERDICTS),
        ("target.csv", "period_s,Sa_g\n0.5,0.3\n"),
    ):
        (folder / name).write_text(text)
    record = folder / "records" / "wave0.AT2"
    assert (
        command("records", "measure", record, "--out", folder / "flat.csv").exit_code
        == 0
    )
    return folder


CASES = [
    "onset --study small.yaml --arch ring --thickness 0.9",
    "onset --study small.yaml --arch ring --profile circular",
    "onset --study small.yaml --arch ring --layer A",
    "onset --study small.yaml --arch ring --drawing a.dxf",
    f"onset {RING} --arch ring",
    "onset --drawing a.dxf --friction 0.7 --profile circular",
    f"onset {RING} --radius 11",
    f"{SIMULATE} --scale 2 --pga 0.3",
    f"{SIMULATE} --scale 1.0 --pga 0.3",
    f"{SIMULATE} --scale 2 --scale 3",
    f"{SIMULATE} --dt 0.001 --rtol 0.001 --method time_stepping",
    "simulate --study small.yaml --arch ring --height 2 records/wave0.AT2",
    f"{RISK} --site 13.3,42.3",
    f"{RISK} --unit m/s2",
    f"{RISK} --consequence collapse=0.5,collapse=0.9",
    f"{RISK} --consequence collapse=0.5,Collapse=0.9",
    f"{RISK} --consequence collapse=0.5 --consequence collapse=0.9",
    f"{RISK} --years 50 --years 100",
    f"{RISK} --vulnerability a.csv",
    f"{RISK} --hazard hazard.csv",
    "export small.yaml --format dxf --curve branches",
    "export small.yaml --format scene --limit-state impact",
    "update small.yaml damage.csv --arch ring --beta-model 0.1 --format csv",
    "update small.yaml damage.csv --arch none --beta-model 0.1",
    "update small.yaml damage.csv --beta-model 0.1",
    "update small.yaml damage.csv --arch ring",
    "update small.yaml damage.csv --arch ring --beta-model 0.1 --shakemap grid.xml",
    "fit small.yaml --columns intensity=PGA",
    "fit small.yaml --measure PGA",
    "fit small.yaml --confidence 0.9",
    "fit small.yaml --output new",
    "fit small.yaml --format csv",
    "fit small.yaml --hazard hazard.csv",
    "fit verdicts.csv --set report.confidence=0.8",
    "fit verdicts.csv --columns intensity=PGA,intensity=a",
    "fit verdicts.csv --states none,none,collapse",
    "fit verdicts.csv --states none,collapse",
    "run small.yaml --set title=One --set title=Two",
    "run small.yaml --set method.dt=0.001 --set 'method={name: auto}'",
    "run small.yaml --cores 1 --workers 2",
    f"{SELECT} --target target.csv --magnitude 6",
    f"{SELECT} --target target.csv --model CY14",
    f"{SELECT} --target target.csv --target flat.csv",
]


SHAKEN = "collapsed,{0},0.1,0.1\ncollapsed,{0},0.1,0.1\ncollapsed,{0},0.1,0.1\n"


@pytest.mark.parametrize("line", CASES, ids=lambda line: line[-60:])
def test_two_options_that_cannot_both_hold_are_refused(place, monkeypatch, line):
    monkeypatch.chdir(place)
    done = command(*shlex.split(line))
    assert done.exit_code == 2, done.output
    assert isinstance(done.exception, SystemExit)


def test_arguments_of_methods_are_not_passed_over(place, monkeypatch):
    monkeypatch.chdir(place)
    results = af.open("small.yaml")
    table = [[0.1, 0.1], [1.0, 1e-3]]
    for given in (
        {"site": (13.0, 42.0)},
        {"unit": "g"},
        {"hazard": table, "site": (13.0, 42.0)},
        {"hazard": "hazard.csv", "site": (13.0, 42.0)},
    ):
        with pytest.raises(InputError, match="leave"):
            results.risk(**given)
    with pytest.raises(InputError, match="has no hazard"):
        results.compare("ring", "slab", years=10.0)
    with pytest.raises(InputError, match="cores = 1 and workers = 2"):
        af.Study.from_file("small.yaml").run(cores=1, workers=2)


def test_update_prints_and_exports_the_curve_of_after(place, monkeypatch):
    monkeypatch.chdir(place)
    results = af.open("small.yaml")
    name, before = next(iter(results.curves.items()))
    text = f"state,median [g],tau,phi\n{SHAKEN.format(0.5 * before.theta)}"
    (place / "damage.csv").write_text(text)
    options = ["--arch", name, "--beta-model", str(0.5 * before.beta)]
    told = command("update", "small.yaml", "damage.csv", *options, "--json")
    theta = json.loads(told.stdout)["collapse"]["theta"]
    assert theta < before.theta
    written = ["--format", "nrml-continuous", "--out", "updated"]
    done = command("update", "small.yaml", "damage.csv", *options, *written)
    assert done.exit_code == 0, done.output
    assert "updated by damage of 3 arches in 1 earthquake" in done.stdout
    after = results.update("damage.csv", name, beta_model=0.5 * before.beta)
    assert after.curves[name].theta == pytest.approx(theta)
    assert (
        f'mean="{theta * np.exp(0.5 * after.curves[name].beta ** 2):.6g}'[:12]
        in (place / "updated" / "small-fragility-continuous.xml").read_text()
    )
    assert af.open("small.yaml").curves[name].theta == before.theta


def test_years_hold_with_the_hazard_of_the_study(place, tmp_path):
    text = (place / "small.yaml").read_text() + "risk: {hazard: hazard.csv}\n"
    path = small_study(tmp_path, text)
    (tmp_path / "hazard.csv").write_text(HAZARD)
    results = af.Study.from_file(path).run(progress=False)
    own = results.risk()
    longer = results.risk(years=100.0)
    assert (longer["probability"] > 1.5 * own["probability"]).all()
    assert (results.risk(years=50.0)["probability"] == own["probability"]).all()


def test_what_is_no_study_is_named(place, monkeypatch):
    monkeypatch.chdir(place)
    for name in ("info", "open"):
        done = command(name, "hazard.csv")
        assert done.exit_code == 2
        assert (
            "hazard.csv: is no study file (.yaml), and no folder of results"
            in done.stderr
        )
    with pytest.raises(
        InputError, match=r"is a cube; give its folder out, or the study file"
    ):
        af.open("out/cube.nc")


def test_a_folder_that_is_read_only_ends_a_step_with_the_code_of_outputs(
    place, monkeypatch
):
    def denied(path, **given):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.chdir(place)
    monkeypatch.setattr(Path, "touch", denied)
    done = command("report", "small.yaml")
    assert done.exit_code == 4
    assert "cannot be written (Permission denied)" in done.stderr


def test_studies_of_one_file_name_are_refused_by_snakemake(tmp_path):
    for folder in (tmp_path, tmp_path / "a"):
        small_study(folder)
    words = ["snakemake", "-s", ROOT / "Snakefile", "-n", "--cores", "1", "--config"]
    start = [sys.executable, "-m", *words]
    done = subprocess.run(
        [*start, "study=[small.yaml, a/small.yaml]"],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode != 0
    assert "would both have their results in small" in done.stdout + done.stderr
    once = subprocess.run(
        [*start, "study=[small.yaml, ./small.yaml]"],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        check=False,
    )
    assert once.returncode == 0, once.stderr
    assert Path(tmp_path, "results").exists() is False
