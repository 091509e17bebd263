"""Compiled kernels follow their source, are made once, and nobody else can plant any."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import pytest

import archfrag
from archfrag.physics.kernels import load

PACKAGE = Path(archfrag.__file__).parent
CALLER = """
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.ground import rest_margin

@kernel
def twice(across):
    return 2.0 * rest_margin(across, 0.0, 10.0, 0.5, 0.5)
"""
ASK = """
import sys
from archfrag.physics.caller import twice
print(twice(1.0), "numba" in sys.modules)
"""
MARGIN = """
import sys
from archfrag.physics.kernels.cache import use_kernel_cache
from archfrag.physics.ground import rest_margin
print(rest_margin(3.5, 0.0, 10.0, 0.5, 0.5), "numba" in sys.modules, use_kernel_cache())
"""


def python(code, umask=-1, **environment):
    """What a process of its own prints."""
    inherited = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        umask=umask,
        env={**inherited, **{k: str(v) for k, v in environment.items()}},
    ).stdout


def margin(**environment):
    """Whether a process that computes a margin compiles, and its folder."""
    value, compiles, folder = python(MARGIN, **environment).split()
    assert float(value) == 1.5
    return compiles == "True", Path(folder)


def clone(root):
    shutil.copytree(
        PACKAGE, root / "archfrag", ignore=shutil.ignore_patterns("__pycache__")
    )
    return root / "archfrag"


def test_an_edited_helper_is_compiled_anew_and_a_second_clone_compiles_nothing(
    tmp_path,
):
    cache = tmp_path / "cache"
    answers = []
    for name in ("first", "second"):
        package = clone(tmp_path / name)
        (package / "physics" / "caller.py").write_text(CALLER)
        answers.append(
            python(ASK, PYTHONPATH=tmp_path / name, NUMBA_CACHE_DIR=cache).split()
        )
    assert answers == [["8.0", "True"], ["8.0", "False"]]
    helper = package / "physics" / "ground.py"
    text = helper.read_text()
    assert text.count("return margin\n") == 1
    helper.write_text(text.replace("return margin\n", "return margin + 1.0\n"))
    answer = python(ASK, PYTHONPATH=tmp_path / "second", NUMBA_CACHE_DIR=cache)
    assert answer.split() == ["10.0", "True"]
    assert len(list(cache.glob("k-*"))) == 2


SOURCE = b'''"""What a file does is more than its words."""
def first(a: int, *, b=None) -> None:
    """Versions differ in fields that are empty, in pieces of texts, and in what they escape."""
    kinds = {**a, "": [], None: ()}
    if b: raise ValueError(f"what is said {a}")
    return f"{a:{b}}, {a!r:>{b}.3f} {{b}} {a=}" "" f"", "\\u1c89 \xf0\x9f\xab\xa9", 1e400
'''
VERSIONS = ("python3.11", "python3.12", "python3.13")
ON_ITS_OWN = """
import hashlib, importlib.util, sys
from unittest.mock import MagicMock
sys.modules["archfrag"] = sys.modules["archfrag.system"] = MagicMock()  # of no use to digests
spec = importlib.util.spec_from_file_location("cache", sys.argv[1])
cache = importlib.util.module_from_spec(spec)
spec.loader.exec_module(cache)
cache.use_kernel_cache = lambda: None
print(hashlib.sha256(cache.text_of(eval(sys.argv[2])).encode()).hexdigest(), cache.source_hash())
"""


def digests(python):
    """Digests of `SOURCE` and of the kernels' source by another Python, which has no packages."""
    given = [PACKAGE / "physics" / "kernels" / "cache.py", repr(SOURCE)]
    return subprocess.check_output(
        [python, "-c", ON_ITS_OWN, *given], text=True
    ).split()


def test_the_digest_of_a_source_is_the_same_on_all_versions_of_python():
    known = "498bed226e855181"
    assert digests(sys.executable)[0][:16] == known


@pytest.mark.parametrize("python", VERSIONS)
def test_other_versions_of_python_find_the_same_shipped_code(python):
    found = subprocess.run([python, "--version"], capture_output=True)
    if found.returncode:
        pytest.skip(f"{python} is not installed")
    assert digests(python) == digests(sys.executable)


def test_the_name_of_machine_code_has_what_the_processor_may_use(monkeypatch, tmp_path):
    monkeypatch.setattr(load, "use_kernel_cache", lambda: tmp_path)
    features = llvm.get_host_cpu_features()
    before = load._path("steps")
    assert load._path("steps") == before
    monkeypatch.setattr(
        llvm,
        "get_host_cpu_features",
        lambda: llvm.FeatureMap({**features, "avx512f": not features.get("avx512f")}),
    )
    assert load._path("steps") != before


def test_only_what_kernels_are_made_of_counts(tmp_path):
    package = clone(tmp_path)
    code = (
        "from archfrag.physics.kernels.cache import kernel_hash; print(kernel_hash())"
    )
    before = python(code, PYTHONPATH=tmp_path)
    for name, same in (
        ("methods/registry.py", True),
        ("methods/auto.py", True),
        ("shared.py", False),
    ):
        with open(package / "physics" / name, "a", encoding="utf-8") as file:
            file.write("\n# edited\n")
        assert (python(code, PYTHONPATH=tmp_path) == before) is same


@pytest.fixture
def base(tmp_path):
    """A cache of our own with a compiled kernel."""
    margin(NUMBA_CACHE_DIR=tmp_path / "base")
    return tmp_path / "base"


@pytest.mark.skipif(os.getuid() != 0, reason="only root makes files of others")
def test_files_of_another_user_are_not_used(base):
    assert not margin(NUMBA_CACHE_DIR=base)[0]
    for place in (base, *base.rglob("*")):
        os.chown(place, 61002, 61002)
    assert margin(NUMBA_CACHE_DIR=base) == (True, Path("None"))


def test_a_place_where_everybody_writes_is_not_used(tmp_path, base):
    code = "from archfrag.physics.kernels.cache import use_kernel_cache; print(use_kernel_cache())"
    everybody = tmp_path / "open"
    everybody.mkdir()
    for place in (everybody, next(base.glob("k-*"))):
        place.chmod(0o777)
    for place in (everybody, everybody / "new", base):
        assert python(code, 0, NUMBA_CACHE_DIR=place).strip() == "None"
    assert margin(HOME="/dev/null", XDG_CACHE_HOME="") == (True, Path("None"))


def test_damaged_files_count_as_missing(base):
    (file,) = base.glob("*/*.kernels")
    full = file.read_bytes()
    for content in (full[:100], b"", full[:-1] + bytes([full[-1] ^ 1])):
        file.write_bytes(content)
        assert margin(NUMBA_CACHE_DIR=base)[0]
        assert file.read_bytes() == full
    assert not margin(NUMBA_CACHE_DIR=base)[0]


def test_processes_that_compile_at_once_leave_whole_files(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    running = [
        subprocess.Popen(
            [sys.executable, "-c", MARGIN],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    assert all(each.communicate(timeout=120)[0].startswith("1.5 ") for each in running)
    assert len(list(tmp_path.rglob("*.kernels"))) == 1
    assert not list(tmp_path.rglob("*.tmp"))


def test_what_cannot_be_kept_is_said_once_and_runs(tmp_path):
    code = (
        "import pathlib, archfrag.physics.kernels.load as load\n"
        "def full(*_): raise OSError(28, 'No space left on device')\n"
        "load.replace = full\n" + MARGIN
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    made = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert made.stdout.startswith("1.5 True")
    assert made.stderr.count("No space left on device") == 1
    assert not list(tmp_path.rglob("*.tmp"))
