"""How Fourier amplitudes vary between earthquakes, sites and records.

The logarithm of the amplitude has three normal terms, each a row over frequency: one of the
earthquake (tau), one of the site (phi_s2s) and one of the record (phi_ss). Their standard
deviations, and the correlation between frequencies that all three have, are those of Bayless and
Abrahamson; that amplitudes drawn so give response spectra the variance and the correlation between
periods of records is the theory of Stafford (2017).

References
----------
.. [1] Bayless and Abrahamson (2018), An empirical model for Fourier amplitude spectra using the
   NGA-West2 database, PEER report 2018/07, and its electronic supplement.
.. [2] Bayless and Abrahamson (2019), An empirical model for the interfrequency correlation of
   epsilon for Fourier amplitude spectra, BSSA 109(3), 1058-1070.
.. [3] Stafford (2017), Interfrequency correlations among Fourier spectral ordinates and
   implications for stochastic ground-motion simulation, BSSA 107(6), 2774-2791.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.motions.synthetic.source import table

DAMPING = 0.05
TERMS = {"event": "tau", "site": "phi_s2s", "record": "phi_ss"}
_GRID: NDArray[np.float64] = np.geomspace(0.05, 50.0, 150)  # of integrals over frequency [Hz]
_ROUNDS = 6


def frequencies() -> NDArray[np.float64]:
    """Frequencies at which the terms are drawn, shape (61,) [Hz]; constant beyond their ends."""
    return table()["frequency_hz"]


def correlation(frequency: ArrayLike) -> NDArray[np.float64]:
    """Correlation of ln amplitude between frequencies [Hz], shape (n_frequency, n_frequency).

    tanh(A exp(B x) + C exp(D x)), x = abs(ln(f1 / f2)), A to D at the lower frequency [2]_.
    """
    f = np.clip(np.asarray(frequency, dtype=np.float64), *frequencies()[[0, -1]])
    lower = np.minimum(f[:, None], f)
    apart = np.abs(np.log(f[:, None] / f))
    a, b, c, d = (_at(lower, name) for name in "ABCD")
    values = np.tanh(a * np.exp(b * apart) + c * np.exp(d * apart))
    values[apart == 0.0] = 1.0
    return values


def deviation(frequency: ArrayLike) -> NDArray[np.float64]:
    """Total standard deviation of ln amplitude, shape (n_frequency,)."""
    f = np.asarray(frequency, dtype=np.float64)
    return np.sqrt(sum(_at(f, name) ** 2 for name in TERMS.values()))


def draw_term(kind: str, generator: np.random.Generator) -> NDArray[np.float64]:
    """One term of ln amplitude (``event``, ``site`` or ``record``) at `frequencies`."""
    normal = generator.standard_normal(frequencies().size)
    return table()[TERMS[kind]] * (_factor() @ normal)


def power_fractions(amplitude: NDArray[np.float64], period: ArrayLike) -> NDArray[np.float64]:
    """Fraction of the mean square of oscillators that each frequency of `grid` adds."""
    ratio = _GRID * np.asarray(period, dtype=np.float64)[:, None]
    oscillator = 1.0 / ((1.0 - ratio**2) ** 2 + (2.0 * DAMPING * ratio) ** 2)
    power = amplitude**2 * oscillator * np.gradient(_GRID)
    return power / power.sum(axis=1, keepdims=True)


def grid() -> NDArray[np.float64]:
    """Frequencies of `power_fractions`, shape (150,) [Hz]."""
    return _GRID


def median_correction(amplitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """What to add to ln amplitude so that variation leaves the median of Sa, shape (61,).

    The mean square of an oscillator is a sum over frequencies of lognormal variables, whose median
    is above the sum of their medians unless all vary as one. The correction at a frequency f is
    found by repetition so that the mean of the sum's logarithm, over 150 drawn rows of variation
    and the same with opposite sign, is unchanged at the period 1 / f.
    """
    nodes, periods = np.log(frequencies()), 1.0 / frequencies()
    fractions = power_fractions(amplitude, periods)
    correction = np.zeros(nodes.size)
    for _ in range(_ROUNDS):
        gain = np.exp(2.0 * np.interp(np.log(_GRID), nodes, correction))
        correction -= 0.5 * np.log((fractions * gain) @ _drawn_powers()).mean(axis=1)
    return correction


@lru_cache(maxsize=1)
def _drawn_powers() -> NDArray[np.float64]:
    """Squared factors of many drawn variations at `grid`, shape (150, 300)."""
    generator = np.random.Generator(np.random.PCG64(0))
    normal = _factor() @ generator.standard_normal((frequencies().size, 150))
    normal *= deviation(frequencies())[:, None]
    rows = np.array([np.interp(np.log(_GRID), np.log(frequencies()), row) for row in normal.T])
    return np.exp(2.0 * np.concatenate((rows, -rows)).T)


def _at(frequency: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    return np.asarray(np.interp(frequency, frequencies(), table()[name]), dtype=np.float64)


@lru_cache(maxsize=1)
def _factor() -> NDArray[np.float64]:
    return np.asarray(np.linalg.cholesky(correlation(frequencies())), dtype=np.float64)
