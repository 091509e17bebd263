"""Intensity measures compared: how well each predicts collapse, in a table and a figure."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from archfrag.report import picture as look
from archfrag.report.axes import even_ticks
from archfrag.report.picture import BELOW, SMALL, Picture, shortened, text_width
from archfrag.report.plot import Panel, Sheet, picture
from archfrag.report.tables import Table

Row = Mapping[str, Any]  # of archfrag.fragility.measures.MeasureRow, with the unit of theta
_COLUMNS = {
    "β": "beta", "efficiency": "efficiency", "practicality": "practicality",
    "proficiency": "proficiency", "p of magnitude": "p_magnitude", "p of distance": "p_distance",
}  # fmt: skip


def measures_table(rows: Sequence[Row]) -> Table:
    """One row for each measure, the most efficient first."""
    return Table(
        ["measure", "θ", "unit", *_COLUMNS],
        [
            [row["measure"], _digits(row["theta"]), row["unit"],
             *(_digits(row[key]) for key in _COLUMNS.values())]
            for row in sorted(rows, key=_efficiency)
        ],
    )  # fmt: skip


def measures_figure(rows: Sequence[Row], arch: str, best: str) -> Picture | None:
    """Efficiency of each measure, the best on top; None if fewer than two are known."""
    known = sorted((row for row in rows if np.isfinite(_efficiency(row))), key=_efficiency)
    if len(known) < 2:
        return None
    values = np.array([_efficiency(row) for row in known])
    chosen = np.array([row["measure"] == best for row in known])

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        left = min(max(text_width(row["measure"], SMALL) for row in known) + 10.0, 0.4 * width)
        bottom = 4.0 + 16.0 * len(known)
        panel = Panel(
            sheet, (left, 4.0, width - 44.0, bottom), (0.0, 1.02 * values.max()),
            (len(known) - 0.5, -0.5),
        )  # fmt: skip
        panel.axis_x(even_ticks(0.0, float(values.max())), "efficiency [1]", grid=True)
        rows_ = np.arange(len(known))
        for own, colour in ((chosen, look.BLUE), (~chosen, look.SKY)):
            panel.boxes(0.0, values[own], rows_[own] + 0.3, rows_[own] - 0.3, colour)
        for place, row in enumerate(known):
            y = float(panel.at_y(place)) + 3.5
            sheet.text(left - 5.0, y, shortened(row["measure"], left - 8.0, SMALL), "s e")
            sheet.text(float(panel.at_x(values[place])) + 4.0, y, f"{values[place]:.3f}", "s")
        sheet.height = bottom + BELOW
        return sheet

    return picture(
        draw,
        alternative=f"Efficiency of {len(known)} intensity measures for {arch}; smallest in "
        f"{known[0]['measure']}",
        caption="Efficiency: dispersion of the factors on the records that cause collapse, once "
        "the records are scaled to the same value of a measure. The smaller, the fewer records "
        "give the median as well. Dark: the best of those that are sufficient, which means that "
        "magnitude and distance add nothing (p of magnitude, p of distance above 0.05).",
    )


def _efficiency(row: Row) -> float:
    return _number(row["efficiency"])


def _number(value: Any) -> float:
    """A stored number; null where it is not known."""
    return np.nan if value is None else float(value)


def _digits(value: Any) -> str:
    return f"{_number(value):#.3g}" if np.isfinite(_number(value)) else "–"
