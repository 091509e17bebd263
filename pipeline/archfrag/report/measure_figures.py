"""Intensity measures compared: how well each predicts collapse, in a table and a figure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from archfrag.report import picture as look
from archfrag.report.axes import BELOW, axis_x, even_ticks
from archfrag.report.picture import Picture
from archfrag.report.plot import SMALL, Panel, Sheet, picture, shortened, text_width
from archfrag.report.tables import Table


@dataclass(frozen=True)
class MeasureRow:
    """What one intensity measure is worth for one arch; None where it is not known.

    Attributes
    ----------
    measure, unit : str
        Name, and the unit of `theta`.
    theta : float or None
        Median capacity in this measure, in `unit`.
    beta : float or None
        Dispersion of the curve in this measure [1].
    efficiency : float or None
        Standard deviation of ln(demand) about its regression on ln(measure); less is better.
    practicality : float or None
        Slope of that regression; more is better.
    proficiency : float or None
        Efficiency over practicality (Padgett, Nielson and DesRoches 2008); less is better.
    sufficiency_magnitude, sufficiency_distance : float or None
        p-values of what is left on magnitude and on distance: small ones speak against it.
    """

    measure: str
    unit: str
    theta: float | None = None
    beta: float | None = None
    efficiency: float | None = None
    practicality: float | None = None
    proficiency: float | None = None
    sufficiency_magnitude: float | None = None
    sufficiency_distance: float | None = None


def best(rows: Sequence[MeasureRow]) -> MeasureRow | None:
    """The measure with the smallest dispersion; None where none is known."""
    known = [row for row in rows if row.beta is not None and np.isfinite(row.beta)]
    return min(known, key=lambda row: row.beta or 0.0) if known else None


def measures_table(rows: Sequence[MeasureRow]) -> Table:
    """One row for each measure, in the order given."""
    heads = [
        "measure", "θ", "unit", "β", "efficiency", "practicality", "proficiency",
        "p of magnitude", "p of distance",
    ]  # fmt: skip
    return Table(
        heads,
        [
            [
                row.measure,
                _digits(row.theta),
                row.unit,
                *(
                    _digits(value)
                    for value in (
                        row.beta,
                        row.efficiency,
                        row.practicality,
                        row.proficiency,
                        row.sufficiency_magnitude,
                        row.sufficiency_distance,
                    )
                ),
            ]
            for row in rows
        ],
    )


def measures_figure(rows: Sequence[MeasureRow], arch: str) -> Picture | None:
    """Dispersion in each measure, smallest on top; None if fewer than two are known."""
    known = sorted(
        (row for row in rows if row.beta is not None and np.isfinite(row.beta)),
        key=lambda row: row.beta or 0.0,
    )
    if len(known) < 2:
        return None
    betas = np.array([row.beta for row in known], dtype=float)

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        left = min(max(text_width(row.measure, SMALL) for row in known) + 10.0, 0.4 * width)
        bottom = 4.0 + 16.0 * len(known)
        panel = Panel(
            sheet, (left, 4.0, width - 44.0, bottom), (0.0, 1.02 * betas.max()),
            (len(known) - 0.5, -0.5),
        )  # fmt: skip
        axis_x(panel, even_ticks(0.0, float(betas.max())), "dispersion β [1]", grid=True)
        rows_ = np.arange(len(known))
        panel.boxes(0.0, betas[:1], rows_[:1] + 0.3, rows_[:1] - 0.3, look.BLUE)
        panel.boxes(0.0, betas[1:], rows_[1:] + 0.3, rows_[1:] - 0.3, look.SKY)
        for place, row in enumerate(known):
            y = float(panel.at_y(place)) + 3.5
            sheet.text(left - 5.0, y, shortened(row.measure, left - 8.0, SMALL), "s e")
            sheet.text(float(panel.at_x(betas[place])) + 4.0, y, f"{betas[place]:.3f}", "s")
        sheet.height = bottom + BELOW
        return sheet

    return picture(
        draw,
        alternative=f"Dispersion of the curve of {arch} in {len(known)} intensity measures; "
        f"smallest in {known[0].measure}",
        caption="Dispersion of the lognormal curve fitted to the same runs in each measure: the "
        "smaller, the fewer records tell the median as well.",
    )


def _digits(value: float | None) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:#.3g}"
