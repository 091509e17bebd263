"""Axes of the report's drawings: ticks, labels that keep clear of each other, grids, titles."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from archfrag.report.plot import LINE, SMALL, FloatArray, Panel, Sheet, number, text_width
from archfrag.report.summary import digits

BELOW = 36.0  # pixels that labels and title need below a panel
BESIDE = 48.0  # and left of it


def axis_x(
    panel: Panel,
    ticks: ArrayLike,
    title: str,
    labels: Sequence[str] | None = None,
    grid: bool = False,
) -> None:
    """Ticks below a panel; a label that would come too close to the one before is left out."""
    sheet, (left, top, right, bottom) = panel.sheet, panel.box
    places = panel.at_x(ticks)
    shown = [f"{tick:g}" for tick in np.atleast_1d(ticks)] if labels is None else labels
    if grid:
        sheet.path(
            "".join(f"M{number(x)} {number(top)}V{number(bottom)}" for x in places), kind="gr"
        )
    marks = "".join(f"M{number(x)} {number(bottom)}v3" for x in places)
    sheet.path(f"M{number(left)} {number(bottom)}H{number(right)}{marks}", kind="ax")
    end = -np.inf
    for x, label in zip(places, shown, strict=True):
        half = 0.5 * text_width(label, SMALL)
        if x - half >= end + 5.0:
            sheet.text(x, bottom + 14.0, label, "s m")
            end = x + half
    if title:
        sheet.text(0.5 * (left + right), bottom + 29.0, title, "m")


def axis_y(
    panel: Panel,
    ticks: ArrayLike,
    title: str = "",
    labels: Sequence[str] | None = None,
    grid: bool = True,
) -> None:
    """Ticks left of a panel, its title upright beside them."""
    sheet, (left, top, right, bottom) = panel.sheet, panel.box
    places = panel.at_y(ticks)
    shown = [f"{tick:g}" for tick in np.atleast_1d(ticks)] if labels is None else labels
    if grid:
        sheet.path(
            "".join(f"M{number(left)} {number(y)}H{number(right)}" for y in places), kind="gr"
        )
    sheet.path(f"M{number(left)} {number(top)}V{number(bottom)}", kind="ax")
    end = np.inf
    widest = 0.0
    for y, label in zip(places, shown, strict=True):
        if y <= end - 11.0:
            sheet.text(left - 5.0, y + 3.5, label, "s e")
            widest = max(widest, text_width(label, SMALL))
            end = y
    if title:
        sheet.text(left - widest - 11.0, 0.5 * (top + bottom), title, "m", angle=-90)


def heading(panel: Panel, words: str) -> None:
    """A title over the left end of a panel."""
    panel.sheet.text(panel.box[0], panel.box[1] - 6.0, words, "b")


def level_axis(panel: Panel, levels: FloatArray, title: str) -> None:
    """Labels under cells that stand for levels, the first always among them."""
    most = max(2, int((panel.box[2] - panel.box[0]) / 38.0))
    step = max(1, -(-levels.size // most))
    ticks = np.arange(0, levels.size, step)
    axis_x(panel, ticks, title, [digits(levels[i]) for i in ticks])


def even_ticks(low: float, high: float, most: int = 6) -> FloatArray:
    """Round numbers from low to high, at most about so many."""
    span = max(high - low, 1e-300)
    step = 10.0 ** np.floor(np.log10(span / most))
    step *= next(k for k in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0) if k * step * most >= span)
    first = np.ceil(low / step - 1e-9)
    ticks = step * np.arange(first, np.floor(high / step + 1e-9) + 1)
    return np.asarray(ticks + 0.0, dtype=float)  # no -0


def whole_ticks(high: float, most: int = 5) -> FloatArray:
    """Whole numbers from 0 to high."""
    ticks = even_ticks(0.0, max(high, 1.0), most)
    return np.unique(np.round(ticks))


def log_ticks(low: float, high: float, subs: Sequence[float] = (1.0, 2.0, 5.0)) -> FloatArray:
    """1, 2, 5 in each decade from low to high."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.unique(np.outer(decades, subs).ravel())
    return np.asarray(ticks[(ticks >= low * 0.999) & (ticks <= high * 1.001)], dtype=float)


def panes(
    sheet: Sheet, count: int, top: float, height: float, gap: float = 10.0, left: float = BESIDE
) -> tuple[list[tuple[float, float, float, float]], float]:
    """Boxes of panels, beside each other on a wide sheet and below each other on a narrow one."""
    start = top + LINE + 3.0
    if sheet.narrow:
        step = height + BELOW + LINE + gap
        boxes = [
            (left, start + i * step, sheet.width - 14.0, start + i * step + height)
            for i in range(count)
        ]
    else:
        each = (sheet.width - count * left - (count - 1) * gap - 14.0) / count
        lefts = [left + i * (each + gap + left) for i in range(count)]
        boxes = [(x, start, x + each, start + height) for x in lefts]
    return boxes, boxes[-1][3] + BELOW
