"""Where verdicts change nearest to a known place, in few runs: its distance on a log scale."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from archfrag.evidence.run import Verdict


class Change(NamedTuple):
    """Where verdicts change, relative to where they were expected to.

    Attributes
    ----------
    offset : float
        Relative distance with its sign; nan if there is no change within reach or a run failed.
    width : float
        Relative width of the bracket that is left.
    runs : int
    failed : bool
        Whether a run gave no verdict.
    """

    offset: float
    width: float
    runs: int
    failed: bool


def nearest_change(
    falls: Callable[[float], Verdict],
    centre: float,
    floor: float,
    reach: float = 0.5,
    share: float = 0.1,
) -> Change:
    """Distance of the change from standing to collapse that is nearest to `centre`.

    Probes go away from the centre by factors of ten, towards smaller values if it collapses and
    larger ones if it stands, until verdicts differ; what lies between is bisected on the log
    scale.

    Parameters
    ----------
    falls : callable
        Takes an amplitude; True, False, or None for a failed run.
    centre : float
        Of the change that is expected.
    floor : float
        Smallest relative distance of interest.
    reach : float
        Largest relative distance tried.
    share : float
        The bracket ends at this share of the distance, or at `floor`.

    Returns
    -------
    Change

    Examples
    --------
    >>> from archfrag.evidence.speed.first_change import nearest_change
    >>> found = nearest_change(lambda a: a >= 1.003, 1.0, 1e-6)
    >>> abs(found.offset - 0.003) < 2e-4, found.failed
    (True, False)
    """
    runs = 0

    def probe(offset: float) -> Verdict:
        nonlocal runs
        runs += 1
        return falls(centre * (1.0 + offset))

    at_centre = probe(0.0)
    if at_centre is None:
        return Change(math.nan, math.nan, runs, True)
    side = -1.0 if at_centre else 1.0
    inner, outer = 0.0, floor
    while True:
        seen = probe(side * outer)
        if seen is None:
            return Change(math.nan, math.nan, runs, True)
        if seen is not at_centre:
            break
        if outer >= reach:
            return Change(math.nan, math.nan, runs, False)
        inner, outer = outer, min(10.0 * outer, reach)
    while outer - inner > max(floor, share * inner):
        middle = math.sqrt(inner * outer) if inner > 0.0 else 0.5 * outer
        seen = probe(side * middle)
        if seen is None:
            return Change(math.nan, math.nan, runs, True)
        if seen is at_centre:
            inner = middle
        else:
            outer = middle
    return Change(side * 0.5 * (inner + outer), outer - inner, runs, False)
