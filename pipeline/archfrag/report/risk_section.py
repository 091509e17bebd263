"""Figures and tables of risk: rates of collapse; hazard, fragility and their product."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from scipy.special import ndtr

from archfrag.report.html import (
    TEXTS,
    cautions,
    heading,
    interval,
    paragraph,
    rounded,
    table,
)
from archfrag.report.inputs import ReportInputs, Scale
from archfrag.report.run_figures import level_axis, stacked
from archfrag.report.sections import PageSection
from archfrag.report.svg import (
    BELOW,
    BLUE,
    GREY,
    PALE,
    SKY,
    VERMILION,
    Entry,
    FloatArray,
    Panel,
    Sheet,
    figure,
    log_ticks,
    panel_below,
)
from archfrag.study.answer.rates import ASSUMPTIONS, ArchRisk, StudyRisk
from archfrag.study.file.members import SHOWN
from archfrag.study.hazard import Hazard

_REACH = 1e-4  # of the greatest density of the rate, where the axis ends
_LEFT = 66.0  # left of the panels and their heights [px]
_HEIGHTS = (150.0, 110.0, 110.0)


def risk_section(inputs: ReportInputs) -> Iterator[PageSection]:
    """Yield the section on rates of collapse, if the study has a hazard curve."""
    if inputs.risk is not None:
        yield PageSection("risk", "Risk", list(_parts(inputs, inputs.risk)))


def _parts(inputs: ReportInputs, risk: StudyRisk | str) -> Iterator[Any]:
    """Yield the rates of collapse, and figures of each arch; of many arches only of the first."""
    if isinstance(risk, str):
        yield paragraph(f"There are no rates of collapse: {risk}.", "none")
        return
    hazard = risk.hazard
    first = next(iter(hazard.curves))
    words = f"Rates with the hazard curve {first} of {Path(hazard.source).name}"
    yield paragraph(". ".join([words, *hazard.messages, ""]), "note")
    yield _rates_table(risk, inputs.percent)
    rates = [arch.rate for arch in risk.arches.values() if not isinstance(arch, str)]
    if any(rate.mean > rate.quoted for rate in rates):
        yield paragraph(TEXTS["notes"]["mean_rate"], "note")
    shown = SHOWN if len(risk.arches) <= SHOWN else 3
    for name, arch in list(risk.arches.items())[:shown]:
        if len(risk.arches) > 1:
            yield heading(name)
        if isinstance(arch, str):
            yield paragraph(f"No rate: {arch}.", "none")
            continue
        yield cautions(arch.cautions)
        yield hazard_and_fragility(arch, hazard, inputs.scale)
        yield contributions(arch, inputs.scale)
    assumed = (f"{words[0].upper()}{words[1:]}." for words in ASSUMPTIONS)
    yield paragraph(" ".join(assumed), "note")


def _rates_table(risk: StudyRisk, percent: str) -> Markup:
    """Tabulate the rate of collapse of each arch with what it means over some years."""
    heads = [
        "arch",
        "collapses a year",
        percent,
        "mean rate",
        "return period [years]",
        f"probability in {risk.years:g} years",
        percent,
        "beyond the hazard curve",
        "left out below the onset",
        *(f"a year, {key}" for key in list(risk.hazard.curves)[1:]),
    ]
    rows = []
    for name, arch in risk.arches.items():
        name += f", {risk.classes[name]} arches" if name in risk.classes else ""
        if isinstance(arch, str):
            rows.append([name, "no curve", *["–"] * (len(heads) - 2)])
            continue
        rate = arch.rate
        likely, *ends = rate.probability_in(risk.years)
        least, most = ("at least ", "at most ") if rate.is_bound else ("", "")
        rows.append(
            [
                name,
                least + rounded(rate.quoted),
                interval((rate.lower, rate.upper), rounded),
                rounded(rate.mean),
                most + rounded(rate.return_period),
                least + rounded(likely),
                interval(ends, rounded),
                f"{100 * (rate.below + rate.above):.1f} %",
                rounded(rate.below_onset) if np.any(arch.onset) else "–",
                *(rounded(rate) for rate in list(arch.by_curve.values())[1:]),
            ]
        )
    return table("Rates of collapse", heads, rows, "compact")


@figure
def hazard_and_fragility(
    sheet: Sheet, arch: ArchRisk, hazard: Hazard, scale: Scale
) -> str:
    """Draw the hazard curve, the fragility curve and where the rate of collapse comes from."""
    # Intensities from which all but a small part of the rate comes.
    wide = np.concatenate([arch.levels, hazard.main.im, [arch.fit.theta]])
    im = np.geomspace(0.2 * wide.min(), 5.0 * wide.max(), 1200)
    density = _density(arch, hazard, im)
    used = im[density > _REACH * density.max()]
    im = np.geomspace(min(used[0], arch.levels[0]), max(used[-1], arch.levels[-1]), 200)
    density = _density(arch, hazard, im)
    shown = scale.factor * im
    rates = {key: curve.rate_at(im) for key, curve in hazard.curves.items()}
    points = hazard.main.im * scale.factor
    ends = (float(shown[0]), float(shown[-1]))
    seen = (points >= ends[0]) & (points <= ends[1])
    every = np.concatenate(list(rates.values()))
    low = float(every[every > 0.0].min())
    high = float(every.max())
    entries = [Entry(f"hazard: {key}", GREY, "line") for key in rates]
    entries[0] = entries[0]._replace(colour=VERMILION)
    top = sheet.legend(_LEFT, 0.0, entries) - 8.0
    panels: list[Panel] = []
    reaches = (low, high), (0.0, 1.0), (0.0, 1.05 * density.max())
    for height, y in zip(_HEIGHTS, reaches):
        top += 14.0
        box = (_LEFT, top, sheet.width - 10.0, top + height)
        panels.append(Panel(sheet, box, ends, y, True, log_y=not panels))
        top += height
    first, second, third = panels
    for i, rate in reversed(list(enumerate(rates.values()))):
        first.line(shown, rate, entries[i].colour, 0.8 if i else 1.6)
    first.dots(points[seen], hazard.main.rate[seen], VERMILION, radius=2.2)
    second.line(shown, arch.fit.probability(im), BLUE)
    third.band(shown, np.zeros(im.size), density, SKY, 0.5)
    third.line(shown, density, BLUE)
    first.axis_y("exceeded [1/year]", ticks=log_ticks(low, high, (1.0,)))
    second.axis_y("P(collapse) [1]", 2)
    third.axis_y(f"rate per ln {scale.measure} [1/year]", 4)
    blank = [""] * log_ticks(*ends).size
    for panel in panels:
        for end in points[[0, -1]]:
            if ends[0] < end < ends[1]:
                panel.upright(end)
        last = panel is third
        panel.axis_x(scale.label * last, labels=[] if last else blank, grid=True)
    sheet.height = third.box[3] + BELOW
    words = f"{'at least ' * arch.rate.is_bound}{rounded(arch.rate.quoted)} a year"
    return f"Hazard and fragility curve of {arch.arch} and their product; rate of collapse {words}"


@figure
def contributions(sheet: Sheet, arch: ArchRisk, scale: Scale) -> tuple[str, str] | None:
    """Draw the rate by level and mechanism; None if no run collapsed or no mechanism is known."""
    split = arch.by_mechanism
    if not split.counts.any() or "not known" in split.categories:
        return None
    labels = [
        f"{name} {100 * f:.0f} %" for name, f in zip(split.categories, split.fraction)
    ]
    parts = stacked(labels, split.rate)
    if split.unassigned.any():
        parts.append((Entry("no collapse seen", PALE), split.unassigned))
    highest = 1.05 * float(np.sum([rate for _, rate in parts], axis=0).max())
    ends = (-0.5, arch.levels.size - 0.5), (0.0, highest)
    panel = panel_below(sheet, [entry for entry, _ in parts], 170.0, *ends, left=_LEFT)
    panel.axis_y("rate of collapse [1/year]", 4)
    panel.stack(parts)
    level_axis(panel, scale.factor * arch.levels, scale.label)
    texts = TEXTS["contributions"]
    caption = texts["caption"] + texts["pale"] * bool(split.unassigned.any())
    return f"Rate of collapse of {arch.arch} by level and mechanism", caption


def _density(arch: ArchRisk, hazard: Hazard, im: FloatArray) -> FloatArray:
    """Return the rate of collapse per unit of ln im [1/year].

    It jumps where the slope of the hazard curve does.
    """
    curve = hazard.main
    slope = curve.pieces(np.log(im))[2]
    theta, beta = arch.fit.parts.T
    z = np.log(im[:, None] / theta) / beta
    chance = np.where(im[:, None] < arch.onset, 0.0, ndtr(z)).mean(axis=1)
    return chance * slope * curve.rate_at(im)
