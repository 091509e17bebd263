"""What a record from a file is refused for unless the user accepts it by name."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from archfrag.errors import RecordError
from archfrag.motions.partners import channel_code
from archfrag.motions.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from obspy import Trace

Acceptable = Literal["pga", "time_step", "samples", "header"]
ACCEPTABLE: tuple[Acceptable, ...] = get_args(Acceptable)
PGA_RANGE, TIME_STEP_RANGE = (1e-5, 5.0), (1e-4, 0.1)  # [g], [s]
LARGEST_RECORD, LARGEST_INVENTORY = 2**27, 50_000_000  # [bytes]
Warned = tuple[Acceptable | None, str]  # None: nothing makes it acceptable


def record_size(path: Path) -> int:
    """Size of a record file [bytes]; RecordError for what cannot be read as one."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode("utf-8", "backslashreplace")
        raise RecordError(
            f"{shown}: the name of the file is not in UTF-8; rename it, the id of a record is "
            "made of its name"
        ) from None
    for right, what in (
        (path.exists(), "there is no such file"),
        (not path.is_dir(), "this is a folder; a record is one file"),
        (path.is_file(), "this is not a regular file"),
        (os.access(path, os.R_OK), "the file cannot be read (Permission denied)"),
    ):
        if not right:
            raise RecordError(f"{path}: {what}")
    size = path.stat().st_size
    if not 0 < size <= LARGEST_RECORD:
        many = f"the file has {size} bytes; a record may have at most {LARGEST_RECORD}"
        raise RecordError(f"{path}: {many if size else 'the file is empty'}")
    return size


def accepted_words(words: Iterable[str], place: str) -> tuple[str, ...]:
    """The words of an `accept`, commas or blanks between, in the order of ``ACCEPTABLE``."""
    listed = [words] if isinstance(words, str) else words
    given = [word for text in listed for word in text.replace(",", " ").split()]
    for word in given:
        if word not in ACCEPTABLE:
            raise RecordError(f"{place}: accept {word!r} is not one of {', '.join(ACCEPTABLE)}")
    return tuple(word for word in ACCEPTABLE if word in given)


def implausible(channel: "Trace") -> Iterator[Warned]:
    """What is implausible about a channel in m/s2."""
    code, dt = channel_code(channel), float(channel.stats.delta)
    low, high = TIME_STEP_RANGE
    # A rate such as 10 Hz need not give 0.1 s to the last digit.
    if not low * (1.0 - 1e-9) <= dt <= high * (1.0 + 1e-9):
        text = f"time step of channel {code} is {dt:g} s, outside {low:g} to {high:g} s"
        yield "time_step", text
    low, high = PGA_RANGE
    peak = float(np.abs(channel.data).max()) / STANDARD_GRAVITY
    if not low <= peak <= high:
        unit = channel.stats.record.unit_in_file
        text = f"peak of channel {code} is {peak:.4g} g by its unit {unit}"
        yield "pga", f"{text}, outside {low:g} to {high:g} g"


def accept_or_refuse(
    path: object, accept: tuple[str, ...], warnings: Iterable[Warned]
) -> tuple[str, ...]:
    """Lines for the log on warnings whose word is in `accept`; RecordError for any other one."""
    accepted = []
    for word, fact in warnings:
        if word not in accept:
            remedy = f"; to use it as it is give `accept` with {word} (--accept {word} on the "
            remedy = f"{remedy}command line)" if word else ""
            raise RecordError(f"{path}: {fact}{remedy}")
        accepted.append(f"Accepted: {fact}.")
    return tuple(accepted)
