"""Fragility curves: of one arch with its data, of all arches together, and of limit states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from archfrag.fragility.bands import (
    RecordBand,
    clopper_pearson,
    confidence_band,
    record_bootstrap_band,
)
from archfrag.fragility.fit import Fragility
from archfrag.report import picture as look
from archfrag.report.axes import BELOW, BESIDE, axis_x, axis_y, even_ticks
from archfrag.report.picture import Picture
from archfrag.report.plot import Entry, FloatArray, Panel, Sheet, picture
from archfrag.report.summary import ArchResults, Scale

_RESAMPLES = 1000
_SEED = 1
_DASH = "5 2.5"
COLOURS = (
    look.BLUE, look.VERMILION, look.GREEN, look.ORANGE, look.PURPLE, look.SKY,
)  # fmt: skip
MOST_NAMED = 12  # curves with a colour and stroke of their own
PROBABILITY = "probability of collapse"


@dataclass(frozen=True)
class Resampled:
    """Band from resampled records at `levels` in the reader's unit, and how it was made."""

    levels: FloatArray
    band: RecordBand
    description: str

    def at(self, level: float) -> tuple[float, float]:
        """Ends of the band at a level that is one of `levels`, or between two."""
        low, high = (
            np.interp(level, self.levels, end) for end in (self.band.lower, self.band.upper)
        )
        return float(low), float(high)


def resample(results: ArchResults, confidence: float, at: float | None = None) -> Resampled | None:
    """Band of the curve where the same records serve at all levels; None for a single record.

    Parameters
    ----------
    results : ArchResults
    confidence : float
    at : float, optional
        A level at which the band is wanted exactly, in the reader's unit.
    """
    if len(results.records) < 2 or results.grouped:
        return None
    levels = np.linspace(0.0, 1.05 * results.levels.max(), 100)
    if at is not None:
        levels = np.unique(np.append(levels, at))
    band = record_bootstrap_band(
        results.decided_or_neither, results.levels, levels, seed=_SEED, resamples=_RESAMPLES,
        confidence=confidence,
    )  # fmt: skip
    lost = f", {band.n_degenerate} of them without a lognormal curve" if band.n_degenerate else ""
    return Resampled(
        levels,
        band,
        f"the same from {_RESAMPLES} resamples of whole records (seed {_SEED}{lost}), which keeps "
        "the verdicts of a record at all levels together.",
    )


def curve_axes(sheet: Sheet, top: float, reach: float, title: str, words: str) -> Panel:
    """A panel of probabilities over levels from 0 to reach, and the height of its sheet."""
    bottom = top + (250.0 if sheet.narrow else 300.0)
    panel = Panel(sheet, (BESIDE, top, sheet.width - 10.0, bottom), (0.0, reach), (0.0, 1.0))
    axis_y(panel, np.linspace(0.0, 1.0, 6), words, [f"{p:.1f}" for p in np.linspace(0, 1, 6)])
    axis_x(panel, even_ticks(0.0, reach, 6 if sheet.narrow else 9), title, grid=True)
    sheet.height = bottom + BELOW
    return panel


def curve(
    results: ArchResults, fit: Fragility | None, confidence: float, resampled: Resampled | None
) -> Picture:
    """Fragility curve with its band, and the observed fractions with exact intervals.

    Parameters
    ----------
    results : ArchResults
    fit : Fragility or None
        Theta in SI, as fitted to the cube; None: no curve, the data points only.
    confidence : float
        Of band and intervals.
    resampled : Resampled, optional
        Band from resampled records.
    """
    scale, counts = results.scale, results.counts
    percent = f"{100 * confidence:.0f} %"
    used = counts.n > 0
    levels = results.levels[used]
    fraction = counts.collapsed[used] / counts.n[used]
    low, high = clopper_pearson(counts.collapsed[used], counts.n[used], confidence)
    reach = 1.05 * results.levels.max()
    entries = [Entry(f"share of collapses, exact {percent} interval", look.INK, "dot")]
    if fit is not None:
        entries += [
            Entry("lognormal curve", look.BLUE, "line"),
            Entry(f"{percent} band, runs independent", "#c9e3f5"),
        ]
        if resampled is not None:
            entries.append(Entry(f"{percent} band, records resampled", look.BLUE, "dash"))

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        panel = curve_axes(sheet, top, reach, scale.label, PROBABILITY)
        if fit is not None:
            im = np.linspace(0.0, reach, 100)
            band = confidence_band(fit, im / scale.factor, confidence)
            panel.band(im, band.lower, band.upper, look.SKY)
            if resampled is not None:
                for end in (resampled.band.lower, resampled.band.upper):
                    panel.line(resampled.levels, end, look.BLUE, 0.9, _DASH)
            panel.line(im, fit.probability(im / scale.factor), look.BLUE)
            median = fit.theta * scale.factor
            if median <= reach:
                panel.line([0.0, median, median], [0.5, 0.5, 0.0], look.GREY, 0.8, "4 3")
        panel.errors(levels, low, high)
        panel.dots(levels, fraction, look.INK)
        return sheet

    what = "no lognormal curve could be fitted"
    if fit is not None:
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
    grouped = (
        "Every run has an intensity of its own; each point stands for a group of neighbours. "
        if results.grouped
        else ""
    )
    return picture(
        draw,
        alternative=f"Probability of collapse of {results.arch} against {scale.label}: {what}; "
        f"observed fractions at {levels.size} levels",
        caption="Points: collapsed / (collapsed + standing) at each level; bars: Clopper–Pearson. "
        + grouped
        + "Shaded: pointwise band from the covariance of the maximum-likelihood estimate (delta "
        "method on the probit scale), every run taken as independent."
        + (f" Dashed: {resampled.description}" if fit is not None and resampled else ""),
    )  # fmt: skip


def all_curves(
    fits: Mapping[str, Fragility],
    bands: Mapping[str, Resampled | None],
    classes: Mapping[str, str],
    scale: Scale,
    highest: float,
    at: float | None = None,
) -> Picture | None:
    """Curves of all arches in one figure; None if there are fewer than two.

    Parameters
    ----------
    fits : mapping of arch to Fragility
        Theta in SI.
    bands : mapping of arch to Resampled or None
        Drawn lightly where the curves are few.
    classes : mapping of arch to its class
        Of many arches the median and the 16 and 84 % quantiles are drawn by class.
    scale : Scale
    highest : float
        Level to which the curves are drawn, in the reader's unit.
    at : float, optional
        Level that is marked, in the reader's unit.
    """
    if len(fits) < 2:
        return None
    im = np.linspace(0.0, 1.05 * highest, 100)
    curves = {name: fit.probability(im / scale.factor) for name, fit in fits.items()}
    many = len(fits) > MOST_NAMED
    groups: dict[str, list[FloatArray]] = {}
    for name, row in curves.items():
        groups.setdefault(classes.get(name, name) if many else name, []).append(row)
    if many and len(groups) > MOST_NAMED:
        groups = {f"all {len(fits)} arches": list(curves.values())}
    entries = []
    for i, name in enumerate(groups):
        count = f", median of {len(groups[name])}" if many else ""
        entries.append(Entry(f"{name}{count}", *_stroke(i)[:2]))
    if many:
        entries += [Entry("each arch", "#b5bec8", "line"), Entry("16 to 84 %", "#c3cbd3")]

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        panel = curve_axes(sheet, top, float(im[-1]), scale.label, PROBABILITY)
        if at is not None and 0.0 < at < im[-1]:
            panel.line([at, at], [0.0, 1.0], look.GREY, 0.9, "2 2")
        if many:
            faint = float(np.clip(25.0 / len(curves), 0.15, 0.5))
            for i, rows in enumerate(groups.values()):
                for row in rows:  # every third of 100 points, the last among them
                    panel.line(im[::3], row[::3], _stroke(i)[0], 0.5, opacity=faint)
        for i, (name, rows) in enumerate(groups.items()):
            colour, _, dash = _stroke(i)
            band = bands.get(name)
            if many and len(groups) <= 4:
                low, high = np.quantile(rows, [0.16, 0.84], axis=0)
                panel.band(im, low, high, colour, 0.2)
            elif not many and len(groups) <= 6 and band is not None:
                panel.band(band.levels, band.band.lower, band.band.upper, colour, 0.13)
            panel.line(im, np.median(rows, axis=0), colour, 2.2 if many else 1.8, dash)
        return sheet

    shown = "; ".join(f"{name} {scale.text(fit.theta)}" for name, fit in list(fits.items())[:40])
    return picture(
        draw,
        alternative=f"Fragility curves of {len(fits)} arches against {scale.label}. "
        f"Medians: {shown}",
        caption=(
            "Thin: the lognormal curve of each arch; bold: median of the curves of a class at "
            "each level, shaded 16 to 84\u00a0% of them."
            if many
            else "Lognormal curves of all arches"
            + (
                ", shaded their bands from resampled records." if len(groups) <= 6 else "."
            )
        )
        + (f" Dotted: {scale.text(at / scale.factor)}." if at is not None else ""),
    )  # fmt: skip


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
