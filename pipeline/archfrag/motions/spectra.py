"""Response spectra: linear oscillators under an acceleration that is linear between samples.

The recursion of Nigam and Jennings (1969), BSSA 59(2), exact for such a motion. Between two
samples the response y = w^2 u to an acceleration a + s t is a particular solution and a free
vibration, y = -a - s t + 2 z s / w + f(t). Where the slope s changes by ds, y and y' stay as they
are: f changes by -2 z ds / w, and g = f' / w by ds / w.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError

SAMPLES_PER_PERIOD = 200  # where peaks are looked for
_DIGITS = 10  # of a spectrum; more depend on the machine's exponential function
ANGLES = np.deg2rad(np.arange(180.0))  # of directions in the horizontal plane


def response_spectrum(
    acceleration: NDArray[np.float64], dt: float, periods: ArrayLike, damping: float = 0.05
) -> NDArray[np.float64]:
    """Sa of oscillators from rest, shape (n_period,) [m/s2].

    Peaks are looked for at 200 points of a period or more (to 0.1 %, even of white noise). The
    acceleration falls to zero in one step after the record; the free vibration that follows
    counts. InputError for a period that is not positive or a damping outside [0, 1).
    """
    return _spectrum(acceleration, dt, periods, damping, np.zeros(1))[:, 0]


def rotated_spectrum(
    pair: tuple[NDArray[np.float64], NDArray[np.float64]], dt: float, periods: ArrayLike,
    damping: float = 0.05,
) -> NDArray[np.float64]:  # fmt: skip
    """Sa in each direction of the horizontal plane, (n_period, 180) [m/s2], by degrees."""
    return _spectrum(pair[0] + 1j * pair[1], dt, periods, damping, ANGLES)


def _spectrum(
    ground: NDArray[Any], dt: float, periods: ArrayLike, damping: float,
    angles: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """Sa by angle, (n_period, n_angle); the second component is the imaginary part of `ground`."""
    chosen = np.atleast_1d(np.asarray(periods, dtype=np.float64))
    if not (np.isfinite(chosen).all() and (chosen > 0.0).all()):
        raise InputError(f"periods {chosen.tolist()} must be positive numbers of seconds")
    if not 0.0 <= damping < 1.0:
        raise InputError(f"damping {damping} must be in [0, 1)")
    # A period after the record, in which it falls to zero within one step.
    after = np.ceil(chosen / dt).astype(int) + 2
    padded = np.pad(ground, (0, after.max(initial=0)))
    largest = np.zeros((chosen.size, angles.size))
    loop, directions = _compiled(), np.exp(1j * angles)
    for period, count, row in zip(chosen.tolist(), after + ground.size, largest):
        loop(padded[:count], float(dt), 2.0 * np.pi / period, float(damping), directions, row)
    scale = 10.0 ** (_DIGITS - 1 - np.floor(np.log10(np.where(largest > 0.0, largest, 1.0))))
    return np.round(largest * scale) / scale


@functools.cache
def _compiled() -> Callable[..., None]:
    from archfrag.mechanics.compile import kernel  # imports numba, which takes time

    return kernel(_put_largest)


def _put_largest(ground, dt, w, z, directions, largest):  # type: ignore[no-untyped-def]
    """Put the largest |y| in each direction [m/s2] into `largest`, (n_direction,)."""
    points = max(1, int(np.ceil(SAMPLES_PER_PERIOD * dt * w / (2.0 * np.pi))))
    step, root = dt / points, np.sqrt(1.0 - z * z)
    decay = np.exp(-z * w * step)
    cosine, sine = decay * np.cos(root * w * step), decay * np.sin(root * w * step) / root
    f, g, slope, least = ground[0], 0.0 * ground[0], 0.0 * ground[0], 0.0  # y = y' = 0
    for n in range(ground.size - 1):
        change = (ground[n + 1] - ground[n]) / dt - slope
        slope += change
        f, g = f - 2.0 * z / w * change, g + change / w
        for k in range(points):
            y = f - ground[n] + slope * (2.0 * z / w - k * step)
            if y.real**2 + y.imag**2 > least**2:
                least = np.inf
                for i in range(directions.size):
                    here = abs(y.real * directions[i].real + y.imag * directions[i].imag)
                    largest[i] = max(largest[i], here)
                    least = min(least, largest[i])
            f, g = (cosine + z * sine) * f + sine * g, (cosine - z * sine) * g - sine * f
