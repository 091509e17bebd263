"""Figures of fragility curves, and of what the median capacities of a class depend on."""

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.special import ndtr

from archfrag.fragility.curve import Curve, FloatArray
from archfrag.fragility.verdicts import clopper_pearson
from archfrag.report.html import TEXTS, rounded
from archfrag.report.inputs import ArchResults, ReportInputs, Scale, thetas
from archfrag.report.run_figures import level_axis, stacked
from archfrag.report.svg import (
    BELOW,
    BLUE,
    COLOURS,
    GREY,
    INK,
    LINE,
    PALE,
    SKY,
    VERMILION,
    Entry,
    Panel,
    Sheet,
    Words,
    figure,
    log_ticks,
    panel_below,
    shortened,
)
from archfrag.study.answer.compare import part_curves
from archfrag.study.answer.rates import ArchRisk
from archfrag.study.answer.surface import Surface
from archfrag.study.hazard import Hazard

_REACH = 1e-4  # part of the greatest density of the rate at which the axis ends
_LEFT = 66.0  # space left of the panels, and heights of the panels [px]
_HEIGHTS = (150.0, 110.0, 110.0)

MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
_MOST_PANELS = 9  # values by which the arches of a class differ
_SHADED = 6  # curves that are drawn with their bands
# Light to severe.
_DAMAGE = ("#f9a58a", "#f4795b", "#e34a33", "#c4281c", "#96120f", "#67000d")
_SAME = 0.01  # difference of probabilities that nobody sees


def curve_panel(
    sheet: Sheet,
    entries: Sequence[Entry],
    reach: float,
    title: str,
    words: str = "probability of collapse",
) -> Panel:
    """Draw the axes of a figure of curves below its legend; return their panel."""
    panel = panel_below(sheet, entries, 300.0, (0.0, reach), (0.0, 1.0))
    panel.axis_y(words)
    panel.axis_x(title, 9, grid=True)
    return panel


def draw_curve(
    panel: Panel, fit: Curve, stroke: Entry, width: float = 1.8, band: bool = True
) -> None:
    """Draw a curve with its band, if it has one; nothing if there is no curve."""
    if band and fit.im:
        im, low, high = np.array([fit.im, fit.lower, fit.upper])
        seen = im <= panel.x[1] * (1.0 + 1e-9)  # also where both end
        shade = SKY if stroke.colour == BLUE else stroke.colour
        panel.band(im[seen], low[seen], high[seen], shade, 0.25)
    im = np.linspace(0.0, panel.x[1], 100)
    panel.line(im, fit(im), stroke.colour, width, stroke.dash)


def _stroke(name: str, place: int, colours: Sequence[str] = COLOURS) -> Entry:
    """Choose the colour and the stroke of the curve at a place in a legend."""
    dashed = place // len(colours) % 2
    return Entry(name, colours[place % len(colours)], "dash" if dashed else "line")


def _thinned(fits: Iterable[Curve]) -> list[Curve]:
    """Choose at most `MOST_THIN` curves, evenly from the weakest to the strongest."""
    ordered = sorted(fits, key=lambda fit: fit.theta)
    places = np.linspace(0, len(ordered) - 1, min(len(ordered), MOST_THIN))
    return [ordered[i] for i in places.round().astype(int)]


def _medians(inputs: ReportInputs, fits: Mapping[str, Curve]) -> str:
    """Return a line of text with the medians of curves."""
    text = inputs.scale.text
    words = [f"{name} {text(fit.theta)}" for name, fit in fits.items()]
    return f"Medians: {'; '.join(words)}"


def _band_words(answer: Curve) -> str:
    """Return text on the band of a curve and its assumptions; empty without a band."""
    if not answer.method:
        return ""
    return f" Shaded: pointwise band, {answer.method}. {answer.assumptions.removesuffix('.')}."


@figure
def curve(sheet: Sheet, results: ArchResults, answer: Curve) -> Words:
    """Draw the curve of an arch with its band, and the observed capacities or fractions.

    Capacities are drawn if some records were not run at all levels, else fractions.
    """
    scale = results.scale
    percent = f"{100 * answer.confidence:.0f} %"
    texts = TEXTS["curve"]
    highest = results.levels.max()
    isotonic = None
    if results.runs.gaps:
        caption = texts["searched"]
        entries = [Entry("capacities of the records", INK, "line")]
    else:
        caption = texts["stripes" if results.own_levels is None else "grouped"]
        entries = [Entry(f"fraction, exact {percent} interval", INK, "dot")]
        isotonic = (answer.free or {}).get("isotonic")
    reach = 1.05 * highest
    median = scale.text(answer.theta)
    stroke = Entry("lognormal curve", BLUE, "line")
    what = "no lognormal curve could be fitted"
    if answer.fitted:
        entries += [stroke, Entry(f"{percent} band", "#c9e3f5")]
        what = f"lognormal curve with median {median} and dispersion {answer.beta:.3f}"
        reach = min(max(reach, 1.1 * answer.theta), 3.0 * highest)
        caption += _band_words(answer)
    most = answer.likelihood or Curve()
    likeliest = Entry("by maximum likelihood", BLUE, "dash")
    if most.fitted:
        entries.append(likeliest)
        caption += f" Dashed: θ {scale.text(most.theta)}, β {most.beta:.3f}."
    if isotonic:
        entries.append(Entry("isotonic", GREY, "line"))
        caption += texts["isotonic"]
    panel = curve_panel(sheet, entries, reach, scale.label)
    draw_curve(panel, answer, stroke)
    draw_curve(panel, most, likeliest, 0.9)
    if isotonic:
        im = scale.factor * np.array(isotonic["im"])
        panel.line(im, isotonic["probability"], GREY, 0.9)
    if answer.theta <= reach:
        corner = [0.0, answer.theta, answer.theta]
        panel.line(corner, [0.5, 0.5, 0.0], GREY, 0.8, "4 3")
        panel.label(answer.theta, panel.box[3] - 6.0, f"θ = {median}", "s")
    if reach > 1.05 * highest:
        panel.upright(highest)
        caption += texts["extrapolated"]
    if results.runs.gaps:
        capacity = results.capacities
        seen = np.sort(capacity[capacity <= reach])
        height = np.arange(seen.size + 1) / max(capacity.size, 1)
        steps = np.concatenate([[0.0], np.repeat(seen, 2), [highest]])
        panel.line(steps, np.repeat(height, 2), INK, 1.1)
    else:
        used = results.counts["n"] > 0
        collapses, n = (results.counts[key][used] for key in ("collapsed", "n"))
        ends = clopper_pearson(collapses, n, answer.confidence)
        bars = np.column_stack([*ends, np.full(n.size, np.nan)])
        panel.line(np.repeat(results.levels[used], 3), bars.ravel(), INK, 0.9)
        panel.dots(results.levels, results.fraction, INK)
    return (
        f"Probability of collapse of {results.arch} against {scale.label}: {what}",
        caption,
    )


@figure
def all_curves(
    sheet: Sheet, inputs: ReportInputs, arches: Collection[str], classes: Sequence[str]
) -> Words | None:
    """Draw the curves of arches and classes in one figure; None if there are fewer than two.

    Classes, and arches without a class if they are few, have named curves. All others are thin
    curves below these, in one colour for each class.
    """
    if len(arches) + len(classes) < 2:
        return None
    named, curves = (
        {k: inputs.curves[k] for k in some if inputs.curves[k].fitted}
        for some in (classes, arches)
    )
    label = inputs.scale.label
    at = inputs.at
    reach = 1.05 * inputs.highest
    of_class = inputs.of_class
    single = {k: fit for k, fit in curves.items() if of_class[k] not in classes}
    thin = [
        (
            _stroke("", i).colour,
            [fit for k, fit in curves.items() if of_class[k] == name],
        )
        for i, name in enumerate(classes)
    ]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((GREY, [*single.values()]))
    strokes = [_stroke(name, i) for i, name in enumerate(named)]
    thinned = any(fits for _, fits in thin)
    key = strokes + [Entry("each arch", "#b5bec8", "line")] * thinned
    panel = curve_panel(sheet, key, reach, label)
    if at is not None and 0.0 < at < reach:
        panel.upright(at)
    im = np.linspace(0.0, reach, 34)
    for colour, fits in thin:
        shown = _thinned(fits)
        opacity = np.clip(25.0 / max(len(shown), 1), 0.15, 0.5)
        for fit in shown:
            panel.line(im, fit(im), colour, 0.5, opacity=opacity)
    shaded = len(named) <= _SHADED
    observed = [name for name in named if name in inputs.answers]
    for stroke, (name, fit) in zip(strokes, named.items()):
        draw_curve(panel, fit, stroke, band=shaded)
        if name in observed:
            results = inputs.results(name)
            seen = results.levels <= reach
            dots = results.levels[seen], results.fraction[seen]
            panel.dots(*dots, stroke.colour, radius=2.2)
    words = TEXTS["all_curves"]
    kind = "Curves" if classes else "Lognormal curves"
    whose = f"class {classes[0]}" if len(classes) == 1 else "a class"
    caption = words["bands" if shaded else "curves"].format(kind=kind)
    caption += words["points"] * bool(observed)
    caption += words["classes"].format(whose=whose) * bool(classes)
    caption += words["at"] * (at is not None)
    if shaded and classes:
        only = _band_words(inputs.curves[classes[0]])
        caption += only if len(classes) == 1 else words["several"]
    what = f"Fragility curves of {len(curves)} arches against {label}. "
    what += _medians(inputs, named | dict(list(curves.items())[:40]))
    return what, caption


@figure
def limit_states(
    sheet: Sheet, inputs: ReportInputs, answer: Curve, name: str
) -> str | None:
    """Draw the curves of the limit states of an arch or a class; None if no state has one."""
    curves = {
        _stroke(fit.state.replace("_", " "), i, _DAMAGE): fit
        for i, fit in enumerate(answer.states)
        if fit.fitted
    }
    if not curves:
        return None
    label = inputs.scale.label
    reach = 1.05 * inputs.highest
    panel = curve_panel(sheet, [], reach, label, "probability of reaching it")
    im = np.linspace(0.0, reach, 400)
    seen = list[tuple[str, FloatArray]]()
    for stroke, fit in curves.items():
        draw_curve(panel, fit, stroke, band=False)
        words = stroke.label
        chance = fit(im)
        if seen and np.abs(chance - seen[-1][1]).max() < _SAME:
            words = f"{seen.pop()[0]}, {words}"
        seen.append((words, chance))
    # Above the curves is room on the left, below them on the right.
    for part, (words, chance) in zip(np.linspace(0.85, 0.2, len(seen)), seen):
        i = int(np.searchsorted(chance, part * chance[-1]))
        panel.dots(im[[i]], chance[[i]], INK, radius=2.4)
        panel.label(im[i], float(panel.at_y(chance[i])) + 4.0, words, left=part > 0.5)
    medians = _medians(inputs, {stroke.label: fit for stroke, fit in curves.items()})
    return f"Curves of limit states of {name} against {label}. {medians}"


@figure
def part_panel(sheet: Sheet, results: ArchResults, answer: Curve) -> Words | None:
    """Draw P(a collapse in each part of a bridge) with bands; None if there are no parts."""
    reach = 1.05 * results.levels.max()
    table = part_curves(results.runs, answer, np.linspace(0.0, reach, 100))
    if table.empty:
        return None
    strokes = [_stroke(name, i) for i, name in enumerate(table["part"].unique())]
    whole = Entry("all parts", INK, "line")
    panel = curve_panel(
        sheet, [*strokes, whole], reach, results.scale.label, "probability there"
    )
    draw_curve(panel, answer, whole, 1.0, band=False)
    for stroke, (_, part) in zip(strokes, table.groupby("part", sort=False)):
        panel.band(part["im"], part["lower"], part["upper"], stroke.colour, 0.2)
        panel.line(part["im"], part["probability"], stroke.colour, 1.8, stroke.dash)
    caption = TEXTS["part_panel"]["caption"]
    return (
        f"Curves of {results.arch} by part",
        caption.format(count=len(strokes), percent=100 * answer.confidence),
    )


@figure
def surface_panel(sheet: Sheet, surface: Surface, name: str) -> Words:
    """Draw contours of P(collapse) against the movement of a springing and the intensity."""
    table = surface.contours([0.5, 0.05, 0.25, 0.75, 0.95])
    title, label = surface.to_dataframe().columns[:2]
    strokes = [_stroke(f"P = {p:g}", i) for i, p in enumerate(table)]
    falls = [each for each in surface.border if np.isfinite(each)]
    ends = [*table.index, *falls]
    reach = table.to_numpy().max()
    panel = panel_below(sheet, strokes, 300.0, (min(ends), max(ends)), (0.0, reach))
    panel.axis_y(label)
    panel.axis_x(title, 9, grid=True)
    _draw_contours(panel, surface, table, strokes)
    for end in falls:
        panel.line([end, end], [0.0, reach], VERMILION, 1.6, "4 3")
    return f"Surface of {name}: {title}, {label}", TEXTS["surface_panel"]["caption"]


def _draw_contours(
    panel: Panel, surface: Surface, table: pd.DataFrame, strokes: Sequence[Entry]
) -> None:
    """Draw a table of contours, and the intervals of the medians."""
    low, high = zip(*(each.theta_interval for each in surface.curves))
    panel.band(table.index, low, np.minimum(high, panel.y[1]), SKY, 0.25)
    for p, stroke in zip(table, strokes):
        panel.line(table.index, table[p], stroke.colour)


@figure
def theta_panels(
    sheet: Sheet, inputs: ReportInputs, members: Sequence[str], name: str
) -> str | None:
    """Draw theta of the arches of a class against each value in which they differ.

    Lines show `effects_on_theta`, if there are enough arches; the value with the largest effect is
    first. Return None if no value differs, or if fewer than two arches have a curve.
    """
    theta = thetas(inputs.curves[arch] for arch in members)
    fitted = np.isfinite(theta)
    theta = theta[fitted]
    values = {}
    lines = {}
    for variable, numbers in inputs.cube.data_vars.items():
        if str(variable).startswith("arch_") and numbers.dtype.kind in "fiu":
            each = numbers.sel(arch=list(members)).values.astype(float)
            each[np.isinf(each)] = np.nan  # has no place on an axis
            if np.unique(each[~np.isnan(each)]).size > 1:
                key = str(variable).removeprefix("arch_").replace("_", " ")
                values[key] = each[fitted]
    if not values or theta.size < 2:
        return None
    finite = [key for key, each in values.items() if np.isfinite(each).all()]
    if finite and theta.size >= len(finite) + 2:
        columns = np.column_stack([values[key] for key in finite])
        lines = dict(zip(finite, effects_on_theta(theta, columns)[1]))
    order = sorted(lines, key=lambda key: -abs(np.diff(np.log(lines[key]))[0]))
    shown = [*order, *(key for key in values if key not in lines)][:_MOST_PANELS]
    margin = 0.05 * np.ptp(theta) or 0.05 * theta[0]
    ends = theta.min() - margin, theta.max() + margin
    for box, key in zip(sheet.grid(len(shown), 3, 150.0, BELOW - LINE), shown):
        low = np.nanmin(values[key])
        high = np.nanmax(values[key])
        reach = low - 0.04 * (high - low), high + 0.04 * (high - low)
        panel = Panel(sheet, box, reach, ends)
        panel.axis_x(most=4)
        panel.axis_y(f"θ [{inputs.scale.unit}]")
        panel.dots(values[key], theta, BLUE, radius=2.4)
        if key in lines:
            middle = values[key].mean()
            away = values[key].std(ddof=1)
            panel.line([middle - away, middle + away], lines[key], VERMILION, 2.0)
        panel.heading(shortened(key, box[2] - box[0]))
    return (
        f"Median capacities of {theta.size} arches of {name} against {', '.join(shown)}"
    )


def effects_on_theta(theta: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Return theta at the means of all values, and theta with one value off its mean.

    The second result, (n_value, 2), has each value a standard deviation below and above its mean.
    Both are by a linear regression of ln `theta` (n_arch,) on the `values` (n_arch, n_value).
    """
    unit = (values - values.mean(axis=0)) / values.std(axis=0, ddof=1)
    lines = np.column_stack([np.ones(len(unit)), unit])
    middle, *effects = np.linalg.lstsq(lines, np.log(theta), rcond=None)[0]
    return float(np.exp(middle)), np.exp(middle + np.outer(effects, (-1.0, 1.0)))


@figure
def hazard_and_fragility(
    sheet: Sheet, arch: ArchRisk, hazard: Hazard, scale: Scale
) -> str:
    """Draw the hazard curve, the fragility curve and the rate of collapse per ln intensity."""
    # Intensities from which all but a small part of the rate comes.
    wide = np.concatenate([arch.levels, hazard.main.im, [arch.fit.theta]])
    im = np.geomspace(0.2 * wide.min(), 5.0 * wide.max(), 1200)
    density = _density(arch, hazard, im)
    used = im[density > _REACH * density.max()]
    im = np.geomspace(min(used[0], arch.levels[0]), max(used[-1], arch.levels[-1]), 200)
    density = _density(arch, hazard, im)
    shown = scale.factor * im
    rates = [curve.rate_at(im) for curve in hazard.curves.values()]
    points = hazard.main.im * scale.factor
    ends = (shown[0], shown[-1])
    seen = (points >= ends[0]) & (points <= ends[1])
    every = np.concatenate(rates)
    low = every[every > 0.0].min()
    high = every.max()
    entries = [Entry(f"hazard: {key}", GREY, "line") for key in hazard.curves]
    entries[0] = entries[0]._replace(colour=VERMILION)
    top = sheet.legend(_LEFT, 0.0, entries) - 8.0
    panels: list[Panel] = []
    reaches = (low, high), (0.0, 1.0), (0.0, 1.05 * density.max())
    for height, y in zip(_HEIGHTS, reaches):
        top += 14.0
        box = (_LEFT, top, sheet.width - 10.0, top + height)
        panels.append(Panel(sheet, box, ends, y, True, log_y=not panels))
        top += height
    first, second, third = panels
    for entry, rate in reversed([*zip(entries, rates)]):
        first.line(shown, rate, entry.colour, 0.8 if entry.colour == GREY else 1.6)
    first.dots(points[seen], hazard.main.rate[seen], VERMILION, radius=2.2)
    second.line(shown, arch.fit.probability(im), BLUE)
    third.band(shown, np.zeros(im.size), density, SKY, 0.5)
    third.line(shown, density, BLUE)
    first.axis_y("exceeded [1/year]", ticks=log_ticks(low, high, (1.0,)))
    second.axis_y("P(collapse) [1]", 2)
    third.axis_y(f"rate per ln {scale.measure} [1/year]", 4)
    blank = [""] * log_ticks(*ends).size
    for panel in panels:
        for end in points[[0, -1]]:
            if ends[0] < end < ends[1]:
                panel.upright(end)
        last = panel is third
        panel.axis_x(scale.label * last, labels=[] if last else blank, grid=True)
    sheet.height = third.box[3] + BELOW
    words = f"{'at least ' * arch.rate.is_bound}{rounded(arch.rate.quoted)} a year"
    return f"Hazard and fragility curve of {arch.arch} and their product; rate of collapse {words}"


@figure
def contributions(
    sheet: Sheet, arch: ArchRisk, scale: Scale, by: str = "mechanism"
) -> Words | None:
    """Draw the rate by level and by mechanism or part.

    Return None if no run collapsed, or no mechanism or part is known.
    """
    split = getattr(arch, f"by_{by}")
    if split is None or not split.counts.any() or "not known" in split.categories:
        return None
    labels = [
        f"{name} {100 * f:.0f} %" for name, f in zip(split.categories, split.fraction)
    ]
    parts = stacked(labels, split.rate)
    if split.unassigned.any():
        parts.append((Entry("no collapse seen", PALE), split.unassigned))
    highest = 1.05 * np.sum([rate for _, rate in parts], axis=0).max()
    ends = (-0.5, arch.levels.size - 0.5), (0.0, highest)
    panel = panel_below(sheet, [entry for entry, _ in parts], 170.0, *ends, left=_LEFT)
    panel.axis_y("rate of collapse [1/year]", 4)
    panel.stack(parts)
    level_axis(panel, scale.factor * arch.levels, scale.label)
    texts = TEXTS["contributions"]
    caption = texts["caption"].format(by=by)
    caption += texts["pale"] * bool(split.unassigned.any())
    return f"Rate of collapse of {arch.arch} by level and {by}", caption


def _density(arch: ArchRisk, hazard: Hazard, im: FloatArray) -> FloatArray:
    """Return the rate of collapse per unit of ln im [1/year].

    It jumps where the slope of the hazard curve does.
    """
    curve = hazard.main
    slope = curve.pieces(np.log(im))[2]
    theta, beta = arch.fit.parts.T
    z = np.log(im[:, None] / theta) / beta
    chance = np.where(im[:, None] < arch.onset, 0.0, ndtr(z)).mean(axis=1)
    return chance * slope * curve.rate_at(im)
