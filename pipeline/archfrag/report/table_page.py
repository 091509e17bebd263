"""The report on a table of verdicts: as that of a study, without arches, motions and films."""

import base64
import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from archfrag.files import make_folder
from archfrag.report import curve_figures, html
from archfrag.report.html import heading, paragraph
from archfrag.report.inputs import ReportInputs, Scale, summary
from archfrag.report.page import SUMMARY, overview
from archfrag.report.risk_section import risk_section
from archfrag.report.sections import PageSection, answers_table, card, levels_table, states_parts
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import store_fits
from archfrag.study.answer.rates import StudyRisk
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import write_text

_HOW = (
    "The verdicts are those of the table; archfrag simulated nothing. Runs that are unfinished or "
    "failed count neither as collapse nor as survival."
)


def write_table_report(
    study: StudyKeys, fitted: Fitted, cautions: Sequence[str], risk: StudyRisk | str | None
) -> Path:
    """Write the report on a table and the files of its numbers; return the report's path."""
    intensity, folder = study.intensity, make_folder(study.folder)
    inputs = ReportInputs(
        fitted.cube, Scale(intensity.measure, intensity.unit, 1.0 / intensity.factor), (), (),
        fitted.arches, fitted.classes, cautions, title=study.title, risk=risk,
        confidence=study.report.confidence,
    )  # fmt: skip
    curves = curve_figures.all_curves(inputs, inputs.answers, inputs.classes)
    sections = [*risk_section(inputs), *overview(inputs, curves)]
    for place, name in enumerate(inputs.quoted):
        sections.append(PageSection(f"curve{place}", name, list(_parts(inputs, name))))
    assumed = {each.assumptions: None for each in inputs.known.values()}
    how = [paragraph(text) for text in (_HOW, *assumed)]
    sections.append(PageSection("glossary", "How the curves were found", how))
    digest = base64.b64encode(hashlib.sha256(b"").digest()).decode()
    rest = [words for words in cautions if words.partition(": ")[0] not in inputs.quoted]
    text = html.template(
        "report.html.j2", inputs=inputs, scale=inputs.scale, sections=sections,
        n_level=inputs.cube.sizes["level"], n_arch=len(inputs.answers),
        n_record=inputs.cube.sizes["record"], script="", script_hash=f"'sha256-{digest}'",
        first=Markup("<h1>{}</h1>").format(inputs.title), cautions=html.cautions(rest),
        answers=answers_table(inputs, inputs.quoted) if len(inputs.quoted) > 1 else "",
    )  # fmt: skip
    store_fits(study, fitted)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(folder / SUMMARY, numbers + "\n")
    write_text(folder / "report.html", text)
    return folder / "report.html"


def _parts(inputs: ReportInputs, name: str) -> Iterator[Any]:
    """Yield the parts of the section on a structure or a class."""
    answer, results, start = inputs.quoted[name], inputs.results(name), f"{name}: "
    cautions = [words.removeprefix(start) for words in inputs.cautions if words.startswith(start)]
    yield card(answer, inputs.scale, inputs.percent, cautions, results)
    yield curve_figures.curve(results, answer)
    if answer.more.get("limit_states"):
        yield from states_parts(inputs, answer, name)
    free = answer.more.get("free", {})
    if "test_of_fit" in free:
        yield heading("Checks")
        yield paragraph(free["test_of_fit"]["message"])
    yield html.folded("Verdicts by level", levels_table(results, answer, inputs.percent))
