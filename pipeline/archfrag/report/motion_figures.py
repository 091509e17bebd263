"""The ground motions: how they look, and their response spectra."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, legend_above, picture

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

FloatArray = NDArray[np.float64]
Spectrum = tuple[FloatArray, FloatArray]

PERIODS = np.geomspace(0.02, 5.0, 80)
_COLUMNS = 4
_BINS = 220


def thumbnails(motions: Sequence["Motion"], name: str) -> Picture:
    """All accelerograms, each divided by its own peak, on one time scale for each row of four."""
    rows = -(-len(motions) // _COLUMNS)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(rows, _COLUMNS, squeeze=False)
        figure.set_layout_engine("constrained", hspace=0.08, wspace=0.05)
        for axes in grid.flat[len(motions) :]:
            axes.set_axis_off()
        for axes, motion in zip(grid.flat, motions, strict=False):
            time, low, high = envelope(motion)
            axes.fill_between(time, low, high, color=canvas.BLUE, linewidth=0.4)
            axes.set(ylim=(-1.05, 1.05), xlim=(0.0, motion.duration), yticks=[])
            axes.set_title(_short(motion.id), fontsize=7, fontweight="normal", pad=2.0)
            axes.set_xticks([0.0, motion.duration], ["0", f"{motion.duration:.0f} s"])
            axes.tick_params(labelsize=6.5, length=2.0, pad=1.5)
            axes.spines["left"].set_visible(False)
            left, right = axes.get_xticklabels()
            left.set_ha("left")
            right.set_ha("right")

    return picture(
        name, (canvas.WIDTH, 0.3 + 0.78 * rows), draw,
        alternative=f"Accelerograms of {len(motions)} ground motions, each scaled to its peak",
        caption="Horizontal acceleration of each record divided by its own PGA, whole duration.",
    )  # fmt: skip


def spectra(
    responses: Mapping[str, Spectrum], factors: Mapping[str, float], level: str, name: str
) -> Picture:
    """Spectra at 5 % damping, all scaled to one intensity: each, their median and 16-84 %.

    Parameters
    ----------
    responses : mapping of record to (periods [s], Sa [m/s2])
        Unscaled, all at the same periods.
    factors : mapping of record to float
        Scale factor that brings the record to the intensity shown.
    level : str
        That intensity, with its measure and unit.
    name : str
        Unique on the page.
    """
    periods = np.asarray(next(iter(responses.values()))[0], dtype=float)
    scaled = np.stack([responses[r][1] * factors[r] for r in responses]) / STANDARD_GRAVITY
    low, median, high = np.quantile(scaled, [0.16, 0.5, 0.84], axis=0)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for i, row in enumerate(scaled):
            axes.plot(
                periods, row, color=canvas.GREY, lw=0.5, alpha=0.6, label=None if i else "records"
            )
        axes.fill_between(
            periods, low, high, color=canvas.SKY, alpha=0.3, linewidth=0, label="16 to 84 %"
        )
        axes.plot(periods, median, color=canvas.BLUE, lw=2.0, label="median")
        axes.set(
            xscale="log", yscale="log", xlabel="period [s]", ylabel="Sa, 5 % damping [g]",
            xlim=(periods[0], periods[-1]),
        )  # fmt: skip
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(NullLocator())
        floor = median.max() / 2000.0
        axes.set_ylim(bottom=max(floor, 0.7 * scaled[scaled > 0].min()))
        faint_grid(axes)
        legend_above(axes)

    return picture(
        name, (canvas.WIDTH, 3.3), draw,
        alternative=f"Response spectra of {len(responses)} records scaled to {level}",
        caption=f"Pseudo-acceleration spectra at 5 % damping of all records, scaled to {level}.",
    )  # fmt: skip


def envelope(motion: "Motion") -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time and range of a record in bins as wide as a line, divided by its PGA.

    Returns
    -------
    (ndarray, ndarray, ndarray)
        Bin centres [s], lowest and highest value [1], (n_bin,).
    """
    values = np.asarray(motion.acceleration, dtype=float)
    peak = np.abs(values).max()
    values = values / peak if peak > 0.0 else values
    # Each bin starts with the last sample of the one before it: the trace stays connected.
    edges = np.unique(np.linspace(0, values.size - 1, min(_BINS, values.size - 1) + 1, dtype=int))
    pieces = [values[a : b + 1] for a, b in pairwise(edges)]
    time = 0.5 * (edges[:-1] + edges[1:]) * motion.dt
    return time, np.array([p.min() for p in pieces]), np.array([p.max() for p in pieces])


def _short(name: str) -> str:
    return name if len(name) <= 26 else name[:12] + "…" + name[-13:]
