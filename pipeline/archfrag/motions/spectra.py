"""Response spectra: linear oscillators under an acceleration that is linear between samples.

The recursion of Nigam and Jennings (1969), BSSA 59(2), exact for such a motion. Between two
samples a relative displacement is a particular solution and a free vibration,

    u(t) = -(a + s t) / w^2 + 2 z s / w^3 + Re(q exp(l t)),    l = -z w + i w sqrt(1 - z^2),

s the slope of the acceleration. Displacement and velocity are continuous where the slope changes,
so that q follows from one sample to the next by q' = q exp(l dt) + c (s' - s). Blocks of samples
are done as products of matrices, which takes a fraction of the time of a recursion by samples and
the memory of one block.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError

SAMPLES_PER_PERIOD = 60  # where peaks are looked for: a peak is missed by 0.14 % at worst
_BLOCK = 16  # samples in one product
_BLOCKS = 2048  # there at a time
_PRODUCTS = 200_000  # in one call: fewer than numerical libraries give to threads
_DIGITS = 10
_ANGLES = np.deg2rad(np.arange(180.0))


def response_spectrum(
    acceleration: NDArray[np.float64], dt: float, periods: ArrayLike, damping: float = 0.05
) -> NDArray[np.float64]:
    """Sa of oscillators from rest, free vibration after the record included, shape (n_period,)."""

    def peak(u: NDArray[np.float64], largest: NDArray[np.float64]) -> None:
        largest[0] = max(largest[0], u.max(), -u.min())

    return _largest_responses((acceleration,), dt, periods, damping, peak, 1)[:, 0]


def rotated_spectrum(
    pair: tuple[NDArray[np.float64], NDArray[np.float64]],
    dt: float,
    periods: ArrayLike,
    damping: float = 0.05,
) -> NDArray[np.float64]:
    """Sa in each direction of the horizontal plane, (n_period, 180) [m/s2], by degrees."""
    return _largest_responses(pair, dt, periods, damping, peaks_by_angle, _ANGLES.size)


def _largest_responses(
    rows: tuple[NDArray[np.float64], ...], dt: float, periods: ArrayLike, damping: float,
    update: Callable[..., Any], size: int,
) -> NDArray[np.float64]:  # fmt: skip
    """Largest w^2 u as `update` finds it in displacements by all components, (n_period, size)."""
    oscillators = _oscillators(dt, periods, damping)
    states = [[samples[0] * o.sudden for samples in rows] for o in oscillators]
    largest = np.zeros((len(oscillators), size))
    for windows in zip(*map(_windows, rows), strict=True):
        for number, oscillator in enumerate(oscillators):
            states[number] = list(map(oscillator.put_states, windows, states[number]))
            for responses in zip(*map(oscillator.responses, windows)):
                update(*responses, largest[number])
    for number, oscillator in enumerate(oscillators):
        update(*map(oscillator.free_vibration, states[number]), largest[number])
    return rounded([o.frequency**2 * row for o, row in zip(oscillators, largest)])


def peaks_by_angle(
    one: NDArray[np.float64], other: NDArray[np.float64],
    largest: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:  # fmt: skip
    """Largest |one cos(angle) + other sin(angle)| at 0, 1, … 179 degrees, and of `largest`."""
    if largest is None:
        largest = np.zeros(_ANGLES.size)
    points = np.column_stack((one.ravel(), other.ravel()))
    directions = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)))
    first = points[np.abs(points @ directions[:, ::15]).argmax(axis=0)]
    np.maximum(largest, np.abs(first @ directions).max(axis=0), out=largest)
    outer = points[np.hypot(points[:, 0], points[:, 1]) > largest.min()]
    for start in range(0, len(outer), 4096):
        part = np.abs(outer[start : start + 4096] @ directions).max(axis=0)
        np.maximum(largest, part, out=largest)
    return largest


def rounded(values: ArrayLike) -> NDArray[np.float64]:
    """The values to as many digits as do not depend on the order in which a machine sums."""
    exact = np.asarray(values, dtype=np.float64)
    scale = 10.0 ** (_DIGITS - 1 - np.floor(np.log10(np.where(exact > 0.0, exact, 1.0))))
    return np.where(exact > 0.0, np.round(exact * scale) / scale, 0.0)


def _oscillators(dt: float, periods: ArrayLike, damping: float) -> list["_Oscillator"]:
    wanted = np.atleast_1d(np.asarray(periods, dtype=np.float64))
    if not (np.isfinite(wanted).all() and (wanted > 0.0).all()):
        raise InputError(f"periods {wanted.tolist()} must be positive numbers of seconds")
    if not 0.0 <= damping < 1.0:
        raise InputError(f"damping {damping} must be in [0, 1)")
    return [_oscillator(float(dt), period, float(damping)) for period in wanted.tolist()]


def _windows(record: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Samples of each block with the one before and the one after it, and two free columns."""
    length = _BLOCK * _BLOCKS
    for start in range(0, record.size, length):
        part = record[max(start - 1, 0) : start + length + 1]
        count = -(-min(length, record.size - start) // _BLOCK)
        samples = np.zeros(count * _BLOCK + 2)
        first = 1 if start == 0 else 0
        samples[0] = part[0]
        samples[first : first + part.size] = part
        windows = np.empty((count, _BLOCK + 4))
        windows[:, :-2] = sliding_window_view(samples, _BLOCK + 2)[::_BLOCK]
        yield windows


class _Oscillator:
    """Relative displacements of one oscillator, from blocks of samples."""

    def __init__(self, dt: float, period: float, damping: float) -> None:
        self.frequency = w = 2.0 * np.pi / period
        points = max(1, int(np.ceil(SAMPLES_PER_PERIOD * dt / period)))
        root = np.sqrt(1.0 - damping**2)
        pole = complex(-damping * w, root * w)
        # q(0) = y(0) - i (y'(0) + z w y(0)) / (w root): of a sudden acceleration of 1, and of a
        # slope of 1 with y(0) = -2 z / w^3 and y'(0) = 1 / w^2.
        self.sudden = complex(1.0, -damping / root) / w**2
        slope = -complex(2.0 * damping, (1.0 - 2.0 * damping**2) / root) / w**3
        rotation = np.exp(pole * dt * np.arange(_BLOCK + 1))
        order = np.arange(_BLOCK)
        later = order - order[:, None]
        at = {k: np.eye(_BLOCK + 2, _BLOCK, -k) for k in range(3)}
        slopes = (at[2] - at[1]) / dt
        changes = (at[2] - 2.0 * at[1] + at[0]) / dt
        # From a window to q after each of its samples, and to q where the block ends.
        states = changes @ (slope * np.where(later >= 0, rotation[np.abs(later)], 0.0))
        end = states[:, -1] * rotation[1]
        self.end = np.ascontiguousarray(end.view(np.float64).reshape(-1, 2))
        self.rotation = rotation[_BLOCK]
        into = np.zeros((4, _BLOCK + 4, _BLOCK))
        decay = rotation[:_BLOCK]
        into[0] = np.vstack((states.real, decay.real, -decay.imag))
        into[1] = np.vstack((states.imag, decay.imag, decay.real))
        into[2, :-2], into[3, :-2] = at[1], slopes
        fractions = np.arange(points) * dt / points
        free = np.exp(pole * fractions)
        particular = (np.full(points, -1.0), 2.0 * damping / w - fractions)
        shape = np.stack((free.real, -free.imag, *(np.array(particular) / w**2)))
        self.gain = np.tensordot(into, shape, axes=(0, 0)).reshape(_BLOCK + 4, -1)
        self.rows = max(1, _PRODUCTS // self.gain.size)
        self.after = np.exp(pole * np.arange(int(period * points / dt) + 2) * dt / points)

    def put_states(self, windows: NDArray[np.float64], state: complex) -> complex:
        """Write the state before each block into its last two columns; the state after them."""
        from scipy.signal import lfilter  # takes longer to import than most commands

        ends = (windows[:, :-2] @ self.end).view(np.complex128)[:, 0]
        states = lfilter([1.0], [1.0, -self.rotation], np.concatenate(([state], ends)))
        windows[:, -2], windows[:, -1] = states.real[:-1], states.imag[:-1]
        return complex(states[-1])

    def responses(self, windows: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
        """Displacement [m] within blocks, (n_block, points of a block), some blocks at a time."""
        for start in range(0, len(windows), self.rows):
            yield windows[start : start + self.rows] @ self.gain

    def free_vibration(self, state: complex) -> NDArray[np.float64]:
        """Displacement [m] in the period after a state."""
        return (state * self.after).real


_oscillator = lru_cache(maxsize=256)(_Oscillator)
