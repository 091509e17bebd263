"""Compiled kernels follow their source, are made once, and nobody else can plant any."""

import hashlib
import os
import pickle
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

import archfrag
from archfrag.kernel_cache import HOLDS_NO_KERNEL, KERNEL_FOLDERS

PACKAGE = Path(archfrag.__file__).parent
CALLER = """
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.ground import rest_margin

@kernel
def twice(across):
    return 2.0 * rest_margin(across, 0.0, 10.0, 0.5, 0.5)
"""
ASK = """
from archfrag.mechanics.caller import twice
print(twice(1.0), len(twice.stats.cache_hits))
"""
MARGIN = (
    "import archfrag.mechanics.ground as g;"
    "print(g.rest_margin(3.5, 0.0, 10.0, 0.5, 0.5),"
    "sum(g.rest_margin.stats.cache_hits.values()), g.rest_margin.stats.cache_path)"
)


def python(code, umask=-1, **environment):
    """What a process of its own prints."""
    inherited = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**inherited, **{k: str(v) for k, v in environment.items()}},
        capture_output=True,
        text=True,
        check=True,
        umask=umask,
    ).stdout


def margin(**environment):
    """Number of kernels found, and the folder, where a process computes a margin."""
    value, found, folder = python(MARGIN, **environment).split()
    assert float(value) == 1.5
    return int(found), Path(folder)


def chosen(umask=-1, **environment):
    """Folder that a process would use."""
    code = "from archfrag.kernel_cache import use_kernel_cache; print(use_kernel_cache())"
    return Path(python(code, umask, **environment).strip())


def clone(root):
    shutil.copytree(PACKAGE, root / "archfrag", ignore=shutil.ignore_patterns("__pycache__"))
    return root / "archfrag"


def test_an_edited_helper_is_compiled_anew_and_a_second_clone_compiles_nothing(tmp_path):
    cache, answers = tmp_path / "cache", []
    for name in ("first", "second"):
        package = clone(tmp_path / name)
        (package / "mechanics" / "caller.py").write_text(CALLER)
        answers.append(python(ASK, PYTHONPATH=tmp_path / name, NUMBA_CACHE_DIR=cache).split())
    assert answers == [["8.0", "0"], ["8.0", "1"]]
    helper = package / "mechanics" / "ground.py"
    text = helper.read_text()
    assert text.count("return margin\n") == 1
    helper.write_text(text.replace("return margin\n", "return margin + 1.0\n"))
    answer = python(ASK, PYTHONPATH=tmp_path / "second", NUMBA_CACHE_DIR=cache)
    assert answer.split() == ["10.0", "0"]
    assert len(list(cache.glob("k-*"))) == 2


def test_only_what_kernels_are_made_of_counts(tmp_path):
    package = clone(tmp_path)
    code = "from archfrag.kernel_cache import kernel_hash; print(kernel_hash())"
    before = python(code, PYTHONPATH=tmp_path)
    for name, same in (("registry.py", True), ("auto.py", True), ("springs.py", False)):
        with open(package / "methods" / name, "a", encoding="utf-8") as file:
            file.write("\n# edited\n")
        assert (python(code, PYTHONPATH=tmp_path) == before) is same
    left_out = [
        path
        for folder in KERNEL_FOLDERS
        for path in (PACKAGE / folder).rglob("*.py")
        if path.name in HOLDS_NO_KERNEL
    ]
    assert len(left_out) >= 4
    assert [path for path in left_out if "mechanics.compile" in path.read_text()] == []


class Planted:
    """A pickle that makes a file when it is read."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)


def plant(folder, marker):
    """Put code in the place of every compiled kernel of a folder."""
    planted = pickle.dumps(Planted(marker))
    kernels = [path for path in folder.rglob("*") if path.is_file()]
    assert kernels
    for path in kernels:
        path.write_bytes(hashlib.sha256(planted).digest() + planted)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    base = tmp_path_factory.mktemp("compiled")
    margin(NUMBA_CACHE_DIR=base)
    return base


@pytest.fixture
def base(compiled, tmp_path):
    """A cache of our own with a compiled kernel, its folder and the kernel's file."""
    base = shutil.copytree(compiled, tmp_path / "base")
    (folder,) = base.glob("k-*")
    return base, folder, next(folder.iterdir())


@pytest.fixture
def shared(tmp_path):
    """A directory like /tmp: everybody writes, nobody touches the files of others."""
    place = tmp_path / "shared"
    place.mkdir()
    place.chmod(0o1777)
    return place


@pytest.fixture
def open_to_all(tmp_path):
    place = tmp_path / "open"
    place.mkdir()
    place.chmod(0o777)
    return place


HOMELESS = {"HOME": "/dev/null", "XDG_CACHE_HOME": ""}
as_root = pytest.mark.skipif(
    os.getuid() != 0, reason="only root can make files of another user"
)  # fmt: skip


class TestOthers:
    """A folder that someone else made or can write to is not used."""

    def test_planted_code_runs_where_the_folder_is_ours(self, base, tmp_path):
        # What the next test plants does run when it is trusted.
        plant(base[0], tmp_path / "ran")
        margin(NUMBA_CACHE_DIR=base[0])
        assert (tmp_path / "ran").exists()

    @as_root
    def test_planted_by_another_user(self, base, tmp_path, shared):
        plant(base[0], tmp_path / "ran")
        theirs = Path(shutil.move(base[0], shared / f"archfrag-{os.getuid()}"))
        for place in (theirs, *theirs.rglob("*")):
            os.chown(place, 61002, 61002)
        found, folder = margin(**HOMELESS, TMPDIR=shared)
        assert found == 0
        assert not (tmp_path / "ran").exists()
        assert folder.is_relative_to(shared)
        assert not folder.is_relative_to(theirs)
        assert not folder.exists()  # a temporary one, removed at the end

    @as_root
    @pytest.mark.parametrize("whose", [0, 1, 2], ids=["base", "folder", "file"])
    def test_partly_of_another_user(self, base, shared, whose):
        base[1].chmod(0o777)
        os.chown(base[whose], 61002, 61002)
        assert chosen(NUMBA_CACHE_DIR=base[0], TMPDIR=shared).is_relative_to(shared)

    @pytest.mark.parametrize("inside", ["", "base"])
    def test_a_place_where_everybody_writes(self, open_to_all, shared, inside):
        folder = chosen(NUMBA_CACHE_DIR=open_to_all / inside, TMPDIR=shared)
        assert folder.is_relative_to(shared)

    def test_a_link_in_the_temporary_directory(self, tmp_path, shared):
        (tmp_path / "empty").mkdir(mode=0o700)
        (shared / f"archfrag-{os.getuid()}").symlink_to(tmp_path / "empty")
        assert chosen(**HOMELESS, TMPDIR=shared).is_relative_to(shared)
        assert not list((tmp_path / "empty").iterdir())

    def test_no_safe_place_at_all(self, open_to_all):
        assert margin(**HOMELESS, TMPDIR=open_to_all) == (0, Path("None"))
        assert not list(open_to_all.iterdir())


class TestPrivate:
    def test_whatever_the_umask(self, tmp_path):
        chosen(umask=0, NUMBA_CACHE_DIR=tmp_path / "a" / "b")
        for folder in (p for p in tmp_path.rglob("*") if p.is_dir()):
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700, folder

    def test_a_folder_of_ours_that_a_group_may_write_is_closed(self, base):
        for place in base[:2]:
            place.chmod(0o775)
        assert chosen(NUMBA_CACHE_DIR=base[0]) == base[1]
        assert stat.S_IMODE(base[1].stat().st_mode) == 0o700
        assert base[2].exists()


class TestFiles:
    def test_damaged_ones_count_as_missing(self, base):
        code = (
            "import glob, os, archfrag.mechanics.ground as g\n"
            "(file,) = glob.glob(os.environ['NUMBA_CACHE_DIR'] + '/*/*.kernel')\n"
            "full = open(file, 'rb').read()\n"
            "print(g.rest_margin(3.5, 0.0, 10.0, 0.5, 0.5))\n"
            "cache, context = g.rest_margin._cache, g.rest_margin.targetctx\n"
            "(sig,) = g.rest_margin.overloads\n"
            "for text in (full[:100], b'', full[:-1] + bytes([full[-1] ^ 1]), full):\n"
            "    open(file, 'wb').write(text)\n"
            "    print(cache.load_overload(sig, context) is not None)\n"
        )
        reported = python(code, NUMBA_CACHE_DIR=base[0]).split()
        assert reported == ["1.5", "False", "False", "False", "True"]

    def test_processes_that_compile_at_once(self, tmp_path):
        # Two versions of one kernel by each of four processes, each version by two of them.
        code = (
            "import sys, time, numpy as np, archfrag.mechanics.ground as g\n"
            "while time.time() < float(sys.argv[1]): time.sleep(0.001)\n"
            "for kind in sys.argv[2:]:\n"
            "    print(kind, g.rest_margin(np.dtype(kind).type(1), 0.0, 10.0, 0.5, 0.5))\n"
            "print(len(g.rest_margin.stats.cache_hits), len(g.rest_margin.overloads))"
        )
        start = str(time.time() + 3.0)
        pairs = (["f8", "f4"], ["f4", "f8"], ["i8", "f8"], ["f4", "i8"])
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        running = [
            subprocess.Popen([sys.executable, "-c", code, start, *kinds], env=environment,
                             stdout=subprocess.PIPE, text=True)
            for kinds in pairs
        ]  # fmt: skip
        reported = [process.communicate(timeout=120)[0].split() for process in running]
        for words, kinds in zip(reported, pairs):
            assert words[:4] == [kinds[0], "4.0", kinds[1], "4.0"]
        # Each version was compiled by one process; the others waited for it.
        assert sum(int(words[-2]) for words in reported) == 5
        assert len(list(tmp_path.rglob("*.kernel"))) == 3
        assert not [p for p in tmp_path.rglob("*") if p.suffix in (".lock", ".tmp")]
