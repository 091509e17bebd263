"""Intensity measures of a ground motion, all in SI units and of its horizontal component.

No measure changes the record: nothing is demeaned, filtered or tapered here (see `process`).
"""

import difflib
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.motions.motion import Motion
from archfrag.motions.process import velocity
from archfrag.motions.units import STANDARD_GRAVITY

SAMPLES_PER_PERIOD = 60
AVERAGED_PERIODS = 10
_PLAIN = {"PGA": "m/s2", "PGV": "m/s", "Arias": "m/s", "D5_95": "s"}
_ALLOWED = "PGA, PGV, Arias, D5_95, Sa(T), AvgSA(T1,T2) with periods in seconds"
_SPECTRAL = re.compile(r"(Sa|AvgSA)\(([^()]*)\)")


class Measure(NamedTuple):
    """A parsed name: its kind, its periods [s] if any, and the SI unit of its values."""

    kind: str
    periods: tuple[float, ...]
    unit: str


def parse_measure(name: str) -> Measure:
    """Read the name of an intensity measure.

    Parameters
    ----------
    name : str
        ``PGA``, ``PGV``, ``Arias``, ``D5_95``, ``Sa(0.5)`` or ``AvgSA(0.2,1.0)``.

    Raises
    ------
    InputError
        If the name is none of these or a period is not a positive number.
    """
    text = name.strip() if isinstance(name, str) else ""
    if text in _PLAIN:
        return Measure(text, (), _PLAIN[text])
    found = _SPECTRAL.fullmatch(text)
    if not found:
        close = difflib.get_close_matches(text.upper(), [key.upper() for key in _PLAIN], 1)
        meant = [key for key in _PLAIN if key.upper() in close]
        hint = f" (did you mean {meant[0]}?)" if meant else ""
        raise InputError(f"unknown intensity measure {name!r}{hint}; allowed are {_ALLOWED}")
    kind = found.group(1)
    try:
        periods = tuple(float(part) for part in found.group(2).split(","))
    except ValueError:
        periods = ()
    count = 1 if kind == "Sa" else 2
    if len(periods) != count or not all(np.isfinite(p) and p > 0.0 for p in periods):
        raise InputError(
            f"intensity measure {name!r} needs {count} period(s) in seconds, each above 0"
        )
    if kind == "AvgSA" and periods[0] >= periods[1]:
        raise InputError(f"intensity measure {name!r} needs its shorter period first")
    return Measure(kind, periods, "m/s2")


def measure_unit(name: str) -> str:
    """SI unit of the values of an intensity measure: ``m/s2``, ``m/s`` or ``s``."""
    return parse_measure(name).unit


def measure(motion: Motion, name: str) -> float:
    """Value of the named intensity measure in its SI unit (see `parse_measure`)."""
    kind, periods, _ = parse_measure(name)
    if kind == "Sa":
        return float(spectral_acceleration(motion, periods)[0])
    if kind == "AvgSA":
        return average_spectral_acceleration(motion, *periods)
    return {"PGA": pga, "PGV": pgv, "Arias": arias, "D5_95": significant_duration}[kind](motion)


def pga(motion: Motion) -> float:
    """Peak ground acceleration: the largest absolute sample [m/s2]."""
    return float(np.abs(motion.acceleration).max())


def pgv(motion: Motion) -> float:
    """Peak ground velocity [m/s]: acceleration integrated from rest by the trapezoid rule.

    The record is taken as it is, so that of a raw record must be filtered first.
    """
    return float(np.abs(velocity(motion)).max())


def arias(motion: Motion) -> float:
    """Arias intensity, pi / (2 g) times the integral of the squared acceleration [m/s].

    Trapezoid rule on the squared samples. Arias (1970), "A measure of earthquake intensity".
    """
    return float(_husid(motion)[-1])


def significant_duration(motion: Motion, start: float = 0.05, end: float = 0.95) -> float:
    """Time in which the Arias intensity grows from one share of its total to another [s].

    Trifunac and Brady (1975), BSSA 65(3), with 5 and 95 %; linear between samples. A record
    without motion has no duration: 0.
    """
    husid = _husid(motion)
    if husid[-1] == 0.0:
        return 0.0
    begin, finish = np.interp((start * husid[-1], end * husid[-1]), husid, motion.time)
    return float(finish - begin)


def spectral_acceleration(
    motion: Motion, periods: ArrayLike, damping: float = 0.05
) -> NDArray[np.float64]:
    """Pseudo-spectral acceleration of linear oscillators [m/s2].

    The largest (2 pi / T)^2 |u| of u'' + 2 z w u' + w^2 u = -a(t) from rest, with a(t) linear
    between samples and zero after the last: the exact recursion of Nigam and Jennings (1969),
    BSSA 59(2), run as a digital filter. Where a period has fewer than 60 samples the record is
    refined by linear interpolation, which changes neither a(t) nor the exactness but finds the
    peak between samples (to 0.14 % at worst). The free vibration after the record counts.

    Parameters
    ----------
    motion : Motion
    periods : array_like, shape (n_period,) [s]
    damping : float
        Share of critical damping, in [0, 1).

    Returns
    -------
    numpy.ndarray, shape (n_period,) [m/s2]

    Raises
    ------
    InputError
        If a period is not positive or the damping is outside [0, 1).
    """
    period_list = np.atleast_1d(np.asarray(periods, dtype=np.float64))
    if not (np.isfinite(period_list).all() and (period_list > 0.0).all()):
        raise InputError(f"periods {period_list.tolist()} must be positive numbers of seconds")
    if not 0.0 <= damping < 1.0:
        raise InputError(f"damping {damping} must be in [0, 1)")
    return np.array([_peak_pseudo_acceleration(motion, period, damping) for period in period_list])


def average_spectral_acceleration(
    motion: Motion, shortest: float, longest: float, damping: float = 0.05
) -> float:
    """Geometric mean of Sa at 10 periods from `shortest` to `longest` [s], equally spaced in log.

    Returns m/s2.  Eads, Miranda and Lignos (2015), EESD 44(12).
    """
    spectrum = spectral_acceleration(
        motion, np.geomspace(shortest, longest, AVERAGED_PERIODS), damping
    )
    if not spectrum.all():
        return 0.0
    return float(np.exp(np.log(spectrum).mean()))


def _husid(motion: Motion) -> NDArray[np.float64]:
    from scipy.integrate import cumulative_trapezoid

    squared = cumulative_trapezoid(motion.acceleration**2, dx=motion.dt, initial=0.0)
    return np.pi / (2.0 * STANDARD_GRAVITY) * squared


def _peak_pseudo_acceleration(motion: Motion, period: float, damping: float) -> float:
    frequency = 2.0 * np.pi / period
    refinement = max(1, int(np.ceil(SAMPLES_PER_PERIOD * motion.dt / period)))
    step = motion.dt / refinement
    record = motion.acceleration
    if refinement > 1:
        fine = np.arange((record.size - 1) * refinement + 1) / refinement
        record = np.interp(fine, np.arange(record.size), record)
    after = np.zeros(int(np.ceil(period / step)) + 1)
    response = _oscillator(np.concatenate((record, after)), step, frequency, damping)
    return float(frequency**2 * np.abs(response).max())


def _oscillator(
    record: NDArray[np.float64], step: float, frequency: float, damping: float
) -> NDArray[np.float64]:
    """Relative displacement at the samples, from rest at the first, shape of `record` [m].

    The state x = (u, u') obeys x[k+1] = A x[k] + P a[k] + Q a[k+1]; eliminating u' gives a
    second-order filter whose initial state below makes x[0] zero although a[0] is not.
    """
    from scipy.signal import lfilter

    damped = frequency * np.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * frequency * step)
    cosine, sine = np.cos(damped * step), np.sin(damped * step)
    slope = damping * frequency / damped
    transition = decay * np.array(
        [
            [cosine + slope * sine, sine / damped],
            [-(frequency**2) / damped * sine, cosine - slope * sine],
        ]
    )
    # Particular solution for -a0 - s t:  u = -(a0 + s t) / w^2 + 2 z s / w^3.
    ramp = 2.0 * damping / frequency**3
    start_constant = np.array([1.0, 0.0]) / frequency**2
    start_ramp = np.array([-ramp, 1.0 / frequency**2])
    end_ramp = np.array([-ramp + step / frequency**2, 1.0 / frequency**2])
    unit_constant = transition @ start_constant - start_constant
    unit_ramp = transition @ start_ramp - end_ramp
    after = unit_ramp / step
    before = unit_constant - after

    trace, determinant = np.trace(transition), decay**2
    numerator = np.array(
        [
            after[0],
            before[0] - transition[1, 1] * after[0] + transition[0, 1] * after[1],
            -transition[1, 1] * before[0] + transition[0, 1] * before[1],
        ]
    )
    first = record[0]
    initial = np.array([-numerator[0] * first, (before[0] - numerator[1]) * first])
    return lfilter(numerator, [1.0, -trace, determinant], record, zi=initial)[0]
