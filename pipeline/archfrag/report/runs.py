"""Figures of runs: verdicts and mechanisms; what capacities follow: measures, parameters."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.contributions import Deaggregation, deaggregate
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.report import drawing as look
from archfrag.report.axes import Panel, even_ticks, log_ticks, panel_below
from archfrag.report.curves import efficient_first
from archfrag.report.drawing import BELOW, BESIDE, LINE, SMALL, Entry, FloatArray, Sheet, figure
from archfrag.report.results import ArchResults, Scale, digits
from archfrag.study.answer.curves import Answer

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
LOOKS = (
    (look.BLUE, "area"), (look.ORANGE, "slash"), (look.GREEN, "dots"), (look.PURPLE, "cross"),
    (look.VERMILION, "slash"), (look.SKY, "area"), (look.INK, "area"), (look.GREY, "area"),
)  # fmt: skip
_LABELLED = 60  # records that have their names beside them
IMPACTS = ("no impact", "1 impact", "2 to 9 impacts", "10 to 99 impacts", "100 or more impacts")
_IMPACT_BOUNDS = (1, 2, 10, 100)
_OTHER = "other joints"
_MOST_JOINTS = 4
_TITLES = ("how it was moving", "joint that was lost", "joints closed by then")
MOST_PANELS, MOST_TEXTS = 9, 7
_HIGH = 150.0  # of a panel [px]


def level_axis(panel: Panel, levels: FloatArray, title: str) -> None:
    """Labels under cells that stand for levels, the first always among them."""
    most = max(2, int((panel.box[2] - panel.box[0]) / 38.0))
    ticks = np.arange(0, levels.size, max(1, -(-levels.size // most)))
    panel.axis_x(ticks, title, [digits(levels[i]) for i in ticks])


@figure
def verdict_map(sheet: Sheet, results: ArchResults) -> tuple[str, str]:
    """Verdict of every run: records down, levels across."""
    fell = results.verdict == Verdict.COLLAPSED
    capacity = np.where(fell.any(axis=1), fell.argmax(axis=1), fell.shape[1])
    order = np.lexsort((fell.sum(axis=1), -capacity))
    rows = results.verdict[order]
    names = [results.records[i] for i in order]
    entries = [VERDICT_LOOK[v] for v in VERDICT_LOOK if np.any(rows == v)]
    if not results.simulated.all():
        entries.append(Entry("blank: not simulated", "#ffffff"))
    labelled = len(names) <= _LABELLED
    longest = max(look.text_width(name, SMALL) for name in names)
    left = min(longest + 12.0, 0.36 * sheet.width) if labelled else 26.0
    top = sheet.legend(left, 0.0, entries, sheet.width - left - 8.0) + 2.0
    bottom = top + (14.0 if labelled else min(14.0, 620.0 / len(names))) * len(names)
    box, x = (left, top, sheet.width - 8.0, bottom), (-0.5, rows.shape[1] - 0.5)
    panel = Panel(sheet, box, x, (len(names) - 0.5, -0.5))
    for code, (_, colour, mark) in VERDICT_LOOK.items():
        panel.cells(rows == code, colour, mark, half=0.45 if labelled else 0.5)
    edges = panel.at_x(np.arange(1, rows.shape[1]) - 0.5)
    lines = "".join(f"M{edge:.1f} {top:.1f}V{bottom:.1f}" for edge in edges)
    sheet.path(lines, stroke="#fff", stroke_width=1)
    if labelled:
        for y, name in zip(panel.at_y(np.arange(len(names))), names, strict=True):
            sheet.text(left - 5.0, y + 3.5, look.shortened(name, left - 12.0, SMALL), "s e")
    else:
        words = f"{len(names)} records, most fragile at the bottom"
        sheet.text(left - 8.0, 0.5 * (top + bottom), words, "m", angle=-90)
    level_axis(panel, results.levels, results.scale.label)
    sheet.height = bottom + BELOW
    return (
        f"Verdicts of {results.arch} for {len(names)} records at {rows.shape[1]} levels",
        "Every run, records ordered by the lowest level that brought the arch down.",
    )


@figure
def single_runs(sheet: Sheet, results: ArchResults) -> tuple[str, str]:
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
    panel = panel_below(sheet, entries, 220.0, x, (low, high), left=56.0, log=True)
    panel.axis_x(log_ticks(*x), results.scale.label, grid=True)
    panel.axis_y(log_ticks(low, high, subs=(1.0,)), "largest displacement [m]")
    for code, (_, colour, _) in looks.items():
        own = verdict == code
        height = np.clip(np.where(moved, reach, low), low, high)
        panel.dots(level[own], height[own], colour, radius=2.6)
    return (
        f"{level.size} runs of {results.arch}: intensity, largest displacement and verdict",
        "Every run: the largest displacement of a voussoir against the run's own intensity. What "
        f"moved by less than {low:g} m is shown there.",
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


@figure
def fractions(
    sheet: Sheet, groups: Sequence[Deaggregation], results: ArchResults
) -> tuple[str, str] | None:
    """Fraction of collapses at each level, split by three criteria; None if none collapsed.

    Of all runs where every record was run at every level, else of the collapses.
    """
    if not groups[0].collapsed.any():
        return None
    every = bool(results.simulated.all())
    stacks = [_parts(group, every) for group in groups]
    keys = [[entry for entry, _ in parts] for parts in stacks]
    first = sheet.panes(len(groups), 0.0, 150.0)[0][0]
    lines = (look.legend_rows(key, first[2] - first[0]) for key in keys)
    rows = 1 + max(row for key in lines for row, _, _ in key)
    gap = 10.0 + rows * LINE if sheet.narrow else 10.0
    boxes, end = sheet.panes(len(groups), 0.0, 150.0, gap)
    sheet.height = end + rows * LINE
    for box, parts, key, title in zip(boxes, stacks, keys, _TITLES, strict=True):
        panel = Panel(sheet, box, (-0.5, results.levels.size - 0.5), (0.0, 1.0))
        ticks = [0.0, 0.25, 0.5, 0.75, 1.0]
        panel.axis_y(ticks, f"fraction of the {'runs' if every else 'collapses'}")
        panel.stack(parts)
        level_axis(panel, results.levels, results.scale.label)
        panel.heading(title)
        sheet.legend(box[0], box[3] + 35.0, key, box[2] - box[0])
    column = (
        "the observed fraction of collapses at a level, among the runs that collapsed or stood"
        if every
        else "all collapses at a level (how many of the runs collapse it does not show: records "
        "were run at levels of their own)"
    )
    return (
        f"Fraction of collapses of {results.arch} by level, split by mode, by joint and by "
        "impacts",
        f"Each column is {column}, split by how the joint that lost all contact had been moving, "
        "by which joint that was, and by how many joints had closed with an impact since the "
        "start of the run. Joint 0 is the left springing, or the base of a free-standing chain.",
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


@figure
def measures(sheet: Sheet, answer: Answer, arch: str) -> tuple[str, str] | None:
    """Efficiency of each measure, the best on top; None if fewer than two are known."""
    found = [(str(row["measure"]), row["efficiency"]) for row in efficient_first(answer)]
    known = {name: float(value) for name, value in found if np.isfinite(float(value or np.nan))}
    if len(known) < 2:
        return None
    values, place = np.array(list(known.values())), np.arange(len(known))
    chosen = np.array([name == answer.more["measures"]["best"] for name in known])
    left = min(max(look.text_width(name, SMALL) for name in known) + 10.0, 0.4 * sheet.width)
    box = (left, 4.0, sheet.width - 44.0, 4.0 + 16.0 * len(known))
    panel = Panel(sheet, box, (0.0, 1.02 * values.max()), (len(known) - 0.5, -0.5))
    panel.axis_x(even_ticks(0.0, float(values.max())), "efficiency [1]", grid=True)
    for own, colour in ((chosen, look.BLUE), (~chosen, look.SKY)):
        panel.boxes(0.0, values[own], place[own] + 0.3, place[own] - 0.3, colour)
    for (name, value), y in zip(known.items(), panel.at_y(place) + 3.5, strict=True):
        sheet.text(left - 5.0, y, look.shortened(name, left - 8.0, SMALL), "s e")
        sheet.text(float(panel.at_x(value)) + 4.0, y, f"{value:.3f}", "s")
    sheet.height = box[3] + BELOW
    best = next(iter(known))
    return f"Efficiency of {len(known)} intensity measures for {arch}; smallest in {best}", ""


@figure
def theta_panels(
    sheet: Sheet, members: Sequence[Answer], differences: Mapping[str, NDArray], name: str,
    scale: Scale,
) -> tuple[str, str] | None:  # fmt: skip
    """Theta of each arch against what the arches differ by, a panel for each; None if nothing."""
    every = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in members]
    theta = scale.factor * np.array(every)
    known = np.isfinite(theta)
    shown = dict(list(differences.items())[:MOST_PANELS])
    if not shown or known.sum() < 2:
        return None
    theta = theta[known]
    margin = 0.05 * float(np.ptp(theta)) or 0.05 * float(theta[0])
    ends = float(theta.min()) - margin, float(theta.max()) + margin
    columns = 1 if sheet.narrow else min(3, len(shown))
    each = (sheet.width - 10.0) / columns
    for i, (title, values) in enumerate(shown.items()):
        row, column = divmod(i, columns)
        top = row * (_HIGH + BELOW + LINE) + LINE
        box = (column * each + BESIDE, top, (column + 1) * each - 8.0, top + _HIGH)
        panel = Panel(sheet, box, (0.0, 1.0), ends)
        (_by_text if values.dtype.kind == "U" else _by_number)(panel, values[known], theta)
        panel.axis_y(even_ticks(*ends), f"θ [{scale.unit}]", grid=True)
        panel.heading(look.shortened(title, each - BESIDE - 8.0))
    sheet.height = -(-len(shown) // columns) * (_HIGH + BELOW + LINE) + 4.0
    return (
        f"Median capacities of {theta.size} arches of {name} against {', '.join(shown)}",
        "Points: median capacities of the arches of the class against what they differ by. Bars: "
        "medians of groups.",
    )


def _by_number(panel: Panel, values: NDArray, theta: FloatArray) -> None:
    there = np.isfinite(values)
    low, high = float(values[there].min()), float(values[there].max())
    margin = 0.04 * (high - low) or 1.0
    panel.x = (low - margin, high + margin)
    ticks = even_ticks(*panel.x, 4)
    panel.axis_x(ticks, "", [f"{tick:g}" if abs(tick) < 1e6 else digits(tick) for tick in ticks])
    panel.dots(values[there], theta[there], look.BLUE, radius=2.4)


def _by_text(panel: Panel, texts: NDArray, theta: FloatArray) -> None:
    frequent = [text for text, _ in Counter(texts.tolist()).most_common()]
    kept = sorted(frequent[: MOST_TEXTS - (len(frequent) > MOST_TEXTS)])
    labels = kept + (["others"] if len(frequent) > len(kept) else [])
    place = np.array([kept.index(t) if t in kept else len(kept) for t in texts], dtype=float)
    panel.x = (-0.5, len(labels) - 0.5)
    width = (panel.box[2] - panel.box[0]) / len(labels) - 6.0
    words = [look.shortened(label or "not stated", width, SMALL) for label in labels]
    panel.axis_x(np.arange(len(labels)), "", words)
    for i in range(len(labels)):
        own = np.flatnonzero(place == i)
        middle = float(np.median(theta[own]))
        panel.line([i - 0.35, i + 0.35], [middle, middle], look.INK, 1.4)
        # Points of one text stand beside each other, in the order of the arches.
        place[own] += np.linspace(-0.25, 0.25, own.size) if own.size > 1 else 0.0
    panel.dots(place, theta, look.BLUE, radius=2.4)
