"""Fragility curves: of one arch with its data, of all arches together, and of limit states."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from archfrag.fragility.counts import clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.report import picture as look
from archfrag.report.axes import BELOW, BESIDE, axis_x, axis_y, even_ticks
from archfrag.report.picture import Picture
from archfrag.report.plot import Entry, FloatArray, Panel, Sheet, picture
from archfrag.report.summary import ArchResults, Scale

if TYPE_CHECKING:
    from archfrag.study.curves import Answer

_DASH = "5 2.5"
COLOURS = (
    look.BLUE, look.VERMILION, look.GREEN, look.ORANGE, look.PURPLE, look.SKY,
)  # fmt: skip
MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
PROBABILITY = "probability of collapse"


def stated(words: str) -> str:
    """A sentence of others with its full stop."""
    return words if words.endswith(".") else f"{words}."


def curve_axes(sheet: Sheet, top: float, reach: float, title: str, words: str) -> Panel:
    """A panel of probabilities over levels from 0 to reach, and the height of its sheet."""
    bottom = top + (250.0 if sheet.narrow else 300.0)
    panel = Panel(sheet, (BESIDE, top, sheet.width - 10.0, bottom), (0.0, reach), (0.0, 1.0))
    axis_y(panel, np.linspace(0.0, 1.0, 6), words, [f"{p:.1f}" for p in np.linspace(0, 1, 6)])
    axis_x(panel, even_ticks(0.0, reach, 6 if sheet.narrow else 9), title, grid=True)
    sheet.height = bottom + BELOW
    return panel


def draw_answer(panel: Panel, answer: "Answer", scale: Scale, colour: str, dash: str = "") -> None:
    """The curve that is quoted, over its band."""
    im = scale.factor * np.array(answer.im)
    if isinstance(answer.curve, Fragility):
        seen = im <= panel.x[1]
        low, high = (np.array(side)[seen] for side in (answer.lower, answer.upper))
        panel.band(im[seen], low, high, look.SKY if colour == look.BLUE else colour, 0.25)
        draw_curve(panel, answer, scale, colour, dash)


def draw_curve(panel: Panel, answer: "Answer", scale: Scale, colour: str, dash: str = "") -> None:
    """The curve that is quoted, without its band."""
    if isinstance(answer.curve, Fragility):
        im = np.linspace(0.0, panel.x[1], 100)
        panel.line(im, answer.curve.probability(im / scale.factor), colour, 1.8, dash)


def curve(results: ArchResults, answer: "Answer") -> Picture:
    """Fragility curve of an arch with its band, and what it was made from.

    Observed fractions with exact intervals where every record was run at every level or the runs
    have levels of their own; the distribution of the records' capacities where the levels were
    bisected.

    Parameters
    ----------
    results : ArchResults
    answer : Answer
    """
    scale, percent = results.scale, f"{100 * answer.confidence:.0f} %"
    reach = 1.05 * results.levels.max()
    if results.own_levels is not None:
        reach = 1.05 * float(np.nanmax(results.own_levels))
    fit, free = answer.curve, answer.more.get("free", {})
    entries = _entries(results, answer, percent)

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        panel = curve_axes(sheet, top, reach, scale.label, PROBABILITY)
        draw_answer(panel, answer, scale, look.BLUE)
        if isinstance(answer.likelihood, Fragility):
            im = np.linspace(0.0, reach, 100)
            chance = answer.likelihood.probability(im / scale.factor)
            panel.line(im, chance, look.BLUE, 0.9, _DASH)
        for kind, colour in (("isotonic", look.GREY), ("kernel", look.GREEN)):
            if kind in free and not (kind == "isotonic" and results.bisected):
                at = scale.factor * np.array(free[kind]["im"])
                panel.line(at, free[kind]["probability"], colour, 0.9)
        if isinstance(fit, Fragility) and fit.theta * scale.factor <= reach:
            median = fit.theta * scale.factor
            panel.line([0.0, median, median], [0.5, 0.5, 0.0], look.GREY, 0.8, "4 3")
        _draw_data(panel, results, answer.confidence)
        return sheet

    what = "no lognormal curve could be fitted"
    if isinstance(fit, Fragility):
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
    return picture(
        draw,
        alternative=f"Probability of collapse of {results.arch} against {scale.label}: {what}",
        caption=_caption(results, answer),
    )


def _entries(results: ArchResults, answer: "Answer", percent: str) -> list[Entry]:
    free = answer.more.get("free", {})
    if results.bisected:
        entries = [Entry("capacities of the records", look.INK, "line")]
    else:
        entries = [Entry(f"fraction of collapses, exact {percent} interval", look.INK, "dot")]
    if isinstance(answer.curve, Fragility):
        entries += [
            Entry("lognormal curve", look.BLUE, "line"), Entry(f"{percent} band", "#c9e3f5"),
        ]  # fmt: skip
    if isinstance(answer.likelihood, Fragility):
        entries.append(Entry("by maximum likelihood", look.BLUE, "dash"))
    if "isotonic" in free and not results.bisected:
        entries.append(Entry("isotonic", look.GREY, "line"))
    if "kernel" in free:
        entries.append(Entry("kernel", look.GREEN, "line"))
    return entries


def _draw_data(panel: Panel, results: ArchResults, confidence: float) -> None:
    if results.bisected:
        capacity = capacities(results)
        seen = np.sort(capacity[capacity <= panel.x[1]])
        height = np.arange(seen.size + 1) / max(capacity.size, 1)
        steps = np.concatenate([[0.0], np.repeat(seen, 2), [panel.x[1]]])
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


def _caption(results: ArchResults, answer: "Answer") -> str:
    if results.bisected:
        data = (
            "Steps: distribution of the capacities of the records, each at the middle in "
            "logarithms of the two neighbouring levels between which it was found; the levels "
            "that were run differ between records, so that fractions of runs mean nothing."
        )
    elif results.grouped:
        data = (
            "Every run has a motion and an intensity of its own; each point stands for a group "
            "of neighbours: collapsed / (collapsed + standing), bars: Clopper–Pearson."
        )
    else:
        data = (
            "Points: collapsed / (collapsed + standing) at each level; bars: Clopper–Pearson, of "
            "the records at that level."
        )
    if not answer.method:
        return data
    return (
        f"{data} Shaded: pointwise band, {answer.method}. {stated(answer.assumptions)} Thin: "
        "curves without a given shape, made from the same runs."
    )


def all_curves(
    answers: Mapping[str, "Answer"],
    classes: Mapping[str, "Answer"],
    members: Mapping[str, Sequence["Answer"]],
    scale: Scale,
    marks: tuple[float, float | None],
) -> Picture | None:
    """Curves of all arches in one figure; None if there are fewer than two.

    Parameters
    ----------
    answers : mapping of str to Answer
        Of arches; by name if they are few, otherwise those that are of no class thinly.
    classes : mapping of str to Answer
        Drawn with their bands.
    members : mapping of str to sequence of Answer
        Arches of each class, drawn thinly.
    scale : Scale
    marks : (float, float or None)
        Level to which the curves are drawn, and one that is marked, in the reader's unit.
    """
    known = {k: a for k, a in answers.items() if isinstance(a.curve, Fragility)}
    if len(known) < 2:
        return None
    highest, at = marks
    inside = {id(each) for each in (a for own in members.values() for a in own)}
    named = {k: a for k, a in classes.items() if isinstance(a.curve, Fragility)}
    single = {k: a for k, a in known.items() if id(a) not in inside}
    thin = [(i, thinned(members[k])) for i, k in enumerate(named)]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((len(named), thinned(list(single.values()))))
    shaded = len(named) <= 6
    entries = [Entry(name, *_stroke(i)[:2]) for i, name in enumerate(named)]
    if any(rows for _, rows in thin):
        entries.append(Entry("each arch", "#b5bec8", "line"))

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        panel = curve_axes(sheet, top, 1.05 * highest, scale.label, PROBABILITY)
        if at is not None and 0.0 < at < panel.x[1]:
            panel.line([at, at], [0.0, 1.0], look.GREY, 0.9, "2 2")
        for i, rows in thin:
            draw_thin(panel, rows, scale, _stroke(i)[0] if i < len(classes) else look.GREY)
        for i, answer in enumerate(named.values()):
            colour, _, dash = _stroke(i)
            if shaded:
                draw_answer(panel, answer, scale, colour, dash)
            else:
                draw_curve(panel, answer, scale, colour, dash)
        return sheet

    shown = dict([*named.items(), *list(known.items())[:40]])
    medians = "; ".join(
        f"{name} {scale.text(a.curve.theta)}"
        for name, a in shown.items()
        if isinstance(a.curve, Fragility)
    )
    return picture(
        draw,
        alternative=f"Fragility curves of {len(known)} arches against {scale.label}. "
        f"Medians: {medians}",
        caption="Lognormal curves"
        + (", shaded their bands." if shaded else ".")
        + (" Bold: of an arch of a class that is drawn at random; thin: arches of it." if thin
           and classes else "")
        + (f" Dotted: {scale.text(at / scale.factor)}." if at is not None else ""),
    )  # fmt: skip


def thinned(answers: Sequence["Answer"]) -> list[Fragility]:
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


def limit_states(
    states: Sequence[tuple[str, Fragility]], arch: str, scale: Scale, highest: float
) -> Picture:
    """Curves of the limit states of an arch, in the order given."""
    im = np.linspace(0.0, 1.05 * highest, 100)
    entries = [Entry(name, *_stroke(i)[:2]) for i, (name, _) in enumerate(states)]

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        panel = curve_axes(sheet, top, float(im[-1]), scale.label, "probability of reaching it")
        for i, (_, fit) in enumerate(states):
            colour, _, dash = _stroke(i)
            panel.line(im, fit.probability(im / scale.factor), colour, 1.8, dash)
        return sheet

    medians = "; ".join(f"{name} {scale.text(fit.theta)}" for name, fit in states)
    return picture(
        draw,
        alternative=f"Curves of limit states of {arch} against {scale.label}. Medians: {medians}",
        caption="Lognormal curves from the same runs, one for each limit state.",
    )


def _stroke(place: int) -> tuple[str, str, str]:
    """Colour, mark of the legend and dashes of a curve."""
    colour = COLOURS[place % len(COLOURS)]
    return (colour, "dash", _DASH) if place // len(COLOURS) % 2 else (colour, "line", "")
