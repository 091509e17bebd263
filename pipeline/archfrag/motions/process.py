"""What may be done to a motion before it is used; each step writes a sentence in its log."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.motions.motion import Motion


def demean(motion: Motion) -> Motion:
    """Subtract from each component its mean over the whole record.

    Raw records of digital instruments carry an offset that can exceed the motion.
    """
    means = [float(motion.acceleration.mean())]
    vertical = motion.vertical
    if vertical is not None:
        means.append(float(vertical.mean()))
        vertical = vertical - means[1]
    offsets = " and ".join(f"{mean:.6g}" for mean in means)
    return replace(
        motion,
        acceleration=motion.acceleration - means[0],
        vertical=vertical,
        log=(*motion.log, f"Mean removed ({offsets} m/s2)."),
    )


def bandpass(motion: Motion, lowest: float, highest: float, order: int = 4) -> Motion:
    """Filter with a Butterworth band-pass, forwards and backwards (no phase shift).

    Parameters
    ----------
    lowest, highest : float [Hz]
        Corners; the two passes together halve the amplitude there.
    order : int
        Order of one pass.

    Raises
    ------
    InputError
        Unless 0 < lowest < highest < 1 / (2 dt).
    """
    from scipy.signal import butter, sosfiltfilt

    nyquist = 0.5 / motion.dt
    if not 0.0 < lowest < highest < nyquist:
        raise InputError(
            f"{motion.id or 'motion'}: corners {lowest} and {highest} Hz must satisfy "
            f"0 < lowest < highest < {nyquist:g} Hz"
        )
    sections = butter(order, (lowest, highest), "bandpass", fs=1.0 / motion.dt, output="sos")
    vertical = motion.vertical
    return replace(
        motion,
        acceleration=sosfiltfilt(sections, motion.acceleration),
        vertical=None if vertical is None else sosfiltfilt(sections, vertical),
        log=(
            *motion.log,
            f"Band-pass {lowest:g} to {highest:g} Hz, Butterworth of order {order}, "
            "forwards and backwards.",
        ),
    )


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
    kept = slice(first, last + 1)
    return replace(
        motion,
        acceleration=motion.acceleration[kept],
        vertical=None if motion.vertical is None else motion.vertical[kept],
        log=(*motion.log, f"Cut to {first * motion.dt:g} to {last * motion.dt:g} s."),
    )


def velocity(motion: Motion) -> NDArray[np.float64]:
    """Horizontal ground velocity by the trapezoid rule from rest, shape (n_sample,) [m/s]."""
    from scipy.integrate import cumulative_trapezoid

    return cumulative_trapezoid(motion.acceleration, dx=motion.dt, initial=0.0)


def displacement(motion: Motion) -> NDArray[np.float64]:
    """Horizontal ground displacement by the trapezoid rule twice, shape (n_sample,) [m]."""
    from scipy.integrate import cumulative_trapezoid

    return cumulative_trapezoid(velocity(motion), dx=motion.dt, initial=0.0)
