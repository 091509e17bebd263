"""Figures as inline SVG: one style, one palette, the same bytes from the same numbers.

Text stays text, in the page's own font. Widths are measured in DejaVu Sans, which is wider than
the fonts of any browser's default list, so that what is drawn apart stays apart.
"""

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

# Okabe and Ito's palette: told apart with any kind of colour vision.
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
INK = "#1f2933"
GREY = "#7b8794"
PALE = "#d3dae2"

WIDTH = 7.4  # [inch], the page's column

_STYLE: dict[str, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "hatch.linewidth": 0.7,
    "grid.color": PALE,
    "grid.linewidth": 0.5,
    "path.simplify": True,
    "text.parse_math": False,  # a record's name may hold a dollar
    "svg.fonttype": "none",
    "svg.hashsalt": "archfrag",
}


@dataclass(frozen=True)
class Picture:
    """A figure ready for the page: inline SVG and the sentence that stands under it."""

    svg: str
    caption: str


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib settings of all figures, put back afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)  # type: ignore[arg-type]
        yield


def picture(
    name: str,
    size: tuple[float, float],
    draw: Callable[[Figure], None],
    *,
    alternative: str,
    caption: str,
) -> Picture:
    """Draw a figure and return it as inline SVG.

    Parameters
    ----------
    name : str
        Unique on the page: prefix of all identifiers inside the SVG.
    size : (float, float)
        Width and height [inch].
    draw : callable
        Takes the empty figure.
    alternative : str
        What the figure shows, for those who cannot see it.
    caption : str
    """
    with house_style(), warnings.catch_warnings():
        # Text stays text: what the measuring font lacks, the font of a browser draws.
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from font", UserWarning)
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        buffer = StringIO()
        no_metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(buffer, format="svg", metadata=no_metadata, transparent=True)
    return Picture(_inline(buffer.getvalue(), name, alternative), caption)


def standalone(shown: Picture) -> str:
    """A figure with its caption as the text of a file of its own."""
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    svg = shown.svg.replace("<svg ", f"<svg {spaces} ", 1)
    inside = f'<desc>{escape(shown.caption)}</desc><rect width="100%" height="100%" fill="white"/>'
    return svg.replace(">", f">{inside}", 1) + "\n"


def faint_grid(axes: Axes, which: str = "both") -> None:
    """Grid behind everything else."""
    axes.set_axisbelow(True)
    axes.grid(True, axis=which)  # type: ignore[arg-type]


def legend_above(axes: Axes, columns: int = 4, **options: Any) -> None:
    """Legend over the axes, where it can hide nothing."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.4,
        **options,
    )


def _inline(svg: str, name: str, alternative: str) -> str:
    """The <svg> element alone, its identifiers renumbered so that none occurs twice on a page.

    Numbers in order of appearance also make the bytes independent of memory addresses, which
    some versions of matplotlib use for clip paths.
    """
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"\s*<!--.*?-->", "", svg, flags=re.DOTALL)
    numbers = {old: f"{name}-{i}" for i, old in enumerate(re.findall(r'\bid="([^"]+)"', svg))}
    svg = re.sub(r'\bid="([^"]+)"', lambda m: f'id="{numbers[m[1]]}"', svg)
    svg = re.sub(r'href="#([^"]+)"', lambda m: f'href="#{numbers[m[1]]}"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", lambda m: f"url(#{numbers[m[1]]})", svg)
    view_box = re.search(r'viewBox="([^"]+)"', svg)
    assert view_box is not None
    label = escape(alternative, quote=True)
    head = f'<svg viewBox="{view_box[1]}" role="img" aria-label="{label}">'
    return head + svg[svg.index(">") + 1 :].strip()
