"""Runs of an arch: their verdicts, how, where and after how many impacts it fell, what ran."""

from collections.abc import Sequence

import numpy as np

from archfrag.fragility.contributions import Deaggregation, deaggregate
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode, Model
from archfrag.report import picture as look
from archfrag.report.picture import BELOW, LINE, SMALL, FloatArray, Picture, number
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults
from archfrag.simulation.mechanism import MODEL_WORDS

VERDICT_LOOK = {
    Verdict.STANDING: Entry("standing", "#cfe0ee"),
    Verdict.COLLAPSED: Entry("collapsed", look.VERMILION),
    Verdict.UNFINISHED: Entry("unfinished", "#d9b310", "slash"),
    Verdict.SOLVER_FAILURE: Entry("solver failure", look.INK),
}
MODE_LOOK = {
    CollapseMode.HINGING: Entry("hinging", look.BLUE),
    CollapseMode.SLIDING: Entry("sliding", look.ORANGE, "slash"),
    CollapseMode.LIFT_OFF: Entry("lift-off", look.GREEN, "dots"),
    CollapseMode.OVERTURNING: Entry("overturning", look.PURPLE, "cross"),
    CollapseMode.NONE: Entry("mode not known", look.GREY),
}
_LABELLED = 60  # records that have their names beside them

IMPACTS = ("no impact", "1 impact", "2 to 9 impacts", "10 to 99 impacts", "100 or more impacts")
_IMPACT_BOUNDS = (1, 2, 10, 100)
_OTHER = "other joints"
_MOST_JOINTS = 4
LOOKS = (
    (look.BLUE, "area"), (look.ORANGE, "slash"), (look.GREEN, "dots"), (look.PURPLE, "cross"),
    (look.VERMILION, "slash"), (look.SKY, "area"), (look.INK, "area"), (look.GREY, "area"),
)  # fmt: skip
_TITLES = ("how it was moving", "joint that was lost", "joints closed by then")
MODEL_LOOK = {
    Model.REST: Entry(MODEL_WORDS[Model.REST], look.PALE),
    Model.FOUR_HINGES: Entry(MODEL_WORDS[Model.FOUR_HINGES], look.SKY),
    Model.MEGA_VOUSSOIRS: Entry(MODEL_WORDS[Model.MEGA_VOUSSOIRS], look.GREEN, "dots"),
    Model.ALL_VOUSSOIRS: Entry(MODEL_WORDS[Model.ALL_VOUSSOIRS], look.PURPLE, "slash"),
}


def verdict_map(results: ArchResults) -> Picture:
    """Verdict of every run: records down, levels across."""
    fell = results.verdict == Verdict.COLLAPSED
    capacity = np.where(fell.any(axis=1), fell.argmax(axis=1), fell.shape[1])
    order = np.lexsort((fell.sum(axis=1), -capacity))
    rows = results.verdict[order]
    names = [results.records[i] for i in order]
    entries = [VERDICT_LOOK[v] for v in VERDICT_LOOK if np.any(rows == v)]
    if not results.simulated.all():
        entries.append(Entry("blank: not simulated", "#ffffff"))

    def draw(sheet: Sheet) -> None:
        labelled = len(names) <= _LABELLED
        longest = max(look.text_width(name, SMALL) for name in names)
        left = min(longest + 12.0, 0.36 * sheet.width) if labelled else 26.0
        top = sheet.legend(left, 0.0, entries, sheet.width - left - 8.0) + 2.0
        bottom = top + (14.0 if labelled else min(14.0, 620.0 / len(names))) * len(names)
        panel = Panel(
            sheet, (left, top, sheet.width - 8.0, bottom), (-0.5, rows.shape[1] - 0.5),
            (len(names) - 0.5, -0.5),
        )  # fmt: skip
        for code, (_, colour, mark) in VERDICT_LOOK.items():
            panel.cells(rows == code, colour, mark, half=0.45 if labelled else 0.5)
        lines = "".join(
            f"M{number(x)} {number(top)}V{number(bottom)}"
            for x in panel.at_x(np.arange(1, rows.shape[1]) - 0.5)
        )
        sheet.path(lines, stroke="#fff", stroke_width=1)
        if labelled:
            for y, name in zip(panel.at_y(np.arange(len(names))), names, strict=True):
                sheet.text(left - 5.0, y + 3.5, look.shortened(name, left - 12.0, SMALL), "s e")
        else:
            words = f"{len(names)} records, most fragile at the bottom"
            sheet.text(left - 8.0, 0.5 * (top + bottom), words, "m", angle=-90)
        panel.level_axis(results.levels, results.scale.label)
        sheet.height = bottom + BELOW

    return picture(
        draw,
        alternative=f"Verdicts of {results.arch} for {len(names)} records at {rows.shape[1]} "
        "levels",
    )


def scattered_runs(results: ArchResults) -> Picture:
    """Every run where each has an intensity of its own: its largest displacement, its verdict."""
    assert results.own_levels is not None
    run = results.simulated.any(axis=1)
    level = results.own_levels[run]
    verdict = np.where(results.simulated, results.verdict, 0).sum(axis=1)[run]
    reach = results["peak_displacement"].sum(axis=1)[run]
    moved = np.isfinite(reach) & (reach > 0.0)
    looks = {code: entry._replace(mark="dot") for code, entry in VERDICT_LOOK.items()}
    looks[Verdict.STANDING] = Entry("standing", look.SKY, "dot")
    entries = [entry for code, entry in looks.items() if np.any(verdict == code)]
    seen = reach[moved] if moved.any() else np.array([1e-3, 1.0])
    low = float(10.0 ** np.floor(np.log10(max(seen.min(), 1e-6))))
    high = max(float(10.0 ** np.ceil(np.log10(seen.max()))), 10.0 * low)
    x = 0.95 * float(level.min()), 1.05 * float(level.max())

    def draw(sheet: Sheet) -> None:
        panel = sheet.below_legend(entries, 220.0, x, (low, high), left=56.0, log=True)
        panel.axis_x(look.log_ticks(*x), results.scale.label, grid=True)
        panel.axis_y(look.log_ticks(low, high, subs=(1.0,)), "largest displacement [m]")
        for code, (_, colour, _) in looks.items():
            own = verdict == code
            height = np.clip(np.where(moved, reach, low), low, high)
            panel.dots(level[own], height[own], colour, radius=2.6)

    return picture(
        draw,
        alternative=f"{level.size} runs of {results.arch}: intensity, largest displacement and "
        "verdict",
        caption="Every run: the largest displacement of a voussoir against the run's own "
        f"intensity. What moved by less than {low:g} m is shown there.",
    )


def groupings(results: ArchResults, confidence: float) -> list[Deaggregation]:
    """Collapses by mode, by the joint that was lost, and by the joints that had closed by then."""
    lost = results["collapse_joint"]
    fell = np.bincount(np.maximum(lost[results.verdict == Verdict.COLLAPSED], 0), minlength=1)
    order = np.argsort(-fell, kind="stable")
    own = np.sort(order[: np.count_nonzero(fell)][:_MOST_JOINTS])
    joint = np.full(lost.shape, own.size)
    for place, each in enumerate(own):
        joint[lost == each] = place
    modes = [MODE_LOOK[mode].label for mode in CollapseMode]
    impacts = np.searchsorted(_IMPACT_BOUNDS, results["impacts"], side="right")
    return [
        deaggregate(results.verdict, category, names, confidence=confidence)
        for category, names in (
            (results["collapse_mode"], modes),
            (joint, [*(f"joint {each}" for each in own), _OTHER]),
            (impacts, IMPACTS),
        )
    ]


def fractions(groups: Sequence[Deaggregation], results: ArchResults) -> Picture | None:
    """Fraction of collapses at each level, split by three criteria; None if none collapsed.

    Of all runs where every record was run at every level, else of the collapses.
    """
    if not groups[0].collapsed.any():
        return None
    every = not bool((results.verdict == Verdict.NOT_SIMULATED).any())
    stacks = [_parts(group, every) for group in groups]
    keys = [[entry for entry, _ in parts] for parts in stacks]

    def draw(sheet: Sheet) -> None:
        first = sheet.panes(len(groups), 0.0, 150.0)[0][0]
        rows = max(sheet.legend_rows(key, first[2] - first[0]) for key in keys)
        gap = 10.0 + rows * LINE if sheet.narrow else 10.0
        boxes, end = sheet.panes(len(groups), 0.0, 150.0, gap)
        sheet.height = end + rows * LINE
        for box, parts, key, title in zip(boxes, stacks, keys, _TITLES, strict=True):
            panel = Panel(sheet, box, (-0.5, results.levels.size - 0.5), (0.0, 1.0))
            panel.axis_y(
                [0.0, 0.25, 0.5, 0.75, 1.0], f"fraction of the {'runs' if every else 'collapses'}"
            )
            panel.stack(parts)
            panel.level_axis(results.levels, results.scale.label)
            panel.heading(title)
            sheet.legend(box[0], box[3] + 35.0, key, box[2] - box[0])

    return picture(
        draw,
        alternative=f"Fraction of collapses of {results.arch} by level, split by mode, by joint "
        "and by impacts",
    )


def _parts(group: Deaggregation, every: bool) -> list[tuple[Entry, FloatArray]]:
    """Categories that occur: how they look, and their fraction at each level, as `fractions`."""
    modes = {entry.label: entry for entry in MODE_LOOK.values()}
    found = []
    for i in np.flatnonzero(group.counts.any(axis=1)).tolist():
        name = group.categories[i]
        colours = LOOKS[-1] if name == _OTHER else LOOKS[i % len(LOOKS)]
        part = group.counts[i] / np.maximum(group.collapsed, 1)
        if every:
            part = np.nan_to_num(group.probability[i])
        found.append((modes.get(name, Entry(name, *colours)), part))
    return found
