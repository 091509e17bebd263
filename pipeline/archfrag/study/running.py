"""A run of a study: one at a time in a folder, stopped by signals."""

import contextlib
import errno
import fcntl
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

from tqdm import tqdm

from archfrag.errors import OutputError
from archfrag.files import cannot_write
from archfrag.simulation.warmup import TICK, every
from archfrag.study.file.schema import StudyKeys

GRACE = 4.0  # after a signal, for the run to end by itself [s]
_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextlib.contextmanager
def stoppable() -> Iterator[Callable[[], None]]:
    """Let SIGTERM, SIGINT and SIGHUP raise `SystemExit` once; what follows the first is ignored.

    Its code is 128 and the number of the signal. Given is a function that raises it again, where
    an exception in a signal handler got lost. The process ends after `GRACE` also where code in C,
    such as a compiler, does not return.
    """
    came: list[int] = []
    ended = threading.Event()
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    reader, writer = os.pipe()
    os.set_blocking(writer, False)

    def check() -> None:
        if came:
            raise SystemExit(128 + came[0])

    def record_stop(number: int, frame: FrameType | None) -> None:
        for each in _SIGNALS:
            signal.signal(each, signal.SIG_IGN)
        came.append(number)
        check()

    def end_late() -> None:
        while content := os.read(reader, 1):
            if content[0] in _SIGNALS and not ended.wait(GRACE):
                os._exit(128 + content[0])
        os.close(reader)

    for number in _SIGNALS:
        if before[number] != signal.SIG_IGN:  # under nohup a hang-up does not matter
            signal.signal(number, record_stop)
    wakeup = signal.set_wakeup_fd(writer)
    threading.Thread(target=end_late, daemon=True).start()
    try:
        yield check
    except Exception:
        check()  # what became of it where code in C reports errors of its own
        raise
    finally:
        ended.set()
        signal.set_wakeup_fd(wakeup)
        os.close(writer)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def clock(what: str, say: Callable[[str], None], quiet: bool) -> Iterator[None]:
    """Say how long a block took; at a terminal show meanwhile how long it has taken."""
    started = time.perf_counter()
    form = f"archfrag: {what}: {{elapsed}}"
    hidden = quiet or not sys.stderr.isatty()
    with (
        tqdm(bar_format=form, leave=False, disable=hidden) as bar,
        every(TICK, bar.refresh),
    ):
        yield
    say(f"{what}: {time.perf_counter() - started:.1f} s")


@contextlib.contextmanager
def only_run(study: StudyKeys) -> Iterator[None]:
    """Hold the lock of a study's folder, which the system takes back whatever ends the process.

    OutputError if another run holds it.
    """
    path = study.work / "lock"
    with contextlib.ExitStack() as stack:
        try:
            # Nothing is written to it: it may be a hard link that somebody else made.
            lock = stack.enter_context(open(path, "ab"))
            os.register_at_fork(
                after_in_child=lock.close
            )  # a reader of records holds no lock
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            what = f"another run of study {study.id!r} is at work here"
            raise OutputError(
                f"{study.folder}: {what}; wait for it or stop it"
            ) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:  # of the file system
                raise cannot_write(path, error) from error
        yield
