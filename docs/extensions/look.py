"""One look of all figures of the site: matplotlib's style, and colours that follow the theme.

`import look` in a cell sets the style; a figure that a cell leaves behind is then shown as SVG.
"""

import colorsys
import io
import re

import matplotlib
from IPython import get_ipython
from IPython.display import HTML
from matplotlib.figure import Figure, FigureBase

from archfrag.report.svg import GREY, INK, PALE

WIDTH = 7.4  # of a figure as wide as the text [inch]
STYLE = {
    "font.family": "sans-serif", "font.size": 8.5, "axes.titlesize": 8.5,
    "axes.titleweight": "bold", "axes.titlelocation": "left", "axes.spines.top": False,
    "axes.spines.right": False, "axes.edgecolor": GREY, "axes.linewidth": 0.7,
    "axes.labelcolor": INK, "text.color": INK, "xtick.color": GREY, "ytick.color": GREY,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "legend.frameon": False,
    "legend.fontsize": 8.0, "grid.color": PALE, "grid.linewidth": 0.5, "lines.linewidth": 1.5,
    "figure.figsize": (WIDTH, 3.4), "svg.fonttype": "none", "svg.hashsalt": "archfrag",
}  # fmt: skip
COLOUR = re.compile(r"#[0-9a-fA-F]{6}\b|#[0-9a-fA-F]{3}\b|(?<=[:\"' ])(?:white|black)(?=[;\"'])")
NAMES = {"white": "#ffffff", "black": "#000000"}


def dark(colour: str) -> str:
    """A colour for dark pages: greys and tints change places, strong colours become lighter.

    White becomes the background of the page, black nearly white.
    """
    parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    if max(parts) - min(parts) > 0.28:
        light = 0.21 * parts[0] + 0.72 * parts[1] + 0.07 * parts[2]
        mixed = max(0.0, 0.52 - light) / (1.0 - light)  # with white
        parts = [part + mixed * (1.0 - part) for part in parts]
    else:
        hue, light, saturation = colorsys.rgb_to_hls(*parts)
        parts = colorsys.hls_to_rgb(hue, 0.95 - 0.87 * light, min(saturation, 0.25))
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)


def themed(svg: str) -> str:
    """An SVG for a page: without a ground of its own, each colour one of a light and a dark."""
    svg = re.sub(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = svg.replace('<rect width="100%" height="100%" fill="white"/>', "")

    def pair(found: re.Match) -> str:
        """A colour of the light page with that of the dark one."""
        colour = NAMES.get(found[0], found[0])
        if len(colour) == 4:
            colour = "#" + "".join(2 * digit for digit in colour[1:])
        return f"light-dark({colour}, {dark(colour)})"

    return COLOUR.sub(pair, svg)


def svg_of(figure: Figure) -> str:
    """A figure of matplotlib as SVG of its natural width, or of the page's if that is less."""
    held = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(held, format="svg", transparent=True, metadata=nothing)
    width = f'<svg style="max-width:{99 * figure.get_figwidth():.0f}px" '
    return re.sub(r'<svg (?:width|height)="\S+" |<svg ', width, held.getvalue(), count=1)


def picture(svg: str, caption: str = "", words: str = "") -> HTML:
    """An SVG as a figure of the page; `words` are for those who cannot see it."""
    body = f'<div class="chart">{themed(svg)}</div>'
    if words:
        body = body.replace("<svg ", f'<svg role="img" aria-label="{words}" ', 1)
    below = f"<figcaption>{caption}</figcaption>" if caption else ""
    return HTML(f'<figure class="drawn">{body}{below}</figure>')


matplotlib.rcParams.update(STYLE)
if shell := get_ipython():
    # For the base of Figure, because pyplot takes away what is registered for Figure itself.
    as_html = shell.display_formatter.formatters["text/html"]
    as_html.for_type(FigureBase, lambda figure: picture(svg_of(figure)).data)
