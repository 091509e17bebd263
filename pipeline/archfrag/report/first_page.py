"""First page of the report: the answer in a sentence, the arch to scale, the curve, a collapse."""

import datetime
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
from markupsafe import Markup

from archfrag.arch import Arch
from archfrag.arch.marks import mechanism_marks
from archfrag.files import counted
from archfrag.fragility.curve import Curve
from archfrag.fragility.verdicts import Verdict
from archfrag.report.arch_figure import arch_panel, paint
from archfrag.report.curve_figures import curve_panel, draw_curve
from archfrag.report.film import Example, film
from archfrag.report.html import (
    TEXTS,
    Picture,
    digits,
    interval,
    onset_text,
    paragraph,
    percentages,
    rounded,
    template,
)
from archfrag.report.inputs import ReportInputs, thetas
from archfrag.report.limits import short, study_aspects
from archfrag.report.svg import (
    BLUE,
    GREEN,
    INK,
    NARROW,
    VERMILION,
    Entry,
    Panel,
    Range,
    Sheet,
    figure,
)
from archfrag.simulation.simulate import Onset
from archfrag.version import __version__

PERIODS = (475.0, 2475.0)  # return periods of building codes [years]
_SEEN = 0.001  # difference of probabilities that matters
_MOST = (270.0, 180.0)  # width and height of an arch, and of two [px]
_SMALL = (270.0, 130.0)
_LEAST = 90.0  # width of a span with dimension lines, in a bridge [px]


def leading(inputs: ReportInputs) -> tuple[str, Curve]:
    """Return name and curve of the weakest class or arch without a class.

    It is the most likely one to collapse at the level of the first sentence; without a level it
    has the lowest median.
    """
    level = sentence_level(inputs)

    def strength(item: tuple[str, Curve]) -> Range:
        name, answer = item
        if not (answer.fitted and inputs.fitted.runs[name].intact):
            return np.inf, np.inf
        return 0.0 if level is None else -answer(level[1]), answer.theta

    return min(inputs.quoted.items(), key=strength)


def leading_arch(inputs: ReportInputs) -> str:
    """Return the name of the arch that is drawn first."""
    return _drawn(inputs, *leading(inputs))


def _drawn(inputs: ReportInputs, name: str, answer: Curve) -> str:
    """Return the name of the arch that is drawn for an arch or a class.

    For a class it is the member whose median is nearest to that of the class.
    """
    names = list(inputs.arches)
    if name in names or not answer.fitted:
        return name if name in names else names[0]
    away = np.abs(np.log(thetas(inputs.curves[arch] for arch in names) / answer.theta))
    foreign = np.array([inputs.of_class[arch] != name for arch in names])
    return names[np.where(np.isnan(away) | foreign, np.inf, away).argmin()]


def first_page(inputs: ReportInputs, example: Example | None) -> Markup:
    """Return the page; `example` is a collapse of the arch that is drawn, or a near miss."""
    what = "near miss"
    if example is not None and example.response.collapsed:
        what = "collapse"
    arches = list(_arches(inputs))
    # The frames are as high as the drawings beside them.
    long = example is not None and len(example.arch.spans) > 2
    columns = 2 if len(arches) > 1 or long else 4
    moving = example and film(
        example, "first", f"A {what}", what == "near miss", columns
    )
    about = [inputs.about.get(key) for key in ("project", "client", "author")]
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    return template(
        "first.html.j2",
        inputs=inputs,
        heading=filter(None, [*about, date, f"archfrag {__version__}"]),
        sentence=lead_sentence(inputs),
        compared=before_and_after(inputs),
        film=moving,
        what=what,
        which=f" of {leading_arch(inputs)}" * (len(inputs.answers) > 1),
        run=example,
        arches=arches,
        curve=_curve(inputs),
        facts=_facts(inputs),
        limits=short(study_aspects(inputs)),
    )


def site_levels(inputs: ReportInputs) -> dict[str, float]:
    """Return the intensities of the site for the return periods of its hazard curve."""
    if inputs.risk is None or isinstance(inputs.risk, str):
        return {}
    found = inputs.risk.hazard.main.level_of(PERIODS)
    levels = zip(PERIODS, (inputs.scale.factor * found).tolist())
    return {f"{period:g}-year": level for period, level in levels if level > 0.0}


def sentence_level(inputs: ReportInputs) -> tuple[str, float] | None:
    """Return words for the level of the first sentence, and the level; None without one.

    It is the level that was asked for, or else one of the site.
    """
    if inputs.at is not None:
        return "", inputs.at
    for word, level in site_levels(inputs).items():
        return f"the {word} motion of the site, ", level
    return None


def lead_sentence(inputs: ReportInputs) -> Markup:
    """Return the first sentence: the probability at `sentence_level`, or else the median."""
    name, answer = leading(inputs)
    scale = inputs.scale
    percent = inputs.percent
    level = sentence_level(inputs)
    if not answer.fitted:
        return paragraph(f"There is no fragility curve: {answer.reason}.", "lead")
    form = Markup('<p class="lead">{} <strong>{}</strong> {}</p>')
    whose = _whose(inputs, name)
    if level is None:
        ends = interval(answer.theta_interval, digits)
        start = f"Half of the ground motions make {whose} collapse at"
        median = f"{scale.measure} {scale.text(answer.theta)}"
        return form.format(start, median, f"({percent}: {ends} {scale.unit}).")
    site, at = level
    value, *band = answer.at(at)
    start = f"Under {site}{scale.measure} {scale.text(at)}, {whose} collapses with probability"
    end = f"({percent}: {percentages(band)})."
    found = (
        None if isinstance(inputs.risk, str | None) else inputs.risk.arches.get(name)
    )
    rate = None if isinstance(found, str | None) else found.rate
    if rate and not rate.is_bound and rate.quoted > 0.0:
        rates = rate.quoted, rate.upper, rate.lower
        period, *years = (
            f"{float(f'{1.0 / each:.2g}'):,.0f}" for each in rates if each > 0.0
        )
        ends = f" ({percent}: {' to '.join(years)})" * (rate.lower > 0.0)
        end += f" Collapse has a return period of {period} years{ends}."
    return form.format(start, percentages([value]), end)


def _whose(inputs: ReportInputs, name: str) -> str:
    """Name the arch or the class of an answer in a sentence."""
    count = sum(inputs.fitted.runs[each].intact for each in inputs.quoted)
    whose = name if len(inputs.quoted) > 1 else _noun(inputs)
    if name in inputs.classes:
        members = list(inputs.of_class.values()).count(name)
        whose = f"an arch drawn from class {name} ({members} arches)"
    there = " at this level" * (sentence_level(inputs) is not None)
    return whose + f", the weakest of {count} arches or classes{there}," * (count > 1)


def _noun(inputs: ReportInputs) -> str:
    """Name the only arch of a study, or the structure of a table."""
    if not inputs.arches:
        return next(iter(inputs.quoted))
    arch = next(iter(inputs.arches.values())).arch
    span = "the bridge" if len(arch.spans) > 1 else "the arch"
    column = "the column" if arch.free_end else span
    return "the block" if arch.parameters["profile"] == "block" else column


def _facts(inputs: ReportInputs) -> str:
    """Return text on the numbers of runs and collapses; if one answer, its dispersion too."""
    cube = inputs.cube
    verdict = cube["verdict"].values
    count = len(inputs.answers)
    both = cube.attrs.get("vertical_component", "not used") != "not used"
    words = f"{(verdict != Verdict.NOT_RUN).sum():,} runs of {cube.sizes['record']} "
    words += "ground motions" + " with their vertical components" * both
    collapses = int((verdict == Verdict.COLLAPSED).sum())
    words += f" on {count} arches" * (count > 1)
    words += f", {collapses:,} collapse{'s' * (collapses != 1)}."
    _, answer = leading(inputs)
    if len(inputs.quoted) == 1 and answer.n_independent and answer.fitted:
        beta, low, high = answer.dispersion_words()
        words += f" Dispersion β {beta} ({inputs.percent}: {low} to {high})."
    return words


def before_and_after(inputs: ReportInputs) -> list[str]:
    """Return sentences that compare the two arches or classes of a study.

    The list is empty unless there are exactly two.
    """
    ratios = inputs.ratios
    if isinstance(ratios, str) or len(ratios) != 1:
        return []
    first, second = inputs.known
    median, *rates = (
        ratio_text(row, inputs.percent) for row in ratios[second].values()
    )
    whose = " ".join(filter(None, [second, inputs.stands_after(second)]))
    words = f"The median capacity of {whose} is {median} times that of {first}"
    words += "".join(f", its annual rate of collapse {rate} times" for rate in rates)
    return [f"{words}.", *_crossing(inputs)]


def ratio_text(row: Mapping[str, float], percent: str) -> str:
    """Write a ratio with its interval."""
    return f"{row['ratio']:.2f} ({percent}: {interval((row['lower'], row['upper']))})"


def _crossing(inputs: ReportInputs) -> Iterator[str]:
    """Yield a sentence on which of two curves is higher below their crossing, if they cross."""
    levels = inputs.scale.factor * inputs.cube["intensity"].values
    im = np.geomspace(np.nanmin(levels), np.nanmax(levels), 400)
    one, two = (fit(im) for fit in inputs.known.values())
    seen = np.flatnonzero(np.abs(two - one) > _SEEN)
    sign = np.sign(two - one)[seen]
    changes = np.flatnonzero(np.diff(sign))
    if changes.size == 1:
        start, end = seen[changes[0] : changes[0] + 2]
        at = im[start + np.abs(two - one)[start : end + 1].argmin()]
        name = list(inputs.known)[int(sign[changes[0]] > 0.0)]
        level = f"{inputs.scale.measure} {rounded(at)} {inputs.scale.unit}"
        yield f"Below {level} the curve of {name} is the higher one, because its β is larger."


def _arches(inputs: ReportInputs) -> Iterator[Picture]:
    """Yield the drawing of the leading arch, or of both if two look different."""
    names = [leading_arch(inputs)]
    most = _MOST
    if len(inputs.quoted) == 2:
        both = [_drawn(inputs, *answer) for answer in inputs.quoted.items()]
        marks = [inputs.arches[name].arch.marks for name in both]
        one, two = ([mark.points.tolist() for mark in each] for each in marks)
        if one != two:
            names = both
            most = _SMALL
    named = bool(inputs.classes) or len(inputs.quoted) > 1
    for name in names:
        yield _arch(name, inputs.arches[name], named, most)


def _arch(name: str, onset: Onset, named: bool, most: Range) -> Picture:
    """Draw an arch to scale with its dimensions and its hinges at onset.

    If `named`, the caption has its name. `most` is its largest width and height [px].
    """
    arch = onset.arch
    sheet = Sheet(NARROW)
    panel = arch_panel(sheet, arch, 0.5 * sheet.width, 24.0, most)
    sheet.height = panel.box[3] + 8.0
    words = _dimensions(panel, arch)
    caption = f"Drawn: {name}. " * named
    caption += f"{words}. " * words[0].isdigit()
    if not onset.stands:
        caption += "It does not stand under its own weight."
        return Picture(sheet.svg(f"{name}: {words}"), caption)
    towards = "-x" if onset.minus < 0.999 * onset.plus else "+x"
    limit, hinges, _ = onset.mechanism(towards)
    paint(panel, mechanism_marks(arch, hinges, ()))
    roles = [shape.role for shape in arch.marks]
    caption += f"Blue: {counted(roles.count('tie'), 'tie')}. " * ("tie" in roles)
    caption += "Dashed: the surface of the fill. " * ("earth" in roles)
    caption += f"Motion begins at {onset_text(limit)} of ground acceleration"
    one_way = not np.isclose(onset.plus, onset.minus)
    caption += f" towards {towards.replace('-', '−')}" * one_way
    caption += " with these hinges." if len(hinges) else "."
    return Picture(sheet.svg(f"{name} to scale: {words}"), caption)


def _dimensions(panel: Panel, arch: Arch) -> str:
    """Draw span, rise and thickness, or width and height; return them in words."""
    sheet = panel.sheet
    left, top, right, bottom = panel.box
    if arch.free_end:
        width, height = (f"{np.ptp(ends):.3g} m" for ends in (panel.x, panel.y))
        below = bottom + 12.0
        _measure(sheet, (left, below), (right, below), width)
        edge = right + 12.0
        _measure(sheet, (edge, bottom), (edge, top), height)
        return f"width {width}, height {height}"
    line = 0.5 * (arch.intrados + arch.extrados)
    drawing = len(arch.spans) > 1 or arch.parameters.get("span") is None
    if drawing:
        line = arch.intrados
    line = line[list(max(arch.spans, key=arch.dimensions_of).joints)]
    ends = line[[0, -1]]
    crown = line[line[:, 1].argmax()]
    springing = ends[:, 1].min()
    _, rise, thickness = arch.dimensions
    if not drawing:
        rise = arch.parameters.get("rise") or crown[1] - springing
    span = f"{'clear ' * drawing}span {np.ptp(ends[:, 0]):.3g} m"
    words = span, f"rise {rise:.3g} m", f"thickness {thickness:.3g} m"
    start, end = panel.at_x(np.sort(ends[:, 0]))
    if end - start < _LEAST and len(arch.spans) > 1:
        return f"{len(arch.spans)} spans, the widest: {', '.join(words)}"
    base = float(panel.at_y(springing))
    _measure(sheet, (start, base + 16.0), (end, base + 16.0), words[0])
    middle = float(panel.at_x(crown[0]))
    if rise > 0.0:
        over = float(panel.at_y(springing + rise))
        _measure(sheet, (middle, base), (middle, over), words[1])
    sheet.text(middle, top - 8.0, words[2], "m")
    return ", ".join(words)


def _measure(sheet: Sheet, start: Range, end: Range, words: str) -> None:
    """Draw a dimension line with its number: below a level line, right of an upright line."""
    a, b = start
    c, d = end
    tick = "m-4 0h8" if a == c else "m0 -4v8"
    line = (
        f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}M{a:.1f} {b:.1f}{tick}M{c:.1f} {d:.1f}{tick}"
    )
    sheet.path(line, kind="ax")
    if a == c:
        sheet.text(a + 6.0, 0.5 * (b + d) + 4.0, words)
    else:
        sheet.text(0.5 * (a + c), b + 14.0, words, "m")
        sheet.height = max(sheet.height, b + 20.0)


@partial(figure, width=560.0)
def _curve(sheet: Sheet, inputs: ReportInputs) -> tuple[str, str]:
    """Draw the leading curve with its band, the observed fractions and theta.

    Levels of the site, and the level that was asked for, are marked. If there are two arches or
    classes, the other curve is drawn too.
    """
    name, fit = leading(inputs)
    scale = inputs.scale
    reach = 1.05 * inputs.highest
    whose = name if len(inputs.quoted) > 1 else _noun(inputs)
    whose = f"class {name}" if name in inputs.classes else whose
    strokes = {name: Entry(name, BLUE, "line")}
    if len(inputs.known) == 1 + (name in inputs.known):
        for other in inputs.known:
            strokes.setdefault(other, Entry(other, GREEN, "dash"))
    entries = list(strokes.values()) if len(strokes) > 1 else []
    panel = curve_panel(sheet, entries, reach, scale.label)
    words = f"Probability of collapse of {whose} against {scale.label}"
    results = inputs.results(name)
    kinds = TEXTS["first_curve"]
    kind = ""
    if np.isfinite(results.fraction).any():
        kind = kinds["ida" if results.runs.gaps else results.runs.design.kind]
    seen = results.levels, results.fraction, INK, "dot", 2.6
    if not fit.fitted:
        panel.dots(*seen)
        return words, kind.strip()
    curve = "mean curve of the arches" if fit.members is not None else "lognormal curve"
    caption = f"Line: {curve} of {whose}. Shaded: {inputs.percent} band.{kind}"
    marked = site_levels(inputs)
    if inputs.at is not None:
        marked["asked for"] = inputs.at
    marked = {word: level for word, level in marked.items() if level < reach}
    for level in marked.values():
        panel.line([level, level], [0.0, 1.0], VERMILION, 1.1, "2 2")
    for other, stroke in strokes.items():
        if other != name:
            draw_curve(panel, inputs.known[other], stroke, 1.6, band=False)
            more = inputs.results(other)
            panel.dots(more.levels, more.fraction, stroke.colour, "ring", 2.6)
    draw_curve(panel, fit, strokes[name], 2.4)
    panel.dots(*seen)
    median = scale.text(fit.theta)
    if fit.theta < reach:
        half = fit(fit.theta)  # of a class not quite 0.5
        corner = [0.0, fit.theta, fit.theta]
        panel.line(corner, [half, half, 0.0], INK, 0.9, "4 3")
        panel.dots([fit.theta], [half], BLUE, "hinge", 4.5)
        panel.label(fit.theta, panel.box[3] - 7.0, f"θ = {median}", "b")
    for row, word in enumerate(sorted(marked, key=marked.__getitem__)):
        panel.label(marked[word], panel.box[1] + 12.0 + 14.0 * row, word, "b")
    return f"{words}: median {median}, dispersion {fit.dispersion_words()[0]}", caption
