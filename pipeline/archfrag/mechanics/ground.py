"""Ground acceleration between its samples, and its exact impulse over a step."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel


@allocating
def cumulative_impulse(acceleration, time_step):
    """Integral of a piecewise-linear acceleration up to each sample, (n_sample,) [m/s]."""
    out = np.zeros(acceleration.size)
    for i in range(1, acceleration.size):
        out[i] = out[i - 1] + 0.5 * time_step * (acceleration[i - 1] + acceleration[i])
    return out


@kernel
def impulse_until(time, acceleration, cumulative, time_step):
    """Integral of the acceleration from the first sample to `time` [m/s]."""
    last = acceleration.size - 1
    if time <= 0.0:
        return 0.0
    place = time / time_step
    i = int(place)
    if i >= last:
        return cumulative[last]
    f = place - i
    slope = acceleration[i + 1] - acceleration[i]
    return cumulative[i] + time_step * f * (acceleration[i] + 0.5 * f * slope)


@kernel
def impulse_between(start, end, acceleration, cumulative, time_step):
    """Integral of the acceleration from `start` to `end` [m/s]."""
    return impulse_until(end, acceleration, cumulative, time_step) - impulse_until(
        start, acceleration, cumulative, time_step
    )


@kernel
def acceleration_at(time, acceleration, time_step):
    """Acceleration at `time`, zero outside the record [m/s2]."""
    last = acceleration.size - 1
    place = time / time_step
    if place < 0.0 or place > last:
        return 0.0
    i = min(int(place), last - 1)
    f = place - i
    return acceleration[i] + f * (acceleration[i + 1] - acceleration[i])


@kernel
def rest_margin(horizontal, vertical, gravity, limit_plus, limit_minus):
    """Distance of a body force from the border of the rest range; negative outside [m/s2].

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


@kernel
def end_of_rest(time, ground, gravity, limit_plus, limit_minus):
    """First instant from `time` on at which the ground motion leaves the rest range [s].

    Returns
    -------
    float
        inf if it never does.
    """
    n_sample = ground.horizontal.size
    dt = ground.time_step
    i = max(int(np.ceil(time / dt - 1e-9)), 0)
    before_time = time
    before = rest_margin(
        acceleration_at(time, ground.horizontal, dt),
        acceleration_at(time, ground.vertical, dt),
        gravity,
        limit_plus,
        limit_minus,
    )
    if before < 0.0:
        return time
    while i < n_sample:
        margin = rest_margin(
            ground.horizontal[i], ground.vertical[i], gravity, limit_plus, limit_minus
        )
        if margin < 0.0:
            here = i * dt
            if here <= before_time:
                return here
            return before_time + (here - before_time) * before / (before - margin)
        before = margin
        before_time = i * dt
        i += 1
    return np.inf


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
    gx, sx, gy, sy : float
        Acceleration at `time` and its rate [m/s2], [m/s3].
    """
    dt = ground.time_step
    last = ground.horizontal.size - 1
    i = int(np.floor(time / dt + 1e-9))
    if i >= last:
        return np.inf, 0.0, 0.0, 0.0, 0.0
    part = time - i * dt
    sx = (ground.horizontal[i + 1] - ground.horizontal[i]) / dt
    sy = (ground.vertical[i + 1] - ground.vertical[i]) / dt
    gx = ground.horizontal[i] + sx * part
    gy = ground.vertical[i] + sy * part
    return next_break[i] * dt, gx, sx, gy, sy
