"""Figures and tables of risk: rates of collapse; hazard, fragility and their product."""

from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from archfrag.fragility.contributions import NOT_KNOWN, Contributions
from archfrag.report import drawing as look
from archfrag.report.axes import Panel, even_ticks, log_ticks
from archfrag.report.drawing import BELOW, Box, Entry, FloatArray, Sheet, figure
from archfrag.report.results import Scale, digits, measured, table, to, years
from archfrag.report.runs import LOOKS, level_axis
from archfrag.study.answer.risk import ASSUMPTIONS, OTHER, ArchRisk, StudyRisk
from archfrag.study.file.hazard import Hazard
from archfrag.study.file.members import SHOWN

_REACH = 1e-4  # of the greatest density of the rate, where the axis ends
_BESIDE, _HEIGHTS = 66.0, (150.0, 110.0, 110.0)  # left of the panels and their heights [px]


def risk_section(risk: StudyRisk, scale: Scale, percent: str) -> dict[str, Any]:
    """Rates of collapse, their tables and figures, by the names of the page's template.

    Of many arches only the first have figures: each takes 0.3 MB.
    """
    shown = SHOWN if len(risk.arches) <= SHOWN else 3
    return {
        "study": risk,
        "rates": _rates_table(risk, percent),
        "assumptions": ASSUMPTIONS,
        "arches": [
            {"name": name, "none": arch}
            if isinstance(arch, str)
            else {
                "name": name,
                "cautions": arch.cautions,
                "picture": hazard_and_fragility(arch, risk.hazard, scale),
                "fractions": deaggregation(arch, scale),
                "levels": _level_table(arch, scale),
                "contributions": _contribution_table(arch, percent),
            }
            for name, arch in list(risk.arches.items())[:shown]
        ],
    }


def _rates_table(risk: StudyRisk, percent: str) -> Markup:
    others = [f"a year, {key}" for key in list(risk.hazard.curves)[1:]]
    rows: list[list[object]] = []
    for name, arch in risk.arches.items():
        name += f", {risk.classes[name]} arches" if name in risk.classes else ""
        if isinstance(arch, str):
            rows.append([name, "no curve", *["–"] * (6 + len(others))])
            continue
        rate, likely = arch.rate, arch.rate.probability_in(risk.years)
        outside = f"{100 * rate.outside:.1f} %"
        own = [
            f"{rate.quoted:.2g}", to((rate.lower, rate.upper), ".2g"), f"{rate.mean:.2g}",
            years(rate.return_period), f"{likely[0]:.2g}", to(likely[1:], ".2g"),
        ]  # fmt: skip
        if rate.is_bound:
            own = [f"at least {own[0]}", "–", "–", f"at most {own[3]}", f"at least {own[4]}", "–"]
        by_curve = [measured(each, ".2g") for each in list(arch.by_curve.values())[1:]]
        rows.append([name, *own, outside, *by_curve])
    heads = [
        "arch", "collapses a year", percent, "mean", "return period [years]",
        f"probability in {risk.years:g} years", percent, "beyond the hazard curve", *others,
    ]  # fmt: skip
    return table("Rates of collapse", heads, rows, "compact")


def _level_table(arch: ArchRisk, scale: Scale) -> Markup:
    total, counts = arch.rate.rate or 1.0, arch.by_mechanism.counts.sum(0)
    edges = ["0", *map(digits, (scale.factor * arch.edges).tolist())]
    names = [f"{low} to {high}" for low, high in pairwise(edges)] + [f"from {edges[-1]} on"]
    rows = [
        (name, f"{rate:.2g}", f"{rate / total:.3f}", count)
        for name, rate, count in zip(names, arch.level_rate, counts, strict=True)
    ]
    heads = [scale.label, "rate [1/year]", "fraction", "collapses"]
    return table(f"Rate of collapse of {arch.arch} by level", heads, rows, "compact")


def _contribution_table(arch: ArchRisk, percent: str) -> Markup:
    groups = {
        "mechanism": arch.by_mechanism, "magnitude": arch.by_magnitude,
        "distance": arch.by_distance,
    }  # fmt: skip
    rows = [
        (by, name, f"{parts.fraction[i]:.2f}",
         to((parts.lower[i], parts.upper[i])) if count >= 2 else "–", count)
        for by, parts in groups.items()
        for i, (name, count) in enumerate(zip(parts.categories, parts.counts.sum(axis=1)))
        if parts.shown[i]
    ]  # fmt: skip
    heads = ["by", "category", "fraction of the rate", percent, "collapses"]
    label = f"Contributions to the rate of collapse of {arch.arch}"
    return table(label, heads, rows, "compact", 2)


@figure
def hazard_and_fragility(
    sheet: Sheet, arch: ArchRisk, hazard: Hazard, scale: Scale
) -> tuple[str, str]:
    """Hazard curve, fragility curve and where the rate of collapse comes from, in three panels."""
    im = _shown(arch, hazard)
    density, shown = _density(arch, hazard, im), scale.factor * im
    rates = {key: curve.rate_at(im) for key, curve in hazard.curves.items()}
    points, ends = hazard.main.im * scale.factor, (float(shown[0]), float(shown[-1]))
    seen = (points >= ends[0]) & (points <= ends[1])
    every = np.concatenate(list(rates.values()))
    low, high = float(every[every > 0.0].min()), float(every.max())
    entries = [Entry(key, look.GREY if i else look.BLUE, "line") for i, key in enumerate(rates)]
    top = sheet.legend(_BESIDE, 0.0, entries) + 6.0
    panels: list[Panel] = []
    for height, y in zip(_HEIGHTS, ((low, high), (0.0, 1.0), (0.0, 1.05 * density.max()))):
        box = (_BESIDE, top, sheet.width - 10.0, top + height)
        panels.append(Panel(sheet, box, ends, y, True, log_y=not panels))
        top += height + 14.0
    first, second, third = panels
    for i, rate in reversed(list(enumerate(rates.values()))):
        first.line(shown, rate, entries[i].colour, 0.8 if i else 1.6)
    first.dots(points[seen], hazard.main.rate[seen], look.BLUE, radius=2.2)
    second.line(shown, arch.fit.probability(im), look.VERMILION)
    third.band(shown, np.zeros(im.size), density, look.SKY, 0.5)
    third.line(shown, density, look.BLUE)
    _rate_axis(first, log_ticks(low, high, (1.0,)), "exceeded [1/year]")
    second.axis_y([0.0, 0.5, 1.0], "P(collapse) [1]")
    _rate_axis(third, even_ticks(0.0, third.y[1], 4), "rate per ln im [1/year]")
    ticks = log_ticks(*ends)
    for panel in panels:
        for end in points[[0, -1]]:
            if ends[0] < end < ends[1]:
                panel.line([end, end], panel.y, look.GREY, 0.9, "2 2")
        last = panel is third
        panel.axis_x(ticks, scale.label * last, [] if last else [""] * ticks.size, True)
    sheet.height = third.box[3] + BELOW
    return (
        f"Hazard curve, fragility curve of {arch.arch} and their product; rate of "
        f"collapse {'at least ' * arch.rate.is_bound}{arch.rate.quoted:.2g} a year",
        "From above: how often a year an intensity is exceeded (points: as given); probability of "
        "collapse; and the rate of collapse by motions of an intensity, whose area is the rate of "
        "collapse. Dotted: ends of the hazard curve, beyond which its slope goes on.",
    )


@figure
def deaggregation(sheet: Sheet, arch: ArchRisk, scale: Scale) -> tuple[str, str] | None:
    """The rate by level and mechanism, and its fractions by magnitude and distance.

    None if no run collapsed.
    """
    found = arch.by_mechanism
    if not found.counts.any():
        return None
    others = [
        (title, group)
        for title, group in (("magnitude", arch.by_magnitude), ("distance", arch.by_distance))
        if any(n for c, n in zip(group.categories, group.shown) if c != NOT_KNOWN)
    ]
    parts = [
        (Entry(name, *((look.PALE, "area") if name == OTHER else LOOKS[i % len(LOOKS)])), rate)
        for i, (name, rate) in enumerate(zip(found.categories, found.rate))
        if rate.any()
    ]
    if found.unassigned.any():
        parts.append((Entry("no collapse seen", look.GREY), found.unassigned))
    highest = 1.05 * float(np.sum([rate for _, rate in parts], axis=0).max())
    top = sheet.legend(_BESIDE, 0.0, [entry for entry, _ in parts])
    boxes, sheet.height = sheet.panes(1 + len(others), top, 170.0, left=84.0)
    panel = Panel(sheet, boxes[0], (-0.5, arch.levels.size - 0.5), (0.0, highest))
    _rate_axis(panel, even_ticks(0.0, highest, 4), "rate of collapse [1/year]")
    panel.stack(parts)
    level_axis(panel, scale.factor * arch.levels, scale.label)
    panel.heading("by level and mechanism")
    for box, (title, group) in zip(boxes[1:], others):
        _bars(sheet, box, group, f"by {title}")
    return (
        f"Rate of collapse of {arch.arch} by level and mechanism, and its fractions "
        "by magnitude and distance of the records",
        "Rate of collapse by motions nearest to each level, divided as the collapses at that "
        "level were; grey: levels at which none was seen. Beside it, fractions of the rate by "
        "records of each magnitude and distance, with bands from resampled earthquakes. They hold "
        "for this set of records and are no deaggregation of the hazard.",
    )


def _shown(arch: ArchRisk, hazard: Hazard) -> FloatArray:
    """Intensities from which all but a small part of the rate comes, SI unit."""
    wide = np.concatenate([arch.levels, hazard.main.im, [arch.fit.theta]])
    im = np.geomspace(0.2 * wide.min(), 5.0 * wide.max(), 1200)
    density = _density(arch, hazard, im)
    used = im[density > _REACH * density.max()]
    low, high = min(used[0], arch.levels[0]), max(used[-1], arch.levels[-1])
    return np.geomspace(low, high, 200)


def _density(arch: ArchRisk, hazard: Hazard, im: FloatArray) -> FloatArray:
    """Rate of collapse per unit of ln im [1/year]; jumps where the slope of the hazard does."""
    curve = hazard.main
    slope = curve.pieces(np.log(im))[2]
    return arch.fit.probability(im) * slope * curve.rate_at(im)


def _rate_axis(panel: Panel, ticks: ArrayLike, title: str) -> None:
    panel.axis_y(ticks, title, [f"{tick:.2g}" for tick in np.atleast_1d(ticks)])


def _bars(sheet: Sheet, box: Box, found: Contributions, title: str) -> None:
    """Fractions of the rate by category, with their bands."""
    kept = np.flatnonzero(found.shown)
    place = np.arange(kept.size)
    panel = Panel(sheet, box, (0.0, 1.0), (-0.5, kept.size - 0.5))
    panel.axis_x([0.0, 0.25, 0.5, 0.75, 1.0], "fraction of the rate [1]", grid=True)
    panel.boxes(0.0, found.fraction[kept], place - 0.35, place + 0.35, look.SKY)
    for at, i in zip(place, kept):
        panel.line([found.lower[i], found.upper[i]], [at, at], look.INK, 1.0)
    panel.axis_y(place, "", [found.categories[i] for i in kept], grid=False)
    panel.heading(title)
