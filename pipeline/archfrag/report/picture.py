"""What a figure is once it is drawn; the colours, sizes, ticks and pieces of SVG of all."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
WIDE, NARROW = 760.0, 358.0  # widths that figures are drawn for [px]
SIZE, SMALL = 11.5, 10.0  # of texts [px]
LINE = 15.0  # [px]
BELOW, BESIDE = 36.0, 48.0  # pixels that labels and title need below a panel and left of it
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

# Texts and axes of figures that `archfrag.report.plot` draws; the page holds this once.
SVG_STYLE = (
    'svg text{font:11.5px "Helvetica Neue",Helvetica,Arial,"Liberation Sans","DejaVu Sans",'
    f"sans-serif;fill:{INK}}}"
    "svg .s{font-size:10px}svg .b{font-weight:600}"
    "svg .m{text-anchor:middle}svg .e{text-anchor:end}"
    f"svg .q{{fill:{SOFT}}}svg .w{{fill:#fff}}"
    f"svg .ax{{stroke:{GREY};stroke-width:.8;fill:none}}"
    f"svg .gr{{stroke:{PALE};stroke-width:.6;fill:none}}"
)


@dataclass(frozen=True)
class Picture:
    """A figure ready for the page."""

    svg: str  #: inline SVG, or HTML that holds several
    caption: str  #: what stands under it
    narrow: str = ""  #: drawn anew for narrow screens; empty where `svg` serves all widths


def standalone(shown: Picture) -> str:
    """A figure with its caption as the text of a file of its own."""
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    svg = shown.svg.replace("<svg ", f"<svg {spaces} ", 1)
    inside = (
        f"<desc>{escape(shown.caption)}</desc><style>{SVG_STYLE}</style>"
        '<rect width="100%" height="100%" fill="white"/>'
    )
    return svg.replace(">", f">{inside}", 1) + "\n"


def number(value: float) -> str:
    """A coordinate to a tenth of a pixel."""
    return f"{value:.1f}".removesuffix(".0").replace("-0.", "-.").removeprefix("-0") or "0"


def text_width(words: str, size: float = SIZE) -> float:
    """Width of a text [px], from above."""
    return size * sum(
        1.0
        if ord(c) > 0x2E80 or c in "mwMW%"
        else 0.36
        if c in "il.,:;|'!() "
        else 0.72
        if c.isupper()
        else 0.6
        for c in words
    )


def shortened(words: str, width: float, size: float = SIZE) -> str:
    """A text that fits a width, its middle left out where it is too long."""
    if text_width(words, size) <= width:
        return words
    keep = len(words)
    while keep > 4 and text_width(words[:keep], size) + size > width:
        keep -= 1
    return words[: keep // 2] + "…" + words[len(words) - (keep - keep // 2) :]


def symbol(x: float, y: float, radius: float) -> str:
    """Path of a dot."""
    r, across = number(radius), number(2.0 * radius)
    return f"M{number(x - radius)} {number(y)}a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0z"


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


def envelope(values: FloatArray, bins: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place among the samples and range of a trace in bins as wide as a line."""
    # Each bin starts with the last sample of the one before it: the trace stays connected.
    edges = np.unique(np.linspace(0, values.size - 1, min(bins, values.size - 1) + 1, dtype=int))
    pieces = [values[a : b + 1] for a, b in pairwise(edges)]
    low, high = (np.array([end(piece) for piece in pieces]) for end in (np.min, np.max))
    return 0.5 * (edges[:-1] + edges[1:]), low, high


def digits(value: float) -> str:
    """A level with three digits, or all before the point: 0.500, 12.0, 1250."""
    return f"{value:.0f}" if 99.95 <= abs(value) < 1e6 else f"{value:#.3g}"


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
