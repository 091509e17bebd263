"""The report of a study: one HTML file that needs no network, and its numbers for programs."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from archfrag.errors import InputError, attempt
from archfrag.fragility.curve import Fragility
from archfrag.mechanics.collapse import NOTED_GAP
from archfrag.report import curves, drawing, results
from archfrag.report.drawing import Picture
from archfrag.report.inputs import ReportInputs, summary
from archfrag.report.motions import motion_section
from archfrag.report.results import ArchResults, Scale, arch_results, reading_scale, study_config
from archfrag.report.risk import risk_section
from archfrag.report.sections import arch_section, cautions_of, class_section, stood_after_loss
from archfrag.study.answer.curves import Answer, arch_classes, quoted
from archfrag.study.file.members import SHOWN
from archfrag.study.files import write_text
from archfrag.study.steps import ALL_CURVES, REPORT_FILES

SUMMARY = REPORT_FILES[1]  # beside the page
_MOST_ANIMATED = 4
_MOST_ROWS = 200  # arches of the table of answers


def write_report(inputs: ReportInputs, out: Path) -> Path:
    """Write the report, and beside it its numbers and curves; each file complete or not at all.

    ``summary.json`` is by `summary`, ``curve-<arch>.svg`` the curve of each arch; of many arches
    ``curves.svg`` holds all.

    Parameters
    ----------
    inputs : ReportInputs
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
    text, figures = render(inputs)
    for name, shown in figures.items():
        write_text(out.parent / name, shown.file)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out.parent / SUMMARY, numbers + "\n")
    write_text(out, text)
    return out


def render(inputs: ReportInputs) -> tuple[str, dict[str, Picture]]:
    """The page as text, and by file name the figures that are files too.

    The same inputs give the same text.

    Raises
    ------
    InputError
        If the parts do not belong together.
    """
    cube, scale = inputs.cube, reading_scale(inputs.cube, inputs.measure)
    _check(inputs)
    names = [name for name, _, _ in inputs.arches]
    percent = f"{100 * inputs.confidence:.0f} %"
    sections = [
        arch_section(inputs, arch_results(cube, name, scale), i, i < _MOST_ANIMATED)
        for i, name in enumerate(names)
    ]
    of_class = arch_classes(cube)
    highest = scale.factor * float(cube["intensity"].max())
    every = curves.all_curves(
        inputs.answers, inputs.classes, of_class, scale, highest, inputs.at
    )
    # In the order of the table: classes, arches that are of none, other arches.
    count = Counter(of_class.values())
    listed = {
        f"{name}, {count[name]} arches" if name in inputs.classes else name: answer
        for name, answer in quoted(cube, inputs.answers, inputs.classes).items()
    } | dict(inputs.answers)
    risk: Any = inputs.risk
    if isinstance(risk, str):
        risk = {"none": risk}
    elif risk is not None:
        risk = _part(risk_section, risk, scale, percent)
    classes = [
        {"id": f"class{i}", "name": name} | _part(class_section, inputs, name, scale)
        for i, name in enumerate(inputs.classes)
    ]
    environment = Environment(
        loader=PackageLoader("archfrag.report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    filters = (results.chance, results.digits, results.onset_text, results.to, results.together)
    environment.filters |= {each.__name__: each for each in filters}
    text = environment.get_template("report.html.j2").render(
        inputs=inputs, at=inputs.at, listed=list(listed.items()), most_rows=_MOST_ROWS,
        # How curves and bands were made, each once.
        methods=list(dict.fromkeys(a.method for a in listed.values() if a.method)),
        all_curves=every, sections=sections, classes=classes, risk=risk,
        compared=compare_section(inputs, scale), motions=motion_section(inputs, scale),
        cautions=[c for c in inputs.cautions if not any(cautions_of([c], n) for n in names)],
        # Gap over joint length from which a loss of contact is a collapse.
        loss_limit=f"{100.0 * float(cube.attrs['loss_limit']):g} %", percent=percent, scale=scale,
        n_arch=len(inputs.answers), n_record=cube.sizes["record"], n_level=cube.sizes["level"],
        provenance=[(name, _laid_out(value)) for name, value in cube.attrs.items()],
        table=results.table, style=Markup(drawing.STYLE), patterns=Markup(drawing.PATTERNS),
    )  # fmt: skip
    if len(inputs.answers) > SHOWN:
        return text, {ALL_CURVES: every} if every is not None else {}
    return text, {f"curve-{section['name']}.svg": section["curve"] for section in sections}


def _part(make: Callable[..., dict[str, Any]], *given: Any) -> dict[str, Any]:
    """A part of the page, or why it cannot be made."""
    made = attempt(partial(make, *given))
    return {"none": made} if isinstance(made, str) else made


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


def _laid_out(value: Any) -> str:
    """A provenance entry as text; JSON, given as text or as a mapping, is laid out in lines."""
    if isinstance(value, str) and value[:1] in "{[":
        try:
            value = json.loads(value)
        except ValueError:
            return str(value)
    if isinstance(value, Mapping | list | tuple):
        return json.dumps(value, indent=2, ensure_ascii=False, default=str)
    return str(value)


def compare_section(inputs: ReportInputs, scale: Scale) -> dict[str, Any] | None:
    """What the page shows of another study, by the names that its template uses."""
    if inputs.compared is None:
        return None
    studies = (inputs.cube, inputs.answers), inputs.compared
    cubes = [cube for cube, _ in studies]
    names = [str(cube.attrs["archfrag_study"]) for cube in cubes]
    refused = f"study {names[1]!r} cannot be compared with {names[0]!r}"
    kinds = ["{measure} [{units}]".format(**cube["intensity"].attrs) for cube in cubes]
    if kinds[0] != kinds[1]:
        raise InputError(f"{refused}: its levels are of {kinds[1]}, not of {kinds[0]}")
    own = [name for name, _, _ in inputs.arches]
    theirs = [str(name) for name in cubes[1]["arch"].values]
    common = [name for name in own if name in theirs]
    if not common:
        raise InputError(f"{refused}: it has no arch {' or '.join(own)}, but {', '.join(theirs)}")
    arches = []
    for arch in common:
        sides = [(arch_results(cube, arch, scale), answers[arch]) for cube, answers in studies]
        vertical = [cube.attrs.get("vertical_component", "not stated") for cube in cubes]
        columns = [_compared(*side, sides[0][1], names[0], inputs.confidence) for side in sides]
        rows = [[label, *(column[label] for column in columns)] for label in columns[0]]
        heads, rows = ["figure", *names], [["vertical component", *vertical], *rows]
        shown = results.table(f"{arch} in both studies", heads, rows)
        arches.append((arch, curves.two_studies(names, sides), shown))
    records = [set(each["record"].values.tolist()) for each in cubes]
    one, other = (_settings(cube, common) for cube in cubes)
    differing = [
        (key, one.get(key, "–"), other.get(key, "–"))
        for key in sorted({**one, **other})
        if one.get(key) != other.get(key)
    ]
    label = "Arches, levels and method in which the studies differ"
    return {
        "names": names,
        "arches": arches,
        "records": [len(each) for each in records],
        "common": len(records[0] & records[1]),
        "settings": differing and results.table(label, ["key", *names], differing, "pairs"),
    }


def _compared(
    found: ArchResults, answer: Answer, first: Answer, first_name: str, confidence: float
) -> dict[str, str]:
    """Curve, runs and losses of contact of an arch in one of two studies."""
    scale, percent = found.scale, f"{100 * confidence:.0f} %"
    fit, likeliest, counts = answer.curve, answer.likelihood, found.counts
    theta = beta = "no curve"
    ends, most, change = ["–", "–"], ["–", "–"], "–"
    if isinstance(fit, Fragility):
        theta, beta = scale.text(fit.theta), f"{fit.beta:#.3g}"
        ends = [scale.interval(answer.theta), results.to(answer.beta, "#.3g")]
        most = ["no maximum", "no maximum"]
        if isinstance(likeliest, Fragility):
            most = [scale.text(likeliest.theta), f"{likeliest.beta:#.3g}"]
        if answer is not first and isinstance(first.curve, Fragility):
            change = f"{100 * (fit.theta / first.curve.theta - 1):+.1f} %".replace("-", "−")
    lost = found.simulated & np.isfinite(found["lost_contact_time"])
    numbers = {
        "runs": counts.runs.sum(), "collapsed": counts.collapsed.sum(),
        f"lost contact by a gap above {100 * NOTED_GAP:g} % of a joint's length": lost.sum(),
        "of these, standing": stood_after_loss(found),
        "runs with a loss of contact by any gap": (found["contact_losses"] > 0).sum(),
        "losses of contact by any gap": found["contact_losses"].sum(),
        "unfinished": counts.unfinished.sum(), "solver failures": counts.solver_failures.sum(),
    }  # fmt: skip
    return {
        "median capacity θ": theta, f"{percent} of θ": ends[0],
        "θ by maximum likelihood": most[0], f"change of θ from {first_name}": change,
        "dispersion β": beta, f"{percent} of β": ends[1], "β by maximum likelihood": most[1],
    } | {label: f"{number:,}" for label, number in numbers.items()}  # fmt: skip


def _settings(cube: xr.Dataset, arches: Sequence[str]) -> dict[str, str]:
    config = study_config(cube)
    parts = {name: config.get(name, {}) for name in ("intensity", "method")}
    entries = {entry["id"]: entry for entry in config.get("arches", ())}
    parts |= {f"arches.{name}": entries[name] for name in arches if name in entries}
    return {
        f"{part}.{key}": json.dumps(value, ensure_ascii=False)
        for part, values in parts.items()
        for key, value in values.items()
    }
