"""Memory of the steps after the runs, by runs that are made up."""

import json
import subprocess
import sys
import tracemalloc

import numpy as np
import pandas as pd
import pytest
import yaml

from archfrag.files import write_csv
from archfrag.fragility import posterior
from archfrag.fragility.posterior import fit_capacity_posterior
from archfrag.fragility.verdicts import Verdict, find_brackets
from archfrag.study.answer.curves import runs_of_cube
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.store import ROW, make_plan, write_part
from tests.report.synthetic import cube as made_up_cube
from tests.study.small import ROOT, write_at2

# Cube and curves in a process of their own, as `archfrag run` makes them; its peak [bytes].
AFTER_THE_RUNS = """
import re, sys
from pathlib import Path
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.fits import fit_cube
from archfrag.study.file.schema import load_study
study = load_study(Path(sys.argv[1]))
write_cube(study)
fit_cube(study)
print(int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) * 1024)
"""


def peak(call):
    """The most memory that arrays of a call take at once [bytes], and its result."""
    tracemalloc.start()
    try:
        made = call()
        return tracemalloc.get_traced_memory()[1], made
    finally:
        tracemalloc.stop()


def verdicts(n_record, levels, scatter=0.1, seed=3):
    """Verdicts of records with lognormal capacities whose runs scatter."""
    generator = np.random.default_rng(seed)
    capacity = 0.4 * generator.standard_normal((n_record, 1))
    error = scatter * generator.standard_normal((n_record, levels.size))
    return (np.log(levels) > capacity + error).astype(np.int8)


def made_up_study(folder, n_level, n_arch=40, n_record=50):
    """A study with stored runs of a class of arches, behind which is no simulation."""
    (folder / "records").mkdir(parents=True)
    generator = np.random.default_rng(1)
    for i in range(n_record):
        wave = 0.2 * generator.standard_normal(60)
        write_at2(folder / "records" / f"r{i:02d}.AT2", wave, 0.01)
    ring = yaml.safe_load((ROOT / "configs" / "ring.yaml").read_text())["arches"][0]
    thickness = {"distribution": "normal", "mean": 1.5, "cov": 0.03}
    vary = {
        "samples": n_arch,
        "scheme": "latin_hypercube",
        "of": {"thickness": thickness},
    }
    study = {
        "id": "scale",
        "title": "Made-up runs",
        "output": "out",
        "arches": [ring | {"vary": vary | {"seed": 1}}],
        "motions": {"files": ["records/*.AT2"]},
        "intensity": {"measure": "PGA", "unit": "g"},
    }
    study["intensity"]["levels"] = {"start": 0.1, "stop": 3.0, "count": n_level}
    path = folder / "scale.yaml"
    path.write_text(json.dumps(study))  # JSON is YAML
    study = load_study(path)
    prepare_motions(study)
    plan = make_plan(study)
    plan.parts.mkdir(parents=True)
    for arch, requests in plan.requests().items():
        cases = next(requests)
        rows = np.zeros(len(cases), ROW)
        rows["key"] = plan.keys(cases)
        codes = verdicts(n_record, np.array(study.intensity.given), seed=arch)
        rows["verdict"] = codes[cases["record"], cases["place"]]
        write_part(plan.parts, rows)
    return path


@pytest.mark.skipif(sys.platform != "linux", reason="peaks are read from /proc")
def test_a_run_takes_a_kilobyte_after_the_runs(tmp_path):
    """By two studies that differ in their number of runs, so that imports do not count."""
    sizes = []
    for n_level in (10, 200):
        path = made_up_study(tmp_path / str(n_level), n_level)
        command = [sys.executable, "-c", AFTER_THE_RUNS, path]
        found = subprocess.run(command, capture_output=True, text=True)
        assert not found.returncode, found.stderr
        sizes.append(int(found.stdout.split()[-1]))
    assert np.diff(sizes) / (190 * 40 * 50) < 1000.0


def test_runs_of_a_class_are_no_copy_of_the_cube():
    cube = made_up_cube(("a", "b", "c"))
    cube["arch_class"] = ("arch", ["one", "two", "two"])
    for name, own in runs_of_cube(cube, ["a", "one", "two"]).items():
        assert np.shares_memory(own.cube["steps"].values, cube["steps"].values), name
    cube["arch_class"] = ("arch", ["one", "two", "one"])
    one = runs_of_cube(cube, ["one"])["one"]
    assert one.cube["arch"].values.tolist() == ["a", "c"]


def test_many_records_have_the_posterior_of_all_at_once(monkeypatch):
    levels = np.linspace(0.1, 4.0, 120)
    codes = verdicts(3000, levels)
    codes[:, 3] = Verdict.NOT_RUN
    brackets = find_brackets(codes, levels)
    most, found = peak(lambda: fit_capacity_posterior(brackets))
    monkeypatch.setattr(posterior, "_MANY", 10**9)
    monkeypatch.setattr(posterior, "_THREADED", 10**9)
    more, plain = peak(lambda: fit_capacity_posterior(brackets))
    assert most < 0.6 * more
    np.testing.assert_allclose(found.density, plain.density, rtol=1e-9, atol=1e-15)
    assert found.scatter == pytest.approx(plain.scatter, rel=1e-12)


def test_threads_change_no_bit(monkeypatch):
    levels = np.linspace(0.1, 4.0, 120)
    brackets = find_brackets(verdicts(200, levels), levels)
    found = fit_capacity_posterior(brackets)
    monkeypatch.setattr(posterior, "_THREADED", 10**9)
    plain = fit_capacity_posterior(brackets)
    np.testing.assert_array_equal(found.density, plain.density)


@pytest.mark.parametrize("form", [{"float_format": "%.7g"}, {}])
def test_cells_are_written_as_pandas_writes_them(tmp_path, form):
    numbers = [0.1 + 0.2, -0.0, np.nan, np.inf, -np.inf, 1e300, 12345678.9]
    texts = ["a,b", 'c"d', "", "plain", None, "é", "plain"]
    places = pd.array([1, None, 3, 4, 5, 6, 7], dtype="Int64")
    table = pd.DataFrame({"x": numbers, "text": texts, "n": range(7), "place": places})
    table["single"] = np.float32(0.1)
    path = tmp_path / "table.csv"
    write_csv(path, [table, table[:2]], **form)
    expected = pd.concat([table, table[:2]]).to_csv(
        index=False, lineterminator="\n", **form
    )
    assert path.read_bytes().decode() == expected
    write_csv(path, [pd.DataFrame({"text": ["=1", "b"]})])
    assert path.read_text() == "text\n'=1\nb\n"
