"""Verdicts by mechanism: how, where and after how many impacts the arch collapsed."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from archfrag.fragility.deaggregate import Deaggregation, deaggregate
from archfrag.mechanics.status import CollapseMode
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, picture
from archfrag.report.figures import MODE_LOOK, level_ticks
from archfrag.report.summary import ArchResults, digits
from archfrag.report.tables import Table

IMPACTS = ("no impact", "1 impact", "2 to 9 impacts", "10 to 99 impacts", "100 or more impacts")
_IMPACT_BOUNDS = (1, 2, 10, 100)
_OTHER = "other joints"
_MOST_JOINTS = 4
_LOOKS = (
    (canvas.BLUE, ""), (canvas.ORANGE, "////"), (canvas.GREEN, "...."), (canvas.PURPLE, "xxxx"),
    (canvas.GREY, ""),
)  # fmt: skip


def by_mode(results: ArchResults, confidence: float) -> Deaggregation:
    """Collapses by how the joint that was lost had been moving, codes of `CollapseMode`."""
    names = [MODE_LOOK[mode][0] for mode in CollapseMode]
    return deaggregate(results.verdict, results.collapse_mode, names, confidence=confidence)


def by_joint(results: ArchResults, n_joint: int, confidence: float) -> Deaggregation:
    """Collapses by the joint that was lost: those lost most often, and the others together."""
    fell = results.collapses_by_joint(n_joint).sum(axis=(1, 2))
    order = np.argsort(-fell, kind="stable")
    own = np.sort(order[: np.count_nonzero(fell)][:_MOST_JOINTS])
    category = np.full(results.collapse_joint.shape, own.size)
    for place, joint in enumerate(own):
        category[results.collapse_joint == joint] = place
    names = [*(f"joint {joint}" for joint in own), _OTHER]
    return deaggregate(results.verdict, category, names, confidence=confidence)


def by_impacts(results: ArchResults, confidence: float) -> Deaggregation:
    """Collapses by the number of joints that had closed until then."""
    category = np.searchsorted(_IMPACT_BOUNDS, results.impacts, side="right")
    return deaggregate(results.verdict, category, IMPACTS, confidence=confidence)


def shares(groups: Sequence[Deaggregation], results: ArchResults, name: str) -> Picture | None:
    """Observed fraction of collapses at each level, split three ways; None if none collapsed.

    Parameters
    ----------
    groups : sequence of Deaggregation
        By mode, by joint and by impacts.
    results : ArchResults
    name : str
        Unique on the page.
    """
    if not groups[0].collapsed.any():
        return None

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(groups), sharey=True)
        titles = ("how it was moving", "joint that was lost", "joints closed by then")
        for i, (axes, group, title) in enumerate(zip(panels, groups, titles, strict=True)):
            _stack(axes, group)
            axes.set_title(title)
            axes.set(xlabel=results.scale.label, ylim=(0.0, 1.0), xlim=(-0.6, group.n.size - 0.4))
            level_ticks(axes, results.levels, most=4)
            faint_grid(axes, "y")
            if i == 0:
                axes.set_ylabel("share of the runs that decide")

    return picture(
        name, (canvas.WIDTH, 3.3), draw,
        alternative=f"Fraction of collapses of {results.arch} by level, split by mode, by joint "
        "and by impacts",
        caption="Each column is the observed fraction of collapses at a level, split by how the "
        "joint that lost all contact had been moving, by which joint that was, and by how many "
        "joints had closed with an impact since the start of the run.",
    )  # fmt: skip


def table(groups: Sequence[Deaggregation], results: ArchResults) -> Table:
    """Collapses of each category at each level, and their share of all with its interval."""
    percent = f"{100 * groups[0].confidence:.0f} %"
    levels = map(digits, results.levels)
    heads = ["collapses", "all levels", "share", f"{percent} interval", *levels]
    everything = groups[0].collapsed
    rows = [["all", str(everything.sum()), "", "", *map(str, everything)]]
    for group in groups:
        for i, category in enumerate(group.categories):
            if group.counts[i].any():
                ends = f"{group.overall_lower[i]:.2f} – {group.overall_upper[i]:.2f}"
                total, share = str(group.counts[i].sum()), f"{group.overall[i]:.2f}"
                rows.append([category, total, share, ends, *map(str, group.counts[i])])
    return Table(heads, rows)


def _stack(axes: Axes, group: Deaggregation) -> None:
    base = np.zeros(group.n.size)
    probability = np.nan_to_num(group.probability)
    for i, category in enumerate(group.categories):
        if not group.counts[i].any():
            continue
        colour, hatch = _look(category, i)
        axes.bar(
            np.arange(base.size), probability[i], bottom=base, width=0.85, label=category,
            facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0.4,
        )  # fmt: skip
        base += probability[i]
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.22), borderaxespad=0.0, handlelength=1.6
    )


def _look(category: str, place: int) -> tuple[str, str]:
    if category == _OTHER:
        return _LOOKS[-1]
    modes = {look[0]: (look[1], look[2]) for look in MODE_LOOK.values()}
    return modes.get(category, _LOOKS[place % len(_LOOKS)])
