"""Where a mechanism ends: margins of the contact laws and the instant at which one of them is
used up.

Every margin is dimensionless and positive while the mechanism holds (METHOD of Sinopoli, section
3.5): forces over the weight, gaps over the joint's length, slip rates over the speed of a fall
through that length. Gaps weigh more, so that all are located to the same threshold.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.kinematics import clearance, move_faces, vertex_on_earlier
from archfrag.mechanics.laws import (
    MINUS,
    OPEN,
    PLUS,
    STICK,
    corner_mode,
    cross,
    friction_ray,
    is_closed,
    slip_of,
    touches,
)
from archfrag.mechanics.reactions import inner_margins
from archfrag.methods.few_bodies import dense_state, evaluate, sliding_rate

N_MARGIN = 6
# Columns of the margins of a joint between mega-voussoirs: two laws, two gaps, end of a slip,
# and a vertex that slides past the other.
LAW = 0
GAP = 2
SLIP_END = 4
PASSING = 5
# A law counts as broken beyond this; the contact problem behind it resolves a hundredth of it.
THRESHOLD = 1e-9
GAP_WEIGHT = 1e4
SLIP_WEIGHT = 1e2
MAX_ROUNDS = 60
# A corner that overlaps by less than this part of the joint's length and parts has closed a
# rounding too late; one that overlaps by more has been missed.
ROUNDING = 1e-9
# Looks for the least gap inside a step in which a corner may have closed and parted again.
GAP_SAMPLES = 4
CLOSELY = 1e-3
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class Margins(NamedTuple):
    """Workspace for the margins of all laws."""

    between: np.ndarray  # (n_joint, 6) joints between mega-voussoirs
    target: np.ndarray  # (n_joint, 6) int8: contact mode on the other side
    inner: np.ndarray  # (n_joint, 4) joints inside them
    trigger: np.ndarray  # (3,) int64: 1 if inner, joint, column of the smallest margin
    low_between: np.ndarray  # (n_joint, 6) margins where all laws still hold
    low_inner: np.ndarray  # (n_joint, 4)
    gap: np.ndarray  # (n_joint, 2, 2) open corners: gap [m] and its rate [m/s]; inf if it touches
    low_gap: np.ndarray  # (n_joint, 2, 2) the same at the beginning of the step


@allocating
def new_margins(n_joint):
    """Workspace for the margins of a chain of `n_joint` joints."""
    return Margins(
        np.full((n_joint, N_MARGIN), np.inf),
        np.zeros((n_joint, N_MARGIN), np.int8),
        np.full((n_joint, 4), np.inf),
        np.zeros(3, np.int64),
        np.full((n_joint, N_MARGIN), np.inf),
        np.full((n_joint, 4), np.inf),
        np.full((n_joint, 2, 2), np.inf),
        np.full((n_joint, 2, 2), np.inf),
    )


@kernel
def keep_margins(few, margins):
    """Note the present margins as those of the beginning of a step."""
    for k in range(few.work.mode.size):
        for q in range(N_MARGIN):
            margins.low_between[k, q] = margins.between[k, q]
        for c in range(2):
            for d in range(2):
                margins.low_gap[k, c, d] = margins.gap[k, c, d]
    for j in range(margins.inner.shape[0]):
        for q in range(4):
            margins.low_inner[j, q] = margins.inner[j, q]


@kernel
def _of_trigger(margins, low):
    inner, k, q = margins.trigger[0], margins.trigger[1], margins.trigger[2]
    if low:
        return margins.low_inner[k, q] if inner else margins.low_between[k, q]
    return margins.inner[k, q] if inner else margins.between[k, q]


@kernel
def _closed_margins(few, k, share, value, target):
    mode = few.work.mode[k]
    sense = slip_of(mode)
    contacts = few.contacts
    fx, fy = few.work.reaction[k, 0], few.work.reaction[k, 1]
    nx, ny = contacts.normal[k, 0], contacts.normal[k, 1]
    press = fx * nx + fy * ny
    px = contacts.point[k, 0, 0] - few.work.pivot[k, 0]
    py = contacts.point[k, 0, 1] - few.work.pivot[k, 1]
    difference = few.work.reaction[k, 2] / cross(px, py, nx, ny)
    value[LAW] = 0.5 * share * (press + difference)
    target[LAW] = corner_mode(1, sense)
    value[LAW + 1] = 0.5 * share * (press - difference)
    target[LAW + 1] = corner_mode(0, sense)


@kernel
def _corner_margins(few, k, share, value, target):
    mode = few.work.mode[k]
    corner = 0 if touches(mode, 0) else 1
    sense = slip_of(mode)
    mu = few.chain.friction[k]
    plus, minus = few.contacts.normal_plus[k, corner], few.contacts.normal_minus[k, corner]
    fx, fy = few.work.reaction[k, 0], few.work.reaction[k, 1]
    norm = share if np.isinf(mu) else share / np.sqrt(1.0 + mu * mu)
    hx, hy = friction_ray(plus[0], plus[1], mu, PLUS)
    lx, ly = friction_ray(minus[0], minus[1], mu, MINUS)
    if sense == STICK:
        value[LAW] = -norm * cross(hx, hy, fx, fy)
        target[LAW] = corner_mode(corner, PLUS)
        value[LAW + 1] = -norm * cross(fx, fy, lx, ly)
        target[LAW + 1] = corner_mode(corner, MINUS)
        if np.isinf(mu):
            # Both rays of a cone without friction limit are the tangents: beyond them contact
            # is lost.
            target[LAW] = target[LAW + 1] = OPEN
    elif sense == PLUS:
        value[LAW] = norm * (fx * hx + fy * hy)
        target[LAW] = OPEN
    else:
        value[LAW] = norm * (fx * lx + fy * ly)
        target[LAW] = OPEN


@kernel
def _opening_rate(few, k, corner, velocity):
    contacts = few.contacts
    px, py = contacts.point[k, corner, 0], contacts.point[k, corner, 1]
    ux = uy = 0.0
    if k < velocity.shape[0]:
        ux = velocity[k, 0] - velocity[k, 2] * (py - contacts.centroid[k, 1])
        uy = velocity[k, 1] + velocity[k, 2] * (px - contacts.centroid[k, 0])
    if k > 0:
        ux -= velocity[k - 1, 0] - velocity[k - 1, 2] * (py - contacts.centroid[k - 1, 1])
        uy -= velocity[k - 1, 1] + velocity[k - 1, 2] * (px - contacts.centroid[k - 1, 0])
    return contacts.normal[k, 0] * ux + contacts.normal[k, 1] * uy


@kernel
def margins_between(few, velocity, share, falling, margins):
    """Margins at the joints between mega-voussoirs, after `evaluate`.

    Parameters
    ----------
    few : Few
    velocity : ndarray, (n, 3)
    share : float
        One over the weight [1/N].
    falling : float
        Speed that counts as one [m/s].
    margins : Margins
        `between` and `target` are overwritten.

    Returns
    -------
    float
        The smallest.
    """
    worst = np.inf
    for k in range(few.work.mode.size):
        mode = few.work.mode[k]
        value, target = margins.between[k], margins.target[k]
        value[:] = np.inf
        for c in range(2):
            margins.gap[k, c, 0] = margins.gap[k, c, 1] = np.inf
            if not touches(mode, c):
                gap = clearance(k, c, few.before, few.after)
                rate = _opening_rate(few, k, c, velocity)
                margins.gap[k, c, 0], margins.gap[k, c, 1] = gap, rate
                value[GAP + c] = GAP_WEIGHT * gap / few.length[k]
                if gap < 0.0 <= rate and gap > -ROUNDING * few.length[k]:
                    value[GAP + c] = 0.0
        if mode != OPEN:
            if is_closed(mode):
                _closed_margins(few, k, share, value, target)
            else:
                _corner_margins(few, k, share, value, target)
            sense = slip_of(mode)
            if sense != STICK:
                rate = sliding_rate(few, k, velocity)
                value[SLIP_END] = -SLIP_WEIGHT * sense * rate / falling
                if not is_closed(mode):
                    # The vertex that slides changes where it passes the other one.
                    corner = 0 if touches(mode, 0) else 1
                    ahead = few.slip[k] * (-1.0 * sense)
                    if vertex_on_earlier(corner, few.slip[k]) != vertex_on_earlier(
                        corner, -1.0 * sense
                    ):
                        value[PASSING] = -GAP_WEIGHT * ahead / few.length[k]
        for q in range(N_MARGIN):
            worst = min(worst, value[q])
    return worst


@kernel
def all_margins(
    chain, mechanism, few, position, velocity, ground_x, ground_y, share, falling, margins
):
    """Smallest margin of all laws, after `evaluate` at this state; see `margins_between`."""
    worst = margins_between(few, velocity, share, falling, margins)
    push_y = ground_y + few.chain.gravity
    return min(
        worst,
        inner_margins(
            chain, mechanism, position, velocity, few.work, ground_x, push_y, share, margins.inner
        ),
    )


@kernel
def find_trigger(mechanism, few, margins):
    """Which law has the smallest margin, into ``margins.trigger``; returns that margin."""
    worst = np.inf
    for k in range(few.work.mode.size):
        for q in range(N_MARGIN):
            if margins.between[k, q] < worst:
                worst = margins.between[k, q]
                margins.trigger[0], margins.trigger[1], margins.trigger[2] = 0, k, q
    j = 0
    for k in range(few.work.mode.size + 1):
        stop = few.joint[k] if k < few.work.mode.size else margins.inner.shape[0]
        while j < stop:
            for q in range(4):
                if margins.inner[j, q] < worst:
                    worst = margins.inner[j, q]
                    margins.trigger[0], margins.trigger[1], margins.trigger[2] = 1, j, q
            j += 1
        j += 1
    return worst


@kernel
def margin_at(chain, mechanism, few, theta, step, gx, sx, gy, sy, share, falling, margins):
    """Smallest margin at a part of a step, and the threshold above it; nan without a solution."""
    dense_state(few, theta, few.new_position, few.new_velocity)
    gx += sx * theta * step
    gy += sy * theta * step
    if not evaluate(few, few.new_position, few.new_velocity, gx, gy):
        return np.nan
    return THRESHOLD + all_margins(
        chain, mechanism, few, few.new_position, few.new_velocity, gx, gy, share, falling, margins
    )


@kernel
def may_have_closed(few, margins, step):
    """Whether a corner that is open at both ends of a step may have closed inside it.

    A gap that first shrinks and then grows lies above the tangents at the ends of the step, as
    long as its rate turns only once.

    Returns
    -------
    bool
    """
    for k in range(few.work.mode.size):
        for c in range(2):
            first, falls = margins.low_gap[k, c, 0], margins.low_gap[k, c, 1]
            last, rises = margins.gap[k, c, 0], margins.gap[k, c, 1]
            if not (np.isfinite(first) and falls < 0.0 < rises):
                continue
            if first * rises - last * falls < -falls * rises * step:
                return True
    return False


@kernel
def closed_inside(few, closely):
    """Part of a step at which an open corner overlaps; 0 where none does.

    Looked for at a few instants of the dense output, which has to be made, and then by golden
    sections.

    Parameters
    ----------
    few : Few
    closely : bool
        Whether to look between those instants too.

    Returns
    -------
    float
    """
    deepest, place = np.inf, 0.0
    for i in range(1, GAP_SAMPLES):
        gap = _least_gap(few, i / GAP_SAMPLES)
        if gap < deepest:
            deepest, place = gap, i / GAP_SAMPLES
    low, high = place - 1.0 / GAP_SAMPLES, place + 1.0 / GAP_SAMPLES
    while closely and deepest >= -ROUNDING and high - low > CLOSELY:
        first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        at_first, at_second = _least_gap(few, first), _least_gap(few, second)
        if at_first < at_second:
            high = second
        else:
            low = first
        if min(at_first, at_second) < deepest:
            deepest = min(at_first, at_second)
            place = first if at_first < at_second else second
    dense_state(few, 0.0, few.position, few.velocity)
    move_faces(few.chain, few.new_position, few.before, few.after)
    return place if deepest < -ROUNDING else 0.0


@kernel
def _least_gap(few, theta):
    """Smallest gap of the open corners at a part of a step, over the joint's length."""
    dense_state(few, theta, few.position, few.velocity)
    move_faces(few.chain, few.position, few.before, few.after)
    least = np.inf
    for k in range(few.work.mode.size):
        for c in range(2):
            if not touches(few.work.mode[k], c):
                least = min(least, clearance(k, c, few.before, few.after) / few.length[k])
    return least


@kernel
def locate(chain, mechanism, few, step, end, gx, sx, gy, sy, share, falling, margins):
    """First instant of a step at which a margin is used up, found on the dense output.

    The margin that is smallest where a law is broken is followed back by regula falsi with
    halving (Illinois), until none is broken by more than the threshold.

    Parameters
    ----------
    chain, mechanism, few, margins
        Those of the step, with the margins at `end`, where one is used up; `keep_margins` holds
        those at its beginning.
    step : float [s]
    end : float
        Part of the step in which to look.
    gx, sx, gy, sy : float
        Ground acceleration at the beginning of the step and its rate [m/s2], [m/s3].
    share, falling : float
        As in `margins_between`.

    Returns
    -------
    theta : float
        Part of the step; nan where no state could be evaluated. ``few.new_position``,
        ``few.new_velocity`` and the last evaluation are those at that instant.
    """
    low, high = 0.0, end
    find_trigger(mechanism, few, margins)
    high_value = THRESHOLD + _of_trigger(margins, False)
    low_value = max(THRESHOLD + _of_trigger(margins, True), 0.1 * THRESHOLD)
    side = 0
    theta = end
    for number in range(MAX_ROUNDS):
        theta = (low * high_value - high * low_value) / (high_value - low_value)
        if number % 4 == 3 or not low < theta < high:
            theta = 0.5 * (low + high)
        value = margin_at(
            chain, mechanism, few, theta, step, gx, sx, gy, sy, share, falling, margins
        )
        if np.isnan(value) or -THRESHOLD <= value < 0.0:
            break
        old = margins.trigger[0] * 1000003 + margins.trigger[1] * 10 + margins.trigger[2]
        if value < 0.0:
            high = theta
            find_trigger(mechanism, few, margins)
            high_value = value
            now = margins.trigger[0] * 1000003 + margins.trigger[1] * 10 + margins.trigger[2]
            if now != old:
                low_value = max(THRESHOLD + _of_trigger(margins, True), 0.1 * THRESHOLD)
                side = 0
            elif side == -1:
                low_value *= 0.5
            side = -1
        else:
            low = theta
            low_value = max(THRESHOLD + _of_trigger(margins, False), 0.1 * THRESHOLD)
            keep_margins(few, margins)
            if side == 1:
                high_value *= 0.5
            side = 1
        if high - low < 1e-14:
            value = margin_at(
                chain, mechanism, few, high, step, gx, sx, gy, sy, share, falling, margins
            )
            theta = high
            break
    find_trigger(mechanism, few, margins)
    return theta if not np.isnan(value) else np.nan
