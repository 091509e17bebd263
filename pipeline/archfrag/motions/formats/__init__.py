"""Waveform files in the formats that are allowed, each read by the plug-in for it.

A record is somebody else's file. `obspy.read` would offer it to a reader of pickles, which runs
what the file holds, unpack archives, and take a name for a pattern or an address. None of that
happens here: the formats below are tried one by one on the file as it lies there. What C code
reads is read in another process, which a damaged file may end.
"""

import contextlib
import functools
import os
import re
import warnings
from codecs import BOM_UTF8
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from obspy import Trace, UTCDateTime

from archfrag.errors import RecordError, reason_of
from archfrag.files import opened, wide_encoding
from archfrag.motions.channel import Channel
from archfrag.motions.formats.apart import Limited, LimitedError
from archfrag.motions.formats.keyed import read_knet

# The formats of this package, which are entry points in pyproject.toml.
OWN = ("AT2", "COSMOS", "DMG", "DYNA", "GEONET", "RESORCE", "SMC")
TEXT = (*OWN, "KNET", "SLIST", "TSPAIR")
# Formats that name other files (CSS, Q), that lose a cut-off trace silently (AH, DMX, SH_ASC,
# WAV, WIN, Y) or that are no earthquakes' are not offered.
BINARY = ("SAC", "SEISAN", "SACXY", "KINEMETRICS_EVT", "REFTEK130")
IN_C = (
    "MSEED",
    "GSE2",
    "GSE1",
    "GCF",
)  # damaged files have crashed these readers of obspy
_entry_points = functools.cache(
    entry_points
)  # a look-up reads the metadata of all packages


def read_traces(path: str, form: str | None = None) -> list[Trace]:
    """Read the traces of a file in the format `form`, or else in the first that recognises it.
    Each has its `Channel` as ``stats.record``. RecordError if the file is damaged or in no format.
    """
    form = form or recognise(path, (*TEXT, *BINARY))
    traces = read_as(path, form) if form else read_apart(path)
    if traces:
        return traces
    with opened(path) as file:
        head = file.read(400)
    wide = "UTF-8" if head.startswith(BOM_UTF8) else wide_encoding(head)
    if wide:
        raise RecordError(
            f"{path}: is text in {wide} (it begins with a byte-order mark, or has zeros in "
            "between); save it as UTF-8 without such a mark"
        )
    raise RecordError(
        f"{path}: the format is not recognised. Archives are never unpacked: unpack them first. "
        "For columns of text, give `columns` (--columns time=1,acceleration=2 on the command "
        "line). If the file is not a record, move it, or use a pattern such as *.AT2"
    )


@functools.cache
def plug_in(name: str, task: str) -> Callable[[str], Any]:
    """Return the function that tests whether a file is in a format, or that reads it.

    `task` is ``is`` or ``read``. The function is of this package or of obspy.
    """
    if (name, task) == ("KNET", "read"):
        return read_knet
    group = f"obspy.plugin.waveform.{name}"
    (point,) = _entry_points(name=f"{task}Format").select(group=group)
    return point.load()


def recognise(path: str, formats: Sequence[str]) -> str | None:
    """Return the first of the formats that a file is in, None if it is in none of them."""
    for name in formats:
        # A test that fails with an error has not recognised the file.
        with contextlib.suppress(Exception):
            if plug_in(name, "is")(path):
                return name
    return None


def read_as(path: str, name: str) -> list[Trace]:
    """Read the traces of a file in the format `name`, as `read_traces` returns them."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            traces = list(plug_in(name, "read")(path))
            if not traces:
                raise ValueError("no trace could be read from it")
            for trace in traces:  # npts, which the header states, stays as it is
                object.__setattr__(trace, "data", trace.data.astype(float))
        except RecordError:
            raise
        except MemoryError:
            raise RecordError(
                f"{path}: read as {name} it takes too much memory"
            ) from None
        except Exception as error:
            raise RecordError(
                f"{path}: the file is damaged, truncated or not of this format "
                f"({reason_of(error)})"
            ) from None
    shown = []
    for warning in caught:
        text = " ".join(str(warning.message).split())
        if "MSEED" in warning.category.__name__:
            raise RecordError(f"{path}: damaged or truncated MSEED ({text})")
        if not issubclass(warning.category, DeprecationWarning):
            shown.append(f"obspy: {text}")
    for trace in traces:
        stats = trace.stats
        blocks = stats.get("mseed", {})
        length = blocks.get("record_length") or (1024 if name == "GCF" else 0)
        size = blocks.get("filesize") or Path(path).stat().st_size
        if length and size % length:
            raise RecordError(
                f"{path}: truncated {name}: {size} bytes are no multiple of blocks of {length} "
                "bytes"
            )
        held = len(trace.data)
        channel = Channel(str(stats.channel).strip(), announced=stats.npts, held=held)
        stats.setdefault("record", channel).messages = list(dict.fromkeys(shown))
        stats._format = name
        stats.npts = held
    if name == "TSPAIR":
        _compare_times(path, traces[0])
    return traces


def _compare_times(path: str, trace: Trace) -> None:
    """Compare the first two times of a TSPAIR file with the step in its header.

    The reader of obspy passes over these times.
    """
    with opened(path) as file:
        head = file.read(2000).decode("latin-1")
    times = re.findall(r"(?m)^(\d{4}-\d\d-\d\dT\S+)\s", head)
    delta = trace.stats.delta
    step = UTCDateTime(times[1]) - UTCDateTime(times[0]) if times[1:] else delta
    if abs(step - delta) > 0.01 * delta:
        trace.stats.record.contradicted = (
            f"its first samples are {step:g} s apart, its header states {delta:g} s"
        )


def read_apart(path: str) -> list[Trace]:
    """Read a file by a reader in C, in another process; return [] if it has no such format.

    The process reads all such files. RecordError if a file makes it crash, takes too long or takes
    too much memory; the next file then has a new process.
    """
    try:
        return READER.ask((os.getcwd(), path))
    except LimitedError as error:
        raise RecordError(
            f"{path}: reading it failed ({error}); the file is damaged or has another format than "
            "it seems"
        ) from None


def read_in_c(place: tuple[str, str]) -> list[Trace]:
    """Read a file by a reader in C in this process, which a damaged file may end.

    `place` is the folder that a relative path starts from, and the path.
    """
    folder, path = place
    os.chdir(folder)
    name = recognise(path, IN_C)
    return read_as(path, name) if name else []


# At most a minute of computing a file, and 1 GiB.
READER = Limited(f"{__name__}:{read_in_c.__name__}", 60.0, 2**30)
