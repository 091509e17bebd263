"""Where compiled kernels are kept: one private folder for each state of the kernels' source.

The folder's name is a hash of all of `mechanics` and `methods` and of the versions of Python,
numba and llvmlite, so that an edited helper never leaves old machine code in use, and every clone
and environment of a machine uses the same compiled code (`archfrag.mechanics.compile`).

What is loaded from the folder runs as machine code. It is therefore used only if nobody else can
write to it: it is ours, private, and no directory above it lets others replace it. Where the
user's cache does not fulfil that, or cannot be written, a private folder in the system's
temporary directory takes its place, and where that is not safe either, nothing is kept.
"""

import atexit
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
KEPT = 8
KEPT_FOR_SURE = 30 * 86400.0
# Names the temporary cache of this process to the processes that it starts.
INHERITED = "ARCHFRAG_KERNEL_CACHE"


def kernel_hash() -> str:
    """Hash of everything that compiled kernels depend on: 40 hexadecimal digits.

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
        for path in sorted((home / folder).rglob("*.py")):
            if path.name in HOLDS_NO_KERNEL:
                continue
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:40]


@functools.cache
def use_kernel_cache() -> Path | None:
    """Choose and make the folder for the compiled kernels as they are now, once a process.

    The first of these that can be made, is ours and can be written by nobody else:
    ``NUMBA_CACHE_DIR`` if that is set, else the user's cache directory; ``archfrag-UID`` in the
    temporary directory; a new temporary folder, which is removed when the process ends.

    Returns
    -------
    Path or None
        None if there is no safe place: kernels are then compiled again in every process.
    """
    name = f"k-{kernel_hash()}"
    places = [(_base(), False)]
    with contextlib.suppress(OSError):
        places.append((Path(tempfile.gettempdir()) / f"archfrag-{os.getuid()}", True))
    if INHERITED in os.environ:
        places.insert(0, (Path(os.environ[INHERITED]), True))
    for base, ours in places:
        with contextlib.suppress(OSError):
            return _prepared(base, name, ours)
    with contextlib.suppress(OSError):
        base = Path(tempfile.mkdtemp(prefix="archfrag-"))
        atexit.register(_remove, base, os.getpid())
        found = _prepared(base, name, True)
        os.environ[INHERITED] = str(base)
        return found
    return None


def _base() -> Path:
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen).absolute()
    from platformdirs import user_cache_path

    return user_cache_path("archfrag") / "kernels"


def _prepared(base: Path, name: str, ours: bool) -> Path:
    """Folder `name` in `base`, private; `ours` if `base` is to be too; `OSError` if it cannot."""
    if ours:
        _kept_from_others(base.parent)
        _make_private(base)
    base = _kept_from_others(base)
    _make_folders(base)
    _make_private(base / name)
    tempfile.TemporaryFile(dir=base / name).close()
    os.utime(base / name)
    _forget_old(base)
    return base / name


def _kept_from_others(path: Path) -> Path:
    """A path without symbolic links, if nobody else can replace it (else `PermissionError`).

    Only root and we may own its directories and links. Others may write to a directory above it
    if it has the sticky bit, as the temporary directory has. Members of a group that may
    write are trusted: where each user has a group of their own, this is the usual umask.
    """
    resolved = Path(os.path.realpath(path))
    for place in (path, *path.parents, resolved, *resolved.parents):
        try:
            found = os.lstat(place)
        except FileNotFoundError:
            continue
        if found.st_uid not in (0, os.getuid()):
            raise PermissionError(f"{place} belongs to another user")
        if stat.S_ISLNK(found.st_mode):
            continue
        if found.st_mode & stat.S_IWOTH and not found.st_mode & stat.S_ISVTX:
            raise PermissionError(f"{place} can be written by every user")
    return resolved


def _make_folders(path: Path) -> None:
    """Make a folder and what is missing above it, private whatever the umask."""
    for place in (*reversed(path.parents), path):
        with contextlib.suppress(FileExistsError):
            place.mkdir(mode=0o700)


def _make_private(folder: Path) -> None:
    """Make a folder that only we can enter; one that exists has to be ours with all in it."""
    _make_folders(folder)
    found = os.lstat(folder)
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
        raise PermissionError(f"{folder} is not a directory of our own")
    if not found.st_mode & 0o077:
        return
    # Others had access: keep them off first, then see that they left nothing.
    folder.chmod(0o700)
    for place, folders, files in os.walk(folder):
        for entry in (*folders, *files):
            inside = os.lstat(os.path.join(place, entry))
            if inside.st_uid != os.getuid() or stat.S_ISLNK(inside.st_mode):
                raise PermissionError(f"{folder} holds what is not ours: {entry}")


def _forget_old(base: Path) -> None:
    folders = [p for p in base.glob("k-*") if p.is_dir() and p.lstat().st_uid == os.getuid()]
    folders.sort(key=lambda p: p.stat().st_mtime, reverse=True)
    recent = time.time() - KEPT_FOR_SURE
    for folder in folders[KEPT:]:
        if folder.stat().st_mtime <= recent:
            shutil.rmtree(folder, ignore_errors=True)


def _remove(folder: Path, pid: int) -> None:
    if os.getpid() == pid:
        shutil.rmtree(folder, ignore_errors=True)
