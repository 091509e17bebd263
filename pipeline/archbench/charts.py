"""Charts drawn from the tables alone; one colour and one marker for a solver everywhere."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from archbench.growth import medians
from archbench.quantities import QUANTITIES
from archbench.speed import kept_errors

INK, GREY, PALE = "#1f2933", "#7b8794", "#d3dae2"
WIDTH = 7.4  # [inch]
_COLUMNS = 3


class Style(NamedTuple):
    """Label, colour, marker and stroke of a solver."""

    label: str
    colour: str
    marker: str
    stroke: Literal["-", ":"] = "-"


# Ours in Okabe and Ito's colours; other solvers dotted.
STYLES = {
    "time_stepping": Style("time stepping", "#0072B2", "o"),
    "event_driven": Style("event-driven", "#D55E00", "s"),
    "auto": Style("auto", "#009E73", "^"),
    "penalty": Style("penalty springs", "#E69F00", "D"),
    "four_link": Style("four-link", INK, "P"),
    "gauss_seidel": Style("Gauss–Seidel", "#CC79A7", "X"),
    "quadratic_programme": Style("quadratic programme", "#56B4E9", "p"),
    "mujoco": Style("MuJoCo", "#8c6d31", "<", ":"),
    "mujoco_corners": Style("MuJoCo, corners", "#8c6d31", ">", ":"),
    "pymunk": Style("pymunk", "#637939", "v", ":"),
    "lmgc90": Style("LMGC90", "#843c39", "*", ":"),
    "siconos": Style("Siconos", "#7b4173", "h", ":"),
    "pinocchio": Style("Pinocchio (ADMM)", "#3182bd", "d", ":"),
    "kamino": Style("Newton Kamino", "#636363", "8", ":"),
}
# Letter, fill and ink of the cells of a map.
KINDS = {
    "not ended": ("H", "#5b3a1e", "white"),
    "diverged": ("D", INK, "white"),
    "unconverged": ("U", GREY, "white"),
    "drifted at rest": ("R", "#56B4E9", INK),
    "penetrated": ("P", "#CC79A7", INK),
    "gained energy": ("E", "#E69F00", INK),
    "false collapse": ("F", "#D55E00", "white"),
    "missed collapse": ("M", "#0072B2", "white"),
    "undecided": ("?", "#eef1f4", GREY),
    "does not apply": ("–", "white", GREY),
    "right": ("", "#bfe3d5", INK),
}
RESULTS = {"held": "#bfe3d5", "broke": "#D55E00", "failed": INK, "does not apply": "#eef1f4"}


def style_of(name: str) -> Style:
    """Style of a method or of another solver; one that is unknown is grey."""
    return STYLES.get(name, Style(name, GREY, ".", ":"))


def new_figure(height: float) -> Figure:
    """An empty figure of the page's width in the common style."""
    matplotlib.rcParams.update({
        "font.size": 8.5, "axes.titlesize": 8.5, "axes.titleweight": "bold",
        "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False,
        "axes.edgecolor": GREY, "axes.linewidth": 0.7, "legend.frameon": False,
        "legend.fontsize": 8.0, "grid.color": PALE, "grid.linewidth": 0.5,
        "svg.fonttype": "none", "svg.hashsalt": "archbench",
    })  # fmt: skip
    return Figure(figsize=(WIDTH, height), layout="constrained")


def _log(axes: Axes, both: bool = True) -> None:
    for axis in (axes.xaxis, axes.yaxis) if both else (axes.xaxis,):
        axis.set_major_locator(LogLocator(10.0, numticks=5))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(_decade))
    axes.set_axisbelow(True)
    axes.grid(True)


def _decade(value: float, _: int) -> str:
    return f"{value:g}" if 1e-3 < value < 1e4 else f"1e{round(np.log10(value))}"


def _legend(figure: Figure, methods: Iterable[str], floor: bool = True) -> None:
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle=stroke, lw=1.0, ms=4.0, label=label)
        for label, colour, marker, stroke in map(style_of, methods)
    ]
    if floor:
        marks: dict[str, Any] = {
            "color": GREY,
            "marker": "o",
            "mfc": "white",
            "lw": 0.0,
            "ms": 4.0,
        }
        handles.append(Line2D([], [], label="at most", **marks))
    figure.legend(handles=handles, loc="outside upper left", ncols=5, handlelength=2.0)


def _ordered(names: Iterable[str]) -> list[str]:
    found = list(dict.fromkeys(names))
    return [name for name in STYLES if name in found] + [n for n in found if n not in STYLES]


def _marked(axes: Axes, x, y, hollow, style: Style) -> None:
    axes.plot(x, y, color=style.colour, linestyle=style.stroke, lw=0.9, zorder=2)
    for one, other, empty in zip(x, y, hollow, strict=True):
        axes.plot(one, other, color=style.colour, marker=style.marker, ms=4.0, zorder=3,
                  mfc="white" if empty else style.colour, mew=0.8)  # fmt: skip


def cost_chart(points: pd.DataFrame, quantity: str) -> Figure | None:
    """Cost against error of one quantity, a panel for each scene; None if no scene has it."""
    shown = points[(points["quantity"] == quantity) & points["drawn"].astype(bool)]
    if shown.empty:
        return None
    scenes = list(dict.fromkeys(shown["scene"]))
    rows = math.ceil(len(scenes) / _COLUMNS)
    figure = new_figure(0.9 + 1.75 * rows)
    grid = figure.subplots(rows, _COLUMNS, squeeze=False)
    methods = _ordered(shown["method"])
    for axes, scene in zip(grid.flat, scenes, strict=False):
        frame = shown[shown["scene"] == scene]
        for method in methods:
            part = frame[frame["method"] == method]
            error = np.maximum(part["error"], part["floor"])
            _marked(axes, error, part["seconds"], part["at_floor"].astype(bool), style_of(method))
        axes.axvline(float(frame["floor"].min()), color=GREY, lw=0.7, zorder=1)
        axes.set(xscale="log", yscale="log", title=scene)
        _log(axes)
    for axes in grid.flat[len(scenes) :]:
        axes.set_axis_off()
    figure.supxlabel(QUANTITIES[quantity], fontsize=8.5)
    figure.supylabel("CPU seconds of a run", fontsize=8.5)
    _legend(figure, methods)
    return figure


def overview_chart(points: pd.DataFrame, quantity: str = "amplitude") -> Figure:
    """Cost against error over all scenes: medians of each setting that most of them have."""
    kept = kept_errors(points)
    kept = kept[kept["quantity"] == quantity]
    figure = new_figure(3.6)
    axes = figure.subplots()
    methods = _ordered(kept["method"])
    for method in methods:
        group = kept[kept["method"] == method].groupby("value", sort=False)
        table = group[["kept", "seconds", "at_floor"]].agg(
            {"kept": "median", "seconds": "median", "at_floor": "all"}
        )
        table = table[group.size() * 2 > kept["scene"].nunique()]
        _marked(axes, table["kept"], table["seconds"], table["at_floor"], style_of(method))
    axes.set(xscale="log", yscale="log", xlabel=QUANTITIES[quantity],
             ylabel="CPU seconds of a run", title="Medians over scenes")  # fmt: skip
    _log(axes)
    _legend(figure, methods)
    return figure


def fragility_chart(curves: pd.DataFrame) -> Figure:
    """Difference of theta and beta from the reference against cost; bars: all repetitions."""
    figure = new_figure(3.9)
    panels = figure.subplots(1, 2, sharex=True)
    methods = _ordered(curves["method"])
    for axes, name in zip(panels, ("theta", "beta"), strict=True):
        known, sampling = (
            100.0 * float(curves[f"{name}_{kind}"].iloc[0]) for kind in ("known_to", "sampling")
        )
        for method in methods:
            style = style_of(method)
            group = curves[curves["method"] == method].sort_values("seconds")
            middle, low, high = (
                100.0 * group[f"{name}_{kind}"] for kind in ("difference", "low", "high")
            )
            axes.vlines(group["seconds"], low, high, color=style.colour, lw=1.5, alpha=0.5)
            _marked(axes, group["seconds"], middle, [False] * len(group), style)
        axes.axhspan(-known, known, color=PALE, alpha=0.7, lw=0.0)
        for sign in (-1.0, 1.0):
            axes.axhline(sign * sampling, color=INK, ls=(0, (5, 3)), lw=0.8)
        axes.annotate("standard error of the sample of records", (1.0, sampling), (0, 3),
                      fontsize=7.0, xycoords=("axes fraction", "data"),
                      textcoords="offset points", ha="right")  # fmt: skip
        axes.set_xscale("log")
        axes.set_yscale("symlog", linthresh=20.0)
        axes.set(title=f"{name} less the reference's (%)", xlabel="CPU seconds of one study")
        _log(axes, both=False)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    _legend(figure, methods, floor=False)
    return figure


def growth_chart(runs: pd.DataFrame, exponents: pd.DataFrame) -> Figure:
    """CPU seconds for a second of motion against the number of voussoirs."""
    figure = new_figure(3.4)
    axes = figure.subplots()
    known = exponents.set_index("method")
    for method in _ordered(exponents["method"]):
        label, colour, marker, stroke = style_of(method)
        cost, row = medians(runs[runs["method"] == method]), known.loc[method]
        half = 0.5 * (row["high"] - row["low"])
        axes.plot(cost.index, cost, marker=marker, color=colour, ls=stroke, ms=4.5, lw=1.0,
                  label=f"{label}: n^{row['exponent']:.2f} ± {half:.2f}")  # fmt: skip
    axes.axhline(1.0, color=INK, ls=(0, (5, 3)), lw=0.9)
    axes.set(xscale="log", yscale="log", xlabel="voussoirs",
             ylabel="CPU seconds for a second of motion")  # fmt: skip
    _log(axes)
    numbers = sorted(runs["voussoirs"].dropna().unique())
    axes.set_xticks(numbers, [f"{number:g}" for number in numbers])
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def stability_map(cells: pd.DataFrame) -> Figure:
    """Cells of one plane: a map for each method, its parameter across, what differs up."""
    methods, rows = _ordered(cells["method"]), list(dict.fromkeys(cells["row"]))
    across = min(4, len(methods))
    down = math.ceil(len(methods) / across)
    figure = new_figure(0.6 + down * (0.8 + 0.22 * len(rows)))
    panels = figure.subplots(down, across, squeeze=False)
    for axes, method in zip(panels.flat, methods, strict=False):
        own = cells[cells["method"] == method]
        values = sorted(set(own["value"]), reverse=True)
        for _, cell in own.iterrows():
            x, y = values.index(cell["value"]), rows.index(cell["row"])
            letter, fill, ink = KINDS[cell["kind"]]
            axes.add_patch(Rectangle((x - 0.47, y - 0.45), 0.94, 0.9, fc=fill, ec=PALE, lw=0.3))
            axes.text(x, y, letter, ha="center", va="center", fontsize=7.0, color=ink)
        axes.set_xticks(range(len(values)), [f"{value:.0e}".replace("e-0", "e-")
                        .replace("e+00", "") for value in values], fontsize=6.5)  # fmt: skip
        axes.set_yticks(range(len(rows)), [f"{row:g}" for row in rows], fontsize=7.0)
        axes.set(xlim=(-0.6, len(values) - 0.4), ylim=(-0.6, len(rows) - 0.4),
                 title=style_of(method).label, xlabel=own["parameter"].iloc[0])  # fmt: skip
        axes.tick_params(length=0.0)
        axes.spines[:].set_visible(False)
    for axes in panels.flat[len(methods) :]:
        axes.set_axis_off()
    figure.supylabel(cells["axis"].iloc[0], fontsize=8.5)
    counts = cells["kind"].value_counts()
    handles = [Patch(fc=fill, ec=PALE, label=f"{letter} {kind} ({counts[kind]})".strip())
               for kind, (letter, fill, _) in KINDS.items() if kind in counts]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower left", ncols=5)
    return figure


def corner_chart(runs: pd.DataFrame) -> Figure:
    """Corner cases and their variants by method."""
    methods = _ordered(runs["method"])
    lines = list(dict.fromkeys(zip(runs["case"], runs["variant"].fillna(""), strict=True)))
    figure = new_figure(1.3 + 0.19 * len(lines))
    axes = figure.subplots()
    for _, row in runs.fillna({"variant": ""}).iterrows():
        x, y = methods.index(row["method"]), lines.index((row["case"], row["variant"]))
        colour = RESULTS[row["result"]]
        axes.add_patch(Rectangle((x - 0.46, y - 0.44), 0.92, 0.88, fc=colour, lw=0.0))
        if row["result"] in ("broke", "failed"):
            axes.text(x, y, "×", ha="center", va="center", color="white", fontsize=8.0)
    axes.set(xlim=(-0.5, len(methods) - 0.5), ylim=(len(lines) - 0.5, -0.5))
    axes.set_xticks(range(len(methods)), [style_of(m).label for m in methods], rotation=30.0,
                    ha="left")  # fmt: skip
    axes.xaxis.tick_top()
    names = [": ".join(part for part in (case.replace("_", " "), variant) if part)
             for case, variant in lines]  # fmt: skip
    axes.set_yticks(range(len(lines)), names)
    axes.tick_params(length=0.0)
    axes.spines[:].set_visible(False)
    handles = [Patch(color=colour, label=kind) for kind, colour in RESULTS.items()]
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles))
    return figure
