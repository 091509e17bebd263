"""What the readers of text formats have in common: lines, numbers in columns, even time steps."""

import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import RecordError
from archfrag.files import opened

Source = str | Path | BinaryIO

_CHUNK = 4000  # lines converted at a time: words need ten times the memory of numbers
_FORTRAN = str.maketrans("Dd", "EE")
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[Ee][-+]?\d+)?")
# Fixed-width columns leave no blank before a sign, nor after a two-digit exponent.
_RUN_TOGETHER = re.compile(r"(?<=[Ee][-+]\d\d)(?=[-+.\d])|(?<=[\d.])(?=[-+])")
_FIXED_WIDTH = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[Ee][-+]\d\d)?")
_FORMAT = re.compile(r"\(\s*\d*P?,?\s*\d*\s*[FEGDI]\s*(\d{1,2})(?:\.\d+)?\s*\)", re.IGNORECASE)
_STEPS = np.outer(10.0 ** np.arange(-5, 1), (1.0, 2.0, 2.5, 5.0)).ravel()  # [s]
END_OF_DATA = re.compile(r"/&|\s*END[ -]OF[ -]DATA", re.IGNORECASE)
WORDS = re.compile(r"[A-Za-z]{4}|/&|END", re.IGNORECASE)


class Text:
    """Lines of a file, whatever ends them."""

    def __init__(self, source: Source) -> None:
        is_path = isinstance(source, (str, Path))
        self.name = str(source if is_path else getattr(source, "name", "buffer"))
        self.lines = _lines(_read_bytes(source))

    def place(self, index: int) -> str:
        """What messages call a line."""
        return f"{self.name}, line {index + 1}"

    def head(self, first: int, last: int) -> list[str]:
        """Lines of a header, cut to 200 characters: patterns take long over much longer ones."""
        return [line[:200] for line in self.lines[first:last]]

    def needs(self, index: int, what: str) -> RecordError:
        """The error for a line that is something else than needed."""
        end = index >= len(self.lines)
        shown = "the end of the file" if end else repr(self.lines[index].strip()[:60])
        return RecordError(f"{self.place(index)}: {what} is needed here, this is {shown}")

    def numbers(
        self, first: int, last: int | None = None, expected: int | None = None,
        width: int | None = None,
    ) -> NDArray[np.float64]:  # fmt: skip
        """Finite numbers of some lines, between blanks or in columns of a width."""
        lines = self.lines[first:last]
        words = _converted(lines, None)
        if width is not None and (words is None or words.size != expected):
            columns = _converted(lines, width)
            if columns is not None and (words is None or columns.size == expected):
                return columns
        if words is not None:
            return words
        values: list[float] = []
        for number, line in enumerate(lines, start=first):
            for word in _words(line, width):
                values += split(word, self.place(number))
        return np.array(values)

    def first(self, index: int, test: Callable[[str], object]) -> int:
        """The first line from `index` on that passes a test; the number of lines if none does."""
        count = len(self.lines)
        return next((i for i in range(index, count) if test(self.lines[i])), count)


def _read_bytes(source: Source, size: int = -1) -> bytes:
    """First bytes of a file, or of the rest of an open buffer, whose position is kept."""
    if isinstance(source, (str, Path)):
        with opened(source) as file:
            return file.read(size)
    position = source.seek(0, io.SEEK_CUR)
    content = source.read(size)
    source.seek(position, io.SEEK_SET)
    return content


def begins_with(*patterns: str) -> Callable[[Source], bool]:
    """A test of a file or open binary buffer: plain text in whose first 4096 bytes all match."""

    def begins(source: Source) -> bool:
        try:
            content = _read_bytes(source, 4096)
        except (OSError, ValueError):
            return False
        text = "\n".join(_lines(content))
        return b"\0" not in content and all(re.search(pattern, text) for pattern in patterns)

    return begins


def _lines(content: bytes) -> list[str]:
    text = content.decode("latin-1").replace("\0", " ")  # with which some rows are filled
    return re.sub("\r+\n|\r", "\n", text).rstrip("\x1a ").split("\n")


def format_width(text: str) -> int | None:
    """Width of the columns by a Fortran format such as ``(8f9.6)`` in a text."""
    found = _FORMAT.search(text)
    return int(found.group(1)) or None if found else None


def _converted(lines: Sequence[str], width: int | None) -> NDArray[np.float64] | None:
    """All numbers at once; None if a word or a column is not a finite number."""
    parts = [np.zeros(0)]
    for start in range(0, len(lines), _CHUNK):
        text = "\n".join(lines[start : start + _CHUNK]).translate(_FORTRAN)
        if "_" in text or (width is not None and "\t" in text):  # Python allows 1_000
            return None
        cells = text.split() if width is None else [
            line[i : i + width]
            for line in map(str.rstrip, text.split("\n"))
            for i in range(0, len(line), width)
        ]  # fmt: skip
        try:
            parts.append(np.array(list(map(float, cells))))
        except ValueError:
            return None
        if not np.isfinite(parts[-1]).all():
            return None
    return np.concatenate(parts)


def _words(line: str, width: int | None) -> list[str]:
    """Words of a line, or its columns if only they are numbers."""
    words = line.split()
    if width is None or "\t" in line:
        return words
    columns = [line[start : start + width].strip() for start in range(0, len(line), width)]
    for found in (words, list(filter(None, columns))):
        if all(_NUMBER.fullmatch(word.translate(_FORTRAN)) for word in found):
            return found
    return words


def split(word: str, place: str) -> list[float]:
    """Numbers of one word, of which fixed-width columns may have made several."""
    text = word.translate(_FORTRAN).upper()
    shown = repr(word if len(word) <= 40 else word[:40] + "...")
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


def on_even_steps(pairs: NDArray[np.float64], name: str) -> tuple[NDArray, float, str]:
    """Samples at equal steps, the step [s] and what was done, from pairs of time and sample."""
    times, values = pairs[: pairs.size // 2 * 2].reshape(-1, 2).T
    if times.size < 2:
        return values[:0], 1.0, ""
    steps, length = np.diff(times), times[-1] - times[0]
    if steps.min() < 0.0 or not length > 0.0:
        bad = int(np.argmax(steps < 0.0)) + 1 if steps.min() < 0.0 else 0
        raise RecordError(f"{name}: times must increase; sample {bad} is at {times[bad]:g} s")
    mean = float(length) / steps.size
    if np.abs(times - times[0] - mean * np.arange(times.size)).max() <= 0.05 * mean:
        # Times rounded to their last digit give a step that is nearly what it was before.
        rounded = (float(f"{mean:.{digits}g}") for digits in (1, 2, 3))
        step = next((value for value in rounded if abs(value - mean) <= 1e-5 * mean), mean)
        return np.ascontiguousarray(values), step, ""
    # Linear between samples, as digitised film is; a step of 1, 2, 2.5, 5, 10... up to the median.
    median = float(np.median(steps[steps > 0.0]))
    step = float(_STEPS[median >= _STEPS / 1.02].max(initial=0.0)) or median
    if not length / step < 20 * times.size:
        raise RecordError(f"{name}: times are too uneven: steps of {median:g} s in {length:g} s")
    grid = times[0] + step * np.arange(int(length / step * (1.0 + 1e-12)) + 1)
    unequal = f"Samples at unequal steps of {steps.min():.4g} to {steps.max():.4g} s"
    sizes = f"linear between them ({values.size} to {grid.size} samples)"
    done = f"{unequal} read at equal steps of {step:g} s, {sizes}."
    return np.interp(grid, times, values), step, done
