"""The report on a table of verdicts: as that of a study, without arches, motions and films."""

from collections.abc import Iterator, Sequence
from typing import Any

from archfrag.report import curve_figures, html
from archfrag.report.html import TEXTS, heading, paragraph
from archfrag.report.inputs import ReportInputs, Scale
from archfrag.report.sections import PageSection, card, levels_table, states_parts
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.rates import StudyRisk
from archfrag.study.file.schema import StudyKeys
from archfrag.version import __version__


def table_inputs(
    study: StudyKeys, fitted: Fitted, cautions: Sequence[str], risk: StudyRisk | str | None
) -> ReportInputs:
    """Return what the report on a table is written from."""
    scale = Scale(study.intensity.measure, study.intensity.unit, 1.0 / study.intensity.factor)
    return ReportInputs(
        fitted.cube, scale, (), (), fitted.arches, fitted.classes, cautions, title=study.title,
        risk=risk, confidence=study.report.confidence,
    )  # fmt: skip


def table_sections(inputs: ReportInputs) -> Iterator[PageSection]:
    """Yield a section for each structure, and one on how the curves were found."""
    for place, name in enumerate(inputs.quoted):
        yield PageSection(f"curve{place}", name, list(_parts(inputs, name)))
    assumed = {each.assumptions: None for each in inputs.known.values()}
    digest = inputs.cube.attrs["table_sha256"]
    words = TEXTS["notes"]["table"].format(digest=digest, version=__version__)
    how = [paragraph(text) for text in (words, *assumed)]
    yield PageSection("glossary", "How the curves were found", how)


def _parts(inputs: ReportInputs, name: str) -> Iterator[Any]:
    """Yield the parts of the section on a structure or a class."""
    answer, results, start = inputs.quoted[name], inputs.results(name), f"{name}: "
    cautions = [words.removeprefix(start) for words in inputs.cautions if words.startswith(start)]
    yield card(answer, inputs.scale, inputs.percent, cautions, results)
    yield curve_figures.curve(results, answer)
    if answer.more.get("limit_states"):
        yield from states_parts(inputs, answer, name)
    if "test_of_fit" in (free := answer.more.get("free", {})):
        yield heading("Checks")
        yield paragraph(free["test_of_fit"]["message"])
    yield html.folded("Verdicts by level", levels_table(results, answer, inputs.percent))
