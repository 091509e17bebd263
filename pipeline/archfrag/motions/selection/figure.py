"""The spectra of a selection beside those of its target."""

from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

if TYPE_CHECKING:
    from archfrag.motions.selection.select import Selection

BLUE, VERMILION, GREY = "#0072B2", "#D55E00", "#7b8794"
QUANTILE = 1.959964  # of the standard normal at 97.5 %


def draw(selection: "Selection") -> Figure:
    """Left: spectra, medians, 2.5 and 97.5 percentiles of lognormal Sa. Right: sd of ln Sa."""
    target, periods = selection.target, selection.target.periods
    with matplotlib.rc_context({"svg.hashsalt": "archfrag", "font.size": 8.5}):
        figure = Figure(figsize=(9.0, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        for row in selection.ln_sa:
            left.loglog(periods, np.exp(row), color=GREY, lw=0.5, alpha=0.6)
        left.plot([], [], color=GREY, lw=0.5, label=f"{len(selection.ln_sa)} selected, scaled")
        for ln_mean, sd, colour, name in (
            (target.ln_mean, target.sd, BLUE, "target"),
            (selection.ln_sa.mean(axis=0), selection.sd, VERMILION, "selected"),
        ):
            left.loglog(periods, np.exp(ln_mean), color=colour, lw=2.0, label=f"{name}: median")
            band = QUANTILE * np.nan_to_num(sd)
            for sign, label in ((1.0, f"{name}: 2.5 and 97.5 %"), (-1.0, None)):
                left.loglog(
                    periods, np.exp(ln_mean + sign * band), "--", color=colour, label=label
                )
            right.semilogx(periods, sd, color=colour, lw=2.0, label=name)
        if target.conditioning is not None:
            for axis in (left, right):
                axis.axvline(target.conditioning, color=GREY, lw=0.8, ls=":")
        left.set_ylabel("Sa, 5 % damping [g]")
        right.set_ylabel("standard deviation of ln Sa")
        right.set_ylim(bottom=0.0)
        _plain(left.yaxis)
        for axis in (left, right):
            axis.set_xlabel("period [s]")
            _plain(axis.xaxis)
            axis.legend(fontsize=7, frameon=False)
            axis.grid(True, which="major", lw=0.3)
        return figure


def _plain(axis: Axis) -> None:
    """Numbers such as 0.05 in the place of powers of ten."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())
