"""What curves are compared with, and how well that is known.

Beyond the predictability horizon no run has one answer, and a study made once is one draw of its
theta. The reference is the curve of many studies together, by two methods that share nothing but
the contact problem, with settings that differ a little so that each is a draw of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from archfrag.evidence.run import Way

STEP, TOLERANCE = 2e-4, 1e-5
STUDIES = {True: 4, False: 6}
# Between the settings of two studies of one method, relative.
APART = 0.04


def reference_ways(quick: bool) -> tuple[tuple[Way, ...], tuple[Way, ...]]:
    """Fine steps, and events at a tight tolerance.

    Parameters
    ----------
    quick : bool
        Fewer of each.

    Examples
    --------
    >>> from archfrag.evidence.fragility.reference import reference_ways
    >>> [len(ways) for ways in reference_ways(quick=True)]
    [4, 4]
    """
    finer = [1.0 - APART * k for k in range(STUDIES[quick])]
    return (
        tuple(Way("time_stepping", "dt", STEP * factor) for factor in finer),
        tuple(Way("event_driven", "rtol", TOLERANCE * factor) for factor in finer),
    )


def known_to(
    together: Sequence[Sequence[float]], studies: Sequence[Sequence[Sequence[float]]]
) -> NDArray[np.float64]:
    """Error of the reference, by quantity.

    Half of how far its two methods lie apart; or, if that is larger, the standard error of its
    mean, from how studies of one method scatter: methods that agree by chance prove no more.

    Parameters
    ----------
    together : sequence of (ln theta, beta)
        Of all studies of a method, for each of the two.
    studies : sequence of sequence of (ln theta, beta)
        Of every study, for each of the two.

    Examples
    --------
    >>> from archfrag.evidence.fragility.reference import known_to
    >>> known_to([[0.0], [0.3]], [[[0.0]], [[0.3]]]).tolist()
    [0.15]
    >>> known_to([[0.0], [0.0]], [[[-0.1], [0.1]], [[-0.1], [0.1]]]).round(3).tolist()
    [0.071]
    """
    half = 0.5 * np.abs(np.subtract(together[0], together[1]))
    mean = scatter(studies) / np.sqrt(sum(len(each) for each in studies))
    return np.fmax(half, mean)


def scatter(studies: Sequence[Sequence[Sequence[float]]]) -> NDArray[np.float64]:
    """Standard deviation of a single study within its method, by quantity; nan if unknown.

    Errors of two single studies that are smaller are luck, not merit.

    Parameters
    ----------
    studies : sequence of sequence of (ln theta, beta)
        Of every study, for each method.

    Examples
    --------
    >>> from archfrag.evidence.fragility.reference import scatter
    >>> scatter([[[0.9], [1.1]], [[1.4], [1.6]]]).round(3).tolist()
    [0.141]
    """
    variance = [np.var(each, axis=0, ddof=1) for each in studies if len(each) > 1]
    if not variance:
        return np.full(len(studies[0][0]), np.nan)
    return np.sqrt(np.mean(variance, axis=0))
