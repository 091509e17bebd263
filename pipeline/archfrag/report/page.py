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
from archfrag.report.inputs import ReportInputs, arch_results, study_config, summary
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

    Each file is replaced once the new one is complete (else OutputError). ``curve-<arch>.svg``
    has the curve of each arch; of many arches ``curves.svg`` has all.
    """
    text, figures = render(inputs)
    for name, shown in figures.items():
        write_text(out.parent / name, shown.file)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out.parent / SUMMARY, numbers + "\n")
    write_text(out, text)
    return out


def render(inputs: ReportInputs) -> tuple[str, dict[str, Picture]]:
    """The page as text, and by file name the figures that are files too."""
    cube, answers, classes = inputs.cube, inputs.answers, inputs.classes
    every = curves.all_curves(inputs, answers, classes)
    sections: list[tuple[str, str, Iterable[Any]]] = []
    if every is not None and len(quoted(cube, answers, classes)) > 1:
        sections.append(("all", "All arches", [every]))
    for i, name in enumerate(classes):
        sections.append((f"class{i}", f"Class {name}", _parts(class_parts, inputs, name)))
    figures = {}
    for i, (name, _, _) in enumerate(inputs.arches):
        results = arch_results(cube, name, inputs.scale)
        shown = list(arch_parts(inputs, results, i, i < _MOST_ANIMATED))
        sections.append((f"arch{i}", name, shown))
        figures[f"curve-{name}.svg"] = curves.curve(results, answers[name])
    if inputs.risk is not None:
        parts = _parts(risk_parts, inputs.risk, inputs.scale, inputs.percent)
        sections.append(("risk", "Risk", parts))
    if inputs.compared is not None:
        title = f"Compared with study {inputs.compared[0].attrs['archfrag_study']}"
        sections.append(("compared", title, list(_compared(inputs, *inputs.compared))))
    sections += [
        ("motions", "Ground motions", motion_parts(inputs)),
        ("provenance", "Provenance", _provenance(cube.attrs)),
    ]
    named = [name for name, _, _ in inputs.arches]
    of_none = [c for c in inputs.cautions if not any(cautions_of([c], name) for name in named)]
    text = html.template(
        "report.html.j2", inputs=inputs, scale=inputs.scale, sections=sections,
        n_level=cube.sizes["level"], n_arch=len(answers), answers=_answers(inputs),
        cautions=html.cautions(of_none),
        methods=dict.fromkeys(a.method for a in answers.values() if a.method),
        loss_limit=f"{100.0 * float(cube.attrs['loss_limit']):g} %",  # gap over joint length
    )  # fmt: skip
    if len(answers) > SHOWN:
        figures = {ALL_CURVES: every} if every is not None else {}
    return text, figures


def _parts(make: Callable[..., Iterable[Any]], *given: Any) -> Iterable[Any]:
    """Parts of a section, or why it cannot be made."""
    made = attempt(lambda: list(make(*given)))
    if isinstance(made, str):
        return [paragraph(f"This section is missing: {made}.", "none")]
    return made


def _answers(inputs: ReportInputs) -> Markup:
    """Table of classes, of arches that are of none, and of other arches."""
    scale, at, count = inputs.scale, inputs.at, Counter(arch_classes(inputs.cube).values())
    heads = ["arch", f"median capacity θ [{scale.unit}] ({inputs.percent})"]
    heads += [f"dispersion β ({inputs.percent})", "θ, β by maximum likelihood"]
    if at is not None:
        heads.insert(1, f"P(collapse) at {scale.text(at / scale.factor)}")
    rows = []
    listed = quoted(inputs.cube, inputs.answers, inputs.classes) | dict(inputs.answers)
    for name, answer in listed.items():
        fit, likeliest = answer.curve, answer.likelihood
        row = [f"{name}, {count[name]} arches" if name in inputs.classes else name]
        rows.append(row)
        if isinstance(fit, str):
            row += [*["–"] * (len(heads) - 4), "no curve", "–", "–"]
            continue
        if at is not None:
            value, *ends = map(html.chance, answer.probability(at / scale.factor))
            row.append(f"{value} ({' to '.join(dict.fromkeys(ends))})")
        row.append(f"{scale.digits(fit.theta)} ({' to '.join(map(scale.digits, answer.theta))})")
        row.append(f"{fit.beta:.2f} ({html.interval(answer.beta)})")
        most = "–"
        if isinstance(likeliest, Fragility):
            most = f"{scale.digits(likeliest.theta)}, {likeliest.beta:.2f}"
        row.append(most)
    more = f", the first {_MOST_ROWS}" if len(rows) > _MOST_ROWS else ""
    return table(f"Answer for each arch{more}", heads, rows[:_MOST_ROWS], "compact")


def _compared(
    inputs: ReportInputs, other: xr.Dataset, answers: Mapping[str, Answer]
) -> Iterable[Any]:
    """The arches that another study has too; InputError if the two cannot be compared."""
    cubes, of_each = (inputs.cube, other), (inputs.answers, answers)
    names = [str(cube.attrs["archfrag_study"]) for cube in cubes]
    refused = f"study {names[1]!r} cannot be compared with {names[0]!r}"
    kinds = ["{measure} [{units}]".format(**cube["intensity"].attrs) for cube in cubes]
    if kinds[0] != kinds[1]:
        raise InputError(f"{refused}: its levels are of {kinds[1]}, not of {kinds[0]}")
    own = [name for name, _, _ in inputs.arches]
    common = [name for name in own if name in answers]
    if not common:
        raise InputError(f"{refused}: it has no arch {' or '.join(own)}, but {', '.join(answers)}")
    one, two = (set(cube["record"].values.tolist()) for cube in cubes)
    sizes = {"names": names, "sizes": [len(one), len(two)], "common": len(one & two)}
    yield paragraph(TEXTS["notes"]["compared"].format(**sizes), "note")
    settings = pd.concat(map(_settings, cubes), axis=1, keys=names).fillna("–").sort_index()
    differing = settings[settings[names[0]] != settings[names[1]]].itertuples(name=None)
    label = "Settings in which the studies differ"
    yield table(label, ["key", *names], differing, "pairs", numeric_from=3)
    for arch in common:
        yield html.heading(arch)
        results = [arch_results(cube, arch, inputs.scale) for cube in cubes]
        sides = [(each, answers[arch]) for each, answers in zip(results, of_each)]
        yield curves.two_studies(names, sides)
        fits = [answer.curve for _, answer in sides]
        if isinstance(fits[0], Fragility) and isinstance(fits[1], Fragility):
            change = f"{100 * (fits[1].theta / fits[0].theta - 1):+.1f} %".replace("-", "−")
            yield paragraph(f"Change of θ from {names[0]} to {names[1]}: {change}.")
        for name, (each, answer) in zip(names, sides):
            yield paragraph(f"{arch} in {name}:")
            yield card(answer, inputs.scale, inputs.percent, results=each)


def _settings(cube: xr.Dataset) -> pd.Series:
    """Keys of a study file, such as ``arches.ring.thickness``, that its results depend on."""
    config = study_config(cube)
    used = ("intensity", "motions", "design", "method")
    parts = {key: config[key] for key in used if key in config}
    parts["arches"] = {entry["id"]: entry for entry in config.get("arches", ())}
    return pd.json_normalize(parts).iloc[0].map(str)


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
