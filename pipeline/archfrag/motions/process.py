"""What may be done to a motion before it is used; each step writes a line in its log.

A step does the same to all components of a motion. None changes the motion that it is given.
What its settings may be is in `archfrag.study.processing`; what depends on the motion, too, is
checked here.
"""

import itertools
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.motions.integrals import arias_times, integral
from archfrag.motions.motion import Motion
from archfrag.motions.units import STANDARD_GRAVITY

Samples = NDArray[np.float64]
_MOST_PARTS = 1000  # of a time step, in the ratio of two of them


def demean(motion: Motion) -> Motion:
    """Subtract from each component its mean over all samples.

    Raw records of digital instruments have an offset that can exceed the motion.
    """
    rows = (samples for samples in motion.components.values() if samples is not None)
    offsets = " and ".join(f"{samples.mean():.6g}" for samples in rows)
    return motion._changed(lambda a: a - a.mean(), f"Mean removed ({offsets} m/s2).")


def detrend(motion: Motion) -> Motion:
    """Subtract from each component the straight line that fits it best (least squares)."""
    return motion._changed(lambda a: _without(a, _fitted(a, (0, 1))), "Linear trend removed.")


def baseline(motion: Motion, order: int = 2) -> Motion:
    """Subtract the derivative of the polynomial that fits the velocity best (least squares).

    The polynomial is zero at the first sample, where the record is at rest. Order 2 is that of
    Graizer (1979); see Boore (2001), BSSA 91(5).

    Parameters
    ----------
    order : int
        Of the polynomial, from 1 to 5.
    """

    def corrected(a: Samples) -> Samples:
        velocity = _fitted(integral(a, 1.0), range(1, order + 1))
        return _without(a, velocity.deriv() / (a.size - 1))

    return motion._changed(corrected, f"Baseline removed, velocity polynomial of order {order}.")


def taper(motion: Motion, fraction: float = 0.05, side: str = "both") -> Motion:
    """Bring the ends to zero by half a cosine wave.

    Parameters
    ----------
    fraction : float
        Of the record at each end, above 0 and at most 0.5.
    side : str
        ``both``, ``left`` or ``right``.
    """
    count = max(1, int(fraction * motion.acceleration.size))
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / count)

    def tapered(a: Samples) -> Samples:
        a = a.copy()
        if side != "right":
            a[:count] *= rise
        if side != "left":
            a[-count:] *= rise[::-1]
        return a

    return motion._changed(tapered, f"Tapered by a cosine over {fraction:g} of it, {side} ends.")


def bandpass(
    motion: Motion,
    lowest: float | None,
    highest: float | None,
    order: int = 4,
    causal: bool = False,
) -> Motion:
    """Filter with a Butterworth band-pass, forwards and backwards (no phase shift) or causal.

    Parameters
    ----------
    lowest, highest : float or None [Hz]
        Corners; without the one it is a low-pass, without the other a high-pass. Two passes
        together halve the amplitude there, one leaves 0.71 of it.
    order : int
        Order of one pass, from 1 to 10.
    causal : bool
        Forwards only.

    Raises
    ------
    InputError
        Unless 0 < lowest < highest < 1 / (2 dt).
    """
    from scipy.signal import butter, sosfilt, sosfiltfilt

    nyquist = 0.5 / motion.dt
    corners = [corner for corner in (lowest, highest) if corner is not None]
    rising = all(low < high for low, high in itertools.pairwise((0.0, *corners, nyquist)))
    if not corners or not rising:
        allowed = f"0 < lowest < highest < {nyquist:g} Hz"
        both = f"corners {lowest} and {highest} Hz"
        raise InputError(f"{motion.id or 'motion'}: {both} must satisfy {allowed}")
    kind = "bandpass" if len(corners) == 2 else "lowpass" if lowest is None else "highpass"
    sections = butter(order, np.squeeze(corners), kind, fs=1.0 / motion.dt, output="sos")
    band = f"{lowest or 0.0:g} to {'the highest' if highest is None else f'{highest:g}'} Hz"
    passes = "forwards only (causal)" if causal else "forwards and backwards"
    done = f"Band-pass {band}, Butterworth of order {order}, {passes}."
    taps = 2 * len(sections) + 1 - min((sections[:, [2, 5]] == 0.0).sum(axis=0))
    edge = min(3 * taps, motion.acceleration.size - 1)  # scipy's own but for short records

    def filtered(a: Samples) -> Samples:
        return sosfilt(sections, a) if causal else sosfiltfilt(sections, a, padlen=edge)

    return motion._changed(filtered, done)


def cut(motion: Motion, start: float, end: float) -> Motion:
    """Keep the samples from `start` to `end` [s], both counted from the first sample.

    Raises
    ------
    InputError
        Unless 0 <= start < end and two samples remain.
    """
    first = int(np.ceil(start / motion.dt - 1e-9)) if start >= 0.0 else -1
    last = int(np.floor(min(end, motion.duration) / motion.dt + 1e-9))
    if first < 0 or last <= first:
        raise InputError(
            f"{motion.id or 'motion'}: cannot cut from {start} s to {end} s; the record lasts "
            f"{motion.duration:g} s and at least two samples must remain"
        )
    done = f"Cut to {first * motion.dt:g} to {last * motion.dt:g} s."
    return motion._changed(lambda a: a[first : last + 1].copy(), done)


def trim_by_arias(
    motion: Motion, start: float = 0.001, end: float = 0.999, margin: float = 0.0
) -> Motion:
    """Keep what lies between two fractions of the Arias intensity, and `margin` [s] around it.

    The intensity is that of both horizontal components together where there are two.
    """
    first, last = arias_times(motion, (start, end))
    return _around(motion, first, last, margin)


def trim_by_threshold(motion: Motion, threshold: float, margin: float = 0.0) -> Motion:
    """Keep from the first to the last time that `threshold` [m/s2] is reached, and a margin.

    Parameters
    ----------
    threshold : float [m/s2]
        Of any horizontal component.
    margin : float [s]
        Kept before and after.

    Raises
    ------
    InputError
        If none does, or fewer than two samples remain.
    """
    reached = np.abs(motion.acceleration) >= threshold
    if motion.across is not None:
        reached |= np.abs(motion.across) >= threshold
    if not reached.any():
        raise InputError(
            f"{motion.id or 'motion'}: no sample reaches the threshold {threshold:g} m/s2 "
            f"({threshold / STANDARD_GRAVITY:.4g} g) that it is to be trimmed by"
        )
    first, last = int(reached.argmax()), reached.size - 1 - int(reached[::-1].argmax())
    return _around(motion, first * motion.dt, last * motion.dt, margin)


def resample(motion: Motion, dt: float) -> Motion:
    """Give the motion another time step, band-limited: what both can hold stays as it is.

    A polyphase filter with a Kaiser window (scipy's `resample_poly`) of 64 zero crossings: up to
    0.9 of the lower of both Nyquist frequencies nothing changes by more than 0.01 %.

    Parameters
    ----------
    dt : float [s]
        Its ratio to the motion's must be one of integers up to 1000.

    Raises
    ------
    InputError
        If it is not.
    """
    from scipy.signal import firwin, resample_poly

    ratio = motion.dt / dt if dt > 0.0 else 0.0
    parts = Fraction(ratio).limit_denominator(_MOST_PARTS)
    up, down = parts.numerator, parts.denominator
    if not 0 < up <= _MOST_PARTS or abs(up / down - ratio) > 1e-9 * ratio:
        raise InputError(
            f"{motion.id or 'motion'}: cannot be resampled from {motion.dt:g} s to {dt:g} s; the "
            f"ratio must be one of integers up to {_MOST_PARTS}"
        )
    if up == down:
        return motion
    widest = max(up, down)
    window = firwin(2 * 64 * widest + 1, 1.0 / widest, window=("kaiser", 10.0))
    changed = motion._changed(
        lambda a: resample_poly(a, up, down, window=window),
        f"Resampled from {motion.dt:g} to {dt:g} s, band-limited ({up}:{down}).",
    )
    return changed._replaced(dt=motion.dt * down / up)


def velocity(motion: Motion) -> Samples:
    """Horizontal ground velocity by the trapezoid rule from rest, shape (n_sample,) [m/s]."""
    return integral(motion.acceleration, 1.0) * motion.dt


def _around(motion: Motion, first: float, last: float, margin: float) -> Motion:
    return cut(motion, max(0.0, first - margin), min(motion.duration, last + margin))


def _fitted(values: Samples, powers: Sequence[int]) -> np.polynomial.Polynomial:
    """Polynomial of some powers that fits values best, over the record brought to 0 to 1."""
    exponents = np.array(powers)
    rows = (np.arange(values.size) / (values.size - 1)) ** exponents[:, None]
    coefficients = np.zeros(exponents[-1] + 1)
    coefficients[exponents] = np.linalg.solve(rows @ rows.T, rows @ values)
    return np.polynomial.Polynomial(coefficients)


def _without(samples: Samples, shape: np.polynomial.Polynomial) -> Samples:
    """Samples less a polynomial over the record brought to 0 to 1."""
    return samples - shape(np.arange(samples.size) / (samples.size - 1))
