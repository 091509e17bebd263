"""Charts drawn from the tables alone; one colour and one marker for a solver everywhere."""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

from archbench.growth import medians
from archbench.joints import CORNERS, EXACT, NAMES
from archbench.quantities import QUANTITIES
from archbench.settings import default_setting
from archbench.speed import kept_errors
from archfrag.physics.methods.registry import AUTO

INK = "#1f2933"
GREY = "#7b8794"
PALE = "#d3dae2"
WIDTH = 7.4  # [inch]
DASHES = (0, (5, 3))
COST = "CPU seconds of a run"
PERCENTS = (-80, -40, -20, -10, 0, 10, 20, 40, 80, 160, 320)


class Style(NamedTuple):
    """Label, colour, marker and stroke of a solver."""

    label: str
    colour: str
    marker: str
    stroke: Literal["-", ":", "--", ""] = "-"


# Ours in Okabe and Ito's colours, other solvers dotted; letter, fill and ink of cells.
_TABLES = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
STYLES = {name: Style(*row) for name, row in _TABLES["methods"].items()}
KINDS = _TABLES["kinds"]
RESULTS = _TABLES["results"]


def style_of(name: str) -> Style:
    """Style of a method or of another solver; one that is unknown is grey."""
    return STYLES.get(name, Style(name, GREY, ".", ":"))


def _panels(
    height: float, rows: int = 1, columns: int = 1, used: int = 1
) -> tuple[Figure, list]:
    """A figure of the page's width and its axes; those beyond `used` are empty."""
    matplotlib.rcParams.update(
        {
            "font.size": 8.5,
            "axes.titlesize": 8.5,
            "axes.titleweight": "bold",
            "axes.titlelocation": "left",
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.edgecolor": GREY,
            "axes.linewidth": 0.7,
            "legend.frameon": False,
            "legend.fontsize": 8.0,
            "grid.color": PALE,
            "grid.linewidth": 0.5,
            "svg.fonttype": "none",
            "svg.hashsalt": "archbench",
        }
    )
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flatten().tolist()
    for each in axes[used:]:
        each.set_axis_off()
    return figure, axes[:used]


def _decade(value: float, _: int) -> str:
    return f"{value:g}" if 1e-3 < value < 1e4 else f"1e{round(np.log10(value))}"


def _log(axes: Axes, x: str, y: str, title: str = "", both: bool = True) -> None:
    axes.set(
        xscale="log",
        xlabel=x,
        ylabel=y,
        title=title,
        **({"yscale": "log"} if both else {}),
    )
    for axis in (axes.xaxis, axes.yaxis) if both else (axes.xaxis,):
        axis.set_major_locator(LogLocator(10.0, numticks=5))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(_decade))
    axes.set_axisbelow(True)
    axes.grid(True)


def _legend(figure: Figure, methods: Iterable[str], floor: bool = True) -> None:
    handles = [
        Line2D(
            [], [], color=colour, marker=marker, ls=stroke, lw=1.0, ms=4.0, label=label
        )
        for label, colour, marker, stroke in map(style_of, methods)
    ]
    if floor:
        handles.append(
            Line2D(
                [],
                [],
                color=GREY,
                marker="o",
                mfc="white",
                lw=0.0,
                ms=4.0,
                label="at most",
            )
        )
    figure.legend(handles=handles, loc="outside upper left", ncols=5, handlelength=2.0)


def _ordered(names: Iterable[str]) -> list[str]:
    found = list(dict.fromkeys(names))
    return [name for name in STYLES if name in found] + [
        n for n in found if n not in STYLES
    ]


def _marked(axes: Axes, x, y, hollow, style: Style) -> None:
    axes.plot(x, y, color=style.colour, linestyle=style.stroke, lw=0.9, zorder=2)
    for one, other, empty in zip(x, y, hollow, strict=True):
        axes.plot(
            one,
            other,
            color=style.colour,
            marker=style.marker,
            ms=4.0,
            zorder=3,
            mfc="white" if empty else style.colour,
            mew=0.8,
        )


def cost_chart(points: pd.DataFrame, quantity: str) -> Figure | None:
    """Cost against error of one quantity, a panel for each scene; None if no scene has it."""
    shown = points[(points["quantity"] == quantity) & points["drawn"].astype(bool)]
    if shown.empty:
        return None
    scenes = list(dict.fromkeys(shown["scene"]))
    methods = _ordered(shown["method"])
    rows = math.ceil(len(scenes) / 3)
    figure, panels = _panels(0.9 + 1.75 * rows, rows, 3, len(scenes))
    for axes, scene in zip(panels, scenes, strict=True):
        frame = shown[shown["scene"] == scene]
        for method in methods:
            part = frame[frame["method"] == method]
            error = np.maximum(part["error"], part["floor"])
            _marked(
                axes,
                error,
                part["seconds"],
                part["at_floor"].astype(bool),
                style_of(method),
            )
        axes.axvline(float(frame["floor"].min()), color=GREY, lw=0.7, zorder=1)
        _log(axes, "", "", scene)
    figure.supxlabel(QUANTITIES[quantity], fontsize=8.5)
    figure.supylabel(COST, fontsize=8.5)
    _legend(figure, methods)
    return figure


def is_default(table: pd.DataFrame) -> pd.Series:
    """Which rows of a table, by its columns `method` and `value`, are of `auto` by default."""
    return (table["method"] == AUTO) & (table["value"] == default_setting(AUTO).value)


def errors_chart(points: pd.DataFrame, errors: pd.DataFrame) -> Figure | None:
    """Error against cost over that of the default: of the collapse amplitude, and of theta.

    Amplitudes are medians over scenes of each setting that most of them have. Beside the errors
    of theta by steps are those of the model. None if the default was not measured.
    """
    kept = kept_errors(points)
    kept = kept[kept["quantity"] == "amplitude"]
    enough = kept.groupby(["method", "value"])["scene"].transform("size")
    shown = kept[(enough * 2 > kept["scene"].nunique()) | is_default(kept)]
    settings = shown.groupby(["method", "value"], sort=False)
    table = settings.agg({"kept": "median", "seconds": "median", "at_floor": "all"})
    table = table.reset_index()
    unit = table.loc[is_default(table), "seconds"].median()
    if math.isnan(unit):
        return None
    figure, panels = _panels(4.6, 1, 2, 2)
    methods = _ordered(table["method"])
    for method in methods:
        own = table[table["method"] == method]
        cost = own["seconds"] / unit
        _marked(panels[0], cost, 100.0 * own["kept"], own["at_floor"], style_of(method))
    for kind, rows in errors.groupby("kind", sort=False):
        _errors_of_theta(panels[1], str(kind), rows)
    words = "cost over that of auto at its default"
    _log(panels[0], words, "error (%)", "Collapse amplitude of a scene")
    _log(panels[1], words, "", "Theta of a study")
    panels[1].set(xlim=(0.2, 300.0), ylim=(0.3, 100.0))
    _legend(figure, methods)
    return figure


def _errors_of_theta(axes: Axes, kind: str, rows: pd.DataFrame) -> None:
    """Marks and labels of errors of one kind."""
    style = style_of(kind)
    error = rows["error"].abs()
    percent = 100.0 * np.maximum(error, rows["known_to"])
    _marked(axes, rows["cost"], percent, error <= rows["known_to"], style)
    below = kind in (AUTO, "time_stepping")
    shown = rows.assign(percent=percent)
    if below or kind == "records":  # a line has labels at its ends
        shown = shown.iloc[[0, -1]]
    for label, x, y in shown[["what", "cost", "percent"]].itertuples(index=False):
        axes.annotate(
            label,
            (x, y),
            (-4, -9) if below else (4, 3),
            ha="right" if below else "left",
            textcoords="offset points",
            fontsize=7.0,
            color=style.colour,
        )


def fragility_chart(curves: pd.DataFrame) -> Figure:
    """Difference of theta and beta from the reference against cost; bars: all repetitions."""
    figure, panels = _panels(3.9, 1, 2, 2)
    methods = _ordered(curves["method"])
    for axes, name in zip(panels, ("theta", "beta"), strict=True):
        known, sampling = (
            100.0 * curves[[f"{name}_known_to", f"{name}_sampling"]].iloc[0]
        )
        for method in methods:
            group = curves[curves["method"] == method].sort_values("seconds")
            middle, low, high = (
                100.0 * group[f"{name}_{end}"] for end in ("difference", "low", "high")
            )
            style = style_of(method)
            axes.vlines(
                group["seconds"], low, high, color=style.colour, lw=1.5, alpha=0.5
            )
            _marked(axes, group["seconds"], middle, [False] * len(group), style)
        axes.axhspan(-known, known, color=PALE, alpha=0.7, lw=0.0)
        for sign in (-1.0, 1.0):
            axes.axhline(sign * sampling, color=INK, ls=DASHES, lw=0.8)
        axes.annotate(
            "standard error of the sample of records",
            (1.0, sampling),
            (0, 3),
            fontsize=7.0,
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            ha="right",
        )
        title = f"{name} less the reference's (%)"
        _log(axes, "CPU seconds of one study", "", title, both=False)
        axes.set_yscale("symlog", linthresh=20.0)
        axes.yaxis.set_major_locator(FixedLocator(PERCENTS))
        axes.yaxis.set_major_formatter("{x:g}")
    panels[1].sharex(panels[0])
    _legend(figure, methods, floor=False)
    return figure


def knee_chart(settings: pd.DataFrame) -> Figure:
    """Error of theta, with its standard error, against the cost of a study; a panel an arch."""
    arches = list(dict.fromkeys(settings["arch"]))
    figure, panels = _panels(2.9, 1, len(arches), len(arches))
    for axes, arch in zip(panels, arches, strict=True):
        for method, group in settings[settings["arch"] == arch].groupby(
            "method", sort=False
        ):
            shown = group[group["rms"] > 0.0].sort_values(
                "seconds"
            )  # the reference has no error
            style = style_of(str(method))
            percent = 100.0 * shown[["error", "standard_error"]]
            axes.errorbar(
                shown["seconds"],
                *percent.to_numpy().T,
                color=style.colour,
                marker=style.marker,
                ms=4.0,
                lw=0.9,
            )
        axes.axhline(0.0, color=GREY, lw=0.7, zorder=1)
        axes.set(
            xscale="log",
            title=arch,
            xlabel="CPU seconds of 450 runs",
            ylabel="error of theta (%)",
        )
    _legend(figure, _ordered(settings["method"]), floor=False)
    return figure


def joints_chart(errors: pd.DataFrame, left_out: pd.DataFrame) -> Figure:
    """What rigid joints and an inset leave out of a face, beside the errors of steps."""
    figure, panels = _panels(3.2, 1, 3, 3)
    colours = {"rigid": INK, "inset": STYLES["auto"].colour}
    colours[CORNERS] = STYLES["penalty"].colour
    for model in ("rigid", "inset"):
        percent = 100.0 * errors[f"error_{model}"]
        panels[0].plot(
            100.0 * errors["onset_loss"],
            percent,
            ".",
            color=colours[model],
            label=model,
        )
    panels[0].axhspan(-5.0, 5.0, color=PALE, zorder=0)
    panels[0].set(
        title="borders of half sines",
        xlabel="onset that the inset takes (%)",
        ylabel="border over that of the face (%)",
        ylim=(-40.0, 80.0),
    )
    panels[0].legend()
    for axes, (arch, name) in zip(panels[1:], NAMES.items(), strict=True):
        own = left_out[(left_out["arch"] == arch) & ~left_out["model"].isin(EXACT)]
        for model, rows in own.groupby(
            own["model"].where(own["model"].isin(colours), "steps")
        ):
            style = {
                "color": colours.get(str(model), GREY),
                "fmt": "s" if model in colours else "o",
            }
            axes.errorbar(
                rows["seconds"],
                100.0 * rows["error"],
                100.0 * rows["standard_error"],
                ms=4.0,
                label=f"{model}",
                **style,
            )
        axes.axhline(0.0, color=GREY, lw=0.7, zorder=1)
        axes.set(xscale="log", title=name, xlabel=COST, ylabel="error of theta (%)")
        axes.legend()
    return figure


def growth_chart(runs: pd.DataFrame, exponents: pd.DataFrame) -> Figure:
    """CPU seconds for a second of motion against the number of voussoirs."""
    figure, (axes,) = _panels(3.4)
    known = exponents.set_index("method")
    for method in _ordered(exponents["method"]):
        label, colour, marker, stroke = style_of(method)
        cost = medians(runs[runs["method"] == method])
        row = known.loc[method]
        half = 0.5 * (row["high"] - row["low"])
        fitted = f": n^{row['exponent']:.2f} ± {half:.2f}" if np.isfinite(half) else ""
        axes.plot(
            cost.index,
            cost,
            marker=marker,
            color=colour,
            ls=stroke,
            ms=4.5,
            lw=1.0,
            label=label + fitted,
        )
    axes.axhline(1.0, color=INK, ls=DASHES, lw=0.9)
    _log(axes, "voussoirs", "CPU seconds for a second of motion")
    numbers = sorted(runs["voussoirs"].dropna().unique())
    axes.set_xticks(numbers, [f"{number:g}" for number in numbers])
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _cells(axes: Axes, places: Iterable[tuple[int, int]], cells: Iterable) -> None:
    """Squares of (letter, fill, ink) at places; axes without ticks and spines."""
    for (x, y), (letter, fill, ink) in zip(places, cells, strict=True):
        axes.add_patch(
            Rectangle((x - 0.47, y - 0.45), 0.94, 0.9, fc=fill, ec=PALE, lw=0.3)
        )
        axes.text(x, y, letter, ha="center", va="center", fontsize=7.0, color=ink)
    axes.tick_params(length=0.0)
    axes.spines[:].set_visible(False)


def stability_map(cells: pd.DataFrame) -> Figure:
    """Cells of one plane: a map for each method, its parameter across, what differs up."""
    methods = _ordered(cells["method"])
    rows = list(dict.fromkeys(cells["row"]))
    columns = min(4, len(methods))
    down = math.ceil(len(methods) / columns)
    figure, panels = _panels(
        0.6 + down * (0.8 + 0.22 * len(rows)), down, columns, len(methods)
    )
    for axes, method in zip(panels, methods, strict=True):
        own = cells[cells["method"] == method]
        values = sorted(set(own["value"]), reverse=True)
        places = zip(
            map(values.index, own["value"]), map(rows.index, own["row"]), strict=True
        )
        _cells(axes, places, own["kind"].map(KINDS))
        axes.set_xticks(
            range(len(values)),
            [
                f"{value:.2g}" if value >= 0.1 else f"{value:.0e}".replace("e-0", "e-")
                for value in values
            ],
            fontsize=6.5,
        )
        axes.set_yticks(range(len(rows)), [f"{row:g}" for row in rows], fontsize=7.0)
        axes.set(
            xlim=(-0.6, len(values) - 0.4),
            ylim=(-0.6, len(rows) - 0.4),
            title=style_of(method).label,
            xlabel=own["parameter"].iloc[0],
        )
    figure.supylabel(cells["axis"].iloc[0], fontsize=8.5)
    counts = cells["kind"].value_counts()
    handles = [
        Patch(fc=fill, ec=PALE, label=f"{letter} {kind} ({counts[kind]})".strip())
        for kind, (letter, fill, _) in KINDS.items()
        if kind in counts
    ]
    figure.legend(handles=handles, loc="outside lower left", ncols=4)
    return figure


def corner_chart(runs: pd.DataFrame) -> Figure:
    """Corner cases and their variants by method."""
    methods = _ordered(runs["method"])
    variants = runs["variant"].fillna("")
    keys = list(zip(runs["case"], variants, strict=True))
    lines = list(dict.fromkeys(keys))
    figure, (axes,) = _panels(1.3 + 0.19 * len(lines))
    places = zip(
        map(methods.index, runs["method"]), map(lines.index, keys), strict=True
    )
    _cells(axes, places, runs["result"].map(RESULTS))
    axes.set(xlim=(-0.5, len(methods) - 0.5), ylim=(len(lines) - 0.5, -0.5))
    labels = [style_of(method).label for method in methods]
    axes.set_xticks(range(len(methods)), labels, rotation=30.0, ha="left")
    axes.xaxis.tick_top()
    names = [
        ": ".join(filter(None, (case.replace("_", " "), variant)))
        for case, variant in lines
    ]
    axes.set_yticks(range(len(lines)), names)
    handles = [
        Patch(color=colour, label=kind) for kind, (_, colour, _) in RESULTS.items()
    ]
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles))
    return figure
