"""The report of a study: one HTML file that needs nothing else, on a network or off it."""

import json
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from archfrag.errors import InputError, attempt
from archfrag.report.answer import summary
from archfrag.report.arch_section import arch_section, cautions_of
from archfrag.report.beside import beside_section
from archfrag.report.class_section import class_section
from archfrag.report.curve_figures import all_curves
from archfrag.report.filters import FILTERS, percent_of
from archfrag.report.inputs import ReportInputs
from archfrag.report.motion_figures import motion_section
from archfrag.report.picture import SVG_STYLE, Picture, standalone
from archfrag.report.plot import hatch_definitions
from archfrag.report.risk_section import risk_section
from archfrag.report.summary import arch_results, reading_scale
from archfrag.study.curves import Answer, arch_classes, quoted
from archfrag.study.files import write_text
from archfrag.study.members import SHOWN
from archfrag.study.steps import ALL_CURVES, REPORT_FILES

SUMMARY = REPORT_FILES[1]  # beside the page
_MOST_ANIMATED = 4
_MOST_ROWS = 200  # arches of the table of answers


def write_report(study_results: ReportInputs, out: Path) -> Path:
    """Write the report, and beside it its numbers and curves; each file complete or not at all.

    ``summary.json`` is by `archfrag.report.answer.summary`, ``curve-<arch>.svg`` the
    curve of each arch; of many arches ``curves.svg`` holds all.

    Parameters
    ----------
    study_results : ReportInputs
    out : Path
        HTML file; replaced only once the new one is complete.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    InputError
        If the parts do not belong together.
    OutputError
        If a file cannot be written.
    """
    out = Path(out)
    text, curves, data = _render(study_results)
    for name, curve in curves.items():
        write_text(out.parent / name, standalone(curve))
    numbers = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out.parent / SUMMARY, numbers + "\n")
    write_text(out, text)
    return out


def render(study_results: ReportInputs) -> str:
    """The page as text; the same inputs give the same text.

    Raises
    ------
    InputError
        If the parts do not belong together.
    """
    return _render(study_results)[0]


def _render(inputs: ReportInputs) -> tuple[str, dict[str, Picture], dict[str, Any]]:
    """The page, the figures that are files too, and the content of ``summary.json``."""
    cube = inputs.cube
    scale = reading_scale(cube, inputs.measure)
    _check(inputs)
    sections = [
        arch_section(inputs, arch_results(cube, name, scale), i, i < _MOST_ANIMATED)
        for i, (name, _, _) in enumerate(inputs.arches)
    ]
    listed, marks = _listed(inputs), (scale.factor * float(cube["intensity"].max()), inputs.at)
    every = all_curves(inputs.answers, inputs.classes, arch_classes(cube), scale, marks)
    of_classes = [
        _part({"id": f"class{i}", "name": name}, partial(class_section, inputs, name, i, scale))
        for i, name in enumerate(inputs.classes)
    ]
    risk: dict[str, Any] | None = None
    if isinstance(inputs.risk, str):
        risk = {"none": inputs.risk}
    elif inputs.risk is not None:
        risk = _part({}, partial(risk_section, inputs.risk, scale))
    named = [name for name, _, _ in inputs.arches]
    provenance = [_plain(item) for item in cube.attrs.items()]
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=inputs.title,
            listed=list(listed.items()),
            most_rows=_MOST_ROWS,
            at=inputs.at,
            # How curves and bands were made, each once.
            methods=list(dict.fromkeys(a.method for a in listed.values() if a.method)),
            all_curves=every,
            n_arch=len(inputs.answers),
            sections=sections,
            design={"arches": {}} | json.loads(cube.attrs.get("archfrag_design", "{}")),
            classes=of_classes,
            beside=beside_section(inputs, scale),
            risk=risk,
            scale=scale,
            cautions=[c for c in inputs.cautions if not any(cautions_of([c], n) for n in named)],
            # Gap over joint length from which a loss of contact is a collapse.
            loss_limit=f"{100.0 * float(cube.attrs['loss_limit']):g} %",
            percent=percent_of(inputs.confidence),
            n_record=cube.sizes["record"],
            n_level=cube.sizes["level"],
            motions=motion_section(inputs, scale),
            facts=[(k, v) for k, v in provenance if "\n" not in v],
            documents=[(k, v) for k, v in provenance if "\n" in v],
            svg_style=Markup(SVG_STYLE),
            hatches=Markup(hatch_definitions()),
        )
    )
    curves = {f"curve-{section['name']}.svg": section["curve"] for section in sections}
    if len(inputs.answers) > SHOWN:
        curves = {ALL_CURVES: every} if every is not None else {}
    return text, curves, summary(inputs, scale)


def _part(known: dict[str, Any], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """A part of the page, or what is known of it and why it cannot be made."""
    made = attempt(make)
    return known | ({"none": made} if isinstance(made, str) else made)


def _listed(inputs: ReportInputs) -> dict[str, Answer]:
    """Answers in the order of the table: classes, arches that are of none, other arches."""
    counted = Counter(arch_classes(inputs.cube).values())
    first = quoted(inputs.cube, inputs.answers, inputs.classes)
    named = {
        f"{k}, {counted[k]} arches" if k in inputs.classes else k: a for k, a in first.items()
    }
    return named | dict(inputs.answers)


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("archfrag.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= FILTERS | {"inline": _inline}
    return environment


def _inline(shown: Picture) -> Markup:
    """A picture for all widths, or the drawing for the page's column and the narrow one."""
    if not shown.narrow:
        return Markup(shown.svg)
    return Markup(f'<div class="broad">{shown.svg}</div><div class="slim">{shown.narrow}</div>')


def _check(inputs: ReportInputs) -> None:
    cube = inputs.cube
    records = [str(name) for name in cube["record"].values]
    given = [motion.id for motion in inputs.motions]
    if sorted(given) != sorted(records):
        odd = sorted(set(given) ^ set(records))
        raise InputError(
            f"motions and cube do not belong together: {', '.join(odd) or 'a record is twice'}"
        )
    for name in (*map(str, cube["arch"].values), *(name for name, _, _ in inputs.arches)):
        if name not in inputs.answers:
            raise InputError(f"answers holds none for arch {name!r}")


def _plain(item: tuple[str, Any]) -> tuple[str, str]:
    """A provenance entry as text; JSON, given as text or as a mapping, is laid out in lines."""
    name, value = item
    if isinstance(value, str) and value[:1] in "{[":
        try:
            value = json.loads(value)
        except ValueError:
            return name, value
    if isinstance(value, Mapping | list | tuple):
        return name, json.dumps(value, indent=2, ensure_ascii=False, default=str)
    return name, str(value)
