"""Machine code of kernels: from the cache, from LLVM code that comes with archfrag, or compiled.

Kernels that are called from Python are compiled in sets, each one module of LLVM: `SETS` are those
of a study, shipped as LLVM code that is optimised for `PROCESSOR`. Any other kernel that is called
is a set of its own. A file of the cache has what a set offers, then machine code; it appears whole
or not at all, and one that is damaged counts as missing.
"""

import contextlib
import functools
import hashlib
import json
import lzma
import os
import threading
import uuid
import warnings
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from archfrag.physics.kernels.cache import HOME, source_hash, use_kernel_cache
from archfrag.system import replace

SETS = ("rest", "steps", "wide", "events", "faces", "bridges")
SHIPPED = Path(__file__).parent / "shipped"
# All processors with these features, those of the last ten years, give the same bits: they have
# fused multiply-adds.
PROCESSOR = "x86-64-v3"
NEEDED = ("avx2", "fma", "bmi2")
# Processors with AVX-512 on which eight runs at a time are faster than four, by measurement: 0.83
# of the time on znver5; on znver4, which halves its instructions, 1.05.
FASTER_BY_EIGHT = ("znver5",)
ARM = ("arm64-", "aarch64-")

called: list[
    tuple[str, Any]
] = []  # kernels that were called from Python so far, and how
_lock = threading.RLock()
_found: dict[tuple[str, Any], tuple[int, Any]] = {}
_engines: list[Any] = []  # hold the machine code


_features = functools.cache(llvm.get_host_cpu_features)
_processor = functools.cache(llvm.get_host_cpu_name)


def has_common_features() -> bool:
    """Return whether this processor has what `PROCESSOR` has."""
    return all(map(_features().get, NEEDED))


def takes_eight() -> bool:
    """Return whether eight runs go side by side here, not four.

    The environment variable ARCHFRAG_LANES, 4 or 8, says so in place of the processor.
    """
    given = os.environ.get("ARCHFRAG_LANES", "")
    return given == "8" if given else _processor() in FASTER_BY_EIGHT


def of_all() -> tuple[str, ...]:
    """Return the sets of kernels that every study uses, on this processor."""
    return "rest", "wide" if takes_eight() else "steps", "events"


def can_use_shipped() -> bool:
    """Return whether LLVM can make machine code for this machine of the code that is shipped.

    It has no instruction of any processor, but needs fused multiply-adds, which all processors of
    64 bits by ARM have.
    """
    return has_common_features() or llvm.get_process_triple().startswith(ARM)


def compiled_for():
    """Return LLVM's description of `PROCESSOR`, so that all machines like it give the same bits.

    It is of this machine's processor if that has not all features of `PROCESSOR`.
    """
    return machine(PROCESSOR) if has_common_features() else machine()


@functools.cache
def machine(processor: str = ""):
    """Return LLVM's description of `processor`, or of this machine's processor if it is empty."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = "" if processor else llvm.get_host_cpu_features().flatten()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=processor or llvm.get_host_cpu_name(),
        features=features,
        opt=3,
        reloc="static",
        codemodel="jitdefault",
        jit=True,
    )


def load(kernel, key) -> tuple[int, Any]:
    """Return the address of a kernel's machine code, and the description of its result.

    `key` has the descriptions of its arguments.
    """
    entry = kernel.name, key
    with _lock:
        called.append(entry)
        for name in SETS if entry not in _found else ():
            if is_ready(name) or (
                is_shipped(name) and entry in _kernels(_shipped(name)[1])
            ):
                _take(make_ready(name), entry)
        if entry not in _found:
            name = _name_of(entry, Path(kernel.py_func.__code__.co_filename))
            _take(_made(name, [entry]), entry)
        return _found[entry]


def is_shipped(name: str) -> bool:
    """Return whether shipped LLVM code of a set fits this source and this processor."""
    return can_use_shipped() and _shipped(name)[0] == source_hash()


def is_ready(name: str) -> bool:
    """Return whether the cache has the machine code of a set."""
    path = _path(name)
    return path is not None and path.is_file()


def make_ready(name: str) -> tuple[Any, bytes]:
    """Return the offers of a set of `SETS`, and its machine code.

    If the cache does not have the code, it is made and kept.
    """
    return _made(name, _kernels(_shipped(name)[1]))


def _kernels(offers) -> list[tuple[str, Any]]:
    return [(kernel, as_tuples(key)) for kernel, key, *_ in offers]


def as_tuples(given):
    """Return what was read from JSON with tuples in place of lists, as descriptions have them."""
    return tuple(map(as_tuples, given)) if isinstance(given, list) else given


@functools.cache
def _shipped(name: str) -> tuple[str, Any, bytes]:
    """Return source hash, offers and code of a shipped set; all are empty if there is none.

    They are empty with a warning if the file is damaged.
    """
    try:
        content = lzma.decompress((SHIPPED / f"{name}.xz").read_bytes())
        header, _, code = content.partition(b"\n")
        source, offers, digest = json.loads(header)
        if hashlib.sha256(code).hexdigest() == digest:
            return source, offers, code
    except OSError:
        return "", [], b""
    except (lzma.LZMAError, TypeError, ValueError):
        pass
    _warn_unreadable(name)
    return "", [], b""


def _parsed(name: str) -> tuple[Any, Any] | None:
    """Return the offers and LLVM's module of a shipped set.

    None if there is none, or LLVM cannot read it.
    """
    if name not in SETS or not is_shipped(name):
        return None
    _, offers, code = _shipped(name)
    try:
        module = parsed_for(code, machine())
        for _, _, symbol, _ in offers:
            module.get_function(symbol)
    except (RuntimeError, NameError):
        _warn_unreadable(name)
        return None
    return offers, module


def parsed_for(code: bytes, target):
    """Return LLVM's module of shipped code, for the system of LLVM's description of a machine."""
    module = llvm.parse_bitcode(code)
    module.triple = target.triple
    module.data_layout = str(target.target_data)
    return module


def _warn_unreadable(name: str) -> None:
    """Warn that the shipped code of a set cannot be used, so that its kernels are compiled."""
    what = f"{SHIPPED / name}.xz is damaged, or needs a newer llvmlite than {llvmlite.__version__}"
    how = "kernels are compiled in its place, which takes about a minute; install archfrag anew"
    warnings.warn(f"{what}; {how}", RuntimeWarning, stacklevel=2)


def _made(name: str, entries) -> tuple[Any, bytes]:
    path = _path(name)
    content = None if path is None else _read(path)
    if content is None:
        target = machine()
        offers, module = _parsed(name) or (None, None)
        if module is None:
            from archfrag.physics.kernels.compile import compile_set

            offers, code = compile_set(entries, compiled_for())
            module = llvm.parse_bitcode(code)
        content = offers, target.emit_object(module)
        if path is not None:
            _write(path, content)
    return content


def _take(content: tuple[Any, bytes], entry: tuple[str, Any]) -> None:
    """Load machine code, and note the addresses of all its kernels.

    Nothing is loaded if the kernel of `entry` is not among them.
    """
    offers, code = content
    if entry not in _kernels(offers):
        return
    machine()  # starts LLVM; the engine keeps a description of its own
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine.__wrapped__())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    for kernel, key, symbol, returned in offers:
        address = engine.get_function_address(symbol)
        _found.setdefault((kernel, as_tuples(key)), (address, as_tuples(returned)))


def _name_of(entry: tuple[str, Any], place: Path) -> str:
    """Return the name of the set that holds one kernel only.

    `place` is the kernel's file. If that is outside archfrag, the name has a digest of its folder.
    """
    text = repr(entry)
    if not place.is_relative_to(HOME):
        content = b"".join(
            path.read_bytes() for path in sorted(place.parent.glob("*.py"))
        )
        text += hashlib.sha256(content).hexdigest()
    return (
        f"{entry[0].replace(':', '.')}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    )


def _path(name: str) -> Path | None:
    """Return the file of a set in the cache; None if there is no cache.

    Machine code is for a system and a kind of processor, and for what such a processor may use: a
    virtual machine may withhold some of it.
    """
    folder = use_kernel_cache()
    features = llvm.get_host_cpu_features().flatten()
    kind = hashlib.sha256(
        f"{llvm.get_process_triple()} {features}".encode()
    ).hexdigest()[:8]
    return folder and folder / f"{name}-{llvm.get_host_cpu_name()}-{kind}.kernels"


def _read(path: Path) -> tuple[Any, bytes] | None:
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest = content[:32]
    content = content[32:]
    if hashlib.sha256(content).digest() != digest:
        return None
    offers, _, code = content.partition(b"\n")
    return json.loads(offers), code


def _write(path: Path, content: tuple[Any, bytes]) -> None:
    written = json.dumps(content[0]).encode() + b"\n" + content[1]
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}.tmp")
    try:
        temporary.write_bytes(hashlib.sha256(written).digest() + written)
        replace(temporary, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        message = f"compiled kernels cannot be kept in {path.parent}: {error.strerror}"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
