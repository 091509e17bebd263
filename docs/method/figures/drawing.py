"""What all figures of the method use: colours, sheets, arrows, and how a page shows them."""

from collections.abc import Sequence
from html import escape

import numpy as np
from IPython.display import HTML
from look import picture, svg_of
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from archfrag import Arch
from archfrag.report.svg import (  # noqa: F401  # for the other modules here
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    SKY,
    VERMILION,
)

# Darker than in the report, because texts have these colours too.
ORANGE, PURPLE = "#b87a00", "#a0568a"
STONE, EDGE = "#e9e4da", "#8d8473"


def sheet(width: float, height: float) -> Figure:
    """An empty figure [inch]."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def shown(figure: Figure, words: str, caption: str) -> HTML:
    """A figure as part of a page; `words` are for those who cannot see it."""
    return picture(svg_of(figure), caption, words=escape(words))


def arrow(
    axes: Axes, start: ArrayLike, end: ArrayLike, colour: str, label: str = "", at: float = 1.0
) -> None:
    """An arrow; its label stands at a part of its length, on the right for a negative part."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axes.annotate(
        "", xy=tuple(end), xytext=tuple(start),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0,
                    "mutation_scale": 8},
    )  # fmt: skip
    axes.update_datalim([start, end])
    if not label:
        return
    along = end - start
    side = np.copysign(1.0, at) * np.array([-along[1], along[0]]) if abs(at) < 1.0 else along
    offset = 10.0 * side / max(float(np.linalg.norm(side)), 1e-12)
    place = "center" if abs(offset[0]) < 5 else ("left" if offset[0] > 0 else "right")
    axes.annotate(
        label, xy=tuple(start + abs(at) * along), xytext=tuple(offset), color=colour, ha=place,
        textcoords="offset points", va="center",
    )  # fmt: skip


def name(axes: Axes, x: float, y: float, words: str, colour: str = INK) -> None:
    """Words centred on a point."""
    axes.text(x, y, words, ha="center", va="center", color=colour, fontsize=8.0)


def bare(axes: Axes, margin: float = 0.1) -> None:
    """Equal scales and no axes."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(margin)
    axes.autoscale_view()
    axes.set_axis_off()


def stones(axes: Axes, outlines: Sequence[ArrayLike], **look: object) -> None:
    """Voussoirs by their outlines."""
    options = {"facecolor": STONE, "edgecolor": EDGE, "linewidth": 0.8, **look}
    for outline in outlines:
        axes.add_patch(Polygon(np.asarray(outline), closed=True, **options))
        axes.update_datalim(np.asarray(outline))


def moved(
    arch: Arch, displacement: ArrayLike, rotation: ArrayLike, times: float
) -> list[ArrayLike]:
    """Outlines of an arch that has moved, displacements multiplied."""
    found = []
    for outline, centre, shift, angle in zip(
        arch.outlines, arch.chain.centroid, np.asarray(displacement), np.asarray(rotation)
    ):
        c, s = np.cos(times * angle), np.sin(times * angle)
        found.append(centre + times * shift + (outline - centre) @ np.array([[c, s], [-s, c]]))
    return found
