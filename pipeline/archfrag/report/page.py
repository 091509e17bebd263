"""The report of a study: one HTML file that needs no network, and its numbers for programs."""

import base64
import hashlib
import json
from pathlib import Path

from archfrag.export.papers import write_papers
from archfrag.report import html
from archfrag.report import study_sections as study_wide
from archfrag.report.curve_figures import all_curves
from archfrag.report.film import typical_run
from archfrag.report.first_page import first_page, leading_arch
from archfrag.report.html import Picture
from archfrag.report.inputs import ReportInputs, report_inputs, summary
from archfrag.report.risk_section import risk_section
from archfrag.report.sections import answers_table, arch_sections, class_sections
from archfrag.study.answer.fits import gathered
from archfrag.study.file.members import SHOWN
from archfrag.study.file.schema import Study
from archfrag.study.provenance import write_text
from archfrag.study.steps import ALL_CURVES, REPORT_FILES

SUMMARY = REPORT_FILES[1]  # beside the page


def make_report(study: Study, compared: Path | None = None) -> Path:
    """Write the report of a finished study, compared with that of another file; return its path.

    Beside it are its numbers ``summary.json``, its curves as SVG files (``curves.svg`` in the
    place of those of many arches), and the tables of `archfrag.export.papers`.
    """
    return write_report(report_inputs(study, compared), study.folder / "report.html")


def write_report(inputs: ReportInputs, out: Path) -> Path:
    """Write the report `out` and the files beside it; return its path.

    Raise OutputError if they cannot be written.
    """
    text, figures = render(inputs)
    for name, picture in figures.items():
        write_text(out.parent / name, picture.file)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out.parent / SUMMARY, numbers + "\n")
    scale = inputs.scale
    write_papers(inputs.cube, scale.measure, scale.unit, scale.factor, out.parent)
    write_text(out, text)
    return out


def render(inputs: ReportInputs) -> tuple[str, dict[str, Picture]]:
    """Return the page as text, and by file name the figures that are files too."""
    lead = leading_arch(inputs)
    examples = [typical_run(inputs, place) for place in range(len(inputs.arches))]
    arches, appendix = arch_sections(inputs, examples, lead)
    curves = all_curves(inputs, inputs.answers, inputs.classes)
    sections = [
        *risk_section(inputs), *study_wide.overview(inputs, curves),
        *class_sections(inputs), *arches,
        *study_wide.compared_section(inputs), study_wide.motions_section(inputs),
        study_wide.provenance_section(inputs.cube.attrs), *appendix,
        study_wide.glossary_section(inputs),
    ]  # fmt: skip
    # Cautions that no section has; of those of arches that differ in numbers only the first.
    own = [name for name, _, _ in inputs.arches if name in inputs.quoted]
    rest = [words for words in inputs.cautions if words.partition(": ")[0] not in own]
    digest = base64.b64encode(hashlib.sha256(html.SCRIPT.encode()).digest()).decode()
    listed = inputs.quoted
    text = html.template(
        "report.html.j2", inputs=inputs, scale=inputs.scale, sections=sections,
        n_level=inputs.cube.sizes["level"], n_arch=len(inputs.answers),
        script=html.SCRIPT, script_hash=f"'sha256-{digest}'",
        first=first_page(inputs, examples[lead]),
        answers=answers_table(inputs, listed) if len(listed) > 1 else "",
        cautions=html.cautions(gathered(rest, inputs.cube, own)),
    )  # fmt: skip
    figures = {name: picture for each in sections for name, picture in each.files.items()}
    return text, figures | ({ALL_CURVES: curves} if len(inputs.answers) > SHOWN else {})
