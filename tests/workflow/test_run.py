"""One command for a study: done, up to date, killed, resumed; and the same steps by Snakemake."""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
import psutil
import pytest
import xarray as xr

import archfrag as af
from archfrag.motions import measures
from archfrag.physics.kernels import cache as kernel_cache
from archfrag.study import provenance
from archfrag.study.file.schema import load_study
from archfrag.study.provenance import sha256_of
from archfrag.study.steps import only_run
from archfrag.study.validate import shipped_folder
from archfrag.study.yaml_text import read_keys
from tests.study.small import ROOT, TEXT, command, files_below, small_study, write_at2

# Long enough to be killed in the middle, by making each chunk one run.
SLOW = TEXT.replace("chunk: 2", "chunk: 1").replace(
    "[0.1, 0.6, 1.2]", "[0.1, 0.3, 0.6, 0.9, 1.2]"
)
SNAKEFILE = shipped_folder() / "Snakefile"
STARTED: list[subprocess.Popen] = []
NOTHING = "archfrag: nothing to do: all results are up to date\n"
TITLE = ("--set", "title=Another title")


def start(*arguments, env=MappingProxyType({})):
    """`archfrag run` as a user starts it, in a process group of its own."""
    process = subprocess.Popen(
        [sys.executable, "-m", "archfrag", "run", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, **env},
        # What runs behind a script is deaf to SIGINT; a user's command is not.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    STARTED.append(process)
    return process


@pytest.fixture(autouse=True)
def _nothing_goes_on():
    yield
    while STARTED:
        if (process := STARTED.pop()).poll() is None:
            kill_tree(process)


def run(*arguments, code=0, **options):
    """What a run prints on standard output and error, if it ends with an exit code."""
    process = start(*arguments, **options)
    stdout, stderr = process.communicate(timeout=600)
    assert process.returncode == code, stderr
    return stdout, stderr


def kill_tree(process):
    """SIGKILL for the full tree, however it has grouped itself."""
    members = [parent := psutil.Process(process.pid), *parent.children(recursive=True)]
    os.killpg(process.pid, signal.SIGKILL)
    for member in members:
        with contextlib.suppress(psutil.NoSuchProcess):
            member.kill()
    psutil.wait_procs(members, timeout=10)
    process.communicate()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Study file of an undisturbed run, what it printed, and its cube."""
    path = small_study(tmp_path_factory.mktemp("finished"), SLOW)
    return path, *run(path), xr.load_dataset(path.parent / "out" / "cube.nc")


def finished_folder(path, overrides=()):
    return provenance.finished_folder(path, *read_keys(path, overrides))


def written(folder):
    """All that is below a folder, with what a write would change."""
    places = [
        place
        for place in (folder, *folder.rglob("*"))
        if ".snakemake" not in place.parts
    ]
    return {place: (place.stat().st_ino, place.stat().st_mtime_ns) for place in places}


def test_a_run_ends_with_a_report_and_is_not_made_again(finished):
    """The second time nothing is written: the disk may be one that allows none."""
    path, stdout, stderr, _ = finished
    out = path.parent / "out"
    a_run_ends_with_its_answers(path, stdout)
    assert "A small study" in (out / "report.html").read_text()
    lines = stderr.replace("\r", "\n").splitlines()
    steps = [
        line.split()[1].rstrip(":") for line in lines if line.startswith("archfrag: ")
    ]
    assert steps == ["reading", "motions", "simulations", "cube", "fit", "report"]
    assert {entry.name for entry in out.iterdir()} == {
        ".archfrag",
        "README.txt",
        "capacities.csv",
        "cube.nc",
        "curve-ring.svg",
        "curve-slab.svg",
        "curve.csv",
        "fits.json",
        "report.html",
        "runs.csv",
        "summary.json",
    }
    entries = json.loads((out / ".archfrag" / "run_log.json").read_text())
    assert (entries[0]["runs"], entries[0]["workers"]) == (20, 2)
    curve = pd.read_csv(out / "curve.csv")
    assert list(curve) == ["arch", "PGA [g]", "probability", "lower", "upper"]
    assert ((curve["lower"] <= curve["upper"]) & (curve["probability"] <= 1.0)).all()
    before = written(out)
    again = f"{stdout.splitlines()[-1]}\n", f"archfrag: reading {path}\n{NOTHING}"
    assert run(path) == again
    assert written(out) == before


def a_run_ends_with_its_answers(path, stdout):
    """Each once, cautions broken between words, and the path of the report whole."""
    *lines, last = stdout.splitlines()
    out = path.parent / "out"
    assert last == f"report  {out / 'report.html'}  (archfrag open {path})"
    told = " ".join(" ".join(lines).split())
    numbers = json.loads((out / "summary.json").read_text())
    assert lines[0].startswith("ring    no curve: ")
    curve = numbers["arches"][1]["curve"]
    low, high, *ends = (*curve["theta_interval"], *curve["beta_interval"])
    assert (
        f"slab median {curve['theta']:#.3g} g PGA (90 %: {low:#.3g}–{high:#.3g})"
        in told
    )
    assert (
        f" dispersion {curve['beta']:.2f} ({'–'.join(f'{end:.2f}' for end in ends)})"
        in told
    )
    assert (
        "ring: the ring weighs 809 kN; springings at (-9.072, 1.805) and (9.072,"
        in told
    )
    assert (cautions := numbers["cautions"])
    assert all(told.count(f"! {caution}") == 1 for caution in cautions)
    assert max(map(len, lines)) <= 80


def snakemake(folder, *arguments, file=SNAKEFILE, code=0):
    """What Snakemake, started as a user does, prints if it ends with an exit code."""
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "--snakefile", file, *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        env=environment,
    )
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


class TestSnakemake:
    @pytest.fixture(scope="class")
    def made(self, finished, tmp_path_factory):
        """A folder in which Snakemake made the study by the name of its report."""
        folder = tmp_path_factory.mktemp("snakemake")
        study = f"study={finished[0]}"
        snakemake(folder, "--cores", 1, "results/small/report.html", "--config", study)
        return folder, study

    def test_it_makes_what_a_run_makes_and_its_report_holds_ours(self, finished, made):
        folder, study = made
        results = folder / "results" / "small"
        xr.testing.assert_identical(xr.load_dataset(results / "cube.nc"), finished[3])
        assert (results / "report.html").is_file()
        opened = af.open(results)
        assert opened.folder.samefile(results)
        assert opened.report().samefile(results / "report.html")
        assert {entry.name for entry in folder.iterdir()} == {".snakemake", "results"}
        snakemake(folder, "--report", "ours.html", "--config", study)
        text = (folder / "ours.html").read_text()
        assert "report.html" in text
        assert "curve.csv" in text

    def test_dry_runs_and_pictures_change_nothing(self, made, tmp_path):
        folder, study = made
        text = Path(study.removeprefix("study=")).read_text()
        edited = small_study(tmp_path, text.replace("[0.1, ", "[0.2, "))
        before = written(folder)
        for asked, shown in (
            (study, "Nothing to be done"),
            (f"study={edited}", "motions"),
        ):
            for _ in range(2):
                assert shown in snakemake(folder, "-n", "--config", asked)
            assert "digraph" in snakemake(folder, "--dag", "--config", asked)
        assert written(folder) == before

    def test_a_workflow_takes_it_as_a_module_for_two_studies(self, made, tmp_path):
        first = Path(made[1].removeprefix("study="))
        second = first.with_name("second.yaml")
        second.write_text(first.read_text().replace("id: small", "id: second"))
        (tmp_path / "Snakefile").write_text(
            f"module fragility:\n    snakefile: {str(SNAKEFILE)!r}\n"
            f"    config: {{'study': [{str(first)!r}, {str(second)!r}]}}\n"
            "use rule * from fragility as fragility_*\n"
            "rule both:\n    default_target: True\n"
            "    input: 'results/small/curve.csv', 'results/second/curve.csv'\n"
            "    output: 'both.csv'\n    shell: 'cat {input} > {output}'\n"
        )
        snakemake(tmp_path, "--cores", 2, file=tmp_path / "Snakefile")
        own = (tmp_path / "results" / "small" / "curve.csv").read_text()
        assert (tmp_path / "both.csv").read_text() == 2 * own

    def test_without_a_study_an_error_names_the_option(self, tmp_path):
        message = "no study is given; add --config study=FILE"
        assert message in snakemake(tmp_path, "-n", code=1)

    def test_without_archfrag_an_error_says_how_to_install_both(
        self, tmp_path, monkeypatch
    ):
        blocked = "import sys; sys.modules['archfrag'] = None"
        (tmp_path / "sitecustomize.py").write_text(blocked)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        assert 'pip install -e ".[workflow]"' in snakemake(tmp_path, "-n", code=1)


def test_the_first_line_comes_before_anything_heavy_is_imported():
    blocked = "import sys; sys.modules.update(dict.fromkeys(['numpy', 'numba', 'pandas', 'yaml']))"
    code = f"{blocked}; from archfrag.cli import main; main(['run', 'lost.yaml'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.startswith("archfrag: reading lost.yaml\nTraceback")


def test_a_command_with_nothing_to_do_imports_neither_dask_nor_xarray(finished):
    code = "import sys; from archfrag.cli import main; main(sys.argv[1:], standalone_mode=False)"
    code += "; print('loaded', *sys.modules)"
    asked = [sys.executable, "-c", code, "run", finished[0]]
    done = subprocess.run(asked, capture_output=True, text=True)
    assert NOTHING in done.stderr
    loaded = set(done.stdout.split("loaded")[1].split())
    assert "archfrag.study.provenance" in loaded
    assert not loaded & {"dask", "distributed", "xarray", "numba", "numpy"}


def test_a_cube_is_written_without_a_client_of_dask(finished, tmp_path):
    shutil.copytree(finished[0].parent, tmp_path, dirs_exist_ok=True)
    code = "import sys; from archfrag.cli import main; main(sys.argv[1:], standalone_mode=False)"
    code += "; print('loaded', *sys.modules)"
    asked = [sys.executable, "-c", code, "cube", tmp_path / finished[0].name]
    done = subprocess.run(asked, capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split("loaded")[1].split())
    assert "netCDF4" in loaded
    assert "distributed" not in loaded


def test_no_spectrum_is_computed_twice(tmp_path, monkeypatch):
    """Two records are computed side by side; a period of both is asked for once."""
    asked = []
    spectrum = measures._spectrum

    def counted(ground, dt, periods, *more):
        asked.extend(np.ravel(periods))
        return spectrum(ground, dt, periods, *more)

    monkeypatch.setattr(measures, "_spectrum", counted)
    result = command("run", small_study(tmp_path))
    assert result.exit_code == 0, result.output
    assert len(asked) > 150
    assert len(asked) == len(set(asked))


def test_info_describes_a_cube_by_its_file_its_folder_and_its_study(finished, tmp_path):
    path, _, _, cube = finished
    out = path.parent / "out"
    facts = json.loads(command("info", out / "cube.nc", "--json").stdout)
    assert (facts["arches"], facts["records"]) == (["ring", "slab"], ["wave0", "wave1"])
    assert (facts["measure"], facts["unit"], facts["design"]) == ("PGA", "g", "stripes")
    assert facts["levels"] == [0.1, 0.3, 0.6, 0.9, 1.2]
    assert facts["verdicts"]["collapsed"] == (cube["verdict"] == 1).sum()
    assert sum(facts["verdicts"].values()) == facts["dimensions"]["arch"] * 2 * 5
    text = command("info", path).stdout
    assert text == command("info", out).stdout
    assert "levels              5: 0.1, 0.3, 0.6, 0.9, 1.2\n" in text
    (tmp_path / "other.nc").write_bytes(b"CDF")
    for wrong in (tmp_path, tmp_path / "other.nc"):
        refused = command("info", wrong)
        assert refused.exit_code == 2
        assert "is missing, damaged or no cube of archfrag" in refused.stderr


def test_open_shows_the_report_in_the_browser_and_else_its_path(
    finished, monkeypatch, tmp_path
):
    path = finished[0]
    opened = []
    report = path.parent / "out" / "report.html"
    monkeypatch.setattr("webbrowser.open", lambda url: not opened.append(url))
    assert command("open", path).output == ""
    assert opened == [report.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert command("open", report.parent).output == f"{report}\n"
    assert command("open", tmp_path).exit_code == 2


def test_export_of_what_is_finished_and_of_nothing_else(
    finished, tmp_path, monkeypatch
):
    asked = ["export", finished[0], "--format", "csv", "--out", tmp_path]
    # A commit of other files alone leaves results as they are.
    monkeypatch.setattr("archfrag.study.provenance.commit", lambda: "another")
    exported = command(*asked)
    assert exported.exit_code == 0, exported.stderr
    assert len(pd.read_csv(tmp_path / "small-runs.csv")) == 2 * 2 * 5
    made = files_below(tmp_path)
    late = command(*asked, "--set", "intensity.levels=[0.1, 0.6]")
    assert late.exit_code == 2
    assert "cube.nc: was made before these changed: intensity" in late.stderr
    assert files_below(tmp_path) == made


def test_edits_and_another_record_with_an_older_date_are_noticed_and_named(
    finished, tmp_path
):
    path = shutil.copytree(finished[0].parent, tmp_path / "copy") / finished[0].name
    out = path.parent / "out"
    record = path.parent / "records" / "wave1.AT2"
    before = sha256_of(out / "cube.nc")
    time_ = np.arange(150) * 0.01
    write_at2(record, 0.2 * np.sin(9.0 * time_) * np.sin(np.pi * time_ / 1.5), 0.01)
    os.utime(record, (1.0e9, 1.0e9))
    _, stderr = run(path, *TITLE)
    assert f"archfrag: record {record} has changed" in stderr
    assert "Another title" in (out / "report.html").read_text()
    assert sha256_of(out / "cube.nc") != before
    with xr.open_dataset(out / "cube.nc") as cube:
        assert cube["record_sha256"].sel(record="wave1").item() == sha256_of(record)
        assert json.loads(cube.attrs["archfrag_inputs_sha256"])[
            "wave1.AT2"
        ] == sha256_of(record)
    assert run(path, *TITLE)[1] == f"archfrag: reading {path}\n{NOTHING}"


def test_killed_three_times_and_started_again_gives_the_same_cube(finished, tmp_path):
    path = small_study(tmp_path, SLOW)
    work = tmp_path / "out" / ".archfrag"
    work.mkdir(parents=True)
    with only_run(load_study(path)):
        _, stderr = run(path, code=4)
    assert (
        "another run of study 'small' is at work here; wait for it or stop it" in stderr
    )
    dice = random.Random(20)
    parts = []
    for sign in ("study.json", "motions/*", "parts/*/*.npy"):
        process = start(path)
        while not list(work.glob(sign)):
            assert process.poll() is None, "it was done before it could be killed"
            time.sleep(0.02)
        time.sleep(dice.uniform(0.0, 0.3))
        kill_tree(process)
        parts.append(len(list(work.glob("parts/*/*.npy"))))
    assert parts[-1] >= 1, "no run came so far that resuming meant anything"
    run(path, "--resume")
    xr.testing.assert_identical(
        xr.load_dataset(tmp_path / "out" / "cube.nc"), finished[3]
    )
    assert not list((tmp_path / "out").rglob(".*.tmp"))


@pytest.mark.parametrize(
    ("number", "whom"),
    [(signal.SIGTERM, "parent"), (signal.SIGINT, "group"), (signal.SIGKILL, "parent")],
)
def test_a_run_that_is_stopped_while_threads_are_in_kernels_ends_within_seconds(
    tmp_path, number, whom
):
    path = small_study(tmp_path, SLOW.replace("dt: 2.0e-3", "dt: 1.0e-5"))
    process = start(path)
    while not list((tmp_path / "out").glob(".archfrag/parts/*/*.npy")):
        assert process.poll() is None
        time.sleep(0.05)
    stopped = time.monotonic()
    (os.killpg if whom == "group" else os.kill)(process.pid, number)
    _, stderr = process.communicate(timeout=30)
    if number == signal.SIGKILL:
        return
    assert time.monotonic() - stopped < 5.0
    assert process.returncode == 128 + number
    assert stderr.endswith(
        f"archfrag: stopped by {number.name}; what is finished is kept; continue with `archfrag "
        f"run {path} --resume`\n"
    )


def test_a_copy_of_a_study_file_with_the_same_id_is_refused(finished, tmp_path):
    path = shutil.copytree(finished[0].parent, tmp_path / "own") / finished[0].name
    before = sha256_of(path.parent / "out" / "cube.nc")
    copy = path.with_name("copy.yaml")
    copy.write_text(path.read_text().replace("thickness: 1.5", "thickness: 1.4"))
    _, stderr = run(copy, code=4)
    assert f"holds the results of {path}; give copy.yaml another output" in stderr
    assert stderr.count("\n") == 2
    assert sha256_of(path.parent / "out" / "cube.nc") == before
    moved = path.with_name("moved.yaml")
    path.rename(moved)
    run(moved, *TITLE)
    moved.rename(path)


def test_records_of_ones_own_of_odd_names_and_a_home_that_cannot_be_written(
    tmp_path, monkeypatch
):
    """The command of configs/own_records.yaml, in a folder with odd names."""
    folder = tmp_path / "a {b}\n'c'"
    small_study(folder)
    for number, name in enumerate(("{x} $HOME.AT2", "two\nlines.AT2")):
        os.rename(folder / "records" / f"wave{number}.AT2", folder / "records" / name)
    names = [str(folder / "records" / name) for name in ("*lines.AT2", "{x} $HOME.AT2")]
    monkeypatch.chdir(folder / "records")
    kernels = kernel_cache.use_kernel_cache().parent
    _, stderr = run(
        ROOT / "configs" / "own_records.yaml",
        "--set",
        f"motions.files={json.dumps(names)}",
        "--set",
        f"output={json.dumps(str(folder / 'mine'))}",
        "--set",
        "intensity.levels=[0.3, 0.9]",
        "--set",
        "method.dt=2e-3",
        "--set",
        "method.follow=1",
        "--quiet",
        env={"HOME": "/dev/null", "NUMBA_CACHE_DIR": str(kernels)},
    )
    assert stderr == ""
    assert (folder / "mine" / "report.html").is_file()


@pytest.fixture(scope="module")
def still(finished, tmp_path_factory):
    """A study with a table of arches, run where it is."""
    place = tmp_path_factory.mktemp("done") / "copy"
    path = shutil.copytree(finished[0].parent, place) / finished[0].name
    path.with_name("table.csv").write_text("id,width\nlast,0.6\n")
    many = "  - {id: many, table: table.csv, profile: block, height: 2, friction: .inf}"
    path.write_text(path.read_text().replace("motions:", f"{many}\nmotions:"))
    assert command("run", path).exit_code == 0
    return path


class TestNothingToDo:
    """One digest tells it, before numpy and pydantic are imported."""

    def test_nothing_heavy_is_imported_for_it(self, still):
        blocked = "import sys; sys.modules.update(dict.fromkeys(['numpy', 'pydantic', 'numba']))"
        code = (
            f"{blocked}; from archfrag.cli import main; main(['run', {str(still)!r}])"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True
        )
        assert done.stderr == f"archfrag: reading {still}\n{NOTHING}"

    def test_all_that_counts_is_in_it(self, still, monkeypatch):
        """Files that change, are gone or are new; keys that are given; another code."""
        (work,) = still.parent.glob("out/.archfrag")
        folder = finished_folder(still)
        assert folder == still.parent / "out"
        assert finished_folder(still, ["title=Other"]) is None
        for path in (
            still,
            still.with_name("table.csv"),
            *still.parent.glob("records/*"),
            *folder.glob("[!.]*"),
            work / "motions.json",
            *work.glob("motions/*"),
            *work.glob("runs/*"),
        ):
            content = path.read_bytes()
            path.write_bytes(content.replace(b"1", b"2"))
            assert (finished_folder(still) is None) == (content != path.read_bytes()), (
                path
            )
            path.write_bytes(content)
        for new in (
            "records/index.csv",
            "index.csv",
            "records/wave0.xml",
            "records/wave9.AT2",
        ):
            (still.parent / new).write_text("new")
            assert finished_folder(still) is None, new
            (still.parent / new).unlink()
        (still.parent / "notes.txt").write_text("of the user")
        assert finished_folder(still)
        monkeypatch.setattr("archfrag.study.provenance.code", lambda: "edited")
        assert finished_folder(still) is None

    def test_a_damaged_stamp_is_no_answer(self, still):
        path = still.parent / "out" / ".archfrag" / "stamp.json"
        content = path.read_text()
        whole = json.loads(content)
        for damage in (
            {},
            [],
            "text",
            {**whole, "from": 3},
            {**whole, "inputs": {}},
            {**whole, "inputs": {"\0": ""}},
            {**whole, "files": {"report.html": []}},
        ):
            path.write_text(json.dumps(damage))
            assert finished_folder(still) is None
        path.write_text(content)
        assert finished_folder(still)
