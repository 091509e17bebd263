"""Curve, verdicts, collapses and numerical quality of one arch."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from archfrag.fragility.bands import (
    RecordBand,
    clopper_pearson,
    confidence_band,
    record_bootstrap_band,
)
from archfrag.fragility.counts import Verdict
from archfrag.fragility.fit import Fragility
from archfrag.fragility.runs import Resampling
from archfrag.mechanics.status import CollapseMode
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, legend_above, picture
from archfrag.report.summary import ArchResults, FloatArray, digits

VERDICT_LOOK = {
    Verdict.STANDING: ("standing", "#cfe0ee", ""),
    Verdict.COLLAPSED: ("collapsed", canvas.VERMILION, ""),
    Verdict.UNFINISHED: ("unfinished", "#f2d24b", "////"),
    Verdict.SOLVER_FAILURE: ("solver failure", canvas.INK, ""),
}
MODE_LOOK = {
    CollapseMode.HINGING: ("hinging", canvas.BLUE, ""),
    CollapseMode.SLIDING: ("sliding", canvas.ORANGE, "////"),
    CollapseMode.LIFT_OFF: ("lift-off", canvas.GREEN, "...."),
    CollapseMode.OVERTURNING: ("overturning", canvas.PURPLE, "xxxx"),
    CollapseMode.NONE: ("mode not told", canvas.GREY, ""),
}
# Logarithmic histograms need a floor for exact zeros.
_FLOOR = 1e-18
_RESAMPLES = 1000
_SEED = 1


def curve(
    results: ArchResults,
    fit: Fragility | None,
    name: str,
    confidence: float,
    resampled: "Resampled | None" = None,
) -> Picture:
    """Fragility curve with its band, and the observed fractions with exact intervals.

    Parameters
    ----------
    results : ArchResults
    fit : Fragility or None
        Theta in SI, as fitted to the cube; None: no curve, the data points only.
    name : str
        Unique on the page.
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

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        if fit is not None:
            im = np.linspace(0.0, reach, 400)
            band = confidence_band(fit, im / scale.factor, confidence)
            axes.fill_between(
                im, band.lower, band.upper, color=canvas.SKY, alpha=0.3, linewidth=0,
                label=f"{percent} band, runs independent",
            )  # fmt: skip
            axes.plot(
                im, fit.probability(im / scale.factor), color=canvas.BLUE, label="lognormal curve"
            )
            if resampled is not None:
                style: dict[str, Any] = {"color": canvas.BLUE, "lw": 0.9, "ls": (0, (5, 2))}
                axes.plot(resampled.levels, resampled.band.lower, **style)
                axes.plot(
                    resampled.levels, resampled.band.upper, **style,
                    label=f"{percent} band, records resampled",
                )  # fmt: skip
            median = fit.theta * scale.factor
            if median <= reach:
                axes.plot(
                    [0.0, median, median],
                    [0.5, 0.5, 0.0],
                    color=canvas.GREY,
                    lw=0.8,
                    ls=(0, (4, 3)),
                )
        bars = np.maximum([fraction - low, high - fraction], 0.0)
        axes.errorbar(
            levels, fraction, yerr=bars, fmt="o", color=canvas.INK, markersize=3.8,
            elinewidth=0.8, capsize=2.0, capthick=0.8,
            label=f"share of collapses, exact {percent} interval",
        )  # fmt: skip
        axes.set(
            xlim=(0.0, reach), ylim=(-0.02, 1.02), xlabel=scale.label,
            ylabel="probability of collapse [1]",
        )  # fmt: skip
        faint_grid(axes)
        legend_above(axes, columns=2)

    what = "no lognormal curve could be fitted"
    if fit is not None:
        what = f"lognormal curve with median {scale.text(fit.theta)} and dispersion {fit.beta:.3f}"
    return picture(
        name, (canvas.WIDTH, 3.7), draw,
        alternative=f"Probability of collapse of {results.arch} against {scale.label}: {what}; "
        f"observed fractions at {levels.size} levels",
        caption="Points: collapsed / (collapsed + standing) at each level; bars: Clopper–Pearson. "
        "Shaded: pointwise band from the covariance of the maximum-likelihood estimate (delta "
        "method on the probit scale), every run taken as independent."
        + (f" Dashed: {resampled.description}" if fit is not None and resampled else ""),
    )  # fmt: skip


@dataclass(frozen=True)
class Resampled:
    """Band from resampled records at `levels` in the reader's unit, and how it was made."""

    levels: FloatArray
    band: RecordBand
    description: str


def resample(results: ArchResults, confidence: float) -> Resampled:
    """Band of the curve where the same records serve at all levels."""
    levels = np.linspace(0.0, 1.05 * results.levels.max(), 200)
    band = record_bootstrap_band(
        results.verdict, results.levels, levels, Resampling(_SEED, _RESAMPLES, confidence),
    )  # fmt: skip
    lost = f", {band.n_degenerate} of them without a lognormal curve" if band.n_degenerate else ""
    return Resampled(
        levels,
        band,
        f"the same from {_RESAMPLES} resamples of whole records (seed {_SEED}{lost}), which keeps "
        "the verdicts of a record at all levels together.",
    )


def verdict_map(results: ArchResults, name: str) -> Picture:
    """Verdict of every run: records down, levels across."""
    weight = (results.verdict == Verdict.COLLAPSED).sum(axis=1)
    order = np.lexsort((np.arange(weight.size), weight))
    rows = results.verdict[order]
    n_record, n_level = rows.shape
    labelled = n_record <= 60

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        colours = ListedColormap([look[1] for look in VERDICT_LOOK.values()])
        edges = np.arange(n_level + 1) - 0.5
        axes.pcolormesh(
            edges, np.arange(n_record + 1) - 0.5, rows, cmap=colours, vmin=-0.5, vmax=3.5,
            edgecolors="white" if labelled else "face", linewidth=0.6 if labelled else 0.3,
        )  # fmt: skip
        for row, level in np.argwhere(rows == Verdict.UNFINISHED):
            axes.add_patch(
                Rectangle(
                    (level - 0.5, row - 0.5), 1.0, 1.0, fill=False, hatch="////", linewidth=0.0,
                    edgecolor=canvas.GREY,
                )
            )  # fmt: skip
        axes.invert_yaxis()
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0)
        level_ticks(axes, results.levels, most=15)
        axes.set_xlabel(results.scale.label)
        if labelled:
            axes.set_yticks(np.arange(n_record), [results.records[i] for i in order], fontsize=7)
        else:
            axes.set_ylabel(f"{n_record} records, most fragile at the bottom")
            axes.set_yticks([])
        present = [v for v in VERDICT_LOOK if np.any(rows == v)]
        axes.legend(
            handles=[_swatch(*VERDICT_LOOK[v]) for v in present], loc="lower left",
            bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2,
        )  # fmt: skip

    again = results.resurrections
    return picture(
        name, (canvas.WIDTH, 0.9 + min(0.17 * n_record, 7.5)), draw,
        alternative=f"Verdicts of {results.arch} for {n_record} records at {n_level} levels",
        caption="Every run, records ordered by the number of collapses. "
        + (
            f"{again} of {n_record} records bring the arch down at a level and leave it standing "
            "at a higher one."
            if again
            else "No record leaves the arch standing above a level at which it collapsed."
        ),
    )  # fmt: skip


def collapses(results: ArchResults, n_joint: int, name: str) -> Picture | None:
    """Where and how the arch collapsed, and at which levels; None if it never did."""
    table = results.collapses_by_joint(n_joint)
    if not table.any():
        return None
    by_mode = table.sum(axis=2)
    by_level = table.sum(axis=1)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.25])
        base = np.zeros(n_joint)
        for mode, look in MODE_LOOK.items():
            if by_mode[:, mode].any():
                left.barh(
                    np.arange(n_joint), by_mode[:, mode], left=base, height=0.75, color=look[1],
                    hatch=look[2], edgecolor="white", linewidth=0.4, label=look[0],
                )  # fmt: skip
                base += by_mode[:, mode]
        left.set(xlabel="collapses [runs]", ylabel="joint that lost contact")
        left.set_ylim(-0.6, n_joint - 0.4)
        left.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        joints = np.arange(0, n_joint, max(1, -(-n_joint // 15)))
        left.set_yticks(joints)
        faint_grid(left, "x")
        legend_above(left, columns=2)
        shades = LinearSegmentedColormap.from_list("counts", ["#ffffff", "#f3b48a", "#a83a00"])
        right.pcolormesh(
            np.arange(results.levels.size + 1) - 0.5, np.arange(n_joint + 1) - 0.5, by_level,
            cmap=shades, vmin=0, edgecolors=canvas.PALE, linewidth=0.4,
        )  # fmt: skip
        if n_joint <= 30 and results.levels.size <= 16:
            for joint, level in np.argwhere(by_level):
                dark = by_level[joint, level] > 0.6 * by_level.max()
                right.text(
                    level, joint, str(by_level[joint, level]), ha="center", va="center",
                    fontsize=6.5, color="white" if dark else canvas.INK,
                )  # fmt: skip
        level_ticks(right, results.levels)
        right.set(xlabel=results.scale.label, ylabel="joint that lost contact")
        right.set_yticks(joints)
        right.tick_params(length=0)
        right.set_title("collapses [runs] by joint and level")

    worst = int(by_level.sum(axis=1).argmax())
    return picture(
        name, (canvas.WIDTH, max(2.7, min(0.9 + 0.2 * n_joint, 6.0))), draw,
        alternative=f"Collapses of {results.arch} by joint, mode and level; joint {worst} most "
        "often",
        caption="Joint 0 is the left springing, or the base of a free-standing chain. A run is "
        "counted at the joint whose loss of contact decided, by how that joint had been moving.",
    )  # fmt: skip


def numerics(results: ArchResults, name: str) -> Picture:
    """Energy error and contact residual of all runs."""

    def draw(figure: Figure) -> None:
        first, second = figure.subplots(1, 2)
        _log_histogram(first, results.energy_error, "energy error [1]", canvas.BLUE)
        _log_histogram(second, results.residual, "contact residual [1]", canvas.GREEN)

    return picture(
        name, (canvas.WIDTH, 2.6), draw,
        alternative=f"Histograms of energy error and contact residual of {results.arch}",
        caption="Energy error: what is missing in the energy account, relative to the largest "
        "kinetic energy of the run. Contact residual: largest violation of Signorini's and "
        f"Coulomb's laws, dimensionless. Values below {_FLOOR:g} are shown at {_FLOOR:g}; "
        "solver failures are included.",
    )  # fmt: skip


def _swatch(label: str, colour: str, hatch: str) -> Patch:
    return Patch(facecolor=colour, hatch=hatch, edgecolor=canvas.GREY, linewidth=0.4, label=label)


def level_ticks(axes: Axes, levels: FloatArray, most: int = 8) -> None:
    """At most so many labels over cells that stand for levels, the first always among them."""
    step = max(1, int(np.ceil(levels.size / most)))
    ticks = np.arange(0, levels.size, step)
    axes.set_xticks(ticks, [digits(levels[i]) for i in ticks])


def _log_histogram(axes: Axes, values: FloatArray, label: str, colour: str) -> None:
    values = np.abs(values[np.isfinite(values)])
    axes.set(xlabel=label, ylabel="runs", xscale="log")
    if values.size == 0:
        axes.text(0.5, 0.5, "not told", transform=axes.transAxes, ha="center", color=canvas.GREY)
        return
    logs = np.log10(np.maximum(values, _FLOOR))
    low, high = np.floor(logs.min()), np.ceil(logs.max() + 1e-9)
    edges = 10.0 ** np.linspace(low, max(high, low + 1.0), 25)
    axes.hist(10.0**logs, bins=edges.tolist(), color=colour)
    axes.xaxis.set_major_locator(LogLocator(numticks=5))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(lambda value, _: f"1e{np.log10(value):.0f}")
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    faint_grid(axes, "y")
