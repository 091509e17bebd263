"""Figures of record files as SVG: histories and response spectra."""

from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.motions.measures import spectral_acceleration, velocity
from archfrag.motions.motion import Motion

PERIODS = np.geomspace(0.02, 5.0, 80)
MOST = 24  # channels in a figure
_NORMAL_975 = 1.959964  # quantile of the standard normal


def measured_spectra(found: Mapping[float, NDArray[np.float64]]) -> str:
    """Response spectra of a flatfile, period [s] to Sa [g] (n_record,), as SVG."""
    periods = sorted(found)
    if len(periods) < 2:
        raise InputError(f"a figure of spectra needs two periods or more; there is {len(periods)}")
    rows = np.stack([found[period] for period in periods])
    chart, axes = _chart()
    axes.plot(periods, rows, color="grey", linewidth=0.5)
    low, median, high = np.nanquantile(rows, [0.16, 0.5, 0.84], axis=1)
    axes.fill_between(periods, low, high, color="tab:cyan", alpha=0.35, label="16 to 84 %")
    axes.plot(periods, median, color="tab:blue", linewidth=2.0, label="median")
    return _svg(chart, axes)


def selected_spectra(selection: Any) -> str:
    """Spectra of selected, scaled records and their target: medians, 2.5 and 97.5 %, as SVG."""
    target, (chart, axes) = selection.target, _chart()
    axes.plot(target.periods, np.exp(selection.ln_sa).T, color="grey", linewidth=0.5)
    selected = selection.ln_sa.mean(axis=0), selection.sd, "tab:orange", "selected"
    for mean, sd, colour, label in (selected, (target.ln_mean, target.sd, "tab:blue", "target")):
        axes.plot(target.periods, np.exp(mean), color=colour, linewidth=2.0, label=label)
        for end in (-_NORMAL_975, _NORMAL_975):
            spectrum = np.exp(mean + end * np.nan_to_num(sd))
            axes.plot(target.periods, spectrum, color=colour, linewidth=0.8)
    return _svg(chart, axes)


def channels(traces: Sequence[tuple[str, Motion]]) -> str:
    """Acceleration and velocity of labelled channels as read, and their spectra, as SVG."""
    if not 1 <= len(traces) <= MOST:
        raise InputError(
            f"a figure shows 1 to {MOST} channels with a known unit; there are {len(traces)}"
        )
    rows = len(traces)
    chart, axes = _chart(4.5 + 1.4 * rows, (rows + 1, 2), [1.0] * rows + [3.0])
    for row, (label, motion) in enumerate(traces):
        acceleration = np.asarray(motion.acceleration) / STANDARD_GRAVITY
        time = np.arange(acceleration.size) * motion.dt
        histories = {
            f"{label}: acceleration [g]": acceleration,
            "velocity [cm/s]": 100.0 * velocity(motion),
        }
        for column, (title, values) in enumerate(histories.items()):
            own = chart.add_subplot(axes.get_gridspec()[row, column])
            own.plot(time, values, color="tab:blue", linewidth=0.6)
            own.set_title(title, loc="left", fontsize="small")
        sa = spectral_acceleration(motion, PERIODS) / STANDARD_GRAVITY
        axes.plot(PERIODS, sa, linewidth=1.2, label=label)
    return _svg(chart, axes)


def _chart(
    height: float = 4.5, shape: tuple[int, int] = (1, 1), heights: Sequence[float] = (1.0,)
) -> tuple[Any, Any]:
    """A figure of matplotlib with axes of spectra, which have the last row of a grid."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    chart = Figure(figsize=(9.0, height), layout="constrained")
    axes = chart.add_subplot(chart.add_gridspec(*shape, height_ratios=heights)[-1, :])
    axes.set(xscale="log", yscale="log", xlabel="period [s]", ylabel="Sa, 5 % damping [g]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
    return chart, axes


def _svg(chart: Any, axes: Any) -> str:
    import matplotlib

    axes.legend(frameon=False)
    text = StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "archfrag"}):
        chart.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()
