"""What the page shows of risk: rates in tables; hazard, fragility and their product in figures."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from archfrag.fragility.contributions import NOT_KNOWN, Contributions
from archfrag.report import picture as look
from archfrag.report.figures import LOOKS
from archfrag.report.picture import BELOW, FloatArray, Picture
from archfrag.report.plot import Box, Entry, Panel, Sheet, picture
from archfrag.report.summary import Scale
from archfrag.study.hazard import Hazard
from archfrag.study.members import SHOWN
from archfrag.study.risk import OTHER, ArchRisk, StudyRisk
from archfrag.study.risk_output import ASSUMPTIONS

_REACH = 1e-4  # of the greatest density of the rate, where the axis ends
_BESIDE, _HEIGHTS = 66.0, (150.0, 110.0, 110.0)  # left of the panels and their heights [px]


def risk_section(risk: StudyRisk, scale: Scale) -> dict[str, Any]:
    """Rates of collapse, their tables and figures, by the names of the page's template.

    Of many arches only the first have figures: each takes 0.3 MB.
    """
    shown = SHOWN if len(risk.arches) <= SHOWN else 3
    return {
        "study": risk,
        "others": [f"a year, {key}" for key in list(risk.hazard.curves)[1:]],
        "assumptions": ASSUMPTIONS,
        "arches": [
            {"name": name, "risk": arch}
            if isinstance(arch, str)
            else {
                "name": name, "risk": arch,
                "picture": hazard_and_fragility(arch, risk.hazard, scale),
                "fractions": deaggregation(arch, scale),
            }
            for name, arch in list(risk.arches.items())[:shown]
        ],
    }  # fmt: skip


def hazard_and_fragility(arch: ArchRisk, hazard: Hazard, scale: Scale) -> Picture:
    """Hazard curve, fragility curve and where the rate of collapse comes from, in three panels."""
    im = _shown(arch, hazard)
    density, shown = _density(arch, hazard, im), scale.factor * im
    rates = {key: curve.rate_at(im) for key, curve in hazard.curves.items()}
    points, ends = hazard.main.im * scale.factor, (float(shown[0]), float(shown[-1]))
    seen = (points >= ends[0]) & (points <= ends[1])
    every = np.concatenate(list(rates.values()))
    low, high = float(every[every > 0.0].min()), float(every.max())
    entries = [Entry(key, look.GREY if i else look.BLUE, "line") for i, key in enumerate(rates)]

    def draw(sheet: Sheet) -> None:
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
        _rates(first, look.log_ticks(low, high, (1.0,)), "exceeded [1/year]")
        second.axis_y([0.0, 0.5, 1.0], "P(collapse) [1]")
        _rates(third, look.even_ticks(0.0, third.y[1], 4), "rate per ln im [1/year]")
        ticks = look.log_ticks(*ends)
        for panel in panels:
            for end in points[[0, -1]]:
                if ends[0] < end < ends[1]:
                    panel.line([end, end], panel.y, look.GREY, 0.9, "2 2")
            last = panel is third
            panel.axis_x(ticks, scale.label * last, None if last else [""] * ticks.size, True)
        sheet.height = third.box[3] + BELOW

    return picture(
        draw,
        alternative=f"Hazard curve, fragility curve of {arch.arch} and their product; rate of "
        f"collapse {'at least ' * arch.rate.is_bound}{arch.rate.quoted:.2g} a year",
    )


def deaggregation(arch: ArchRisk, scale: Scale) -> Picture | None:
    """The rate by level and mechanism, and its fractions by magnitude and distance.

    None if no run collapsed.
    """
    if not arch.by_mechanism.counts.any():
        return None
    beside = [
        (title, found)
        for title, found in (("magnitude", arch.by_magnitude), ("distance", arch.by_distance))
        if any(n for c, n in zip(found.categories, found.shown) if c != NOT_KNOWN)
    ]
    found = arch.by_mechanism
    parts = [
        (Entry(name, *((look.PALE, "area") if name == OTHER else LOOKS[i % len(LOOKS)])), rate)
        for i, (name, rate) in enumerate(zip(found.categories, found.rate))
        if rate.any()
    ]
    if found.unassigned.any():
        parts.append((Entry("no collapse seen", look.GREY), found.unassigned))
    highest = 1.05 * float(np.sum([rate for _, rate in parts], axis=0).max())

    def draw(sheet: Sheet) -> None:
        entries = [entry for entry, _ in parts]
        top = sheet.legend(_BESIDE, 0.0, entries)
        boxes, sheet.height = sheet.panes(1 + len(beside), top, 170.0, left=84.0)
        panel = Panel(sheet, boxes[0], (-0.5, arch.levels.size - 0.5), (0.0, highest))
        _rates(panel, look.even_ticks(0.0, highest, 4), "rate of collapse [1/year]")
        panel.stack(parts)
        panel.level_axis(scale.factor * arch.levels, scale.label)
        panel.heading("by level and mechanism")
        for box, (title, part) in zip(boxes[1:], beside):
            _bars(sheet, box, part, f"by {title}")

    return picture(
        draw,
        alternative=f"Rate of collapse of {arch.arch} by level and mechanism, and its fractions "
        "by magnitude and distance of the records",
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
    slope = curve.slopes[np.searchsorted(curve.im, im, side="right")]
    return arch.fit.probability(im) * slope * curve.rate_at(im)


def _rates(panel: Panel, ticks: ArrayLike, title: str) -> None:
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
