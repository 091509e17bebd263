"""Figures as SVG, drawn once for the page's column and once for a phone.

No font is known here: the width of a text is estimated from above.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from html import escape
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Box = tuple[float, float, float, float]  # left, top, right, bottom [px]
WIDE, NARROW = 760.0, 358.0  # widths of figures [px]
SIZE, SMALL = 11.5, 10.0  # of texts [px]
LINE = 15.0  # [px]
BELOW, LEFT = 36.0, 48.0  # space for labels and title below a panel and left of it [px]
# Okabe and Ito's palette: distinct with any kind of colour vision.
BLUE, SKY, GREEN, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#E69F00"
VERMILION, PURPLE = "#D55E00", "#CC79A7"
INK, SOFT, GREY, PALE = "#1f2933", "#52606d", "#7b8794", "#d3dae2"
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
# White patterns that lie over a colour.
HATCHES = {
    "slash": '<path d="M-1 7L7 -1M-1 1L1 -1M5 7L7 5" stroke="#fff" stroke-width="1.3"/>',
    "dots": '<path d="M2 2h2v2h-2z" fill="#fff"/>',
    "cross": '<path d="M0 0L6 6M6 0L0 6" stroke="#fff" stroke-width="1.1"/>',
}
# The page holds the style and the hatches once, for all of its figures.
STYLE = (
    'svg text{font:11.5px "Helvetica Neue",Helvetica,Arial,"Liberation Sans","DejaVu Sans",'
    f"sans-serif;fill:{INK}}}"
    "svg .s{font-size:10px}svg .b{font-weight:600}"
    "svg .m{text-anchor:middle}svg .e{text-anchor:end}"
    f"svg .q{{fill:{SOFT}}}"
    "svg .stone{fill:#e9e4da;stroke:#8d8473}"
    f"svg .ax{{stroke:{GREY};stroke-width:.8;fill:none}}"
    f"svg .gr{{stroke:{PALE};stroke-width:.6;fill:none}}"
)
PATTERNS = "".join(
    f'<pattern id="hatch-{name}" width="6" height="6" patternUnits="userSpaceOnUse">{shape}'
    "</pattern>"
    for name, shape in HATCHES.items()
)


class Entry(NamedTuple):
    """One line of a legend; `mark` is line, dash, dot, ring, area or a hatch."""

    label: str
    colour: str
    mark: str = "area"


@dataclass(frozen=True)
class Picture:
    """A figure with its caption."""

    svg: str  #: or HTML
    caption: str
    narrow: str = ""  #: for narrow screens; empty where `svg` serves all widths

    def __html__(self) -> str:
        shown = self.svg
        if self.narrow:
            shown = f'<div class="broad">{shown}</div><div class="slim">{self.narrow}</div>'
        return f"<figure>\n{shown}\n<figcaption>{escape(self.caption)}</figcaption>\n</figure>"

    @property
    def file(self) -> str:
        """The figure with its caption as the text of an SVG file of its own."""
        spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        inside = (
            f"<desc>{escape(self.caption)}</desc><style>{STYLE}</style>"
            '<rect width="100%" height="100%" fill="white"/>'
        )
        svg = self.svg.replace("<svg ", f"<svg {spaces} ", 1)
        return svg.replace(">", f">{inside}", 1) + "\n"


def figure(draw: Callable[..., tuple[str, str] | None]) -> Callable[..., Any]:
    """Make a function that draws on a sheet return a `Picture`, drawn for both widths.

    `draw` gets the sheet before its other arguments. It returns the alternative text and the
    caption, or None if there is nothing to show; so does the function made of it.
    """

    @wraps(draw)
    def drawn(*arguments: Any, **named: Any) -> Picture | None:
        sheets = Sheet(NARROW), Sheet(WIDE)
        words = [draw(sheet, *arguments, **named) for sheet in sheets][-1]
        if words is None:
            return None
        narrow, wide = (sheet.svg(words[0]) for sheet in sheets)
        return Picture(wide, words[1], narrow)

    return drawn


class Sheet:
    """A drawing of a given width [px]; `height` is set once it is known."""

    def __init__(self, width: float) -> None:
        self.width, self.height = width, 0.0
        self.narrow = width < 560.0  # panels go below each other
        self.parts: list[str] = []

    def text(self, x: float, y: float, words: str, kind: str = "", angle: int = 0) -> None:
        """Write words with their baseline at y; `kind` holds classes of `STYLE`."""
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

    def dots(
        self, points: Sequence[tuple[float, float]], radius: float, colour: str, mark: str = "dot"
    ) -> None:
        """Add circles of one colour: full (dot), with a white edge (hinge) or empty (ring)."""
        r, diameter = number(radius), number(2.0 * radius)
        circle = f"a{r} {r} 0 1 0 {diameter} 0a{r} {r} 0 1 0 -{diameter} 0z"
        d = "".join(f"M{number(x - radius)} {number(y)}{circle}" for x, y in points)
        edge = {"ring": colour, "hinge": "#fff"}.get(mark, "")
        self.path(d, fill="#fff" if mark == "ring" else colour, stroke=edge)

    def legend(
        self, x: float, y: float, entries: Sequence[Entry], width: float | None = None
    ) -> float:
        """Draw rows of marks and labels from y downwards; return where they end."""
        row = 0
        for row, place, (label, colour, mark) in legend_rows(
            entries, width or self.width - x - 10.0
        ):
            left, top = x + place, y + row * LINE
            if mark in ("line", "dash"):
                self.path(
                    f"M{number(left)} {number(top + 6.0)}h16", stroke=colour, stroke_width=1.8,
                    fill="none", stroke_dasharray="4 2.5" if mark == "dash" else "",
                )  # fmt: skip
            elif mark in ("dot", "ring"):
                self.dots([(left + 8.0, top + 6.0)], 3.2, colour, mark)
            else:
                self.fill(f"M{number(left + 2)} {number(top + 1)}h13v10h-13z", colour, mark)
            self.text(left + 20.0, top + 10.0, label)
        return y + (row + 1) * LINE + 3.0 if entries else y

    def boxes(
        self, count: int, top: float, height: float, gap: float = 10.0, left: float = LEFT
    ) -> list[Box]:
        """Place panels with headings in a row, or on a narrow sheet in a column.

        The first heading begins at `top`; `height` is without heading, labels and title; `left`
        is for the axis of each.
        """
        start = top + LINE + 3.0
        if self.narrow:
            step = height + BELOW + LINE + gap
            tops = [start + i * step for i in range(count)]
            return [(left, y, self.width - 14.0, y + height) for y in tops]
        each = (self.width - count * left - (count - 1) * gap - 14.0) / count
        lefts = [left + i * (each + gap + left) for i in range(count)]
        return [(x, start, x + each, start + height) for x in lefts]

    def svg(self, alternative: str) -> str:
        """The drawing as an <svg> element with an alternative text."""
        return (
            f'<svg viewBox="0 0 {number(self.width)} {number(self.height)}" role="img" '
            f'aria-label="{escape(alternative, quote=True)}">{"".join(self.parts)}</svg>'
        )


def legend_rows(entries: Sequence[Entry], width: float) -> Iterator[tuple[int, float, Entry]]:
    """Row and distance from its start of each line of a legend, with a label that fits."""
    row, place = 0, 0.0
    for entry in entries:
        label = shortened(entry.label, width - 22.0)
        need = 22.0 + text_width(label)
        if place > 0.0 and place + need > width:
            row, place = row + 1, 0.0
        yield row, place, entry._replace(label=label)
        place += need + 12.0


def number(value: float) -> str:
    """A coordinate to a tenth of a pixel."""
    return f"{value:.1f}".removesuffix(".0").replace("-0.", "-.").removeprefix("-0") or "0"


def text_width(words: str, size: float = SIZE) -> float:
    """Width of a text [px], from above."""
    classes = ((1.0, "mwMW%"), (0.36, "il.,:;|'!() "))
    return size * sum(
        1.0 if ord(c) > 0x2E80
        else next((width for width, some in classes if c in some), 0.72 if c.isupper() else 0.6)
        for c in words
    )  # fmt: skip


def shortened(words: str, width: float, size: float = SIZE) -> str:
    """A text that fits a width; a long one loses its middle."""
    if text_width(words, size) <= width:
        return words
    fitting = (n for n in range(len(words), 4, -1) if text_width(words[:n], size) + size <= width)
    keep = next(fitting, 4)
    return words[: keep // 2] + "…" + words[len(words) - (keep - keep // 2) :]


def trace(x: FloatArray, y: FloatArray) -> str:
    """Path through points, with a gap where one is not finite."""
    points = (
        f"{number(a)} {number(b)}" if np.isfinite(a + b) else "" for a, b in zip(x, y, strict=True)
    )
    lines = ("M" + " ".join(line) for seen, line in groupby(points, bool) if seen)
    return "".join(lines).replace(" -", "-")
