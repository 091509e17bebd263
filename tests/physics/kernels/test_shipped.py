"""LLVM code that comes with archfrag: of this source, ready at once, the same bits everywhere."""

import contextlib
import difflib
import hashlib
import itertools
import json
import lzma
import os
import struct
import subprocess
import sys
import time
import warnings

import llvmlite.binding as llvm
import numpy as np
import psutil
import pytest

import archfrag as af
from archfrag.physics.kernels import __main__ as ready
from archfrag.physics.kernels import load
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

    def compile_set(entries, target):
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
    assert (made, len(said)) == (list(load.of_all()), 3)


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
    not load.has_common_features(), reason="needs the processor's features"
)
def test_machine_code_for_this_processor_and_for_any_gives_the_same_bits(monkeypatch):
    from archfrag.physics.steps.run import run_several

    here = runs("time_stepping")
    (key,) = list(run_several._entries)[:1]
    entry = run_several._entries.pop(key)
    code = llvm.parse_bitcode(load._shipped("steps")[2])
    common = load.machine(load.PROCESSOR).emit_object(code)
    monkeypatch.setattr(load, "_found", {})
    load._take((load._shipped("steps")[1], common), (run_several.name, key))
    monkeypatch.setattr(load, "called", [])
    assert (run_several.name, key) in load._found
    there = runs("time_stepping")
    run_several._entries[key] = entry
    for one, other in zip(here, there, strict=True):
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    assert len(set(here.status.tolist())) == 2


RUN = """
import hashlib, sys
from pathlib import Path
from archfrag.physics.kernels import load
load.SHIPPED = Path(sys.argv[1])
import numpy as np
import archfrag as af
arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.6)
bridge = af.Bridge([arch, arch], piers={"height": 5.0, "width": 4.0})
wave = np.cumsum(np.random.default_rng(2).normal(size=(5, 400)), axis=1) * np.hanning(400)
motions = [af.Motion(each, 0.01) for each in wave for _ in range(20)]
found = hashlib.sha256()
for each, method in ((arch, "time_stepping"), (arch, "event_driven"), (bridge, "auto")):
    runs = af.simulate_many(each, motions, np.geomspace(0.2, 2.0, 100), method=method)
    for name in ("collapsed", "peak_rotation", "collapse_time"):
        found.update(np.ascontiguousarray(runs[name]).tobytes())
assert all(load.is_shipped(name) for name in load.SETS)
print(found.hexdigest())
"""


@pytest.mark.skipif(
    not load.has_common_features(), reason="this processor has not what it is for"
)
def test_it_is_made_again_to_the_last_byte_or_at_least_to_the_last_bit(tmp_path):
    """LLVM orders code in the same way nearly always; else all results must be the same."""
    made = tmp_path / "made"
    subprocess.run(
        [sys.executable, "-m", "archfrag.physics.kernels", "build", made], check=True
    )
    unequal = {}
    for name in load.SETS:
        contents = [
            lzma.decompress((folder / f"{name}.xz").read_bytes())
            for folder in (made, load.SHIPPED)
        ]
        headers = [json.loads(each.partition(b"\n")[0]) for each in contents]
        assert headers[0][:2] == headers[1][:2], f"{name}: run `{BUILD}`"
        if contents[0] != contents[1]:
            codes = [
                str(llvm.parse_bitcode(each.partition(b"\n")[2])) for each in contents
            ]
            lines = difflib.unified_diff(
                *map(str.splitlines, codes), "made", "shipped", n=0
            )
            unequal[name] = list(itertools.islice(lines, 40))
    if unequal:
        warnings.warn(f"made in another order: {unequal}", stacklevel=1)
        told = [
            subprocess.check_output(
                [sys.executable, "-c", RUN, folder],
                env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / f"cache{n}")},
            )
            for n, folder in enumerate((made, load.SHIPPED))
        ]
        assert told[0] == told[1]


TRIPLES = {
    "x86_64-unknown-linux-gnu": ("x86-64-v3", b"\x7fELF"),
    "x86_64-pc-windows-msvc": ("x86-64-v3", b"\x64\x86"),
    "arm64-apple-macosx11.0.0": ("apple-m1", b"\xcf\xfa\xed\xfe"),
}
# What an object file may ask of the system: the C library's mathematics and memory, and the check
# of the stack that Windows has.
OF_SYSTEM = {
    *[
        "acos",
        "asin",
        "atan",
        "atan2",
        "cos",
        "exp",
        "floor",
        "fmod",
        "hypot",
        "log",
        "pow",
        "sin",
        "sqrt",
        "tan",
        "cbrt",
        "ceil",
        "fma",
    ],
    *[
        "memcpy",
        "memmove",
        "memset",
        "bzero",
        "__bzero",
        "_GLOBAL_OFFSET_TABLE_",
        "_chkstk",
        "fltused",
    ],
}


CONSTANTS = (b"__real@", b"__xmm@", b"__ymm@")


def symbols_of(content):
    """Names in an object file that it defines for others, and those that it asks for."""
    if content[:4] == b"\x7fELF":
        (sections,) = struct.unpack_from("<Q", content, 0x28)
        size, number = struct.unpack_from("<HH", content, 0x3A)
        rows = [
            struct.unpack_from("<IIQQQQIIQQ", content, sections + i * size)
            for i in range(number)
        ]
        (table,) = [row for row in rows if row[1] == 2]
        names = rows[table[6]][4]
        found = []
        for at in range(table[4], table[4] + table[5], 24):
            name, info, _, section = struct.unpack_from("<IBBH", content, at)
            if info >> 4:
                found.append((names + name, section > 0))
        whole = content
    elif content[:2] == b"\x64\x86":
        at, number = struct.unpack_from("<II", content, 8)
        names = at + 18 * number
        found = []
        i = 0
        short = bytearray()
        while i < number:
            entry = at + 18 * i
            _, section, _, kind, more = struct.unpack_from("<IhHBB", content, entry + 8)
            zero, place = struct.unpack_from("<II", content, entry)
            if zero:
                place = len(content) - names + len(short)
                short += content[entry : entry + 8].rstrip(b"\0") + b"\0"
            if kind == 2 and not content[names + place :].startswith(
                CONSTANTS
            ):  # no constant
                found.append((names + place, section > 0))
            i += 1 + more
        whole = content + bytes(short)
    else:
        at = 32
        while struct.unpack_from("<I", content, at)[0] != 2:
            at += struct.unpack_from("<I", content, at + 4)[0]
        table, number, names = struct.unpack_from("<III", content, at + 8)
        found = []
        for i in range(number):
            name, kind, _, _ = struct.unpack_from("<IBBH", content, table + 16 * i)
            if kind & 1:
                found.append((names + name, kind & 0x0E != 0))
        whole = content
    texts = [
        (whole[place : whole.index(b"\0", place)].decode().removeprefix("_"), defined)
        for place, defined in found
    ]
    return [
        {name for name, defined in texts if defined is side} for side in (True, False)
    ]


@pytest.mark.parametrize("triple", TRIPLES)
def test_it_becomes_machine_code_of_each_system(triple):
    """The same LLVM code is taken on all; here only that of Linux can be run."""
    processor, begin = TRIPLES[triple]
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(triple).create_target_machine(
        processor, "", 3, "static", "jitdefault", jit=True
    )
    for name in load.SETS:
        _, offers, code = load._shipped(name)
        content = target.emit_object(load.parsed_for(code, target))
        assert content.startswith(begin)
        defined, asked = symbols_of(content)
        assert defined == {symbol.removeprefix("_") for _, _, symbol, _ in offers}, name
        assert asked <= OF_SYSTEM, asked - OF_SYSTEM


def test_shipped_code_is_refused_where_no_processor_is_known(monkeypatch):
    monkeypatch.setattr(llvm, "get_process_triple", lambda: "riscv64-unknown-linux-gnu")
    monkeypatch.setattr(load, "has_common_features", lambda: False)
    assert not any(map(load.is_shipped, load.SETS))
    monkeypatch.setattr(llvm, "get_process_triple", lambda: "arm64-apple-macosx15.0.0")
    assert all(map(load.is_shipped, load.SETS))
