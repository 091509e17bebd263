"""What a figure is once it is drawn, and the colours that all figures share."""

import re
from dataclasses import dataclass
from html import escape

# Okabe and Ito's palette: told apart with any kind of colour vision.
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
    """A figure ready for the page.

    Attributes
    ----------
    svg : str
        Inline SVG, or HTML that holds several.
    caption : str
        The sentence that stands under it.
    narrow : str
        The same drawn anew for narrow screens; empty where `svg` serves all widths.
    """

    svg: str
    caption: str
    narrow: str = ""


def standalone(shown: Picture) -> str:
    """A figure with its caption as the text of a file of its own."""
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    svg = shown.svg.replace("<svg ", f"<svg {spaces} ", 1)
    style = f"<style>{SVG_STYLE}</style>" if re.search(r'class="', svg) else ""
    inside = (
        f"<desc>{escape(shown.caption)}</desc>{style}"
        '<rect width="100%" height="100%" fill="white"/>'
    )
    return svg.replace(">", f">{inside}", 1) + "\n"
