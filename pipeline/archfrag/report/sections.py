"""Sections of the page on arches and classes, part by part in the order of the page."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from archfrag.arch.facts import facts_text
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import Contributions
from archfrag.fragility.verdicts import Verdict, clopper_pearson
from archfrag.motions.measures import LEVEL_UNITS
from archfrag.properties import PROPERTIES, Property
from archfrag.report import arch_figure, curve_figures, run_figures
from archfrag.report.film import Example, farthest, film, repeat
from archfrag.report.html import (
    TEXTS,
    Picture,
    cautions,
    digits,
    facts,
    folded,
    heading,
    interval,
    lines,
    measured,
    median_and_largest,
    onset_text,
    pairs,
    paragraph,
    percentages,
    table,
    three,
)
from archfrag.report.inputs import COUNTS, ArchResults, ReportInputs
from archfrag.report.limits import base_of
from archfrag.simulation.response import MODEL_WORDS
from archfrag.simulation.simulate import Onset
from archfrag.simulation.standing import edge_loss, edge_text, joints_text
from archfrag.study.file.members import SHOWN
from archfrag.version import __version__

Parts = Iterator[Any]  # of a section: texts, tables and figures; None is left out
_MOST_ANIMATED = 4  # arches with films
_MOST_ROWS = 200
_SPELT = {"degrees": "deg", "kg/m3": "kg/m³"}  # units of keys
_REMARKS = TEXTS["notes"]


@dataclass(frozen=True)
class PageSection:
    """A chapter of the page: a title, and below it texts, tables and figures in order."""

    anchor: str
    title: str
    parts: Sequence[Any]  #: None is left out
    files: Mapping[str, Picture] = field(
        default_factory=dict
    )  #: figures that are written as files too, by file name


def class_sections(inputs: ReportInputs) -> Iterator[PageSection]:
    """Yield a section for each class of several arches."""
    for place, name in enumerate(inputs.classes):
        members = [arch for arch, of in inputs.of_class.items() if of == name]
        curves = curve_figures.all_curves(inputs, members, [name])
        split = inputs.classes[name].dispersion or {}
        parts = [card(inputs, name), heading("Fragility curve of the class"), curves]
        if "none" in split:
            parts.append(paragraph(f"The parts of β are not known: {split['none']}."))
        elif split:
            parts.append(paragraph(_REMARKS["dispersion"].format(**split)))
        falls = curve_figures.part_panel(inputs.results(name), inputs.curves[name])
        parts += _headed("Where they fall", falls)
        parts += _limit_states(inputs, name)
        if name in inputs.surfaces:
            parts.append(heading("Movement of a springing, and shaking"))
            parts.append(curve_figures.surface_panel(inputs.surfaces[name], name))
        panels = curve_figures.theta_panels(inputs, members, name)
        parts += _headed("What θ depends on", panels)
        files = {f"curve-{name}.svg": curves}
        yield PageSection(f"class{place}", f"Class {name}", parts, files)


def arch_sections(
    inputs: ReportInputs, examples: Mapping[str, Example | None], lead: str
) -> tuple[list[PageSection], list[PageSection]]:
    """Return a section for each arch without a class, and an appendix on arches of classes.

    `examples` has a run of each arch that was simulated again; that of the arch `lead` is on the
    first page.
    """
    members = [name for name in inputs.answers if name not in inputs.quoted]
    appendix = [folded("Answers", answers_table(inputs, members))]
    files = dict[str, Picture]()
    sections = list[PageSection]()
    # An arch that has the name of its study was not given any.
    unnamed = [inputs.cube.attrs.get("archfrag_study")] == list(inputs.answers)
    for place, (name, example) in enumerate(examples.items()):
        curve = curve_figures.curve(inputs.results(name), inputs.curves[name])
        file = {} if len(inputs.answers) > SHOWN else {f"curve-{name}.svg": curve}
        parts = list(_arch_parts(inputs, place, name, curve, example, name == lead))
        if name in members:
            appendix.append(folded(name, *parts))
            files |= file
        else:
            title = "The arch" if unnamed else name
            sections.append(PageSection(f"arch{place}", title, parts, file))
    if not members:
        return sections, []
    title = "Appendix: arches of classes"
    return sections, [PageSection("members", title, appendix, files)]


def table_sections(inputs: ReportInputs) -> Iterator[PageSection]:
    """Yield a section for each structure of a table, and one on how the curves were found."""
    for place, (name, answer) in enumerate(inputs.quoted.items()):
        results = inputs.results(name)
        parts = [card(inputs, name), curve_figures.curve(results, answer)]
        parts += _limit_states(inputs, name)
        if "test_of_fit" in (answer.free or {}):
            parts += heading("Checks"), *_fit_test(answer)
        parts.append(folded("Verdicts by level", _levels(results, answer)))
        yield PageSection(f"curve{place}", name, parts)
    assumed = dict.fromkeys(each.assumptions for each in inputs.known.values())
    digest = inputs.cube.attrs["table_sha256"]
    words = _REMARKS["table"].format(digest=digest, version=__version__)
    how = list(map(paragraph, (words, *assumed)))
    yield PageSection("glossary", "How the curves were found", how)


def _arch_parts(
    inputs: ReportInputs,
    place: int,
    name: str,
    curve: Picture,
    example: Example | None,
    leads: bool,
) -> Parts:
    """Yield the parts of an arch's section.

    `place` is its number on the page, `curve` its figure of the curve. A film of its `example` is
    among the parts unless it `leads`: then the film is on the first page.
    """
    onset = inputs.arches[name]
    arch = onset.arch
    answer = inputs.curves[name]
    results = inputs.results(name)
    design = results.runs.design
    yield card(inputs, name, onset)
    groups = run_figures.groupings(results, inputs.confidence, arch)
    yield heading("How it falls")
    yield arch_figure.lost_joints(arch, results)
    if results.counts["collapsed"].any():
        yield run_figures.fractions(groups, results, base_of(arch))
    else:
        yield paragraph("No run collapsed.")
    yield from _headed("Where it falls", curve_figures.part_panel(results, answer))
    if place < _MOST_ANIMATED and onset.stands:
        yield from _films(inputs, place, name, None if leads else example)
    yield from _headed("How far it moves", run_figures.ida_curves(results))
    yield heading("Every run")
    single = results.own_levels is not None
    yield (run_figures.single_runs if single else run_figures.verdict_map)(results)
    yield from _limit_states(inputs, name)
    if answer.measures:
        yield from _measures(inputs, answer.measures, name)
    yield heading("The arch and its onset")
    yield arch_figure.arch_at_onset(onset, name)
    if arch.places and onset.stands:
        for towards in ("+x", "-x"):
            words = (
                f"Onset towards {towards.replace('-', '−')}: {onset.places(towards)}."
            )
            yield paragraph(words)
    edges = edge_text(arch, edge_loss(arch))
    texts = onset.transverse_text, facts_text(arch), edges, joints_text(arch)
    for words in filter(None, texts):
        yield paragraph(f"{words[0].upper()}{words[1:]}.")
    yield heading("Checks")
    yield curve
    yield from _fit_test(answer)
    asked = "each record at its own levels" if results.runs.by_level else design.text
    yield paragraph(f"Design {design.kind}: {asked}.")
    if answer.cloud:
        yield paragraph(_cloud(inputs, answer.cloud["logistic"]), "note")
    yield folded("Verdicts by level", _levels(results, answer))
    mechanisms = _mechanism_table(groups, results, inputs.percent)
    yield folded("Collapses by mechanism", *mechanisms)
    geometry = _geometry(arch.parameters)
    yield folded("Geometry", pairs(f"Geometry of {name}", geometry, "parameter"))
    computed = f"Models, time and accuracy of {name}", _computed(inputs, results)
    yield folded("How it was computed", pairs(*computed))
    if example is not None:
        yield folded("The mechanism in one run", run_figures.timeline(example))


def _headed(title: str, picture: Picture | None) -> Parts:
    """Yield a heading and a picture, if there is one."""
    if picture:
        yield heading(title)
        yield picture


def _fit_test(answer: Curve) -> Parts:
    """Yield what the test of fit found, or why there is none."""
    free = answer.free or {}
    if "test_of_fit" in free:
        yield paragraph(free["test_of_fit"]["message"])
    elif "none" in free:
        words = f"There is no isotonic curve and no test of fit: {free['none']}."
        yield paragraph(words)


def _films(inputs: ReportInputs, place: int, name: str, fall: Example | None) -> Parts:
    """Yield films of a collapse and of a near miss, as far as there are any.

    `fall` is the collapse, None if it is shown elsewhere.
    """
    films = []
    if fall is not None and fall.response.collapsed:
        films.append(film(fall, f"fall{place}", "A collapse"))
    miss = repeat(inputs, name, farthest(inputs.results(name)))
    if miss is not None and not miss.response.collapsed:
        films.append(film(miss, f"miss{place}", "A near miss", enlarged=True))
    if any(films):
        shown = lines(pair[0] for pair in films if pair is not None)
        yield Markup('<div class="motions">{}</div>').format(shown)


def answers_table(inputs: ReportInputs, names: Iterable[str]) -> Markup:
    """Return a table of the probability, the median and the dispersion of curves, by name."""
    at = inputs.at
    count = Counter(inputs.of_class.values())
    heads = ["arch", f"median capacity θ [{inputs.scale.unit}] ({inputs.percent})"]
    heads.append(f"dispersion β ({inputs.percent})")
    if at is not None:
        heads.insert(1, f"P(collapse) at {inputs.scale.text(at)}")
    rows = []
    for name in names:
        answer = inputs.curves[name]
        about = f"{name}, {count[name]} arches" if name in inputs.classes else name
        row = [", ".join(filter(None, [about, inputs.stands_after(name)]))]
        rows.append(row)
        if not answer.fitted:
            row += ["no curve", *["–"] * (len(heads) - 2)]
            continue
        if at is not None:
            value, *ends = answer.at(at)
            row.append(f"{percentages([value])} ({percentages(ends)})")
        row.append(
            f"{digits(answer.theta)} ({interval(answer.theta_interval, digits)})"
        )
        row.append("{} ({} to {})".format(*answer.dispersion_words()))
    more = f", the first {_MOST_ROWS}" if len(rows) > _MOST_ROWS else ""
    return table(f"Answer for each arch{more}", heads, rows[:_MOST_ROWS], "compact")


def card(inputs: ReportInputs, name: str, onset: Onset | None = None) -> Markup:
    """Return the answer for an arch or a class in large digits.

    For an arch its cautions and its numbers of runs, without zeros, are added; with `onset` its
    onset of motion too.
    """
    answer = inputs.curves[name]
    scale = inputs.scale
    percent = inputs.percent
    messages = []
    figures = []
    counts = {}
    if name in inputs.answers:
        own = [each for each in inputs.cautions if each.startswith(f"{name}: ")]
        messages = [each.removeprefix(f"{name}: ") for each in own]
        verdicts = inputs.results(name).counts
        counts = {each.replace("_", " "): verdicts[each].sum() for each in COUNTS}
    lost = answer.undecided(scale.text)
    parts = [cautions([*messages, *[lost] * bool(lost)])]
    if not answer.fitted:
        parts.append(paragraph(f"No fragility curve: {answer.reason}.", "none"))
    else:
        ends = f"{percent}: {interval(answer.theta_interval, digits)} {scale.unit}"
        label = f"median capacity θ ({scale.measure})"
        figures.append([label, scale.text(answer.theta), ends])
        ends = f"{percent}: {interval(answer.beta_interval, three)}"
        figures.append(["dispersion β", three(answer.beta), ends])
        counts["effective number"] = f"{answer.n_independent:.3g}"
        counts["non-monotone runs"] = answer.n_non_monotone
    if onset is not None:
        plus, minus = map(onset_text, (onset.plus, onset.minus))
        about = f"towards +x; {minus} towards −x"
        if plus == minus:
            about = "in both directions"
        if not onset.stands:
            plus = "none"
            about = "does not stand under its own weight"
        figures.append(["onset of motion", plus, about])
        if onset.transverse is not None:
            pier, column = onset.transverse
            limit = onset_text(column.least)
            figures.append(["onset across the bridge", limit, f"of {pier}"])
    shown = [(label, count) for label, count in counts.items() if count]
    parts += [facts(figures, "figures"), facts(shown, "figures counts")]
    return Markup('<div class="answer">{}</div>').format(lines(parts))


def _levels(results: ArchResults, answer: Curve) -> Markup:
    """Tabulate verdicts and probabilities at each level."""
    records = results.known
    ends = clopper_pearson(records["collapsed"], records["n"], answer.confidence)
    fraction, low, high, curve = (
        [measured(value, ".3f") for value in values]
        for values in (results.fraction, *ends, answer(results.levels))
    )
    columns = {
        results.scale.label: map(digits, results.levels),
        **{name.replace("_", " "): results.counts[name] for name in COUNTS[:-1]},
        "records with capacity below" if results.runs.gaps else "fraction": fraction,
        f"Clopper–Pearson {100 * answer.confidence:.0f} %": map(
            " – ".join, zip(low, high)
        ),
        "curve": curve,
    }
    label = f"Verdicts and probabilities of {results.arch} by level"
    return table(label, list(columns), zip(*columns.values()), "", 0)


def _cloud(inputs: ReportInputs, fit: Mapping[str, Any]) -> str:
    """Return a sentence on a logistic regression `fit` [SI], or on why there is none."""
    if "none" in fit:
        return f"There is no logistic regression: {fit['none']}."
    scale = inputs.scale
    theta, *ends = (
        scale.factor * each for each in (fit["theta"], *fit["theta_interval"])
    )
    beta = f"β {fit['beta']:.2f} ({interval(fit['beta_interval'])})"
    words = f"θ {scale.text(theta)} ({interval(ends, digits)}), {beta}"
    return f"Logistic regression of collapse against ln intensity: {words}."


def _limit_states(inputs: ReportInputs, name: str) -> Parts:
    """Yield figure and table of limit states, if there are any."""
    answer = inputs.curves[name]
    if not answer.crossings:
        return
    yield heading("Limit states")
    yield paragraph(_REMARKS["states"])
    yield curve_figures.limit_states(inputs, answer, name)
    yield paragraph(answer.crossings)
    rows = []
    for own in answer.states:
        meaning = own.meaning
        numbers = ["–"] * 4
        if not own.fitted:
            meaning += f" (no curve: {own.reason})"
        else:
            theta = digits(own.theta), interval(own.theta_interval, three)
            numbers = [*theta, f"{own.beta:.3f}", interval(own.beta_interval)]
        rows.append((own.state.replace("_", " "), meaning, *numbers))
    percent = inputs.percent
    heads = [
        "limit state",
        "meaning",
        f"θ [{inputs.scale.unit}]",
        percent,
        "β",
        percent,
    ]
    yield table(f"Limit states of {name}", heads, rows, "compact", 2)


def _measures(inputs: ReportInputs, found: Mapping[str, Any], name: str) -> Parts:
    """Yield the table of intensity measures, the most efficient first."""
    yield heading("Intensity measures compared")
    if "none" in found:
        yield paragraph(f"No comparison: {found['none']}")
        return
    scale = inputs.scale
    efficiency = np.array([float(row["efficiency"] or np.nan) for row in found["rows"]])
    largest = max(np.nanmax(efficiency, initial=0.0), 1e-9)
    percent = 100.0 * np.nan_to_num(efficiency / largest)
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
    heads = ["measure", "efficiency: dispersion", "p of magnitude", "p of distance"]
    label = f"Intensity measures for {name}"
    yield table(label, [*heads, "θ", "unit"], cells, "dense narrow")
    yield paragraph(_REMARKS["efficiency"], "note")


def _geometry(parameters: Mapping[str, Any], block: str = "") -> Parts:
    """Yield names and values of the parameters of an arch.

    The name of a nested parameter has that of its block in front; `block` is for its unit.
    """
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            nested = _geometry(value, f"{key}.")
            yield from ((f"{key}: {name}", shown) for name, shown in nested)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for number, item in enumerate(value):
                yield from _geometry({f"{key} {number + 1}": item})
        elif value is not None:
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            shown = f"{np.size(value)} values" if np.size(value) > 6 else shown
            unit = PROPERTIES.get(block + key, Property()).unit
            unit = f" [{_SPELT.get(unit, unit)}]" if unit else ""
            yield f"{key.replace('_', ' ')}{unit}", shown
    if parameters.get("dead_load", 0) is None and "fill" not in parameters:
        yield "dead load", "none"


def _mechanism_table(
    groups: Sequence[Contributions], results: ArchResults, percent: str
) -> Iterator[Markup]:
    """Yield the table of collapses by mode, joint and part, and a remark on its intervals."""
    collapsed = results.counts["collapsed"].sum()
    rows = [["all", collapsed, "", ""]]
    for group in groups:
        ends = zip(group.lower, group.upper)
        parts = group.categories, group.counts.sum(axis=1), group.fraction, ends
        for category, count, fraction, limits in zip(*parts):
            if count:
                rows.append([category, count, f"{fraction:.2f}", interval(limits)])
    what = "motion, joint, span or pier" if groups[2:] else "motion or joint"
    heads = [what, "collapses", "fraction", f"{percent} interval"]
    yield table(f"Collapses of {results.arch} by mechanism", heads, rows, "compact")
    if results.own_levels is None and collapsed:
        numbers = {"collapses": collapsed, "effective": groups[0].n_effective}
        yield paragraph(_REMARKS["effective"].format(**numbers), "note")


def _computed(inputs: ReportInputs, results: ArchResults) -> Parts:
    """Yield names and values on the time and the accuracy of the computation."""
    models = inputs.cube["model"].values.astype(str)
    time = dict(zip(models, results["model_time"].sum(axis=(0, 1)).tolist()))
    total = sum(time.values())
    yield "simulated time", f"{total:,.0f} s in {results.counts['runs'].sum():,} runs"
    for model, words in MODEL_WORDS.items():
        seconds = time[model]
        if seconds:
            part = f"{seconds:,.1f} s ({100 * seconds / total:.1f} %)"
            yield f"of this, {words}", part
    wall = sum(inputs.timings.get(results.arch, ()))
    if wall > 0 and total > 0:
        yield "wall time of the simulations, summed over workers", f"{wall:,.2f} s"
        yield "wall time for one simulated second", f"{1e3 * wall / total:#.3g} ms"
    for name, words in TEXTS["computed"].items():
        yield words, f"{results[name].sum():,}"
    failed = results.verdict == Verdict.FAILED
    sound = results.simulated & ~failed
    displaced = sound & (results["peak_displacement"] >= 1e-4)
    of = f"{displaced.sum()} runs displaced by 0.1 mm or more"
    error = median_and_largest(results["energy_error"][displaced])
    residual = results["contact_residual"]
    yield f"energy error, median and largest ({of})", error
    yield "contact residual, median and largest", median_and_largest(residual[sound])
    if failed.any():
        label = "contact residual of solver failures, median and largest"
        yield label, median_and_largest(residual[failed])
