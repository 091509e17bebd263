"""Ground motions that differ in their last bits, as those of two processors do."""

import archfrag as af

STEP = 1e-13


def nearby(motion: af.Motion, number: int = 8) -> list[af.Motion]:
    """Return the motion and others that differ from it by multiples of 1e-13."""
    return [motion * (1.0 + k * STEP) for k in range(number)]
