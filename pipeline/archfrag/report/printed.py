"""Main figures of a report for papers: PDF and PNG in the style of `archfrag.plots`."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from archfrag import plots
from archfrag.files import check_targets, make_folder, replacing
from archfrag.report.inputs import ArchResults, ReportInputs
from archfrag.report.run_figures import MEASURED, VERDICTS, ida_lines

_COLOURS = (plots.BLUE, plots.VERMILION, plots.GREEN, plots.ORANGE)
_STYLES = {"16 %": "--", "84 %": ":"}
_MOST_NAMED = 60  # records whose names are written


def save_figures(inputs: ReportInputs, folder: Path) -> list[Path]:
    """Write the figures to a folder; return the files.

    They are the fragility curves, and for each arch that the report shows the IDA curves (not of
    a cloud), every run, and the arch at onset.
    """
    figures = {"fragility": _curves(inputs)}
    for name, _, onset in inputs.arches:
        results = inputs.results(name)
        if results.own_levels is None:
            figures[f"ida-{name}"] = _ida_figure(results)
        figures[f"runs-{name}"] = _runs_figure(results)
        figures[f"onset-{name}"], ax = _axes(3.6)
        onset.plot(ax)
    paths = [folder / f"{name}.{end}" for name in figures for end in ("pdf", "png")]
    check_targets(paths)
    make_folder(folder)
    for number, figure in enumerate(figures.values()):  # for print: black text on white
        figure.patch.set(alpha=1.0, facecolor="white")
        for text in figure.findobj(Text):
            text.set_color("black")
        pdf, png = paths[2 * number : 2 * number + 2]
        with (
            rc_context({"pdf.fonttype": 42}),
            replacing(pdf) as part,
        ):  # fonts to be edited
            figure.savefig(part, format="pdf", metadata={"CreationDate": None})
        with replacing(png) as part:
            figure.savefig(part, format="png", dpi=300)
    return paths


def _axes(height: float) -> tuple[Figure, Axes]:
    """Return a figure of this height [inch], as wide as a text, and its axes."""
    figure = Figure((5.4, height), layout="constrained")
    return figure, plots.dressed(figure.add_subplot())


def _curves(inputs: ReportInputs) -> Figure:
    """Draw the curves of classes and arches with their bands, and the fractions of the runs."""
    scale, (figure, ax), shown = (
        inputs.scale,
        _axes(3.6),
        [name for name, _, _ in inputs.arches],
    )
    for number, (name, answer) in enumerate(inputs.quoted.items()):
        colour = _COLOURS[number % 4]
        style = "-" if number < 4 else "--"
        if answer.fitted:
            im = np.array(answer.im)
            label = f"{name}: median {scale.text(answer.theta)}"
            ax.plot(
                scale.factor * im,
                answer.probability(im),
                style,
                color=colour,
                label=label,
            )
            band = answer.lower, answer.upper
            ax.fill_between(scale.factor * im, *band, color=colour, alpha=0.2, lw=0.0)
        if name in shown:  # of a class the fractions are not shown
            results = inputs.results(name)
            ax.plot(results.levels, results.fraction, "o", color=colour, ms=3.0)
    ax.set(
        xlabel=scale.label,
        ylabel="probability of collapse",
        xlim=(0.0, 1.05 * inputs.highest),
        ylim=(0.0, 1.02),
    )
    if ax.get_legend_handles_labels()[0]:
        plots.legend(ax)
    return figure


def _ida_figure(results: ArchResults) -> Figure:
    """Draw largest and residual rotation against intensity; collapse is a flat line."""
    figure = Figure((7.2, 3.6), layout="constrained")
    axes: Any = figure.subplots(1, 2, sharey=True)
    for ax, (name, title) in zip(map(plots.dressed, axes), MEASURED.items()):
        right, lines = ida_lines(results, name, 1.1)
        for x, y, label in lines:
            colour, width = (plots.BLUE, 1.5) if label else (plots.GREY, 0.6)
            ax.plot(x, y, _STYLES.get(label, "-"), color=colour, lw=width, label=label)
        ax.set(xlabel=title, xlim=(0.0, right))
        ax.locator_params(axis="x", nbins=5)
    axes[0].set(ylabel=results.scale.label, ylim=(0.0, 1.05 * results.levels.max()))
    plots.legend(axes[0])
    return figure


def _runs_figure(results: ArchResults) -> Figure:
    """Draw the verdict of every run, records in the order of their capacities."""
    order = np.argsort(results.capacities, kind="stable")
    count = len(results.records)
    figure, ax = _axes(1.0 + 0.16 * min(count, _MOST_NAMED))
    own = results.own_levels
    size = min(16.0, 1000.0 / count)
    for code, entry in VERDICTS.items():
        row, place = np.nonzero(
            results.simulated[order] & (results.verdict[order] == code)
        )
        x = results.levels[place] if own is None else own[order][row]
        if row.size:
            ax.scatter(
                x, row, size, entry.colour, marker="s", label=entry.label, lw=0.0
            )
    if count <= _MOST_NAMED:
        names = [results.records[i] for i in order]
        ax.set_yticks(range(count), names, fontsize=plots.SIZE - 2.0)
    ax.set(xlabel=results.scale.label, ylim=(count - 0.4, -0.6))
    plots.legend(ax, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    return figure
