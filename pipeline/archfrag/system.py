"""What differs by operating system. No other module of archfrag asks which system it runs on.

Where a system lacks something (owners of files, pipes that do not block), its part is left out.
"""

import contextlib
import ctypes
import errno
import gc
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO


class Deferred:
    """A module that is imported when one of its names is first used, by whatever thread."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._module), name)


filelock = Deferred("filelock")
psutil = Deferred("psutil")

# Signals that ask a process to end; not every system has all.
STOPPING = tuple(
    getattr(signal, name)
    for name in ("SIGTERM", "SIGINT", "SIGHUP", "SIGBREAK")
    if hasattr(signal, name)
)
# Without these a pipe is waited for, a link is followed, or line ends of bytes are changed.
_PLAIN = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_HAS_OWNERS = hasattr(os, "getuid")
WAITED = 2.0  # for another program to close a file that is to be replaced [s]
GRACE = 4.0  # after a signal, for the process to end by itself [s]
TRIED = 0.05  # between two attempts to replace a file [s]
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # of a file system
# Names that Windows keeps for devices, whatever their ending.
DEVICES = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {
    f"{name}{number}" for name in ("com", "lpt") for number in range(1, 10)
}


def open_to_read(path: str | Path) -> BinaryIO:
    """Open a file to read its bytes; a pipe or device is not waited for."""
    return open(os.open(path, os.O_RDONLY | _PLAIN), "rb")


def open_to_append(path: str | Path) -> BinaryIO:
    """Open a file to append bytes to it; OSError if it is a link."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | _PLAIN | _NO_LINK
    return open(os.open(path, flags, 0o666), "ab")


def replace(source: Path, target: Path) -> None:
    """Rename `source` to `target`, which it replaces.

    Where a system refuses this while another program has `target` open, it is tried for `WAITED`
    seconds.
    """
    until = time.monotonic() + WAITED
    while True:
        try:
            return os.replace(source, target)
        except PermissionError:
            if not _is_waited_for(target) or time.monotonic() > until:
                raise
            time.sleep(TRIED)


def _is_waited_for(target: Path) -> bool:
    """Return whether a file that cannot be replaced now may be replaced soon."""
    return target.is_file() and os.access(target.parent, os.W_OK)


def is_alive(process: int) -> bool:
    """Return whether this computer runs a process of this number."""
    return psutil.pid_exists(process)


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def give_back_memory() -> None:
    """Give the system the memory that nothing needs: of a million runs half a gigabyte.

    Circles of objects keep some; what is freed, the C library of Linux keeps. It takes 0.1 s.
    """
    gc.collect()
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


@contextlib.contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold the lock at `path` during the block, which gets False if another process holds it.

    The system releases it whatever ends the process. On a file system without locks it is not
    held, or a file takes its place. OSError if the file cannot be opened.
    """
    with contextlib.suppress(FileNotFoundError):
        # One with two names is a file of somebody else too; a lock may empty it.
        if path.lstat().st_nlink > 1:
            path.unlink()
    lock = filelock.FileLock(path, blocking=False)
    ours = True
    try:
        lock.acquire()
    except filelock.Timeout:
        ours = False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    try:
        yield ours
    finally:
        lock.release()


@contextlib.contextmanager
def every(seconds: float, call: Callable[[], object]) -> Iterator[None]:
    """Call a function every so many seconds, from another thread, while a ``with`` block lasts."""
    ended = threading.Event()

    def tick() -> None:
        while not ended.wait(seconds):
            call()

    ticker = threading.Thread(target=tick, daemon=True)
    ticker.start()
    try:
        yield
    finally:
        ended.set()
        ticker.join()


def start_python(
    *arguments: str, stdout: int = subprocess.DEVNULL
) -> "subprocess.Popen[bytes]":
    """Start another process of this Python, with the modules of this one.

    `arguments` are those of the interpreter. Its standard input ends with this process: see
    `end_with_input`. What it prints goes nowhere, unless `stdout` is a pipe.
    """
    places = [str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH")]
    return subprocess.Popen(
        [sys.executable, "-P", "-W", "ignore", *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))},
        stdin=subprocess.PIPE,
        stdout=stdout,
        stderr=subprocess.DEVNULL,
    )


def end_with_input() -> None:
    """End this process as soon as its standard input ends. A thread waits for this."""

    def wait() -> None:
        sys.stdin.buffer.read()
        os._exit(0)

    threading.Thread(target=wait, daemon=True).start()


@contextlib.contextmanager
def stoppable() -> Iterator[Callable[[], None]]:
    """Make the signals `STOPPING` raise `SystemExit` in the block, once; ignore later ones.

    The exit code is 128 plus the number of the signal. The block gets a function that raises the
    exit again, since an exception in a signal handler may get lost. If code in C, such as a
    compiler, does not return, the process ends `GRACE` seconds after the signal.
    """
    came: list[int] = []
    ended = threading.Event()
    before = {number: signal.getsignal(number) for number in STOPPING}
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def check() -> None:
        if came:
            raise SystemExit(128 + came[0])

    def record_stop(number: int, frame: FrameType | None) -> None:
        for each in STOPPING:
            signal.signal(each, signal.SIG_IGN)
        came.append(number)
        check()

    def end_late() -> None:
        with reader:
            while content := reader.recv(1):
                if content[0] in STOPPING and not ended.wait(GRACE):
                    os._exit(128 + content[0])

    for number in STOPPING:
        if before[number] != signal.SIG_IGN:  # under nohup a hang-up does not matter
            signal.signal(number, record_stop)
    wakeup = signal.set_wakeup_fd(writer.fileno())
    threading.Thread(target=end_late, daemon=True).start()
    try:
        yield check
    except Exception:
        check()  # code in C may have made another error of the exit
        raise
    finally:
        ended.set()
        signal.set_wakeup_fd(wakeup)
        writer.close()
        for number, handler in before.items():
            signal.signal(number, handler)


def private_folder(folder: Path) -> bool:
    """Make a folder that only this user may open; return whether it is one.

    On a system without owners of files, the folders of users are kept from others by the system.
    """
    for place in (*reversed(folder.parents), folder):
        with contextlib.suppress(FileExistsError):
            place.mkdir(mode=0o700)
    tempfile.TemporaryFile(dir=folder).close()
    state = os.lstat(folder)
    return stat.S_ISDIR(state.st_mode) and (
        not _HAS_OWNERS or (is_own(folder) and not state.st_mode & 0o077)
    )


def is_own(path: Path) -> bool:
    """Return whether a file or folder is this user's."""
    return not _HAS_OWNERS or os.lstat(path).st_uid == os.getuid()


def kept_from_others(path: Path) -> Path:
    """Return `path` without symbolic links; raise `PermissionError` if others can replace it.

    Only root and we may own its directories and links. Others may write to a directory above it if
    it has the sticky bit, as the temporary directory has. Members of a group that may write are
    trusted: if each user has a group of their own, this is the usual umask.
    """
    resolved = Path(os.path.realpath(path))
    places = (path, *path.parents, resolved, *resolved.parents)
    for place in filter(os.path.lexists, places if _HAS_OWNERS else ()):
        state = os.lstat(place)
        open_to_all = state.st_mode & stat.S_IWOTH and not state.st_mode & stat.S_ISVTX
        if state.st_uid not in (0, os.getuid()) or (
            open_to_all and not place.is_symlink()
        ):
            raise PermissionError(f"{place} can be written by others")
    return resolved
