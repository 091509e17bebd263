"""The report of a study: one HTML file that needs no network, and its numbers for programs."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr
from markupsafe import Markup

from archfrag.errors import InputError, attempt
from archfrag.fragility.curve import Fragility
from archfrag.report import curves, html
from archfrag.report.html import TEXTS, Picture, paragraph, table
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
    if every is not None and len(quoted(cube, inputs.answers, inputs.classes)) > 1:
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
    named = [name for name, _, _ in inputs.arches]
    of_none = [c for c in inputs.cautions if not any(cautions_of([c], name) for name in named)]
    text = html.template(
        "report.html.j2", inputs=inputs, scale=scale, sections=sections,
        n_level=cube.sizes["level"], n_arch=len(inputs.answers),
        answers=_answers(inputs, scale), cautions=html.cautions(of_none),
        methods=dict.fromkeys(a.method for a in inputs.answers.values() if a.method),
        loss_limit=f"{100.0 * float(cube.attrs['loss_limit']):g} %",  # gap over joint length
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


def _answers(inputs: ReportInputs, scale: Scale) -> Markup:
    """Table of classes, of arches that are of none, and of other arches."""
    cube, count = inputs.cube, Counter(arch_classes(inputs.cube).values())
    listed = {
        f"{name}, {count[name]} arches" if name in inputs.classes else name: answer
        for name, answer in quoted(cube, inputs.answers, inputs.classes).items()
    } | dict(inputs.answers)
    rows = [[name, *_row(answer, scale, inputs.at)] for name, answer in listed.items()]
    heads = ["arch", f"median capacity θ [{scale.unit}] ({inputs.percent})"]
    heads += [f"dispersion β ({inputs.percent})", "θ, β by maximum likelihood"]
    if inputs.at is not None:
        heads.insert(1, f"P(collapse) at {scale.text(inputs.at / scale.factor)}")
    more = f", the first {_MOST_ROWS}" if len(rows) > _MOST_ROWS else ""
    return table(f"Answer for each arch{more}", heads, rows[:_MOST_ROWS], "compact")


def _row(answer: Answer, scale: Scale, at: float | None) -> list[str]:
    fit, likeliest, asked = answer.curve, answer.likelihood, [] if at is None else ["–"]
    if isinstance(fit, str):
        return [*asked, "no curve", "–", "–"]
    if at is not None:
        value, *ends = map(html.chance, answer.probability(at / scale.factor))
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
    sizes = {"names": names, "sizes": [len(one), len(other)], "common": len(one & other)}
    yield paragraph(TEXTS["notes"]["compared"].format(**sizes), "note")
    settings = [_settings(cube) for cube in cubes]
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


def _settings(cube: xr.Dataset) -> dict[str, str]:
    """Keys of a study file, such as ``arches.ring.thickness``, that its results depend on."""
    config = study_config(cube)
    parts = {
        key: config[key] for key in ("intensity", "motions", "design", "method") if key in config
    }
    parts["arches"] = {entry["id"]: entry for entry in config.get("arches", ())}
    flat = pd.json_normalize(parts).iloc[0]
    return {str(key): str(value) for key, value in flat.items()}


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
    yield html.pairs("Provenance", short.items(), "attribute of the cube")
    yield from (html.folded(name, text) for name, text in long.items())
