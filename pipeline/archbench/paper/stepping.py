"""Time stepping and ties: Moreau's midpoint step, and bars that only pull (METHOD.md).

The step is not of Sinopoli's paper. Sources: Moreau (1988), *CISM 302*, 1-82; Jean (1999),
*Comput. Methods Appl. Mech. Engrg.* 177, 235-257; Paoli and Schatzman (2002), *SIAM J. Numer.
Anal.* 40(2), for the position at which Signorini's law holds. A body is its centroid and rotation
(3,) with velocity (3,); corners are points of the bodies, given from their centroids.
"""

import math
from itertools import product

import numpy as np

from archbench.paper.arch import Array, rotated


def middle_of(position: Array, velocity: Array, step: float) -> Array:
    """Return the positions in the middle of a step: q + h/2 v."""
    return position + 0.5 * step * velocity


def end_of(middle: Array, velocity: Array, step: float) -> Array:
    """Return the positions at the end of a step, by the velocities after it: q_m + h/2 w."""
    return middle + 0.5 * step * velocity


def free_velocity(
    velocity: Array, ground: tuple[float, float], step: float, g: float
) -> Array:
    """Return the velocities after a step without reactions; `ground` is its change of velocity."""
    return velocity - np.array([ground[0], ground[1] + step * g, 0.0])


def offset_at(
    time: float, earlier: tuple[Array, Array], later: tuple[Array, Array]
) -> Array:
    """Return where a corner of the later body is from that of the earlier one (2,) [m].

    Bodies are (corner, velocity), a corner from the centroid (2,); `time` after the middle they
    have gone on at constant velocities. In the middle the offset is zero.
    """
    (before, motion), (after, later_motion) = earlier, later

    def moved(arm: Array, velocity: Array) -> Array:
        c = math.cos(velocity[2] * time)
        s = math.sin(velocity[2] * time)
        return velocity[:2] * time + (c - 1.0) * arm + s * rotated(arm)

    return moved(after, later_motion) - moved(before, motion)


def contact_bias(
    offset: Array,
    step: float,
    beyond: float,
    earlier: tuple[Array, Array],
    later: tuple[Array, Array],
) -> Array:
    """Return what a corner's velocity after the step has to undo in its offset [m/s].

    The law holds where the offset of the middle has gone on for half a step h at the velocities
    to come, and for a time k (`beyond`) at the ones then reached: (e + (h/8 + k/2) h b) over
    (h/2 + k), with b the acceleration of the offset at constant velocities.
    """
    small = 1e-4
    bend = sum(offset_at(time, earlier, later) for time in (small, -small)) / small**2
    return (offset + (step / 8.0 + beyond / 2.0) * step * bend) / (step / 2.0 + beyond)


def tie_impulse(
    stretch: float,
    stiffness: float,
    strength: float,
    step: float,
    rates: tuple[float, float],
) -> float:
    """Return the impulse of a tie over a step [N s].

    `stretch` is its elastic elongation in the middle by the velocities before the step, `rates`
    those of its elongation before and after the step: h k (stretch + h/4 (after - before)), at
    least 0 and at most h times its strength.
    """
    elastic = step * stiffness * (stretch + 0.25 * step * (rates[1] - rates[0]))
    return min(max(elastic, 0.0), step * strength)


def tie_impulses(
    free: Array,
    answer: Array,
    before: Array,
    stretch: Array,
    stiffness: Array,
    strength: Array,
    step: float,
) -> Array:
    """Return the impulses of all ties of a chain over a step, by trying all their modes (k,).

    The rates after the step are ``free + answer @ impulses``: `free` (k,) without ties, `answer`
    (k, k) those that unit impulses add.
    """
    gain = 0.25 * step**2 * stiffness
    known = step * stiffness * stretch - gain * before
    most = step * strength
    for modes in product(("slack", "taut", "yields"), repeat=len(free)):
        taut = np.array([mode == "taut" for mode in modes])
        held = np.array(
            [most[t] if mode == "yields" else 0.0 for t, mode in enumerate(modes)]
        )
        matrix = np.eye(len(free)) - np.where(taut, gain, 0.0)[:, None] * answer
        impulses = np.linalg.solve(matrix, np.where(taut, known + gain * free, held))
        rates = free + answer @ impulses
        law = [
            tie_impulse(
                stretch[t], stiffness[t], strength[t], step, (before[t], rates[t])
            )
            for t in range(len(free))
        ]
        if np.allclose(
            impulses, law, rtol=1e-9, atol=1e-9 * step * np.abs(stiffness).max()
        ):
            return impulses
    raise ValueError("no modes of the ties agree with their laws")
