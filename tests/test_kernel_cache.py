"""Compiled kernels follow their source, are made once, and nobody else can plant any."""

import hashlib
import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import archfrag
from tests.motions.helpers import Payload

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
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, umask=umask,
        env={**inherited, **{k: str(v) for k, v in environment.items()}},
    ).stdout  # fmt: skip


def margin(**environment):
    """Number of kernels found, and the folder, where a process computes a margin."""
    value, found, folder = python(MARGIN, **environment).split()
    assert float(value) == 1.5
    return int(found), Path(folder)


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
    for name, same in (("registry.py", True), ("auto.py", True), ("common.py", False)):
        with open(package / "methods" / name, "a", encoding="utf-8") as file:
            file.write("\n# edited\n")
        assert (python(code, PYTHONPATH=tmp_path) == before) is same


def plant(folder, marker):
    """Put code in the place of every compiled kernel of a folder."""
    planted = pickle.dumps(Payload(marker))
    for path in folder.rglob("*.kernel"):
        path.write_bytes(hashlib.sha256(planted).digest() + planted)


@pytest.fixture
def base(tmp_path):
    """A cache of our own with a compiled kernel."""
    margin(NUMBA_CACHE_DIR=tmp_path / "base")
    return tmp_path / "base"


@pytest.fixture
def shared(tmp_path):
    """A directory like /tmp: everybody writes, nobody touches the files of others."""
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)
    return tmp_path / "shared"


@pytest.mark.skipif(os.getuid() != 0, reason="only root makes files of others")
def test_planted_code_runs_unless_it_is_of_another_user(base, tmp_path, shared):
    plant(base, tmp_path / "ran")
    margin(NUMBA_CACHE_DIR=base)
    (tmp_path / "ran").rmdir()
    plant(base, tmp_path / "ran")
    for place in (base, *base.rglob("*")):
        os.chown(place, 61002, 61002)
    found, folder = margin(NUMBA_CACHE_DIR=base, TMPDIR=shared)
    assert (found, (tmp_path / "ran").exists()) == (0, False)
    assert folder.is_relative_to(shared)
    assert not folder.exists()  # a temporary one, removed at the end


def test_a_place_where_everybody_writes_is_not_used(tmp_path, base, shared):
    code = "from archfrag.kernel_cache import use_kernel_cache; print(use_kernel_cache())"
    everybody = tmp_path / "open"
    everybody.mkdir()
    for place in (everybody, next(base.glob("k-*"))):
        place.chmod(0o777)
    for place in (everybody, everybody / "new", base):
        folder = python(code, 0, NUMBA_CACHE_DIR=place, TMPDIR=shared).strip()
        assert Path(folder).is_relative_to(shared)
    homeless = {"HOME": "/dev/null", "XDG_CACHE_HOME": ""}
    assert margin(**homeless, TMPDIR=everybody) == (0, Path("None"))


def test_damaged_files_count_as_missing(base):
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
    reported = python(code, NUMBA_CACHE_DIR=base).split()
    assert reported == ["1.5", "False", "False", "False", "True"]


def test_of_processes_that_compile_at_once_one_compiles_each_version(tmp_path):
    # Two versions of one kernel by each of four processes, each version by two of them.
    code = (
        "import sys, time, numpy as np, archfrag.mechanics.ground as g\n"
        "while time.time() < float(sys.argv[1]): time.sleep(0.001)\n"
        "for kind in sys.argv[2:]:\n"
        "    print(g.rest_margin(np.dtype(kind).type(1), 0.0, 10.0, 0.5, 0.5))\n"
        "print(len(g.rest_margin.stats.cache_hits))"
    )
    environment, start = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}, str(time.time() + 3.0)
    running = [
        subprocess.Popen([sys.executable, "-c", code, start, *kinds], env=environment,
                         stdout=subprocess.PIPE, text=True)
        for kinds in (["f8", "f4"], ["f4", "f8"], ["i8", "f8"], ["f4", "i8"])
    ]  # fmt: skip
    reported = [process.communicate(timeout=120)[0].split() for process in running]
    assert [words[:2] for words in reported] == 4 * [["4.0", "4.0"]]
    assert sum(int(words[2]) for words in reported) == 5
    assert len(list(tmp_path.rglob("*.kernel"))) == 3
    assert not [p for p in tmp_path.rglob("*") if p.suffix in (".lock", ".tmp")]
