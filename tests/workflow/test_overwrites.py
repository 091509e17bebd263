"""Commands and methods replace no input and no file of somebody else, but their own files."""

import os
import shlex
import shutil
from pathlib import Path

import pandas as pd
import pytest

import archfrag as af
from archfrag.errors import OutputError
from tests.study.small import command, files_below, small_study

PRECIOUS = "years of work\n"
HAZARD = "PGA [g],rate\n0.01,0.1\n0.5,1e-3\n3,1e-5\n"
VERDICTS = "record,PGA [g],verdict\n" + "".join(
    f"{name},{level},{int(level > capacity)}\n"
    for name, capacity in (("a", 0.25), ("b", 0.35), ("c", 0.45))
    for level in (0.2, 0.3, 0.4, 0.5)
)
RING = shlex.split(
    "onset --radius 10 --thickness 1.5 --embrace 157.5 --voussoirs 7 --friction 0.7"
)
MADE = shlex.split(
    "records make --events 1 --records-per-event 1 --magnitude 6:6.5 --distance-km 5:10"
)
SMALL = ("small.yaml",)
FIT = ("fit", "verdicts.csv", "--output")
SELECT = ("records", "select", "flat.csv", "--count", 1, "--target")
MEASURE = ("records", "measure", "records/wave0.AT2", "--out")
EXPORT = ("export", "small.yaml", "--out")
TARGET = "period_s,Sa_g\n0.5,0.3\n1,0.2\n"
RISK = ("risk", "small.yaml", "--hazard", "hazard.csv", "--consequence", "collapse=1")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study that is done, a table, a hazard and a flatfile in one folder."""
    folder = tmp_path_factory.mktemp("finished")
    assert command("run", small_study(folder), "--quiet").exit_code == 0
    (folder / "hazard.csv").write_text(HAZARD)
    (folder / "verdicts.csv").write_text(VERDICTS)
    record = folder / "records" / "wave0.AT2"
    assert (
        command("records", "measure", record, "--out", folder / "flat.csv").exit_code
        == 0
    )
    return folder


@pytest.fixture
def folder(finished, tmp_path, monkeypatch):
    shutil.copytree(finished, tmp_path / "own")
    monkeypatch.chdir(tmp_path / "own")
    return tmp_path / "own"


def fit(name, *more):
    """Fit a table of a name that its report has as well."""
    shutil.copyfile("verdicts.csv", name)
    return "fit", name, *more


def linked(to, path, hard=False):
    (os.link if hard else os.symlink)(Path(to).absolute(), path)
    return path


def foreign(path, content=PRECIOUS):
    """Write a file of the user; return its path."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(content)
    return path


def beside(path, content=PRECIOUS):
    """Write a file of the user; return its folder."""
    return Path(foreign(path, content)).parent


def fit_beside_link(hard=False):
    """Fit a table into a folder where a link to it has the name of a table of the report."""
    Path("new").mkdir()
    linked("verdicts.csv", "new/runs.csv", hard)
    return *FIT, "new"


def study(old, new, *files):
    """Return the words to run a study with other keys beside files of the user."""
    text = Path("small.yaml").read_text()
    assert old in text
    foreign("other.yaml", text.replace(old, new))
    for path in files:
        foreign(path)
    return "run", "other.yaml"


def with_risk(hazard, output):
    words = study("id: small", f"id: other\nrisk: {{hazard: {hazard}}}")
    text = Path("other.yaml").read_text()
    Path("other.yaml").write_text(text.replace("output: out", f"output: {output}"))
    foreign(hazard, HAZARD)
    return words


CASES = {
    "fit: the table is runs.csv": lambda: fit("runs.csv", "--output", "."),
    "fit: the table is curve.csv": lambda: fit("curve.csv", "--output", "."),
    "fit: the table is capacities.csv": lambda: fit("capacities.csv", "--output", "."),
    "fit: by another name of the folder": lambda: fit(
        "runs.csv", "--output", "records/.."
    ),
    "fit: by a link to the folder": lambda: fit(
        "runs.csv", "--output", linked(".", "elsewhere")
    ),
    "fit: a link to the table": fit_beside_link,
    "fit: a hard link to the table": lambda: fit_beside_link(hard=True),
    "fit: the hazard is curve.csv": lambda: (
        *FIT,
        "new",
        "--hazard",
        foreign("new/curve.csv", HAZARD),
    ),
    "fit: a report of the user": lambda: (*FIT, beside("new/report.html")),
    "fit: a summary of the user": lambda: (*FIT, beside("new/summary.json")),
    "fit: the folder is the table": lambda: (*FIT, "verdicts.csv"),
    "fit of a study: the user's curve": lambda: (
        foreign("out/curve.csv") and "fit",
        *SMALL,
    ),
    "run: the hazard is curve.csv": lambda: with_risk("curve.csv", "."),
    "run: the hazard is fits.json": lambda: with_risk("fits.json", "."),
    "run: a report of the user": lambda: study(
        "output: out", "output: .", "report.html"
    ),
    "run: a summary of the user": lambda: study(
        "output: out", "output: .", "summary.json"
    ),
    "run: a figure of the user": lambda: study(
        "output: out", "output: new", "new/curve-ring.svg"
    ),
    "run: a cube of somebody else": lambda: study(
        "output: out", "output: new", "new/cube.nc"
    ),
    "run: a report of the user in the results": lambda: (
        foreign("out/report.html") and "run",
        *SMALL,
        "--set",
        "title=New",
    ),
    "run: a folder in the place of a table": lambda: study(
        "output: out", "output: new", "new/runs.csv/mine"
    ),
    "run: a link in the place of a table": lambda: (
        (beside("new/a"), linked("hazard.csv", "new/runs.csv"))[2:]
        + study("output: out", "output: new")
    ),
    "validate: a report of the user": lambda: (
        "validate",
        *study("output: out", "output: .", "report.html")[1:],
    ),
    "risk: the hazard": lambda: (*RISK, "--vulnerability", "hazard.csv"),
    "risk: a file of the user": lambda: (*RISK, "--vulnerability", foreign("loss.csv")),
    "risk: a hard link to the hazard": lambda: (
        *RISK,
        "--vulnerability",
        linked("hazard.csv", "loss.csv", True),
    ),
    "risk: a result of the study": lambda: (*RISK, "--vulnerability", "out/curve.csv"),
    "film: a film of the user": lambda: ("film", *SMALL, "--to", foreign("fall.svg")),
    "film: a figure of the study": lambda: (
        "film",
        *SMALL,
        "--to",
        "out/curve-ring.svg",
    ),
    "export: a table of the user": lambda: (
        *EXPORT,
        beside("new/small-runs.csv"),
        "--format",
        "csv",
    ),
    "export: a file of the user": lambda: (
        *EXPORT,
        beside("new/small-fragility-discrete.xml"),
        "--format",
        "nrml-discrete",
    ),
    "export: a drawing of the user": lambda: (
        *EXPORT,
        beside("new/small-ring.dxf"),
        "--format",
        "dxf",
    ),
    "onset: a drawing of the user": lambda: (*RING, "--figure", foreign("ring.svg")),
    "onset: a link": lambda: (*RING, "--figure", linked("hazard.csv", "ring.svg")),
    "measure: the record": lambda: (*MEASURE, "records/wave0.AT2"),
    "measure: the record by ..": lambda: (*MEASURE, "records/../records/wave0.AT2"),
    "measure: a figure of the user": lambda: (
        *MEASURE,
        "new.csv",
        "--figure",
        foreign("a.svg"),
    ),
    "measure: one file for both": lambda: (*MEASURE, "a.svg", "--figure", "a.svg"),
    "select: the flatfile": lambda: (
        *SELECT,
        foreign("t.csv", TARGET),
        "--out",
        "flat.csv",
    ),
    "select: the target": lambda: (*SELECT, foreign("t.csv", TARGET), "--out", "t.csv"),
    "select: the target that is written too": lambda: (
        *SELECT,
        foreign("a.target.csv", TARGET),
        "--out",
        "a.csv",
    ),
    "make: an index of the user": lambda: (
        *MADE,
        "--out",
        beside("new/index.csv", "id,file,unit,model\nx,x.txt,g,mine\n"),
    ),
    "make: a motion of the user": lambda: (
        *MADE,
        "--out",
        beside("new/synthetic/e1-r1.mseed").parent,
    ),
    "init: a study of the user": lambda: ("init", beside("new/study.yaml")),
}


@pytest.mark.parametrize("name", CASES)
def test_no_command_replaces_an_input_or_a_file_of_somebody_else(folder, name):
    words = CASES[name]()
    before = files_below(folder)
    done = command(*words)
    assert done.exit_code in (2, 4), done.output
    assert isinstance(done.exception, SystemExit)
    assert files_below(folder) == before


METHODS = {
    "to_file": lambda results: af.Study.from_file("small.yaml").to_file(
        foreign("mine.yaml")
    ),
    "to_nrml": lambda results: results.to_nrml(foreign("mine.xml")),
    "to_csv": lambda results: results.to_csv(beside("new/small-curves.csv")),
    "film": lambda results: results.film().save(foreign("mine.gif")),
    "report of a table": lambda results: af.fit(
        "verdicts.csv", output=beside("new/report.html")
    ).report(),
    "report beside the table": lambda results: af.fit(
        fit("runs.csv")[1], output="."
    ).report(),
}


@pytest.mark.parametrize("name", METHODS)
def test_no_method_replaces_an_input_or_a_file_of_somebody_else(folder, name):
    results = af.open("small.yaml")
    with pytest.raises(
        OutputError, match="archfrag does not replace it; name another place"
    ):
        METHODS[name](results)
    assert Path("hazard.csv").read_text() == HAZARD
    mine = [path for path in files_below(folder) if path.name.startswith("mine")]
    assert all(path.read_text() == PRECIOUS for path in mine)
    assert not Path("runs.csv").exists() or Path("runs.csv").read_text() == VERDICTS


AGAIN = {
    "fit": ("fit", "verdicts.csv", "--output", "new", "--confidence"),
    "figure": (*RING[:-2], "--figure", "ring.svg", "--friction"),
    "risk": (*RISK, "--vulnerability", "loss.csv", "--confidence"),
    "export": (*EXPORT, "new", "--format", "csv", "--curve"),
    "measure": (
        "records",
        "measure",
        "records/wave0.AT2",
        "--out",
        "new.csv",
        "--periods",
    ),
    "make": (*MADE, "--out", "new", "--seed"),
    "run": ("run", "small.yaml", "--quiet", "--set"),
    "film": ("film", "small.yaml", "--to", "fall.svg", "--arch"),
}
CHANGED = {
    "fit": (0.9, 0.8),
    "figure": (0.7, 0.5),
    "risk": (0.9, 0.8),
    "measure": (0.7, 0.8),
    "make": (1, 2),
    "film": ("ring", "slab"),
    "run": ("title=One", "title=Two"),
    "export": ("median", "predictive"),
}


@pytest.mark.parametrize("name", AGAIN)
def test_a_command_replaces_what_it_made_itself(folder, name):
    for value in CHANGED[name]:
        done = command(*AGAIN[name], value)
        assert done.exit_code == 0, done.output


def test_results_without_their_hidden_folder_are_made_again(folder):
    shutil.rmtree(folder / "out" / ".archfrag")
    done = command("run", "small.yaml", "--quiet")
    assert done.exit_code == 0, done.output
    assert pd.read_csv("out/runs.csv")["verdict"].size
