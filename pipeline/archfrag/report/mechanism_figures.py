"""Mechanisms of an arch: how, where and after how many impacts it collapsed, and what ran."""

from collections.abc import Sequence

import numpy as np

from archfrag.fragility.contributions import Deaggregation, deaggregate
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode, Model
from archfrag.report import picture as look
from archfrag.report.figures import MODE_LOOK
from archfrag.report.picture import LINE, FloatArray, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults
from archfrag.report.tables import Table
from archfrag.simulation.mechanism import MODEL_WORDS

IMPACTS = ("no impact", "1 impact", "2 to 9 impacts", "10 to 99 impacts", "100 or more impacts")
_IMPACT_BOUNDS = (1, 2, 10, 100)
_OTHER = "other joints"
_MOST_JOINTS = 4
LOOKS = (
    (look.BLUE, "area"), (look.ORANGE, "slash"), (look.GREEN, "dots"), (look.PURPLE, "cross"),
    (look.VERMILION, "slash"), (look.SKY, "area"), (look.INK, "area"), (look.GREY, "area"),
)  # fmt: skip
OF_RUNS = (
    "Each column is the observed fraction of collapses at a level, among the runs that collapsed "
    "or stood"
)
OF_COLLAPSES = (
    "Each column is all collapses at a level (how many of the runs collapse it does not show: "
    "records were run at levels of their own)"
)
_TITLES = ("how it was moving", "joint that was lost", "joints closed by then")
MODEL_LOOK = {
    Model.REST: Entry(MODEL_WORDS[Model.REST], look.PALE),
    Model.FOUR_HINGES: Entry(MODEL_WORDS[Model.FOUR_HINGES], look.SKY),
    Model.MEGA_VOUSSOIRS: Entry(MODEL_WORDS[Model.MEGA_VOUSSOIRS], look.GREEN, "dots"),
    Model.ALL_VOUSSOIRS: Entry(MODEL_WORDS[Model.ALL_VOUSSOIRS], look.PURPLE, "slash"),
}


def groupings(results: ArchResults, confidence: float) -> list[Deaggregation]:
    """Collapses by mode, by the joint that was lost, and by the joints that had closed by then."""
    lost = results["collapse_joint"]
    fell = np.bincount(np.maximum(lost[results.verdict == Verdict.COLLAPSED], 0), minlength=1)
    order = np.argsort(-fell, kind="stable")
    own = np.sort(order[: np.count_nonzero(fell)][:_MOST_JOINTS])
    joint = np.full(lost.shape, own.size)
    for place, number in enumerate(own):
        joint[lost == number] = place
    modes = [MODE_LOOK[mode].label for mode in CollapseMode]
    impacts = np.searchsorted(_IMPACT_BOUNDS, results["impacts"], side="right")
    return [
        deaggregate(results.verdict, category, names, confidence=confidence)
        for category, names in (
            (results["collapse_mode"], modes),
            (joint, [*(f"joint {number}" for number in own), _OTHER]),
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
        caption=f"{OF_RUNS if every else OF_COLLAPSES}, split by how the joint that lost all "
        "contact had been moving, by which joint that was, and by how many joints had closed with "
        "an impact since the start of the run. Joint 0 is the left springing, or the base of a "
        "free-standing chain.",
    )


def fractions_table(groups: Sequence[Deaggregation], results: ArchResults) -> Table:
    """Collapses of each category at each level, and their fraction of all with its interval."""
    percent = f"{100 * groups[0].confidence:.0f} %"
    heads = ["collapses", "all levels", "fraction", f"{percent} interval"]
    everything = groups[0].collapsed
    rows = [["all", str(everything.sum()), "", "", *map(str, everything)]]
    for group in groups:
        for i in np.flatnonzero(group.counts.any(axis=1)):
            ends = f"{group.overall_lower[i]:.2f} – {group.overall_upper[i]:.2f}"
            total, fraction = str(group.counts[i].sum()), f"{group.overall[i]:.2f}"
            rows.append([group.categories[i], total, fraction, ends, *map(str, group.counts[i])])
    return Table([*heads, *map(look.digits, results.levels)], rows)


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


def ran_table(results: ArchResults) -> Table:
    """Simulated time of each model, and totals of events and contact problems."""
    time = results["model_time"]
    moving = time.sum() - time[..., results.models.index("rest")].sum()
    total = max(float(time.sum()), np.finfo(float).tiny)
    rows = {}
    for i, model in enumerate(results.models):
        seconds = float(time[..., i].sum())
        words = f"simulated time, {MODEL_LOOK[Model[model.upper()]].label}"
        rows[words] = f"{seconds:,.1f} s ({100 * seconds / total:.1f} %)" if seconds else "0"
    if moving > 0.0:
        by_steps = time[..., results.models.index("all_voussoirs")].sum() / moving
        rows["fraction of the time in motion on all voussoirs"] = f"{100 * by_steps:.1f} %"
    for label, name in (
        ("events located", "events"), ("impacts", "impacts"),
        ("switches to time stepping", "switches"),
    ):  # fmt: skip
        count = results[name].sum()
        rate = f" ({count / moving:.3g} in a second of motion)" if moving > 0.0 else ""
        rows[label] = f"{count:,}{rate}"
    solved, again = int(results["levels"].sum()), int(results["level_iterations"].sum())
    part = f" ({100 * again / solved:.2g} %)" if solved else ""
    rows["contact problems solved by the two levels"] = f"{solved:,}"
    rows["of these, with more than one round"] = f"{again:,}{part}"
    rows["contact problems left to the general solver"] = f"{results['general'].sum():,}"
    some = [[name, text] for name, text in rows.items() if text.split()[0] != "0"]
    return Table(["figure", "value"], some)
