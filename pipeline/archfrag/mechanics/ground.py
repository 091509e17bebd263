"""Ground acceleration between its samples, and its exact impulse over a step."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel


@kernel
def rest_margin(horizontal, vertical, gravity, limit_plus, limit_minus):
    """Distance of a body force from the border of the range of rest; negative outside [m/s2].

    Rest depends on the direction of the body force only: ``-limit_minus <= k_h / (1 + k_v) <=
    limit_plus``, a convex cone, so that a force linear in time between two samples inside it
    stays inside.
    """
    upward = gravity + vertical
    margin = upward
    if not np.isinf(limit_plus):
        margin = min(margin, limit_plus * upward - horizontal)
    if not np.isinf(limit_minus):
        margin = min(margin, limit_minus * upward + horizontal)
    return margin


@allocating
def find_breaks(ground):
    """For each sample the next one at which the ground acceleration changes its slope.

    Parameters
    ----------
    ground : archfrag.mechanics.types.GroundMotion

    Returns
    -------
    ndarray, (n_sample,) int64
    """
    n = ground.horizontal.size
    out = np.empty(n, np.int64)
    largest = max(np.max(np.abs(ground.horizontal)), np.max(np.abs(ground.vertical)))
    out[n - 1] = n - 1
    following = n - 1
    for i in range(n - 2, -1, -1):
        out[i] = following
        if i > 0:
            x, y = ground.horizontal, ground.vertical
            bend = abs(x[i - 1] - 2.0 * x[i] + x[i + 1]) + abs(y[i - 1] - 2.0 * y[i] + y[i + 1])
            if bend > 1e-12 * largest:
                following = i
    return out


@kernel
def segment_at(time, ground, next_break):
    """Where the ground acceleration is linear in time.

    Returns
    -------
    end : float
        Until when [s]; inf after the record.
    horizontal, horizontal_rate, vertical, vertical_rate : float
        Acceleration at `time` and its rate [m/s2], [m/s3].
    """
    dt = ground.time_step
    last = ground.horizontal.size - 1
    i = int(np.floor(time / dt + 1e-9))
    if i >= last:
        return np.inf, 0.0, 0.0, 0.0, 0.0
    part = time - i * dt
    horizontal_rate = (ground.horizontal[i + 1] - ground.horizontal[i]) / dt
    vertical_rate = (ground.vertical[i + 1] - ground.vertical[i]) / dt
    horizontal = ground.horizontal[i] + horizontal_rate * part
    vertical = ground.vertical[i] + vertical_rate * part
    return next_break[i] * dt, horizontal, horizontal_rate, vertical, vertical_rate
