"""Charts of cost against error: one panel for each scene, one figure for each quantity."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from archfrag.evidence.speed.quantities import QUANTITIES
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, picture
from archfrag.report.styles import METHOD_STYLES, method_style

_COLUMNS = 3
_ROW = 1.75  # [inch]


def chart(points: pd.DataFrame, references: pd.DataFrame, quantity: str) -> Picture | None:
    """Cost against error of one quantity, a panel for each scene; None if no scene has it.

    Parameters
    ----------
    points, references : DataFrame
        As `archfrag.evidence.speed.accuracy.measure` returns them.
    quantity : str
        Of `QUANTITIES`.
    """
    shown = points[(points["quantity"] == quantity) & points["charted"].astype(bool)]
    shown = shown[shown["who"] != "limit"]
    if shown.empty:
        return None
    scenes = list(dict.fromkeys(shown["scene"]))
    lines = [line for line in METHOD_STYLES if line in set(shown["line"])]
    lines += [line for line in dict.fromkeys(shown["line"]) if line not in METHOD_STYLES]
    rows = math.ceil(len(scenes) / _COLUMNS)
    legend_rows = math.ceil((len(lines) + 1) / 4)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(rows, _COLUMNS, squeeze=False)
        for axes, scene in zip(grid.flat, scenes, strict=False):
            _panel(axes, shown[shown["scene"] == scene], scene, lines)
        for axes in list(grid.flat)[len(scenes) :]:
            axes.set_axis_off()
        figure.supxlabel(QUANTITIES[quantity].label, fontsize=8.5)
        figure.supylabel("cost of a run [s]", fontsize=8.5)
        handles = [
            Line2D([], [], color=style.colour, marker=style.marker, linestyle=style.stroke, lw=1.0,
                   markersize=4.0, label=style.label)
            for style in map(method_style, lines)
        ]  # fmt: skip
        handles.append(
            Line2D([], [], color=canvas.GREY, marker="o", markerfacecolor="white", lw=0.0,
                   markersize=4.0, label="at most (≤)")
        )  # fmt: skip
        figure.legend(handles=handles, loc="outside upper left", ncols=4, handlelength=2.2)

    errors = references[(references["quantity"] == quantity) & references["scene"].isin(scenes)]
    worst = errors["error"].max()
    own = (
        "Amplitudes about which the reference's two tolerances disagree are left out; the grey "
        "line is half a wrong verdict."
        if quantity == "verdicts"
        else f"Errors of the references: {errors['error'].min():.1e} to {worst:.1e}. "
        "The grey line is ten times that of its scene; what is read from frames is not drawn "
        "below what frames as far apart as that run's blur. Nothing is drawn left of its own "
        "line, and hollow marks say at most."
    )
    return picture(
        f"speed-{quantity.replace('_', '-')}",
        (canvas.WIDTH, 0.55 + 0.2 * legend_rows + _ROW * rows),
        draw,
        alternative=f"Cost against error, {QUANTITIES[quantity].label}, for "
        f"{', '.join(lines)}, on {len(scenes)} scenes",
        caption=f"{QUANTITIES[quantity].meaning[0].upper()}{QUANTITIES[quantity].meaning[1:]}. "
        f"Down and to the left is better. Marks are settings, coarse to fine. {own}",
    )


def _panel(axes: Axes, frame: pd.DataFrame, scene: str, lines: list[str]) -> None:
    for line in lines:
        part = frame[frame["line"] == line].sort_values("place")
        if part.empty:
            continue
        _, colour, marker, stroke = method_style(line)
        error = np.maximum(part["error"].to_numpy(), part["floor"].to_numpy())
        cost = part["cost"].to_numpy()
        hollow = part["at_floor"].to_numpy(bool)
        axes.plot(error, cost, color=colour, linestyle=stroke, lw=0.9, zorder=2)
        inside = np.where(hollow, "white", colour)
        for x, y, fill in zip(error, cost, inside, strict=True):
            # A cross has no inside.
            plain = {} if marker == "x" else {"markerfacecolor": fill}
            axes.plot(x, y, color=colour, marker=marker, markersize=3.6, zorder=3,
                      markeredgewidth=0.8, **plain)  # fmt: skip
    axes.axvline(float(frame["floor"].min()), color=canvas.GREY, lw=0.7, zorder=1)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(scene, fontsize=8.0)
    _whole_decades(axes)
    faint_grid(axes)


def _whole_decades(axes: Axes) -> None:
    for low, high, put, axis in (
        (*axes.get_xlim(), axes.set_xlim, axes.xaxis),
        (*axes.get_ylim(), axes.set_ylim, axes.yaxis),
    ):
        bottom, top = math.floor(math.log10(low)), math.ceil(math.log10(high))
        put(10.0**bottom, 10.0**top)
        axis.set_major_locator(LogLocator(numticks=5))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(lambda value, _: f"1e{round(math.log10(value))}")


def spread_chart(spreads: pd.DataFrame, horizons: pd.DataFrame) -> Picture | None:
    """Peak displacements of perturbed runs, of scenes whose peak is not charted."""
    if spreads.empty:
        return None
    scenes = list(dict.fromkeys(spreads["scene"]))
    rows = math.ceil(len(scenes) / _COLUMNS)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(rows, _COLUMNS, squeeze=False)
        for axes, scene in zip(grid.flat, scenes, strict=False):
            frame = spreads[spreads["scene"] == scene]
            ways = list(dict.fromkeys(frame["way"]))
            for k, way in enumerate(ways):
                part = frame[(frame["way"] == way) & ~frame["collapsed"].astype(bool)]
                offset = np.linspace(-0.25, 0.25, len(part))
                style = method_style(str(frame[frame["way"] == way]["line"].iloc[0]))
                axes.plot(
                    part["peak"], k + offset, style.marker, color=style.colour, markersize=3.0
                )
            axes.set_yticks(range(len(ways)), ways)
            axes.set_ylim(len(ways) - 0.5, -0.5)
            axes.set_xlim(left=0.0)
            axes.set_title(scene, fontsize=8.0)
            faint_grid(axes, "x")
        for axes in list(grid.flat)[len(scenes) :]:
            axes.set_axis_off()
        figure.supxlabel("peak displacement [m]", fontsize=8.5)

    return picture(
        "speed-spreads",
        (canvas.WIDTH, 0.5 + 1.5 * rows),
        draw,
        alternative=f"Peak displacements of perturbed runs on {len(scenes)} scenes",
        caption="Where the peak comes beyond the predictability horizon, or the reference's own "
        "peak is not sure, no single history can be compared: peak displacements of runs whose "
        "ground motion is scaled by 1 plus or minus 1e-9 to 1e-6. Runs that collapse are not "
        "drawn; their number is in the table.",
    )
