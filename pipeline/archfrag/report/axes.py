"""Panels with axes on a sheet: what is drawn in one is given in its units, not in pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.report import drawing as look
from archfrag.report.drawing import LEFT, Box, Entry, FloatArray, Sheet, number, text_width

Range = tuple[float, float]


@dataclass
class Panel:
    """Axes on a sheet: a box in pixels and the ranges that it shows."""

    sheet: Sheet
    box: Box
    x: Range
    y: Range
    log_x: bool = False
    log_y: bool = False

    def at_x(self, values: ArrayLike) -> FloatArray:
        """Pixels of values of x."""
        return _scaled(values, self.x, self.log_x, self.box[0], self.box[2])

    def at_y(self, values: ArrayLike) -> FloatArray:
        """Pixels of values of y."""
        return _scaled(values, self.y, self.log_y, self.box[3], self.box[1])

    def line(
        self, x: ArrayLike, y: ArrayLike, colour: str = look.INK, width: float = 1.6,
        dash: str = "", opacity: float | None = None,
    ) -> None:  # fmt: skip
        """Join points, with a gap at each nan."""
        self.sheet.path(
            look.trace(self.at_x(x), self.at_y(y)), fill="none", stroke=colour, stroke_width=width,
            stroke_dasharray=dash, stroke_opacity=opacity, stroke_linejoin="round",
        )  # fmt: skip

    def band(
        self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, opacity: float = 0.3
    ) -> None:
        """Fill between two curves."""
        place, lower, upper = self.at_x(x), self.at_y(low), self.at_y(high)
        d = look.trace(np.append(place, place[::-1]), np.append(upper, lower[::-1]))
        self.sheet.path(d + "z" if d else "", fill=colour, fill_opacity=opacity)

    def dots(
        self, x: ArrayLike, y: ArrayLike, colour: str, mark: str = "dot", radius: float = 3.0
    ) -> None:
        """Mark points."""
        points = zip(self.at_x(x), self.at_y(y), strict=True)
        self.sheet.dots([p for p in points if np.isfinite(sum(p))], radius, colour, mark)

    def boxes(
        self, left: ArrayLike, right: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str,
        mark: str = "area",
    ) -> None:  # fmt: skip
        """Fill rectangles with one colour, as one path."""
        sides = self.at_x(left), self.at_x(right), self.at_y(high), self.at_y(low)
        d = "".join(
            f"M{number(a)} {number(c)}H{number(b)}V{number(e)}H{number(a)}z"
            for a, b, c, e in np.stack([np.ravel(s) for s in np.broadcast_arrays(*sides)], axis=1)
        )
        self.sheet.fill(d, colour, mark)

    def cells(
        self, mask: NDArray[np.bool_], colour: str, mark: str = "area",
        edges: FloatArray | None = None, half: float = 0.5,
    ) -> None:  # fmt: skip
        """Fill cells of a mask, (n_row, n_column), at 0, 1, 2, ...; neighbours of a row join.

        `edges` are those of the columns, (n_column + 1,); `half` is half the height of a cell.
        """
        x = np.arange(mask.shape[1] + 1) - 0.5 if edges is None else edges
        steps = np.diff(mask.astype(int), axis=1, prepend=0, append=0)
        (row, first), (_, last) = np.nonzero(steps > 0), np.nonzero(steps < 0)
        self.boxes(x[first], x[last], row - half, row + half, colour, mark)

    def stack(self, parts: Sequence[tuple[Entry, FloatArray]]) -> None:
        """Draw columns at 0, 1, 2, ... of parts, (n_column,) each, over each other."""
        base = np.zeros(len(parts[0][1]) if parts else 0)
        for (_, colour, mark), part in parts:
            here = np.flatnonzero(part)
            low, high = base[here], base[here] + part[here]
            self.boxes(here - 0.42, here + 0.42, low, high, colour, mark)
            base = base + part

    def axis_x(
        self, ticks: ArrayLike, title: str = "", labels: Sequence[str] = (), grid: bool = False
    ) -> None:
        """Draw ticks below; labels too close to the one before are left out."""
        left, top, right, bottom = self.box
        places = self.at_x(ticks)
        if grid:
            lines = (f"M{number(x)} {number(top)}V{number(bottom)}" for x in places)
            self.sheet.path("".join(lines), kind="gr")
        marks = "".join(f"M{number(x)} {number(bottom)}v3" for x in places)
        self.sheet.path(f"M{number(left)} {number(bottom)}H{number(right)}{marks}", kind="ax")
        end = -np.inf
        for x, label in zip(places, labels or _labels(ticks), strict=True):
            half = 0.5 * text_width(label, look.SMALL)
            if x - half >= end + 5.0:
                self.sheet.text(x, bottom + 14.0, label, "s m")
                end = x + half
        if title:
            self.sheet.text(0.5 * (left + right), bottom + 29.0, title, "m")

    def axis_y(
        self, ticks: ArrayLike, title: str = "", labels: Sequence[str] = (), grid: bool = True
    ) -> None:
        """Draw ticks on the left, and the title upright left of them."""
        left, top, right, bottom = self.box
        places = self.at_y(ticks)
        if grid:
            lines = (f"M{number(left)} {number(y)}H{number(right)}" for y in places)
            self.sheet.path("".join(lines), kind="gr")
        self.sheet.path(f"M{number(left)} {number(top)}V{number(bottom)}", kind="ax")
        end, widest = np.inf, 0.0
        for y, label in zip(places, labels or _labels(ticks), strict=True):
            if y <= end - 11.0:
                self.sheet.text(left - 5.0, y + 3.5, label, "s e")
                widest, end = max(widest, text_width(label, look.SMALL)), y
        if title:
            self.sheet.text(left - widest - 11.0, 0.5 * (top + bottom), title, "m", angle=-90)

    def heading(self, words: str) -> None:
        """Write a title over the left end."""
        self.sheet.text(self.box[0], self.box[1] - 6.0, words, "b")


def panel_below(
    sheet: Sheet, entries: Sequence[Entry], height: float, x: Range, y: Range, *,
    left: float = LEFT, top: float = 0.0, log: bool = False,
) -> Panel:  # fmt: skip
    """A legend, and below it the last panel of a sheet, over its full width."""
    top = sheet.legend(left, top, entries) + 6.0
    sheet.height = top + height + look.BELOW
    return Panel(sheet, (left, top, sheet.width - 10.0, top + height), x, y, log, log)


def even_ticks(low: float, high: float, most: int = 6) -> FloatArray:
    """Round numbers from low to high, at most about so many."""
    span = max(high - low, 1e-300)
    step = 10.0 ** np.floor(np.log10(span / most))
    step *= next(k for k in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0) if k * step * most >= span)
    first = np.ceil(low / step - 1e-9)
    ticks = step * np.arange(first, np.floor(high / step + 1e-9) + 1)
    return np.asarray(ticks + 0.0, dtype=float)  # no -0


def log_ticks(low: float, high: float, subs: Sequence[float] = (1.0, 2.0, 5.0)) -> FloatArray:
    """1, 2, 5 in each decade from low to high."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.unique(np.outer(decades, subs).ravel())
    return np.asarray(ticks[(ticks >= low * 0.999) & (ticks <= high * 1.001)], dtype=float)


def _scaled(values: ArrayLike, ends: Range, log: bool, start: float, stop: float) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        given, low, high = (
            np.log(each) if log else np.asarray(each, dtype=float) for each in (values, *ends)
        )
    return np.asarray(start + (given - low) / (high - low) * (stop - start))


def _labels(ticks: ArrayLike) -> list[str]:
    return [f"{tick:g}" for tick in np.atleast_1d(ticks)]
