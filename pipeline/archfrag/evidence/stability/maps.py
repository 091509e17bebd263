"""Maps of failures: small multiples by method, a colour and a letter for each kind."""

from __future__ import annotations

import math

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from archfrag.report import canvas
from archfrag.report.canvas import Picture, picture

RIGHT = "right"
# Kinds from the worst to the mildest: letter, fill, ink. A cell shows the first that it has.
KINDS = {
    "hung": ("H", "#5b3a1e", "white"),
    "diverged": ("D", canvas.INK, "white"),
    "unconverged": ("U", canvas.GREY, "white"),
    "drifted at rest": ("R", canvas.SKY, canvas.INK),
    "penetrated": ("P", canvas.PURPLE, canvas.INK),
    "gained energy": ("E", canvas.ORANGE, canvas.INK),
    "false collapse": ("F", canvas.VERMILION, "white"),
    "missed collapse": ("M", canvas.BLUE, "white"),
    "undecided": ("?", "#eef1f4", canvas.GREY),
    "does not apply": ("–", "white", canvas.GREY),
    RIGHT: ("", "#bfe3d5", canvas.INK),
}
FAILURES = tuple(KINDS)[:8]
_ACROSS = 4
_KNOBS = {
    "dt": ("step [ms]", 1e3, "{:.3g}"),
    "rtol": ("tolerance", 1.0, "{:.0e}"),
    "step_fraction": ("part of critical step", 1.0, "{:g}"),
}


def kinds_of(cells: pd.DataFrame) -> pd.Series:
    """The kind that a map shows of each cell: the first flag that is set, or right."""
    kind = pd.Series(RIGHT, index=cells.index, dtype=object)
    for name in reversed(list(KINDS)[:-1]):
        kind[_flag(cells, name)] = name
    return kind


def lead_sentences(cells: pd.DataFrame) -> list[str]:
    """One for each method: how many runs are right, and how many fail in each way."""
    return [f"{method}: {failing(own)}." for method, own in cells.groupby("method", sort=False)]


def failing(cells: pd.DataFrame) -> str:
    """How many runs of one method are right, and how many fail in each way.

    Parameters
    ----------
    cells : DataFrame
    """
    judged = cells[~_flag(cells, "does not apply")]
    flags = pd.DataFrame({name: _flag(judged, name) for name in FAILURES})
    parts = [f"{count} {name}" for name, count in flags.sum().items() if count]
    clean = int((~flags.any(axis=1)).sum())
    said = ", ".join(parts) if parts else "none failed"
    return f"{clean} of {len(judged)} runs without a failure; {said}"


def draw_maps(name: str, title: str, axis: str, cells: pd.DataFrame) -> Picture:
    """Cells of one plane: a map for each method, its knob across, what differs up.

    Parameters
    ----------
    name : str
        Of the figure, unique on the page.
    title, axis : str
    cells : DataFrame
        With columns method, knob, value, row and the flags of `KINDS`.
    """
    cells = cells.assign(kind=kinds_of(cells), row=cells["row"].map(_label))
    methods = list(dict.fromkeys(cells["method"]))
    rows = list(dict.fromkeys(cells["row"]))
    across = min(_ACROSS, len(methods))
    down = math.ceil(len(methods) / across)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(down, across, squeeze=False)
        for k, method in enumerate(methods):
            axes = panels[k // across, k % across]
            _map(axes, cells[cells["method"] == method], rows)
            axes.set_title(method)
            if k % across == 0:
                axes.set_ylabel(axis)
        for k in range(len(methods), down * across):
            panels[k // across, k % across].set_axis_off()
        counts = cells["kind"].value_counts()
        handles = [
            Patch(facecolor=fill, edgecolor=canvas.PALE, label=f"{letter} {kind} ({counts[kind]})"
                  .strip())
            for kind, (letter, fill, _) in KINDS.items()
            if kind in counts
        ]  # fmt: skip
        figure.legend(handles=handles, loc="outside lower left", ncols=5)

    height = down * (0.75 + 0.24 * len(rows)) + 0.6
    return picture(
        name, (canvas.WIDTH, height), draw,
        alternative=f"{title}: kinds of failure by method, step or tolerance, and {axis}",
        caption=f"{title}. Each cell is one run; steps or tolerances become finer to the right. "
        "In brackets, how many runs show each kind.",
    )  # fmt: skip


def _map(axes: Axes, cells: pd.DataFrame, rows: list[str]) -> None:
    values = sorted(set(cells["value"]), reverse=True)
    for row, value, kind in zip(cells["row"], cells["value"], cells["kind"]):
        x, y = values.index(value), rows.index(row)
        letter, fill, ink = KINDS[kind]
        axes.add_patch(
            Rectangle((x - 0.47, y - 0.45), 0.94, 0.9, facecolor=fill, edgecolor=canvas.PALE,
                      linewidth=0.3)
        )  # fmt: skip
        axes.text(x, y, letter, ha="center", va="center", fontsize=7.5, color=ink)
    name, scale, form = _KNOBS[cells["knob"].iloc[0]]
    labels = [form.format(scale * value).replace("e-0", "e-") for value in values]
    axes.set_xticks(range(len(values)), labels)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xlabel(name)
    axes.set(xlim=(-0.55, len(values) - 0.45), ylim=(-0.55, len(rows) - 0.45))
    axes.tick_params(length=0.0, labelsize=7.5)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _label(value: object) -> str:
    """A row's label as it was before the table went to disk, where 27 became 27.0."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _flag(cells: pd.DataFrame, name: str) -> pd.Series:
    if name not in cells:
        return pd.Series(False, index=cells.index)
    return cells[name].map(lambda value: value is True or str(value) in ("True", "1.0", "1"))
