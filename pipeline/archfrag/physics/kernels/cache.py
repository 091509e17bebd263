"""Folders of machine code: a private one for each state of the kernels' source.

The folder's name is a hash of the kernels' files and of the versions of what compiles them:
edited source never leaves old machine code in use, and all clones and environments of a machine
share it. archfrag uses such a folder only if nobody else can write to it or replace it.
"""

import ast
import contextlib
import functools
import hashlib
import os
import platform
import shutil
import time
from importlib.metadata import version
from pathlib import Path

from archfrag.system import is_own, kept_from_others, private_folder

HOME = Path(__file__).resolve().parents[2]
HOLDS_NO_KERNEL = (
    "registry.py",
    "auto.py",
    "__main__.py",
    "cache.py",
    "load.py",
)
KEPT = (
    30 * 86400.0
)  # time for which folders of other states of the source stay unused [s]


def kernel_platform() -> str:
    """Return the versions and the kind of machine that compiled kernels depend on."""
    versions = [f"{name}={version(name)};" for name in ("numba", "llvmlite", "numpy")]
    return (
        "".join(versions) + f"python={platform.python_version()};{platform.machine()};"
    )


def _sources() -> list[Path]:
    found = sorted((HOME / "physics").rglob("*.py"))
    return [path for path in found if path.name not in HOLDS_NO_KERNEL]


@functools.cache
def kernel_hash() -> str:
    """Return the hash of everything that compiled kernels depend on: 40 hexadecimal digits."""
    content = b"".join(path.name.encode() + path.read_bytes() for path in _sources())
    return hashlib.sha256(kernel_platform().encode() + content).hexdigest()[:40]


@functools.cache
def source_hash() -> str:
    """Return the hash of the kernels' source without comments, docstrings and layout."""
    return digest_of_syntax(tuple(_sources()))


@functools.cache
def digest_of_syntax(paths: tuple[Path, ...]) -> str:
    """Return the SHA-256 of what Python files of this package do, 64 hexadecimal digits.

    Comments, docstrings, layout and the messages of errors do not count, nor does the version of
    Python. It takes half a second, so it is kept beside the machine code of the kernels, in a file
    named by a hash of the files' bytes.
    """
    known = [
        each.relative_to(HOME).as_posix().encode() + each.read_bytes() for each in paths
    ]
    known += [Path(__file__).read_bytes(), platform.python_version().encode()]
    place = use_kernel_cache()
    kept = place and place / f"syntax-{hashlib.sha256(b''.join(known)).hexdigest()}"
    with contextlib.suppress(OSError, ValueError):
        text = kept.read_text("ascii") if kept else ""
        if len(text) == 64:
            return text
    digest = hashlib.sha256()
    for path in paths:
        digest.update(
            f"{path.relative_to(HOME).as_posix()} {text_of(path.read_bytes())}".encode()
        )
    with contextlib.suppress(OSError):
        if kept:
            kept.write_text(digest.hexdigest(), "ascii")
    return digest.hexdigest()


def text_of(source: bytes) -> str:
    """Return the syntax tree of a Python file as text, the same on every version of Python.

    Comments, docstrings, layout and the messages of errors are left out.
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            node.exc.args = []
            node.exc.keywords = []
        if isinstance(
            node, ast.Module | ast.ClassDef | ast.FunctionDef
        ) and ast.get_docstring(node, clean=False):
            del node.body[0]
        if isinstance(
            node, ast.JoinedStr
        ):  # some versions put empty texts between its parts
            node.values = [
                each for each in node.values if getattr(each, "value", None) != ""
            ]
    return _text(tree)


def _text(node: object) -> str:
    """Return a syntax tree as text.

    Empty fields are left out, since not every version of Python has them.
    """
    if isinstance(node, list):
        return f"[{','.join(map(_text, node))}]"
    if not isinstance(node, ast.AST):
        return ascii(node)  # what `repr` escapes depends on the version
    filled = (
        (name, each) for name, each in ast.iter_fields(node) if each not in (None, [])
    )
    return f"{type(node).__name__}({','.join(f'{name}={_text(each)}' for name, each in filled)})"


@functools.cache
def use_kernel_cache() -> Path | None:
    """Return the folder for machine code of the present kernels, made if needed.

    It is chosen once a process, in ``NUMBA_CACHE_DIR`` if that is set, else in the user's cache
    directory. None if that is not safe: each process then makes its machine code anew. Folders of
    other states of the source that nobody used for `KEPT` are removed.
    """
    from platformdirs import user_cache_path

    chosen = os.environ.get("NUMBA_CACHE_DIR")
    base = (
        Path(chosen).absolute() if chosen else user_cache_path("archfrag") / "kernels"
    )
    with contextlib.suppress(OSError):
        base = kept_from_others(base)
        folder = base / f"k-{kernel_hash()}"
        if not private_folder(folder):
            return None
        os.utime(folder)
        for other in base.glob("k-*"):
            if is_own(other) and other.lstat().st_mtime <= time.time() - KEPT:
                shutil.rmtree(other, ignore_errors=True)
        return folder
    return None
