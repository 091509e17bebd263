"""Where compiled kernels are kept: one folder for each state of the kernels' source.

Numba's disk cache looks at the file in which a kernel is defined, not at the helpers it calls
from other files, so that an edited helper would leave old machine code in use. The folder's
name is therefore a hash of all of `mechanics` and `methods` and of the versions of Python,
numba and llvmlite. Inside it a kernel is found by the place of its file in the package, not on
the disk, so that every clone and environment of a machine uses the same compiled code.
"""

import hashlib
import os
import platform
import shutil
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

KERNEL_FOLDERS = ("mechanics", "methods")
HOLDS_NO_KERNEL = ("registry.py",)
KEPT = 8
KEPT_FOR_SURE = 30 * 86400.0


def kernel_hash() -> str:
    """Hash of everything that compiled kernels depend on.

    Returns
    -------
    str
        40 hexadecimal digits.

    Examples
    --------
    >>> from archfrag.kernel_cache import kernel_hash
    >>> len(kernel_hash())
    40
    """
    digest = hashlib.sha256()
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name}={version(name)};".encode())
    digest.update(f"python={platform.python_version()};{platform.machine()};".encode())
    home = Path(__file__).resolve().parent
    for folder in KERNEL_FOLDERS:
        for path in sorted((home / folder).glob("*.py")):
            if path.name in HOLDS_NO_KERNEL:
                continue
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:40]


def _base() -> Path:
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("archfrag") / "kernels"


def _forget_old(base: Path) -> None:
    folders = [p for p in base.iterdir() if p.is_dir() and p.name.startswith("k-")]
    folders.sort(key=lambda p: p.stat().st_mtime, reverse=True)
    recent = time.time() - KEPT_FOR_SURE
    for folder in folders[KEPT:]:
        if folder.stat().st_mtime > recent:
            continue
        shutil.rmtree(folder, ignore_errors=True)


def use_kernel_cache() -> Path:
    """Keep the compiled kernels of this package in the folder for the kernels as they are now.

    Called when `archfrag.mechanics` is imported, before any kernel is declared. Numba functions
    outside this package are cached where numba would put them anyway.

    Returns
    -------
    Path
        The folder; one under the system's temporary folder if the user's cache cannot be
        written.
    """
    from numba.core import caching

    base = _base()
    folder = base / f"k-{kernel_hash()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        _forget_old(base)
    except OSError:
        base = Path(tempfile.gettempdir()) / f"archfrag-{os.getuid()}"
        folder = base / folder.name
        folder.mkdir(parents=True, exist_ok=True)
    home = Path(__file__).resolve().parent

    class KernelLocator(caching.InTreeCacheLocator):
        """Finds a kernel of this package by its file's place in the package."""

        def __init__(self, py_func: Any, py_file: str) -> None:
            self._py_file = py_file
            self._lineno = py_func.__code__.co_firstlineno
            place = Path(py_file).resolve().parent.relative_to(home)
            self._cache_path = str(folder / place)

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            if not Path(py_file).resolve().is_relative_to(home):
                return None
            return super().from_function(py_func, py_file)

    caching.CacheImpl._locator_classes.insert(0, KernelLocator)
    return folder
