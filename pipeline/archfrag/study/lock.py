"""One run at a time in a folder of results; the lock states which, and whether it was stopped."""

import contextlib
import errno
import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from archfrag.errors import OutputError
from archfrag.study.config import Study
from archfrag.study.files import cannot_write
from archfrag.study.tree import identity, is_alive

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


@contextlib.contextmanager
def only_run(study: Study) -> Iterator[Lock]:
    """Hold the lock of a study's folder; a run that is stopped leaves its name in it."""
    path = study.work / LOCK
    try:
        file = open(path, "a+", encoding="utf-8")  # noqa: SIM115
    except OSError as error:
        raise cannot_write(path, error) from error
    with file:
        granted, holder = _take(file), _read(file)
        if granted is False or _may_live(holder, path, known=granted is True):
            raise _at_work(study, holder)
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


def _may_live(holder: dict[str, Any], path: Path, known: bool) -> bool:
    """Whether who left a name in the lock may still be there; `known`: the system granted it."""
    if not holder or holder["stopped"]:
        return False
    if holder["host"] == socket.gethostname():
        return not known and is_alive(holder["pid"], holder["started"])
    # Some file systems keep locks to themselves: only the beat is seen from elsewhere.
    return time.time() - path.stat().st_mtime < _SILENT


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
    with contextlib.suppress(ValueError, KeyError, TypeError):
        holder = json.loads(file.read())
        known = {key: holder[key] for key in ("host", "pid", "started")}
        return {**known, "stopped": holder.get("stopped", False)}
    return {}


def _write(file: IO[str], holder: dict[str, Any]) -> None:
    file.seek(0)
    file.truncate()
    if holder:
        file.write(json.dumps(holder) + "\n")
    file.flush()


def _name(holder: dict[str, Any]) -> str:
    return f"process {holder['pid']} on {holder['host']}"


def _at_work(study: Study, holder: dict[str, Any]) -> OutputError:
    who = f" ({_name(holder)})" if holder else ""
    return OutputError(
        f"{study.folder}: another run of study {study.id!r} is at work here{who}; wait for it or "
        "stop it"
    )
