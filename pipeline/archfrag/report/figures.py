"""Verdicts of all runs of one arch."""

import numpy as np

from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.report import picture as look
from archfrag.report.picture import BELOW, SMALL, Picture, number
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults

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


def verdict_map(results: ArchResults) -> Picture:
    """Verdict of every run: records down, levels across."""
    weight = (results.verdict == Verdict.COLLAPSED).sum(axis=1)
    order = np.lexsort((np.arange(weight.size), weight))
    rows = results.verdict[order]
    names = [results.records[i] for i in order]
    entries = [VERDICT_LOOK[v] for v in VERDICT_LOOK if np.any(rows == v)]
    if not results.simulated.all():
        entries.append(Entry("blank: not simulated", "#ffffff"))

    def draw(sheet: Sheet) -> None:
        labelled = len(names) <= _LABELLED
        longest = max(look.text_width(name, SMALL) for name in names)
        left = min(longest + 8.0, 0.36 * sheet.width) if labelled else 26.0
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
                sheet.text(left - 5.0, y + 3.5, look.shortened(name, left - 8.0, SMALL), "s e")
        else:
            words = f"{len(names)} records, most fragile at the bottom"
            sheet.text(left - 8.0, 0.5 * (top + bottom), words, "m", angle=-90)
        panel.level_axis(results.levels, results.scale.label)
        sheet.height = bottom + BELOW

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
