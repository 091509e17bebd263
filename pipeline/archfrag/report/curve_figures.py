"""Fragility curves: of one arch with its data, of all arches together, and of limit states."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from archfrag.fragility.counts import clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.report import picture as look
from archfrag.report.axes import even_ticks
from archfrag.report.picture import BELOW, BESIDE, FloatArray, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults, Scale

if TYPE_CHECKING:
    from archfrag.study.curves import Answer

_DASH = "5 2.5"
COLOURS = (
    look.BLUE, look.VERMILION, look.GREEN, look.ORANGE, look.PURPLE, look.SKY,
)  # fmt: skip
MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
_SHADED = 6  # curves that are drawn with their bands
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


def curve_picture(
    draw: Callable[[Panel], None],
    entries: Sequence[Entry],
    x: tuple[float, str],
    words: str = "probability of collapse",
    *,
    alternative: str,
    caption: str,
) -> Picture:
    """A figure of probabilities over levels from 0; `x` is where they end, and their title."""
    reach, title = x

    def drawn(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        bottom = top + (250.0 if sheet.narrow else 300.0)
        panel = Panel(sheet, (BESIDE, top, width - 10.0, bottom), (0.0, reach), (0.0, 1.0))
        ticks = np.linspace(0.0, 1.0, 6)
        panel.axis_y(ticks, words, [f"{p:.1f}" for p in ticks])
        panel.axis_x(even_ticks(0.0, reach, 6 if sheet.narrow else 9), title, grid=True)
        draw(panel)
        sheet.height = bottom + BELOW
        return sheet

    return picture(drawn, alternative=alternative, caption=caption)


def draw_answer(panel: Panel, answer: "Answer", scale: Scale, colour: str, dash: str = "") -> None:
    """The curve that is quoted, over its band."""
    im = scale.factor * np.array(answer.im)
    if isinstance(answer.curve, Fragility):
        seen = im <= panel.x[1]
        low, high = (np.array(side)[seen] for side in (answer.lower, answer.upper))
        panel.band(im[seen], low, high, look.SKY if colour == look.BLUE else colour, 0.25)
        draw_fit(panel, answer.curve, scale, colour, 1.8, dash)


def draw_fit(
    panel: Panel, fit: Fragility, scale: Scale, colour: str, width: float, dash: str = ""
) -> None:
    """A lognormal curve."""
    im = np.linspace(0.0, panel.x[1], 100)
    panel.line(im, fit.probability(im / scale.factor), colour, width, dash)


def curve(results: ArchResults, answer: "Answer") -> Picture:
    """Fragility curve of an arch with its band, and what it was made from.

    Observed fractions with exact intervals where every record was run at every level or the runs
    have levels of their own; the distribution of the records' capacities where the levels were
    bisected.
    """
    scale, percent, fit = results.scale, f"{100 * answer.confidence:.0f} %", answer.curve
    free = {
        kind: (colour, found)
        for kind, colour in (("isotonic", look.GREY), ("kernel", look.GREEN))
        if (found := answer.more.get("free", {}).get(kind))
        and not (kind == "isotonic" and results.bisected)
    }
    data = (
        "capacities of the records" if results.bisected else f"fraction, exact {percent} interval"
    )
    entries = [Entry(data, look.INK, "line" if results.bisected else "dot")]
    what = "no lognormal curve could be fitted"
    if isinstance(fit, Fragility):
        entries += band_entries("lognormal curve", percent)
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
    if isinstance(answer.likelihood, Fragility):
        entries.append(Entry("by maximum likelihood", look.BLUE, "dash"))
    entries += [Entry(kind, colour, "line") for kind, (colour, _) in free.items()]

    def draw(panel: Panel) -> None:
        draw_answer(panel, answer, scale, look.BLUE)
        if isinstance(answer.likelihood, Fragility):
            draw_fit(panel, answer.likelihood, scale, look.BLUE, 0.9, _DASH)
        for colour, found in free.values():
            panel.line(scale.factor * np.array(found["im"]), found["probability"], colour, 0.9)
        if isinstance(fit, Fragility) and fit.theta * scale.factor <= panel.x[1]:
            median = fit.theta * scale.factor
            panel.line([0.0, median, median], [0.5, 0.5, 0.0], look.GREY, 0.8, "4 3")
        _draw_data(panel, results, answer.confidence)

    kind = "bisected" if results.bisected else "grouped" if results.grouped else "stripes"
    shaded = f"{band_words(answer)} Thin: curves without a given shape, made from the same runs."
    return curve_picture(
        draw, entries, (1.05 * float(results.levels.max()), scale.label),
        alternative=f"Probability of collapse of {results.arch} against {scale.label}: {what}",
        caption=_DATA[kind] + (shaded if answer.method else ""),
    )  # fmt: skip


def band_entries(name: str, percent: str) -> list[Entry]:
    """Legend of a curve that is quoted and of its band."""
    return [Entry(name, look.BLUE, "line"), Entry(f"{percent} band", "#c9e3f5")]


def band_words(answer: "Answer") -> str:
    """How a band was made, for a caption."""
    if not answer.method:
        return ""
    return f" Shaded: pointwise band, {answer.method}. {answer.assumptions.removesuffix('.')}."


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


def all_curves(
    answers: Mapping[str, "Answer"],
    classes: Mapping[str, "Answer"],
    members: Mapping[str, Sequence["Answer"]],
    scale: Scale,
    marks: tuple[float, float | None],
) -> Picture | None:
    """Curves of all arches in one figure; None if there are fewer than two.

    Classes are drawn with their bands, their arches (`members`) thinly; other arches by name if
    they are not many. `marks` are the level to which the curves are drawn, and one that is
    marked, in the reader's unit.
    """
    known = {k: a for k, a in answers.items() if isinstance(a.curve, Fragility)}
    if len(known) < 2:
        return None
    highest, at = marks
    inside = {id(each) for own in members.values() for each in own}
    named = {k: a for k, a in classes.items() if isinstance(a.curve, Fragility)}
    single = {k: a for k, a in known.items() if id(a) not in inside}
    thin = [(i, thinned(members[k])) for i, k in enumerate(named)]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((len(named), thinned(list(single.values()))))
    entries = [Entry(name, *_stroke(i)[:2]) for i, name in enumerate(named)]
    if any(rows for _, rows in thin):
        entries.append(Entry("each arch", "#b5bec8", "line"))

    def draw(panel: Panel) -> None:
        if at is not None and 0.0 < at < panel.x[1]:
            panel.line([at, at], [0.0, 1.0], look.GREY, 0.9, "2 2")
        for i, rows in thin:
            draw_thin(panel, rows, scale, _stroke(i)[0] if i < len(classes) else look.GREY)
        for i, answer in enumerate(named.values()):
            colour, _, dash = _stroke(i)
            if len(named) <= _SHADED:
                draw_answer(panel, answer, scale, colour, dash)
            elif isinstance(answer.curve, Fragility):
                draw_fit(panel, answer.curve, scale, colour, 1.8, dash)

    fits = {k: a.curve for k, a in (*named.items(), *list(known.items())[:40])}
    return curve_picture(
        draw, entries, (1.05 * highest, scale.label),
        alternative=f"Fragility curves of {len(known)} arches against {scale.label}. "
        f"Medians: {_medians(fits, scale)}",
        caption="Lognormal curves. Shaded, where they are not many: their bands. Of classes: "
        "bold, of an arch of the class that is drawn at random; thin, arches of it. Dotted: the "
        "level that the probability is asked for.",
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

    def draw(panel: Panel) -> None:
        for i, (_, fit) in enumerate(states):
            colour, _, dash = _stroke(i)
            draw_fit(panel, fit, scale, colour, 1.8, dash)

    return curve_picture(
        draw, [Entry(name, *_stroke(i)[:2]) for i, (name, _) in enumerate(states)],
        (1.05 * highest, scale.label), "probability of reaching it",
        alternative=f"Curves of limit states of {arch} against {scale.label}. Medians: "
        + _medians(dict(states), scale),
        caption="Lognormal curves from the same runs, one for each limit state.",
    )  # fmt: skip


def _medians(fits: Mapping[str, Fragility | str], scale: Scale) -> str:
    known = {name: fit for name, fit in fits.items() if isinstance(fit, Fragility)}
    return "; ".join(f"{name} {scale.text(fit.theta)}" for name, fit in known.items())


def _stroke(place: int) -> tuple[str, str, str]:
    """Colour, mark of the legend and dashes of a curve."""
    colour = COLOURS[place % len(COLOURS)]
    return (colour, "dash", _DASH) if place // len(COLOURS) % 2 else (colour, "line", "")
