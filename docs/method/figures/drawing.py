"""What all figures of the method use: colours, sheets, arrows, and how a page shows them."""

import base64
from collections.abc import Sequence
from html import escape
from io import BytesIO

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from archfrag import Arch

# Okabe and Ito (2008), apart for eyes that do not separate red from green.
INK, GREY, PALE = "#24313d", "#6b7780", "#d5dbe0"
BLUE, GREEN, ORANGE, VERMILION = "#0072b2", "#009e73", "#b87a00", "#d55e00"
PURPLE, SKY = "#a0568a", "#56b4e9"
STONE, EDGE = "#e9e4da", "#8d8473"
STYLE = {
    "font.family": "DejaVu Sans", "font.size": 9.0, "axes.titlesize": 9.5, "axes.edgecolor": GREY,
    "axes.labelcolor": INK, "text.color": INK, "xtick.color": GREY, "ytick.color": GREY,
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
    "lines.linewidth": 1.5, "svg.hashsalt": "archfrag",
}  # fmt: skip


class HTML(str):
    """What a notebook shows as it is."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return str(self)


def sheet(width: float, height: float) -> Figure:
    """An empty figure [inch]."""
    matplotlib.rcParams.update(STYLE)
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasSVG(figure)
    return figure


def shown(figure: Figure, words: str, caption: str) -> HTML:
    """A figure as part of a page; `words` are for those who cannot see it."""
    held = BytesIO()
    figure.savefig(held, format="svg", metadata={"Date": None, "Creator": None})
    data = base64.b64encode(held.getvalue()).decode()
    return HTML(
        '<figure style="margin:1em 0"><div style="overflow-x:auto"><img style="width:100%;'
        f'min-width:27rem;background:#fff" alt="{escape(words)}" '
        f'src="data:image/svg+xml;base64,{data}"></div><figcaption>{caption}</figcaption></figure>'
    )


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
