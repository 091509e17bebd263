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
from archfrag.report import html, svg
from archfrag.report.arch_figure import arch_panel, paint
from archfrag.report.curve_figures import curve_panel, draw_curve
from archfrag.report.film import Example, film
from archfrag.report.html import TEXTS, Picture
from archfrag.report.inputs import ReportInputs, thetas
from archfrag.report.limits import short, study_aspects
from archfrag.report.svg import Entry, Panel, Sheet, figure
from archfrag.simulation.simulate import Onset
from archfrag.study.answer.curves import arch_classes
from archfrag.version import __version__

PERIODS = (475.0, 2475.0)  # return periods of building codes [years]
_SEEN = 0.001  # difference of probabilities that matters
_HALF = 560.0  # width of the curve [px]
_MOST = (270.0, 180.0)  # width and height of an arch, and of two [px]
_SMALL = (270.0, 130.0)


def leading(inputs: ReportInputs) -> tuple[str, Curve]:
    """Return the answer that stands first: of the weakest class, or arch of none.

    It is the most likely to collapse at the level of the first sentence, or has the least median.
    """
    level = sentence_level(inputs)

    def strength(item: tuple[str, Curve]) -> tuple[float, float]:
        name, answer = item
        if not (answer.fitted and inputs.fitted.runs[name].intact):
            return np.inf, np.inf
        return 0.0 if level is None else -float(answer(level[1])), answer.theta

    return min(inputs.quoted.items(), key=strength)


def leading_arch(inputs: ReportInputs) -> int:
    """Return the place among `inputs.arches` of the arch that is drawn first."""
    return _place(inputs, *leading(inputs))


def _place(inputs: ReportInputs, name: str, answer: Curve) -> int:
    """Return the place of an arch, or for a class of its arch with the nearest median."""
    names = [arch for arch, _, _ in inputs.arches]
    if name in names or not answer.fitted:
        return names.index(name) if name in names else 0
    away = np.abs(np.log(thetas(inputs.answers[arch] for arch in names) / answer.theta))
    of_class = arch_classes(inputs.cube)
    foreign = np.array([of_class[arch] != name for arch in names])
    return int(np.where(np.isnan(away) | foreign, np.inf, away).argmin())


def first_page(inputs: ReportInputs, example: Example | None) -> Markup:
    """Return the page; `example` is a collapse of the arch that is drawn, or its nearest miss."""
    what = (
        "collapse"
        if example is not None and example.response.collapsed
        else "near miss"
    )
    arches = list(_arches(inputs))
    columns = (
        2 if len(arches) > 1 else 4
    )  # the frames are as high as the drawings beside them
    moving = example and film(
        example, "first", f"A {what}", what == "near miss", columns
    )
    name, _, _ = inputs.arches[leading_arch(inputs)]
    heading = [
        inputs.about[key]
        for key in ("project", "client", "author")
        if key in inputs.about
    ]
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    return html.template(
        "first.html.j2",
        inputs=inputs,
        heading=[*heading, date, f"archfrag {__version__}"],
        sentence=lead_sentence(inputs),
        compared=before_and_after(inputs),
        film=moving,
        what=what,
        which=f" of {name}" * (len(inputs.answers) > 1),
        run=example,
        arches=arches,
        curve=_curve(inputs),
        facts=_facts(inputs),
        limits=short(study_aspects(inputs)),
    )


def site_levels(inputs: ReportInputs) -> dict[str, float]:
    """Return the intensities [SI] of the site for the return periods of its hazard curve."""
    if inputs.risk is None or isinstance(inputs.risk, str):
        return {}
    curve = inputs.risk.hazard.main
    positive = curve.rate > 0.0
    years = np.log(1.0 / curve.rate[positive])
    im = np.log(curve.im[positive])
    levels = np.exp(np.interp(np.log(PERIODS), years, im, np.nan, np.nan))
    return {
        f"{p:g}-year": float(level) for p, level in zip(PERIODS, levels) if level > 0.0
    }


def sentence_level(inputs: ReportInputs) -> tuple[str, float] | None:
    """Return whose level the first sentence is at, and the level [SI]; None without one."""
    if inputs.at is not None:
        return "", inputs.at / inputs.scale.factor
    named = (
        (f"the {word} motion of the site, ", at)
        for word, at in site_levels(inputs).items()
    )
    return next(named, None)


def lead_sentence(inputs: ReportInputs) -> Markup:
    """Write the probability at the level asked for or of the site, or else the median."""
    name, answer = leading(inputs)
    scale = inputs.scale
    level = sentence_level(inputs)
    if not answer.fitted:
        return html.paragraph(f"There is no fragility curve: {answer.reason}.", "lead")
    form = Markup('<p class="lead">{} <strong>{}</strong> {}</p>')
    whose = _whose(inputs, name)
    if level is None:
        low, high = map(scale.digits, answer.theta_interval)
        start = f"Half of the ground motions make {whose} collapse at"
        end = f"({inputs.percent}: {low} to {high} {scale.unit})."
        return form.format(start, f"{scale.measure} {scale.text(answer.theta)}", end)
    site, at = level
    value, *band = answer.at(at)
    start = f"Under {site}{scale.measure} {scale.text(at)}, {whose} collapses with probability"
    end = f"({inputs.percent}: {html.percentages(band)})."
    risk = None if isinstance(inputs.risk, str | None) else inputs.risk.arches.get(name)
    if (
        not isinstance(risk, str | None)
        and not risk.rate.is_bound
        and risk.rate.quoted > 0.0
    ):
        rates = risk.rate.quoted, risk.rate.upper, risk.rate.lower
        period, *ends = (
            f"{float(f'{1.0 / rate:.2g}'):,.0f}" for rate in rates if rate > 0.0
        )
        found = (
            f" ({inputs.percent}: {' to '.join(ends)})" if risk.rate.lower > 0.0 else ""
        )
        end += f" Collapse has a return period of {period} years{found}."
    return form.format(start, html.percentages([value]), end)


def _whose(inputs: ReportInputs, name: str) -> str:
    """Name the arch or the class of an answer in a sentence."""
    count = sum(inputs.fitted.runs[each].intact for each in inputs.quoted)
    whose = name if len(inputs.quoted) > 1 else _noun(inputs)
    if name in inputs.classes:
        members = list(arch_classes(inputs.cube).values()).count(name)
        whose = f"an arch drawn from class {name} ({members} arches)"
    kinds = "classes and arches" if inputs.classes else "arches"
    kinds = "classes" if len(inputs.quoted) == len(inputs.classes) else kinds
    there = " at this level" * (sentence_level(inputs) is not None)
    return whose + f", the weakest of {count} {kinds}{there}," * (count > 1)


def _noun(inputs: ReportInputs) -> str:
    """Name the only arch of a study, or the structure of a table."""
    if not inputs.arches:
        return next(iter(inputs.quoted))
    _, arch, _ = inputs.arches[0]
    column = "the column" if arch.free_end else "the arch"
    return "the block" if arch.parameters["profile"] == "block" else column


def _facts(inputs: ReportInputs) -> str:
    """Write how many runs and collapses there are, and the dispersion of the only answer."""
    cube = inputs.cube
    verdict = inputs.cube["verdict"].values
    count = len(inputs.answers)
    both = cube.attrs.get("vertical_component", "not used") != "not used"
    words = f"{(verdict != Verdict.NOT_RUN).sum():,} runs of {cube.sizes['record']} "
    words += "ground motions" + " with their vertical components" * both
    collapses = int((verdict == Verdict.COLLAPSED).sum())
    words += f" on {count} arches" * (count > 1) + f", {collapses:,} "
    words += "collapse." if collapses == 1 else "collapses."
    answer = leading(inputs)[1]
    if len(inputs.quoted) == 1 and answer.n_independent and answer.fitted:
        beta, low, high = answer.dispersion_words()
        words += f" Dispersion β {beta} ({inputs.percent}: {low} to {high})."
    return words


def before_and_after(inputs: ReportInputs) -> list[str]:
    """Compare the two arches or classes of a study in sentences; empty if it has not two."""
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
    return f"{row['ratio']:.2f} ({percent}: {row['lower']:.2f} to {row['upper']:.2f})"


def _crossing(inputs: ReportInputs) -> Iterator[str]:
    """Say which of two curves is higher below the level at which they cross, if they do."""
    levels = inputs.cube["intensity"].values
    scale = inputs.scale
    im = np.geomspace(np.nanmin(levels), np.nanmax(levels), 400)
    one, two = (fit.probability(im) for fit in inputs.known.values())
    seen = np.flatnonzero(np.abs(two - one) > _SEEN)
    sign = np.sign(two - one)[seen]
    changes = np.flatnonzero(np.diff(sign))
    if changes.size == 1:
        start = seen[changes[0]]
        end = seen[changes[0] + 1]
        at = scale.factor * float(
            im[start + np.abs(two - one)[start : end + 1].argmin()]
        )
        name = list(inputs.known)[int(sign[changes[0]] > 0.0)]
        level = html.rounded(at)
        where = f"Below {scale.measure} {level} {scale.unit} the curve of {name} is the higher one"
        yield f"{where}, because its β is larger."


def _arches(inputs: ReportInputs) -> Iterator[Picture]:
    """Draw the arch of the leading answer; of two that look different both."""
    places = [leading_arch(inputs)]
    most = _MOST
    if len(inputs.quoted) == 2:
        both = [_place(inputs, *answer) for answer in inputs.quoted.items()]
        drawn = [
            [s.points.tolist() for s in inputs.arches[place][1].marks] for place in both
        ]
        if both[0] != both[1] and drawn[0] != drawn[1]:
            places = both
            most = _SMALL
    named = bool(inputs.classes) or len(inputs.quoted) > 1
    for place in places:
        yield _arch(*inputs.arches[place], named, most)


def _arch(
    name: str, arch: Arch, onset: Onset, named: bool, most: tuple[float, float]
) -> Picture:
    """Draw an arch to scale with its dimensions and hinges at onset; `named` in the caption."""
    sheet = Sheet(svg.NARROW)
    panel = arch_panel(sheet, arch, 0.5 * sheet.width, 24.0, most)
    sheet.height = panel.box[3] + 8.0
    words = _dimensions(panel, arch)
    caption = f"Drawn: {name}. " * named
    if not onset.stands:
        caption += "It does not stand under its own weight."
        return Picture(sheet.svg(f"{name}: {words}"), caption)
    towards = "-x" if onset.minus < 0.999 * onset.plus else "+x"
    limit, hinges, _ = onset.mechanism(towards)
    paint(panel, mechanism_marks(arch, hinges, ()))
    roles = [shape.role for shape in arch.marks]
    caption += f"Blue: {counted(roles.count('tie'), 'tie')}. " * ("tie" in roles)
    caption += "Dashed: the surface of the fill. " * ("earth" in roles)
    caption += f"Motion begins at {html.onset_text(limit)} of ground acceleration"
    one_way = not np.isclose(onset.plus, onset.minus)
    caption += f" towards {towards.replace('-', '−')}" * one_way
    caption += " with these hinges." if len(hinges) else "."
    return Picture(sheet.svg(f"{name} to scale: {words}"), caption)


def _dimensions(panel: Panel, arch: Arch) -> str:
    """Draw span, rise and thickness, or width and height; return them in words."""
    sheet, (left, top, right, bottom) = panel.sheet, panel.box
    if arch.free_end:
        width = np.ptp(panel.x)
        height = np.ptp(panel.y)
        _measure(sheet, (left, bottom + 12.0), (right, bottom + 12.0), f"{width:.3g} m")
        _measure(sheet, (right + 12.0, bottom), (right + 12.0, top), f"{height:.3g} m")
        return f"width {width:.3g} m, height {height:.3g} m"
    line = 0.5 * (arch.intrados + arch.extrados)
    which = ""
    if arch.parameters.get("span") is None:  # as a drawing gives them
        line = arch.intrados
        which = "clear "
    ends = line[list(arch.springings)]
    crown = line[line[:, 1].argmax()]
    span = float(np.ptp(ends[:, 0]))
    springing = float(ends[:, 1].min())
    _, rise, thickness = arch.dimensions
    if not which:
        rise = float(arch.parameters.get("rise") or crown[1] - springing)
    (start, end), base = panel.at_x(np.sort(ends[:, 0])), float(panel.at_y(springing))
    _measure(
        sheet, (start, base + 16.0), (end, base + 16.0), f"{which}span {span:.3g} m"
    )
    middle = float(panel.at_x(crown[0]))
    if rise > 0.0:
        over = float(panel.at_y(springing + rise))
        _measure(sheet, (middle, base), (middle, over), f"rise {rise:.3g} m")
    sheet.text(middle, top - 8.0, f"thickness {thickness:.3g} m", "m")
    return f"{which}span {span:.3g} m, rise {rise:.3g} m, thickness {thickness:.3g} m"


def _measure(
    sheet: Sheet, start: tuple[float, float], end: tuple[float, float], words: str
) -> None:
    """Draw a dimension line with its number: below a level one, right of an upright one."""
    (a, b), (c, d) = start, end
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


@partial(figure, width=_HALF)
def _curve(sheet: Sheet, inputs: ReportInputs) -> tuple[str, str]:
    """Draw the curve with its band, what was observed, theta, and levels of the site or of the
    reader; of two arches or classes the other curve too.
    """
    (name, answer), scale, reach = leading(inputs), inputs.scale, 1.05 * inputs.highest
    others = {k: fit for k, fit in inputs.known.items() if k != name}
    others = others if len(others) == 1 else {}
    whose = name if len(inputs.quoted) > 1 else _noun(inputs)
    whose = f"class {name}" if name in inputs.classes else whose
    entries = [
        Entry(name, svg.BLUE, "line"),
        *(Entry(k, svg.GREEN, "dash") for k in others),
    ]
    panel = curve_panel(sheet, entries if others else [], reach, scale.label)
    words = f"Probability of collapse of {whose} against {scale.label}"
    results = inputs.results(name)
    kinds = TEXTS["first_curve"]
    kind = ""
    if np.isfinite(results.fraction).any():
        kind = kinds["ida" if results.runs.gaps else results.runs.design.kind]
    seen = results.levels, results.fraction, svg.INK, "dot", 2.6
    if not (fit := answer).fitted:
        panel.dots(*seen)
        return words, kind.strip()
    curve = "mean curve of the arches" if fit.members is not None else "lognormal curve"
    caption = f"Line: {curve} of {whose}. Shaded: {inputs.percent} band.{kind}"
    marked = {word: scale.factor * level for word, level in site_levels(inputs).items()}
    marked |= {} if inputs.at is None else {"asked for": inputs.at}
    marked = {word: level for word, level in marked.items() if level < reach}
    for level in marked.values():
        panel.line([level, level], [0.0, 1.0], svg.VERMILION, 1.1, "2 2")
    for key, other in others.items():
        draw_curve(panel, other, scale, entries[1], 1.6, band=False)
        more = inputs.results(key)
        panel.dots(more.levels, more.fraction, entries[1].colour, "ring", 2.6)
    draw_curve(panel, answer, scale, entries[0], 2.4)
    panel.dots(*seen)
    theta = scale.factor * fit.theta
    median = scale.text(fit.theta)
    if theta < reach:
        half = float(fit.probability(fit.theta))  # of a class not quite 0.5
        panel.line([0.0, theta, theta], [half, half, 0.0], svg.INK, 0.9, "4 3")
        panel.dots([theta], [half], svg.BLUE, "hinge", 4.5)
        panel.label(theta, panel.box[3] - 7.0, f"θ = {median}", "b")
    for row, word in enumerate(sorted(marked, key=marked.__getitem__)):
        panel.label(marked[word], panel.box[1] + 12.0 + 14.0 * row, word, "b")
    return f"{words}: median {median}, dispersion {fit.dispersion_words()[0]}", caption
