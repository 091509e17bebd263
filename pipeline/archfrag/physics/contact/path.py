"""Contact problem by its piecewise-linear solution path, if Newton's iteration on the modes fails.

The path begins at a problem whose solution is known in given modes, mostly those before the step:
it has other velocities of free bodies and another bias, chosen so that each joint keeps its mode.
These are changed into the problem's own, tau from 0 to 1, and the solution is followed exactly
from piece to piece of the contact laws: at each break one joint changes its mode. Where the laws
are not monotone (friction) the path may go back in tau; its direction after a break is the one
that leads into the new piece. This is Lemke's complementary pivoting (Cottle, Pang and Stone, *The
Linear Complementarity Problem*, ch. 4) written for the modes of a chain, with a block-tridiagonal
solution for each piece, and from a known basis as in Ferris and Munson's PATH (1999, *Optim.
Methods Softw.* 12).
"""

import math
from typing import NamedTuple

import numpy as np

from archfrag.physics.contact import blocks, laws
from archfrag.physics.contact.blocks import Precision
from archfrag.physics.contact.modes import solve_contact, velocity_scale
from archfrag.physics.contact.placing import corner_velocity, relative_velocity
from archfrag.physics.contact.ties import push_by_pulls, recall_pulls
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.numbers import copy_rows
from archfrag.physics.onset import RestProblem, new_rest_problem
from archfrag.physics.state import Model
from archfrag.physics.status import Count

# Coefficient of friction along a path of joints with unlimited friction. At the end of the path
# they stick again.
PATH_FRICTION = 1e3
# Modes that a path begins with: those given, those reached by the path before, or all joints open.
GIVEN = 0
REACHED = 1
ALL_OPEN = 2


class Attempt(NamedTuple):
    """Settings of a path that is tried."""

    compliance: float  # of contact rows, relative; it keeps hyperstatic pieces regular
    size: float  # velocities at the start over those of the problem
    start: int  # GIVEN, REACHED or ALL_OPEN
    compliant: bool  # whether joints stay compliant at the end


ATTEMPTS = (
    Attempt(1e-10, 1.0, GIVEN, False),
    Attempt(1e-7, 1.0, REACHED, False),
    Attempt(1e-6, 10.0, ALL_OPEN, False),
    Attempt(1e-8, 1.0, ALL_OPEN, False),
    Attempt(1e-6, 0.1, ALL_OPEN, False),
    Attempt(1e-10, 10.0, ALL_OPEN, False),
    Attempt(1e-6, 1.0, ALL_OPEN, True),
    Attempt(1e-5, 1.0, ALL_OPEN, True),
    Attempt(1e-4, 1.0, ALL_OPEN, True),
)
# Where a corner is neither compressed nor opening, rounding decides. Such a state may break a law
# by DEGENERATE, relative, and its residual shows it. If joints have to be rigid, the first
# EXACT_PATHS paths must keep the laws to rounding.
DEGENERATE = 1e-8
EXACT_PATHS = 2
ON = 1.0
BACK = -1.0
N_FUNCTION = 4
NONE = -2  # no mode


@struct(
    free=(3,),
    bias=(2, 2),
    push=(3,),
    opening=(2, 2),
    contact=(2,),
    at_start=(4,),
    at_end=(4,),
    target=(4,),
)
class Path(NamedTuple):
    """Workspace of path following, and of the range of rest."""

    model: Model  # with friction limited to PATH_FRICTION
    free: (
        np.ndarray
    )  # (n_body + 2, 3) velocities without reactions of the problem itself
    bias: np.ndarray  # (n_joint, 2, 2) bias of the problem itself
    push: np.ndarray  # (n_body + 2, 3) velocities that the start adds to `free`
    opening: np.ndarray  # (n_joint, 2, 2) bias that the start adds to `bias`
    contact: np.ndarray  # (n_joint, 2) modes in which a path has ended
    slide: np.ndarray  # (n_joint,)
    at_start: np.ndarray  # (n_joint, 4) functions of each joint's piece at tau = 0
    at_end: np.ndarray  # (n_joint, 4) the same functions at tau = 1
    target: np.ndarray  # (n_joint, 4) modes on the other side of the functions' zeros
    rest: RestProblem


class Break(NamedTuple):
    """Point at which a path leaves a piece."""

    joint: int  # joint that changes its mode; -1: none does
    distance: float  # distance in tau from the last break
    mode: int  # new mode of the joint
    decides: (
        int  # corner at which the slip decides the sense of friction; -1: it is known
    )


NO_BREAK = Break(-1, np.inf, laws.OPEN, -1)


def new_path(model: Model) -> Path:
    """Return the workspace of path following for the chain of a model."""
    n_joint = model.friction.size
    friction = np.minimum(model.friction, PATH_FRICTION)
    limited = model._replace(
        friction=friction, ray=np.stack([np.ones(n_joint), friction], axis=1)
    )
    free, push = np.zeros((2, model.mass.size, 3))
    bias, opening = np.zeros((2, n_joint, 2, 2))
    functions = np.zeros((3, n_joint, N_FUNCTION))
    modes = (np.zeros((n_joint, 2)), np.zeros(n_joint))
    rest = new_rest_problem(model)
    arrays = free, bias, push, opening, *modes, *functions
    return Path(limited, *arrays, rest)  # type: ignore[call-arg]


@inlined
def copy_modes(of, to):
    """Copy the modes, ``contact`` and ``slide``, from `of` to `to`."""
    for j in range(to.slide.size):
        to.contact[j, 0] = of.contact[j, 0]
        to.contact[j, 1] = of.contact[j, 1]
        to.slide[j] = of.slide[j]


@inlined
def _set_problem(work, path, part):
    """Set velocities and bias in `work` to the problem's own plus a part of the start's.

    That is `part` times what the start adds.
    """
    for i in range(work.free.shape[0]):
        for c in range(3):
            work.free[i, c] = path.free[i, c] + part * path.push[i, c]
    for j in range(work.slide.size):
        for k in range(2):
            for c in range(2):
                work.bias[j, k, c] = path.bias[j, k, c] + part * path.opening[j, k, c]


@kernel
def piece_functions(position, work, path, tau, value):
    """Evaluate the linear functions that are non-negative on the path's present piece.

    They are those at `tau`. They go into `value`, (n_joint, 4), with inf where there is no
    function; the modes beyond their zeros go into ``path.target``. Return nan if a pivot vanishes.
    """
    _set_problem(work, path, 1.0 - tau)
    left = blocks.correct(path.model, position, work, np.inf)
    for j in range(work.slide.size):
        for f in range(N_FUNCTION):
            value[j, f] = np.inf
            path.target[j, f] = NONE
        at_0, at_1 = laws.touching(j, work)
        if at_0 and at_1:
            laws.functions_if_closed(j, path.model, work, value[j], path.target[j])
        elif at_0 or at_1:
            laws.functions_if_corner(j, path.model, work, value[j], path.target[j])
        else:
            laws.functions_if_open(j, work, value[j], path.target[j])
    return left


@inlined
def _corner_normal(work, j, k, closed, slide):
    """Return the normal of a corner, along which it is compressed or opens.

    `closed` says whether the joint is, and `slide` is the sense of its friction.
    """
    if slide != 0.0 and not closed:
        return laws.slip_normal(j, k, slide < 0.0, work)
    n = laws.side_of(j, k, laws.PLUS, work)
    m = laws.side_of(j, k, laws.MINUS, work)
    x = n[0] + m[0]
    y = n[1] + m[1]
    norm = math.sqrt(x * x + y * y)
    if closed or norm <= 1e-3:
        return laws.normal_of(j, work)
    return x / norm, y / norm


@kernel
def set_start(position, work, path, scale):
    """Choose where a path begins: a problem with a solution in the present modes.

    Its bodies move as without reactions, every corner that touches is compressed, every other
    one opens, and what slides does so against its friction. Sizes grow along the chain: equal
    ones would let several joints change their modes at one tau.

    Writes: work (column, reaction, relative, row, solved, unknown), path (opening, push).
    """
    model = path.model
    unknown = work.unknown
    n_joint = work.slide.size
    force = scale * model.mass.sum()
    blocks.set_rows(model, position, work)
    relative_velocity(model, position, path.free, work.pivot, work.relative)
    for j in range(n_joint):
        size = 1.0 + j / n_joint
        slide = work.slide[j]
        closed = work.contact[j, 0] + work.contact[j, 1] > 1.5
        unknown[j, 0] = unknown[j, 1] = unknown[j, 2] = 0.0
        for k in range(2):
            nx, ny = _corner_normal(work, j, k, closed, slide)
            ux, uy = corner_velocity(j, k, work.relative, work)
            vx = scale * size * nx
            vy = scale * size * ny
            if work.contact[j, k] > 0.5:
                vx, vy = slide * vy, -slide * vx
                if closed or slide != 0.0:
                    column = k if closed else 0
                    unknown[j, column] = -force * size
                else:
                    for a in range(2):
                        part = work.row[j, a, 0] * nx + work.row[j, a, 1] * ny
                        unknown[j, a] = -force * size * part
            path.opening[j, k, 0] = vx - ux - path.bias[j, k, 0]
            path.opening[j, k, 1] = vy - uy - path.bias[j, k, 1]
    work.solved[:] = 0.0
    blocks.add_reactions(model, position, work)
    copy_rows(work.solved, path.push, 0, position.shape[0])


@kernel
def direction_after(path, j, mode, left):
    """Return the sense of tau that leads into the next piece after a break at joint `j`.

    `mode` is the joint's new mode, and `left` the one that it left. Return ON, BACK, or zero if no
    function leads back.

    Reads: path (at_end, at_start, target).
    """
    direction = 0.0
    for f in range(N_FUNCTION):
        back = path.target[j, f] == left
        if mode == laws.OPEN:
            # An open joint has two functions a corner, by the two senses of friction.
            back = f == laws.function_of(left)
        if back:
            direction = ON if path.at_end[j, f] > path.at_start[j, f] else BACK
    return direction


@inlined
def _zero(path, j, f, tau, direction):
    """Return the distance in tau to the zero of a function, its slope and its value.

    It is function `f` of joint `j`. The slope is that along `direction`. The distance is at least
    0, and inf if the function does not fall.
    """
    rise = path.at_end[j, f] - path.at_start[j, f]
    slope = rise * direction
    value = path.at_start[j, f] + tau * rise
    return (max(-value / slope, 0.0) if slope < 0.0 else np.inf), slope, value


@kernel
def _closing_of_corner(work, path, j, k, tau, direction, left):
    """Find the break at which corner `k` of open joint `j` closes: both its functions reach zero.

    Return `NO_BREAK` if it does not. `left` is the mode that the joint left last, or -1.

    Reads: work (known, side_normal), path (at_end, at_start, target).
    """
    far = -np.inf
    chosen = -1
    for f in range(2 * k, 2 * k + 2):
        distance, slope, value = _zero(path, j, f, tau, direction)
        if path.target[j, f] == left and slope > 0.0:
            return NO_BREAK
        if slope >= 0.0:
            if value > 0.0:
                return NO_BREAK
        elif distance > far:
            far = distance
            chosen = f
    if chosen < 0:
        return NO_BREAK
    n = laws.side_of(j, k, laws.PLUS, work)
    m = laws.side_of(j, k, laws.MINUS, work)
    alike = work.known[j] == 0.0 and abs(n[0] - m[0]) + abs(n[1] - m[1]) < 1e-12
    corner = k if alike else -1
    return Break(j, far, int(path.target[j, chosen]), corner)


@kernel
def next_break(work, path, tau, direction, crossed):
    """Find the next break of the path from `tau` along `direction`.

    `crossed` has the joint and the former mode of the last break.
    """
    first = NO_BREAK
    for j in range(work.slide.size):
        left = crossed[1] if j == crossed[0] else -1
        if work.contact[j, 0] + work.contact[j, 1] < 0.5:
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
def follow_path(position, work, path, scale, compliance):
    """Follow the solution from the present modes to those at the problem itself, left in `work`.

    `compliance` of the contact rows is relative. Return the number of breaks.
    """
    set_start(position, work, path, scale)
    tau = 0.0
    direction = ON
    crossed = (-1, -1)
    first = 0
    breaks = 0
    limit = 100 + 20 * work.slide.size
    while breaks < limit:
        blocks.set_up(path.model, position, work, compliance, first)
        left = piece_functions(position, work, path, 0.0, path.at_start)
        left += piece_functions(position, work, path, 1.0, path.at_end)
        if crossed[0] >= 0:
            mode = laws.mode_of(crossed[0], work)
            direction = direction_after(path, crossed[0], mode, crossed[1])
        if direction == 0.0 or not math.isfinite(left):
            break
        found = next_break(work, path, tau, direction, crossed)
        ahead = direction * (1.0 - tau)
        if 0.0 < ahead <= found.distance or found.joint < 0:
            break
        tau += direction * found.distance
        first = found.joint
        mode = found.mode
        k = found.decides
        if k >= 0:
            piece_functions(position, work, path, tau, path.at_start)
            normal = laws.side_of(first, k, laws.PLUS, work)
            slipping = laws.cross(normal, laws.rate_of(first, k, work))
            mode = laws.corner_mode(k, -1.0 if slipping > 0.0 else 1.0)
        crossed = first, laws.mode_of(first, work)
        laws.set_mode(work, first, mode)
        breaks = breaks + 1
    _set_problem(work, path, 0.0)
    return breaks


@kernel
def solve_by_path(model, position, work, path, exact):
    """Solve one contact problem along solution paths, the first from the modes in `work`.

    If `exact`, joints are rigid. Else they stay slightly compliant (relative compliance 1e-6 to
    1e-4) if no rigid solution is found: where a ring closes, its last gaps contradict each other
    by the square of their size, and of the many combinations that leave one of them open by 1e-10
    m rounding finds none.

    Return solved, compliant, the number of linear problems in the iteration on modes, and the
    number of breaks.
    """
    scale = velocity_scale(model, position, work)
    copy_rows(work.free, path.free, 0, position.shape[0])
    push_by_pulls(model, work, path.free, 1.0)  # on a path ties pull as before
    for j in range(work.slide.size):
        for k in range(2):
            path.bias[j, k, 0] = work.bias[j, k, 0]
            path.bias[j, k, 1] = work.bias[j, k, 1]
    iterations = 0.0
    breaks = 0
    if not math.isfinite(scale):
        return False, False, iterations, breaks
    for number in range(len(ATTEMPTS)):
        attempt = ATTEMPTS[number]
        if exact and attempt.compliant:
            break
        if attempt.start == REACHED:
            copy_modes(path, work)
        elif attempt.start == ALL_OPEN:
            for j in range(work.slide.size):
                laws.set_mode(work, j, laws.OPEN)
        breaks += follow_path(
            position, work, path, attempt.size * scale, attempt.compliance
        )
        push_by_pulls(model, work, work.free, -1.0)
        for j in range(work.slide.size):  # joints of unlimited friction stick again
            touches = work.contact[j, 0] + work.contact[j, 1]
            if math.isinf(model.friction[j]) and touches > 1.5:
                work.slide[j] = 0.0
        copy_modes(work, path)
        for loose in range(
            1 if attempt.compliant or (exact and number < EXACT_PATHS) else 2
        ):
            copy_modes(path, work)
            slack = DEGENERATE if loose or attempt.compliant else blocks.EXACT.slack
            precision = Precision(blocks.EXACT.compliance, slack, slack)
            if attempt.compliant:
                precision = Precision(attempt.compliance, slack, np.inf)
            solved, _, _, more = solve_contact(
                model, position, work, True, 0.0, -1.0, precision
            )
            iterations += more
            if solved:
                return True, attempt.compliant, iterations, breaks
    return False, False, iterations, breaks


@kernel
def solve_with_fallback(model, state, work, path):
    """Solve a posed contact problem along paths, the first from the state's own modes.

    Return solved, and compliant: whether the solution is that of slightly compliant joints.
    """
    count = state.count
    copy_modes(state, work)
    recall_pulls(state, work, True)
    for j in range(work.slide.size):
        work.known[j] = 0.0
    solved, compliant, iterations, breaks = solve_by_path(
        model, work.position, work, path, False
    )
    count[Count.ITERATIONS] += iterations + breaks
    count[Count.PATHS] += breaks > 0
    count[Count.COMPLIANT] += compliant
    return solved, compliant
