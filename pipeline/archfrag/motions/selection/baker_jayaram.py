"""Correlation of spectral accelerations at two periods: Baker and Jayaram (2008)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError

SHORTEST, LONGEST = 0.01, 10.0  # periods for which the model was fitted [s]


def correlation(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Correlation of ln Sa at two periods, about the median of a ground-motion model.

    With T the shorter and U the longer period,

    C1 = 1 - cos(pi/2 - 0.366 ln(U / max(T, 0.109)))
    C2 = 1 - 0.105 (1 - 1 / (1 + exp(100 U - 5))) (U - T) / (U - 0.0099) if U < 0.2, else 0
    C3 = C2 if U < 0.109, else C1
    C4 = C1 + 0.5 (sqrt(C3) - C3) (1 + cos(pi T / 0.109))

    and the correlation is C2 if U < 0.109, C1 if T > 0.109, min(C2, C4) if U < 0.2, else C4.

    Baker and Jayaram (2008), Correlation of spectral acceleration values from NGA ground motion
    models, Earthquake Spectra 24(1), 299-317.

    Parameters
    ----------
    first, second : array_like [s]
        Periods; they are broadcast against each other.

    Returns
    -------
    numpy.ndarray [1]

    Raises
    ------
    InputError
        If a period is outside 0.01 to 10 s, where the model was fitted.

    Examples
    --------
    >>> from archfrag.motions.selection import correlation
    >>> float(correlation(0.5, 1.0).round(2)), float(correlation(0.05, 1.0).round(2))
    (0.75, 0.42)
    """
    one, other = (_checked(periods) for periods in (first, second))
    short, long = np.minimum(one, other), np.maximum(one, other)
    c1 = 1.0 - np.cos(0.5 * np.pi - 0.366 * np.log(long / np.maximum(short, 0.109)))
    growth = 1.0 - 1.0 / (1.0 + np.exp(100.0 * np.minimum(long, 0.2) - 5.0))
    c2 = np.where(long < 0.2, 1.0 - 0.105 * growth * (long - short) / (long - 0.0099), 0.0)
    c3 = np.where(long < 0.109, c2, c1)
    c4 = c1 + 0.5 * (np.sqrt(c3) - c3) * (1.0 + np.cos(np.pi * short / 0.109))
    return np.select(
        [long < 0.109, short > 0.109, long < 0.2], [c2, c1, np.minimum(c2, c4)], default=c4
    )


def _checked(periods: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(periods, dtype=np.float64)
    outside = values[~((values >= SHORTEST) & (values <= LONGEST))]
    if outside.size:
        raise InputError(
            f"period {outside.flat[0]:g} s is outside {SHORTEST:g} to {LONGEST:g} s, for which "
            "the correlations of Baker and Jayaram (2008) were fitted"
        )
    return values
