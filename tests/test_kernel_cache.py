"""Compiled kernels follow their source: an edited helper never leaves an old kernel in use."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import archfrag

PACKAGE = Path(archfrag.__file__).parent
ASK = """
import numpy as np
from archfrag.mechanics.energy import potential_energy
from archfrag.mechanics.caller import twice
print(twice(np.ones(1), 10.0, np.array([[0.0, 2.0, 0.0]])))
"""
CALLER = """
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.energy import potential_energy

@kernel
def twice(mass, gravity, position):
    return 2.0 * potential_energy(mass, gravity, position)
"""


def ask(root, cache):
    done = subprocess.run(
        [sys.executable, "-c", ASK],
        env={**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def test_an_edited_helper_is_compiled_anew(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "archfrag", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "archfrag" / "mechanics" / "caller.py").write_text(CALLER)
    cache = tmp_path / "cache"
    assert ask(tmp_path, cache) == 40.0
    assert ask(tmp_path, cache) == 40.0
    assert len(list(cache.glob("k-*"))) == 1
    helper = tmp_path / "archfrag" / "mechanics" / "energy.py"
    text = helper.read_text()
    assert "return total * gravity" in text
    helper.write_text(text.replace("return total * gravity", "return total * gravity + 1.0"))
    assert ask(tmp_path, cache) == 42.0
    assert len(list(cache.glob("k-*"))) == 2


def test_kernels_are_found_again(tmp_path):
    code = (
        "import archfrag.mechanics.energy as e, numpy as np;"
        "e.kinetic_energy(np.ones(1), np.ones(1), np.ones((1, 3)));"
        "print(sum(e.kinetic_energy.stats.cache_hits.values()))"
    )
    hits = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for _ in range(2)
    ]
    assert hits == ["0", "1"]


def test_a_cache_that_cannot_be_written_is_replaced(tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.write_text("")
    done = subprocess.run(
        [sys.executable, "-c", "import archfrag.mechanics.energy as e;"
         "print(e.kinetic_energy.stats.cache_path)"],
        env={**os.environ, "NUMBA_CACHE_DIR": str(in_the_way), "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.startswith(str(tmp_path / "archfrag-"))


def test_only_what_kernels_are_made_of_counts(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "archfrag", ignore=shutil.ignore_patterns("__pycache__"))

    def digest():
        return subprocess.run(
            [sys.executable, "-c",
             "from archfrag.kernel_cache import kernel_hash; print(kernel_hash())"],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip

    before = digest()
    for name, same in (("registry.py", True), ("springs.py", False)):
        with open(tmp_path / "archfrag" / "methods" / name, "a", encoding="utf-8") as file:
            file.write("\n# edited\n")
        assert (digest() == before) is same


def test_a_second_clone_compiles_nothing(tmp_path):
    code = (
        "import archfrag.mechanics.energy as e, numpy as np;"
        "e.kinetic_energy(np.ones(1), np.ones(1), np.ones((1, 3)));"
        "print(sum(e.kinetic_energy.stats.cache_hits.values()))"
    )
    hits = []
    for name in ("first", "second"):
        shutil.copytree(
            PACKAGE, tmp_path / name / "archfrag", ignore=shutil.ignore_patterns("__pycache__")
        )
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={
                **os.environ,
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
                "PYTHONPATH": str(tmp_path / name),
            },
            capture_output=True,
            text=True,
            check=True,
        )
        hits.append(done.stdout.strip())
    assert hits == ["0", "1"]
