"""Solve the contact problem for given modes by one block sweep over the joints.

A closed joint has three rows: its normal at both corners, and its tangent at the pivot where it
sticks. A joint that touches at one corner has the normal there, and the tangent where it sticks.
What a joint does not have is a row of zeros with a one on the diagonal, so that all blocks are
3 x 3 and only neighbours couple: a block-tridiagonal problem, eliminated from the first joint to
the last and substituted back. The bed below a top course couples with the springings of both
rings, which couple already, so that its elimination makes no new block.

The three reactions of a closed joint are not unique in an arch that is closed everywhere. The
relative `Precision.compliance` of each row picks those of joints that are equal springs in the
limit of infinite stiffness.
"""

from typing import NamedTuple

from archfrag.physics.contact.laws import contact_of, touching
from archfrag.physics.contact.placing import relative_velocity
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import fused, opposite, select, some
from archfrag.physics.neighbours import bed_of, follows, is_behind_fork, row_of
from archfrag.physics.numbers import choose, copy_rows, dot, larger

MOST_CORRECTIONS = 6


class Precision(NamedTuple):
    """How closely a contact problem is solved."""

    compliance: float  # of each row, relative
    # largest violation of a law that counts as none, over the scale of velocities or forces
    slack: float
    # largest velocity along constrained directions that counts as none, over its scale
    left: float


# Precision of time steps, and of what has to hold to the last digits that rounding leaves.
FOR_STEPS = Precision(1e-10, 1e-9, 1e-9)
EXACT = Precision(1e-10, 1e-11, 1e-11)


@inlined
def _set_row(out, j, k, at, along, about):
    """Set direction `k` of joint `j` in `out`: `along`, (x, y), at the point `at`.

    Its lever arms are about the centroids `about` of the bodies after and before the joint.
    """
    px, py = at
    dx, dy = along
    ax, ay, bx, by = about
    out[j, k, 0] = dx
    out[j, k, 1] = dy
    out[j, k, 2] = (px - ax) * dy - (py - ay) * dx
    out[j, k, 3] = (px - bx) * dy - (py - by) * dx


@inlined
def _set_rows_of(j, model, position, work):
    """Set the constrained and reaction directions of one joint in its present mode."""
    slide = work.slide[j]
    at_0, at_1 = touching(j, work)
    sticks = slide == 0.0
    closed = at_0 & at_1
    nx, ny, px, py = contact_of(j, work)
    nx, ny = choose(opposite(at_0 | at_1), (0.0, 0.0), (nx, ny))
    # Friction on the cone (Eqs 6, 20); a rough joint's reaction lies in the tangent.
    along = slide * model.ray[j, 1]
    pressing = select(sticks, 1.0, model.ray[j, 0])
    fx = pressing * nx - along * ny
    fy = pressing * ny + along * nx
    i = row_of(model, j, 0)
    k = row_of(model, j, 1)
    about = position[k, 0], position[k, 1], position[i, 0], position[i, 1]
    _set_row(work.row, j, 0, (px, py), (nx, ny), about)
    _set_row(work.column, j, 0, (px, py), (fx, fy), about)
    # The normal at corner 1 of a closed joint, or the tangent at a corner that sticks.
    tangent = sticks & opposite(closed)
    has = select(closed | tangent, 1.0, 0.0)
    at = choose(closed, (work.point[j, 1, 0], work.point[j, 1, 1]), (px, py))
    direction = choose(tangent, (-ny, nx), (has * nx, has * ny))
    _set_row(work.row, j, 1, at, direction, about)
    direction = choose(tangent, (-ny, nx), (has * fx, has * fy))
    _set_row(work.column, j, 1, at, direction, about)
    has = select(closed & sticks, 1.0, 0.0)
    at = work.pivot[j, 0], work.pivot[j, 1]
    direction = -has * ny, has * nx
    _set_row(work.row, j, 2, at, direction, about)
    _set_row(work.column, j, 2, at, direction, about)


@kernel
def set_rows(model, position, work):
    """Set the constrained and reaction directions of all joints in their present modes.

    Writes: work (column, row).
    """
    for j in range(work.slide.shape[0]):
        _set_rows_of(j, model, position, work)


@inlined
def solve_block(f, x, y, z):
    """Solve a factorised 3 x 3 block for the right side x, y, z; return the solution.

    `f` has nine numbers by rows, with reciprocals on the diagonal.
    """
    y = fused(-f[3], x, y)
    z = fused(-f[7], y, fused(-f[6], x, z)) * f[8]
    y = fused(-f[5], z, y) * f[4]
    x = fused(-f[2], z, fused(-f[1], y, x)) * f[0]
    return x, y, z


@inlined
def _along(a, j, k):
    return a[j, k, 0], a[j, k, 1], a[j, k, 2]


@inlined
def _down(a, j, k):
    return a[j, 0, k], a[j, 1, k], a[j, 2, k]


@inlined
def block_of(f, j):
    """Return block `j` of `f` as nine numbers, by rows."""
    return _along(f, j, 0) + _along(f, j, 1) + _along(f, j, 2)


@inlined
def _weighted(row, j, a, mass, inertia, arm):
    """Return the velocity that a unit impulse along row `a` of joint `j` gives to a body.

    `mass` and `inertia` are the body's inverse ones, or their opposites. `arm` is 2 for the body
    after the joint, 3 for the one before.
    """
    return mass * row[j, a, 0], mass * row[j, a, 1], inertia * row[j, a, arm]


@inlined
def _on(column, j, a, arm):
    return column[j, a, 0], column[j, a, 1], column[j, a, arm]


@inlined
def _set_diagonal(model, work, j, compliance):
    """Set the diagonal block of joint `j`: the effect of its reactions on both its bodies."""
    row = work.row
    column = work.column
    f = work.block
    i = row_of(model, j, 0)
    k = row_of(model, j, 1)
    both = model.inverse_mass[k] + model.inverse_mass[i]
    after = model.inverse_inertia[k]
    before = model.inverse_inertia[i]
    for a in range(3):
        moved = _weighted(row, j, a, both, after, 2)
        rotated = before * row[j, a, 3]
        for b in range(3):
            f[j, a, b] = fused(
                rotated, column[j, b, 3], dot(moved, _on(column, j, b, 2))
            )
        own = f[j, a, a]
        f[j, a, a] = select(own == 0.0, 1.0, fused(compliance, abs(own), own))


@inlined
def _of_fork(work, j, k, a):
    """Return row `a` of the coupling of joint `j` with the bed (`k` 0), or the eliminated (1)."""
    return work.fork[j, k, a, 0], work.fork[j, k, a, 1], work.fork[j, k, a, 2]


@inlined
def _by_bed(work, j, b):
    """Return column `b` of the eliminated coupling of the bed with joint `j`."""
    return work.fork[j, 1, 0, b], work.fork[j, 1, 1, b], work.fork[j, 1, 2, b]


@inlined
def _less_by_bed(work, j, b, of):
    """Return column `b` of the coupling of joint ``j - 1`` with joint `j`, less the bed's part."""
    known = _by_bed(work, j, b)
    x = of[0] - dot(_of_fork(work, j - 1, 0, 0), known)
    y = of[1] - dot(_of_fork(work, j - 1, 0, 1), known)
    return x, y, of[2] - dot(_of_fork(work, j - 1, 0, 2), known)


@inlined
def _eliminate_bed(model, work, j):
    """Eliminate the bed below a top course from the block of joint `j` at that course."""
    row = work.row
    column = work.column
    f = work.block
    bed = bed_of(model, j)
    top = row_of(model, bed, 1)
    # The course lies after the bed, and after or before the joint.
    arm = 2 if row_of(model, j, 1) == top else 3
    sense = 1.0 if arm == 2 else -1.0
    mass = sense * model.inverse_mass[top]
    inertia = sense * model.inverse_inertia[top]
    block = block_of(f, bed)
    first = _weighted(row, bed, 0, mass, inertia, 2)
    second = _weighted(row, bed, 1, mass, inertia, 2)
    third = _weighted(row, bed, 2, mass, inertia, 2)
    for b in range(3):
        to = _on(column, j, b, arm)
        x, y, z = solve_block(block, dot(first, to), dot(second, to), dot(third, to))
        work.fork[j, 1, 0, b] = x
        work.fork[j, 1, 1, b] = y
        work.fork[j, 1, 2, b] = z
    for a in range(3):
        moved = _weighted(row, j, a, mass, inertia, arm)
        for b in range(3):
            work.fork[j, 0, a, b] = dot(moved, _on(column, bed, b, 2))
        for b in range(3):
            f[j, a, b] -= dot(_of_fork(work, j, 0, a), _by_bed(work, j, b))


@inlined
def _eliminate(model, work, j):
    """Eliminate joint ``j - 1`` from the block of joint `j`."""
    i = row_of(model, j, 0)
    forked = is_behind_fork(model, j)
    row = work.row
    column = work.column
    f = work.block
    lower = work.lower
    upper = work.upper
    mass = -model.inverse_mass[i]
    inertia = -model.inverse_inertia[i]
    block = block_of(f, j - 1)
    first = _weighted(row, j - 1, 0, mass, inertia, 2)
    second = _weighted(row, j - 1, 1, mass, inertia, 2)
    third = _weighted(row, j - 1, 2, mass, inertia, 2)
    for b in range(3):
        to = _on(column, j, b, 3)
        x = dot(first, to)
        y = dot(second, to)
        z = dot(third, to)
        if forked:
            x, y, z = _less_by_bed(work, j, b, (x, y, z))
        x, y, z = solve_block(block, x, y, z)
        upper[j - 1, 0, b] = x
        upper[j - 1, 1, b] = y
        upper[j - 1, 2, b] = z
    for a in range(3):
        moved = _weighted(row, j, a, mass, inertia, 3)
        x = dot(moved, _on(column, j - 1, 0, 2))
        y = dot(moved, _on(column, j - 1, 1, 2))
        z = dot(moved, _on(column, j - 1, 2, 2))
        if forked:
            x -= dot(_of_fork(work, j, 0, a), _by_bed(work, j - 1, 0))
            y -= dot(_of_fork(work, j, 0, a), _by_bed(work, j - 1, 1))
            z -= dot(_of_fork(work, j, 0, a), _by_bed(work, j - 1, 2))
        lower[j, a, 0] = x
        lower[j, a, 1] = y
        lower[j, a, 2] = z
        for b in range(3):
            f[j, a, b] -= dot((x, y, z), _down(upper, j - 1, b))


@inlined
def factorise_block(f, j):
    """Factorise block `j` of `f` into triangles, with reciprocals on the diagonal."""
    a, b, c, d, e, g, h, i, k = block_of(f, j)
    a = 1.0 / a
    d = d * a
    h = h * a
    e = 1.0 / fused(-d, b, e)
    g = fused(-d, c, g)
    i = fused(-h, b, i) * e
    k = 1.0 / fused(-i, g, fused(-h, c, k))
    f[j, 0, 0] = a
    f[j, 1, 0] = d
    f[j, 1, 1] = e
    f[j, 1, 2] = g
    f[j, 2, 0] = h
    f[j, 2, 1] = i
    f[j, 2, 2] = k


@inlined
def _factorise_joint(j, model, work, compliance):
    _set_diagonal(model, work, j, compliance)
    if bed_of(model, j) >= 0:
        _eliminate_bed(model, work, j)
    if follows(model, j):
        _eliminate(model, work, j)
    factorise_block(work.block, j)


@kernel
def factorise(model, work, compliance):
    """Factorise the system whose rows and columns are set, block by block.

    Writes: work (block, fork, lower, upper).
    """
    for j in range(work.slide.shape[0]):
        _factorise_joint(j, model, work, compliance)


@kernel
def set_up(model, position, work, compliance, first):
    """Set the directions of all joints from joint `first` on, and factorise their system.

    Both are done in one sweep.

    Writes: work (block, column, fork, lower, row, upper).
    """
    for j in range(first, work.slide.shape[0]):
        _set_rows_of(j, model, position, work)
        _factorise_joint(j, model, work, compliance)


@inlined
def _add_reaction(j, of, model, position, work):
    """Add the multipliers `of` of joint `j`, three numbers, to reaction and velocities."""
    column = work.column
    solved = work.solved
    reaction = work.reaction
    fx = dot(of, _down(column, j, 0))
    fy = dot(of, _down(column, j, 1))
    after = dot(of, _down(column, j, 2))
    before = dot(of, _down(column, j, 3))
    i = row_of(model, j, 0)
    k = row_of(model, j, 1)
    px = work.pivot[j, 0] - position[k, 0]
    py = work.pivot[j, 1] - position[k, 1]
    reaction[j, 0] += fx
    reaction[j, 1] += fy
    reaction[j, 2] += fused(py, fx, fused(-px, fy, after))
    solved[k, 0] = fused(model.inverse_mass[k], fx, solved[k, 0])
    solved[k, 1] = fused(model.inverse_mass[k], fy, solved[k, 1])
    solved[k, 2] = fused(model.inverse_inertia[k], after, solved[k, 2])
    solved[i, 0] = fused(-model.inverse_mass[i], fx, solved[i, 0])
    solved[i, 1] = fused(-model.inverse_mass[i], fy, solved[i, 1])
    solved[i, 2] = fused(-model.inverse_inertia[i], before, solved[i, 2])


@kernel
def add_reactions(model, position, work):
    """Add the multipliers of all joints to reactions, and their effect to velocities.

    The multipliers are in ``work.unknown``, three for each joint; velocities are in
    ``work.solved``.

    Writes: work (reaction, solved).
    """
    out = work.unknown
    for j in range(out.shape[0]):
        _add_reaction(j, (out[j, 0], out[j, 1], out[j, 2]), model, position, work)


@kernel
def substitute(model, position, work, where):
    """Solve for the multipliers that remove the residual; add them to reactions and velocities.

    They are added where `where` holds.

    Writes: work (reaction, solved, unknown).
    """
    f = work.block
    lower = work.lower
    upper = work.upper
    residual = work.residual
    out = work.unknown
    last = residual.shape[0] - 1
    x = y = z = 0.0
    for j in range(last + 1):  # no joint comes before the first: its `lower` is zero
        known = x, y, z
        x = -residual[j, 0] - dot(_along(lower, j, 0), known)
        y = -residual[j, 1] - dot(_along(lower, j, 1), known)
        z = -residual[j, 2] - dot(_along(lower, j, 2), known)
        bed = bed_of(model, j)
        if bed >= 0:
            known = out[bed, 0], out[bed, 1], out[bed, 2]
            x -= dot(_of_fork(work, j, 0, 0), known)
            y -= dot(_of_fork(work, j, 0, 1), known)
            z -= dot(_of_fork(work, j, 0, 2), known)
        x, y, z = solve_block(block_of(f, j), x, y, z)
        out[j, 0] = x
        out[j, 1] = y
        out[j, 2] = z
    for j in range(last, -1, -1):
        if j < last:
            known = x, y, z
            x = out[j, 0] - dot(_along(upper, j, 0), known)
            y = out[j, 1] - dot(_along(upper, j, 1), known)
            z = out[j, 2] - dot(_along(upper, j, 2), known)
        bed = bed_of(model, j)
        if bed >= 0:
            for c in range(3):
                out[bed, c] -= dot(_of_fork(work, j, 1, c), (x, y, z))
        of = select(where, x, 0.0), select(where, y, 0.0), select(where, z, 0.0)
        _add_reaction(j, of, model, position, work)


@kernel
def measure_residual(model, position, work):
    """Measure velocities of corners, and residuals along constrained directions.

    Return the largest residual, nan if anything has overflowed. ``work.relative``,
    ``work.corner_rate`` and ``work.residual`` are overwritten.

    Writes: work (corner_rate, relative, residual).
    """
    relative_velocity(model, position, work.solved, work.pivot, work.relative)
    row = work.row
    bias = work.bias
    residual = work.residual
    largest = spoiled = 0.0
    for j in range(residual.shape[0]):
        ux = work.relative[j, 0]
        uy = work.relative[j, 1]
        w = work.relative[j, 2]
        # The pivot lies halfway between the corners.
        px = work.point[j, 0, 0] - work.pivot[j, 0]
        py = work.point[j, 0, 1] - work.pivot[j, 1]
        x0 = fused(-w, py, ux) + bias[j, 0, 0]
        y0 = fused(w, px, uy) + bias[j, 0, 1]
        x1 = fused(w, py, ux) + bias[j, 1, 0]
        y1 = fused(-w, px, uy) + bias[j, 1, 1]
        work.corner_rate[j, 0, 0] = x0
        work.corner_rate[j, 0, 1] = y0
        work.corner_rate[j, 1, 0] = x1
        work.corner_rate[j, 1, 1] = y1
        at_0, at_1 = touching(j, work)
        vx, vy = choose(at_0 | opposite(at_1), (x0, y0), (x1, y1))
        a = fused(row[j, 0, 0], vx, row[j, 0, 1] * vy)
        vx, vy = choose(at_1, (x1, y1), (vx, vy))
        b = fused(row[j, 1, 0], vx, row[j, 1, 1] * vy)
        c = fused(row[j, 2, 0], 0.5 * (x0 + x1), row[j, 2, 1] * (0.5 * (y0 + y1)))
        residual[j, 0] = a
        residual[j, 1] = b
        residual[j, 2] = c
        largest = larger(largest, larger(abs(a), larger(abs(b), abs(c))))
        spoiled += 0.0 * (
            a + b + c
        )  # nan where anything has overflowed; comparisons lose it
    return largest + spoiled


@kernel
def correct(model, position, work, enough):
    """Solve the factorised problem, and refine it until the residual is below `enough`.

    Return the largest velocity left along a constrained direction; nan if a pivot vanishes.

    Writes: work (corner_rate, reaction, relative, residual, solved, unknown).
    """
    copy_rows(work.free, work.solved, 0, position.shape[0])
    work.reaction[:] = 0.0
    left = measure_residual(model, position, work)
    go = left == left
    # One substitution leaves what the compliance yields; where that counts it is corrected.
    for _ in range(MOST_CORRECTIONS):
        substitute(model, position, work, go)
        before = left
        left = measure_residual(model, position, work)
        go = go & (left > enough) & (left < before)
        if not some(go):
            break
    return left


@kernel
def solve_modes(model, position, work, scale, precision, first):
    """Solve for the motion of all bodies (Eqs 26, 27) in the present modes.

    Modes are those in ``work.contact`` and ``work.slide``, velocities without reactions those in
    ``work.free``; the largest relative one of these is `scale`. `solved`, `reaction`, `relative`
    and `corner_rate` are overwritten. The joints before `first` are set up already. Return what
    `correct` does.
    """
    set_up(model, position, work, precision.compliance, first)
    return correct(model, position, work, precision.left * scale)
