"""Contact problem by following its piecewise-linear solution path: what Newton's iteration on the
modes could not solve.

All joints are first pushed apart by an extra opening velocity, so that none touches and the
solution is known. The extra velocity is then taken back, tau from 0 to 1, and the solution is
followed exactly from piece to piece of the contact laws: at each break one joint changes its
mode. Where the laws are not monotone (friction) the path may go back in tau; its direction
after a break is the one that leads into the new piece. This is Lemke's complementary pivoting
(Cottle, Pang and Stone, *The Linear Complementarity Problem*, ch. 4) written for the modes of a
chain, with a block-tridiagonal solution for each piece.
"""

import math
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.contact.blocks import EXACT, Precision, correct, factorise, set_rows
from archfrag.mechanics.contact.modes import reconcile_modes, straight_rounds, velocity_scale
from archfrag.mechanics.contact.placing import MINUS, PLUS
from archfrag.mechanics.model import Model

# Friction without limit is at most this in between; at its end joints stick again.
PATH_FRICTION = 1e3
# Paths to try, from other opening velocities each, and their compliances, one after another:
# they keep the pieces of hyperstatic joints regular. Behind them paths of joints that stay
# compliant.
PATHS, SOFT_PATHS = 9, 3
COMPLIANCES = (1e-6, 1e-8, 1e-10)
# Where a corner is neither compressed nor opening, rounding decides: such a state may break a
# law by this much, relative, and its residual shows it.
DEGENERATE = 1e-8
ON, BACK = 1.0, -1.0
N_FUNCTION = 4
# A mode as one number: corners that touch, 1 and 2, times three, and the sense of friction.
OPEN, NONE = 1, -2


class Path(NamedTuple):
    """Workspace of path following."""

    model: Model  # with friction limited to PATH_FRICTION
    opening: np.ndarray  # (n_joint, 2, 2) corner, xy: extra velocity at the start [m/s]
    bias: np.ndarray  # (n_joint, 2, 2) of the problem itself [m/s]
    at_start: np.ndarray  # (n_joint, 4) functions of each joint's piece at tau = 0
    at_end: np.ndarray  # (n_joint, 4) and at tau = 1
    target: np.ndarray  # (n_joint, 4) modes on the other side of their zeros


class Break(NamedTuple):
    """Where a path leaves a piece."""

    joint: int  # that changes its mode; -1: none does
    distance: float  # in tau
    mode: int  # into which
    decides: int  # corner at which the slip decides the sense of friction; -1: it is known


NO_BREAK = Break(-1, np.inf, OPEN, -1)


def new_path(model: Model) -> Path:
    """Workspace for the chain of a model."""
    n_joint = model.friction.size
    friction = np.minimum(model.friction, PATH_FRICTION)
    limited = model._replace(friction=friction, ray=np.stack([np.ones(n_joint), friction], axis=1))
    velocities = np.zeros((2, n_joint, 2, 2))
    functions = np.zeros((3, n_joint, N_FUNCTION))
    return Path(limited, *velocities, *functions)


@inlined
def mode_number(touch_0, touch_1, slide):
    """A mode as one number."""
    return 3 * (int(touch_0) + 2 * int(touch_1)) + int(slide) + 1


@inlined
def _corner_mode(corner, slide):
    return 3 * (corner + 1) + int(slide) + 1


@inlined
def _set_mode(work, j, mode):
    corners = mode // 3
    work.touch[j, 0], work.touch[j, 1] = corners & 1, corners >> 1
    work.slide[j] = mode % 3 - 1


@inlined
def _along(work, j, k, sense):
    """Opening rate of a corner by the normal that counts for a sense of friction."""
    n = work.side_normal[j, k, PLUS if sense > 0.0 else MINUS]
    return n[0] * work.parting[j, k, 0] + n[1] * work.parting[j, k, 1]


@kernel
def _functions_if_open(j, work, value, target):
    """Opening rates of corner 0 by the two normals, then those of corner 1 (Eqs 5, 23)."""
    for k in range(2):
        if work.candidate[j, k] < 0.5:
            continue
        for c in range(2):
            sense = work.known[j]
            if sense == 0.0:
                sense = 1.0 - 2.0 * c
            value[2 * k + c] = _along(work, j, k, sense)
            target[2 * k + c] = _corner_mode(k, sense)


@kernel
def _functions_if_closed(j, model, work, value, target):
    """Normal forces at both corners, then Coulomb's limits of either sense, or the slip rate."""
    nx, ny = work.normal[j, 0], work.normal[j, 1]
    fx, fy, slide = work.reaction[j, 0], work.reaction[j, 1], work.slide[j]
    normal, tangential = fx * nx + fy * ny, fy * nx - fx * ny
    px, py = work.point[j, 0, 0] - work.pivot[j, 0], work.point[j, 0, 1] - work.pivot[j, 1]
    difference = work.reaction[j, 2] / (px * ny - py * nx)
    value[0], target[0] = 0.5 * (normal + difference), _corner_mode(1, slide)
    value[1], target[1] = 0.5 * (normal - difference), _corner_mode(0, slide)
    if slide == 0.0:
        limit = model.friction[j] * normal
        value[2], target[2] = limit - tangential, mode_number(1, 1, 1)
        value[3], target[3] = limit + tangential, mode_number(1, 1, -1)
    elif work.known[j] == 0.0:
        ux = work.parting[j, 0, 0] + work.parting[j, 1, 0]
        uy = work.parting[j, 0, 1] + work.parting[j, 1, 1]
        value[2], target[2] = -0.5 * slide * (nx * uy - ny * ux), mode_number(1, 1, 0)


@kernel
def _functions_if_corner(j, model, work, value, target):
    """Margins of the cones about both normals, or force and slip rate; then the other corner."""
    k = 0 if work.touch[j, 0] > 0.5 else 1
    other, mu, slide = 1 - k, model.friction[j], work.slide[j]
    n, m = work.side_normal[j, k, PLUS], work.side_normal[j, k, MINUS]
    fx, fy = work.reaction[j, 0], work.reaction[j, 1]
    if slide == 0.0:
        hx, hy = n[0] - mu * n[1], n[1] + mu * n[0]
        lx, ly = m[0] + mu * m[1], m[1] - mu * m[0]
        sense = 1.0 if lx * hy - ly * hx >= 0.0 else -1.0
        value[0], target[0] = -sense * (hx * fy - hy * fx), _corner_mode(k, 1)
        value[1], target[1] = -sense * (fx * ly - fy * lx), _corner_mode(k, -1)
    else:
        nx, ny = (n[0], n[1]) if slide > 0.0 else (m[0], m[1])
        along = slide * mu
        value[0], target[0] = fx * (nx - along * ny) + fy * (ny + along * nx), OPEN
        if work.known[j] == 0.0:
            ux, uy = work.parting[j, k, 0], work.parting[j, k, 1]
            value[1], target[1] = -slide * (nx * uy - ny * ux), _corner_mode(k, 0)
    if work.candidate[j, other] > 0.5:
        nx, ny = work.normal[j, 0], work.normal[j, 1]
        value[2] = nx * work.parting[j, other, 0] + ny * work.parting[j, other, 1]
        target[2] = mode_number(1, 1, slide)


@inlined
def _set_bias(work, path, part):
    """The problem's own bias with a part of the opening velocities."""
    for j in range(work.slide.size):
        for k in range(2):
            for c in range(2):
                work.bias[j, k, c] = path.bias[j, k, c] + part * path.opening[j, k, c]


@kernel
def piece_functions(position, work, path, tau, value):
    """Linear functions that are non-negative on the present piece, at one place of the path.

    Into `value`, inf where there is no function, and into ``path.target`` the mode on the other
    side of each one's zero. Returned is nan where a pivot vanishes.
    """
    _set_bias(work, path, 1.0 - tau)
    left = correct(path.model, position, work, np.inf)
    for j in range(work.slide.size):
        for f in range(N_FUNCTION):
            value[j, f], path.target[j, f] = np.inf, NONE
        at_0, at_1 = work.touch[j, 0] > 0.5, work.touch[j, 1] > 0.5
        if at_0 and at_1:
            _functions_if_closed(j, path.model, work, value[j], path.target[j])
        elif at_0 or at_1:
            _functions_if_corner(j, path.model, work, value[j], path.target[j])
        else:
            _functions_if_open(j, work, value[j], path.target[j])
    return left


@kernel
def set_openings(work, path, scale, attempt):
    """Open all joints, and choose velocities that keep them so; others for each attempt."""
    seed = 88172645 + 7919 * attempt
    for j in range(work.slide.size):
        _set_mode(work, j, OPEN)
        for k in range(2):
            seed ^= (seed << 13) & 0xFFFFFFFF
            seed ^= seed >> 17
            seed ^= (seed << 5) & 0xFFFFFFFF
            size = scale * (4.0 + 4.0 * (seed >> 8) / 16777216.0)
            nx = work.side_normal[j, k, PLUS, 0] + work.side_normal[j, k, MINUS, 0]
            ny = work.side_normal[j, k, PLUS, 1] + work.side_normal[j, k, MINUS, 1]
            norm = math.sqrt(nx * nx + ny * ny)
            if norm < 1e-3:
                nx, ny, norm = work.normal[j, 0], work.normal[j, 1], 1.0
            path.opening[j, k, 0], path.opening[j, k, 1] = size * nx / norm, size * ny / norm


@kernel
def direction_after(path, j, mode, left):
    """Sense of tau that leads into the piece of joint j behind a break.

    `mode` is the joint's new one, `left` the one it left; zero where no function leads back.
    """
    direction = 0.0
    for f in range(N_FUNCTION):
        back = path.target[j, f] == left
        if mode == OPEN:
            corner = left // 3 - 1
            back = f == 2 * corner + (0 if left % 3 == 2 else 1)
        if back:
            direction = ON if path.at_end[j, f] > path.at_start[j, f] else BACK
    return direction


@inlined
def _zero(path, j, f, tau, direction):
    """Distance in tau to a function's zero, and its slope; the distance is not negative."""
    rise = path.at_end[j, f] - path.at_start[j, f]
    slope, value = rise * direction, path.at_start[j, f] + tau * rise
    return (max(-value / slope, 0.0) if slope < 0.0 else np.inf), slope, value


@kernel
def _closing_of_corner(work, path, j, k, tau, direction, left):
    """Break at which a corner of an open joint closes: both functions have reached zero."""
    far, chosen = -np.inf, -1
    for f in range(2 * k, 2 * k + 2):
        distance, slope, value = _zero(path, j, f, tau, direction)
        if path.target[j, f] == left and slope > 0.0:
            return NO_BREAK
        if slope >= 0.0:
            if value > 0.0:
                return NO_BREAK
        elif distance > far:
            far, chosen = distance, f
    if chosen < 0:
        return NO_BREAK
    n, m = work.side_normal[j, k, PLUS], work.side_normal[j, k, MINUS]
    alike = work.known[j] == 0.0 and abs(n[0] - m[0]) + abs(n[1] - m[1]) < 1e-12
    return Break(j, far, int(path.target[j, chosen]), k if alike else -1)


@kernel
def next_break(work, path, tau, direction, crossed):
    """The next break of the path behind tau; `crossed` is the last: its joint and mode left."""
    first = NO_BREAK
    for j in range(work.slide.size):
        left = crossed[1] if j == crossed[0] else -1
        if work.touch[j, 0] + work.touch[j, 1] < 0.5:
            for k in range(2):
                if work.candidate[j, k] > 0.5:
                    found = _closing_of_corner(work, path, j, k, tau, direction, left)
                    if found.distance < first.distance:
                        first = found
            continue
        for f in range(N_FUNCTION):
            if path.at_end[j, f] == np.inf or path.target[j, f] == left:
                continue
            distance, slope, _ = _zero(path, j, f, tau, direction)
            if slope < 0.0 and distance < first.distance:
                first = Break(j, distance, int(path.target[j, f]), -1)
    return first


@kernel
def follow_path(position, work, path, scale, compliance, attempt):
    """Follow the solution from all joints open to the problem's own; its modes are left in `work`.

    `compliance` of the contact rows is relative; `attempt` chooses other opening velocities, and
    with them another path. Returned: whether the end is reached, and how many breaks were met.
    """
    set_openings(work, path, scale, attempt)
    tau, direction, reached = 0.0, ON, False
    crossed = -1, -1
    limit = 100 + 20 * work.slide.size
    breaks = 0
    while breaks < limit:
        set_rows(path.model, position, work)
        factorise(path.model, work, compliance)
        left = piece_functions(position, work, path, 0.0, path.at_start)
        left += piece_functions(position, work, path, 1.0, path.at_end)
        j = crossed[0]
        if j >= 0:
            mode = mode_number(work.touch[j, 0], work.touch[j, 1], work.slide[j])
            direction = direction_after(path, j, mode, crossed[1])
        if direction == 0.0 or not math.isfinite(left):
            break
        found = next_break(work, path, tau, direction, crossed)
        ahead = direction * (1.0 - tau)
        reached = 0.0 < ahead <= found.distance
        if reached or found.joint < 0:
            break
        tau += direction * found.distance
        j, mode, k = found.joint, found.mode, found.decides
        if k >= 0:
            piece_functions(position, work, path, tau, path.at_start)
            n = work.side_normal[j, k, PLUS]
            slipping = n[0] * work.parting[j, k, 1] - n[1] * work.parting[j, k, 0]
            mode = _corner_mode(k, -1 if slipping > 0.0 else 1)
        crossed = j, mode_number(work.touch[j, 0], work.touch[j, 1], work.slide[j])
        _set_mode(work, j, mode)
        breaks += 1
    _set_bias(work, path, 0.0)
    return reached, breaks


@kernel
def _stick_rough(model, work):
    """Closed joints without friction limit stick again, whatever a path took them through."""
    for j in range(work.slide.size):
        if math.isinf(model.friction[j]) and work.touch[j, 0] + work.touch[j, 1] > 1.5:
            work.slide[j] = 0.0


@kernel
def solve_by_path(model, position, work, path, most_paths, soft_paths):
    """Solve one contact problem along solution paths.

    Parameters
    ----------
    model : archfrag.mechanics.model.Model
    position : array, (n_body + 2, 3)
    work : archfrag.mechanics.model.Work
        With the contacts placed, `candidate`, `known`, `bias` and `free`; on return the solution.
    path : Path
    most_paths, soft_paths : int
        Paths allowed, and behind them those of joints that stay compliant; `PATHS`, `SOFT_PATHS`.

    Returns
    -------
    solved, compliant : bool
        Compliant where the solution is that of slightly compliant joints (relative compliance
        1e-6 to 1e-4). Where a ring closes, its last gaps contradict each other by the square of
        their size, and of the many combinations that leave one of them open by 1e-10 m rounding
        finds none.
    rounds, breaks : int
        Linear problems solved by the iteration on modes, and pieces of paths followed.
    """
    scale = velocity_scale(position, work)
    for j in range(work.slide.size):
        for k in range(2):
            path.bias[j, k, 0], path.bias[j, k, 1] = work.bias[j, k, 0], work.bias[j, k, 1]
    rounds = breaks = 0
    straight = straight_rounds(work)
    if not math.isfinite(scale):
        return False, False, rounds, breaks
    for attempt in range(most_paths):
        compliance = COMPLIANCES[attempt % 3]
        _, more = follow_path(position, work, path, scale, compliance, attempt)
        breaks += max(more, 1)
        _stick_rough(model, work)
        while compliance > 2.0 * EXACT.compliance:
            soft = Precision(compliance, EXACT.slack, np.inf)
            rounds += reconcile_modes(model, position, work, scale, soft, straight)[1]
            compliance *= 0.1
        for slack in (EXACT.slack, DEGENERATE):
            exact = Precision(EXACT.compliance, slack, slack)
            solved, more = reconcile_modes(model, position, work, scale, exact, straight)
            rounds += more
            if solved:
                return True, False, rounds, breaks
    for attempt in range(soft_paths):
        compliance = COMPLIANCES[0] * 10.0**attempt
        _, more = follow_path(position, work, path, scale, compliance, attempt)
        breaks += max(more, 1)
        _stick_rough(model, work)
        soft = Precision(compliance, DEGENERATE, np.inf)
        solved, more = reconcile_modes(model, position, work, scale, soft, straight)
        rounds += more
        if solved:
            return True, True, rounds, breaks
    return False, False, rounds, breaks
