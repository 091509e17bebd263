"""Sheets that figures are drawn on as SVG, once for the page's column and once for a phone.

Texts are measured by a width that is above that of the fonts they are shown in.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from html import escape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Box = tuple[float, float, float, float]  # left, top, right, bottom [px]
WIDE, NARROW = 760.0, 358.0  # widths that figures are drawn for [px]
SIZE, SMALL = 11.5, 10.0  # of texts [px]
LINE = 15.0  # [px]
BELOW, BESIDE = 36.0, 48.0  # pixels that labels and title need below a panel and left of it
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
# What the page holds once for all of its figures: their style and their hatches.
STYLE = (
    'svg text{font:11.5px "Helvetica Neue",Helvetica,Arial,"Liberation Sans","DejaVu Sans",'
    f"sans-serif;fill:{INK}}}"
    "svg .s{font-size:10px}svg .b{font-weight:600}"
    "svg .m{text-anchor:middle}svg .e{text-anchor:end}"
    f"svg .q{{fill:{SOFT}}}svg .w{{fill:#fff}}"
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
    """A figure ready for the page."""

    svg: str  #: inline SVG, or HTML that holds several
    caption: str  #: what stands under it
    narrow: str = ""  #: drawn anew for narrow screens; empty where `svg` serves all widths

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
    """Make a figure of a function that draws on a sheet.

    The function gets the sheet before its other arguments. It returns the figure's alternative
    text and its caption, or None if there is nothing to show. What is made returns a `Picture` or
    None.
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
        r, across = number(radius), number(2.0 * radius)
        circle = f"a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0z"
        d = "".join(f"M{number(x - radius)} {number(y)}{circle}" for x, y in points)
        edge = {"ring": colour, "hinge": "#fff"}.get(mark, "")
        self.path(d, fill="#fff" if mark == "ring" else colour, stroke=edge)

    def legend(
        self, x: float, y: float, entries: Sequence[Entry], width: float | None = None
    ) -> float:
        """Rows of marks and labels from y downwards, as wide as the sheet; where they end."""
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
    """A text that fits a width, its middle left out where it is too long."""
    if text_width(words, size) <= width:
        return words
    keep = len(words)
    while keep > 4 and text_width(words[:keep], size) + size > width:
        keep -= 1
    return words[: keep // 2] + "…" + words[len(words) - (keep - keep // 2) :]


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
