"""Reading files in a process of their own, which a damaged or hostile file may end.

obspy reads miniSEED, GSE and GCF in C, and a damaged file can crash that code, run for ever or
ask for any amount of memory. Each such file is read in a fork of this process, within limits of
computing time and memory.
"""

import contextlib
import multiprocessing
import os
import resource
import signal
from multiprocessing.connection import Connection
from pathlib import Path

from obspy import Trace

from archfrag.errors import RecordError
from archfrag.motions.formats.waveform import plug_in, read_as, recognise

COMPUTING_TIME = 60.0  # [s] of processor time for one file
MEMORY = 2**30  # [bytes] of address space beyond that of this process


def read_apart(path: str, formats: tuple[str, ...]) -> list[Trace]:
    """Read a file in the first of the formats that it is in; no traces if it is in none.

    RecordError if the file is damaged, crashes the reader, or takes more than is allowed.
    """
    for form in formats:  # imported once here, not in each fork
        plug_in(form, "is", "isFormat"), plug_in(form, "read", "readFormat")
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, path, formats), daemon=True)
    process.start()
    theirs.close()
    name = found = None
    try:
        name = ours.recv()
        found = ours.recv()
    except EOFError:
        pass  # it ended before
    finally:
        ours.close()
        process.join(timeout=5.0)
        process.kill()
    if isinstance(found, RecordError):
        raise found
    if found is not None:
        return found
    process.join()
    task = f"reading it as {name}" if name else "recognising its format"
    code = process.exitcode or 0
    if code == -signal.SIGPROF:
        allowed = f"more than the {COMPUTING_TIME:g} s of computing that are allowed"
        raise RecordError(f"{path}: {task} took {allowed}")
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    raise RecordError(
        f"{path}: {task} ended in a crash ({how}); the file is damaged or not what it seems"
    )


def _answer(pipe: Connection, path: str, formats: tuple[str, ...]) -> None:
    """Send the format of a file and then its traces, or why there are none."""
    for number in (signal.SIGINT, signal.SIGPROF, signal.SIGSEGV):
        signal.signal(number, signal.SIG_DFL)
    with contextlib.suppress(OSError, ValueError):  # a system that cannot limit it
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):  # readers in C print what they think of a file
        os.dup2(quiet, stream)
    signal.setitimer(signal.ITIMER_PROF, COMPUTING_TIME)
    name = recognise(path, formats)
    pipe.send(name)
    try:
        traces = [] if name is None else read_as(path, name)
        for trace in traces:
            trace.data = trace.data.astype(float)
        pipe.send(traces)
    except RecordError as error:
        pipe.send(error)
    except (TypeError, ValueError):
        other = f"{path}: the {name} file holds something other than numbers"
        pipe.send(RecordError(other))
