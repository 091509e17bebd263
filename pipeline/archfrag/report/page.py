"""The report of a study: one HTML file that needs no network, and its numbers for programs."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from markupsafe import Markup

from archfrag.errors import InputError, attempt
from archfrag.fragility.curve import Fragility
from archfrag.report import curves, drawing, html
from archfrag.report.drawing import Picture
from archfrag.report.html import (
    cautions,
    chance,
    folded,
    pairs,
    paragraph,
    table,
)
from archfrag.report.inputs import (
    ReportInputs,
    Scale,
    arch_results,
    reading_scale,
    study_config,
    summary,
)
from archfrag.report.motions import motion_parts
from archfrag.report.risk import risk_parts
from archfrag.report.sections import arch_parts, card, cautions_of, class_parts
from archfrag.study.answer.curves import Answer, arch_classes, quoted
from archfrag.study.file.members import SHOWN
from archfrag.study.files import write_text
from archfrag.study.steps import ALL_CURVES, REPORT_FILES

SUMMARY = REPORT_FILES[1]  # beside the page
_MOST_ANIMATED = 4
_MOST_ROWS = 200  # arches of the table of answers


def write_report(inputs: ReportInputs, out: Path) -> Path:
    """Write the report `out`, its numbers ``summary.json`` and its curves as SVG files.

    Each file is replaced once the new one is complete. ``curve-<arch>.svg`` has the curve of each
    arch; of many arches ``curves.svg`` has all.

    Raises
    ------
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
    """The page as text, and by file name the figures that are files too."""
    cube, scale = inputs.cube, reading_scale(inputs.cube, inputs.measure)
    highest = scale.factor * float(cube["intensity"].max())
    every = curves.all_curves(
        inputs.answers, inputs.classes, arch_classes(cube), scale, highest, inputs.at
    )
    sections: list[tuple[str, str, Iterable[Any]]] = []
    if every is not None:
        sections.append(("all", "All arches", [every]))
    for i, name in enumerate(inputs.classes):
        sections.append((f"class{i}", f"Class {name}", _parts(class_parts, inputs, name, scale)))
    figures = {}
    for i, (name, _, _) in enumerate(inputs.arches):
        results = arch_results(cube, name, scale)
        shown = list(arch_parts(inputs, results, i, i < _MOST_ANIMATED))
        sections.append((f"arch{i}", name, shown))
        figures[f"curve-{name}.svg"] = curves.curve(results, inputs.answers[name])
    if inputs.risk is not None:
        parts = _parts(risk_parts, inputs.risk, scale, inputs.percent)
        sections.append(("risk", "Risk", parts))
    if inputs.compared is not None:
        title = f"Compared with study {inputs.compared[0].attrs['archfrag_study']}"
        sections.append(("compared", title, list(_compared(inputs, scale))))
    sections += [
        ("motions", "Ground motions", motion_parts(inputs, scale)),
        ("provenance", "Provenance", _provenance(cube.attrs)),
    ]
    text = html.template(
        "report.html.j2", inputs=inputs, head=list(_head(inputs, scale)), sections=sections,
        loss_limit=f"{100.0 * float(cube.attrs['loss_limit']):g} %",  # gap over joint length
        style=Markup(drawing.STYLE), patterns=Markup(drawing.PATTERNS),
    )  # fmt: skip
    if len(inputs.answers) > SHOWN:
        figures = {ALL_CURVES: every} if every is not None else {}
    return text, figures


def _parts(make: Callable[..., Iterable[Any]], *given: Any) -> Iterable[Any]:
    """Parts of a section, or why it cannot be made."""
    made = attempt(lambda: list(make(*given)))
    if isinstance(made, str):
        return [paragraph(f"This section is missing: {made}.", "none")]
    return made


def _head(inputs: ReportInputs, scale: Scale) -> Iterable[Any]:
    """The table of answers: classes, arches that are of none, other arches; and cautions."""
    cube, count = inputs.cube, Counter(arch_classes(inputs.cube).values())
    listed = {
        f"{name}, {count[name]} arches" if name in inputs.classes else name: answer
        for name, answer in quoted(cube, inputs.answers, inputs.classes).items()
    } | dict(inputs.answers)
    heads = ["arch", f"median capacity θ [{scale.unit}] ({inputs.percent})"]
    heads += [f"dispersion β ({inputs.percent})", "θ, β by maximum likelihood"]
    if inputs.at is not None:
        heads.insert(1, f"P(collapse) at {scale.text(inputs.at / scale.factor)}")
    rows = [[name, *_row(answer, scale, inputs.at)] for name, answer in listed.items()]
    yield table("Answer for each arch", heads, rows[:_MOST_ROWS], "compact")
    sizes = [f"{len(inputs.answers)} arches" if len(inputs.answers) > 1 else "1 arch"]
    n_record, n_level = cube.sizes["record"], cube.sizes["level"]
    sizes.append(f"{n_record} ground motion{'s' * (n_record > 1)}")
    words = [", ".join(sizes) + f" at {n_level} levels of {scale.measure}" * (n_level > 1) + "."]
    words.append(f"θ: {scale.measure} at which half of the motions cause collapse.")
    words.append("β: standard deviation of the logarithm of the capacity.")
    if inputs.classes:
        words.append("β of a class includes the differences between its arches.")
    methods = dict.fromkeys(a.method for a in listed.values() if a.method)
    words.append(f"In parentheses: {inputs.percent} intervals ({'; '.join(methods)}).")
    if len(rows) > _MOST_ROWS:
        words.append(f"The table shows the first {_MOST_ROWS} rows.")
    if len(inputs.arches) < len(inputs.answers):
        words.append("The weakest, the middle and the strongest arch by θ have a section.")
    link = Markup('<a href="{0}">{0}</a>').format(SUMMARY)
    yield paragraph(Markup("{} Numbers for programs: {}.").format(" ".join(words), link), "note")
    names = [name for name, _, _ in inputs.arches]
    yield cautions(c for c in inputs.cautions if not any(cautions_of([c], n) for n in names))


def _row(answer: Answer, scale: Scale, at: float | None) -> list[str]:
    fit, likeliest, asked = answer.curve, answer.likelihood, [] if at is None else ["–"]
    if isinstance(fit, str):
        return [*asked, "no curve", "–", "–"]
    if at is not None:
        value, *ends = map(chance, answer.probability(at / scale.factor))
        asked = [f"{value} ({' to '.join(dict.fromkeys(ends))})"]
    theta, most = map(scale.digits, answer.theta), "–"
    if isinstance(likeliest, Fragility):
        most = f"{scale.digits(likeliest.theta)}, {likeliest.beta:.2f}"
    beta = f"{fit.beta:.2f} ({html.interval(answer.beta)})"
    return [*asked, f"{scale.digits(fit.theta)} ({' to '.join(theta)})", beta, most]


def _compared(inputs: ReportInputs, scale: Scale) -> Iterable[Any]:
    """The arches that another study has too; InputError if the two cannot be compared."""
    assert inputs.compared is not None
    studies = (inputs.cube, inputs.answers), inputs.compared
    cubes = [cube for cube, _ in studies]
    names = [str(cube.attrs["archfrag_study"]) for cube in cubes]
    refused = f"study {names[1]!r} cannot be compared with {names[0]!r}"
    kinds = ["{measure} [{units}]".format(**cube["intensity"].attrs) for cube in cubes]
    if kinds[0] != kinds[1]:
        raise InputError(f"{refused}: its levels are of {kinds[1]}, not of {kinds[0]}")
    own, theirs = [name for name, _, _ in inputs.arches], cubes[1]["arch"].values.astype(str)
    common = [name for name in own if name in theirs]
    if not common:
        raise InputError(f"{refused}: it has no arch {' or '.join(own)}, but {', '.join(theirs)}")
    one, other = (set(cube["record"].values.tolist()) for cube in cubes)
    yield paragraph(
        f"{names[0]} has {len(one)} ground motions, {names[1]} has {len(other)}; "
        f"{len(one & other)} have the same name in both.", "note",
    )  # fmt: skip
    settings = [_settings(cube, common) for cube in cubes]
    keys = sorted({**settings[0], **settings[1]})
    rows = [[key, *(each.get(key, "–") for each in settings)] for key in keys]
    differing = [row for row in rows if row[1] != row[2]]
    yield table("Settings in which the studies differ", ["key", *names], differing, "pairs")
    for arch in common:
        yield html.heading(arch)
        sides = [(arch_results(cube, arch, scale), answers[arch]) for cube, answers in studies]
        yield curves.two_studies(names, sides)
        fits = [answer.curve for _, answer in sides]
        if isinstance(fits[0], Fragility) and isinstance(fits[1], Fragility):
            change = f"{100 * (fits[1].theta / fits[0].theta - 1):+.1f} %".replace("-", "−")
            yield paragraph(f"Change of θ from {names[0]} to {names[1]}: {change}.")
        for name, (results, answer) in zip(names, sides):
            yield paragraph(f"{arch} in {name}:")
            yield card(answer, scale, inputs.percent, results=results)


def _settings(cube: xr.Dataset, arches: Sequence[str]) -> dict[str, str]:
    config = study_config(cube)
    parts = {name: config.get(name, {}) for name in ("intensity", "method")}
    entries = {entry["id"]: entry for entry in config.get("arches", ())}
    parts |= {f"arches.{name}": entries[name] for name in arches if name in entries}
    found = {
        f"{part}.{key}": json.dumps(value, ensure_ascii=False)
        for part, values in parts.items()
        for key, value in values.items()
    }
    return found | {"vertical component": cube.attrs.get("vertical_component", "not stated")}


def _provenance(attributes: Mapping[str, Any]) -> Iterable[Any]:
    """Attributes of the cube; JSON is laid out in lines."""
    long, short = {}, {}
    for name, value in attributes.items():
        try:
            found = json.loads(value) if str(value)[:1] in "{[" else value
        except ValueError:
            found = value
        if isinstance(found, Mapping | list):
            long[name] = json.dumps(found, indent=2, ensure_ascii=False)
        else:
            short[name] = found
    yield pairs("Provenance", short.items(), "attribute of the cube")
    yield from (folded(name, text) for name, text in long.items())
