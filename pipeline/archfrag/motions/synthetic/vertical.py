"""The vertical component: V/H of response spectra by Gulerce and Abrahamson (2011).

Gulerce and Abrahamson (2011), Site-specific design spectra for vertical ground motion, Earthquake
Spectra 27(4), 1023-1047; strike-slip faults.
"""

import numpy as np
from numpy.typing import NDArray

from archfrag.motions.synthetic.source import ground_motion_duration, read_table, site_factor
from archfrag.motions.synthetic.variation import frequencies, grid, power_fractions
from archfrag.motions.units import STANDARD_GRAVITY

# Coefficients that are the same at all periods.
_C, _N, _C1, _C4, _A3, _A4, _A5 = 1.88, 1.18, 6.75, 10.0, 0.0147, 0.0334, -0.034
_ROCK = 1100.0  # Vs30 at which the model's reference PGA is taken [m/s]
_SHORTEST = 0.04  # period below which amplitudes no longer decide the spectrum [s]
_ROUNDS = 20
_TABLE = "gulerce_abrahamson.csv"
# Correlation of the record terms of a vertical with those of its horizontal: horizontals of one
# record have about 0.7 (Wang, Takedatsu, Olsen and Day 2019, BSSA 109(6)); with it the ratio of a
# vertical to its horizontal varies as Gulerce and Abrahamson found.
COMPONENT_CORRELATION = 0.7


def vertical_ratio(
    magnitude: float, distance: float, vs30: float, rock_pga: float
) -> NDArray[np.float64]:
    """Median of vertical over horizontal Sa (5 %) at `vertical_periods`; rock_pga in g."""
    t = read_table(_TABLE)
    over = magnitude - _C1
    scaling = t["a1"] + t["a8"] * (8.5 - magnitude) ** 2
    scaling += (t["a2"] + _A3 * over) * np.log(np.hypot(distance, _C4))
    scaling += (_A4 if over < 0.0 else _A5) * over
    velocity = np.minimum(vs30, _velocity_limit(t["period_s"]))
    ratio = velocity / t["v_lin"]
    nonlinear = t["b"] * (np.log(rock_pga + _C * ratio**_N) - np.log(rock_pga + _C))
    linear = t["b"] * _N * np.log(ratio)
    site = t["a10"] * np.log(ratio) - np.where(velocity < t["v_lin"], nonlinear, linear)
    return np.exp(scaling + site)


def vertical_periods() -> NDArray[np.float64]:
    """Periods of the model, shape (22,) [s]."""
    return read_table(_TABLE)["period_s"]


def vertical_factor(
    amplitude: NDArray[np.float64], magnitude: float, distance: float, vs30: float
) -> NDArray[np.float64]:
    """ln of the factor on horizontal amplitudes that gives spectra the model's ratio, (61,).

    Peak over root mean square and duration being those of the horizontal, the ratio of spectra is
    the root of that of mean squares; the factor at 1 / T is found by repetition.
    """
    rock = amplitude * site_factor(grid(), _ROCK) / site_factor(grid(), vs30)
    rock_pga = _expected_peak(rock, magnitude, distance) / STANDARD_GRAVITY
    chosen = vertical_periods() >= _SHORTEST
    periods = vertical_periods()[chosen][::-1]
    wanted = np.log(vertical_ratio(magnitude, distance, vs30, rock_pga))[chosen][::-1]
    fractions = power_fractions(amplitude, periods)
    nodes = np.log(1.0 / periods)
    logarithm = wanted.copy()
    for _ in range(_ROUNDS):
        gain = np.exp(2.0 * np.interp(np.log(grid()), nodes, logarithm))
        logarithm += wanted - 0.5 * np.log(fractions @ gain)
    return np.interp(np.log(frequencies()), nodes, logarithm)


def _expected_peak(amplitude: NDArray[np.float64], magnitude: float, distance: float) -> float:
    """Peak of a stationary motion of that amplitude [m/s2]: Davenport (1964)."""
    duration = ground_motion_duration(magnitude, distance)
    power = 2.0 * amplitude**2 * np.gradient(grid())
    crossings = 2.0 * duration * np.sqrt((power * grid() ** 2).sum() / power.sum())
    reach = np.sqrt(2.0 * np.log(max(crossings, 2.0)))
    return float((reach + 0.5772 / reach) * np.sqrt(power.sum() / duration))


def _velocity_limit(period: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vs30 beyond which sites no longer differ [m/s]."""
    middle = np.exp(8.0 - 0.795 * np.log(period / 0.21))
    long = np.exp(6.76 - 0.297 * np.log(period))
    return np.select([period <= 0.5, period <= 1.0, period < 2.0], [1500.0, middle, long], 700.0)
