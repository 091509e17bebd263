"""What ran: shares of the models of the ladder, events, hand-overs, general contact problems."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from archfrag.mechanics.status import Model
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, legend_above, picture
from archfrag.report.figures import level_ticks
from archfrag.report.summary import ArchResults
from archfrag.report.tables import Table
from archfrag.simulation.mechanism import MODEL_WORDS

MODEL_LOOK = {
    Model.REST: (canvas.PALE, ""),
    Model.FOUR_HINGES: (canvas.SKY, ""),
    Model.MEGA_VOUSSOIRS: (canvas.GREEN, "...."),
    Model.ALL_VOUSSOIRS: (canvas.PURPLE, "////"),
}


def what_ran(results: ArchResults, name: str) -> Picture:
    """Share of simulated time of each model, and what happened in a second of motion, by level."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        _shares(left, results)
        _rates(right, results)

    return picture(
        name, (canvas.WIDTH, 2.8), draw,
        alternative=f"Shares of simulated time of {results.arch} by model of the ladder, and "
        "numbers of events in a second of motion, by level",
        caption="Left: simulated time that each model of the ladder had, from rest over the few "
        "bodies that move relative to each other to all voussoirs. Right: means over the time in "
        "motion; what did not occur is not drawn. Impacts are joints that closed; an event is an "
        "instant that was located; a hand-over is where events came too thick to be located; "
        "general are contact problems that the two levels left to the general solver.",
    )  # fmt: skip


def table(results: ArchResults) -> Table:
    """Simulated time of each model, and totals of events and contact problems."""
    total = max(float(results.model_time.sum()), np.finfo(float).tiny)
    moving = _moving(results).sum()
    rows = []
    for i, model in enumerate(results.models):
        seconds = float(results.model_time[..., i].sum())
        rows.append(
            [
                f"simulated time, {_words(model)}",
                f"{seconds:,.1f} s ({100 * seconds / total:.1f} %)",
            ]
        )
    by_steps = results.model_time[..., results.models.index("all_voussoirs")].sum()
    if moving > 0.0:
        rows.append(
            ["share of the time in motion on all voussoirs", f"{100 * by_steps / moving:.1f} %"]
        )
    for label, counts in (
        ("events located", results.events),
        ("impacts", results.impacts),
        ("hand-overs to time stepping", results.hand_overs),
    ):
        rate = f" ({counts.sum() / moving:.3g} in a second of motion)" if moving > 0.0 else ""
        rows.append([label, f"{counts.sum():,}{rate}"])
    solved = int(results.two_level.sum())
    again = int(results.level_iterations.sum())
    share = f" ({100 * again / solved:.2g} %)" if solved else ""
    rows += [
        ["contact problems solved by the two levels", f"{solved:,}"],
        ["of these, with more than one round", f"{again:,}{share}"],
        ["contact problems left to the general solver", f"{results.general.sum():,}"],
    ]
    return Table(["figure", "value"], rows)


def _shares(axes: Axes, results: ArchResults) -> None:
    time = results.model_time.sum(axis=0)
    total = np.maximum(time.sum(axis=1), np.finfo(float).tiny)
    base = np.zeros(results.levels.size)
    for i, model in enumerate(results.models):
        colour, hatch = MODEL_LOOK[Model[model.upper()]]
        share = 100.0 * time[:, i] / total
        if share.any():
            axes.bar(
                np.arange(share.size), share, bottom=base, width=0.85, label=_words(model),
                facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0.4,
            )  # fmt: skip
        base += share
    level_ticks(axes, results.levels, most=6)
    axes.set(xlabel=results.scale.label, ylabel="simulated time [%]", ylim=(0, 100))
    legend_above(axes, columns=2)


def _rates(axes: Axes, results: ArchResults) -> None:
    moving = _moving(results).sum(axis=0)
    shown = 0
    for label, counts, colour, marker in (
        ("impacts", results.impacts, canvas.VERMILION, "o"),
        ("events", results.events, canvas.BLUE, "s"),
        ("hand-overs", results.hand_overs, canvas.ORANGE, "^"),
        ("general", results.general, canvas.GREEN, "D"),
    ):
        rate = counts.sum(axis=0) / np.where(moving > 0.0, moving, np.nan)
        rate[~(rate > 0.0)] = np.nan
        if np.isfinite(rate).any():
            shown += 1
            axes.plot(rate, color=colour, marker=marker, markersize=3.5, lw=1.0, label=label)
    level_ticks(axes, results.levels, most=6)
    axes.set(xlabel=results.scale.label, ylabel="in a second of motion")
    axes.set_xlim(-0.6, results.levels.size - 0.4)
    if not shown:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "no events", transform=axes.transAxes, ha="center", color=canvas.GREY)
        return
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(10.0 ** np.floor(np.log10(low)), 10.0 ** np.ceil(np.log10(high)))
    axes.yaxis.set_major_locator(LogLocator(numticks=6))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    faint_grid(axes, "y")
    legend_above(axes, columns=2)


def _moving(results: ArchResults) -> np.ndarray:
    """Simulated time in motion of each run [s]."""
    return results.model_time.sum(axis=2) - results.model_time[..., results.models.index("rest")]


def _words(model: str) -> str:
    return MODEL_WORDS[Model[model.upper()]]
