"""Drawings of the report, written as SVG: at the width they are read at, in milliseconds.

Every figure is drawn twice, for the page's column and for a narrow screen, with the same fonts.
Texts are measured by a width that is above that of the fonts they are shown in, and every text
leaves its box, so that tests can see that none covers another.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.report.picture import INK, Picture

FloatArray = NDArray[np.float64]

WIDE, NARROW = 760.0, 358.0  # [px]
SIZE, SMALL = 11.5, 10.0  # of texts [px]
LINE = 15.0  # [px]
# White patterns that lie over a colour, held once by the page.
HATCHES = {
    "slash": '<path d="M-1 7L7 -1M-1 1L1 -1M5 7L7 5" stroke="#fff" stroke-width="1.3"/>',
    "dots": '<path d="M2 2h2v2h-2z" fill="#fff"/>',
    "cross": '<path d="M0 0L6 6M6 0L0 6" stroke="#fff" stroke-width="1.1"/>',
}


class Entry(NamedTuple):
    """One line of a legend; `mark` is line, dash, dot, ring, square, area or a hatch."""

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
    draw: Callable[[float], "Sheet"], *, alternative: str, caption: str, narrow: bool = True
) -> Picture:
    """Draw a figure for the page's column and for a narrow screen."""
    return Picture(
        draw(WIDE).svg(alternative), caption, draw(NARROW).svg(alternative) if narrow else ""
    )


def number(value: float) -> str:
    """A coordinate to a tenth of a pixel."""
    return f"{value:.1f}".removesuffix(".0").replace("-0.", "-.").removeprefix("-0") or "0"


def text_width(words: str, size: float = SIZE) -> float:
    """Width of a text [px], from above."""
    return size * sum(
        1.0 if ord(c) > 0x2E80 else 0.32 if c in "il.,:;|'!() " else 0.6 for c in words
    )


def shortened(words: str, width: float, size: float = SIZE) -> str:
    """A text that fits a width, its middle left out where it is too long."""
    if text_width(words, size) <= width:
        return words
    keep = len(words)
    while keep > 4 and text_width(words[:keep], size) + size > width:
        keep -= 1
    return words[: keep // 2] + "…" + words[len(words) - (keep - keep // 2) :]


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
        size = SMALL if "s" in kind.split() else SIZE
        width = text_width(words, size)
        left = x - width * (0.5 if "m" in kind.split() else 1.0 if "e" in kind.split() else 0.0)
        if angle:
            self.boxes.append((words, x - 0.8 * size, y - 0.5 * width, x, y + 0.5 * width))
        else:
            self.boxes.append((words, left, y - 0.75 * size, left + width, y + 0.2 * size))
        turned = f' transform="rotate({angle} {number(x)} {number(y)})"' if angle else ""
        named = f' class="{kind}"' if kind else ""
        self.parts.append(
            f'<text x="{number(x)}" y="{number(y)}"{named}{turned}>{escape(words)}</text>'
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

    def legend(self, x: float, y: float, entries: Sequence[Entry], width: float) -> float:
        """Rows of marks and labels from y downwards; returns where they end."""
        place = x
        for label, colour, mark in entries:
            label = shortened(label, width - 22.0)
            need = 22.0 + text_width(label)
            if place > x and place + need > x + width:
                place, y = x, y + LINE
            self._mark(place, y, colour, mark)
            self.text(place + 20.0, y + 10.0, label)
            place += need + 12.0
        return y + LINE + 3.0 if entries else y

    @staticmethod
    def legend_rows(entries: Sequence[Entry], width: float) -> int:
        """Rows that `legend` takes."""
        rows, place = 1, 0.0
        for entry in entries:
            need = 22.0 + text_width(shortened(entry.label, width - 22.0))
            if place > 0.0 and place + need > width:
                rows, place = rows + 1, 0.0
            place += need + 12.0
        return rows

    def _mark(self, x: float, y: float, colour: str, mark: str) -> None:
        middle = number(y + 6.0)
        if mark in ("line", "dash"):
            self.path(
                f"M{number(x)} {middle}h16", stroke=colour, stroke_width=1.8, fill="none",
                stroke_dasharray="4 2.5" if mark == "dash" else "",
            )  # fmt: skip
        elif mark in ("dot", "ring", "square"):
            self.path(symbol(x + 8.0, y + 6.0, 3.2, mark == "square"), **_look(colour, mark))
        else:
            box = f"M{number(x + 2)} {number(y + 1)}h13v10h-13z"
            self.path(box, fill=colour)
            if mark in HATCHES:
                self.path(box, fill=f"url(#hatch-{mark})")

    def svg(self, alternative: str) -> str:
        """The whole as an <svg> element with a name."""
        return (
            f'<svg viewBox="0 0 {number(self.width)} {number(self.height)}" role="img" '
            f'aria-label="{escape(alternative, quote=True)}">{"".join(self.parts)}</svg>'
        )


def symbol(x: float, y: float, radius: float, square: bool = False) -> str:
    """Path of a dot or a square."""
    if square:
        side = number(2.0 * radius)
        return f"M{number(x - radius)} {number(y - radius)}h{side}v{side}h-{side}z"
    r = number(radius)
    across = number(2.0 * radius)
    return f"M{number(x - radius)} {number(y)}a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0z"


def _look(colour: str, mark: str) -> dict[str, str]:
    if mark == "dot":
        return {"fill": colour}
    return {"fill": "#fff", "stroke": colour, "stroke_width": "1.4"}


@dataclass
class Panel:
    """Axes on a sheet: a box in pixels and the ranges that it shows.

    Attributes
    ----------
    sheet : Sheet
    box : (float, float, float, float)
        Left, top, right, bottom [px].
    x, y : (float, float)
        Ranges.
    log_x, log_y : bool
    """

    sheet: Sheet
    box: tuple[float, float, float, float]
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
        self, x: ArrayLike, y: ArrayLike, colour: str = INK, width: float = 1.6, dash: str = "",
        opacity: float | None = None,
    ) -> None:  # fmt: skip
        """Join points, with a gap at each nan."""
        self.sheet.path(
            trace(self.at_x(x), self.at_y(y)), fill="none", stroke=colour, stroke_width=width,
            stroke_dasharray=dash, stroke_opacity=opacity, stroke_linejoin="round",
        )  # fmt: skip

    def band(
        self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, opacity: float = 0.3
    ) -> None:
        """Fill between two curves."""
        across, lower, upper = self.at_x(x), self.at_y(low), self.at_y(high)
        d = trace(np.append(across, across[::-1]), np.append(upper, lower[::-1]))
        self.sheet.path(d + "z" if d else "", fill=colour, fill_opacity=opacity)

    def dots(
        self, x: ArrayLike, y: ArrayLike, colour: str, mark: str = "dot", radius: float = 3.0
    ) -> None:
        """Marks at points."""
        places = zip(self.at_x(x), self.at_y(y), strict=True)
        d = "".join(
            symbol(a, b, radius, mark == "square") for a, b in places if np.isfinite(a + b)
        )
        self.sheet.path(d, **_look(colour, mark))

    def errors(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str = INK) -> None:
        """Upright bars with caps."""
        d = "".join(
            f"M{number(a - 2)} {number(b)}h4m-2 0V{number(c)}m-2 0h4"
            for a, b, c in zip(self.at_x(x), self.at_y(low), self.at_y(high), strict=True)
            if np.isfinite(b + c)
        )
        self.sheet.path(d, stroke=colour, stroke_width=0.9, fill="none")

    def boxes(
        self, left: ArrayLike, right: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str,
        hatch: str = "",
    ) -> None:  # fmt: skip
        """Rectangles of one colour, as one path."""
        edges = np.broadcast_arrays(
            self.at_x(left), self.at_x(right), self.at_y(high), self.at_y(low)
        )
        d = "".join(
            f"M{number(a)} {number(c)}H{number(b)}V{number(e)}H{number(a)}z"
            for a, b, c, e in zip(*(np.ravel(edge) for edge in edges), strict=True)
        )
        self.sheet.path(d, fill=colour)
        if hatch:
            self.sheet.path(d, fill=f"url(#hatch-{hatch})")


def trace(x: FloatArray, y: FloatArray) -> str:
    """Path through points, with a gap where one is not finite."""
    parts, pen = [], False
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not np.isfinite(a + b):
            pen = False
            continue
        parts.append(f"{'' if pen else 'M'}{number(a)} {number(b)}")
        pen = True
    return " ".join(parts).replace(" M", "M").replace(" -", "-")


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
