"""Sections of the page on arches and classes, part by part in the order of the page."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from archfrag.arch.facts import facts_text
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import Contributions
from archfrag.fragility.verdicts import Verdict, clopper_pearson
from archfrag.motions.measures import LEVEL_UNITS
from archfrag.report import arch_figure, curve_figures, html, run_figures
from archfrag.report.film import Example, farthest, film, repeat
from archfrag.report.html import (
    TEXTS,
    Picture,
    digits,
    heading,
    measured,
    paragraph,
    table,
)
from archfrag.report.inputs import COUNTS, ArchResults, ReportInputs, Scale, thetas
from archfrag.report.limits import base_of
from archfrag.simulation.response import MODEL_WORDS
from archfrag.simulation.simulate import Onset
from archfrag.simulation.standing import inset_loss, inset_text, joints_text
from archfrag.study.answer.curves import arch_classes
from archfrag.study.file.arches import UNITS
from archfrag.study.file.members import SHOWN
from archfrag.version import __version__

Parts = Iterator[Any]  # of a section: texts, tables and figures; None is left out
_MOST_ANIMATED = 4  # arches: with films, and in the table of answers
_MOST_ROWS = 200
_SPELT = {
    "1": "",
    "degree": " [deg]",
    "kg m-3": " [kg/m³]",
}  # of units as the cube has them
_UNITS = {name: _SPELT.get(unit, f" [{unit}]") for name, unit in UNITS.items()}
_UNITS |= {"intrados": " [m]", "extrados": " [m]", "joints": ""}
_UNITS |= {"stiffness": " [Pa/m]", "shear": " [Pa/m]"}


@dataclass(frozen=True)
class PageSection:
    """A chapter of the page: a title, and below it texts, tables and figures in order."""

    anchor: str
    title: str
    parts: Sequence[Any]  #: None is left out
    files: Mapping[str, Picture] = field(
        default_factory=dict
    )  #: figures to be files too, by name


def class_sections(inputs: ReportInputs) -> Iterator[PageSection]:
    """Yield a section for each class of several arches."""
    of_class = arch_classes(inputs.cube)
    for place, name in enumerate(inputs.classes):
        members = {
            k: answer for k, answer in inputs.answers.items() if of_class[k] == name
        }
        curves = curve_figures.all_curves(inputs, members, {name: inputs.classes[name]})
        parts = list(_class_parts(inputs, name, curves))
        yield PageSection(
            f"class{place}", f"Class {name}", parts, {f"curve-{name}.svg": curves}
        )


def arch_sections(
    inputs: ReportInputs, examples: Sequence[Example | None], lead: int
) -> tuple[list[PageSection], list[PageSection]]:
    """Return a section for each arch that is shown, and an appendix of those that classes have.

    `examples` are collapses of the arches; that of the arch at place `lead` is on the first page.
    """
    members = {
        k: answer for k, answer in inputs.answers.items() if k not in inputs.quoted
    }
    folded = list[Markup]()
    files = dict[str, Picture]()
    sections = list[PageSection]()
    for place, (name, _, _) in enumerate(inputs.arches):
        curve = curve_figures.curve(inputs.results(name), inputs.answers[name])
        file = {} if len(inputs.answers) > SHOWN else {f"curve-{name}.svg": curve}
        parts = list(_arch_parts(inputs, place, curve, examples[place], place == lead))
        if name in members:
            folded.append(html.folded(name, *filter(None, parts)))
            files |= file
            continue
        # An arch that has the name of its study was not given any.
        alone = len(inputs.answers) == 1 and name == inputs.cube.attrs.get(
            "archfrag_study"
        )
        sections.append(
            PageSection(f"arch{place}", "The arch" if alone else name, parts, file)
        )
    if not members:
        return sections, []
    folded.insert(0, html.folded("Answers", answers_table(inputs, members)))
    return sections, [
        PageSection("members", "Appendix: arches of classes", folded, files)
    ]


def table_sections(inputs: ReportInputs) -> Iterator[PageSection]:
    """Yield a section for each structure of a table, and one on how the curves were found."""
    for place, (name, answer) in enumerate(inputs.quoted.items()):
        results = inputs.results(name)
        start = f"{name}: "
        parts = list[Any]()
        own = [
            words.removeprefix(start)
            for words in inputs.cautions
            if words.startswith(start)
        ]
        parts.append(card(answer, inputs.scale, inputs.percent, own, results))
        parts.append(curve_figures.curve(results, answer))
        if answer.crossings:
            parts += _limit_states(inputs, answer, name)
        free = answer.free or {}
        if "test_of_fit" in free:
            parts += heading("Checks"), paragraph(free["test_of_fit"]["message"])
        parts.append(
            html.folded("Verdicts by level", _levels(results, answer, inputs.percent))
        )
        yield PageSection(f"curve{place}", name, parts)
    assumed = dict.fromkeys(each.assumptions for each in inputs.known.values())
    digest = inputs.cube.attrs["table_sha256"]
    words = TEXTS["notes"]["table"].format(digest=digest, version=__version__)
    how = [paragraph(text) for text in (words, *assumed)]
    yield PageSection("glossary", "How the curves were found", how)


def _arch_parts(
    inputs: ReportInputs,
    place: int,
    curve: Picture,
    example: Example | None,
    leads: bool,
) -> Parts:
    """Yield the parts of an arch's section; a film of its `example` unless it `leads`."""
    name, arch, onset = inputs.arches[place]
    answer = inputs.answers[name]
    percent = inputs.percent
    results = inputs.results(name)
    start = f"{name}: "
    design = results.runs.design
    cautions = [
        words.removeprefix(start)
        for words in inputs.cautions
        if words.startswith(start)
    ]
    yield card(answer, inputs.scale, percent, cautions, results, onset)
    groups = run_figures.groupings(results, inputs.confidence)
    yield heading("How it falls")
    yield arch_figure.lost_joints(arch, results)
    if results.counts["collapsed"].any():
        base = base_of(arch.free_end, arch.parameters)
        yield run_figures.fractions(groups, results, base)
    else:
        yield paragraph("No run collapsed.")
    if place < _MOST_ANIMATED and onset.stands:
        yield from _films(inputs, place, None if leads else example)
    if picture := run_figures.ida_curves(results):
        yield heading("How far it moves")
        yield picture
    yield heading("Every run")
    of_runs = (
        run_figures.verdict_map
        if results.own_levels is None
        else run_figures.single_runs
    )
    yield of_runs(results)
    if answer.crossings:
        yield from _limit_states(inputs, answer, name)
    if answer.measures:
        yield from _measures(answer.measures, name, inputs.scale)
    yield heading("The arch and its onset")
    yield arch_figure.arch_at_onset(arch, onset, name)
    texts = facts_text(arch), inset_text(arch, inset_loss(arch)), joints_text(arch)
    for words in filter(None, texts):
        yield paragraph(f"{words[0].upper()}{words[1:]}.")
    yield heading("Checks")
    yield curve
    free = answer.free or {}
    if "test_of_fit" in free:
        yield paragraph(free["test_of_fit"]["message"])
    elif "none" in free:
        yield paragraph(
            f"There is no isotonic curve and no test of fit: {free['none']}."
        )
    yield paragraph(f"Design {design.kind}: {design.text}.")
    if answer.cloud:
        yield paragraph(_cloud(answer.cloud["logistic"], inputs.scale), "note")
    yield html.folded("Verdicts by level", _levels(results, answer, percent))
    yield html.folded(
        "Collapses by mechanism", *_mechanism_table(groups, results, percent)
    )
    geometry = html.pairs(
        f"Geometry of {name}", _geometry(arch.parameters), "parameter"
    )
    yield html.folded("Geometry", geometry)
    computed = html.pairs(
        f"Models, time and accuracy of {name}", _computed(inputs, results)
    )
    yield html.folded("How it was computed", computed)
    if example is not None and (picture := run_figures.timeline(example)):
        yield html.folded("The mechanism in one run", picture)


def _films(inputs: ReportInputs, place: int, fall: Example | None) -> Parts:
    """Yield films of a collapse, unless it is shown elsewhere, and of a near miss."""
    films = []
    results = inputs.results(inputs.arches[place][0])
    if fall is not None and fall.response.collapsed:
        films.append(film(fall, f"fall{place}", "A collapse"))
    miss = repeat(inputs, place, farthest(results))
    if miss is not None and not miss.response.collapsed:
        films.append(film(miss, f"miss{place}", "A near miss", enlarged=True))
    if any(films):
        shown = Markup("\n").join(pair[0] for pair in films if pair is not None)
        yield Markup('<div class="motions">{}</div>').format(shown)


def _class_parts(inputs: ReportInputs, name: str, curves: Picture) -> Parts:
    """Yield the parts of the section of a class; `curves` is the figure of its curves."""
    answer = inputs.classes[name]
    yield card(answer, inputs.scale, inputs.percent)
    yield heading("Fragility curve of the class")
    yield curves
    split = answer.dispersion or {}
    if "none" in split:
        yield paragraph(f"The parts of β are not known: {split['none']}.")
    elif split:
        yield paragraph(TEXTS["notes"]["dispersion"].format(**split))
    if answer.crossings:
        yield from _limit_states(inputs, answer, name)
    members = np.array(list(arch_classes(inputs.cube).values())) == name
    differences = {}
    for key, variable in inputs.cube.data_vars.items():
        if str(key).startswith("arch_") and variable.dtype.kind in "fiu":
            values = variable.values[members].astype(float)
            values[np.isinf(values)] = np.nan  # has no place on an axis
            if np.unique(values[~np.isnan(values)]).size > 1:
                differences[str(key).removeprefix("arch_").replace("_", " ")] = values
    theta = inputs.scale.factor * thetas(inputs.answers.values())[members]
    if figure := curve_figures.theta_panels(
        theta, differences, name, inputs.scale.unit
    ):
        yield heading("What θ depends on")
        yield figure


def answers_table(inputs: ReportInputs, listed: Mapping[str, Curve]) -> Markup:
    """Tabulate the probability, the median and the dispersion of each answer."""
    scale = inputs.scale
    at = inputs.at
    count = Counter(arch_classes(inputs.cube).values())
    heads = ["arch", f"median capacity θ [{scale.unit}] ({inputs.percent})"]
    heads.append(f"dispersion β ({inputs.percent})")
    if at is not None:
        heads.insert(1, f"P(collapse) at {scale.text(at / scale.factor)}")
    rows = []
    for name, answer in listed.items():
        row = [f"{name}, {count[name]} arches" if name in inputs.classes else name]
        row[0] = ", ".join(filter(None, [row[0], inputs.stands_after(name)]))
        rows.append(row)
        if not answer.fitted:
            row += ["no curve", *["–"] * (len(heads) - 2)]
            continue
        if at is not None:
            value, *ends = answer.at(at / scale.factor)
            row.append(f"{html.percentages([value])} ({html.percentages(ends)})")
        theta, low, high = map(scale.digits, (answer.theta, *answer.theta_interval))
        row += [
            f"{theta} ({low} to {high})",
            "{} ({} to {})".format(*answer.dispersion_words()),
        ]
    more = f", the first {_MOST_ROWS}" if len(rows) > _MOST_ROWS else ""
    return table(f"Answer for each arch{more}", heads, rows[:_MOST_ROWS], "compact")


def card(
    answer: Curve,
    scale: Scale,
    percent: str,
    cautions: Sequence[str] = (),
    results: ArchResults | None = None,
    onset: Onset | None = None,
) -> Markup:
    """Return an answer in large digits with its cautions and the numbers of runs other than 0."""
    lost = answer.undecided(scale.text)
    parts = [html.cautions([*cautions, *filter(None, [lost])])]
    figures = []
    counts = {}
    if results is not None:
        counts = {n.replace("_", " "): results.counts[n].sum() for n in COUNTS}
    if not answer.fitted:
        parts.append(paragraph(f"No fragility curve: {answer.reason}.", "none"))
    else:
        low, high = map(scale.digits, answer.theta_interval)
        figures = [
            [
                f"median capacity θ ({scale.measure})",
                scale.text(answer.theta),
                f"{percent}: {low} to {high} {scale.unit}",
            ],
            [
                "dispersion β",
                f"{answer.beta:#.3g}",
                f"{percent}: {html.interval(answer.beta_interval, '#.3g')}",
            ],
        ]
        counts["effective number"] = f"{answer.n_independent:.3g}"
        counts["non-monotone runs"] = answer.n_non_monotone
    if onset is not None:
        plus, minus = map(html.onset_text, (onset.plus, onset.minus))
        about = (
            "in both directions" if plus == minus else f"towards +x; {minus} towards −x"
        )
        if not onset.stands:
            plus = "none"
            about = "does not stand under its own weight"
        figures.append(["onset of motion", plus, about])
    shown = [[label, str(count)] for label, count in counts.items() if count]
    parts += [html.facts(figures, "figures"), html.facts(shown, "figures counts")]
    return Markup('<div class="answer">{}</div>').format(Markup("\n").join(parts))


def _levels(results: ArchResults, answer: Curve, percent: str) -> Markup:
    """Tabulate verdicts and probabilities at each level."""
    counts = results.counts
    records = results.known
    ends = zip(*clopper_pearson(records["collapsed"], records["n"], answer.confidence))
    chance = np.full(results.levels.size, np.nan)
    if answer.fitted:
        chance = answer.probability(results.levels / results.scale.factor)
    columns = {
        results.scale.label: map(digits, results.levels),
        **{name.replace("_", " "): counts[name] for name in COUNTS[:-1]},
        "records with capacity below" if results.runs.gaps else "fraction": [
            measured(value, ".3f") for value in results.fraction
        ],
        f"Clopper–Pearson {percent}": [
            f"{measured(low, '.3f')} – {measured(high, '.3f')}" for low, high in ends
        ],
        "curve": [measured(value, ".3f") for value in chance],
    }
    label = f"Verdicts and probabilities of {results.arch} by level"
    return table(label, list(columns), zip(*columns.values()), "", 0)


def _cloud(fit: Mapping[str, Any], scale: Scale) -> str:
    """Write the curve of a logistic regression, or why there is none."""
    if "none" in fit:
        return f"There is no logistic regression: {fit['none']}."
    theta, low, high = map(scale.digits, (fit["theta"], *fit["theta_interval"]))
    beta = f"β {fit['beta']:.2f} ({html.interval(fit['beta_interval'])})"
    words = f"θ {theta} {scale.unit} ({low} to {high}), {beta}"
    return f"Logistic regression of collapse against ln intensity: {words}."


def _limit_states(inputs: ReportInputs, answer: Curve, name: str) -> Parts:
    """Yield figure and table of limit states."""
    yield heading("Limit states")
    yield paragraph(TEXTS["notes"]["states"])
    yield curve_figures.limit_states(inputs, answer, name)
    yield paragraph(answer.crossings)
    rows = []
    scale = inputs.scale
    for own in answer.states:
        meaning = own.meaning
        numbers = ["–"] * 4
        if not own.fitted:
            meaning += f" (no curve: {own.reason})"
        else:
            theta = html.interval(
                [scale.factor * end for end in own.theta_interval], "#.3g"
            )
            beta = f"{own.beta:.3f}", html.interval(own.beta_interval)
            numbers = [scale.digits(own.theta), theta, *beta]
        rows.append((own.state.replace("_", " "), meaning, *numbers))
    heads = [
        "limit state",
        "meaning",
        f"θ [{scale.unit}]",
        inputs.percent,
        "β",
        inputs.percent,
    ]
    yield table(f"Limit states of {name}", heads, rows, "compact", 2)


def _measures(found: Mapping[str, Any], name: str, scale: Scale) -> Parts:
    """Yield the table of intensity measures, the most efficient first."""
    yield heading("Intensity measures compared")
    if "none" in found:
        yield paragraph(f"No comparison: {found['none']}")
        return
    efficiency = np.array([float(row["efficiency"] or np.nan) for row in found["rows"]])
    percent = 100.0 * np.nan_to_num(
        efficiency / max(np.nanmax(efficiency, initial=0.0), 1e-9)
    )
    bar = Markup('{}<span class="bar"><i style="width:{:.0f}%"></i></span>')
    cells = []
    for i in np.argsort(efficiency):  # nan is last
        row = found["rows"][i]
        label = row["measure"] + " (best)" * (row["measure"] == found["best"])
        label += " (of the study)" * (row["measure"] == scale.measure)
        shown = bar.format(measured(efficiency[i]), percent[i])
        numbers = [measured(row[key]) for key in ("p_magnitude", "p_distance")]
        units = LEVEL_UNITS.get(row["unit"], {})
        unit = scale.unit if scale.unit in units else row["unit"]
        theta = measured(float(row["theta"] or np.nan) / units.get(unit, 1.0))
        cells.append([label, shown, *numbers, theta, unit.replace("2", "²")])
    yield paragraph(found["message"])
    heads = [
        "measure",
        "efficiency: dispersion",
        "p of magnitude",
        "p of distance",
        "θ",
        "unit",
    ]
    yield table(f"Intensity measures for {name}", heads, cells, "dense narrow")
    yield paragraph(TEXTS["notes"]["efficiency"], "note")


def _geometry(parameters: Mapping[str, Any]) -> Parts:
    """Yield names and values of the parameters of an arch, nested ones by both names."""
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            yield from ((f"{key}: {name}", shown) for name, shown in _geometry(value))
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for number, item in enumerate(value):
                yield from _geometry({f"{key} {number + 1}": item})
        elif value is not None:
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            shown = f"{np.size(value)} values" if np.size(value) > 6 else shown
            yield f"{key.replace('_', ' ')}{_UNITS.get(key, '')}", shown
    if parameters.get("dead_load", 0) is None and "fill" not in parameters:
        yield "dead load", "none"


def _mechanism_table(
    groups: Sequence[Contributions], results: ArchResults, percent: str
) -> Iterator[Markup]:
    """Yield the table of collapses by mode and by joint, and what its intervals count."""
    collapsed = results.counts["collapsed"].sum()
    rows = [["all", collapsed, "", ""]]
    for group in groups:
        for i in np.flatnonzero(group.counts.any(axis=1)):
            limits = html.interval((group.lower[i], group.upper[i]))
            fraction = f"{group.fraction[i]:.2f}"
            rows.append([group.categories[i], group.counts[i].sum(), fraction, limits])
    heads = ["motion or joint", "collapses", "fraction", f"{percent} interval"]
    yield table(f"Collapses of {results.arch} by mechanism", heads, rows, "compact")
    if results.own_levels is None and collapsed:
        numbers = {"collapses": collapsed, "effective": groups[0].n_effective}
        yield paragraph(TEXTS["notes"]["effective"].format(**numbers), "note")


def _computed(inputs: ReportInputs, results: ArchResults) -> Parts:
    """Yield names and values of what the computation took and how exact it is."""
    models = inputs.cube["model"].values.astype(str)
    time = dict(zip(models, results["model_time"].sum(axis=(0, 1)).tolist()))
    total = sum(time.values())
    yield "simulated time", f"{total:,.0f} s in {results.counts['runs'].sum():,} runs"
    for model, words in MODEL_WORDS.items():
        if seconds := time[model.name.lower()]:
            yield (
                f"of this, {words}",
                f"{seconds:,.1f} s ({100 * seconds / total:.1f} %)",
            )
    wall = np.array(inputs.timings.get(results.arch, ()), dtype=float)
    if wall.sum() > 0 and total > 0:
        yield (
            "wall time of the simulations, summed over workers",
            f"{wall.sum():,.2f} s",
        )
        yield (
            "wall time for one simulated second",
            f"{1e3 * wall.sum() / total:#.3g} ms",
        )
    counted = TEXTS["computed"].items()
    yield from ((words, f"{results[name].sum():,}") for name, words in counted)
    failed = results.verdict == Verdict.FAILED
    sound = results.simulated & ~failed
    displaced = sound & (results["peak_displacement"] >= 1e-4)
    of = f"{displaced.sum()} runs displaced by 0.1 mm or more"
    error = results["energy_error"]
    residual = results["contact_residual"]
    yield (
        f"energy error, median and largest ({of})",
        html.median_and_largest(error[displaced]),
    )
    yield (
        "contact residual, median and largest",
        html.median_and_largest(residual[sound]),
    )
    if failed.any():
        label = "contact residual of solver failures, median and largest"
        yield label, html.median_and_largest(residual[failed])
