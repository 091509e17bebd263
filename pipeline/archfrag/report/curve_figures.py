"""Fragility curves of one arch with its data, of all arches and of limit states; measures."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from archfrag.fragility.counts import clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.report import picture as look
from archfrag.report.filters import percent_of
from archfrag.report.picture import BELOW, SMALL, FloatArray, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults, Scale
from archfrag.study.curves import Answer, curve_of_dict

_DASH = "5 2.5"
COLOURS = (
    look.BLUE, look.VERMILION, look.GREEN, look.ORANGE, look.PURPLE, look.SKY,
)  # fmt: skip
MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
_SHADED = 6  # curves that are drawn with their bands
THIN = "#b5bec8"
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
_BEYOND = " Dotted: the highest level that was run; beyond it the curve is its shape alone."


def curve_picture(
    draw: Callable[[Panel], None], entries: Sequence[Entry], x: tuple[float, str],
    words: str = "probability of collapse", *, alternative: str, caption: str = "",
) -> Picture:  # fmt: skip
    """A figure of probabilities over levels from 0; `x` is where they end, and their title."""
    reach, title = x

    def drawn(sheet: Sheet) -> None:
        height = 250.0 if sheet.narrow else 300.0
        panel = sheet.below_legend(entries, height, (0.0, reach), (0.0, 1.0))
        ticks = np.linspace(0.0, 1.0, 6)
        panel.axis_y(ticks, words, [f"{p:.1f}" for p in ticks])
        panel.axis_x(look.even_ticks(0.0, reach, 6 if sheet.narrow else 9), title, grid=True)
        draw(panel)

    return picture(drawn, alternative=alternative, caption=caption)


def draw_answer(panel: Panel, answer: Answer, scale: Scale, stroke: Entry) -> None:
    """The curve that is quoted, over its band."""
    im = scale.factor * np.array(answer.im)
    if isinstance(answer.curve, Fragility):
        seen = im <= panel.x[1]
        low, high = (np.array(side)[seen] for side in (answer.lower, answer.upper))
        shade = look.SKY if stroke.colour == look.BLUE else stroke.colour
        panel.band(im[seen], low, high, shade, 0.25)
        draw_fit(panel, answer.curve, scale, stroke)


def draw_fit(
    panel: Panel, fit: Fragility, scale: Scale, stroke: Entry, width: float = 1.8
) -> None:
    """A lognormal curve."""
    im = np.linspace(0.0, panel.x[1], 100)
    dash = _DASH if stroke.mark == "dash" else ""
    panel.line(im, fit.probability(im / scale.factor), stroke.colour, width, dash)


def curve(results: ArchResults, answer: Answer) -> Picture:
    """Fragility curve of an arch with its band, and what it was made from.

    Observed fractions with exact intervals where every record was run at every level or the runs
    have levels of their own; the distribution of the records' capacities where the levels were
    bisected.
    """
    scale, percent, fit = results.scale, percent_of(answer.confidence), answer.curve
    shapes = answer.more.get("free", {})
    free = [
        (Entry(kind, colour, "line"), shapes[kind])
        for kind, colour in (("isotonic", look.GREY), ("kernel", look.GREEN))
        if kind in shapes and not (kind == "isotonic" and results.bisected)
    ]
    entries = [
        Entry("capacities of the records", look.INK, "line") if results.bisected
        else Entry(f"fraction, exact {percent} interval", look.INK, "dot")
    ]  # fmt: skip
    what = "no lognormal curve could be fitted"
    if isinstance(fit, Fragility):
        entries += band_entries("lognormal curve", percent)
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
    highest = float(results.levels.max())
    reach = 1.05 * highest
    if isinstance(fit, Fragility):
        reach = min(max(reach, 1.1 * fit.theta * scale.factor), 3.0 * highest)
    beyond = reach > 1.05 * highest
    likeliest = Entry("by maximum likelihood", look.BLUE, "dash")
    if isinstance(answer.likelihood, Fragility):
        entries.append(likeliest)
    entries += [entry for entry, _ in free]

    def draw(panel: Panel) -> None:
        draw_answer(panel, answer, scale, Entry("", look.BLUE, "line"))
        if isinstance(answer.likelihood, Fragility):
            draw_fit(panel, answer.likelihood, scale, likeliest, 0.9)
        for entry, found in free:
            im = scale.factor * np.array(found["im"])
            panel.line(im, found["probability"], entry.colour, 0.9)
        if isinstance(fit, Fragility) and fit.theta * scale.factor <= panel.x[1]:
            median = fit.theta * scale.factor
            panel.line([0.0, median, median], [0.5, 0.5, 0.0], look.GREY, 0.8, "4 3")
        if beyond:
            panel.line([highest, highest], [0.0, 1.0], look.GREY, 0.9, "2 2")
        _draw_data(panel, results, answer.confidence)

    kind = "bisected" if results.bisected else "grouped" if results.grouped else "stripes"
    shaded = f"{band_words(answer)} Thin: curves without a given shape, made from the same runs."
    return curve_picture(
        draw, entries, (reach, scale.label),
        alternative=f"Probability of collapse of {results.arch} against {scale.label}: {what}",
        caption=_DATA[kind] + (shaded if answer.method else "") + (_BEYOND if beyond else ""),
    )  # fmt: skip


def band_entries(name: str, percent: str) -> list[Entry]:
    """Legend of a curve that is quoted and of its band."""
    return [Entry(name, look.BLUE, "line"), Entry(f"{percent} band", "#c9e3f5")]


def band_words(answer: Answer) -> str:
    """How a band was made, for a caption."""
    if not answer.method:
        return ""
    return f" Shaded: pointwise band, {answer.method}. {answer.assumptions.removesuffix('.')}."


def _draw_data(panel: Panel, results: ArchResults, confidence: float) -> None:
    if results.bisected:
        capacity = capacities(results)
        seen = np.sort(capacity[capacity <= panel.x[1]])
        height = np.arange(seen.size + 1) / max(capacity.size, 1)
        steps = np.concatenate([[0.0], np.repeat(seen, 2), [results.levels.max()]])
        panel.line(steps, np.repeat(height, 2), look.INK, 1.1)
        return
    counts = results.counts
    used = counts.n > 0
    low, high = clopper_pearson(counts.collapsed[used], counts.n[used], confidence)
    panel.errors(results.levels[used], low, high)
    panel.dots(results.levels[used], counts.collapsed[used] / counts.n[used], look.INK)


def capacities(results: ArchResults) -> FloatArray:
    """Capacity of each record that was run: the middle of its bracket in logarithms.

    inf where it never collapsed; its lowest level where it collapsed there.
    """
    found = results.brackets
    return np.where(found.bracketed, found.middle, found.upper)


def all_curves(
    answers: Mapping[str, Answer],
    classes: Mapping[str, Answer],
    of_class: Mapping[str, str],
    scale: Scale,
    marks: tuple[float, float | None],
) -> Picture | None:
    """Curves of all arches in one figure; None if there are fewer than two.

    Classes are drawn with their bands, their arches (by `of_class`) thinly; other arches by name
    if they are not many. `marks` are the level to which the curves are drawn, and one that is
    marked, in the reader's unit.
    """
    known = {k: a for k, a in answers.items() if isinstance(a.curve, Fragility)}
    if len(known) < 2:
        return None
    highest, at = marks
    named = {k: a for k, a in classes.items() if isinstance(a.curve, Fragility)}
    single = {k: a for k, a in known.items() if of_class.get(k) not in classes}
    members = [[a for k, a in known.items() if of_class.get(k) == name] for name in named]
    thin = [(stroke("", i).colour, thinned(own)) for i, own in enumerate(members)]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((look.GREY, thinned(list(single.values()))))
    strokes = [stroke(name, i) for i, name in enumerate(named)]
    each_arch = [Entry("each arch", THIN, "line")] if any(rows for _, rows in thin) else []

    def draw(panel: Panel) -> None:
        if at is not None and 0.0 < at < panel.x[1]:
            panel.line([at, at], [0.0, 1.0], look.GREY, 0.9, "2 2")
        for colour, rows in thin:
            draw_thin(panel, rows, scale, colour)
        for own, answer in zip(strokes, named.values(), strict=True):
            if len(named) <= _SHADED:
                draw_answer(panel, answer, scale, own)
            elif isinstance(answer.curve, Fragility):
                draw_fit(panel, answer.curve, scale, own)

    fits = {k: a.curve for k, a in (*named.items(), *list(known.items())[:40])}
    return curve_picture(
        draw, strokes + each_arch, (1.05 * highest, scale.label),
        alternative=f"Fragility curves of {len(known)} arches against {scale.label}. "
        f"Medians: {_medians(fits, scale)}",
        caption="Lognormal curves. Shaded, where they are not many: their bands. Of classes: "
        "bold, of an arch of the class that is drawn at random; thin, arches of it. Dotted: the "
        "level that the probability is asked for.",
    )  # fmt: skip


def thinned(answers: Sequence[Answer]) -> list[Fragility]:
    """Curves of at most `MOST_THIN` arches, evenly from the weakest to the strongest."""
    known = [a.curve for a in answers if isinstance(a.curve, Fragility)]
    known.sort(key=lambda fit: fit.theta)
    if len(known) <= MOST_THIN:
        return known
    return [known[i] for i in np.linspace(0, len(known) - 1, MOST_THIN).round().astype(int)]


def draw_thin(panel: Panel, fits: Sequence[Fragility], scale: Scale, colour: str) -> None:
    """Curves of many arches, lightly."""
    im = np.linspace(0.0, panel.x[1], 34)
    opacity = float(np.clip(25.0 / max(len(fits), 1), 0.15, 0.5))
    for fit in fits:
        panel.line(im, fit.probability(im / scale.factor), colour, 0.5, opacity=opacity)


def limit_states(answer: Answer, name: str, scale: Scale, highest: float) -> Picture | None:
    """Curves of the limit states of an arch or a class; None if none has one.

    They are drawn to the `highest` level in the reader's unit.
    """
    fits = {}
    for state in answer.more.get("limit_states", {}).get("states", ()):
        if not isinstance(fit := curve_of_dict(state["curve"]), str):
            fits[state["name"].replace("_", " ")] = fit
    if not fits:
        return None
    strokes = [stroke(name, i) for i, name in enumerate(fits)]

    def draw(panel: Panel) -> None:
        for own, fit in zip(strokes, fits.values(), strict=True):
            draw_fit(panel, fit, scale, own)

    return curve_picture(
        draw, strokes, (1.05 * highest, scale.label),
        "probability of reaching it",
        alternative=f"Curves of limit states of {name} against {scale.label}. Medians: "
        + _medians(fits, scale),
    )  # fmt: skip


def _medians(fits: Mapping[str, Fragility | str], scale: Scale) -> str:
    known = {name: fit for name, fit in fits.items() if isinstance(fit, Fragility)}
    return "; ".join(f"{name} {scale.text(fit.theta)}" for name, fit in known.items())


def stroke(name: str, place: int) -> Entry:
    """Colour and dashes of the curve at a place, with its name."""
    dashed = place // len(COLOURS) % 2
    return Entry(name, COLOURS[place % len(COLOURS)], "dash" if dashed else "line")


def efficient_first(answer: Answer) -> list[Mapping[str, Any]]:
    """Measures that were compared, the most efficient first: `MeasureRow`s with their units."""
    return sorted(answer.more.get("measures", {}).get("rows", ()), key=_efficiency)


def measures(answer: Answer, arch: str) -> Picture | None:
    """Efficiency of each measure, the best on top; None if fewer than two are known."""
    known = [row for row in efficient_first(answer) if np.isfinite(_efficiency(row))]
    if len(known) < 2:
        return None
    names = [str(row["measure"]) for row in known]
    values, place = np.array([_efficiency(row) for row in known]), np.arange(len(known))
    chosen = np.array([name == answer.more["measures"]["best"] for name in names])

    def draw(sheet: Sheet) -> None:
        left = min(max(look.text_width(name, SMALL) for name in names) + 10.0, 0.4 * sheet.width)
        box = (left, 4.0, sheet.width - 44.0, 4.0 + 16.0 * len(known))
        panel = Panel(sheet, box, (0.0, 1.02 * values.max()), (len(known) - 0.5, -0.5))
        panel.axis_x(look.even_ticks(0.0, float(values.max())), "efficiency [1]", grid=True)
        for own, colour in ((chosen, look.BLUE), (~chosen, look.SKY)):
            panel.boxes(0.0, values[own], place[own] + 0.3, place[own] - 0.3, colour)
        for name, value, y in zip(names, values, panel.at_y(place) + 3.5, strict=True):
            sheet.text(left - 5.0, y, look.shortened(name, left - 8.0, SMALL), "s e")
            sheet.text(float(panel.at_x(value)) + 4.0, y, f"{value:.3f}", "s")
        sheet.height = box[3] + BELOW

    return picture(
        draw,
        alternative=f"Efficiency of {len(known)} intensity measures for {arch}; smallest in "
        f"{names[0]}",
    )


def _efficiency(row: Mapping[str, Any]) -> float:
    """Infinite where it is not known, so that such measures come last."""
    value = np.nan if row["efficiency"] is None else float(row["efficiency"])
    return value if np.isfinite(value) else np.inf
