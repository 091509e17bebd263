"""Reading files in a process of their own, which a damaged or hostile file may end.

obspy reads miniSEED, GSE and GCF in C, and a damaged file can crash that code, run for ever or
ask for any amount of memory. One process for all files of a command takes them, within limits of
computing time and memory; when a file ends it, the next file gets a new one. It is an interpreter
of its own, not a copy of this one: scripts need no ``__main__`` guard, and threads do not matter.
It ends when this process does, however that happens, because its input closes; at the latest
when the file that it reads is done.

Requests and answers are lines of JSON, followed by samples as float64: what comes from that
process is never executed here.
"""

import atexit
import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import WorkerError
from archfrag.motions.formats.waveform import IN_C, Content, Unreadable, read_as, recognise

if TYPE_CHECKING:
    from obspy import Trace

COMPUTING_TIME = 60.0  # [s] of processor time for one file
MEMORY = 5 * 2**28  # [bytes] of address space, a quarter of it libraries
_START = (
    "import sys; sys.path[:] = sys.argv[1:]; from archfrag.motions.isolated import serve; serve()"
)
_NAMES = ("network", "station", "location", "channel", "_format")


class Reader:
    """A process that reads files within processor time [s] and memory [bytes], started at need."""

    def __init__(self, computing_time: float = COMPUTING_TIME, memory: int = MEMORY) -> None:
        self.computing_time = computing_time
        self.memory = memory
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        atexit.register(self.stop)
        os.register_at_fork(after_in_child=self._forget)

    def read(self, path: str, formats: tuple[str, ...]) -> Content | None:
        """Read a file in the first of the formats that it is in, or in the only one named."""
        with self._lock:
            try:
                name, answer = self._ask(path, formats)
            except BaseException:
                self.stop()  # what the process would answer next belongs to this file
                raise
            if name is None:
                return None
            if "error" in answer:
                if name in IN_C:
                    self.stop()  # a damaged file may have left its memory in any state
                raise Unreadable(answer["error"])
        traces, announced, held = (answer[key] for key in ("traces", "announced", "held"))
        return Content(name, traces, announced, held, tuple(answer["messages"]))

    @property
    def pid(self) -> int | None:
        """Number of the process while it runs."""
        return self._process.pid if self._process and self._process.poll() is None else None

    def _ask(self, path: str, formats: tuple[str, ...]) -> tuple[str | None, dict[str, Any]]:
        process, name = self._started(), None
        request = {"path": os.path.abspath(path), "name": path, "formats": formats}
        try:
            _send(process.stdin, request | {"seconds": self.computing_time})
            name = _receive(process.stdout)["format"]
            answer = {} if name is None else _receive(process.stdout)
            headers = answer.get("traces", [])
            return name, answer | {"traces": [_take_trace(process.stdout, h) for h in headers]}
        except (EOFError, BrokenPipeError, ValueError):
            task = f"reading it as {name}" if name else "recognising its format"
            raise Unreadable(f"{path}: {task} {self._ending(process)}") from None

    def _started(self) -> "subprocess.Popen[bytes]":
        if self._process is not None and self.pid is not None:
            return self._process
        self.stop()
        command = [sys.executable, "-c", _START, *sys.path]
        # Threads of numerical libraries would reserve much of the address space allowed.
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe)
            self._process = process
            _send(process.stdin, {"memory": self.memory})
            _receive(process.stdout)
        except (OSError, EOFError) as error:
            reason = getattr(error, "strerror", None) or "it ended at once"
            lost = "the process that reads record files does not start"
            raise WorkerError(f"{sys.executable}: {lost} ({reason})") from None
        return process

    def _ending(self, process: "subprocess.Popen[bytes]") -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=5.0)
        process.kill()  # one that answers nonsense
        code = process.wait()
        if code == -signal.SIGPROF:
            return f"took more than the {self.computing_time:g} s of computing that are allowed"
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"ended in a crash ({how}); the file is damaged or not what it seems"

    def stop(self, fork: bool = False) -> None:
        """End the process, if there is one; it is not for a `fork` of this one to do so."""
        process, self._process = self._process, None
        if process is None:
            return
        if not fork:
            process.kill()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(BrokenPipeError):
                pipe.close()  # type: ignore[union-attr]
        process.returncode = 0 if fork else process.wait()

    def _forget(self) -> None:
        self._lock = threading.Lock()
        self.stop(fork=True)


def serve() -> None:
    """Answer requests on standard input until it closes; the process does nothing else."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    _limit(resource.RLIMIT_AS, json.loads(requests.readline())["memory"])
    _limit(resource.RLIMIT_CORE, 0)
    _send(answers, {"ready": True})
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):  # readers in C print what they think of a file
        os.dup2(quiet, stream)
    for line in requests:
        request = json.loads(line)
        signal.setitimer(signal.ITIMER_PROF, request["seconds"])
        _answer(answers, request)
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _limit(what: int, size: int) -> None:
    bounds = [size, *(old for old in resource.getrlimit(what) if old != resource.RLIM_INFINITY)]
    with contextlib.suppress(ValueError):  # a system that cannot limit it
        resource.setrlimit(what, (min(bounds), resource.getrlimit(what)[1]))


def _answer(answers: Any, request: dict[str, Any]) -> None:
    path, shown, formats = (request[key] for key in ("path", "name", "formats"))
    name = formats[0] if len(formats) == 1 else recognise(path, formats)
    _send(answers, {"format": name})
    if name is None:
        return
    try:
        content = read_as(path, name)
        rows = [np.asarray(trace.data, dtype=np.float64) for trace in content.traces]
    except (Unreadable, TypeError, ValueError) as error:
        other = f"{shown}: the {name} file holds something other than numbers"
        known = isinstance(error, Unreadable)
        return _send(answers, {"error": str(error).replace(path, shown) if known else other})
    headers = [_header(trace) | {"size": row.size} for trace, row in zip(content.traces, rows)]
    _send(answers, content._asdict() | {"traces": headers})
    for row in rows:
        answers.write(row.tobytes())
    answers.flush()


def _header(trace: "Trace") -> dict[str, Any]:
    stats = trace.stats
    header: dict[str, Any] = {key: str(stats[key]) for key in _NAMES}
    header |= {key: float(stats[key]) for key in ("delta", "calib")}
    header["start"] = stats.starttime.ns
    return header | ({"record": dict(stats.record)} if "record" in stats else {})


def _take_trace(answers: Any, header: dict[str, Any]) -> "Trace":
    from obspy import Trace, UTCDateTime
    from obspy.core import AttribDict

    size = 8 * header.pop("size")
    data = answers.read(size)
    if len(data) < size:
        raise EOFError
    stats = header | {"starttime": UTCDateTime(ns=header.pop("start"))}
    if "record" in stats:
        stats["record"] = AttribDict(stats["record"])
    return Trace(np.frombuffer(data, dtype=np.float64), header=stats)


def _send(pipe: Any, message: dict[str, Any]) -> None:
    pipe.write(json.dumps(message).encode() + b"\n")
    pipe.flush()


def _receive(pipe: Any) -> dict[str, Any]:
    line = pipe.readline()
    if not line.endswith(b"\n"):
        raise EOFError
    return json.loads(line)
