"""What ran: models of the ladder, events, switches, general contact problems."""

import numpy as np

from archfrag.mechanics.status import Model
from archfrag.report import picture as look
from archfrag.report.axes import log_ticks
from archfrag.report.picture import LINE, Picture
from archfrag.report.plot import Box, Entry, Panel, Sheet, picture
from archfrag.report.summary import ArchResults
from archfrag.report.tables import Table
from archfrag.simulation.mechanism import MODEL_WORDS

MODEL_LOOK = {
    Model.REST: (look.PALE, ""),
    Model.FOUR_HINGES: (look.SKY, ""),
    Model.MEGA_VOUSSOIRS: (look.GREEN, "dots"),
    Model.ALL_VOUSSOIRS: (look.PURPLE, "slash"),
}


def what_ran(results: ArchResults) -> Picture:
    """Fraction of simulated time of each model, and events in a second of motion, by level."""

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        boxes, sheet.height = sheet.panes(2, 20.0, 150.0, gap=26.0)
        _fractions(sheet, boxes[0], results)
        _rates(sheet, boxes[1], results)
        return sheet

    return picture(
        draw,
        alternative=f"Fractions of simulated time of {results.arch} by model of the ladder, and "
        "numbers of events in a second of motion, by level",
        caption="Simulated time that each model of the ladder had; and means over the time in "
        "motion, where what did not occur is not drawn. Impacts are joints that closed; an event "
        "is an instant that was located; a hand-over is where events came too thick to be located "
        "one by one; general are contact problems that the two levels left to the general solver.",
    )


def table(results: ArchResults) -> Table:
    """Simulated time of each model, and totals of events and contact problems."""
    time, moving = results.model_time, _moving(results).sum()
    total = max(float(time.sum()), np.finfo(float).tiny)
    rows = {}
    for i, model in enumerate(results.models):
        seconds = float(time[..., i].sum())
        rows[f"simulated time, {_words(model)}"] = (
            f"{seconds:,.1f} s ({100 * seconds / total:.1f} %)"
        )
    if moving > 0.0:
        by_steps = time[..., results.models.index("all_voussoirs")].sum() / moving
        rows["fraction of the time in motion on all voussoirs"] = f"{100 * by_steps:.1f} %"
    for label, counts in (
        ("events located", results.events),
        ("impacts", results.impacts),
        ("switches to time stepping", results.switches),
    ):
        rate = f" ({counts.sum() / moving:.3g} in a second of motion)" if moving > 0.0 else ""
        rows[label] = f"{counts.sum():,}{rate}"
    solved, again = int(results.two_level.sum()), int(results.level_iterations.sum())
    part = f" ({100 * again / solved:.2g} %)" if solved else ""
    rows["contact problems solved by the two levels"] = f"{solved:,}"
    rows["of these, with more than one round"] = f"{again:,}{part}"
    rows["contact problems left to the general solver"] = f"{results.general.sum():,}"
    return Table(["figure", "value"], list(rows.items()))


def _fractions(sheet: Sheet, box: Box, results: ArchResults) -> None:
    time = results.model_time.sum(axis=0)
    total = np.maximum(time.sum(axis=1), np.finfo(float).tiny)
    panel = Panel(sheet, box, (-0.5, results.levels.size - 0.5), (0.0, 100.0))
    panel.axis_y([0.0, 25.0, 50.0, 75.0, 100.0], "simulated time [%]")
    base, entries = np.zeros(results.levels.size), []
    for i, model in enumerate(results.models):
        colour, hatch = MODEL_LOOK[Model[model.upper()]]
        part = 100.0 * time[:, i] / total
        here = np.flatnonzero(part)
        if here.size:
            top = base[here] + part[here]
            panel.boxes(here - 0.42, here + 0.42, base[here], top, colour, hatch)
            entries.append(Entry(_words(model), colour, hatch or "area"))
        base += part
    _key(sheet, panel, entries)
    panel.level_axis(results.levels, results.scale.label)


def _rates(sheet: Sheet, box: Box, results: ArchResults) -> None:
    moving = _moving(results).sum(axis=0)
    rates, entries = [], []
    for label, counts, colour, mark in (
        ("impacts", results.impacts, look.VERMILION, "dot"),
        ("events", results.events, look.BLUE, "square"),
        ("switches", results.switches, look.ORANGE, "ring"),
        ("general", results.general, look.GREEN, "square"),
    ):
        rate = counts.sum(axis=0) / np.where(moving > 0.0, moving, np.nan)
        rate[~(rate > 0.0)] = np.nan
        if np.isfinite(rate).any():
            rates.append((rate, colour, mark))
            entries.append(Entry(label, colour, mark))
    x = (-0.5, results.levels.size - 0.5)
    if not rates:
        Panel(sheet, box, x, (0.0, 1.0)).level_axis(results.levels, results.scale.label)
        sheet.text(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]), "no events", "m q")
        return
    logs = np.log10(np.concatenate([rate[np.isfinite(rate)] for rate, _, _ in rates]))
    low, high = 10.0 ** np.floor(logs.min()), 10.0 ** np.ceil(logs.max() + 1e-9)
    panel = Panel(sheet, box, x, (low, high), log_y=True)
    panel.axis_y(log_ticks(low, high, (1.0,)), "in a second of motion")
    for rate, colour, mark in rates:
        panel.line(np.arange(rate.size), rate, colour, 1.0)
        panel.dots(np.arange(rate.size), rate, colour, mark, 2.6)
    _key(sheet, panel, entries)
    panel.level_axis(results.levels, results.scale.label)


def _key(sheet: Sheet, panel: Panel, entries: list[Entry]) -> None:
    """Legend over a panel."""
    left, top, right, _ = panel.box
    rows = sheet.legend_rows(entries, right - left)
    sheet.legend(left, top - rows * LINE - 6.0, entries, right - left)


def _moving(results: ArchResults) -> np.ndarray:
    """Simulated time in motion of each run [s]."""
    return results.model_time.sum(axis=2) - results.model_time[..., results.models.index("rest")]


def _words(model: str) -> str:
    return MODEL_WORDS[Model[model.upper()]]
