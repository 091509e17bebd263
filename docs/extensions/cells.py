"""How cells and commands are shown.

Shell cells stand without their magic, paths without the build's folders; the help of commands is
plain text, in which stars and backticks are not reStructuredText's.
"""

import re
import tempfile

from docutils import nodes
from sphinx.application import Sphinx

MAGIC = "%%bash -e\n"
FOLDER = re.compile(re.escape(tempfile.gettempdir()) + r"/[^\s/'\"]+/(?=\S)")


def show_plainly(app: Sphinx, doctree: nodes.document) -> None:
    for literal in doctree.findall(nodes.literal_block):
        text = literal.astext()
        plain = FOLDER.sub("", text.removeprefix(MAGIC))
        if text.startswith(MAGIC):
            literal["language"] = "bash"
        if plain != text:
            literal.children = [nodes.Text(plain)]
            literal.rawsource = plain


def plain_help(app: Sphinx, context: object, lines: list[str]) -> None:
    lines[:] = [
        re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", line.replace("*", r"\*")) for line in lines
    ]


def setup(app: Sphinx) -> dict:
    for part in ("description", "options", "arguments", "epilog"):
        app.connect(f"sphinx-click-process-{part}", plain_help)
    app.connect("doctree-read", show_plainly)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
