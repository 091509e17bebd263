"""Figures of fragility curves, and of what the median capacities of a class depend on."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.curve import Curve, FloatArray
from archfrag.fragility.verdicts import clopper_pearson
from archfrag.report import svg
from archfrag.report.html import TEXTS
from archfrag.report.inputs import ArchResults, ReportInputs, Scale
from archfrag.report.svg import Entry, Panel, Sheet, figure
from archfrag.study.answer.curves import arch_classes

MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
_MOST_PANELS = 9  # values by which the arches of a class differ
_SHADED = 6  # curves that are drawn with their bands
_BAND = "#c9e3f5"  # in legends
_THIN = "#b5bec8"
_DAMAGE = (
    "#f9a58a",
    "#f4795b",
    "#e34a33",
    "#c4281c",
    "#96120f",
    "#67000d",
)  # light to severe
_SAME = 0.01  # difference of probabilities that nobody sees


def curve_panel(
    sheet: Sheet,
    entries: Sequence[Entry],
    reach: float,
    title: str,
    words: str = "probability of collapse",
) -> Panel:
    """Draw the axes of a figure of curves below its legend; return their panel."""
    panel = svg.panel_below(sheet, entries, 300.0, (0.0, reach), (0.0, 1.0))
    panel.axis_y(svg.even_ticks(0.0, 1.0), words)
    panel.axis_x(svg.even_ticks(0.0, reach, 9), title, grid=True)
    return panel


def draw_curve(
    panel: Panel,
    fit: Curve | None,
    scale: Scale,
    stroke: Entry,
    width: float = 1.8,
    band: bool = True,
) -> None:
    """Draw a curve with its band, if it has one; nothing if there is no curve."""
    if fit is None or not fit.fitted:
        return
    if band and fit.im:
        im, low, high = np.array([fit.im, fit.lower, fit.upper])
        seen = scale.factor * im <= panel.x[1]
        shade = svg.SKY if stroke.colour == svg.BLUE else stroke.colour
        panel.band(scale.factor * im[seen], low[seen], high[seen], shade, 0.25)
    im = np.linspace(0.0, panel.x[1], 100)
    dash = "5 2.5" if stroke.mark == "dash" else ""
    panel.line(im, fit.probability(im / scale.factor), stroke.colour, width, dash)


def _stroke(name: str, place: int, colours: Sequence[str] = svg.COLOURS) -> Entry:
    """Choose the colour and the stroke of the curve at a place in a legend."""
    dashed = place // len(colours) % 2
    return Entry(name, colours[place % len(colours)], "dash" if dashed else "line")


def _thinned(fits: Iterable[Curve]) -> list[Curve]:
    """Choose at most `MOST_THIN` curves, evenly from the weakest to the strongest."""
    ordered = sorted(fits, key=lambda fit: fit.theta)
    places = np.linspace(0, len(ordered) - 1, min(len(ordered), MOST_THIN))
    return [ordered[i] for i in places.round().astype(int)]


def _known(answers: Mapping[str, Curve]) -> dict[str, Curve]:
    """Return those that have a curve."""
    return {name: curve for name, curve in answers.items() if curve.fitted}


def _medians(fits: Mapping[str, Curve], scale: Scale) -> str:
    """Write the medians of curves in a line."""
    return "Medians: " + "; ".join(
        f"{name} {scale.text(fit.theta)}" for name, fit in fits.items()
    )


def _band_words(answer: Curve) -> str:
    """Write what the band of an answer is and what it assumes; empty without a band."""
    if not answer.method:
        return ""
    return f" Shaded: pointwise band, {answer.method}. {answer.assumptions.removesuffix('.')}."


@figure
def curve(sheet: Sheet, results: ArchResults, answer: Curve) -> tuple[str, str]:
    """Draw the curve of an arch with its band, and the capacities or fractions behind it."""
    scale = results.scale
    percent = f"{100 * answer.confidence:.0f} %"
    texts = TEXTS["curve"]
    highest = float(results.levels.max())
    isotonic = None
    if results.runs.gaps:
        caption = texts["searched"]
        entries = [Entry("capacities of the records", svg.INK, "line")]
    else:
        caption = texts["stripes" if results.own_levels is None else "grouped"]
        entries = [Entry(f"fraction, exact {percent} interval", svg.INK, "dot")]
        isotonic = answer.more.get("free", {}).get("isotonic")
    reach = 1.05 * highest
    what = "no lognormal curve could be fitted"
    if answer.fitted:
        entries += [
            Entry("lognormal curve", svg.BLUE, "line"),
            Entry(f"{percent} band", _BAND),
        ]
        what = f"lognormal curve with median {scale.text(answer.theta)}"
        what += f" and dispersion {answer.beta:.3f}"
        reach = min(max(reach, 1.1 * answer.theta * scale.factor), 3.0 * highest)
        caption += _band_words(answer)
    likeliest = Entry("by maximum likelihood", svg.BLUE, "dash")
    if (most := answer.likelihood) is not None and most.fitted:
        entries.append(likeliest)
        caption += f" Dashed: θ {scale.text(most.theta)}, β {most.beta:.3f}."
    if isotonic:
        entries.append(Entry("isotonic", svg.GREY, "line"))
        caption += texts["isotonic"]
    panel = curve_panel(sheet, entries, reach, scale.label)
    draw_curve(panel, answer, scale, Entry("", svg.BLUE, "line"))
    draw_curve(panel, answer.likelihood, scale, likeliest, 0.9)
    if isotonic:
        im = scale.factor * np.array(isotonic["im"])
        panel.line(im, isotonic["probability"], svg.GREY, 0.9)
    if answer.fitted and (median := answer.theta * scale.factor) <= reach:
        panel.line([0.0, median, median], [0.5, 0.5, 0.0], svg.GREY, 0.8, "4 3")
        panel.label(median, panel.box[3] - 6.0, f"θ = {scale.text(answer.theta)}", "s")
    if reach > 1.05 * highest:
        panel.line([highest, highest], [0.0, 1.0], svg.GREY, 0.9, "2 2")
        caption += texts["extrapolated"]
    if results.runs.gaps:
        capacity = results.capacities
        seen = np.sort(capacity[capacity <= reach])
        height = np.arange(seen.size + 1) / max(capacity.size, 1)
        steps = np.concatenate([[0.0], np.repeat(seen, 2), [highest]])
        panel.line(steps, np.repeat(height, 2), svg.INK, 1.1)
    else:
        used = results.counts["n"] > 0
        collapses, n = (results.counts[key][used] for key in ("collapsed", "n"))
        ends = clopper_pearson(collapses, n, answer.confidence)
        bars = np.column_stack([*ends, np.full(ends[0].size, np.nan)])
        panel.line(np.repeat(results.levels[used], 3), bars.ravel(), svg.INK, 0.9)
        panel.dots(results.levels, results.fraction, svg.INK)
    return (
        f"Probability of collapse of {results.arch} against {scale.label}: {what}",
        caption,
    )


@figure
def all_curves(
    sheet: Sheet,
    inputs: ReportInputs,
    answers: Mapping[str, Curve],
    classes: Mapping[str, Curve],
) -> tuple[str, str] | None:
    """Draw the curves of some arches and classes in one figure; None if they are fewer than two.

    Curves with names lie over thin ones of one colour each.
    """
    curves = _known(answers)
    named = _known(classes)
    of_class = arch_classes(inputs.cube)
    if len(answers) + len(classes) < 2:
        return None
    scale = inputs.scale
    at = inputs.at
    reach = 1.05 * inputs.highest
    single = {k: fit for k, fit in curves.items() if of_class.get(k) not in classes}
    members = [
        [fit for k, fit in curves.items() if of_class.get(k) == name]
        for name in classes
    ]
    thin = [(_stroke("", i).colour, _thinned(fits)) for i, fits in enumerate(members)]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((svg.GREY, _thinned(single.values())))
    strokes = [_stroke(name, i) for i, name in enumerate(named)]
    key = strokes + [Entry("each arch", _THIN, "line")] * any(fits for _, fits in thin)
    panel = curve_panel(sheet, key, reach, scale.label)
    if at is not None and 0.0 < at < reach:
        panel.line([at, at], [0.0, 1.0], svg.GREY, 0.9, "2 2")
    im = np.linspace(0.0, reach, 34)
    for colour, fits in thin:
        opacity = float(np.clip(25.0 / max(len(fits), 1), 0.15, 0.5))
        for fit in fits:
            panel.line(
                im, fit.probability(im / scale.factor), colour, 0.5, opacity=opacity
            )
    shaded = len(named) <= _SHADED
    words = TEXTS["all_curves"]
    for stroke, (name, fit) in zip(strokes, named.items()):
        draw_curve(panel, fit, scale, stroke, band=shaded)
        if name in inputs.answers:
            results = inputs.results(name)
            seen = results.levels <= reach
            panel.dots(
                results.levels[seen], results.fraction[seen], stroke.colour, radius=2.2
            )
    kind = "Curves" if classes else "Lognormal curves"
    one = len(classes) == 1
    whose = f"class {next(iter(classes))}" if one else "a class"
    caption = words["bands" if shaded else "curves"].format(kind=kind)
    caption += words["points"] * any(name in inputs.answers for name in named)
    caption += words["classes"].format(whose=whose) * bool(classes)
    caption += words["at"] * (at is not None)
    if shaded:
        bands = "".join(map(_band_words, classes.values()))
        caption += bands if one else words["several"] * bool(classes)
    what = f"Fragility curves of {len(curves)} arches against {scale.label}. "
    what += _medians(named | dict(list(curves.items())[:40]), scale)
    return what, caption


@figure
def limit_states(
    sheet: Sheet, inputs: ReportInputs, answer: Curve, name: str
) -> str | None:
    """Draw the curves of the limit states of an arch or a class; None if none has one."""
    curves = [
        (_stroke(fit.state.replace("_", " "), i, _DAMAGE), fit)
        for i, fit in enumerate(answer.states)
        if fit.fitted
    ]
    if not curves:
        return None
    scale = inputs.scale
    reach = 1.05 * inputs.highest
    panel = curve_panel(sheet, [], reach, scale.label, "probability of reaching it")
    im = np.linspace(0.0, reach, 400)
    seen = list[tuple[str, FloatArray]]()
    for stroke, fit in curves:
        draw_curve(panel, fit, scale, stroke, band=False)
        words = stroke.label
        chance = fit.probability(im / scale.factor)
        if seen and np.abs(chance - seen[-1][1]).max() < _SAME:
            words = f"{seen.pop()[0]}, {words}"
        seen.append((words, chance))
    # Above the curves is room on the left, below them on the right.
    for part, (words, chance) in zip(np.linspace(0.85, 0.2, len(seen)), seen):
        i = int(np.searchsorted(chance, part * chance[-1]))
        panel.dots(im[[i]], chance[[i]], svg.INK, radius=2.4)
        panel.label(im[i], float(panel.at_y(chance[i])) + 4.0, words, left=part > 0.5)
    medians = _medians({stroke.label: fit for stroke, fit in curves}, scale)
    return f"Curves of limit states of {name} against {scale.label}. {medians}"


@figure
def theta_panels(
    sheet: Sheet,
    theta: FloatArray,
    differences: Mapping[str, NDArray],
    name: str,
    unit: str,
) -> str | None:
    """Draw theta of each arch against each value by which arches differ; None without such.

    Lines are `effects_on_theta`, if the arches are enough for it; the largest stands first.
    """
    fitted = np.isfinite(theta)
    lines = {}
    if not differences or fitted.sum() < 2:
        return None
    theta = theta[fitted]
    values = {key: each[fitted] for key, each in differences.items()}
    finite = {
        key: numbers for key, numbers in values.items() if np.isfinite(numbers).all()
    }
    if finite and theta.size >= len(finite) + 2:
        _, effects = effects_on_theta(theta, np.column_stack([*finite.values()]))
        lines = dict(
            sorted(
                zip(finite, effects), key=lambda one: -abs(np.diff(np.log(one[1]))[0])
            )
        )
    shown = [*lines, *(key for key in values if key not in lines)][:_MOST_PANELS]
    margin = 0.05 * float(np.ptp(theta)) or 0.05 * float(theta[0])
    ends = float(theta.min()) - margin, float(theta.max()) + margin
    for box, key in zip(sheet.grid(len(shown), 3, 150.0, svg.BELOW - svg.LINE), shown):
        low = float(np.nanmin(values[key]))
        high = float(np.nanmax(values[key]))
        reach = low - 0.04 * (high - low), high + 0.04 * (high - low)
        panel = Panel(sheet, box, reach, ends)
        panel.axis_x(svg.even_ticks(*reach, 4))
        panel.axis_y(svg.even_ticks(*ends), f"θ [{unit}]")
        panel.dots(values[key], theta, svg.BLUE, radius=2.4)
        if key in lines:
            middle = values[key].mean()
            away = values[key].std(ddof=1)
            panel.line([middle - away, middle + away], lines[key], svg.VERMILION, 2.0)
        panel.heading(svg.shortened(key, box[2] - box[0]))
    return (
        f"Median capacities of {theta.size} arches of {name} against {', '.join(shown)}"
    )


def effects_on_theta(theta: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Return theta with all values at their means, and with one a standard deviation off its mean.

    The latter has a row for each value, with less and more (n_value, 2). They are from a linear
    regression of ln `theta` (n_arch,) on the `values` (n_arch, n_value).
    """
    unit = (values - values.mean(axis=0)) / values.std(axis=0, ddof=1)
    lines = np.column_stack([np.ones(len(unit)), unit])
    middle, *effects = np.linalg.lstsq(lines, np.log(theta), rcond=None)[0]
    return float(np.exp(middle)), np.exp(middle + np.outer(effects, (-1.0, 1.0)))
