r"""Formulas as MathML, written while the site is built: no script, no font, no request.

A number of the paper is given as LaTeX gives it, ``\tag{29}`` at the end of a formula; a label of
MyST (``$$ (name)``) is numbered by Sphinx.
"""

import re
from html import escape

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

CONVERTER = LatexToMathML(fancy_error=False)
TAG = re.compile(r"\\tag\{([^}]*)\}")
NUMBERED = re.compile(r"\{(align|gather)\*?\}")
log = logging.getLogger(__name__)


def markup(latex: str, node: nodes.Node, display: bool) -> str:
    """One formula; what the converter does not know is a warning that names page and line."""
    try:
        return CONVERTER.convert_with_local_state(latex, displaystyle=display)
    except LatexError as error:
        log.warning("formula %r: %s", latex, error, location=node, type="mathml")
        return f"<code>{escape(latex)}</code>"


def inline(writer, node: nodes.math) -> None:
    """A formula within a line."""
    writer.body.append(markup(node.astext(), node, display=False))
    raise nodes.SkipNode


def block(writer, node: nodes.math_block) -> None:
    """A formula on a line of its own, with its number."""
    latex = NUMBERED.sub(r"{\1ed}", node.astext().strip()).replace("{split}", "{aligned}")
    tags = TAG.findall(latex)
    latex = TAG.sub("", latex)
    if r"\\" in latex and r"\begin" not in latex:
        latex = rf"\begin{{aligned}}{latex}\end{{aligned}}"
    number = ", ".join(tags)
    if not number and node.get("number"):
        number = get_node_equation_number(writer, node)
    anchors = "".join(f'<span id="{name}"></span>' for name in node.get("ids", []))
    side = f'<span class="eqno">({number})</span>' if number else ""
    formula = markup(latex, node, display=True)
    writer.body.append(f'<div class="math-block">{anchors}{formula}{side}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
