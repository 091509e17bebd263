"""Figures of fragility curves: of an arch, a class, all arches, limit states and two studies."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from archfrag.fragility.counts import clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.fragility.quoted import Answer, curve_of_dict
from archfrag.report import drawing as look
from archfrag.report.drawing import Entry, Panel, Sheet, figure
from archfrag.report.html import TEXTS, Picture
from archfrag.report.inputs import ArchResults, ReportInputs, Scale
from archfrag.study.answer.curves import arch_classes

MOST_NAMED = 12  # curves with a colour and stroke of their own
MOST_THIN = 60  # curves of arches that are drawn for their class
_SHADED = 6  # curves that are drawn with their bands
_BAND, _THIN = "#c9e3f5", "#b5bec8"  # in legends
_DAMAGE = ("#fdca26", "#fb9f3a", "#ed7953", "#d8576b", "#bd3786", "#9c179e")  # light to severe


def _panel(
    sheet: Sheet, entries: Sequence[Entry], reach: float, title: str,
    words: str = "probability of collapse",
) -> Panel:  # fmt: skip
    height = 250.0 if sheet.narrow else 300.0
    panel = look.panel_below(sheet, entries, height, (0.0, reach), (0.0, 1.0))
    panel.axis_y(look.even_ticks(0.0, 1.0), words)
    panel.axis_x(look.even_ticks(0.0, reach, 6 if sheet.narrow else 9), title, grid=True)
    return panel


def draw_curve(
    panel: Panel, shown: Answer | Fragility | str, scale: Scale, stroke: Entry, width: float = 1.8
) -> None:
    """Draw a lognormal curve, and the band of an answer; nothing if there is no curve."""
    fit = shown.curve if isinstance(shown, Answer) else shown
    if isinstance(fit, str):
        return
    if isinstance(shown, Answer):
        im, low, high = np.array([shown.im, shown.lower, shown.upper])
        seen = scale.factor * im <= panel.x[1]
        shade = look.SKY if stroke.colour == look.BLUE else stroke.colour
        panel.band(scale.factor * im[seen], low[seen], high[seen], shade, 0.25)
    im = np.linspace(0.0, panel.x[1], 100)
    dash = "5 2.5" if stroke.mark == "dash" else ""
    panel.line(im, fit.probability(im / scale.factor), stroke.colour, width, dash)


def draw_fractions(panel: Panel, results: ArchResults, colour: str, mark: str = "dot") -> None:
    """Draw the fraction of the known verdicts at each level that are collapses."""
    known = results.known
    used = known["n"] > 0
    fraction = known["collapsed"][used] / known["n"][used]
    panel.dots(results.levels[used], fraction, colour, mark)


def _stroke(name: str, place: int, colours: Sequence[str] = look.COLOURS) -> Entry:
    dashed = place // len(colours) % 2
    return Entry(name, colours[place % len(colours)], "dash" if dashed else "line")


def _thinned(fits: Iterable[Fragility]) -> list[Fragility]:
    """At most `MOST_THIN` curves, evenly from the weakest to the strongest."""
    known = sorted(fits, key=lambda fit: fit.theta)
    places = np.linspace(0, len(known) - 1, min(len(known), MOST_THIN))
    return [known[i] for i in places.round().astype(int)]


def _known(answers: Mapping[str, Answer]) -> dict[str, Fragility]:
    fits = {name: answer.curve for name, answer in answers.items()}
    return {name: fit for name, fit in fits.items() if isinstance(fit, Fragility)}


def _medians(fits: Mapping[str, Fragility], scale: Scale) -> str:
    return "Medians: " + "; ".join(f"{name} {scale.text(fit.theta)}" for name, fit in fits.items())


def _band_words(answer: Answer) -> str:
    if not answer.method:
        return ""
    return f" Shaded: pointwise band, {answer.method}. {answer.assumptions.removesuffix('.')}."


@figure
def curve(sheet: Sheet, results: ArchResults, answer: Answer) -> tuple[str, str]:
    """Fragility curve of an arch with its band, and the capacities or fractions behind it."""
    scale, fit, percent = results.scale, answer.curve, f"{100 * answer.confidence:.0f} %"
    texts, highest, isotonic = TEXTS["curve"], float(results.levels.max()), None
    if results.design.adaptive:
        caption = texts["searched"]
        entries = [Entry("capacities of the records", look.INK, "line")]
    else:
        caption = texts["stripes" if results.own_levels is None else "grouped"]
        entries = [Entry(f"fraction, exact {percent} interval", look.INK, "dot")]
        isotonic = answer.more.get("free", {}).get("isotonic")
    reach, what = 1.05 * highest, "no lognormal curve could be fitted"
    if isinstance(fit, Fragility):
        entries += [Entry("lognormal curve", look.BLUE, "line"), Entry(f"{percent} band", _BAND)]
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
        reach = min(max(reach, 1.1 * fit.theta * scale.factor), 3.0 * highest)
        caption += _band_words(answer)
    likeliest = Entry("by maximum likelihood", look.BLUE, "dash")
    if isinstance(answer.likelihood, Fragility):
        entries.append(likeliest)
    if isotonic:
        entries.append(Entry("isotonic", look.GREY, "line"))
        caption += texts["isotonic"]
    panel = _panel(sheet, entries, reach, scale.label)
    draw_curve(panel, answer, scale, Entry("", look.BLUE, "line"))
    draw_curve(panel, answer.likelihood, scale, likeliest, 0.9)
    if isotonic:
        im = scale.factor * np.array(isotonic["im"])
        panel.line(im, isotonic["probability"], look.GREY, 0.9)
    if isinstance(fit, Fragility) and (median := fit.theta * scale.factor) <= reach:
        panel.line([0.0, median, median], [0.5, 0.5, 0.0], look.GREY, 0.8, "4 3")
        x, words = float(panel.at_x(median)), f"θ = {scale.text(fit.theta)}"
        fits = x + look.text_width(words, look.SMALL) + 8.0 < panel.box[2]
        shift, kind = (4.0, "s") if fits else (-4.0, "s e")
        sheet.text(x + shift, panel.box[3] - 6.0, words, kind)
    if reach > 1.05 * highest:
        panel.line([highest, highest], [0.0, 1.0], look.GREY, 0.9, "2 2")
        caption += texts["extrapolated"]
    _draw_data(panel, results, answer.confidence)
    return f"Probability of collapse of {results.arch} against {scale.label}: {what}", caption


def _draw_data(panel: Panel, results: ArchResults, confidence: float) -> None:
    if results.design.adaptive:
        capacity = results.capacities
        seen = np.sort(capacity[capacity <= panel.x[1]])
        height = np.arange(seen.size + 1) / max(capacity.size, 1)
        steps = np.concatenate([[0.0], np.repeat(seen, 2), [results.levels.max()]])
        panel.line(steps, np.repeat(height, 2), look.INK, 1.1)
        return
    used = results.counts["n"] > 0
    collapsed, n = (results.counts[name][used] for name in ("collapsed", "n"))
    level, (low, high) = results.levels[used], clopper_pearson(collapsed, n, confidence)
    bars = np.column_stack([low, high, np.full(low.size, np.nan)])
    panel.line(np.repeat(level, 3), bars.ravel(), look.INK, 0.9)
    draw_fractions(panel, results, look.INK)


@figure
def _several(
    sheet: Sheet, scale: Scale, reach: float, named: Sequence[tuple[Entry, Answer | Fragility]],
    texts: tuple[str, str], *, thin: Sequence[tuple[str, Sequence[Fragility]]] = (),
    key: Sequence[Entry] = (), at: float | None = None, title: str = "probability of collapse",
    data: Sequence[ArchResults] = (),
) -> tuple[str, str]:  # fmt: skip
    """Curves with names and data, over thin ones of one colour each; a level is marked."""
    panel = _panel(sheet, key or [own for own, _ in named], reach, scale.label, title)
    if at is not None and 0.0 < at < reach:
        panel.line([at, at], [0.0, 1.0], look.GREY, 0.9, "2 2")
    im = np.linspace(0.0, reach, 34)
    for colour, fits in thin:
        opacity = float(np.clip(25.0 / max(len(fits), 1), 0.15, 0.5))
        for fit in fits:
            panel.line(im, fit.probability(im / scale.factor), colour, 0.5, opacity=opacity)
    for own, shown in named:
        draw_curve(panel, shown, scale, own)
    for (own, _), results, mark in zip(named, data, ("dot", "ring")):
        draw_fractions(panel, results, own.colour, mark)
    return texts


def all_curves(
    inputs: ReportInputs, answers: Mapping[str, Answer], classes: Mapping[str, Answer]
) -> Picture | None:
    """Curves of some arches and classes in one figure; None if there are fewer than two."""
    known, named, of_class = _known(answers), _known(classes), arch_classes(inputs.cube)
    if len(known) + len(named) < 2:
        return None
    single = {k: fit for k, fit in known.items() if of_class.get(k) not in classes}
    members = [[fit for k, fit in known.items() if of_class.get(k) == name] for name in classes]
    thin = [(_stroke("", i).colour, _thinned(own)) for i, own in enumerate(members)]
    if len(named) + len(single) <= MOST_NAMED:
        named |= single
    elif single:
        thin.append((look.GREY, _thinned(single.values())))
    strokes = [_stroke(name, i) for i, name in enumerate(named)]
    shaded, words = len(named) <= _SHADED, TEXTS["all_curves"]
    shown = [{**answers, **classes}[k] if shaded else fit for k, fit in named.items()]
    caption = words["bands" if shaded else "curves"]
    caption += words["classes"] * bool(classes) + words["at"] * (inputs.at is not None)
    texts = (
        f"Fragility curves of {len(known)} arches against {inputs.scale.label}. "
        + _medians(named | dict(list(known.items())[:40]), inputs.scale),
        caption + "".join(map(_band_words, classes.values())),
    )
    key = strokes + [Entry("each arch", _THIN, "line")] * any(fits for _, fits in thin)
    drawn = inputs.scale, 1.05 * inputs.highest, list(zip(strokes, shown, strict=True)), texts
    return _several(*drawn, thin=thin, key=key, at=inputs.at)


def limit_states(inputs: ReportInputs, answer: Answer, name: str) -> Picture | None:
    """Curves of the limit states of an arch or a class; None if none has one."""
    states = answer.more.get("limit_states", {}).get("states", ())
    curves = [
        (_stroke(state["name"].replace("_", " "), i, _DAMAGE), fit)
        for i, state in enumerate(states)
        if isinstance(fit := curve_of_dict(state["curve"]), Fragility)
    ]
    if not curves:
        return None
    scale = inputs.scale
    medians = _medians({own.label: fit for own, fit in curves}, scale)
    text = f"Curves of limit states of {name} against {scale.label}. {medians}"
    texts, title = (text, TEXTS["limit_states"]["caption"]), "probability of reaching it"
    return _several(scale, 1.05 * inputs.highest, curves, texts, title=title)


def two_studies(names: Sequence[str], sides: Sequence[tuple[ArchResults, Answer]]) -> Picture:
    """Curves of an arch in two studies with their bands, and the observed fractions."""
    scale = sides[0][0].scale
    reach = 1.05 * max(results.levels.max() for results, _ in sides)
    strokes = [Entry(names[0], look.BLUE, "line"), Entry(names[1], look.VERMILION, "dash")]
    medians = _medians(_known({name: answer for name, (_, answer) in zip(names, sides)}), scale)
    what = f"Probability of collapse of {sides[0][0].arch} against {scale.label} in two studies"
    texts = f"{what}. {medians}", TEXTS["two_studies"]["caption"]
    curves = [(own, answer) for own, (_, answer) in zip(strokes, sides)]
    return _several(scale, reach, curves, texts, data=[results for results, _ in sides])
