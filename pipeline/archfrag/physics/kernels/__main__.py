"""Make the sets of kernels of a study ready, or write the LLVM code that archfrag ships.

``python -m archfrag.physics.kernels ready [SET ...]``, or ``build [FOLDER]`` in its place.
"""

import contextlib
import hashlib
import json
import lzma
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from archfrag.physics.kernels.cache import source_hash, use_kernel_cache
from archfrag.physics.kernels.load import (
    PROCESSOR,
    SHIPPED,
    as_tuples,
    compiled_for,
    is_ready,
    make_ready,
    of_all,
)
from archfrag.system import end_with_input, start_python


def make_all_ready() -> None:
    """Make the machine code that every study needs; a second process makes the last missing set.

    If the kernels of a set cannot be compiled as its list says, a warning tells so, and they are
    compiled when they are called.
    """
    missing = [name for name in of_all() if not is_ready(name)]
    with (
        _second_process(missing[-1:]) if len(missing) > 1 else contextlib.nullcontext()
    ):
        for name in missing:
            try:
                make_ready(name)
            except Exception as error:  # numba's errors have many bases
                how = "if the kernels are right, run `python -m archfrag.physics.kernels build`"
                what = f"kernels of set {name} do not take what they took when it was built"
                warnings.warn(f"{what} ({type(error).__name__}); {how}", stacklevel=2)


@contextlib.contextmanager
def _second_process(names: Sequence[str]) -> Iterator[None]:
    """Let another process make the sets `names` while the context lasts.

    There is no such process on one core, or without a cache. It ends with the context, and with
    this process.
    """
    process = None
    if (os.cpu_count() or 1) > 1 and use_kernel_cache() is not None:
        with contextlib.suppress(OSError):
            process = start_python("-m", "archfrag.physics.kernels", "ready", *names)
    try:
        yield
    finally:
        if process is not None:
            process.kill()
            process.communicate()


def build(folder: Path = SHIPPED) -> None:
    """Write the LLVM code of all sets into `folder`, with the hash of the kernels' source.

    The sets hold the kernels that studies call, as `archfrag.simulation.warmup` lists them. The
    code is the same whatever processor builds it.
    """
    os.environ |= {"NUMBA_CPU_NAME": PROCESSOR, "NUMBA_CPU_FEATURES": ""}
    from archfrag.physics.kernels.compile import compile_set

    used = subprocess.check_output(
        [sys.executable, "-P", "-m", "archfrag.simulation.warmup"]
    )
    folder.mkdir(exist_ok=True)
    for name, entries in json.loads(used).items():
        called = ((kernel, as_tuples(key)) for kernel, key in entries)
        offers, code = compile_set(called, compiled_for())
        header = json.dumps(
            [source_hash(), offers, hashlib.sha256(code).hexdigest()]
        ).encode()
        (folder / f"{name}.xz").write_bytes(
            lzma.compress(header + b"\n" + code, preset=9)
        )


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["build", *places]:
            build(*map(Path, places))
        case ["ready"]:
            make_all_ready()
        case ["ready", *names]:
            end_with_input()
            for each in names:
                make_ready(each)
        case _:
            sys.exit(__doc__)
