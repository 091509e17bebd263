"""Search for the amplitude at which a chain begins to collapse."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Collapses = Callable[[float], bool | None]


class Change(NamedTuple):
    """Where outcomes change, relative to where they were expected to.

    Attributes
    ----------
    offset : float
        Relative distance with its sign; nan if there is no change within reach or a run failed.
    width : float
        Relative width of the bracket that remains.
    failed : bool
        Whether a run gave no outcome.
    """

    offset: float
    width: float
    failed: bool


NO_CHANGE, FAILED = Change(math.nan, math.nan, False), Change(math.nan, math.nan, True)


def nearest_change(
    collapses: Collapses, centre: float, floor: float, reach: float = 0.5, fraction: float = 0.1
) -> Change:
    """Distance of the change from standing to collapse that is nearest to `centre`.

    Probes go away from the centre by factors of ten, towards smaller values if it collapses and
    larger ones if it stands, until outcomes differ; what lies between is bisected on the log
    scale.

    Examples
    --------
    >>> from archbench.search import nearest_change
    >>> found = nearest_change(lambda a: a >= 1.003, 1.0, 1e-6)
    >>> abs(found.offset - 0.003) < 2e-4, found.failed
    (True, False)
    """
    at_centre = collapses(centre)
    if at_centre is None:
        return FAILED
    side = -1.0 if at_centre else 1.0
    inner, outer = 0.0, floor
    while True:
        seen = collapses(centre * (1.0 + side * outer))
        if seen is None:
            return FAILED
        if seen is not at_centre:
            break
        if outer >= reach:
            return NO_CHANGE
        inner, outer = outer, min(10.0 * outer, reach)
    while outer - inner > max(floor, fraction * inner):
        middle = math.sqrt(inner * outer) if inner > 0.0 else 0.5 * outer
        seen = collapses(centre * (1.0 + side * middle))
        if seen is None:
            return FAILED
        inner, outer = (middle, outer) if seen is at_centre else (inner, middle)
    return Change(side * 0.5 * (inner + outer), outer - inner, False)


def least_collapsing(
    collapses: Collapses, low: float, high: float, width: float = 1e-4, grid: int = 12
) -> float:
    """First collapse on a grid, because outcomes are not monotone, then bisected.

    Examples
    --------
    >>> from archbench.search import least_collapsing
    >>> round(least_collapsing(lambda a: a >= 0.7, 0.5, 1.0), 3)
    0.7
    """
    stands, least = low, math.nan
    for amplitude in np.geomspace(low, high, grid).tolist():
        if collapses(amplitude):
            least = amplitude
            break
        stands = amplitude
    while least - stands > width * least:
        middle = 0.5 * (least + stands)
        if collapses(middle):
            least = middle
        else:
            stands = middle
    return least
