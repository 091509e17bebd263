"""Search for the amplitude at which a chain begins to collapse."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Collapses = Callable[[float], bool | None]


class Change(NamedTuple):
    """Where outcomes change, relative to where they were expected to.

    `offset` has a sign, nan if there is no change within reach or a run gave no outcome, which is
    `failed`; `width` is that of the bracket that remains.
    """

    offset: float = math.nan
    width: float = math.nan
    failed: bool = False


def nearest_change(
    collapses: Collapses, centre: float, floor: float, reach: float = 0.5, fraction: float = 0.1
) -> Change:
    """Distance of the change from standing to collapse that is nearest to `centre`.

    Probes go away from the centre by factors of ten, towards smaller values if it collapses and
    larger ones if it stands, until outcomes differ; what lies between is bisected on the log
    scale.
    """
    at_centre = collapses(centre)
    if at_centre is None:
        return Change(failed=True)
    side, inner, outer, changed = -1.0 if at_centre else 1.0, 0.0, floor, False
    while not changed or outer - inner > max(floor, fraction * inner):
        middle = math.sqrt(inner * outer) if inner > 0.0 else 0.5 * outer
        probe = middle if changed else outer
        seen = collapses(centre * (1.0 + side * probe))
        if seen is None:
            return Change(failed=True)
        if changed:
            inner, outer = (middle, outer) if seen is at_centre else (inner, middle)
        elif seen is not at_centre:
            changed = True
        elif outer >= reach:
            return Change()
        else:
            inner, outer = outer, min(10.0 * outer, reach)
    return Change(side * 0.5 * (inner + outer), outer - inner)


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
        stands, least = (stands, middle) if collapses(middle) else (middle, least)
    return least
