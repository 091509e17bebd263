"""Where compiled kernels are kept: one folder for each state of the kernels' source.

Numba's disk cache looks at the file in which a kernel is defined, not at the helpers it calls
from other files, so that an edited helper would leave old machine code in use. The folder's
name is therefore a hash of all of `mechanics` and `methods` and of the versions of Python,
numba and llvmlite.
"""

import hashlib
import os
import platform
import shutil
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

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
    home = Path(__file__).parent
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
    """Point numba at the folder for the kernels as they are now.

    Called when `archfrag.mechanics` is imported, before any kernel is declared.

    Returns
    -------
    Path
        The folder; one under the system's temporary folder if the user's cache cannot be
        written.
    """
    from numba import config

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
    config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    return folder
