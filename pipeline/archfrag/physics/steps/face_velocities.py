"""Velocities after a step of bodies whose joints give, by Newton's iteration on blocks.

With the velocities w after a step of h, the part of a joint that has overlapped before it has the
gap d_m + b u_w: that in the middle of the step, moved on for the delay b of its dashpots. What
comes into contact has d_m + h u_w. In the limit of stiff joints this is Signorini's law as
`steps.step` has it. What joints bear is linear between changes of what overlaps, and without
friction it is the derivative of a convex energy: Newton's step is cut to where the energy falls no
more along it. The system of each step is block-tridiagonal.
"""

from typing import NamedTuple

from numpy import ndarray

from archfrag.physics.contact.blocks import block_of, factorise_block, solve_block
from archfrag.physics.contact.placing import corner_rate_at, turn_of
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import fused, opposite, select, some
from archfrag.physics.kernels.structs import struct
from archfrag.physics.neighbours import ahead_of, end_of, row_of
from archfrag.physics.numbers import copy_rows, dot, flag, larger, smaller
from archfrag.physics.steps.face_law import Gaps, bear
from archfrag.physics.steps.step import normal_of

MOST_ITERATIONS = 40.0
# A Newton step is cut to where the slope of the energy vanishes, if at its end the slope is
# positive and more than TURNED times what it was. Trials keep the part LEAST of an interval from
# its ends, until the interval is shorter than SHORTEST.
TURNED = 0.5
LEAST = 0.05
SHORTEST = 1e-6


OF_BODIES = ("block", "left", "forward", "base", "change")


@struct(slip=(3,))
class Memory(NamedTuple):
    """What joints that give remember between steps, of one run or of four."""

    slip: ndarray  # (n_joint, 3) elastic part of the slip of points [m]
    touching: ndarray  # (n_joint,) length in contact [m]
    half: ndarray  # (n_joint,) half the length along which faces lay opposite [m]


@struct(
    gap=(2,),
    before=(2,),
    part=(2,),
    slip=(3,),
    held=(3,),
    most=(3,),
    force=(3,),
    stiffness=(3, 3),
    block=(3, 3),
    lower=(3, 3),
    upper=(3, 3),
    left=(3,),
    forward=(3,),
    base=(3,),
    change=(3,),
)
class FaceWork(NamedTuple):
    """Workspace of a step of joints that give, of one run or of four."""

    gap: ndarray  # (n_joint, 2) in the middle of the step: at the joint's middle [m], slope [1]
    before: ndarray  # (n_joint, 2) the same at the beginning of the step
    part: ndarray  # (n_joint, 2) ends of the part that overlaps at the beginning [m]
    tilt: ndarray  # (n_joint,) by how much the slope falls with the relative rotation
    half: ndarray  # (n_joint,) half the length along which the faces lie opposite [m]
    slip: ndarray  # (n_joint, 3) elastic part of the slip of points in the middle [m]
    touching: ndarray  # (n_joint,) length in contact before the step [m]
    held: ndarray  # (n_joint, 3) length of points at which a slip is held [m]
    most: ndarray  # (n_joint, 3) elastic slip at which they slide [m]
    force: ndarray  # (n_joint, 3) normal [N], its moment [N m], shear [N]
    stiffness: ndarray  # (n_joint, 3, 3) of x, y and rotation about the pivot
    block: ndarray  # (n_body + 2, 3, 3) of the system, eliminated
    left: ndarray  # (n_body + 2, 3) impulses that are not balanced
    lower: (
        ndarray  # (n_joint, 3, 3) coupling of the body after a joint with that before
    )
    upper: ndarray  # (n_joint, 3, 3) coupling of the body before with that after
    forward: ndarray  # (n_body + 2, 3) solution of the forward sweep
    base: ndarray  # (n_body + 2, 3) velocities at which a Newton step begins
    change: ndarray  # (n_body + 2, 3) what the Newton step takes from them


@inlined
def parts_of(j, work, x, y):
    """Return the components of a vector (x, y) along the normal and the tangent of joint `j`."""
    nx, ny = normal_of(j, work)
    return nx * x + ny * y, nx * y - ny * x


@inlined
def _set_stiffness(j, runs, step, b):
    """Set the forces that joint `j` bears, and their derivatives by its relative displacement.

    `step` and `b` are the times after the middle at which the law is asked [s]: of what comes into
    contact, and of what has overlapped before.
    """
    work = runs.work
    own = runs.own
    faces = runs.faces
    px = work.pivot[j, 0]
    py = work.pivot[j, 1]
    ux, uy = corner_rate_at(j, px, py, runs.model, work.position, work.solved)
    opens, along = parts_of(j, work, ux, uy)
    c = own.tilt[j]
    turns = c * turn_of(j, runs.model, work.solved)
    g0 = own.gap[j, 0]
    g1 = own.gap[j, 1]
    d0 = g0 + step * opens
    d1 = g1 - step * turns
    gaps = Gaps(
        d0,
        d1,
        g0 + b * opens,
        g1 - b * turns,
        own.part[j, 0],
        own.part[j, 1],
        step / b,
        0.5 * (g0 + d0),
        0.5 * (g1 + d1),
    )
    slides = b * along
    slip = own.slip[j, 0] + slides, own.slip[j, 1] + slides, own.slip[j, 2] + slides
    k = faces.stiffness[j]
    material = k, faces.shear[j], runs.model.friction[j]
    has = bear(gaps, own.half[j], slip, own.touching[j], material, faces.points)
    for i in range(3):
        own.held[j, i] = has.held[i]
        own.most[j, i] = has.most[i]
    own.force[j, 0] = has.normal
    own.force[j, 1] = c * has.moment
    own.force[j, 2] = has.shear
    nx, ny = normal_of(j, work)
    press = k * has.l0
    x = press * nx - has.rub_0 * ny
    y = press * ny + has.rub_0 * nx
    hold = has.hold
    tilt = c * k * has.l1
    rub = c * has.rub_1
    s = own.stiffness
    s[j, 0, 0] = nx * x + hold * ny * ny
    s[j, 0, 1] = ny * x - hold * ny * nx
    s[j, 0, 2] = rub * ny - tilt * nx
    s[j, 1, 0] = nx * y - hold * nx * ny
    s[j, 1, 1] = ny * y + hold * nx * nx
    s[j, 1, 2] = -rub * nx - tilt * ny
    s[j, 2, 0] = -tilt * nx
    s[j, 2, 1] = -tilt * ny
    s[j, 2, 2] = c * c * k * has.l2


@inlined
def _arm_of(j, i, work):
    """Return the vector to the pivot of joint `j` from the centroid of body `i`."""
    x = work.pivot[j, 0] - work.position[i, 0]
    return x, work.pivot[j, 1] - work.position[i, 1]


@inlined
def _turning(s, j, a, arm):
    """Return row `a` of the stiffness of joint `j`, for the motion of a body's centroid.

    `arm` is the vector from that centroid to the pivot.
    """
    x = s[j, a, 0]
    y = s[j, a, 1]
    return x, y, fused(arm[0], y, fused(-arm[1], x, s[j, a, 2]))


@inlined
def _add(out, i, size, rows, arm):
    """Add `size` times three rows of stiffness to block `i` of `out`.

    The rows become forces on a body and the moment about its centroid, from which `arm` leads to
    the pivot.
    """
    x, y, z = rows
    for c in range(3):
        out[i, 0, c] += size * x[c]
        out[i, 1, c] += size * y[c]
        out[i, 2, c] += size * fused(arm[0], y[c], fused(-arm[1], x[c], z[c]))


@inlined
def _add_side(j, side, sense, runs, size, coupling):
    """Add what joint `j` bears in a step, and its stiffness, for one of its bodies.

    `side` is 0 for the body before the joint, with `sense` -1, and 1 for the one after it, with
    `sense` 1. `coupling` is the array that couples the body with the other one, and `size`
    multiplies stiffnesses.
    """
    own = runs.own
    i = row_of(runs.model, j, side)
    arm = _arm_of(j, i, runs.work)
    other = _arm_of(j, row_of(runs.model, j, 1 - side), runs.work)
    force = runs.work.reaction
    fx = sense * force[j, 0]
    fy = sense * force[j, 1]
    own.left[i, 0] -= fx
    own.left[i, 1] -= fy
    own.left[i, 2] -= sense * force[j, 2] + arm[0] * fy - arm[1] * fx
    s = own.stiffness
    rows = _turning(s, j, 0, arm), _turning(s, j, 1, arm), _turning(s, j, 2, arm)
    _add(own.block, i, size, rows, arm)
    _add(coupling, j, -size, rows, other)


@inlined
def _add_joint(j, runs, step, b):
    """Add what joint j bears in the step, and its stiffness, to the system."""
    work = runs.work
    own = runs.own
    nx, ny = normal_of(j, work)
    press = step * own.force[j, 0]
    rub = step * own.force[j, 2]
    work.reaction[j, 0] = press * nx - rub * ny
    work.reaction[j, 1] = press * ny + rub * nx
    work.reaction[j, 2] = -(step * own.force[j, 1])
    for a in range(3):
        for c in range(3):
            own.upper[j, a, c] = own.lower[j, a, c] = 0.0
    _add_side(j, 1, 1.0, runs, step * b, own.upper)
    _add_side(j, 0, -1.0, runs, step * b, own.lower)


@kernel
def balance(runs, step, b):
    """Set up the balance of momentum at the velocities in ``work.solved``.

    Return two sums over the bodies: of the squares of impulses that are not balanced, over masses,
    and the slope of the energy along ``own.change``.
    """
    model = runs.model
    work = runs.work
    own = runs.own
    for i in range(work.solved.shape[0]):
        for a in range(3):
            mass = model.inertia[i] if a == 2 else model.mass[i]
            own.left[i, a] = mass * (work.solved[i, a] - work.free[i, a])
            for c in range(3):
                own.block[i, a, c] = mass if a == c else 0.0
    for j in range(work.slide.size):
        _set_stiffness(j, runs, step, b)
        _add_joint(j, runs, step, b)
    square = slope = 0.0 * step
    for i in range(1, end_of(model, work.solved)):
        left = three(own.left, i)
        x, y, z = left
        square += model.inverse_mass[i] * (x * x + y * y) + model.inverse_inertia[i] * (
            z * z
        )
        slope -= dot(left, three(own.change, i))
    return square, slope


@inlined
def three(of, i):
    """Return row `i` of an array: three numbers."""
    return of[i, 0], of[i, 1], of[i, 2]


@inlined
def _row(of, i, a):
    return of[i, a, 0], of[i, a, 1], of[i, a, 2]


@inlined
def _less(of, i, block, j, known):
    """Return row `i` of an array less block `j` times `known`, the solution at a neighbour."""
    x = of[i, 0] - dot(_row(block, j, 0), known)
    y = of[i, 1] - dot(_row(block, j, 1), known)
    return x, y, of[i, 2] - dot(_row(block, j, 2), known)


@kernel
def newton_step(model, own, where):
    """Solve the system for ``own.change`` of all bodies, where `where` holds.

    Return the slope of the energy along it. Each body is eliminated from the one that
    ``model.ahead`` names, so that piers come before the spine.

    Reads: model.ahead, own (block, change, forward, left, lower, upper).
    Writes: own (block, change, forward, upper).
    """
    end = end_of(model, own.block)
    block = own.block
    upper = own.upper
    forward = own.forward
    for i in range(1, end):
        for c in range(3):
            forward[i, c] = own.left[i, c]
    for i in range(1, end):
        factorise_block(block, i)
        f = block_of(block, i)
        known = solve_block(f, forward[i, 0], forward[i, 1], forward[i, 2])
        forward[i, 0], forward[i, 1], forward[i, 2] = known
        j, k = ahead_of(model, i)
        if k < end:
            for c in range(3):
                solved = solve_block(f, upper[j, 0, c], upper[j, 1, c], upper[j, 2, c])
                upper[j, 0, c], upper[j, 1, c], upper[j, 2, c] = solved
                for a in range(3):
                    block[k, a, c] -= dot(_row(own.lower, j, a), solved)
            x, y, z = _less(forward, k, own.lower, j, known)
            forward[k, 0], forward[k, 1], forward[k, 2] = x, y, z
    slope = 0.0 * forward[1, 0]
    for i in range(end - 1, 0, -1):
        j, k = ahead_of(model, i)
        if k < end:
            known = _less(forward, i, upper, j, three(forward, k))
            forward[i, 0], forward[i, 1], forward[i, 2] = known
        x, y, z = three(forward, i)
        own.change[i, 0] = select(where, x, own.change[i, 0])
        own.change[i, 1] = select(where, y, own.change[i, 1])
        own.change[i, 2] = select(where, z, own.change[i, 2])
        slope -= dot((x, y, z), three(own.left, i))
    return slope


@kernel
def find_velocities(runs, step, b, balanced, live):
    """Find the velocities after a step, ``work.solved``, and the impulses, ``work.reaction``.

    What has overlapped before is asked a time `b` [s] after the middle of the step. Accelerations
    are balanced to within `balanced`, over gravity. Velocities are those that the impulses give to
    the bodies, so that momentum is balanced to rounding. Return the mask of the runs that are
    solved, and their iterations.
    """
    model = runs.model
    state = runs.state
    work = runs.work
    own = runs.own
    end = end_of(model, work.solved)
    mass = 0.0
    for i in range(1, end):
        mass += model.mass[i]
        for c in range(3):
            work.solved[i, c] = own.base[i, c] = state.velocity[i, c]
            own.change[i, c] = 0.0 * step
    copy_rows(work.free, work.solved, end, work.solved.shape[0])
    enough = balanced * model.gravity * step
    enough = enough * enough * mass
    active = live
    before = iterations = low = at_low = at_high = 0.0 * step
    part = high = 1.0 + before
    while True:
        square, slope = balance(runs, step, b)
        active = active & opposite(square <= enough)
        if not some(active & (iterations < MOST_ITERATIONS)):
            break
        # Where the energy rises again too soon, its slope vanishes between `low` and `high`.
        turned = select(part < 1.0, abs(slope), slope) > -TURNED * before
        back = active & turned & (high - low > SHORTEST)
        over = slope > 0.0
        high = select(over, part, high)
        at_high = select(over, slope, at_high)
        low = select(over, low, part)
        at_low = select(over, at_low, slope)
        ahead = active & opposite(back)
        if some(ahead):
            found = newton_step(model, own, ahead)
            before = select(ahead, found, before)
        cut = smaller(larger(at_low / (at_low - at_high), LEAST), 1.0 - LEAST)
        part = select(back, low + cut * (high - low), 1.0)
        low = select(ahead, 0.0, low)
        high = select(ahead, 1.0, high)
        at_low = select(ahead, before, at_low)
        at_high = select(ahead, 0.0, at_high)
        for i in range(1, end):
            for c in range(3):
                own.base[i, c] = select(ahead, work.solved[i, c], own.base[i, c])
                moved = own.base[i, c] - part * own.change[i, c]
                work.solved[i, c] = select(active, moved, work.solved[i, c])
        iterations += flag(active)
    for i in range(1, end):
        work.solved[i, 0] -= model.inverse_mass[i] * own.left[i, 0]
        work.solved[i, 1] -= model.inverse_mass[i] * own.left[i, 1]
        work.solved[i, 2] -= model.inverse_inertia[i] * own.left[i, 2]
    return live & opposite(active), iterations
