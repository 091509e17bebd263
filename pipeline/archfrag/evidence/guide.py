"""The guide: one page made of all that was measured, and its figures as files."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from archfrag.errors import InputError
from archfrag.evidence.advice import advise
from archfrag.evidence.part import Frames, Section
from archfrag.methods.registry import METHODS
from archfrag.report.canvas import standalone
from archfrag.study.files import make_folder, write_text
from archfrag.study.provenance import commit, machine, versions

PAGE = "guide.html"


def sections_of(found: Mapping[str, Frames]) -> list[tuple[str, Section]]:
    """Advice in words, and what each part shows of its tables.

    Parameters
    ----------
    found : mapping of part to tables

    Returns
    -------
    list of (str, Section)
        The advice, then the parts in the order of `archfrag.evidence.command.PARTS`.
    """
    from archfrag.evidence.command import part

    sections = [(name, part(name).show(frames)) for name, frames in found.items()]
    advice = advise(found)
    return sections if advice is None else [("advice", advice), *sections]


def write_guide(
    found: Mapping[str, Frames], folder: Path, peers: Mapping[str, str] | None = None
) -> Path:
    """Write the page and the figures on it.

    Parameters
    ----------
    found : mapping of part to tables
    folder : Path
    peers : mapping of str to str, optional
        Version of each of the other solvers that were run.

    Returns
    -------
    Path
        The page: one HTML file that needs no network.

    Raises
    ------
    InputError
        If a table is not as this version makes it.
    OutputError
        If a file cannot be written.
    """
    try:
        sections = sections_of(found)
    except KeyError as missing:
        raise InputError(
            f"{folder}: a table of evidence there has no {missing}, as it was made by another "
            "version; measure all parts again with: archfrag evidence"
        ) from missing
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader("archfrag.evidence"), PackageLoader("archfrag.report")]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["inline"] = lambda shown: Markup(shown.svg)
    facts = [(name, str(value)) for name, value in versions().items()]
    facts += [("commit", commit()), ("processor", platform.processor() or platform.machine())]
    facts += [(name, str(value)) for name, value in machine().items() if name != "host"]
    facts += (peers or {}).items()
    page = environment.get_template("guide.html.j2").render(
        title="Speed, accuracy, and where methods fail",
        sections=sections,
        methods=list(METHODS.values()),
        facts=facts,
    )
    make_folder(folder / "figures")
    for _, section in sections:
        for name, shown in section.pictures.items():
            write_text(folder / "figures" / f"{name}.svg", standalone(shown))
    write_text(folder / PAGE, page)
    return folder / PAGE
