"""Figures as SVG, as wide as the page's column; a phone scrolls them sideways.

A `Sheet` takes pixels; a `Panel` on it takes the units of its axes. No font is known here: the
width of a text is estimated from above.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from html import escape
from itertools import groupby, pairwise
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.fragility.curve import FloatArray, Triple
from archfrag.report.html import TEXTS, Picture, px, raised

Range = tuple[float, float]
Words = tuple[str, str]  # alternative text and caption of a figure
Box = tuple[float, float, float, float]  # left, top, right, bottom [px]
WIDE = 760.0  # widths of figures [px]
NARROW = 358.0
READABLE = 0.65  # scale below which a figure does not shrink
SIZE = 11.5  # of texts [px]
SMALL = 10.0
LINE = 15.0  # [px]
BELOW = 36.0  # space for labels and title below a panel and left of it [px]
LEFT = 48.0
# Okabe and Ito's palette: distinct with any kind of colour vision.
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
INK = "#1f2933"
SOFT = "#52606d"
GREY = "#7b8794"
PALE = "#d3dae2"
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)


class Entry(NamedTuple):
    """One line of a legend; `mark` is line, dash, dot, ring, area or a hatch."""

    label: str
    colour: str
    mark: str = "area"

    @property
    def dash(self) -> str:
        return "5 2.5" if self.mark == "dash" else ""


def figure(
    draw: Callable[..., str | Words | None], width: float = WIDE
) -> Callable[..., Any]:
    """Turn a function that draws on a sheet into one that returns a `Picture`.

    `width` is that of the sheet [px]. `draw` returns the alternative text and the caption, or the
    text only if `TEXTS` has the caption under the function's name, or None if there is nothing to
    show.
    """

    @wraps(draw)
    def drawn(*arguments, **named) -> Picture | None:
        sheet = Sheet(width)
        words = draw(sheet, *arguments, **named)
        if words is None:
            return None
        if isinstance(words, str):
            words = words, TEXTS[draw.__name__]["caption"]
        return Picture(sheet.svg(words[0]), words[1])

    return drawn


class Sheet:
    """Drawing of a given width [px]; the functions that draw on it set its `height`."""

    def __init__(self, width: float) -> None:
        self.width = width
        self.height = 0.0
        self.parts: list[str] = []

    def text(
        self, x: float, y: float, words: str, kind: str = "", angle: int = 0
    ) -> None:
        """Write words with their baseline at y; `kind` holds classes of `STYLE`."""
        place = f'x="{px(x)}" y="{px(y)}"'
        more = f' class="{kind}"' if kind else ""
        if angle:
            more += f' transform="rotate({angle} {px(x)} {px(y)})"'
        self.parts.append(f"<text {place}{more}>{escape(words)}</text>")

    def path(self, d: str, **attributes: object) -> None:
        """Add a path with data `d`; nothing if it is empty.

        Attributes have an underscore for a hyphen; `kind` is the class.
        """
        written = ""
        for key, value in attributes.items():
            if value not in ("", None):
                written += (
                    f' {key.replace("_", "-").replace("kind", "class")}="{value}"'
                )
        if d:
            self.parts.append(f'<path d="{d}"{written}/>')

    def fill(self, d: str, colour: str, mark: str = "area") -> None:
        """Add a filled path, hatched if `mark` is the name of a hatch."""
        self.path(d, fill=colour)
        if mark != "area":  # a white pattern, which the page's template draws
            self.path(d, fill=f"url(#hatch-{mark})")

    def dots(
        self,
        points: Sequence[tuple[float, float]],
        radius: float,
        colour: str,
        mark: str = "dot",
    ) -> None:
        """Add circles of one colour: full (dot), with a white edge (hinge) or empty (ring)."""
        arc = f"a{px(radius)} {px(radius)} 0 1 0"
        circle = f"{arc} {px(2.0 * radius)} 0{arc} -{px(2.0 * radius)} 0z"
        d = "".join(f"M{px(x - radius)} {px(y)}{circle}" for x, y in points)
        edge = {"ring": colour, "hinge": "#fff"}.get(mark, "")
        self.path(d, fill="#fff" if mark == "ring" else colour, stroke=edge)

    def legend(
        self, x: float, y: float, entries: Sequence[Entry], width: float | None = None
    ) -> float:
        """Draw rows of marks and labels from y downwards; return where they end."""
        rows = legend_rows(entries, width or self.width - x - 10.0)
        for row, place, (label, colour, mark) in rows:
            left = x + place
            top = y + row * LINE
            if mark in ("line", "dash"):
                dash = "4 2.5" if mark == "dash" else ""
                d = f"M{px(left)} {px(top + 6.0)}h16"
                self.path(d, stroke=colour, stroke_width=1.8, stroke_dasharray=dash)
            elif mark in ("dot", "ring"):
                self.dots([(left + 8.0, top + 6.0)], 3.2, colour, mark)
            else:
                area = f"M{px(left + 2)} {px(top + 1)}h13v10h-13z"
                self.fill(area, colour, mark)
            self.text(left + 20.0, top + 10.0, label)
        return y + (rows[-1][0] + 1) * LINE + 3.0 if rows else y

    def grid(self, count: int, columns: int, height: float, below: float) -> list[Box]:
        """Return boxes of panels with headings, in rows that are `below` apart."""
        columns = min(columns, count)
        width = (self.width - 4.0) / columns
        step = LINE + 3.0 + height + below
        self.height = -(-count // columns) * step
        boxes = list[Box]()
        for place in range(count):
            left = place % columns * width
            top = place // columns * step + LINE + 3.0
            boxes.append((left + LEFT, top, left + width - 10.0, top + height))
        return boxes

    def svg(self, alternative: str) -> str:
        """Return the sheet as an SVG element with its alternative text."""
        size = f'viewBox="0 0 {px(self.width)} {px(self.height)}"'
        style = f'style="min-width:{px(READABLE * self.width)}px"'
        label = escape(alternative, quote=True)
        inside = "".join(self.parts)
        return f'<svg {size} role="img" {style} aria-label="{label}">{inside}</svg>'


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
        """Return pixels of values on the horizontal axis."""
        return _scaled(values, self.x, self.log_x, self.box[0], self.box[2])

    def at_y(self, values: ArrayLike) -> FloatArray:
        """Return pixels of values on the vertical axis."""
        return _scaled(values, self.y, self.log_y, self.box[3], self.box[1])

    def line(
        self,
        x: ArrayLike,
        y: ArrayLike,
        colour: str = INK,
        width: float = 1.6,
        dash: str = "",
        opacity: float | None = None,
    ) -> None:
        """Draw a line, with a gap where a point is not finite."""
        self.sheet.path(
            trace(self.at_x(x), self.at_y(y)),
            fill="none",
            stroke=colour,
            stroke_width=width,
            stroke_dasharray=dash,
            stroke_opacity=opacity,
            stroke_linejoin="round",
        )

    def upright(self, x: float, colour: str = GREY) -> None:
        """Draw a dotted line at `x` over the height of the panel."""
        self.line([x, x], self.y, colour, 0.9, "2 2")

    def band(
        self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, opacity: float
    ) -> None:
        d = ribbon(self.at_x(x), self.at_y(low), self.at_y(high))
        self.sheet.path(d, fill=colour, fill_opacity=opacity)

    def dots(
        self,
        x: ArrayLike,
        y: ArrayLike,
        colour: str,
        mark: str = "dot",
        radius: float = 3.0,
    ) -> None:
        points = zip(self.at_x(x), self.at_y(y), strict=True)
        self.sheet.dots(
            [p for p in points if np.isfinite(sum(p))], radius, colour, mark
        )

    def boxes(
        self,
        left: ArrayLike,
        right: ArrayLike,
        low: ArrayLike,
        high: ArrayLike,
        colour: str,
        mark: str = "area",
    ) -> None:
        """Fill rectangles with one colour, as one path."""
        sides = self.at_x(left), self.at_x(right), self.at_y(high), self.at_y(low)
        corners = zip(*(map(px, side) for side in sides), strict=True)
        d = "".join(f"M{a} {c}H{b}V{e}H{a}z" for a, b, c, e in corners)
        self.sheet.fill(d, colour, mark)

    def cells(
        self,
        mask: NDArray[np.bool_],
        colour: str,
        mark: str = "area",
        edges: FloatArray | None = None,
        half: float = 0.5,
    ) -> None:
        """Fill the cells where a mask, (n_row, n_column), is true; neighbours in a row join.

        Rows and columns are at 0, 1, 2, ... `edges`, (n_column + 1,), are other edges of the
        columns; `half` is half the height of a cell.
        """
        x = np.arange(mask.shape[1] + 1) - 0.5 if edges is None else edges
        steps = np.diff(mask.astype(int), axis=1, prepend=0, append=0)
        row, first = np.nonzero(steps > 0)
        _, last = np.nonzero(steps < 0)
        self.boxes(x[first], x[last], row - half, row + half, colour, mark)

    def stack(self, parts: Sequence[tuple[Entry, FloatArray]]) -> None:
        """Draw stacked columns at 0, 1, 2, ...; each part, (n_column,), lies on the one before."""
        base = np.zeros(len(parts[0][1]) if parts else 0)
        for (_, colour, mark), part in parts:
            here = np.flatnonzero(part)
            low = base
            base = base + part
            self.boxes(here - 0.42, here + 0.42, low[here], base[here], colour, mark)

    def axis_x(
        self,
        title: str = "",
        most: int = 6,
        *,
        ticks: NDArray | None = None,
        labels: Sequence[str] = (),
        grid: bool = False,
    ) -> None:
        """Draw the axis below the panel, with ticks, labels and a title.

        If `ticks` are not given, there are about `most` at most. A label too close to the one
        before is left out.
        """
        left, top, right, bottom = self.box
        values = _ticks(self.x, self.log_x, most) if ticks is None else ticks
        places = self.at_x(values)
        end = -np.inf
        if grid:
            lines = (f"M{px(x)} {px(top)}V{px(bottom)}" for x in places)
            self.sheet.path("".join(lines), kind="gr")
        marks = "".join(f"M{px(x)} {px(bottom)}v3" for x in places)
        base = f"M{px(left)} {px(bottom)}H{px(right)}"
        self.sheet.path(base + marks, kind="ax")
        for x, label in zip(places, labels or map(tick_label, values)):
            half = 0.5 * text_width(label, SMALL)
            if x - half >= end + 5.0:
                self.sheet.text(x, bottom + 14.0, label, "s m")
                end = x + half
        if title:
            self.sheet.text(0.5 * (left + right), bottom + 29.0, title, "m")

    def axis_y(
        self,
        title: str = "",
        most: int = 6,
        ticks: NDArray | None = None,
        labels: Sequence[str] = (),
    ) -> None:
        """Draw a grid with ticks on the left, and the title upright left of them."""
        left, top, right, bottom = self.box
        values = _ticks(self.y, self.log_y, most) if ticks is None else ticks
        places = self.at_y(values)
        end = np.inf
        widest = 0.0
        lines = (f"M{px(left)} {px(y)}H{px(right)}" for y in places)
        self.sheet.path("".join(lines), kind="gr")
        self.sheet.path(f"M{px(left)} {px(top)}V{px(bottom)}", kind="ax")
        for y, label in zip(places, labels or map(tick_label, values)):
            if y <= end - 11.0:
                self.sheet.text(left - 5.0, y + 3.5, label, "s e")
                widest = max(widest, text_width(label, SMALL))
                end = y
        x = left - widest - 11.0
        if title:
            self.sheet.text(x, 0.5 * (top + bottom), title, "m", angle=-90)

    def label(
        self, x: float, y: float, words: str, kind: str = "", left: bool = False
    ) -> None:
        """Write words right of `x`, or left of it if `left`, at the height `y` [px].

        If they have no room there, they stand on the other side.
        """
        place = float(self.at_x(x))
        need = text_width(words) + 7.0
        left = place - need > self.box[0] if left else place + need > self.box[2]
        side = -6.0 if left else 6.0
        self.sheet.text(place + side, y, words, f"{kind} h{' e' * left}")

    def heading(self, words: str) -> None:
        """Write words above the panel."""
        self.sheet.text(self.box[0], self.box[1] - 6.0, words, "b")


def panel_below(
    sheet: Sheet,
    entries: Sequence[Entry],
    height: float,
    x: Range,
    y: Range,
    *,
    left: float = LEFT,
    log: bool = False,
) -> Panel:
    """Draw a legend; return a panel below it over the full width of the sheet."""
    top = sheet.legend(left, 0.0, entries) + 6.0
    sheet.height = top + height + BELOW
    return Panel(sheet, (left, top, sheet.width - 10.0, top + height), x, y, log, log)


def tick_label(value: float) -> str:
    """Return a number in the format :g, but with powers of ten: 0.2, 10⁻⁵, 5·10⁻⁵."""
    mantissa, _, power = f"{value:g}".partition("e")
    return f"{mantissa}·{raised(power)}".removeprefix("1·") if power else mantissa


def even_ticks(low: float, high: float, most: int = 6) -> FloatArray:
    """Return round numbers from low to high, about `most` of them at most."""
    span = max(high - low, 1e-300)
    step = 10.0 ** np.floor(np.log10(span / most))
    step *= next(k for k in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0) if k * step * most >= span)
    first = np.ceil(low / step - 1e-9)
    return step * np.arange(first, np.floor(high / step + 1e-9) + 1) + 0.0  # no -0


def log_ticks(
    low: float, high: float, subs: Sequence[float] = (1.0, 2.0, 5.0)
) -> FloatArray:
    """Return `subs` (1, 2 and 5) times powers of ten, from low to high."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.unique(np.outer(decades, subs))
    return ticks[(ticks >= low * 0.999) & (ticks <= high * 1.001)]


def legend_rows(
    entries: Sequence[Entry], width: float
) -> list[tuple[int, float, Entry]]:
    """Return row, distance from its start [px] and entry for each entry of a legend.

    Labels that are too long for `width` are shortened.
    """
    row = 0
    place = 0.0
    rows = []
    for entry in entries:
        label = shortened(entry.label, width - 22.0)
        need = 22.0 + text_width(label)
        if place > 0.0 and place + need > width:
            row += 1
            place = 0.0
        rows.append((row, place, entry._replace(label=label)))
        place += need + 12.0
    return rows


def text_width(words: str, size: float = SIZE) -> float:
    """Return an upper estimate of the width of a text [px]."""
    narrow, wide = (sum(c in some for c in words) for some in ("il.,:;|'!() ", "mwMW%"))
    wide += sum(ord(c) > 0x2E80 for c in words)
    upper = sum(c.isupper() and c not in "MW" for c in words)
    rest = len(words) - narrow - wide - upper
    return size * (0.36 * narrow + wide + 0.72 * upper + 0.6 * rest)


def shortened(words: str, width: float, size: float = SIZE) -> str:
    """Return a text that fits a width [px]; a longer one loses its middle."""
    if text_width(words, size) <= width:
        return words
    keep = len(words)
    while keep > 4 and text_width(words[:keep], size) + size > width:
        keep -= 1
    return words[: keep // 2] + "…" + words[len(words) - (keep - keep // 2) :]


def trace(x: FloatArray, y: FloatArray) -> str:
    """Return a path through points, with a gap where one is not finite."""
    pairs = np.stack([x, y], axis=1).tolist()
    points = [f"{px(a)} {px(b)}" if isfinite(a + b) else "" for a, b in pairs]
    lines = ("M" + " ".join(line) for seen, line in groupby(points, bool) if seen)
    return "".join(lines).replace(" -", "-")


def ribbon(x: FloatArray, low: FloatArray, high: FloatArray) -> str:
    """Return a closed path between two lines; empty without a point."""
    d = trace(np.append(x, x[::-1]), np.append(high, low[::-1]))
    return d + "z" if d else ""


def envelope(values: FloatArray, bins: int) -> Triple:
    """Divide samples into bins; return the middle, the minimum and the maximum of each.

    The middles are numbers of samples, from 0.
    """
    # Each bin starts with the last sample of the one before it: the trace stays connected.
    last = values.size - 1
    edges = np.unique(np.linspace(0, last, min(bins, last) + 1, dtype=int))
    pieces = [values[a : b + 1] for a, b in pairwise(edges)]
    low, high = (np.array(list(map(end, pieces))) for end in (np.min, np.max))
    return 0.5 * (edges[:-1] + edges[1:]), low, high


def _scaled(
    values: ArrayLike, ends: Range, log: bool, start: float, stop: float
) -> FloatArray:
    numbers = np.asarray(values, dtype=float)
    low, high = np.log(ends) if log else ends
    if log:
        with np.errstate(divide="ignore", invalid="ignore"):
            numbers = np.log(numbers)
    return np.asarray(start + (numbers - low) / (high - low) * (stop - start))


def _ticks(ends: Range, log: bool, most: int) -> FloatArray:
    return log_ticks(*ends) if log else even_ticks(*ends, most)
