"""Figures by matplotlib as inline SVG: one style, the same bytes from the same numbers.

Text stays text, in the page's own font. Widths are measured in DejaVu Sans, which is wider than
the fonts of any browser's default list, so that what is drawn apart stays apart.
"""

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from io import StringIO
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from archfrag.report.picture import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILION,
    Picture,
    standalone,
)

__all__ = [
    "BLUE", "GREEN", "GREY", "INK", "ORANGE", "PALE", "PURPLE", "SKY", "VERMILION", "WIDTH",
    "Picture", "faint_grid", "house_style", "legend_above", "picture", "standalone",
]  # fmt: skip

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
