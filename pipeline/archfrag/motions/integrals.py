"""Measures that are integrals of a motion over time."""

import numpy as np
from numpy.typing import NDArray

from archfrag.motions.motion import Motion
from archfrag.motions.units import STANDARD_GRAVITY

_PART = 2**16  # samples at a time
STANDARD_WINDOW = 1.0  # [s] of the standardised cumulative absolute velocity
STANDARD_LEVEL = 0.025 * STANDARD_GRAVITY  # [m/s2]
_Samples = NDArray[np.float64]


def integral(samples: _Samples, dt: float) -> _Samples:
    """Integral from zero at the first sample by the trapezoid rule, shape (n_sample,)."""
    values = np.zeros(samples.size)
    np.add(samples[1:], samples[:-1], out=values[1:])
    values *= 0.5 * dt
    return np.cumsum(values, out=values)


def pgv(motion: Motion) -> float:
    """Peak ground velocity [m/s]: acceleration integrated from rest by the trapezoid rule.

    The record is taken as it is, so that of a raw record must be filtered first.
    """
    return _largest(integral(motion.acceleration, motion.dt))


def pgd(motion: Motion) -> float:
    """Peak ground displacement [m]: acceleration integrated twice from rest, as in `pgv`."""
    return _largest(integral(integral(motion.acceleration, motion.dt), motion.dt))


def arias(motion: Motion) -> float:
    """Arias intensity, pi / (2 g) times the integral of the squared acceleration [m/s].

    Trapezoid rule on the squared samples. Arias (1970), "A measure of earthquake intensity".
    """
    return float(_husid(motion)[-1])


def arias_times(motion: Motion, fractions: tuple[float, ...]) -> tuple[float, ...]:
    """When the Arias intensity has reached fractions of its total [s]; linear between samples."""
    husid = _husid(motion, both=True)
    if husid[-1] == 0.0:
        return (0.0,) * len(fractions)
    return tuple(float(np.interp(part * husid[-1], husid, motion.time)) for part in fractions)


def significant_duration(motion: Motion) -> float:
    """Time in which the Arias intensity grows from 5 to 95 % of its total [s].

    Trifunac and Brady (1975), BSSA 65(3); linear between samples. A record without motion has no
    duration: 0.
    """
    begin, finish = arias_times(motion._replaced(across=None), (0.05, 0.95))
    return finish - begin


def cav(motion: Motion) -> float:
    """Cumulative absolute velocity, the integral of the absolute acceleration [m/s].

    EPRI (1988), report NP-5930; exact for an acceleration linear between samples.
    """
    record = motion.acceleration
    parts = (record[start : start + _PART + 1] for start in range(0, record.size - 1, _PART))
    return float(sum(_absolute(part, motion.dt).sum() for part in parts))


def cav_standardised(motion: Motion) -> float:
    """Standardised cumulative absolute velocity [m/s].

    The cumulative absolute velocity of the seconds, counted from the first sample, in which the
    acceleration reaches 0.025 g. EPRI (1991), report TR-100082.
    """
    total, record, dt = 0.0, motion.acceleration, motion.dt
    count = round(STANDARD_WINDOW / dt) or 1
    for start in range(0, record.size - 1, count):
        window = record[start : start + count + 1]
        if _largest(window) >= STANDARD_LEVEL:
            total += float(_absolute(window, dt).sum())
    return total


def _husid(motion: Motion, both: bool = False) -> _Samples:
    """Arias intensity up to each sample, of both horizontal components if wanted."""
    squared = motion.acceleration**2
    if both and motion.across is not None:
        squared += motion.across**2
    return np.pi / (2.0 * STANDARD_GRAVITY) * integral(squared, motion.dt)


def _absolute(part: _Samples, dt: float) -> _Samples:
    """Integral of |a| over each step of a part, a linear in it."""
    before, after = np.abs(part[:-1]), np.abs(part[1:])
    together = before + after
    crossing = part[:-1] * part[1:] < 0.0
    squares = np.divide(before**2 + after**2, together, out=np.zeros_like(together),
                        where=crossing)  # fmt: skip
    return 0.5 * dt * np.where(crossing, squares, together)


def _largest(values: _Samples) -> float:
    return float(max(values.max(), -values.min()))
