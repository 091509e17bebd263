"""Verdicts by mechanism: how, where and after how many impacts the arch collapsed."""

from collections.abc import Sequence

import numpy as np

from archfrag.fragility.contributions import Deaggregation, deaggregate
from archfrag.mechanics.status import CollapseMode
from archfrag.report import picture as look
from archfrag.report.axes import digits
from archfrag.report.figures import MODE_LOOK
from archfrag.report.picture import LINE, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults
from archfrag.report.tables import Table

IMPACTS = ("no impact", "1 impact", "2 to 9 impacts", "10 to 99 impacts", "100 or more impacts")
_IMPACT_BOUNDS = (1, 2, 10, 100)
_OTHER = "other joints"
_MOST_JOINTS = 4
_LOOKS = (
    (look.BLUE, ""), (look.ORANGE, "slash"), (look.GREEN, "dots"), (look.PURPLE, "cross"),
    (look.GREY, ""),
)  # fmt: skip
_TITLES = ("how it was moving", "joint that was lost", "joints closed by then")


def by_mode(results: ArchResults, confidence: float) -> Deaggregation:
    """Collapses by how the joint that was lost had been moving, codes of `CollapseMode`."""
    names = [MODE_LOOK[mode][0] for mode in CollapseMode]
    return deaggregate(
        results.decided_or_neither, results.collapse_mode, names, confidence=confidence
    )


def by_joint(results: ArchResults, n_joint: int, confidence: float) -> Deaggregation:
    """Collapses by the joint that was lost: those lost most often, and the others together."""
    fell = results.collapses_by_joint(n_joint).sum(axis=(1, 2))
    order = np.argsort(-fell, kind="stable")
    own = np.sort(order[: np.count_nonzero(fell)][:_MOST_JOINTS])
    category = np.full(results.collapse_joint.shape, own.size)
    for place, joint in enumerate(own):
        category[results.collapse_joint == joint] = place
    names = [*(f"joint {joint}" for joint in own), _OTHER]
    return deaggregate(results.decided_or_neither, category, names, confidence=confidence)


def by_impacts(results: ArchResults, confidence: float) -> Deaggregation:
    """Collapses by the number of joints that had closed until then."""
    category = np.searchsorted(_IMPACT_BOUNDS, results.impacts, side="right")
    return deaggregate(results.decided_or_neither, category, IMPACTS, confidence=confidence)


def fractions(groups: Sequence[Deaggregation], results: ArchResults) -> Picture | None:
    """Fraction of collapses at each level, split by three criteria; None if none collapsed."""
    if not groups[0].collapsed.any():
        return None
    keys = [_key(group) for group in groups]

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        first = sheet.panes(len(groups), 0.0, 150.0)[0][0]
        rows = max(sheet.legend_rows(key, first[2] - first[0]) for key in keys)
        gap = 10.0 + rows * LINE if sheet.narrow else 10.0
        boxes, end = sheet.panes(len(groups), 0.0, 150.0, gap)
        sheet.height = end + rows * LINE
        for box, group, key, title in zip(boxes, groups, keys, _TITLES, strict=True):
            panel = Panel(sheet, box, (-0.5, group.n.size - 0.5), (0.0, 1.0))
            panel.axis_y([0.0, 0.25, 0.5, 0.75, 1.0], "fraction of the runs")
            _stack(panel, group)
            panel.level_axis(results.levels, results.scale.label)
            panel.heading(title)
            sheet.legend(box[0], box[3] + 35.0, key, box[2] - box[0])
        return sheet

    return picture(
        draw,
        alternative=f"Fraction of collapses of {results.arch} by level, split by mode, by joint "
        "and by impacts",
        caption="Each column is the observed fraction of collapses at a level, among the runs "
        "that collapsed or stood, split by how the joint that lost all contact had been moving, "
        "by which joint that was, and by how many joints had closed with an impact since the "
        "start of the run.",
    )


def table(groups: Sequence[Deaggregation], results: ArchResults) -> Table:
    """Collapses of each category at each level, and their fraction of all with its interval."""
    percent = f"{100 * groups[0].confidence:.0f} %"
    levels = map(digits, results.levels)
    heads = ["collapses", "all levels", "fraction", f"{percent} interval", *levels]
    everything = groups[0].collapsed
    rows = [["all", str(everything.sum()), "", "", *map(str, everything)]]
    for group in groups:
        for i, category in enumerate(group.categories):
            if group.counts[i].any():
                ends = f"{group.overall_lower[i]:.2f} – {group.overall_upper[i]:.2f}"
                total, fraction = str(group.counts[i].sum()), f"{group.overall[i]:.2f}"
                rows.append([category, total, fraction, ends, *map(str, group.counts[i])])
    return Table(heads, rows)


def _stack(panel: Panel, group: Deaggregation) -> None:
    base = np.zeros(group.n.size)
    probability = np.nan_to_num(group.probability)
    for i, category in enumerate(group.categories):
        here = np.flatnonzero(probability[i])
        if here.size:
            colour, hatch = _look(category, i)
            top = base[here] + probability[i, here]
            panel.boxes(here - 0.42, here + 0.42, base[here], top, colour, hatch)
            base += probability[i]


def _key(group: Deaggregation) -> list[Entry]:
    found = []
    for i, category in enumerate(group.categories):
        if group.counts[i].any():
            colour, hatch = _look(category, i)
            found.append(Entry(category, colour, hatch or "area"))
    return found


def _look(category: str, place: int) -> tuple[str, str]:
    if category == _OTHER:
        return _LOOKS[-1]
    modes = {name: (colour, hatch) for name, colour, hatch in MODE_LOOK.values()}
    return modes.get(category, _LOOKS[place % len(_LOOKS)])
