"""Folders of compiled kernels: a private one for each state of the kernels' source.

The folder's name is a hash of `mechanics`, `methods` and the versions of Python, numba and
llvmlite: edited source never leaves old machine code in use, and all clones and environments of a
machine share the compiled code (`archfrag.mechanics.compile`). Its files run as machine code, so
archfrag uses it only if nobody else can write to it or replace it.
"""

import contextlib
import functools
import hashlib
import os
import platform
import shutil
import stat
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

KERNEL_FOLDERS = ("mechanics", "methods")
HOLDS_NO_KERNEL = ("registry.py", "auto.py", "front.py")
KEPT = 30 * 86400.0  # time for which folders of other states of the source stay unused [s]
# Names the temporary cache of this process to the processes that it starts.
INHERITED = "ARCHFRAG_KERNEL_CACHE"
_temporary: list[tempfile.TemporaryDirectory[str]] = []  # removed when this process ends


def kernel_platform() -> str:
    """Return the versions and the kind of machine that compiled kernels depend on."""
    versions = [f"{name}={version(name)};" for name in ("numba", "llvmlite", "numpy")]
    return "".join(versions) + f"python={platform.python_version()};{platform.machine()};"


def kernel_hash() -> str:
    """Hash of everything that compiled kernels depend on: 40 hexadecimal digits."""
    digest = hashlib.sha256(kernel_platform().encode())
    home = Path(__file__).resolve().parent
    for folder in KERNEL_FOLDERS:
        for path in sorted((home / folder).rglob("*.py")):
            if path.name not in HOLDS_NO_KERNEL:
                digest.update(path.name.encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:40]


@functools.cache
def use_kernel_cache() -> Path | None:
    """Choose and make the folder for the compiled kernels as they are now, once a process.

    It is in ``NUMBA_CACHE_DIR``, or else in the user's cache directory; if that is not safe, in a
    temporary folder for this process and those that it starts. None if there is no safe place:
    kernels are then compiled again in every process.
    """
    from platformdirs import user_cache_path

    chosen = os.environ.get(INHERITED) or os.environ.get("NUMBA_CACHE_DIR")
    usual = user_cache_path("archfrag") / "kernels"
    with contextlib.suppress(OSError):
        return _prepared(Path(chosen).absolute() if chosen else usual)
    with contextlib.suppress(OSError):
        base = tempfile.TemporaryDirectory(prefix="archfrag-", ignore_cleanup_errors=True)
        _temporary.append(base)
        folder = _prepared(Path(base.name))
        os.environ[INHERITED] = base.name
        return folder
    return None


def _prepared(base: Path) -> Path:
    """Private folder of the kernels in `base`, or `OSError` if there can be none."""
    base = _kept_from_others(base)
    folder = base / f"k-{kernel_hash()}"
    for place in (*reversed(folder.parents), folder):
        with contextlib.suppress(FileExistsError):
            place.mkdir(mode=0o700)
    state = os.lstat(folder)
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.getuid() or state.st_mode & 0o077:
        raise PermissionError(f"{folder} is not a private directory of our own")
    tempfile.TemporaryFile(dir=folder).close()
    os.utime(folder)
    for other in base.glob("k-*"):
        found = other.lstat()
        if found.st_uid == os.getuid() and found.st_mtime <= time.time() - KEPT:
            shutil.rmtree(other, ignore_errors=True)
    return folder


def _kept_from_others(path: Path) -> Path:
    """A path without symbolic links, if nobody else can replace it (else `PermissionError`).

    Only root and we may own its directories and links. Others may write to a directory above it
    if it has the sticky bit, as the temporary directory has. Members of a group that may write
    are trusted: if each user has a group of their own, this is the usual umask.
    """
    resolved = Path(os.path.realpath(path))
    for place in filter(os.path.lexists, (path, *path.parents, resolved, *resolved.parents)):
        state = os.lstat(place)
        open_to_all = state.st_mode & stat.S_IWOTH and not state.st_mode & stat.S_ISVTX
        if state.st_uid not in (0, os.getuid()) or (open_to_all and not place.is_symlink()):
            raise PermissionError(f"{place} can be written by others")
    return resolved
