"""LLVM code that comes with archfrag: of this source, ready at once, the same bits everywhere."""

import contextlib
import hashlib
import json
import lzma
import os
import subprocess
import sys
import time

import llvmlite.binding as llvm
import numpy as np
import psutil
import pytest

import archfrag as af
from archfrag.physics.kernels import __main__ as ready
from archfrag.physics.kernels import load, processor
from archfrag.physics.kernels.cache import source_hash
from archfrag.simulation.simulate import results_of_runs

BUILD = "python -m archfrag.physics.kernels build"
READY = """
import json, sys
from archfrag.simulation.warmup import kernels_are_compiled, warmup
messages = []
before = kernels_are_compiled()
warmup("auto", messages.append)
print(json.dumps([before, kernels_are_compiled(), messages[0], "numba" in sys.modules]))
"""


def test_it_is_of_this_source_and_of_the_kernels_that_studies_call():
    for name in load.SETS:
        assert load._shipped(name)[0] == source_hash(), f"run `{BUILD}`"
    used = subprocess.check_output(
        [sys.executable, "-m", "archfrag.simulation.warmup"], text=True
    )
    shipped = {name: load._kernels(load._shipped(name)[1]) for name in load.SETS}
    found = {
        name: [(kernel, load.as_tuples(key)) for kernel, key in each]
        for name, each in json.loads(used).items()
    }
    assert found == shipped, f"run `{BUILD}`"


def test_it_does_not_say_where_numba_was_installed():
    for name in load.SETS:
        assert "site-packages" not in str(llvm.parse_bitcode(load._shipped(name)[2]))


def test_machine_code_is_made_of_it_once_and_without_numba(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    told = [
        json.loads(
            subprocess.check_output([sys.executable, "-c", READY], env=environment)
        )
        for _ in range(2)
    ]
    assert told[0][2].startswith(
        "making machine code of the kernels (first run only): "
    )
    assert told[0][:2] + told[0][3:] == [False, True, False]
    assert told[1] == [True, True, "loading kernels", False]


def test_a_second_process_ends_with_a_first_one_that_is_killed(tmp_path):
    code = (
        "from archfrag.physics.kernels.__main__ import make_all_ready; make_all_ready()"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    first = subprocess.Popen([sys.executable, "-c", code], env=environment)
    try:
        helpers = []
        until = time.monotonic() + 60.0
        while not helpers:
            assert time.monotonic() < until
            helpers = psutil.Process(first.pid).children()
    finally:
        first.kill()
        first.wait()
    _, alive = psutil.wait_procs(helpers, timeout=20.0)
    assert not alive
    assert not list(tmp_path.rglob("events-*"))  # it has not gone on to its end


def shipped(source, offers, code, digest=None):
    """What the build writes of a set, as a file."""
    header = [source, offers, digest or hashlib.sha256(code).hexdigest()]
    return lzma.compress(json.dumps(header).encode() + b"\n" + code)


def damaged():
    """Files in which a set has come to harm, by what is wrong."""
    source, offers, code = load._shipped("rest")
    middle = len(code) // 2
    changed = code[:middle] + bytes([code[middle] ^ 1]) + code[middle + 1 :]
    whole = (load.SHIPPED / "rest.xz").read_bytes()
    return {
        "another LLVM": shipped(source, offers, b"BC\xc0\xde" + 64 * b"new"),
        "no code": shipped(source, offers, b""),
        "a part of the code": shipped(source, offers, code[:middle]),
        "another byte": shipped(
            source, offers, changed, hashlib.sha256(code).hexdigest()
        ),
        "other kernels": shipped(source, [["of", [], "another", "f8"]], code),
        "no digest": lzma.compress(
            json.dumps([source, offers]).encode() + b"\n" + code
        ),
        "no header": lzma.compress(code),
        "a number": lzma.compress(b"1\n"),
        "cut": whole[:1000],
        "empty": b"",
    }


def test_shipped_code_that_cannot_be_used_is_compiled_with_a_word(
    monkeypatch, tmp_path
):
    files = damaged()
    compiled = []

    def compile_set(entries):
        compiled.append(entries)
        return [], llvm.parse_assembly("").as_bitcode()

    monkeypatch.setattr(load, "SHIPPED", tmp_path)
    monkeypatch.setattr(load, "use_kernel_cache", lambda: None)
    monkeypatch.setattr("archfrag.physics.kernels.compile.compile_set", compile_set)
    for number, (what, content) in enumerate(files.items(), 1):
        load._shipped.cache_clear()
        (tmp_path / "rest.xz").write_bytes(content)
        with pytest.warns(
            RuntimeWarning, match=r"rest\.xz is damaged.*are compiled"
        ) as said:
            load.make_ready("rest")
        assert (len(said), len(compiled)) == (1, number), what
    load._shipped.cache_clear()


def test_a_list_of_kernels_that_is_older_than_their_source_is_said(monkeypatch):
    made = []

    def make(name):
        made.append(name)
        raise TypeError("missing a required argument")

    monkeypatch.setattr(ready, "is_ready", lambda name: False)
    monkeypatch.setattr(ready, "make_ready", make)
    monkeypatch.setattr(
        ready, "_second_process", lambda names: contextlib.nullcontext()
    )
    with pytest.warns(
        UserWarning, match="run `python -m archfrag.physics.kernels build`"
    ) as said:
        ready.make_all_ready()
    assert (made, len(said)) == (list(load.OF_ALL), 3)


def runs(name):
    """What hundred runs leave: of a ring of seven, by steps and by events."""
    rng = np.random.default_rng(2)
    arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.6)
    wave = np.cumsum(rng.normal(size=(5, 400)), axis=1) * np.hanning(400)
    motions = [af.Motion(each, 0.01) for each in wave for _ in range(20)]
    factors = np.tile(np.geomspace(0.1, 1.0, 20), 5).tolist()
    found, *_ = results_of_runs(arch, motions, factors, method=name, rtol=1e-3)
    return found


@pytest.mark.skipif(
    not processor.has_common_features(), reason="needs the processor's features"
)
def test_machine_code_for_this_processor_and_for_any_gives_the_same_bits(monkeypatch):
    from archfrag.physics.steps.run import run_four

    here = runs("time_stepping")
    (key,) = list(run_four._entries)[:1]
    entry = run_four._entries.pop(key)
    code = llvm.parse_bitcode(load._shipped("steps")[2])
    common = processor.machine(processor.PROCESSOR).emit_object(code)
    monkeypatch.setattr(load, "_found", {})
    load._take((load._shipped("steps")[1], common), (run_four.name, key))
    monkeypatch.setattr(load, "called", [])
    assert (run_four.name, key) in load._found
    there = runs("time_stepping")
    run_four._entries[key] = entry
    for one, other in zip(here, there, strict=True):
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    assert len(set(here.status.tolist())) == 2


@pytest.mark.skipif(
    not processor.has_common_features(), reason="this processor has not what it is for"
)
def test_it_is_made_again_to_the_last_byte(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "archfrag.physics.kernels", "build", tmp_path],
        check=True,
    )
    for name in load.SETS:
        made, shipped = (
            lzma.decompress((folder / f"{name}.xz").read_bytes())
            for folder in (tmp_path, load.SHIPPED)
        )
        assert made.partition(b"\n")[0] == shipped.partition(b"\n")[0], name
        assert made == shipped, name
