"""What readers of text files share: lines, numbers, units, and whether a peak is as stated."""

import io
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from obspy import Trace
from obspy.core import AttribDict

from archfrag.errors import RecordError

Source = str | Path | BinaryIO
MOST_SAMPLES = 1_000_000_000
_HEAD_BYTES = 16384
_BLOCK = 10_000  # lines turned into numbers at once: what bounds the memory
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?")
# Fixed-width columns leave no blank before a sign, nor after a two-digit exponent.
_SEAM = re.compile(r"(?<=[EeDd][-+]\d\d)(?=[-+.\d])|(?<=[\d.])(?=[-+])")
_SEAMED = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[EeDd][-+]\d\d)?")
_UNITS = {"g": "g", "gal": "gal", "cm/s2": "cm/s2", "m/s2": "m/s2", "mm/s2": "mm/s2"}


def source_name(source: Source) -> str:
    """Name of a file or open buffer, for messages."""
    return str(getattr(source, "name", "buffer") if hasattr(source, "read") else source)


def first_lines(source: Source) -> list[str]:
    """Lines within the first 16 KiB of a file or open binary buffer; none if it is not there."""
    try:
        return _lines(_content(source, _HEAD_BYTES))
    except OSError:
        return []


def all_lines(source: Source) -> list[str]:
    """Lines of a file or open binary buffer, whatever ends them.

    Raises
    ------
    RecordError
        If there is no such file, or nothing but blanks in it.
    """
    try:
        lines = _lines(_content(source, -1))
    except FileNotFoundError:
        raise RecordError(f"{source_name(source)}: there is no such file") from None
    if not any(line.strip() for line in lines):
        raise RecordError(f"{source_name(source)}: the file is empty")
    return lines


def numbers(
    lines: Sequence[str], first: int, name: str, width: int | None = None
) -> NDArray[np.float64]:
    """All numbers in lines of text in reading order, shape (n,).

    Blanks or tabs separate them; where they run together, the columns of `width` characters do,
    or without it a sign or a two-digit exponent. Fortran's D counts as E.

    Parameters
    ----------
    lines : sequence of str
    first : int
        Number of the first of these lines in the file, for messages.
    name : str
        Name of the file, for messages.
    width : int, optional

    Raises
    ------
    RecordError
        Naming the line of what is not a finite number.
    """
    blocks = [np.empty(0)]
    for start in range(0, len(lines), _BLOCK):
        block = lines[start : start + _BLOCK]
        text = " ".join(block)
        try:
            values = np.array(text.split(), dtype=np.float64)
        except ValueError:
            values = np.array([np.nan])
        if "_" in text or not np.isfinite(values).all():  # Python's 1_000 is no number
            places = ((f"{name}, line {first + start + i}", line) for i, line in enumerate(block))
            values = np.array([v for at, line in places for v in _in_line(line, at, width)])
        blocks.append(values)
    return np.concatenate(blocks)


def number(word: str, place: str) -> float:
    """A finite number; `place` begins the message of the RecordError if it is none."""
    text = word.strip()
    if _NUMBER.fullmatch(text) is None:
        kind = "finite " if text.lstrip("+-").lower() in ("nan", "inf", "infinity") else ""
        raise RecordError(f"{place}: {_short(word)} is not a {kind}number")
    value = float(text.upper().replace("D", "E"))
    if not math.isfinite(value):
        raise RecordError(f"{place}: {_short(word)} is not a finite number")
    return value


def number_or_none(text: str | None) -> float | None:
    """A number of a header, None where it is empty or none."""
    try:
        return number(text, "") if text else None
    except RecordError:
        return None


def count_of_samples(text: str, place: str) -> int:
    """A number of samples that a header announces.

    Raises
    ------
    RecordError
        If it is not a whole number from 2 to ``MOST_SAMPLES``.
    """
    count = number_or_none(text)
    if count is None or not 2 <= count <= MOST_SAMPLES or count != int(count):
        raise RecordError(
            f"{place}: number of samples {_short(text)} must be a whole number from 2 to "
            f"{MOST_SAMPLES}"
        )
    return int(count)


def time_step(text: str, place: str) -> float:
    """A time step [s] of a header.

    Raises
    ------
    RecordError
        If it is not a positive number.
    """
    step = number_or_none(text)
    if step is None or step <= 0.0:
        raise RecordError(
            f"{place}: time step {_short(text)} must be a positive number of seconds"
        )
    return step


def acceleration_unit(text: str, place: str) -> str:
    """A unit of acceleration as archfrag spells it.

    Raises
    ------
    RecordError
        If it is none.

    Examples
    --------
    >>> acceleration_unit("cm/s^2", "a.ASC"), acceleration_unit("m/s/s", "a.acc")
    ('cm/s2', 'm/s2')
    """
    plain = re.sub(r"[\s^*()]", "", text.lower()).replace("sec", "s").replace("/s/s", "/s2")
    if plain not in _UNITS:
        raise RecordError(
            f"{place}: unknown unit {_short(text)} of acceleration; allowed are "
            f"{', '.join(_UNITS)}"
        )
    return _UNITS[plain]


def judge_peak(
    record: dict[str, Any], stated: str | None, values: NDArray[np.float64], unit: str
) -> None:
    """Add to ``faults`` of a record where its header states another peak than the samples have.

    Parameters
    ----------
    record : dict
    stated : str or None
        As in the header: more than 1 % and half its last digit from the samples is a fault.
    values : ndarray, shape (n_sample,) [unit]
    unit : str
    """
    peak = number_or_none(stated)
    if peak is None or stated is None or not values.size:
        return
    held = float(np.abs(values).max())
    digits = len(stated.strip().partition(".")[2])
    if abs(held - abs(peak)) > max(0.01 * abs(peak), 0.51 * 10.0**-digits):
        record["faults"] = (
            *record.get("faults", ()),
            f"the header states a peak of {abs(peak):g} {unit}, the samples have "
            f"{held:.4g} {unit}",
        )


def record_trace(
    samples: NDArray[np.float64], stats: dict[str, Any], record: dict[str, Any]
) -> Trace:
    """A trace in the file's unit with what the header says in ``stats.record``.

    Entries that are None or empty text are left out.
    """
    details = {key: value for key, value in record.items() if value is not None and value != ""}
    return Trace(samples, header={**stats, "record": AttribDict(details)})


def _content(source: Source, size: int) -> bytes:
    if isinstance(source, (str, Path)):
        with open(source, "rb") as file:
            return file.read(size)
    position = source.tell()
    content = source.read(size)
    source.seek(position, io.SEEK_SET)
    return content


def _lines(content: bytes) -> list[str]:
    # Not str.splitlines, which takes characters within names for ends of lines.
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    lines = re.split(r"\r\n|\r|\n", text)
    return lines if lines[-1] else lines[:-1]


def _in_line(line: str, place: str, width: int | None) -> Iterable[float]:
    try:
        values = [float(word) for word in line.split()]
        if "_" not in line and all(map(math.isfinite, values)):
            return values
    except ValueError:
        pass
    if width is not None and "\t" not in line:
        pieces = [line[i : i + width] for i in range(0, len(line), width)]
        return [number(piece, place) for piece in pieces if piece.strip()]
    return [value for word in line.split() for value in _in_word(word, place)]


def _in_word(word: str, place: str) -> Iterable[float]:
    if _NUMBER.fullmatch(word):
        return [number(word, place)]
    pieces = _SEAM.sub(" ", word).split()
    if len(pieces) < 2 or not all(map(_SEAMED.fullmatch, pieces)):
        return [number(word, place)]
    return [number(piece, place) for piece in pieces]


def _short(text: str) -> str:
    word = text.strip()
    return repr(word if len(word) <= 40 else f"{word[:40]}…")
