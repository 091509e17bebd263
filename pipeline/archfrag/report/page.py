"""The report of a study: one HTML file that needs nothing else, on a network or off it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from archfrag.errors import InputError
from archfrag.report.answer import MOST_ROWS, answer_table, classes, summary
from archfrag.report.arch_section import arch_section, cautions_of
from archfrag.report.class_section import class_section
from archfrag.report.curve_figures import all_curves
from archfrag.report.motion_figures import motion_section
from archfrag.report.picture import SVG_STYLE, Picture, standalone
from archfrag.report.plot import hatch_definitions
from archfrag.report.summary import Scale, arch_results, reading_scale
from archfrag.study.files import write_text
from archfrag.study.members import SHOWN
from archfrag.study.steps import ALL_CURVES, REPORT_FILES

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion
    from archfrag.report.beside import Beside
    from archfrag.simulate import Onset
    from archfrag.study.curves import Answer


SUMMARY = REPORT_FILES[1]  # beside the page
_MOST_ANIMATED = 4


@dataclass(frozen=True)
class ReportInputs:
    """Everything a report is written from."""

    cube: "xr.Dataset"  #: of the study
    measure: str  #: name of the intensity measure of the cube's levels, e.g. "PGA"
    motions: "Sequence[Motion]"  #: unscaled, one for each record of the cube, its name as `id`
    #: Name in the cube, geometry and onset of each arch that has a section, in the page's order.
    arches: "Sequence[tuple[str, Arch, Onset]]"
    answers: "Mapping[str, Answer]"  #: of each arch of the cube, theta in the SI unit
    classes: "Mapping[str, Answer]" = field(default_factory=dict)  #: of classes of several arches
    #: What must be known before a curve is used; what concerns one arch begins with its name and a
    #: colon.
    cautions: Sequence[str] = ()
    #: Wall time of each run of an arch, or of groups of them [s].
    timings: Mapping[str, Sequence[float]] | None = None
    title: str = "Fragility of masonry arches"
    confidence: float = 0.9  #: of all bands and intervals
    #: Another study with the same measure, to be compared in the arches that both have.
    beside: "Beside | None" = None
    at: float | None = None  #: level at which the probability is wanted, in the study's unit
    risk: Mapping[str, Any] | None = None  #: from `risk_section.risk_section`


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
    _check(inputs, cube)
    sections = [
        arch_section(inputs, cube, arch_results(cube, name, scale), i, i < _MOST_ANIMATED)
        for i, (name, _, _) in enumerate(inputs.arches)
    ]
    of_class = classes(cube)
    many = len(inputs.answers) > SHOWN
    listed = _listed(inputs, of_class)
    every = _all_curves(inputs, cube, scale, of_class)
    named = [name for name, _, _ in inputs.arches]
    provenance = [_plain(item) for item in cube.attrs.items()]
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=inputs.title,
            answers=answer_table(listed | dict(inputs.answers), scale, inputs.at),
            most_rows=MOST_ROWS,
            methods=_methods(inputs),
            all_curves=every,
            n_arch=len(inputs.answers),
            sections=sections,
            classes=[
                class_section(inputs, cube, name, i, scale)
                for i, name in enumerate(inputs.classes)
            ],
            beside=_beside(inputs, cube, scale),
            risk=inputs.risk,
            scale=scale,
            cautions=[c for c in inputs.cautions if not any(cautions_of([c], n) for n in named)],
            loss_limit=_loss_limit(cube),
            percent=f"{100 * inputs.confidence:.0f} %",
            n_record=cube.sizes["record"],
            n_level=cube.sizes["level"],
            motions=motion_section(inputs, cube, scale),
            facts=[(k, v) for k, v in provenance if "\n" not in v],
            documents=[(k, v) for k, v in provenance if "\n" in v],
            svg_style=Markup(SVG_STYLE),
            hatches=Markup(hatch_definitions()),
        )
    )
    curves = {f"curve-{section['name']}.svg": section["curve"] for section in sections}
    if many:
        curves = {ALL_CURVES: every} if every is not None else {}
    return text, curves, summary(inputs, cube, scale, inputs.cautions)


def _listed(inputs: ReportInputs, of_class: Mapping[str, str]) -> dict[str, "Answer"]:
    """Answers that come first: of the classes, and of the arches that are of none."""
    counted = list(of_class.values())
    first = {f"{k}, {counted.count(k)} arches": answer for k, answer in inputs.classes.items()}
    own = {k: a for k, a in inputs.answers.items() if of_class.get(k) not in inputs.classes}
    return first | own


def _methods(inputs: ReportInputs) -> list[str]:
    """How curves and bands were made, each once."""
    every = (*inputs.classes.values(), *inputs.answers.values())
    return list(dict.fromkeys(answer.method for answer in every if answer.method))


def _all_curves(
    inputs: ReportInputs, cube: "xr.Dataset", scale: Scale, of_class: Mapping[str, str]
) -> Picture | None:
    members: dict[str, list[Answer]] = {name: [] for name in inputs.classes}
    for name, answer in inputs.answers.items():
        if of_class.get(name) in members:
            members[of_class[name]].append(answer)
    highest = scale.factor * float(cube["intensity"].max())
    return all_curves(inputs.answers, inputs.classes, members, scale, (highest, inputs.at))


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("archfrag.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["inline"] = _inline
    return environment


def _inline(shown: Picture) -> Markup:
    """A picture for all widths, or the drawing for the page's column and the narrow one."""
    if not shown.narrow:
        return Markup(shown.svg)
    return Markup(f'<div class="broad">{shown.svg}</div><div class="slim">{shown.narrow}</div>')


def _beside(inputs: ReportInputs, cube: "xr.Dataset", scale: Scale) -> dict[str, Any] | None:
    if inputs.beside is None:
        return None
    from archfrag.report.beside import beside_section

    return beside_section(inputs, cube, scale)


def _loss_limit(cube: "xr.Dataset") -> str | None:
    """Gap over joint length from which a loss of contact is a collapse; None if not known."""
    limit = cube.attrs.get("loss_limit", cube.get("loss_limit"))
    return None if limit is None else f"{100.0 * float(limit):g} %"


def _check(inputs: ReportInputs, cube: "xr.Dataset") -> None:
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
