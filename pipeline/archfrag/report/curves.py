"""Figures of fragility curves: of an arch with its data, of a class, of all; of limit states."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from archfrag.fragility.counts import clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.report import drawing as look
from archfrag.report.axes import Panel, even_ticks, panel_below
from archfrag.report.drawing import COLOURS, Entry, Picture, Sheet, figure
from archfrag.report.results import ArchResults, Scale
from archfrag.study.answer.curves import Answer, curve_of_dict

MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
_SHADED = 6  # curves that are drawn with their bands
_BAND, _THIN = "#c9e3f5", "#b5bec8"  # in legends
# What the data of each kind of design are, under the curve.
_DATA = {
    "bisected": "Steps: distribution of the capacities of the records, each at the middle in "
    "logarithms of the two neighbouring levels between which it was found; the levels that were "
    "run differ between records, so that fractions of runs mean nothing.",
    "grouped": "Every run has a motion and an intensity of its own; each point stands for a group "
    "of neighbours: collapsed / (collapsed + standing), bars: Clopper–Pearson.",
    "stripes": "Points: collapsed / (collapsed + standing) at each level; bars: Clopper–Pearson, "
    "of the records at that level.",
}


def probability_panel(
    sheet: Sheet, entries: Sequence[Entry], reach: float, title: str,
    words: str = "probability of collapse",
) -> Panel:  # fmt: skip
    """Axes of probabilities over levels from 0 to `reach`, below a legend."""
    height = 250.0 if sheet.narrow else 300.0
    panel = panel_below(sheet, entries, height, (0.0, reach), (0.0, 1.0))
    ticks = np.linspace(0.0, 1.0, 6)
    panel.axis_y(ticks, words, [f"{p:.1f}" for p in ticks])
    panel.axis_x(even_ticks(0.0, reach, 6 if sheet.narrow else 9), title, grid=True)
    return panel


def draw_curve(
    panel: Panel, shown: Answer | Fragility | str, scale: Scale, stroke: Entry, width: float = 1.8
) -> None:
    """A lognormal curve, that of an answer over its band; nothing if there is none."""
    if isinstance(shown, Answer):
        im = scale.factor * np.array(shown.im)
        seen = im <= panel.x[1]
        if isinstance(shown.curve, Fragility):
            low, high = (np.array(side)[seen] for side in (shown.lower, shown.upper))
            shade = look.SKY if stroke.colour == look.BLUE else stroke.colour
            panel.band(im[seen], low, high, shade, 0.25)
        shown = shown.curve
    if isinstance(shown, Fragility):
        im = np.linspace(0.0, panel.x[1], 100)
        dash = "5 2.5" if stroke.mark == "dash" else ""
        panel.line(im, shown.probability(im / scale.factor), stroke.colour, width, dash)


def draw_fractions(panel: Panel, results: ArchResults, colour: str, mark: str = "dot") -> None:
    """The observed fraction of collapses at each level."""
    known = results.known
    used = known.n > 0
    panel.dots(results.levels[used], known.collapsed[used] / known.n[used], colour, mark)


def stroke(name: str, place: int) -> Entry:
    """Colour and dashes of the curve at a place, with its name."""
    dashed = place // len(COLOURS) % 2
    return Entry(name, COLOURS[place % len(COLOURS)], "dash" if dashed else "line")


def thinned(answers: Sequence[Answer]) -> list[Fragility]:
    """Curves of at most `MOST_THIN` arches, evenly from the weakest to the strongest."""
    known = [a.curve for a in answers if isinstance(a.curve, Fragility)]
    known.sort(key=lambda fit: fit.theta)
    if len(known) <= MOST_THIN:
        return known
    return [known[i] for i in np.linspace(0, len(known) - 1, MOST_THIN).round().astype(int)]


def band_words(answer: Answer) -> str:
    """How a band was made, for a caption."""
    if not answer.method:
        return ""
    return f" Shaded: pointwise band, {answer.method}. {answer.assumptions.removesuffix('.')}."


@figure
def curve(sheet: Sheet, results: ArchResults, answer: Answer) -> tuple[str, str]:
    """Fragility curve of an arch with its band, and the data behind it.

    The data are observed fractions with exact intervals if every record was run at every level or
    the runs have levels of their own, and the distribution of the capacities of the records if the
    levels were bisected.
    """
    scale, fit, percent = results.scale, answer.curve, f"{100 * answer.confidence:.0f} %"
    kind = "stripes" if results.own_levels is None else "grouped"
    kind = "bisected" if results.bisected else kind
    entries = [
        Entry("capacities of the records", look.INK, "line") if results.bisected
        else Entry(f"fraction, exact {percent} interval", look.INK, "dot")
    ]  # fmt: skip
    highest = float(results.levels.max())
    reach, what = 1.05 * highest, "no lognormal curve could be fitted"
    if isinstance(fit, Fragility):
        entries += [Entry("lognormal curve", look.BLUE, "line"), Entry(f"{percent} band", _BAND)]
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
        reach = min(max(reach, 1.1 * fit.theta * scale.factor), 3.0 * highest)
    likeliest = Entry("by maximum likelihood", look.BLUE, "dash")
    if isinstance(answer.likelihood, Fragility):
        entries.append(likeliest)
    isotonic = None if results.bisected else answer.more.get("free", {}).get("isotonic")
    if isotonic:
        entries.append(Entry("isotonic", look.GREY, "line"))
    panel = probability_panel(sheet, entries, reach, scale.label)
    draw_curve(panel, answer, scale, Entry("", look.BLUE, "line"))
    draw_curve(panel, answer.likelihood, scale, likeliest, 0.9)
    if isotonic:
        im = scale.factor * np.array(isotonic["im"])
        panel.line(im, isotonic["probability"], look.GREY, 0.9)
    if isinstance(fit, Fragility) and fit.theta * scale.factor <= reach:
        median = fit.theta * scale.factor
        panel.line([0.0, median, median], [0.5, 0.5, 0.0], look.GREY, 0.8, "4 3")
    caption = _DATA[kind]
    if answer.method:
        caption += f"{band_words(answer)} Thin: the curve without a given shape, of the same runs."
    if reach > 1.05 * highest:
        panel.line([highest, highest], [0.0, 1.0], look.GREY, 0.9, "2 2")
        caption += " Dotted: the highest level that was run; beyond it only the shape is known."
    _draw_data(panel, results, answer.confidence)
    return f"Probability of collapse of {results.arch} against {scale.label}: {what}", caption


def _draw_data(panel: Panel, results: ArchResults, confidence: float) -> None:
    if results.bisected:
        capacity = results.capacities
        seen = np.sort(capacity[capacity <= panel.x[1]])
        height = np.arange(seen.size + 1) / max(capacity.size, 1)
        steps = np.concatenate([[0.0], np.repeat(seen, 2), [results.levels.max()]])
        panel.line(steps, np.repeat(height, 2), look.INK, 1.1)
        return
    used = results.counts.n > 0
    counts, level = (results.counts.collapsed[used], results.counts.n[used]), results.levels[used]
    low, high = clopper_pearson(*counts, confidence)
    bars = np.column_stack([low, high, np.full(low.size, np.nan)])
    panel.line(np.repeat(level, 3), bars.ravel(), look.INK, 0.9)
    draw_fractions(panel, results, look.INK)


_COLLAPSE = "probability of collapse"
Named = Sequence[tuple[Entry, Answer | Fragility]]
Thin = Sequence[tuple[str, Sequence[Fragility]]]
Axes = tuple[Scale, float, float | None, str]


@figure
def _several(
    sheet: Sheet, named: Named, thin: Thin, key: Sequence[Entry], axes: Axes,
    texts: tuple[str, str],
) -> tuple[str, str]:  # fmt: skip
    """Curves with names, over thin ones of one colour each.

    `axes` are the scale of levels, the highest of them, one that is marked, and the title of the
    probabilities.
    """
    scale, reach, at, title = axes
    panel = probability_panel(sheet, key, reach, scale.label, title)
    if at is not None and 0.0 < at < reach:
        panel.line([at, at], [0.0, 1.0], look.GREY, 0.9, "2 2")
    im = np.linspace(0.0, reach, 34)
    for colour, fits in thin:
        opacity = float(np.clip(25.0 / max(len(fits), 1), 0.15, 0.5))
        for fit in fits:
            panel.line(im, fit.probability(im / scale.factor), colour, 0.5, opacity=opacity)
    for own, shown in named:
        draw_curve(panel, shown, scale, own)
    return texts


def all_curves(
    answers: Mapping[str, Answer], classes: Mapping[str, Answer], of_class: Mapping[str, str],
    scale: Scale, highest: float, at: float | None = None,
) -> Picture | None:  # fmt: skip
    """Curves of all arches in one figure; None if there are fewer than two.

    Classes are drawn with their bands, their arches (by `of_class`) thinly; other arches by name
    if they are not many. The axis ends at the `highest` level; the level `at` is marked.
    """
    known = {k: a for k, a in answers.items() if isinstance(a.curve, Fragility)}
    if len(known) < 2:
        return None
    named = {k: a for k, a in classes.items() if isinstance(a.curve, Fragility)}
    single = {k: a for k, a in known.items() if of_class.get(k) not in classes}
    members = [[a for k, a in known.items() if of_class.get(k) == name] for name in named]
    thin = [(stroke("", i).colour, thinned(own)) for i, own in enumerate(members)]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((look.GREY, thinned(list(single.values()))))
    strokes = [stroke(name, i) for i, name in enumerate(named)]
    shown = [a if len(named) <= _SHADED else a.curve for a in named.values()]
    key = strokes + [Entry("each arch", _THIN, "line")] * any(fits for _, fits in thin)
    fits = {k: a.curve for k, a in (*named.items(), *list(known.items())[:40])}
    texts = (
        f"Fragility curves of {len(known)} arches against {scale.label}. "
        f"Medians: {_medians(fits, scale)}",
        "Lognormal curves. Shaded, where they are not many: their bands. Of classes: bold, of an "
        "arch of the class that is drawn at random; thin, arches of it. Dotted: the level that "
        "the probability is asked for.",
    )
    curves = list(zip(strokes, shown, strict=True))
    return _several(curves, thin, key, (scale, 1.05 * highest, at, _COLLAPSE), texts)


def class_curve(answer: Answer, members: Sequence[Answer], name: str, scale: Scale) -> Picture:
    """Curve of a class with its band, over those of its arches."""
    thin, own = thinned(members), Entry("an arch of the class", look.BLUE, "line")
    ends = [scale.factor * each.im[-1] for each in (answer, *members) if each.im]
    key = [Entry("arches of the class", _THIN, "line")]
    if isinstance(answer.curve, Fragility):
        key += [own, Entry(f"{100 * answer.confidence:.0f} % band", _BAND)]
    texts = (
        f"Probability of collapse of an arch of the class {name} against {scale.label}, and the "
        f"curves of {len(thin)} of its arches",
        "Bold: probability of collapse of an arch of the class of which nothing more is known, so "
        "that both records and arches differ. Thin: its arches, of many some from the weakest to "
        f"the strongest.{band_words(answer)}",
    )
    axes = scale, max(ends, default=1.0), None, _COLLAPSE
    return _several([(own, answer)], [(look.GREY, thin)], key, axes, texts)


def limit_states(answer: Answer, name: str, scale: Scale, highest: float) -> Picture | None:
    """Curves of the limit states of an arch or a class; None if none has one.

    They are drawn to the `highest` level in the reader's unit.
    """
    states = answer.more.get("limit_states", {}).get("states", ())
    found = {each["name"].replace("_", " "): curve_of_dict(each["curve"]) for each in states}
    fits = {name: fit for name, fit in found.items() if isinstance(fit, Fragility)}
    if not fits:
        return None
    texts = (
        f"Curves of limit states of {name} against {scale.label}. Medians: "
        f"{_medians(fits, scale)}",
        "Lognormal curves from the same runs, one for each limit state.",
    )
    strokes = [stroke(name, i) for i, name in enumerate(fits)]
    curves = list(zip(strokes, fits.values(), strict=True))
    axes = scale, 1.05 * highest, None, "probability of reaching it"
    return _several(curves, [], strokes, axes, texts)


@figure
def two_studies(
    sheet: Sheet, names: Sequence[str], sides: Sequence[tuple[ArchResults, Answer]]
) -> tuple[str, str]:
    """Curves of an arch in two studies with their bands, and the observed fractions."""
    scale = sides[0][0].scale
    reach = 1.05 * max(results.levels.max() for results, _ in sides)
    strokes = [Entry(names[0], look.BLUE, "line"), Entry(names[1], look.VERMILION, "dash")]
    panel = probability_panel(sheet, strokes, reach, scale.label)
    for (results, answer), own, mark in zip(sides, strokes, ("dot", "ring")):
        draw_curve(panel, answer, scale, own)
        draw_fractions(panel, results, own.colour, mark)
    medians = _medians({name: answer.curve for name, (_, answer) in zip(names, sides)}, scale)
    return (
        f"Probability of collapse of {sides[0][0].arch} against {scale.label} in two studies. "
        f"Medians: {medians}",
        "Points: fraction of the records that collapse at each level. Shaded: bands, of each "
        "study by itself. Where both have the same records the change is known better than the "
        "bands, which hold the variation between records, suggest.",
    )


def _medians(fits: Mapping[str, Fragility | str], scale: Scale) -> str:
    known = {name: fit for name, fit in fits.items() if isinstance(fit, Fragility)}
    return "; ".join(f"{name} {scale.text(fit.theta)}" for name, fit in known.items())


def efficient_first(answer: Answer) -> list[Mapping[str, Any]]:
    """Measures that were compared, the most efficient first, those without efficiency last."""
    rows = answer.more.get("measures", {}).get("rows", ())
    return sorted(rows, key=lambda row: np.nan_to_num(_efficiency(row), nan=np.inf))


def _efficiency(row: Mapping[str, Any]) -> float:
    return np.nan if row["efficiency"] is None else float(row["efficiency"])
