"""Velocity pulses of near faults: Shahi and Baker (2011), Mavroeidis and Papageorgiou (2003).

References
----------
.. [1] Shahi and Baker (2011), An empirically calibrated framework for including the effects of
   near-fault directivity in probabilistic seismic hazard analysis, BSSA 101(2), 742-755: the
   period of a pulse, and the amplification of Sa over the same motion without it. The period's
   coefficients are those of PEER report 2013/15 of the same authors, too; the amplification's are
   from memory and without a second source: check them before use.
.. [2] Mavroeidis and Papageorgiou (2003), A mathematical representation of near-fault ground
   motions, BSSA 93(3), 1099-1131: the form.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.motions.spectra import response_spectrum

_PERIOD = (-5.73, 0.99, 0.56)  # ln s; slope with magnitude; standard deviation
_PEAK_PERIOD = 0.88  # of the amplification, as a fraction of that of the pulse
CYCLES = 2.0  # gamma: neither paper predicts it


def draw_period(magnitude: float, generator: np.random.Generator) -> float:
    """Period of a pulse [s]: ln Tp is normal with mean -5.73 + 0.99 M and deviation 0.56 [1]_."""
    start, slope, sigma = _PERIOD
    return float(np.exp(start + slope * magnitude + sigma * generator.standard_normal()))


def amplification(ratio: ArrayLike) -> NDArray[np.float64]:
    """Median Sa with a pulse over that without, at T / Tp, shape of `ratio` [1]_."""
    ratio = np.asarray(ratio, dtype=np.float64)
    apart = (np.log(ratio) + 0.127) ** 2
    short = 1.131 * np.exp(-3.11 * apart) + 0.058
    long = 0.924 * np.exp(-2.11 * apart) + 0.255
    return np.exp(np.where(ratio <= _PEAK_PERIOD, short, long))


def wavelet(time: ArrayLike, period: float, phase: float) -> NDArray[np.float64]:
    """Acceleration of a pulse whose velocity has the amplitude 1 m/s, shape of `time` [m/s2].

    The derivative of (1 + cos(2 pi t / (gamma Tp))) cos(2 pi t / Tp + phase) / 2 [2]_, zero where
    abs(t) > gamma Tp / 2; `time` [s] is from its middle.
    """
    angle = 2.0 * np.pi * np.asarray(time, dtype=np.float64) / period
    envelope = 1.0 + np.cos(angle / CYCLES)
    slope = -np.sin(angle / CYCLES) / CYCLES * np.cos(angle + phase)
    slope -= envelope * np.sin(angle + phase)
    return np.where(np.abs(angle) <= np.pi * CYCLES, np.pi / period * slope, 0.0)


def add_pulse(
    samples: NDArray[np.float64],
    time: NDArray[np.float64],
    magnitude: float,
    generator: np.random.Generator,
) -> tuple[NDArray[np.float64], float]:
    """A motion with a pulse at time zero, and its period [s]: at 0.88 Tp it amplifies as [1]_."""
    period = draw_period(magnitude, generator)
    pulse = wavelet(time, period, generator.uniform(0.0, 2.0 * np.pi))
    dt, at = time[1] - time[0], _PEAK_PERIOD * period
    without, alone = (response_spectrum(row, dt, at)[0] for row in (samples, pulse))
    gain = np.sqrt(amplification(_PEAK_PERIOD) ** 2 - 1.0)
    return samples + gain * without / alone * pulse, period
