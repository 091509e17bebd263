"""Verdicts, collapses and numerical quality of one arch."""

import numpy as np

from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.report import picture as look
from archfrag.report.picture import BELOW, SMALL, FloatArray, Picture, number
from archfrag.report.plot import Box, Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults, IntArray

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
_SHADES = ("#fbe9dd", "#f6c9a8", "#ec9c66", "#d4661f", "#a03a00")
# Logarithmic histograms need a floor for exact zeros.
_FLOOR = 1e-18
_LABELLED = 60  # records that have their names beside them


def verdict_map(results: ArchResults) -> Picture:
    """Verdict of every run: records down, levels across."""
    weight = (results.verdict == Verdict.COLLAPSED).sum(axis=1)
    order = np.lexsort((np.arange(weight.size), weight))
    rows = results.verdict[order]
    names = [results.records[i] for i in order]
    entries = [VERDICT_LOOK[v] for v in VERDICT_LOOK if np.any(rows == v)]
    if not results.simulated.all():
        entries.append(Entry("blank: not simulated", "#ffffff"))

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        labelled = len(names) <= _LABELLED
        longest = max(look.text_width(name, SMALL) for name in names)
        left = min(longest + 8.0, 0.36 * width) if labelled else 26.0
        top = sheet.legend(left, 0.0, entries, width - left - 8.0) + 2.0
        bottom = top + (14.0 if labelled else min(14.0, 620.0 / len(names))) * len(names)
        panel = Panel(
            sheet, (left, top, width - 8.0, bottom), (-0.5, rows.shape[1] - 0.5),
            (len(names) - 0.5, -0.5),
        )  # fmt: skip
        for code, (_, colour, mark) in VERDICT_LOOK.items():
            sheet.fill(_cells(panel, rows == code, 1.5 if labelled else 0.0), colour, mark)
        lines = "".join(
            f"M{number(x)} {number(top)}V{number(bottom)}"
            for x in panel.at_x(np.arange(1, rows.shape[1]) - 0.5)
        )
        sheet.path(lines, stroke="#fff", stroke_width=1)
        if labelled:
            for y, name in zip(panel.at_y(np.arange(len(names))), names, strict=True):
                sheet.text(left - 5.0, y + 3.5, look.shortened(name, left - 8.0, SMALL), "s e")
        else:
            words = f"{len(names)} records, most fragile at the bottom"
            sheet.text(left - 8.0, 0.5 * (top + bottom), words, "m", angle=-90)
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
    reach = results["peak_displacement"].sum(axis=1)[run]
    moved = np.isfinite(reach) & (reach > 0.0)
    looks = {code: entry._replace(mark="dot") for code, entry in VERDICT_LOOK.items()}
    looks[Verdict.STANDING] = Entry("standing", look.SKY, "dot")
    entries = [entry for code, entry in looks.items() if np.any(verdict == code)]
    seen = reach[moved] if moved.any() else np.array([1e-3, 1.0])
    low = float(10.0 ** np.floor(np.log10(max(seen.min(), 1e-6))))
    high = max(float(10.0 ** np.ceil(np.log10(seen.max()))), 10.0 * low)
    x = 0.95 * float(level.min()), 1.05 * float(level.max())

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        panel = sheet.below_legend(entries, 220.0, x, (low, high), left=56.0, log=True)
        panel.axis_x(look.log_ticks(*x), results.scale.label, grid=True)
        panel.axis_y(look.log_ticks(low, high, subs=(1.0,)), "largest displacement [m]")
        for code, (_, colour, _) in looks.items():
            own = verdict == code
            height = np.clip(np.where(moved, reach, low), low, high)
            panel.dots(level[own], height[own], colour, radius=2.6)
        return sheet

    return picture(
        draw,
        alternative=f"{level.size} runs of {results.arch}: intensity, largest displacement and "
        "verdict",
        caption="Every run: the largest displacement of a voussoir against the run's own "
        f"intensity. What moved by less than {low:g} m is shown there.",
    )


def _cells(panel: Panel, mask: np.ndarray, gap: float) -> str:
    """Path of the cells of a mask (n_row, n_column), neighbours of a row joined."""
    parts = []
    each = abs(float(panel.at_y(1.0) - panel.at_y(0.0)))
    for row, cells in enumerate(mask):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(int), [0]])))
        y = number(float(panel.at_y(row)) - 0.5 * each)
        for a, b in panel.at_x(ends - 0.5).reshape(-1, 2):
            parts.append(f"M{number(a)} {y}H{number(b)}v{number(each - gap)}H{number(a)}z")
    return "".join(parts)


def collapses(results: ArchResults, n_joint: int) -> Picture | None:
    """Where and how the arch collapsed, and at which levels; None if it never did."""
    table = results.collapses_by_joint(n_joint)
    if not table.any():
        return None
    by_mode, by_level = table.sum(axis=2), table.sum(axis=1)
    parts = [
        (entry, by_mode[:, mode]) for mode, entry in MODE_LOOK.items() if by_mode[:, mode].any()
    ]

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(48.0, 0.0, [entry for entry, _ in parts], width - 56.0)
        height = float(np.clip(17.0 * n_joint, 90.0, 420.0))
        (first, second), sheet.height = sheet.panes(2, top, height)
        y = (-0.5, n_joint - 0.5)
        joints = np.arange(0, n_joint, max(1, -(-n_joint // int(height / 13.0))))
        left = Panel(sheet, first, (0.0, 1.02 * float(by_mode.sum(axis=1).max())), y)
        left.axis_x(look.integer_ticks(left.x[1]), "collapses [runs]", grid=True)
        left.stack(parts, 0.38, across=True)
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
    largest = counts.max()
    shade = np.minimum(len(_SHADES) * (counts - 1) // max(largest, 1), len(_SHADES) - 1)
    n_joint, n_level = counts.shape
    cell = (panel.box[2] - panel.box[0]) / n_level
    high = (panel.box[3] - panel.box[1]) / n_joint
    for i, colour in enumerate(_SHADES):
        joint, level = np.nonzero((counts > 0) & (shade == i))
        panel.boxes(level - 0.47, level + 0.47, joint - 0.46, joint + 0.46, colour)
    if cell < look.text_width(str(largest), SMALL) + 1.0 or high < 10.0:
        return
    for joint, level in np.argwhere(counts):
        kind = "s m w" if shade[joint, level] > 3 else "s m"
        y = float(panel.at_y(joint)) + 3.5
        panel.sheet.text(float(panel.at_x(level)), y, str(counts[joint, level]), kind)


def numerics(results: ArchResults) -> Picture:
    """Energy error and contact residual of all runs."""

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        (first, second), sheet.height = sheet.panes(2, -12.0, 130.0)
        here = results.simulated
        error, residual = results["energy_error"][here], results["contact_residual"][here]
        _log_histogram(sheet, first, error, Entry("energy error [1]", look.BLUE))
        _log_histogram(sheet, second, residual, Entry("contact residual [1]", look.GREEN))
        return sheet

    return picture(
        draw,
        alternative=f"Histograms of energy error and contact residual of {results.arch}",
        caption="Energy error: what is missing in the energy balance, relative to the largest "
        "kinetic energy of the run. Contact residual: largest violation of Signorini's and "
        f"Coulomb's laws, dimensionless. Values below {_FLOOR:g} are shown at {_FLOOR:g}; "
        "solver failures are included.",
    )


def _log_histogram(sheet: Sheet, box: Box, values: FloatArray, entry: Entry) -> None:
    values = np.abs(values[np.isfinite(values)])
    panel = Panel(sheet, box, (1.0, 10.0), (0.0, 1.0), log_x=True)
    if values.size == 0:
        panel.centred(f"{entry.label}: not known")
        return
    logs = np.log10(np.maximum(values, _FLOOR))
    low, high = float(np.floor(logs.min())), float(np.ceil(logs.max() + 1e-9))
    edges = np.linspace(low, max(high, low + 1.0), 25)
    counts, _ = np.histogram(logs, edges)
    there = np.flatnonzero(counts)
    panel.x, panel.y = (10.0**low, 10.0 ** float(edges[-1])), (0.0, 1.04 * counts.max())
    panel.axis_y(look.integer_ticks(panel.y[1]), "runs")
    bars = 10.0 ** edges[there], 10.0 ** edges[there + 1]
    panel.boxes(*bars, np.zeros(there.size), counts[there], entry.colour)
    ticks = look.log_ticks(*panel.x, subs=(1.0,))
    ticks = ticks[:: max(1, -(-ticks.size // 7))]
    panel.axis_x(ticks, entry.label, [f"1e{round(np.log10(tick)):d}" for tick in ticks])
