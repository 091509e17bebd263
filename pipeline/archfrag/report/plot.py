"""Drawings of the report, written as SVG: at the width they are read at, in milliseconds.

Every figure is drawn twice, for the page's column and for a narrow screen, with the same fonts.
Texts are measured by a width that is above that of the fonts they are shown in, and every text
leaves its box, so that tests can see that none covers another.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.report import picture as look
from archfrag.report.picture import BELOW, BESIDE, LINE, FloatArray, Picture, number, text_width

# White patterns that lie over a colour, held once by the page.
HATCHES = {
    "slash": '<path d="M-1 7L7 -1M-1 1L1 -1M5 7L7 5" stroke="#fff" stroke-width="1.3"/>',
    "dots": '<path d="M2 2h2v2h-2z" fill="#fff"/>',
    "cross": '<path d="M0 0L6 6M6 0L0 6" stroke="#fff" stroke-width="1.1"/>',
}
Box = tuple[float, float, float, float]  # left, top, right, bottom [px]


class Entry(NamedTuple):
    """One line of a legend; `mark` is line, dash, dot, ring, area or a hatch."""

    label: str
    colour: str
    mark: str = "area"


def hatch_definitions() -> str:
    """The patterns of `HATCHES`, to be held once by a page."""
    patterns = "".join(
        f'<pattern id="hatch-{name}" width="6" height="6" patternUnits="userSpaceOnUse">'
        f"{shape}</pattern>"
        for name, shape in HATCHES.items()
    )
    return (
        '<svg width="0" height="0" style="position:absolute" aria-hidden="true"><defs>'
        f"{patterns}</defs></svg>"
    )


def picture(
    draw: Callable[["Sheet"], None], *, alternative: str, caption: str = "", narrow: bool = True
) -> Picture:
    """Draw a figure for the page's column and for a narrow screen."""
    drawn = ""
    for width in (look.NARROW, look.WIDE) if narrow else (look.WIDE,):
        draw(sheet := Sheet(width))
        small, drawn = drawn, sheet.svg(alternative)
    return Picture(drawn, caption, small)


class Sheet:
    """A drawing of a given width [px]; `height` is set once it is known."""

    def __init__(self, width: float) -> None:
        self.width, self.height = width, 0.0
        self.parts: list[str] = []
        self.boxes: list[tuple[str, float, float, float, float]] = []
        self.panels: list[Panel] = []

    @property
    def narrow(self) -> bool:
        """Whether panels go below each other."""
        return self.width < 560.0

    def text(self, x: float, y: float, words: str, kind: str = "", angle: int = 0) -> None:
        """Write words with their baseline at y; `kind` holds classes of `SVG_STYLE`."""
        size = look.SMALL if "s" in kind.split() else look.SIZE
        width = text_width(words, size)
        left = x - width * (0.5 if "m" in kind.split() else 1.0 if "e" in kind.split() else 0.0)
        if angle:
            self.boxes.append((words, x - 0.8 * size, y - 0.5 * width, x, y + 0.5 * width))
        else:
            self.boxes.append((words, left, y - 0.75 * size, left + width, y + 0.2 * size))
        rotated = f' transform="rotate({angle} {number(x)} {number(y)})"' if angle else ""
        named = f' class="{kind}"' if kind else ""
        self.parts.append(
            f'<text x="{number(x)}" y="{number(y)}"{named}{rotated}>{escape(words)}</text>'
        )

    def path(self, d: str, **attributes: object) -> None:
        """Add a path; attributes with an underscore for a hyphen, `kind` for the class."""
        written = "".join(
            f' {"class" if key == "kind" else key.replace("_", "-")}="{value}"'
            for key, value in attributes.items()
            if value not in ("", None)
        )
        if d:
            self.parts.append(f'<path d="{d}"{written}/>')

    def fill(self, d: str, colour: str, mark: str = "area") -> None:
        """Add a filled path, with its hatch if the mark is one."""
        self.path(d, fill=colour)
        if mark in HATCHES:
            self.path(d, fill=f"url(#hatch-{mark})")

    def legend(
        self, x: float, y: float, entries: Sequence[Entry], width: float | None = None
    ) -> float:
        """Rows of marks and labels from y downwards, as wide as the sheet; where they end."""
        row = 0
        for row, place, (label, colour, mark) in _rows(entries, width or self.width - x - 10.0):
            self._mark(x + place, y + row * LINE, colour, mark)
            self.text(x + place + 20.0, y + row * LINE + 10.0, label)
        return y + (row + 1) * LINE + 3.0 if entries else y

    @staticmethod
    def legend_rows(entries: Sequence[Entry], width: float) -> int:
        """Rows that `legend` takes."""
        return 1 + max((row for row, _, _ in _rows(entries, width)), default=0)

    def below_legend(
        self, entries: Sequence[Entry], height: float, x: tuple[float, float],
        y: tuple[float, float], *, left: float = BESIDE, top: float = 0.0, log: bool = False,
    ) -> "Panel":  # fmt: skip
        """A legend, and below it the last panel of the sheet, over its full width."""
        top = self.legend(left, top, entries) + 6.0
        self.height = top + height + BELOW
        return Panel(self, (left, top, self.width - 10.0, top + height), x, y, log, log)

    def _mark(self, x: float, y: float, colour: str, mark: str) -> None:
        if mark in ("line", "dash"):
            self.path(
                f"M{number(x)} {number(y + 6.0)}h16", stroke=colour, stroke_width=1.8,
                fill="none", stroke_dasharray="4 2.5" if mark == "dash" else "",
            )  # fmt: skip
        elif mark in ("dot", "ring"):
            self.path(look.symbol(x + 8.0, y + 6.0, 3.2), **_dotted(colour, mark))
        else:
            self.fill(f"M{number(x + 2)} {number(y + 1)}h13v10h-13z", colour, mark)

    def panes(
        self, count: int, top: float, height: float, gap: float = 10.0, left: float = BESIDE
    ) -> tuple[list[Box], float]:
        """Boxes of panels, beside each other or on a narrow sheet below each other.

        The first panel begins with its heading at `top`; `height` is without heading, labels and
        title, `left` is for the axis of each. And where what comes below may begin [px].
        """
        start = top + LINE + 3.0
        if self.narrow:
            step = height + BELOW + LINE + gap
            tops = [start + i * step for i in range(count)]
            boxes = [(left, y, self.width - 14.0, y + height) for y in tops]
        else:
            each = (self.width - count * left - (count - 1) * gap - 14.0) / count
            lefts = [left + i * (each + gap + left) for i in range(count)]
            boxes = [(x, start, x + each, start + height) for x in lefts]
        return boxes, boxes[-1][3] + BELOW

    def svg(self, alternative: str) -> str:
        """All of it as an <svg> element with a name."""
        return (
            f'<svg viewBox="0 0 {number(self.width)} {number(self.height)}" role="img" '
            f'aria-label="{escape(alternative, quote=True)}">{"".join(self.parts)}</svg>'
        )


def _rows(entries: Sequence[Entry], width: float) -> Iterator[tuple[int, float, Entry]]:
    """Row and distance from its start of each line of a legend, with a label that fits."""
    row, place = 0, 0.0
    for entry in entries:
        label = look.shortened(entry.label, width - 22.0)
        need = 22.0 + text_width(label)
        if place > 0.0 and place + need > width:
            row, place = row + 1, 0.0
        yield row, place, entry._replace(label=label)
        place += need + 12.0


def _dotted(colour: str, mark: str) -> dict[str, str]:
    if mark == "dot":
        return {"fill": colour}
    return {"fill": "#fff", "stroke": colour, "stroke_width": "1.4"}


@dataclass
class Panel:
    """Axes on a sheet: a box in pixels and the ranges that it shows."""

    sheet: Sheet
    box: Box
    x: tuple[float, float]
    y: tuple[float, float]
    log_x: bool = False
    log_y: bool = False

    def __post_init__(self) -> None:
        self.sheet.panels.append(self)

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
            look.trace(self.at_x(x), self.at_y(y)), fill="none", stroke=colour,
            stroke_width=width, stroke_dasharray=dash, stroke_opacity=opacity,
            stroke_linejoin="round",
        )  # fmt: skip

    def band(
        self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, opacity: float = 0.3
    ) -> None:
        """Fill between two curves."""
        across, lower, upper = self.at_x(x), self.at_y(low), self.at_y(high)
        d = look.trace(np.append(across, across[::-1]), np.append(upper, lower[::-1]))
        self.sheet.path(d + "z" if d else "", fill=colour, fill_opacity=opacity)

    def dots(
        self, x: ArrayLike, y: ArrayLike, colour: str, mark: str = "dot", radius: float = 3.0
    ) -> None:
        """Marks at points."""
        places = zip(self.at_x(x), self.at_y(y), strict=True)
        d = "".join(look.symbol(a, b, radius) for a, b in places if np.isfinite(a + b))
        self.sheet.path(d, **_dotted(colour, mark))

    def errors(self, x: ArrayLike, low: ArrayLike, high: ArrayLike) -> None:
        """Upright bars with caps."""
        d = "".join(
            f"M{number(a - 2)} {number(b)}h4m-2 0V{number(c)}m-2 0h4"
            for a, b, c in zip(self.at_x(x), self.at_y(low), self.at_y(high), strict=True)
            if np.isfinite(b + c)
        )
        self.sheet.path(d, stroke=look.INK, stroke_width=0.9, fill="none")

    def boxes(
        self, left: ArrayLike, right: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str,
        mark: str = "area",
    ) -> None:  # fmt: skip
        """Rectangles of one colour, as one path."""
        edges = np.broadcast_arrays(
            self.at_x(left), self.at_x(right), self.at_y(high), self.at_y(low)
        )
        d = "".join(
            f"M{number(a)} {number(c)}H{number(b)}V{number(e)}H{number(a)}z"
            for a, b, c, e in zip(*(np.ravel(edge) for edge in edges), strict=True)
        )
        self.sheet.fill(d, colour, mark)

    def cells(
        self, mask: NDArray[np.bool_], colour: str, mark: str = "area",
        edges: FloatArray | None = None, half: float = 0.5,
    ) -> None:  # fmt: skip
        """Cells of a mask, (n_row, n_column), about 0, 1, 2, ...; neighbours of a row are joined.

        `edges` are those of the columns, (n_column + 1,); `half` is half the height of a cell.
        """
        x = np.arange(mask.shape[1] + 1) - 0.5 if edges is None else edges
        steps = np.diff(mask.astype(int), axis=1, prepend=0, append=0)
        (row, first), (_, last) = np.nonzero(steps > 0), np.nonzero(steps < 0)
        self.boxes(x[first], x[last], row - half, row + half, colour, mark)

    def stack(self, parts: Sequence[tuple[Entry, FloatArray]]) -> None:
        """Columns at 0, 1, 2, ... of parts (n_column,) over each other."""
        base = np.zeros(len(parts[0][1]) if parts else 0)
        for (_, colour, mark), part in parts:
            here = np.flatnonzero(part)
            low, high = base[here], base[here] + part[here]
            self.boxes(here - 0.42, here + 0.42, low, high, colour, mark)
            base = base + part

    def axis_x(
        self, ticks: ArrayLike, title: str = "", labels: Sequence[str] | None = None,
        grid: bool = False,
    ) -> None:  # fmt: skip
        """Ticks below; a label that would come too close to the one before is left out."""
        left, top, right, bottom = self.box
        places = self.at_x(np.atleast_1d(ticks))
        if grid:
            lines = (f"M{number(x)} {number(top)}V{number(bottom)}" for x in places)
            self.sheet.path("".join(lines), kind="gr")
        marks = "".join(f"M{number(x)} {number(bottom)}v3" for x in places)
        self.sheet.path(f"M{number(left)} {number(bottom)}H{number(right)}{marks}", kind="ax")
        end = -np.inf
        for x, label in zip(places, _labels(ticks, labels), strict=True):
            half = 0.5 * text_width(label, look.SMALL)
            if x - half >= end + 5.0:
                self.sheet.text(x, bottom + 14.0, label, "s m")
                end = x + half
        if title:
            self.sheet.text(0.5 * (left + right), bottom + 29.0, title, "m")

    def axis_y(
        self, ticks: ArrayLike, title: str = "", labels: Sequence[str] | None = None,
        grid: bool = True,
    ) -> None:  # fmt: skip
        """Ticks on the left, the title upright beside them."""
        left, top, right, bottom = self.box
        places = self.at_y(np.atleast_1d(ticks))
        if grid:
            lines = (f"M{number(left)} {number(y)}H{number(right)}" for y in places)
            self.sheet.path("".join(lines), kind="gr")
        self.sheet.path(f"M{number(left)} {number(top)}V{number(bottom)}", kind="ax")
        end, widest = np.inf, 0.0
        for y, label in zip(places, _labels(ticks, labels), strict=True):
            if y <= end - 11.0:
                self.sheet.text(left - 5.0, y + 3.5, label, "s e")
                widest, end = max(widest, text_width(label, look.SMALL)), y
        if title:
            self.sheet.text(left - widest - 11.0, 0.5 * (top + bottom), title, "m", angle=-90)

    def level_axis(self, levels: FloatArray, title: str) -> None:
        """Labels under cells that stand for levels, the first always among them."""
        most = max(2, int((self.box[2] - self.box[0]) / 38.0))
        ticks = np.arange(0, levels.size, max(1, -(-levels.size // most)))
        self.axis_x(ticks, title, [look.digits(levels[i]) for i in ticks])

    def heading(self, words: str) -> None:
        """A title over the left end."""
        self.sheet.text(self.box[0], self.box[1] - 6.0, words, "b")


def _labels(ticks: ArrayLike, labels: Sequence[str] | None) -> Sequence[str]:
    return [f"{tick:g}" for tick in np.atleast_1d(ticks)] if labels is None else labels


def _scaled(
    values: ArrayLike, ends: tuple[float, float], log: bool, start: float, stop: float
) -> FloatArray:
    given: FloatArray = np.asarray(values, dtype=float)
    low, high = ends
    if log:
        with np.errstate(divide="ignore", invalid="ignore"):
            given = np.log(given)
        low, high = float(np.log(low)), float(np.log(high))
    return np.asarray(start + (given - low) / (high - low) * (stop - start), dtype=float)
