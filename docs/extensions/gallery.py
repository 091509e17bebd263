"""The gallery: cards with the first figures of its pages, and each page as a notebook.

Cells with the tag ``remove-cell`` or ``site-only`` are for the site, so notebooks go without them.
"""

import contextlib
import os
import re
from html import escape
from pathlib import Path

import nbformat
from docutils import nodes
from jupyter_cache import get_cache
from sphinx.addnodes import download_reference
from sphinx.application import Sphinx

INDEX = "gallery/index"
HIDDEN = {"remove-cell", "site-only"}
LINK = re.compile(r"\[([^\]]+)\]\([^):]+\.md[^)]*\)")  # to another page of the site


def offer_notebook(app: Sphinx, doctree: nodes.document) -> None:
    """A link below the title to the page as a notebook."""
    name = app.env.docname
    if not name.startswith("gallery/") or name == INDEX:
        return
    path = Path(app.env.mystnb_config.output_folder, f"{name}.ipynb")
    notebook = nbformat.read(path, as_version=4)  # without outputs if the page was not run anew
    with contextlib.suppress(KeyError):  # a page that failed has none
        cache = get_cache(app.config.nb_execution_cache_path)
        _, notebook = cache.merge_match_into_notebook(notebook)
    shown = [one for one in notebook.cells if HIDDEN.isdisjoint(one.metadata.get("tags", []))]
    for cell in shown:
        if cell.cell_type == "markdown":
            cell.source = LINK.sub(r"\1", cell.source)
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):  # the SVG needs the site's style sheet
                output.data.pop("text/html", None)
    notebook.cells = shown
    nbformat.write(notebook, path)
    target = "/" + os.path.relpath(path, app.srcdir)
    link = download_reference("", "Download this page as a notebook", reftarget=target)
    title = next(doctree.findall(nodes.title))
    title.parent.insert(title.parent.index(title) + 1, nodes.paragraph("", "", link))


def card(app: Sphinx, name: str) -> str:
    """First figure, title and first paragraph of a page, as a link to it."""
    tree = app.env.get_doctree(name)
    outputs = "".join(one.astext() for one in tree.findall(nodes.raw))
    figure = re.search(r"<svg.*?</svg>", outputs, re.DOTALL)
    if figure is None:
        raise LookupError(f"{name}: no figure for the gallery")
    question = next(one for one in tree.findall(nodes.paragraph) if "Download" not in one.astext())
    return (
        f'<a class="card" href="{app.builder.get_relative_uri(INDEX, name)}">'
        f'<span aria-hidden="true">{figure[0]}</span>'
        f"<b>{escape(app.env.titles[name].astext())}</b> {escape(question.astext())}</a>"
    )


def hang(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Cards of all pages, at the end of the gallery's own."""
    if name == INDEX:
        cards = "".join(card(app, each) for each in app.env.toctree_includes[INDEX])
        section = next(doctree.findall(nodes.section))
        section += nodes.raw("", f'<div class="cards">{cards}</div>', format="html")


def setup(app: Sphinx) -> dict:
    """Offer notebooks of the gallery's pages to Sphinx."""
    app.connect("doctree-read", offer_notebook, priority=100)  # before downloads are collected
    app.connect("doctree-resolved", hang)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
