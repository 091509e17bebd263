"""Kernels are C functions, and structs reach them as one pointer."""

import ast
import math
import threading
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import archfrag
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import lane_array, runs_of
from archfrag.physics.kernels.structs import struct
from archfrag.physics.mega_voussoirs.assemble import new_mega_voussoirs
from archfrag.physics.state import model_of
from tests.physics.kernels import effects

PACKAGE = Path(archfrag.__file__).parent
ARCH = archfrag.Arch.circular(10.0, 1.5, 157.5, voussoirs=5, friction=0.7)


@struct(pair=(2,))
class Inner(NamedTuple):
    pair: np.ndarray
    offset: float


@struct()
class Outer(NamedTuple):
    inner: Inner
    parts: tuple[np.ndarray, ...]
    count: int
    on: bool


@struct(row=(2,))
class Pair(NamedTuple):
    column: np.ndarray
    row: np.ndarray


@inlined
def total(values):
    found = 0.0
    for k in range(values.size):
        found += values[k]
    return found


@kernel
def read(outer, shift=0.0):
    """Numbers of all kinds of fields."""
    inner = outer.inner
    found = 0.0
    for i in range(inner.pair.shape[0]):
        found += inner.pair[i, 0] - inner.pair[-1, 1]
    for part in outer.parts:
        found += 100.0 * total(part)
    return found + inner.offset + shift, outer.count, outer.on, inner.pair.shape[1]


@kernel
def write(array, outer):
    array[0] = array[1] + 1.0
    outer.inner.pair[1:, :] = 7.0


def outer_of(n):
    pair = np.arange(2.0 * n).reshape(n, 2)
    return Outer(Inner(pair, 0.5), (np.ones(3), np.full(2, 2.0)), n, n > 2)


class TestCalls:
    @pytest.mark.parametrize("n", [2, 3])
    def test_a_struct_is_read_as_python_reads_it(self, n):
        outer = outer_of(n)
        assert read(outer) == read.py_func(outer) == (sum(read(outer)[:1]), n, n > 2, 2)
        assert read(outer, shift=1.0)[0] == read(outer)[0] + 1.0

    def test_arrays_are_those_of_the_caller_gaps_included(self):
        outer = outer_of(4)
        gaps = np.arange(6.0)[::3]
        write(gaps, outer)
        assert gaps.tolist() == [4.0, 3.0]
        assert (outer.inner.pair[1:] == 7.0).all()
        assert outer.inner.pair[0].tolist() == [0.0, 1.0]

    def test_arrays_of_a_struct_without_their_shape_are_refused(self):
        for wrong in (np.zeros((3, 3)), np.zeros((3, 4))[:, :2]):
            with pytest.raises(ValueError, match="of a struct has shape"):
                read(Outer(Inner(wrong, 0.0), (np.ones(1), np.ones(1)), 1, True))

    def test_an_argument_of_a_kind_that_kernels_do_not_know_is_named(self):
        with pytest.raises(TypeError, match="cannot be given str: 'here'"):
            read("here")

    def test_other_threads_go_on_while_a_kernel_runs(self):
        @kernel
        def busy(n):
            found = 0.0
            for k in range(n):
                found += math.sqrt(found + k)
            return found

        busy.name = f"{__name__}:busy"
        globals()["busy"] = busy
        busy(1)
        thread = threading.Thread(target=busy, args=(300_000_000,))
        counted = 0
        thread.start()
        while thread.is_alive():
            counted += 1
        assert counted > 1000


class TestStructs:
    def test_fields_that_share_memory_are_refused(self):
        """The law by which LLVM reorders loads and stores."""
        whole = np.ones((4, 2))
        with pytest.raises(ValueError, match="column and row of a Pair share memory"):
            _ = Pair(whole[:3], whole[2:]).table
        with pytest.raises(ValueError, match="of a Pair share memory"):
            _ = Pair(whole, whole).table
        assert Pair(whole[:2], whole[2:]).table.size
        assert Pair(whole[:0], whole).table.size

    def test_views_of_mega_voussoirs_are_cut(self):
        mega = new_mega_voussoirs(model_of(ARCH.chain))

        @kernel
        def sizes(mega):
            from_table = in_use(mega)
            return from_table.position.shape[0], from_table.work.slide.shape[0]

        from archfrag.physics.mega_voussoirs.assemble import in_use

        globals()["in_use"] = in_use
        sizes.name = f"{__name__}:sizes"
        globals()["sizes"] = sizes
        for joints in range(ARCH.chain.friction.size + 1):
            mega.count[1] = joints
            assert sizes(mega) == (max(joints - 1, 0) + 2, joints)

    def test_four_runs_share_items(self):
        array = lane_array((2, 3))
        runs_of(array)[1, 2] = [1.0, 2.0, 3.0, 4.0]
        assert array.shape == (2, 3)
        assert array.ctypes.data % 32 == 0


def test_numbas_insides_stand_in_one_folder_and_are_four_names():
    private = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_bytes())):
            names = [getattr(each, "name", "") for each in getattr(node, "names", [])]
            module = (
                getattr(node, "module", None)
                if isinstance(node, ast.ImportFrom)
                else None
            )
            of = module or (names[0] if isinstance(node, ast.Import) else "")
            if of.split(".")[0] in ("numba", "llvmlite"):
                assert path.parent.name == "kernels", path
                if of.startswith("numba.") and of != "numba.extending":
                    private |= set(names)
    assert private == {"compile_extra", "Flags", "cpu_target", "AttributeTemplate"}


def test_docstrings_of_kernels_name_the_fields_that_they_read_and_write():
    texts = effects.sources()
    trees = effects.kernels(texts)
    known = effects.all_effects(texts)
    checked = 0
    for key, (node, _, is_inlined) in trees.items():
        if not is_inlined:
            lines = (ast.get_docstring(node) or "").split("\n")
            told = [line for line in lines if line.startswith(("Reads:", "Writes:"))]
            assert told == effects.lines_of(*known[key]), key
            checked += bool(told)
    assert checked > 50


def test_effects_follow_names_and_imports():
    """Two kernels of one name; what counts is the one that is imported."""
    texts = {
        "one": """
from other import inner
@kernel
def outer(work, state, factor):
    face, total = work.face, 0.0
    for j in range(state.slip.size):
        total += factor * face[j, 0]
        state.slip[j] += 1.0
    inner(state.force, work)
    return total
""",
        "other": "@kernel\ndef inner(out, work):\n    out[0] = work.point[1]\n",
        "third": "@kernel\ndef inner(runs, scene):\n    runs.clock = scene.end\n"
        "A = Law(pose=inner)\n"
        "@kernel\ndef by_law(runs, at):\n    runs.law.pose(at, runs.law)\n",
    }
    known = effects.all_effects(texts)
    assert effects.lines_of(*known["one", "outer"]) == [
        "Reads: work (face, point), state.slip.",
        "Writes: state (force, slip).",
    ]
    assert effects.lines_of(*known["other", "inner"]) == [
        "Reads: work.point.",
        "Writes: out.",
    ]
