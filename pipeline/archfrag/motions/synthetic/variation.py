"""How Fourier amplitudes vary between earthquakes, sites, records and directions.

The logarithm of the amplitude has three normal terms, each a row over frequency: one of the
earthquake (tau), one of the site (phi_s2s) and one of the record (phi_ss). Their standard
deviations, and the correlation between frequencies that all three have, are those of Bayless and
Abrahamson; that amplitudes drawn so give response spectra the variance and the correlation between
periods of records is the theory of Stafford (2017). A vertical component has V/H of response
spectra by Gulerce and Abrahamson, strike-slip faults.

References
----------
.. [1] Bayless and Abrahamson (2018), An empirical model for Fourier amplitude spectra using the
   NGA-West2 database, PEER report 2018/07, and its electronic supplement.
.. [2] Bayless and Abrahamson (2019), An empirical model for the interfrequency correlation of
   epsilon for Fourier amplitude spectra, BSSA 109(3), 1058-1070.
.. [3] Stafford (2017), Interfrequency correlations among Fourier spectral ordinates and
   implications for stochastic ground-motion simulation, BSSA 107(6), 2774-2791.
.. [4] Gulerce and Abrahamson (2011), Site-specific design spectra for vertical ground motion,
   Earthquake Spectra 27(4), 1023-1047.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from archfrag.motions.synthetic.source import (
    COEFFICIENTS,
    FREQUENCIES,
    Row,
    ground_motion_duration,
    read_table,
    site_factor,
)
from archfrag.motions.units import STANDARD_GRAVITY

DAMPING = 0.05
TERMS = {"event": "tau", "site": "phi_s2s", "record": "phi_ss"}
GRID: Row = np.geomspace(0.05, 50.0, 150)  # of integrals over frequency [Hz]
_PASSES, _VERTICAL_PASSES = 6, 20
# Correlation of the record terms of a vertical with those of its horizontal: horizontals of one
# record have about 0.7 (Wang, Takedatsu, Olsen and Day 2019, BSSA 109(6)); with it the ratio of a
# vertical to its horizontal varies as Gulerce and Abrahamson found.
COMPONENT_CORRELATION = 0.7
# Gulerce and Abrahamson: coefficients by period, and those that are the same at all periods.
RATIO = read_table("gulerce_abrahamson.csv")
_C, _N, _C1, _C4, _A3, _A4, _A5 = 1.88, 1.18, 6.75, 10.0, 0.0147, 0.0334, -0.034
_ROCK = 1100.0  # Vs30 at which the model's reference PGA is taken [m/s]
_SHORTEST = 0.04  # period below which amplitudes no longer decide the spectrum [s]


def correlation(frequency: ArrayLike) -> Row:
    """Correlation of ln amplitude between frequencies [Hz], shape (n_frequency, n_frequency).

    tanh(A exp(B x) + C exp(D x)), x = abs(ln(f1 / f2)), A to D at the lower frequency [2]_.
    """
    f = np.clip(np.asarray(frequency, dtype=np.float64), *FREQUENCIES[[0, -1]])
    lower = np.minimum(f[:, None], f)
    apart = np.abs(np.log(f[:, None] / f))
    a, b, c, d = (np.interp(lower, FREQUENCIES, COEFFICIENTS[name]) for name in "ABCD")
    values = np.tanh(a * np.exp(b * apart) + c * np.exp(d * apart))
    values[apart == 0.0] = 1.0
    return values


@lru_cache(maxsize=1)
def _factor() -> Row:
    return np.asarray(np.linalg.cholesky(correlation(FREQUENCIES)), dtype=np.float64)


def draw_term(kind: str, generator: np.random.Generator) -> Row:
    """One term of ln amplitude (``event``, ``site`` or ``record``) at ``FREQUENCIES``."""
    normal = generator.standard_normal(FREQUENCIES.size)
    return COEFFICIENTS[TERMS[kind]] * (_factor() @ normal)


def _power_fractions(amplitude: Row, period: Row) -> Row:
    """Fraction of the mean square of oscillators that each frequency of ``GRID`` adds."""
    ratio = GRID * period[:, None]
    oscillator = 1.0 / ((1.0 - ratio**2) ** 2 + (2.0 * DAMPING * ratio) ** 2)
    power = amplitude**2 * oscillator * np.gradient(GRID)
    return power / power.sum(axis=1, keepdims=True)


def median_correction(amplitude: Row) -> Row:
    """What to add to ln amplitude so that variation leaves the median of Sa, shape (61,).

    The mean square of an oscillator is a sum over frequencies of lognormal variables, whose median
    is above the sum of their medians unless all vary as one. The correction at a frequency f is
    found by repetition so that the mean of the sum's logarithm, over 150 drawn rows of variation
    and the same with opposite sign, is unchanged at the period 1 / f. `amplitude` is at ``GRID``.
    """
    nodes = np.log(FREQUENCIES)
    fractions = _power_fractions(amplitude, 1.0 / FREQUENCIES)
    correction = np.zeros(nodes.size)
    for _ in range(_PASSES):
        gain = np.exp(2.0 * np.interp(np.log(GRID), nodes, correction))
        correction -= 0.5 * np.log((fractions * gain) @ _drawn_powers()).mean(axis=1)
    return correction


@lru_cache(maxsize=1)
def _drawn_powers() -> Row:
    """Squared factors of many drawn variations at ``GRID``, shape (150, 300)."""
    generator = np.random.Generator(np.random.PCG64(0))
    normal = _factor() @ generator.standard_normal((FREQUENCIES.size, 150))
    total = np.sqrt(sum(COEFFICIENTS[name] ** 2 for name in TERMS.values()))
    normal *= total[:, None]
    rows = np.array([np.interp(np.log(GRID), np.log(FREQUENCIES), row) for row in normal.T])
    return np.exp(2.0 * np.concatenate((rows, -rows)).T)


def vertical_ratio(magnitude: float, distance: float, vs30: float, rock_pga: float) -> Row:
    """Median V/H of Sa (5 %) [4]_ at the periods of ``RATIO``, shape (22,); rock_pga in g."""
    t, period = RATIO, RATIO["period_s"]
    over = magnitude - _C1
    scaling = t["a1"] + t["a8"] * (8.5 - magnitude) ** 2
    scaling += (t["a2"] + _A3 * over) * np.log(np.hypot(distance, _C4))
    scaling += (_A4 if over < 0.0 else _A5) * over
    # Vs30 beyond which sites no longer differ [m/s].
    middle = np.exp(8.0 - 0.795 * np.log(period / 0.21))
    long = np.exp(6.76 - 0.297 * np.log(period))
    ends = [period <= 0.5, period <= 1.0, period < 2.0]
    velocity = np.minimum(vs30, np.select(ends, [1500.0, middle, long], 700.0))
    ratio = velocity / t["v_lin"]
    nonlinear = t["b"] * (np.log(rock_pga + _C * ratio**_N) - np.log(rock_pga + _C))
    linear = t["b"] * _N * np.log(ratio)
    site = t["a10"] * np.log(ratio) - np.where(velocity < t["v_lin"], nonlinear, linear)
    return np.exp(scaling + site)


def vertical_factor(amplitude: Row, magnitude: float, distance: float, vs30: float) -> Row:
    """ln of the factor on horizontal amplitudes that gives spectra the model's V/H, (61,).

    Peak over root mean square and duration being those of the horizontal, the ratio of spectra is
    the root of that of mean squares; the factor at 1 / T is found by repetition.
    """
    rock = amplitude * site_factor(GRID, _ROCK) / site_factor(GRID, vs30)
    rock_pga = _expected_peak(rock, magnitude, distance) / STANDARD_GRAVITY
    kept = RATIO["period_s"] >= _SHORTEST
    periods = RATIO["period_s"][kept][::-1]
    target = np.log(vertical_ratio(magnitude, distance, vs30, rock_pga))[kept][::-1]
    fractions = _power_fractions(amplitude, periods)
    nodes = np.log(1.0 / periods)
    logarithm = target.copy()
    for _ in range(_VERTICAL_PASSES):
        gain = np.exp(2.0 * np.interp(np.log(GRID), nodes, logarithm))
        logarithm += target - 0.5 * np.log(fractions @ gain)
    return np.interp(np.log(FREQUENCIES), nodes, logarithm)


def _expected_peak(amplitude: Row, magnitude: float, distance: float) -> float:
    """Peak of a stationary motion of that amplitude [m/s2]: Davenport (1964)."""
    duration = ground_motion_duration(magnitude, distance)
    power = 2.0 * amplitude**2 * np.gradient(GRID)
    crossings = 2.0 * duration * np.sqrt((power * GRID**2).sum() / power.sum())
    reach = np.sqrt(2.0 * np.log(max(crossings, 2.0)))
    return float((reach + 0.5772 / reach) * np.sqrt(power.sum() / duration))
