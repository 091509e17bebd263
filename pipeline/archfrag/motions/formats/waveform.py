"""Waveform files in the formats that are allowed, each read by the plug-in for it.

A record is somebody else's file. `obspy.read` would offer it to a reader of pickles, which runs
what the file holds, unpack archives, and take a name for a pattern or an address. None of that
happens here: the formats below are tried one by one on the file as it lies there.
"""

import importlib
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from obspy import Stream, Trace
from obspy.core import AttribDict
from obspy.core.util.base import buffered_load_entry_point

from archfrag.errors import RecordError
from archfrag.files import opened

# The readers of this package: name of the plug-in, and the module here that has is_<name> and
# read_<name>. Each is an entry point in pyproject.toml, too.
OWN = {"AT2": "keyed", "COSMOS": "csmip", "DMG": "csmip", "DYNA": "keyed", "GEONET": "blocks",
       "RESORCE": "keyed", "SMC": "blocks"}  # fmt: skip
# Text that Python code reads, in this process.
TEXT = (*OWN, "KNET", "SLIST", "TSPAIR")
# Formats that are read apart (see `isolated`): obspy has readers in C for some of them, and
# damaged files have crashed those. Formats that name other files (CSS, Q), that lose a cut-off
# trace silently (AH, DMX, SH_ASC, WAV, WIN, Y) or that are no earthquakes' are not offered.
BINARY = (
    "MSEED", "SAC", "GSE2", "SEISAN", "SACXY", "GSE1", "KINEMETRICS_EVT", "GCF", "REFTEK130",
)  # fmt: skip

_BLOCK = {"GCF": 1024}  # [bytes] of which a file consists
_ARCHIVES = {
    b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"BZh": "bzip2", b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "Zstandard", b"7z\xbc\xaf\x27\x1c": "7z", b"Rar!": "RAR",
}  # fmt: skip
_TAR_PLACE = 257


def plug_in(name: str, ours: str, obspys: str) -> Callable[[str], Any]:
    """Return what recognises or reads a format: a function of this package or obspy's plug-in."""
    if name in OWN or (name, ours) == ("KNET", "read"):
        module = importlib.import_module(f"archfrag.motions.formats.{OWN.get(name, 'keyed')}")
        return getattr(module, f"{ours}_{name.lower()}")
    return buffered_load_entry_point("obspy", f"obspy.plugin.waveform.{name}", obspys)


def recognise(path: str, formats: Sequence[str]) -> str | None:
    """Return the first of the formats that a file is in, None if it is in none of them."""
    for name in formats:
        try:
            found = plug_in(name, "is", "isFormat")(path)
        except Exception:
            found = False  # a test that stumbles over the file has not recognised it
        if found:
            return name
    return None


def archive_kind(path: str) -> str | None:
    """Return the kind of archive that a file is by its first bytes, None if it is not one."""
    with opened(path) as file:
        head = file.read(512)
    if head[_TAR_PLACE : _TAR_PLACE + 5] == b"ustar":
        return "tar"
    return next((kind for magic, kind in _ARCHIVES.items() if head.startswith(magic)), None)


def read_as(path: str, name: str) -> list[Trace]:
    """Read the traces of a file in the format of that name.

    Each has in ``stats.record`` what the header states, samples ``announced`` and ``held``, and
    the ``messages`` of the reader. RecordError if the file is damaged or cut off.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        traces = list(_stream(path, name))
    messages = [w for w in caught if not issubclass(w.category, DeprecationWarning)]
    for message in messages:
        if "MSEED" in message.category.__name__:
            raise RecordError(f"{path}: damaged or truncated miniSEED ({message.message})")
    if not traces:
        raise _damaged(path, "no trace could be read from it")
    texts = (f"obspy: {' '.join(str(message.message).split())}" for message in messages)
    shown = list(dict.fromkeys(texts))
    for trace in traces:
        _check_blocks(trace, path, name)
        record = {"announced": trace.stats.npts, **trace.stats.get("record", {})}
        trace.stats._format, trace.stats.npts = name, len(trace.data)
        trace.stats.record = AttribDict({"held": trace.stats.npts, "messages": shown} | record)
    return traces


def _stream(path: str, name: str) -> Stream:
    try:
        return plug_in(name, "read", "readFormat")(path)
    except RecordError:
        raise
    except MemoryError:
        raise RecordError(f"{path}: reading it as {name} takes more memory than allowed") from None
    except Exception as error:
        lines = str(error).strip().splitlines()
        raise _damaged(path, lines[0] if lines else type(error).__name__) from None


def _damaged(path: str, reason: str) -> RecordError:
    return RecordError(f"{path}: the file is damaged, truncated or not what it seems ({reason})")


def _check_blocks(trace: Trace, path: str, name: str) -> None:
    """Refuse a file whose last block or record is cut off."""
    blocks = trace.stats.get("mseed", {})
    length = blocks.get("record_length") or _BLOCK.get(name)
    size = blocks.get("filesize") or Path(path).stat().st_size
    if length and size % length:
        what = "miniSEED" if name == "MSEED" else name
        raise RecordError(
            f"{path}: truncated {what}: {size} bytes are no multiple of records of {length} bytes"
        )
