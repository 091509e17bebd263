"""Figures of record files: acceleration, velocity and spectra."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.process import velocity
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, legend_above, picture
from archfrag.report.motion_figures import PERIODS, envelope

MOST = 24
_COLOURS = (
    canvas.BLUE, canvas.VERMILION, canvas.GREEN, canvas.ORANGE, canvas.PURPLE, canvas.SKY,
    canvas.INK,
)  # fmt: skip
_DECADES = 1e-4  # of the largest ordinate, below which a spectrum is not shown


def inspected(traces: Sequence[tuple[str, Motion]], name: str) -> Picture:
    """Acceleration and velocity of each channel as read, and the response spectra of all.

    Parameters
    ----------
    traces : sequence of (str, Motion)
        Up to 24 labels and channels.
    name : str
        Unique on a page.

    Raises
    ------
    InputError
        If there is none or there are more.
    """
    if not 1 <= len(traces) <= MOST:
        raise InputError(
            f"a figure shows 1 to {MOST} channels with a known unit; there are {len(traces)}"
        )
    rows = len(traces)

    def draw(figure: Figure) -> None:
        halves = figure.subfigures(2, 1, squeeze=False, height_ratios=[0.9 + 0.9 * rows, 3.0])
        top, bottom = halves[:, 0]
        grid = top.subplots(rows, 2, squeeze=False, sharex="row")
        for (left, right), (label, motion) in zip(grid, traces, strict=True):
            _history(left, motion, 1.0 / STANDARD_GRAVITY)
            rate = velocity(motion)
            _history(right, Motion(rate, motion.dt), 100.0)
            left.set_title(label)
        grid[0, 1].set_title("velocity by the trapezoid rule")
        for axes, quantity in zip(grid[rows // 2], ("acceleration [g]", "velocity [cm/s]")):
            axes.set_ylabel(quantity)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        axes = bottom.subplots()
        for number, (label, motion) in enumerate(traces):
            row = spectral_acceleration(motion, PERIODS) / STANDARD_GRAVITY
            style = "-" if number < len(_COLOURS) else "--"
            colour = _COLOURS[number % len(_COLOURS)]
            axes.plot(PERIODS, row, style, color=colour, lw=1.3, label=label)
        _spectral_axes(axes)
        legend_above(axes, columns=3)

    return picture(
        name, (canvas.WIDTH, 0.9 + 0.9 * rows + 3.0), draw,
        alternative=f"Acceleration, velocity and response spectra of {rows} channels",
        caption="Each channel as it is read, without filter; velocity drifts where the record "
        "needs one. Spectra: pseudo-acceleration at 5 % damping.",
    )  # fmt: skip


def measured(spectra: Mapping[float, NDArray[np.float64]], name: str) -> Picture:
    """Response spectra of the records of a flatfile, as they are: each, median, 16 to 84 %.

    Parameters
    ----------
    spectra : mapping of period [s] to Sa [g], (n_record,)
        At two periods at least.
    name : str
        Unique on a page.

    Raises
    ------
    InputError
        If there are fewer periods.
    """
    periods = np.array(sorted(spectra))
    if periods.size < 2:
        raise InputError(f"a figure of spectra needs two periods or more; there is {periods.size}")
    rows = np.stack([spectra[period] for period in periods], axis=1)
    low, median, high = np.nanquantile(rows, [0.16, 0.5, 0.84], axis=0)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        faint = min(0.6, 60.0 / len(rows))  # so that hundreds leave the band to be seen
        for row in rows:
            axes.plot(periods, row, color=canvas.GREY, lw=0.5, alpha=faint)
        axes.plot([], [], color=canvas.GREY, lw=0.5, label=f"{len(rows)} components")
        axes.fill_between(
            periods, low, high, color=canvas.SKY, alpha=0.4, linewidth=0, label="16 to 84 %",
            zorder=2.5,
        )  # fmt: skip
        axes.plot(periods, median, color=canvas.BLUE, lw=2.0, label="median", zorder=3.0)
        _spectral_axes(axes)
        legend_above(axes)

    return picture(
        name, (canvas.WIDTH, 3.6), draw,
        alternative=f"Response spectra of {len(rows)} components",
        caption="Pseudo-acceleration spectra at 5 % damping, unscaled.",
    )  # fmt: skip


def _history(axes: Axes, series: Motion, factor: float) -> None:
    time, low, high = envelope(series)
    peak = float(np.abs(series.acceleration).max()) * factor
    axes.fill_between(time, low * peak, high * peak, color=canvas.BLUE, linewidth=0.5)
    reach = 1.1 * peak if peak > 0.0 else 1.0
    axes.set(ylim=(-reach, reach), xlim=(0.0, series.duration))
    axes.annotate(
        f"{peak:.3g}", (1.0, 1.0), xycoords="axes fraction", ha="right", va="top", fontsize=7.5
    )
    faint_grid(axes)


def _spectral_axes(axes: Axes) -> None:
    lines = [np.asarray(line.get_ydata(), dtype=float) for line in axes.get_lines()]
    values = np.concatenate(lines)
    top = float(np.nanmax(values, initial=0.0)) or 1.0
    shown = values[values > _DECADES * top]
    axes.set(
        xscale="log", yscale="log", xlabel="period [s]", ylabel="Sa, 5 % damping [g]",
        xlim=tuple(np.asarray(axes.get_lines()[0].get_xdata(), dtype=float)[[0, -1]]),
        ylim=(0.8 * float(shown.min()) if shown.size else 1e-3, 1.4 * top),
    )  # fmt: skip
    steps = (1.0, 2.0, 5.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=steps, numticks=20))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
    faint_grid(axes)
