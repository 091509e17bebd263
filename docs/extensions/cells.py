"""How cells and commands are shown.

Shell cells stand without their magic, paths without the build's folders; the help of commands is
plain text, in which stars and backticks are not reStructuredText's.
"""

import re
import tempfile

from docutils import nodes
from sphinx.application import Sphinx

MAGICS = {"%%bash": "bash", "%%writefile": "yaml"}
FOLDER = re.compile(re.escape(tempfile.gettempdir()) + r"/[^\s/'\"]+/(?=\S)")


def join_streams(outputs: nodes.Element) -> None:
    """What a command writes reaches the page in pieces, cut anywhere: one block again."""
    pieces = [one for one in outputs.children if "stream" in one.get("classes", [])]
    for one in pieces[1:]:
        pieces[0].children = [nodes.Text(pieces[0].astext() + one.astext())]
        outputs.remove(one)


def show_plainly(app: Sphinx, doctree: nodes.document) -> None:
    """Cells without magic words, and outputs without the folders of the build."""
    for outputs in doctree.findall(nodes.container):
        if "cell_output" in outputs["classes"]:
            join_streams(outputs)
    for literal in doctree.findall(nodes.literal_block):
        text = FOLDER.sub("", literal.astext())
        for magic, language in MAGICS.items():
            if text.startswith(magic):
                text = text.split("\n", 1)[1]
                literal["language"] = language
        if text != literal.astext():
            literal.children = [nodes.Text(text)]
        literal.rawsource = text  # or else what it was is highlighted no more


def plain_help(app: Sphinx, context: object, lines: list[str]) -> None:
    """Code in single backticks as reStructuredText writes it; stars and `://...` as they are."""
    lines[:] = [
        re.sub(
            r"(?<!`)`([^`]+)`(?!`)",
            r"``\1``",
            line.replace("*", r"\*").replace("://...", r"\://..."),
        )
        for line in lines
    ]


def setup(app: Sphinx) -> dict:
    for part in ("description", "options", "arguments", "epilog"):
        app.connect(f"sphinx-click-process-{part}", plain_help)
    app.connect("doctree-read", show_plainly)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
