"""Verdicts, collapses and numerical quality of one arch."""

import numpy as np

from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.report import picture as look
from archfrag.report.axes import integer_ticks, log_ticks
from archfrag.report.picture import (
    BELOW,
    BESIDE,
    SMALL,
    FloatArray,
    Picture,
    number,
    shortened,
    text_width,
)
from archfrag.report.plot import Box, Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults, IntArray

VERDICT_LOOK = {
    Verdict.STANDING: ("standing", "#cfe0ee", "area"),
    Verdict.COLLAPSED: ("collapsed", look.VERMILION, "area"),
    Verdict.UNFINISHED: ("unfinished", "#d9b310", "slash"),
    Verdict.SOLVER_FAILURE: ("solver failure", look.INK, "area"),
}
MODE_LOOK = {
    CollapseMode.HINGING: ("hinging", look.BLUE, ""),
    CollapseMode.SLIDING: ("sliding", look.ORANGE, "slash"),
    CollapseMode.LIFT_OFF: ("lift-off", look.GREEN, "dots"),
    CollapseMode.OVERTURNING: ("overturning", look.PURPLE, "cross"),
    CollapseMode.NONE: ("mode not known", look.GREY, ""),
}
# Logarithmic histograms need a floor for exact zeros.
_FLOOR = 1e-18
_LABELLED = 60  # records that have their names beside them


def verdict_map(results: ArchResults) -> Picture:
    """Verdict of every run: records down, levels across."""
    weight = (results.verdict == Verdict.COLLAPSED).sum(axis=1)
    order = np.lexsort((np.arange(weight.size), weight))
    rows = results.verdict[order]
    names = [results.records[i] for i in order]

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        labelled = len(names) <= _LABELLED
        longest = max(text_width(name, SMALL) for name in names)
        left = min(longest + 8.0, 0.36 * width) if labelled else 26.0
        entries = [Entry(*VERDICT_LOOK[v]) for v in VERDICT_LOOK if np.any(rows == v)]
        if not results.simulated.all():
            entries.append(Entry("blank: not simulated", "#ffffff"))
        top = sheet.legend(left, 0.0, entries, width - left - 8.0) + 2.0
        each = 14.0 if labelled else min(14.0, 620.0 / len(names))
        bottom = top + each * len(names)
        panel = Panel(
            sheet, (left, top, width - 8.0, bottom), (-0.5, rows.shape[1] - 0.5),
            (len(names) - 0.5, -0.5),
        )  # fmt: skip
        for code, (_, colour, mark) in VERDICT_LOOK.items():
            d = _cells(panel, rows == code, 1.5 if labelled else 0.0)
            sheet.path(d, fill=colour)
            if mark != "area":
                sheet.path(d, fill=f"url(#hatch-{mark})")
        lines = "".join(
            f"M{number(x)} {number(top)}V{number(bottom)}"
            for x in panel.at_x(np.arange(1, rows.shape[1]) - 0.5)
        )
        sheet.path(lines, stroke="#fff", stroke_width=1)
        if labelled:
            for y, name in zip(panel.at_y(np.arange(len(names))), names, strict=True):
                sheet.text(left - 5.0, y + 3.5, shortened(name, left - 8.0, SMALL), "s e")
        else:
            sheet.text(
                left - 8.0, 0.5 * (top + bottom),
                f"{len(names)} records, most fragile at the bottom", "m", angle=-90,
            )  # fmt: skip
        panel.level_axis(results.levels, results.scale.label)
        sheet.height = bottom + BELOW
        return sheet

    return picture(
        draw,
        alternative=f"Verdicts of {results.arch} for {len(names)} records at {rows.shape[1]} "
        "levels",
        caption="Every run, records ordered by the number of collapses.",
    )


def scattered_runs(results: ArchResults) -> Picture:
    """Every run where each has an intensity of its own: its largest displacement, its verdict."""
    assert results.own_levels is not None
    run = results.simulated.any(axis=1)
    level = results.own_levels[run]
    verdict = np.where(results.simulated, results.verdict, 0).sum(axis=1)[run]
    reach = results.peak_displacement.sum(axis=1)[run]
    moved = np.isfinite(reach) & (reach > 0.0)
    entries = [
        Entry(label, look.SKY if v == Verdict.STANDING else colour, "dot")
        for v, (label, colour, _) in VERDICT_LOOK.items()
        if np.any(verdict == v)
    ]
    seen = reach[moved] if moved.any() else np.array([1e-3, 1.0])
    ends = 10.0 ** np.floor(np.log10(max(seen.min(), 1e-6))), 10.0 ** np.ceil(np.log10(seen.max()))
    x = 0.95 * float(level.min()), 1.05 * float(level.max())

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        bottom = top + 220.0
        box = (BESIDE + 8.0, top, width - 10.0, bottom)
        panel = Panel(sheet, box, x, (ends[0], max(ends[1], 10.0 * ends[0])), True, True)
        panel.axis_x(log_ticks(*x), results.scale.label, grid=True)
        panel.axis_y(log_ticks(*panel.y, subs=(1.0,)), "largest displacement [m]")
        for code, (_, colour, _) in VERDICT_LOOK.items():
            own = verdict == code
            colour = look.SKY if code == Verdict.STANDING else colour
            height = np.clip(np.where(moved, reach, ends[0]), *panel.y)
            panel.dots(level[own], height[own], colour, radius=2.6)
        sheet.height = bottom + BELOW
        return sheet

    return picture(
        draw,
        alternative=f"{level.size} runs of {results.arch}: intensity, largest displacement and "
        "verdict",
        caption="Every run: the largest displacement of a voussoir against the run's own "
        f"intensity. What moved by less than {ends[0]:g} m is shown there.",
    )


def _cells(panel: Panel, mask: np.ndarray, gap: float) -> str:
    """Path of the cells of a mask (n_row, n_column), neighbours of a row joined."""
    parts = []
    each = abs(float(panel.at_y(1.0) - panel.at_y(0.0)))
    for row, cells in enumerate(mask):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(int), [0]])))
        y = float(panel.at_y(row)) - 0.5 * each
        for start, stop in ends.reshape(-1, 2):
            a, b = panel.at_x(start - 0.5), panel.at_x(stop - 0.5)
            parts.append(
                f"M{number(float(a))} {number(y)}H{number(float(b))}v{number(each - gap)}"
                f"H{number(float(a))}z"
            )
    return "".join(parts)


def collapses(results: ArchResults, n_joint: int) -> Picture | None:
    """Where and how the arch collapsed, and at which levels; None if it never did."""
    table = results.collapses_by_joint(n_joint)
    if not table.any():
        return None
    by_mode, by_level = table.sum(axis=2), table.sum(axis=1)
    entries = [
        Entry(name, colour, hatch or "area")
        for mode, (name, colour, hatch) in MODE_LOOK.items()
        if by_mode[:, mode].any()
    ]

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(48.0, 0.0, entries, width - 56.0)
        height = float(np.clip(17.0 * n_joint, 90.0, 420.0))
        (first, second), sheet.height = sheet.panes(2, top, height)
        y = (-0.5, n_joint - 0.5)
        joints = np.arange(0, n_joint, max(1, -(-n_joint // int(height / 13.0))))
        left = Panel(sheet, first, (0.0, 1.02 * float(by_mode.sum(axis=1).max())), y)
        left.axis_x(integer_ticks(left.x[1]), "collapses [runs]", grid=True)
        base = np.zeros(n_joint)
        for mode, (_, colour, hatch) in MODE_LOOK.items():
            if by_mode[:, mode].any():
                here = np.flatnonzero(by_mode[:, mode])
                ends = base[here] + by_mode[here, mode]
                left.boxes(base[here], ends, here - 0.38, here + 0.38, colour, hatch)
                base += by_mode[:, mode]
        left.axis_y(joints, "joint that lost contact", grid=False)
        left.heading("by mode")
        right = Panel(sheet, second, (-0.5, results.levels.size - 0.5), y)
        _heat(right, by_level)
        right.level_axis(results.levels, results.scale.label)
        right.axis_y(joints, "joint that lost contact", grid=False)
        right.heading("by level [runs]")
        return sheet

    worst = int(by_level.sum(axis=1).argmax())
    return picture(
        draw,
        alternative=f"Collapses of {results.arch} by joint, mode and level; joint {worst} most "
        "often",
        caption="Joint 0 is the left springing, or the base of a free-standing chain. A run is "
        "counted at the joint whose loss of contact decided, by how that joint had been moving.",
    )


def _heat(panel: Panel, counts: IntArray) -> None:
    """Cells shaded by their counts, with the number where it can be read."""
    steps = ("#fbe9dd", "#f6c9a8", "#ec9c66", "#d4661f", "#a03a00")
    largest = counts.max()
    shade = np.minimum(len(steps) * (counts - 1) // max(largest, 1), len(steps) - 1)
    n_joint, n_level = counts.shape
    cell = (panel.box[2] - panel.box[0]) / n_level
    high = (panel.box[3] - panel.box[1]) / n_joint
    for i, colour in enumerate(steps):
        joint, level = np.nonzero((counts > 0) & (shade == i))
        if joint.size:
            panel.boxes(level - 0.47, level + 0.47, joint - 0.46, joint + 0.46, colour)
    if cell < text_width(str(largest), SMALL) + 1.0 or high < 10.0:
        return
    for joint, level in np.argwhere(counts):
        kind = "s m w" if shade[joint, level] > 3 else "s m"
        y = float(panel.at_y(joint)) + 3.5
        panel.sheet.text(float(panel.at_x(level)), y, str(counts[joint, level]), kind)


def numerics(results: ArchResults) -> Picture:
    """Energy error and contact residual of all runs."""
    here = results.simulated
    shown = (
        (results.energy_error[here], "energy error [1]", look.BLUE),
        (results.residual[here], "contact residual [1]", look.GREEN),
    )

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        boxes, sheet.height = sheet.panes(2, -12.0, 130.0)
        for box, (values, title, colour) in zip(boxes, shown, strict=True):
            _log_histogram(sheet, box, values, title, colour)
        return sheet

    return picture(
        draw,
        alternative=f"Histograms of energy error and contact residual of {results.arch}",
        caption="Energy error: what is missing in the energy balance, relative to the largest "
        "kinetic energy of the run. Contact residual: largest violation of Signorini's and "
        f"Coulomb's laws, dimensionless. Values below {_FLOOR:g} are shown at {_FLOOR:g}; "
        "solver failures are included.",
    )


def _log_histogram(
    sheet: Sheet,
    box: Box,
    values: FloatArray,
    title: str,
    colour: str,
) -> None:
    values = np.abs(values[np.isfinite(values)])
    if values.size == 0:
        sheet.text(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]), f"{title}: not known", "m q")
        return
    logs = np.log10(np.maximum(values, _FLOOR))
    low, high = float(np.floor(logs.min())), float(np.ceil(logs.max() + 1e-9))
    edges = np.linspace(low, max(high, low + 1.0), 25)
    counts, _ = np.histogram(logs, edges)
    there = np.flatnonzero(counts)
    panel = Panel(
        sheet, box, (10.0**low, 10.0 ** float(edges[-1])), (0.0, 1.04 * counts.max()), log_x=True
    )
    panel.axis_y(integer_ticks(panel.y[1]), "runs")
    bars = 10.0 ** edges[there], 10.0 ** edges[there + 1]
    panel.boxes(*bars, np.zeros(there.size), counts[there], colour)
    ticks = log_ticks(*panel.x, subs=(1.0,))
    ticks = ticks[:: max(1, -(-ticks.size // 7))]
    panel.axis_x(ticks, title, [f"1e{round(np.log10(tick)):d}" for tick in ticks])
