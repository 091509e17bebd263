"""Cautions on a motion by its samples alone: an offset, a drift, an end in the middle of shaking.

Of 106 components of nine agencies, raw ones with their mean removed, the largest offset is 0.0001,
drift 0.09 and end 0.15, but for one analogue record that does drift (0.25).
"""

import numpy as np
from numpy.typing import NDArray

from archfrag.motions.measures import integral
from archfrag.motions.motion import Motion

OFFSET = 0.01  # of the mean to the peak
DRIFT = 0.2  # of the velocity at the end, or of its mean over a record, to its peak
SHORT = 10.0  # [s]
SHAKING = 0.25  # of the peak in the last second to that of the record


def motion_cautions(motion: Motion) -> list[str]:
    """Return the cautions on a motion: those of its file, and on the samples that move an arch."""
    cautions = [*motion.metadata.get("cautions", ())]
    cautions += sample_cautions(motion.acceleration, motion.dt)
    if motion.vertical is not None:
        cautions += [f"vertical: {text}" for text in sample_cautions(motion.vertical, motion.dt)]
    return cautions


def sample_cautions(samples: NDArray[np.float64], dt: float) -> list[str]:
    """List what is suspicious about accelerations [m/s2] at steps of `dt` [s]."""
    peak, cautions = float(np.abs(samples).max()), list[str]()
    if not peak > 0.0:
        return cautions
    velocity = integral(samples, dt)
    fastest = float(np.abs(velocity).max())
    offset, slow = abs(float(samples.mean())) / peak, abs(float(velocity[-1]))
    if samples.size * dt > SHORT:  # the mean of a pulse is not that of a drift
        slow = max(slow, abs(float(velocity.mean())))
    drift = slow / (fastest or 1.0)
    # The last second of a record, less of a short motion: a cycle of a sine ends at rest.
    last = max(2, round(min(1.0 / dt, 0.03 * samples.size)))
    shaking = float(np.abs(samples[-last:]).max()) / peak
    if offset > OFFSET:
        text = f"its mean is {offset:.2g} of its peak: an offset counts as motion; `demean`"
        cautions.append(text)
    if drift > DRIFT:
        how = "correct it by `baseline`, or by `detrend` and `bandpass`"
        where = "at the end" if slow == abs(float(velocity[-1])) else "on average"
        text = f"its velocity {where} is {drift:.2g} of PGV: the baseline drifts; {how}"
        cautions.append(text)
    if shaking > SHAKING:
        cut = "the record ends while it shakes; find a longer one"
        text = f"it has {shaking:.2g} of its peak within its last {last * dt:.2g} s: {cut}"
        cautions.append(text)
    return cautions
