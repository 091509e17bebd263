"""The processes of a run: one at a time in a folder, ended together, none outliving its run."""

import contextlib
import ctypes
import errno
import fcntl
import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING, Any

import psutil

from archfrag.errors import OutputError
from archfrag.files import cannot_write

if TYPE_CHECKING:
    from archfrag.study.config import Study

INSIDE = "ARCHFRAG_INSIDE_RUN"  # how a step in a run reports: in full or quiet
RUN = "ARCHFRAG_RUN"  # the process of the run, as `identity` gives it, in JSON
CACHE_HOME = "ARCHFRAG_CACHE_HOME"  # XDG_CACHE_HOME as it is outside Snakemake
_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_PATIENCE = 2.0  # between asking processes to end and ending them [s]
_AT_MOST = 4.5  # [s]
_PR_SET_PDEATHSIG = 1


class Stopped(BaseException):
    """The run was asked to stop by a signal."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(f"stopped by {signal.Signals(number).name}")


class Stop:
    """Whether a signal came; raised again where an exception in a signal handler got lost."""

    def __init__(self) -> None:
        self.number: int | None = None
        self._held = False

    def check(self) -> None:
        """Raise `Stopped` if a signal came, and is not held back."""
        if self.number is not None and not self._held:
            raise Stopped(self.number)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Hold signals back while a process is made: it must be known to be ended."""
        self._held = True
        try:
            yield
        finally:
            self._held = False


@contextlib.contextmanager
def stoppable() -> Iterator[Stop]:
    """Let SIGTERM, SIGINT and SIGHUP raise `Stopped` once; what follows the first is ignored."""
    stop = Stop()
    before = {number: signal.getsignal(number) for number in _SIGNALS}

    def note(number: int, frame: FrameType | None) -> None:
        for each in _SIGNALS:
            signal.signal(each, signal.SIG_IGN)
        stop.number = number
        stop.check()

    for number in _SIGNALS:
        if before[number] != signal.SIG_IGN:  # under nohup a hang-up does not matter
            signal.signal(number, note)
    try:
        yield stop
    except Exception:
        stop.check()  # what became of it where code in C reports errors of its own
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def identity() -> dict[str, object]:
    """This process, so that another can find out whether it is still there."""
    return {
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "started": psutil.Process().create_time(),
    }


def is_alive(pid: int, started: float) -> bool:
    """Whether a process of this host is still the one that was started then [s since 1970]."""
    try:
        process = psutil.Process(pid)
        # The time of start follows from the time of boot, which is known to a second.
        same = abs(process.create_time() - started) < 2.0
        return same and process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False


def start(command: list[str], **options: object) -> subprocess.Popen:
    """Start a process in a session of its own, that is killed if this process is."""

    parent, libc = os.getpid(), ctypes.CDLL(None)

    def die_with_parent() -> None:
        if sys.platform == "linux":
            libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != parent:
                os._exit(128 + signal.SIGKILL)

    return subprocess.Popen(  # type: ignore[call-overload,no-any-return]
        command, start_new_session=True, preexec_fn=die_with_parent, **options
    )


def end(leader: subprocess.Popen) -> None:
    """End a process that `start` started with all that it started: first asked, then killed.

    The leader gets SIGINT, at which Snakemake cancels what it has handed to a cluster.
    """
    started = time.monotonic()
    for member in _session(leader.pid):
        _send(member, signal.SIGINT if member == leader.pid else signal.SIGTERM)
    while leader.poll() is None or _session(leader.pid):
        elapsed = time.monotonic() - started
        if elapsed > _AT_MOST:
            return
        if elapsed > _PATIENCE:
            for member in _session(leader.pid):
                _send(member, signal.SIGKILL)
        time.sleep(0.05)


def _send(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def _session(leader: int) -> list[int]:
    """Living processes of a session; those whose parent is gone belong to it too."""
    members = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                members.append(process.pid)
    return members


def follow_run() -> None:
    """End this process and its children when the run on this host that it is a step of is gone."""
    run = json.loads(os.environ.get(RUN, "{}"))
    if run.get("host") != socket.gethostname():
        return

    def watch() -> None:
        while is_alive(run["pid"], run["started"]):
            time.sleep(0.5)
        for child in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):
                child.kill()
        os._exit(128 + signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


def leave_snakemakes_cache() -> None:
    """Give the steps of a run the user's cache again; called when Snakemake has its own."""
    if CACHE_HOME in os.environ:
        before = os.environ.pop(CACHE_HOME)
        if before:
            os.environ["XDG_CACHE_HOME"] = before
        else:
            os.environ.pop("XDG_CACHE_HOME", None)


LOCK = "lock"
BEAT = 10.0  # how often a run touches its lock [s]
_SILENT = 6 * BEAT  # after which a run on another host counts as gone [s]
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@dataclass
class Lock:
    """The lock of a folder of results, held."""

    path: Path
    stopped: str  # who held it last, if that run was stopped in the middle; else empty
    left: bool = False  # whether an error leaves the lock to the run that is to go on
    _beaten: float = 0.0

    def beat(self) -> None:
        """Show that this run is still there, to hosts that cannot see its process."""
        if time.monotonic() - self._beaten > BEAT:
            self._beaten = time.monotonic()
            with contextlib.suppress(OSError):
                os.utime(self.path)

    def refuse_stopped(self, folder: Path, typed: str) -> None:
        """See that the run before was not stopped in the middle; `typed` was its command."""
        if self.stopped:
            self.left = True
            who = f"an earlier run ({self.stopped}) was stopped in the middle"
            raise OutputError(f"{folder}: {who}; type `{typed} --resume` to go on")


@contextlib.contextmanager
def only_run(study: "Study") -> Iterator[Lock]:
    """Hold the lock of a study's folder; a run that is stopped leaves its name in it."""
    path = study.work / LOCK
    try:
        file = open(path, "r+", encoding="utf-8", errors="replace", opener=_own)  # noqa: SIM115
    except OSError as error:
        raise cannot_write(path, error) from error
    with file:
        granted, holder = _take(file), _read(file)
        if granted is False or _may_live(holder, path, known=granted is True):
            who = f" ({_name(holder)})" if holder else ""
            what = f"another run of study {study.id!r} is at work here{who}"
            advice = "wait for it or stop it"
            if granted is not False:  # the system knows of none
                advice += f", or remove {path} if it is gone"
            raise OutputError(f"{study.folder}: {what}; {advice}")
        lock = Lock(path, _name(holder) if holder else "")
        _write(file, identity())
        try:
            yield lock
        except Exception:
            _write(file, {**holder, "stopped": True} if lock.left else {})
            raise
        except BaseException:
            _write(file, {**identity(), "stopped": True})
            raise
        _write(file, {})


def _own(path: str, flags: int) -> int:
    """Open the lock, which is written in its place: through no link, which may be anywhere."""
    file = os.open(path, flags | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    found = os.fstat(file)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
        os.close(file)
        raise OSError(errno.EEXIST, "it is a link or no regular file; remove it")
    return file


def _may_live(holder: dict[str, Any], path: Path, known: bool) -> bool:
    """Whether who left a name in the lock may still be there; `known`: the system granted it."""
    if not holder or holder["stopped"]:
        return False
    if holder["host"] == socket.gethostname():
        return not known and is_alive(holder["pid"], holder["started"])
    # Some file systems keep locks to themselves: only the beat is seen from elsewhere.
    # A time to come is of a clock that is wrong: no run has written it just now.
    return abs(time.time() - path.stat().st_mtime) < _SILENT


def _take(file: IO[str]) -> bool | None:
    """Whether the system gives this process the lock; None if it has no locks here."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return None
        raise
    return True


def _read(file: IO[str]) -> dict[str, Any]:
    file.seek(0)
    with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError, OverflowError):
        holder = json.loads(file.read(500))  # too short for what JSON cannot bear
        host, pid, started = str(holder["host"]), int(holder["pid"]), float(holder["started"])
        stopped = bool(holder.get("stopped", False))
        if pid > 0:
            return {"host": host[:100], "pid": pid, "started": started, "stopped": stopped}
    return {}


def _write(file: IO[str], holder: dict[str, Any]) -> None:
    file.seek(0)
    file.truncate()
    if holder:
        file.write(json.dumps(holder) + "\n")
    file.flush()


def _name(holder: dict[str, Any]) -> str:
    return f"process {holder['pid']} on {holder['host']}"
