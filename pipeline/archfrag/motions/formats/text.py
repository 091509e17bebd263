"""What the readers of text formats share: bytes, lines, numbers and times."""

import io
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import RecordError

Source = str | Path | BinaryIO

_CHUNK = 4000  # lines that are taken apart at a time: words need ten times the memory of numbers
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[Ee][-+]?\d+)?")
_WIDEST = 200  # characters of a line of a header; patterns take long over much longer ones
_SHOWN = 40  # characters of a word in a message
_FORTRAN = str.maketrans("Dd", "EE")
# Fixed-width columns leave no blank before a sign, nor after a two-digit exponent.
_RUN_TOGETHER = re.compile(r"(?<=[Ee][-+]\d\d)(?=[-+.\d])|(?<=[\d.])(?=[-+])")
_FIXED_WIDTH = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[Ee][-+]\d\d)?")
_FORMAT = re.compile(r"\(\s*\d*P?,?\s*\d*\s*[FEGDI]\s*(\d{1,2})(?:\.\d+)?\s*\)", re.IGNORECASE)
_STEPS = np.outer(10.0 ** np.arange(-5, 1), (1.0, 2.0, 2.5, 5.0)).ravel()  # [s]
_EVEN = 0.05  # part of a step by which times may be off where only their rounding is seen
_STRETCH = 20  # samples on the grid for each that the file holds, at most
END_OF_DATA = re.compile(r"/&|\s*END[ -]OF[ -]DATA", re.IGNORECASE)


def source_name(source: Source) -> str:
    """What messages call a path or an open buffer."""
    return str(source if isinstance(source, (str, Path)) else getattr(source, "name", "buffer"))


def read_bytes(source: Source, size: int = -1) -> bytes:
    """First bytes of a file or of what is left of an open buffer, whose place is kept."""
    if isinstance(source, (str, Path)):
        with open(source, "rb") as file:
            return file.read(size)
    position = source.tell()
    content = source.read(size)
    source.seek(position, io.SEEK_SET)
    return content


def head_lines(source: Source, size: int = 4096) -> list[str]:
    """Lines at the beginning of a file; none if it is not plain text or cannot be read."""
    try:
        content = read_bytes(source, size)
        if b"\0" in content:
            return []
        return _lines(content)
    except (OSError, ValueError):
        return []


def read_lines(source: Source) -> list[str]:
    """Lines of a file, whatever ends them.

    Raises
    ------
    RecordError
        If there is no such file, or nothing in it.
    """
    name = source_name(source)
    try:
        lines = _lines(read_bytes(source))
    except FileNotFoundError:
        raise RecordError(f"{name}: there is no such file") from None
    if not any(line.strip(" \t\x1a") for line in lines):
        raise RecordError(f"{name}: the file is empty")
    return lines


def _lines(content: bytes) -> list[str]:
    text = content.decode("latin-1").replace("\0", " ")  # with which some rows are filled
    return re.sub("\r+\n|\r", "\n", text).rstrip("\x1a ").split("\n")


def clipped(lines: Sequence[str]) -> list[str]:
    """Lines of a header, none longer than any has."""
    return [line[:_WIDEST] for line in lines]


def format_width(text: str) -> int | None:
    """Width of the columns by a Fortran format such as ``(8f9.6)`` in a text."""
    found = _FORMAT.search(text)
    return int(found.group(1)) or None if found else None


def numbers(
    lines: Sequence[str], first: int, name: str, *, expected: int | None = None,
    width: int | None = None,
) -> NDArray[np.float64]:  # fmt: skip
    """Numbers of some lines, parted by blanks or in columns without any.

    Parameters
    ----------
    lines : sequence of str
    first : int
        Number of the first of them in its file, from 1.
    name : str
        The file, for messages.
    expected : int, optional
        How many there should be: tells whether columns of a `width` run together.
    width : int, optional
        Characters of a column.

    Returns
    -------
    array, shape (n,)

    Raises
    ------
    RecordError
        At the first word that is no finite number, with its line.
    """
    words = _in_chunks(lines, _parted)
    if words is not None and (width is None or words.size == expected):
        return words
    columns = None if width is None else _in_chunks(lines, lambda part: _columns(part, width))
    if columns is not None and (words is None or columns.size == expected):
        return columns
    if words is not None:
        return words
    values: list[float] = []
    for number, line in enumerate(lines, start=first):
        for word in _words(line, width):
            value = _number(word)
            if value is None:
                values.extend(_taken_apart(word, f"{name}, line {number}"))
            else:
                values.append(value)
    return np.array(values)


def _words(line: str, width: int | None) -> list[str]:
    """Words of a line, or its columns where only they are numbers."""
    words = line.split()
    if width is None or "\t" in line:
        return words
    columns = [line[start : start + width].strip() for start in range(0, len(line), width)]
    for found in (words, [column for column in columns if column]):
        if all(_NUMBER.fullmatch(word.translate(_FORTRAN)) for word in found):
            return found
    return words


def _in_chunks(lines: Sequence[str], take) -> NDArray[np.float64] | None:
    parts = []
    for start in range(0, len(lines), _CHUNK):
        try:
            part = np.array(take(lines[start : start + _CHUNK]), dtype=np.float64)
        except ValueError:
            return None
        if not np.isfinite(part).all():
            return None
        parts.append(part)
    return np.concatenate(parts) if parts else np.zeros(0)


def _parted(lines: Sequence[str]) -> list[str]:
    text = " ".join(lines).translate(_FORTRAN)
    if "_" in text:  # which Python allows between digits
        raise ValueError
    return text.split()


def _columns(lines: Sequence[str], width: int) -> list[float]:
    values = []
    for line in lines:
        line = line.rstrip().translate(_FORTRAN)
        if "\t" in line or "_" in line:
            raise ValueError
        values += [float(line[i : i + width]) for i in range(0, len(line), width)]
    return values


def _number(word: str) -> float | None:
    try:
        value = float(word.translate(_FORTRAN))
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in word else None


def _taken_apart(word: str, place: str) -> list[float]:
    text = word.translate(_FORTRAN).upper()
    shown = repr(word if len(word) <= _SHOWN else word[:_SHOWN] + "...")
    pieces = [text] if _NUMBER.fullmatch(text) else _RUN_TOGETHER.sub(" ", text).split()
    if len(pieces) > 1 and not all(_FIXED_WIDTH.fullmatch(piece) for piece in pieces):
        pieces = [""]
    try:
        values = [float(piece.replace("_", "?")) for piece in pieces]
    except ValueError:
        raise RecordError(f"{place}: {shown} is not a number") from None
    if not np.isfinite(values).all():
        raise RecordError(f"{place}: {shown} is not a finite number")
    return values


def on_even_steps(
    times: NDArray[np.float64], values: NDArray[np.float64], name: str
) -> tuple[NDArray[np.float64], float, str]:
    """Samples at equal steps from samples at stated times.

    Where the times are those of equal steps to within their rounding the samples stay as they
    are. Otherwise the motion is taken to be linear between them, as digitised film is, and read
    at the largest of the steps 1, 2, 2.5, 5, 10... that is no longer than the median one.

    Returns
    -------
    samples : array, shape (n,)
    dt : float [s]
    sentence : str
        What was done, for a log; empty if nothing was.

    Raises
    ------
    RecordError
        If times decrease or do not advance, or lie so unevenly that the grid would be
        far larger than the record.
    """
    steps = np.diff(times)
    if steps.size == 0 or steps.min() < 0.0 or not times[-1] > times[0]:
        bad = 1 + int(np.argmax(steps < 0.0)) if steps.size and steps.min() < 0.0 else 0
        raise RecordError(
            f"{name}: the times of the samples must increase; {times[bad]:g} s at sample {bad} "
            "does not"
            if bad
            else f"{name}: the times of the samples must increase; there is only one"
        )
    mean = float(times[-1] - times[0]) / steps.size
    if np.abs(times - times[0] - mean * np.arange(times.size)).max() <= _EVEN * mean:
        return values, _rounded_step(mean), ""
    median = float(np.median(steps[steps > 0.0]))
    fitting = _STEPS[median >= _STEPS / 1.02]
    step = float(fitting.max()) if fitting.size else median
    count = (times[-1] - times[0]) / step
    if not count < _STRETCH * times.size:
        raise RecordError(
            f"{name}: the times of the samples are too uneven: {times.size} samples in "
            f"{times[-1] - times[0]:g} s with a median step of {median:g} s"
        )
    grid = times[0] + step * np.arange(int(count * (1.0 + 1e-12)) + 1)
    sentence = (
        f"Samples at unequal steps of {steps.min():.4g} to {steps.max():.4g} s read at equal "
        f"steps of {step:g} s, linear between them ({values.size} to {grid.size} samples)."
    )
    return np.interp(grid, times, values), step, sentence


def _rounded_step(step: float) -> float:
    """A step that times rounded to their last digit give, as it was before."""
    return next((float(f"{step:.{n}g}") for n in (1, 2, 3)
                 if abs(float(f"{step:.{n}g}") - step) <= 1e-5 * step), step)  # fmt: skip


def next_line(lines: Sequence[str], place: int) -> int:
    """The first line from a place on that is neither empty nor an end of data."""
    while place < len(lines) and (
        not lines[place].strip(" \t\x1a") or END_OF_DATA.match(lines[place])
    ):
        place += 1
    return place
