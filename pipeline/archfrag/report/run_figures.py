"""Figures of runs: verdicts, rotations (IDA curves), mechanisms, and the log of one run."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from archfrag.arch import Arch
from archfrag.fragility.curve import FloatArray, IntArray
from archfrag.fragility.risk import Contributions, contributions
from archfrag.fragility.verdicts import Verdict
from archfrag.report.film import Example, draw_ground
from archfrag.report.html import TEXTS, digits
from archfrag.report.inputs import ArchResults
from archfrag.report.limits import base_of
from archfrag.report.svg import (
    BELOW,
    BLUE,
    GREEN,
    GREY,
    INK,
    LEFT,
    LINE,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    VERMILION,
    Entry,
    Panel,
    Sheet,
    Words,
    even_ticks,
    figure,
    legend_rows,
    log_ticks,
    panel_below,
    shortened,
    text_width,
    tick_label,
)
from archfrag.simulation.response import MechanismChange

VERDICTS = {
    Verdict.SURVIVED: Entry("survived", "#cfe0ee"),
    Verdict.COLLAPSED: Entry("collapsed", VERMILION),
    Verdict.UNFINISHED: Entry("unfinished", "#d9b310", "slash"),
    Verdict.FAILED: Entry("failed", INK),
    Verdict.COLLAPSED_BEFORE: Entry("collapsed in the first shock", ORANGE, "dots"),
}
MODES = (  # by code of `CollapseMode`
    Entry("mode not known", GREY),
    Entry("hinging", BLUE),
    Entry("sliding", ORANGE, "slash"),
    Entry("lift-off", GREEN, "dots"),
    Entry("overturning", PURPLE, "cross"),
)
LOOKS = (
    (BLUE, "area"),
    (ORANGE, "slash"),
    (GREEN, "dots"),
    (PURPLE, "cross"),
    (VERMILION, "slash"),
    (SKY, "area"),
    (INK, "area"),
    (GREY, "area"),
)
_SIDES = {"intrados": BLUE, "extrados": VERMILION, "right": SKY, "left": PURPLE}
# States of a joint, in words of the log, from code 1; a closed joint that sticks is not drawn.
JOINT_STATES = (
    *(
        Entry(f"hinge {side}{slides}", colour, mark)
        for slides, mark in (("", "area"), (" sliding", "slash"))
        for side, colour in _SIDES.items()
    ),
    Entry("slides", ORANGE, "cross"),
    Entry("open", INK),
)
_LABELLED = 60  # records that have their names written
_MOST_JOINTS = 4
_BINS = 600  # of the log
MEASURED = {
    "peak_rotation": "peak rotation [°]",
    "residual_rotation": "residual rotation [°]",
}


def level_axis(panel: Panel, levels: FloatArray, title: str) -> None:
    """Draw the horizontal axis of a panel whose columns 0, 1, 2, ... stand for levels.

    Ticks are at round numbers, whose places between levels are interpolated in logarithms.
    """
    most = min(10, max(2, int((panel.box[2] - panel.box[0]) / 38.0)))
    values = np.empty(0)
    logs = np.log(levels)
    if levels.size > 1:
        even, log = (np.std(x) / np.mean(x) for x in map(np.diff, (levels, logs)))
        ends = levels[0], levels[-1]
        values = log_ticks(*ends) if log < even else even_ticks(*ends, most)
    if values.size < 2:
        values = levels
    places = np.interp(np.log(values), logs, np.arange(levels.size))
    labels = [tick_label(float(digits(value))) for value in values]
    panel.axis_x(title, ticks=places, labels=labels)


@figure
def verdict_map(sheet: Sheet, results: ArchResults) -> Words:
    """Draw the verdict of every run: records down, levels to the right."""
    collapsed = results.verdict == Verdict.COLLAPSED
    n_record, n_level = collapsed.shape
    lowest = np.where(collapsed.any(axis=1), collapsed.argmax(axis=1), n_level)
    order = np.lexsort((collapsed.sum(axis=1), -lowest))
    rows = results.verdict[order]
    names = [results.records[i] for i in order]
    entries = [entry for code, entry in VERDICTS.items() if np.any(rows == code)]
    if not results.simulated.all():
        entries.append(Entry("blank: not run", "#ffffff"))
    bounded = bool(np.isfinite(results.capacities).any())
    if bounded:
        entries.append(Entry("capacity", INK, "line"))
    labelled = n_record <= _LABELLED
    longest = max(text_width(name, SMALL) for name in names)
    left = min(longest + 12.0, 0.36 * sheet.width) if labelled else LEFT
    height = (14.0 if labelled else min(14.0, 620.0 / n_record)) * n_record
    ends = (-0.5, n_level - 0.5), (n_record - 0.5, -0.5)
    panel = panel_below(sheet, entries, height, *ends, left=left)
    for code, (_, colour, mark) in VERDICTS.items():
        panel.cells(rows == code, colour, mark, half=0.45 if labelled else 0.5)
    for edge in np.arange(1, n_level) - 0.5:
        panel.line([edge, edge], ends[1], "#fff", 1.0)
    if bounded:
        capacities = results.capacities[order]
        levels = np.log(results.levels)
        at = np.arange(n_level)
        x = np.interp(np.log(capacities), levels, at, right=n_level - 0.5)
        x = np.where(capacities <= results.levels[0], -0.5, x)
        y = np.repeat(np.arange(n_record + 1), 2)[1:-1] - 0.5
        panel.line(np.repeat(x, 2), y, INK, 1.4)
    for y, name in zip(panel.at_y(np.arange(n_record)), names if labelled else ()):
        sheet.text(left - 5.0, y + 3.5, shortened(name, left - 12.0, SMALL), "s e")
    level_axis(panel, results.levels, results.scale.label)
    texts = TEXTS["verdict_map"]
    words = f"Verdicts of {results.arch} for {n_record} records at {n_level} levels"
    return words, texts["caption"] + texts["capacity"] * bounded


@figure
def single_runs(sheet: Sheet, results: ArchResults) -> Words:
    """Draw the verdict and the largest displacement of runs that each have their own intensity."""
    assert results.own_levels is not None
    run = results.simulated.any(axis=1)
    level = results.own_levels[run]
    verdict = np.where(results.simulated, results.verdict, 0).sum(axis=1)[run]
    reach = results["peak_displacement"].sum(axis=1)[run]
    looks = {code: entry._replace(mark="dot") for code, entry in VERDICTS.items()}
    looks[Verdict.SURVIVED] = Entry("survived", SKY, "dot")
    entries = [entry for code, entry in looks.items() if np.any(verdict == code)]
    low = 1e-4
    high = 10.0 ** np.ceil(np.log10(max(np.nanmax(reach), 1e-3)))
    x = 0.95 * level.min(), 1.05 * level.max()
    panel = panel_below(sheet, entries, 220.0, x, (low, high), left=56.0, log=True)
    panel.axis_x(results.scale.label, grid=True)
    panel.axis_y("largest displacement [m]", ticks=log_ticks(low, high, (1.0,)))
    for code, (_, colour, _) in looks.items():
        chosen = verdict == code
        panel.dots(level[chosen], np.clip(reach[chosen], low, high), colour, radius=2.6)
    words = f"{level.size} runs of {results.arch}: intensity, largest displacement and verdict"
    return words, TEXTS["single_runs"]["caption"].format(low=low)


@figure
def ida_curves(sheet: Sheet, results: ArchResults) -> str | None:
    """Draw largest rotations of each record against intensity; None if no run survived.

    Each line goes flat at the capacity of its record. Between the levels that were run it is
    interpolated.
    """
    survived = results.verdict == Verdict.SURVIVED
    if results.own_levels is not None or not survived.any():
        return None
    levels = results.levels
    capacities = results.capacities
    median = Entry("median", BLUE, "line")
    fractile = Entry("16 and 84 %", BLUE, "dash")
    entries = [Entry("a record", GREY, "line"), median, fractile]
    top = sheet.legend(LEFT, 0.0, entries)
    boxes = sheet.grid(len(MEASURED), 2, 260.0, BELOW)
    sheet.height += top
    highest = 1.05 * levels.max()
    for (name, title), (left, up, right, down) in zip(MEASURED.items(), boxes):
        degrees = np.rad2deg(results[name])
        curves = np.full(degrees.shape, np.nan)
        for row, used in enumerate(survived & (levels < capacities[:, None])):
            if used.any():
                x = np.append(0.0, levels[used])
                y = np.append(0.0, degrees[row, used])
                curves[row] = np.interp(levels, x, y)
        curves = np.where(levels > capacities[:, None], np.inf, curves)
        reach = 1.15 * np.max(curves, initial=1e-6, where=np.isfinite(curves))
        ends = (0.0, reach), (0.0, highest)
        panel = Panel(sheet, (left, up + top, right, down + top), *ends)
        panel.axis_x(title, 5, grid=True)
        panel.axis_y(results.scale.label)
        for line, end in zip(curves, capacities.tolist()):
            panel.line(*ida_line(levels, line, end, reach), GREY, 0.7)
        strokes = (1.3, fractile.dash), (2.0, ""), (1.3, fractile.dash)
        for (line, end), stroke in zip(fractiles(curves, capacities), strokes):
            panel.line(*ida_line(levels, line, end, reach), BLUE, *stroke)
    return f"Peak and residual rotation of {results.arch} against {results.scale.label}"


def fractiles(
    curves: FloatArray, capacities: FloatArray
) -> list[tuple[FloatArray, float]]:
    """Return the 16, 50 and 84 % fractiles of rotations, each with the level where it ends.

    `curves` are the rotations, (n_record, n_level); `capacities` are (n_record,).
    """
    ranked = np.sort(np.where(np.isnan(curves), np.inf, curves), axis=0)
    ends = np.sort(capacities)
    count = len(ranked)
    # The 84 % fractile of demand ends at the 16 % fractile of capacity.
    return [
        (
            ranked[min(int(part * count), count - 1)],
            float(ends[min(int((1.0 - part) * count), count - 1)]),
        )
        for part in (0.16, 0.5, 0.84)
    ]


def ida_line(
    levels: FloatArray, row: FloatArray, capacity: float, right: float
) -> tuple[FloatArray, FloatArray]:
    """Return x and y of a line from the origin, which goes flat to `right` at the capacity.

    `row` has the rotation at each level. Without a finite `capacity` there is no flat part.
    """
    seen = np.isfinite(row)
    x = np.append(0.0, row[seen])
    y = np.append(0.0, levels[seen])
    if np.isfinite(capacity):
        x = np.append(x, [x[-1], right])
        y = np.append(y, [capacity, capacity])
    return x, y


def groupings(
    results: ArchResults, confidence: float, arch: Arch
) -> list[Contributions]:
    """Split the collapses by mode, by the joint that was lost, and by its span or pier."""
    lost = results["collapse_joint"]
    collapsed = results.verdict == Verdict.COLLAPSED
    counted = Counter(np.sort(lost[collapsed]).tolist())
    commonest = sorted(joint for joint, _ in counted.most_common(_MOST_JOINTS))
    joint = np.where(
        np.isin(lost, commonest), np.searchsorted(commonest, lost), len(commonest)
    )
    modes = results["collapse_mode"], [mode.label for mode in MODES]
    joints = joint, [*map(arch.place, commonest), "other joints"]
    of_joint = {j: i for i, part in enumerate(arch.parts) for j in part.joints}
    part = np.array([*map(of_joint.get, range(arch.n_joint)), -1])[lost]
    parts = part, [each.name for each in arch.parts]
    group = results.runs.group
    return [
        contributions(collapsed, labels, names, confidence=confidence, groups=group)
        for labels, names in (modes, joints, parts)[: 3 if arch.places else 2]
    ]


@figure
def fractions(
    sheet: Sheet, groups: Sequence[Contributions], results: ArchResults, base: str
) -> Words:
    """Draw the fraction of collapses at each level, split by mode, by joint and by part.

    `groups` is from `groupings`; `base` names joint 0 in the caption.
    """
    every = bool(results.simulated.all())
    divisor = np.maximum(results.counts["n" if every else "collapsed"], 1)
    stacks = [stacked(group.categories, group.counts / divisor) for group in groups]
    keys = [[entry for entry, _ in parts] for parts in stacks]
    left, _, right, _ = sheet.grid(len(keys), 2, 150.0, BELOW)[0]
    rows = 1 + max(legend_rows(key, right - left)[-1][0] for key in keys)
    boxes = sheet.grid(len(keys), 2, 150.0, BELOW + rows * LINE)
    titles = "how it was moving", "joint that was lost", "span or pier of this joint"
    for box, parts, key, title in zip(boxes, stacks, keys, titles):
        panel = Panel(sheet, box, (-0.5, results.levels.size - 0.5), (0.0, 1.0))
        what = "runs" if every else "collapses"
        panel.axis_y(f"fraction of the {what}", 4)
        panel.stack(parts)
        level_axis(panel, results.levels, results.scale.label)
        panel.heading(title)
        sheet.legend(box[0], box[3] + 35.0, key, right - left)
    texts = TEXTS["fractions"]
    more = texts["parts"] * (len(groups) > 2)
    caption = texts["runs" if every else "collapses"]
    caption += texts["split"].format(base=base, parts=more)
    return (
        f"Fraction of collapses of {results.arch} by level, split by mode and by joint",
        caption,
    )


def stacked(names: Sequence[str], values: FloatArray) -> list[tuple[Entry, FloatArray]]:
    """Return the categories that occur, each with its style and its values at each level."""
    looks = {entry.label: entry for entry in MODES}
    for i, name in enumerate(names):
        colours = LOOKS[-1] if name.startswith("other") else LOOKS[i % len(LOOKS)]
        looks.setdefault(name, Entry(name, *colours))
    return [(looks[name], part) for name, part in zip(names, values) if part.any()]


@figure
def timeline(sheet: Sheet, example: Example) -> Words | None:
    """Draw the ground motion and the joints of a run over time; None if nothing moved."""
    changes = example.response.mechanism or ()
    response = example.response
    # Entries that last, or last for a time not known, in another model than rest.
    moving = [c for c in changes if c.model != "rest" and not c.until <= c.time]
    if not moving:
        return None
    first = moving[0].time
    last = moving[-1].until
    last = last if np.isfinite(last) else response.end_time
    margin = 0.03 * max(last - first, 1e-3)
    start = max(0.0, first - margin)
    end = min(response.end_time, last + margin)
    edges = np.linspace(start, end, _BINS + 1)
    n_joint = example.arch.n_joint
    rows = [joint for part in example.arch.parts for joint in part.joints]
    joints = sampled(changes, n_joint, edges)[:, rows]
    states = [
        (k, s) for k, s in enumerate(JOINT_STATES, start=1) if np.any(joints == k)
    ]
    top = sheet.legend(LEFT, 0.0, [entry for _, entry in states]) + LINE + 4.0
    right = sheet.width - 10.0
    height = np.clip(15.0 * n_joint, 70.0, 400.0)
    upper = Panel(sheet, (LEFT, top, right, top + 62.0), (start, end), (-1.0, 1.0))
    draw_ground(upper, example, 300)
    upper.axis_y("ground [g]", 4)
    ended = response.status.name.lower().replace("_", " ")
    if response.collapsed:
        ended = (
            f"contact lost at {response.collapse_time:.2f} s, {response.collapse_place}"
        )
    sheet.text(LEFT, top - 6.0, f"{example.level}: {ended}", "b")
    box = LEFT, top + 72.0, right, top + 72.0 + height
    middle = Panel(sheet, box, (start, end), (-0.6, n_joint - 0.4))
    step = max(1, -(-n_joint // int(height / 13.0)))
    if example.arch.places:
        sizes = np.array([len(part.joints) for part in example.arch.parts])
        ticks = np.cumsum(sizes) - 0.5 * sizes - 0.5
        middle.axis_y(ticks=ticks, labels=[part.name for part in example.arch.parts])
    else:
        middle.axis_y("joint", ticks=np.arange(0, n_joint, step))
    for k, (_, colour, mark) in states:
        middle.cells((joints == k).T, colour, mark, edges, 0.4)
    middle.axis_x("time [s]", 9)
    if response.collapsed:
        line = f"M{float(middle.at_x(response.collapse_time)):.1f} {top:.1f}V{middle.box[3]:.1f}"
        sheet.path(line, stroke=INK, stroke_dasharray="4 2")
    sheet.height = middle.box[3] + BELOW
    texts = TEXTS["timeline"]
    about = {"level": example.level, "reason": example.reason}
    motion = example.motion.id
    base = base_of(example.arch)
    caption = texts["caption"].format(motion=motion, base=base, **about)
    caption += texts["differs"] * (not example.same)
    return (
        f"Mechanism over time under {motion}: hinges, sliding and open joints",
        caption,
    )


def sampled(
    changes: Sequence[MechanismChange], n_joint: int, edges: FloatArray
) -> IntArray:
    """Return the states of the joints at the middle of each bin of time, (n_bin, n_joint)."""
    codes = {entry.label: code for code, entry in enumerate(JOINT_STATES, start=1)}
    states = np.zeros((len(changes), n_joint), dtype=np.int64)
    for i, change in enumerate(changes):
        for joint, text in change.joints.items():
            states[i, joint] = codes[text.split(" towards ")[0]]
    middle = 0.5 * (edges[:-1] + edges[1:])
    since = (
        np.searchsorted([change.time for change in changes], middle, side="right") - 1
    )
    return states[np.maximum(since, 0)]
