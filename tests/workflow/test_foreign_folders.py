"""Folders from somebody else: nothing in them runs; nothing outside is emptied or removed."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from archfrag.study.provenance import MANIFEST, STAMPS, sha256_of
from tests.study.small import command, files_below, small_study

PRECIOUS = b"years of work\n"
DEEP = b"[" * 100_000


@dataclass
class Payload:
    """A pickle that makes a file when it is read."""

    mark: Path

    def __reduce__(self):
        return Path.touch, (self.mark,)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = small_study(tmp_path_factory.mktemp("made"))
    assert command("run", path).exit_code == 0
    return path.parent


class Folder:
    """A study's folder from somebody else beside files of the user."""

    def __init__(self, place, made):
        self.study = place / "study"
        shutil.copytree(made, self.study)
        self.out = self.study / "out"
        self.work = self.out / ".archfrag"
        self.mark = place / "it ran"
        self.user = place / "user"
        for name in (
            "lock",
            "snakemake.log",
            "a.json",
            "motions/0123456789ab/wave.npz",
            "logs/snakemake.log",
            "parts/0123456789ab/mine.npy",
            f"parts/0123456789ab/{'0' * 32}.npy",
            ".study.yaml.swp",
        ):
            path = self.user / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(PRECIOUS)
        self.precious = self.user / "lock"

    def link(self, name, to=None, hard=False):
        """Put a link in the place of one of the study's files or folders."""
        path = self.out / name
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        (os.link if hard else os.symlink)(to or self.precious, path)

    def pipe(self, name):
        (self.out / name).unlink(missing_ok=True)
        os.mkfifo(self.out / name)

    def write(self, *names, content=PRECIOUS):
        for name in names:
            (self.out / name).parent.mkdir(exist_ok=True)
            (self.out / name).write_bytes(content)

    def folder(self, name):
        (self.out / name).unlink(missing_ok=True)
        self.write(f"{name}/mine")

    def json(self, name, **changes):
        path = self.work / name
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    def pickled(self, path):
        """An array of objects, which numpy would unpickle if it were allowed to."""
        content = io.BytesIO()
        np.save(content, np.array([Payload(self.mark)], object), allow_pickle=True)
        path.write_bytes(content.getvalue())

    def stamps(self, name):
        known = json.loads((self.work / STAMPS).read_text())
        self.json(STAMPS, **{key: {name: "0" * 64} for key in known if key != "from"})

    def motions(self, elsewhere=False):
        manifest = json.loads((self.work / MANIFEST).read_text())
        for record in manifest["records"]:
            if elsewhere:
                record["stored"] = os.path.relpath(self.precious, self.work)
            else:
                self.pickled(self.work / record["stored"])
            record["prepared"] = sha256_of(self.work / record["stored"])
        self.json(MANIFEST, **manifest)

    def odd_names(self):
        parts = next(self.work.glob("parts/*")).relative_to(self.out)
        names = "a\nb.npy", "\x1b]0;x\a.npy", "plan-\n.json", "-rf", "$(touch x).npy"
        self.write(*(parts / name for name in names))


ATTACKS = {
    "lock is a link": lambda f: f.link(".archfrag/lock"),
    "lock is a hard link": lambda f: f.link(".archfrag/lock", hard=True),
    "lock is a pipe": lambda f: f.pipe(".archfrag/lock"),
    "hidden folder is a link": lambda f: f.link(".archfrag", f.user),
    "motions is a link": lambda f: f.link(".archfrag/motions", f.user / "motions"),
    "parts of others is a link": lambda f: f.link(
        ".archfrag/parts/0123456789ab", f.user / "parts/0123456789ab"
    ),
    "stamp is a link": lambda f: f.link(".archfrag/stamp.json", f.user / "a.json"),
    "stamp is a pipe": lambda f: f.pipe(".archfrag/stamp.json"),
    "stamp too deep": lambda f: f.write(".archfrag/stamp.json", content=DEEP),
    "stamps of a device": lambda f: f.stamps("/dev/zero"),
    "stamps with ..": lambda f: f.stamps("../../user/lock"),
    "stamps of a pipe": lambda f: (f.pipe("pipe"), f.stamps("pipe")),
    "run log no list": lambda f: f.write(".archfrag/run_log.json", content=b'{"a": 1}'),
    "run log is a hard link": lambda f: f.link(".archfrag/run_log.json", hard=True),
    "owner is a pipe": lambda f: f.pipe(".archfrag/study.json"),
    "table of runs is a link": lambda f: f.link(".archfrag/runs/batch-0of1.csv"),
    "manifest elsewhere": lambda f: f.motions(elsewhere=True),
    "manifest too deep": lambda f: f.write(f.work / MANIFEST, content=DEEP),
    "motions with pickles": Folder.motions,
    "parts with pickles": lambda f: [f.pickled(path) for path in f.work.rglob("*.npy")],
    "odd names": Folder.odd_names,
    "cube is a link": lambda f: f.link("cube.nc"),
    "cube is a pipe": lambda f: f.pipe("cube.nc"),
    "cube is a folder": lambda f: f.folder("cube.nc"),
    "fits is a link": lambda f: f.link("fits.json"),
    "report is a hard link": lambda f: f.link("report.html", hard=True),
    "figure is a link": lambda f: f.link("curve-ring.svg"),
    "hidden files of the user": lambda f: f.write(
        ".s.yaml.swp", ".notes.csv.bak", "sub/.a.html"
    ),
}


@pytest.fixture
def timeout():
    def hangs(number, frame):
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    "attack",
    [
        pytest.param(each, marks=[pytest.mark.posix] * ("pipe" in each))
        for each in ATTACKS
    ],
)
def test_a_results_folder_from_somebody_else(made, tmp_path, timeout, attack):
    """After a kill, so that it is swept too; with a new title and levels, so that all is made."""
    folder = Folder(tmp_path, made)
    ATTACKS[attack](folder)
    before = files_below(folder.user) | {
        path: content
        for path, content in files_below(folder.out).items()
        if content == PRECIOUS and not path.is_symlink() and path.stat().st_nlink == 1
    }
    study = folder.study / "small.yaml"
    changes = ["--set", "title=New", "--set", "intensity.levels=[0.1, 0.6]"]
    for asked in (["run", study, *changes], ["clean", study, *changes, "--yes"]):
        done = command(*asked)
        assert done.exception is None or isinstance(done.exception, SystemExit)
        assert len(done.stderr.splitlines()) < 20
    assert not folder.mark.exists()
    assert {path: path.read_bytes() for path in before} == before


MODULES = (
    "yaml",
    "numpy",
    "archfrag",
    "multiprocessing",
    "struct",
    "sitecustomize",
    "usercustomize",
    "distributed",
    "dask",
    "numba",
    "click",
    "resource",
    "planted",
)
CONFIGURATIONS = {
    "matplotlibrc": "backend: module://planted\n",
    "dask.yaml": "distributed: {worker: {preload: planted}, scheduler: {preload: planted}}\n",
    ".config/dask/dask.yaml": "distributed: {worker: {preload: planted}}\n",
    ".env": "PYTHONSTARTUP=planted.py\n",
    ".numba_config.yaml": "cache_dir: cached\n",
}


def test_a_current_folder_from_somebody_else(tmp_path):
    """Modules and configurations where a run is started and in the folder of its results."""
    path = small_study(tmp_path)
    (tmp_path / "ran").mkdir()
    for number, place in enumerate((tmp_path, tmp_path / "out" / ".archfrag")):
        for name, text in CONFIGURATIONS.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_text(text)
        for name in MODULES:
            mark = tmp_path / "ran" / f"{number}-{name}"
            (place / f"{name}.py").write_text(
                f"open({str(mark)!r}, 'w')\nraise SystemExit(9)\n"
            )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [Path(sys.executable).parent / "archfrag", "run", path],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        env=environment,
    )
    assert not [mark.name for mark in (tmp_path / "ran").iterdir()]
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "report.html").is_file()
