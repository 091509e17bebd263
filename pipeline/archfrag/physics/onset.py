"""Rest range of a chain: the largest steady horizontal body force that it bears at rest.

Rest is the contact problem with w = 0: reactions in equilibrium with the body forces, pressing at
every joint and inside Coulomb's cone. In a chain all reactions follow from the one at joint 0, in
a bridge from those at the left base and at the base of each inner pier. The unknowns are therefore
the two components of each of these forces, their moments, and the load factor k.
The dual simplex method on the joints' inequalities finds the largest k, at a cost in proportion to
their number (static theorem; Livesley 1978, *Int. J. Num. Meth. Eng.* 12(12)). For a block this is
Eq 13; for an arch it is the least load of Eq 28, found by its dual. The inequalities that are
tight at the end with a positive multiplier are the hinges and sliding joints of the mechanism.
"""

from typing import NamedTuple

import numpy as np

from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.neighbours import bed_of, follows, is_behind_fork, row_of
from archfrag.physics.state import Model, Work

FEASIBLE = 1e-12
BOX = 1e5
NO_LIMIT = 1e3
# A basis of the simplex is left by an inequality whose weight is more than LEAST. If the simplex
# fails it begins anew with costs TILT of all unknowns, LEAST_TILTED, and an inverse that is made
# anew after INVERTED exchanges.
LEAST = 1e-11
TILT = 1e-10
LEAST_TILTED = 1e-9
INVERTED = 3
HINGE_INTRADOS = 1
HINGE_EXTRADOS = 2
SLIDING = 4


class RestLimit(NamedTuple):
    """One end of the range of load factors in which a chain rests; see `rest_limit`."""

    found: bool  # False: no admissible reactions for any load factor
    # signed largest k in the direction asked for [g]; ±inf: no limit
    load_factor: float
    mechanism: (
        np.ndarray
    )  # (n_joint,) int8: bits HINGE_INTRADOS, HINGE_EXTRADOS, SLIDING
    # (n_joint, 3) on the body after each joint, at that load factor: force x, y [N] and moment
    # about the origin [N m]
    reaction: np.ndarray


OF_REST = {
    "centroid": (2,),
    "pull": (3,),
    "candidate": (2,),
    "reaction": (3,),
}


@struct(**OF_REST)
class RestProblem(NamedTuple):
    """Workspace of `find_rest_limit`."""

    centroid: np.ndarray  # (n_body + 2, 2) in the configuration [m]
    pull: (
        np.ndarray
    )  # (n_body + 2, 3) forces of ties [N] and moments about the centroids [N m]
    candidate: (
        np.ndarray
    )  # (n_joint, 2) int8: zero where a corner is open, which bears nothing
    # (n_joint, 3, n + 1) resultant at each joint. Rows: force x, force y, moment about the origin.
    # Columns: coefficients of the n unknowns, that is of force x, force y and moment at each base
    # but the last (not used in a chain with a free end) and of the load factor, constant part.
    part: np.ndarray
    # (3, n + 1) of one joint, columns as in `part`: normal force at corner 0, normal force at
    # corner 1, friction less Coulomb's limit
    row: np.ndarray
    bound: (
        np.ndarray
    )  # (8 n_joint, n) left sides of the inequalities ``bound x <= level`` of rest
    level: np.ndarray  # (8 n_joint,)
    joint: np.ndarray  # (8 n_joint,) int64: joint of each inequality
    kind: np.ndarray  # (8 n_joint,) int8: bit of each inequality in `mechanism`
    # (n,) int64: inequalities that are tight; numbers beyond the last are sides of the box, `BOX`
    active: np.ndarray
    basis: np.ndarray  # (n, n) left sides of the tight inequalities
    inverse: np.ndarray  # (n, n) of `basis`
    spare: np.ndarray  # (n, 2 n)
    # (5, n) in rows: LEVEL of the tight inequalities, UNKNOWN, MULTIPLIER, WEIGHT of each tight
    # inequality in the one that enters, LEFT after the last refinement
    vertex: np.ndarray
    mechanism: np.ndarray  # (n_joint,) int8, as in `RestLimit`
    reaction: np.ndarray  # (n_joint, 3)


LEVEL, UNKNOWN, MULTIPLIER, WEIGHT, LEFT = range(5)


def new_rest_problem(model: Model) -> RestProblem:
    """Allocate the workspace for a chain's range of rest."""
    n_joint = model.friction.size
    n_row = model.mass.size
    n = 3 * (n_row - model.end) + 1
    shapes = OF_REST | {"part": (3, n + 1), "row": (n + 1,), "spare": (2 * n,)}
    shapes |= dict.fromkeys(("bound", "basis", "inverse", "vertex"), (n,))
    first = {"centroid": n_row, "pull": n_row, "row": 3}
    first |= {"vertex": 5, "active": n, "basis": n, "inverse": n, "spare": n}
    first |= dict.fromkeys(("bound", "level", "joint", "kind"), 8 * n_joint)
    kinds: dict[str, type] = {"joint": np.int64, "active": np.int64}
    kinds |= dict.fromkeys(("candidate", "kind", "mechanism"), np.int8)
    problem = RestProblem(
        *(
            np.zeros((first.get(name, n_joint), *shapes.get(name, ())), kinds.get(name))
            for name in RestProblem._fields
        )
    )
    problem.candidate[:] = 1
    return problem


@kernel
def _add_body(model, problem, j, i, weight, size, sense):
    """Add `sense` times what balances body `i` to the resultants of joint `j`.

    Its loads are the weight, the horizontal body force and the pull of ties; `sense` is 1 or -1.
    Forces are divided by `weight` [N], moments by `weight` times `size` [N m].

    Reads: model (gravity, mass), problem (centroid, part, pull).
    Writes: problem.part.
    """
    part = problem.part[j]
    load = part.shape[1] - 2
    x = problem.centroid[i, 0]
    y = problem.centroid[i, 1]
    pull = problem.pull[i]
    w = model.mass[i] * model.gravity / weight
    part[0, load] += sense * w
    part[1, -1] += sense * w
    part[2, load] -= sense * (w * y / size)
    part[2, -1] += sense * (w * x / size)
    # Resultants balance the loads: weight and body force act towards -y and -x, a pull along its
    # own components.
    part[0, -1] -= sense * pull[0] / weight
    part[1, -1] -= sense * pull[1] / weight
    moment = pull[2] + x * pull[1] - y * pull[0]
    part[2, -1] -= sense * moment / (weight * size)


@kernel
def set_resultants(model, problem, weight, size):
    """Set the resultants of all joints, ``problem.part``.

    Forces are divided by `weight` [N], moments by `weight` times `size` [N m].

    Reads: model (bed, body, end, gravity, mass), problem (centroid, part, pull).
    Writes: problem.part.
    """
    part = problem.part
    first = 0
    for j in range(part.shape[0]):
        part[j] = 0.0
        if follows(model, j):
            forked = is_behind_fork(model, j)
            for c in range(3):
                for k in range(part.shape[2]):
                    part[j, c, k] = part[j - 1, c, k]
                    if forked:
                        part[j, c, k] += part[bed_of(model, j), c, k]
            _add_body(model, problem, j, row_of(model, j, 0), weight, size, -1.0)
        elif part.shape[0] == model.end - 1:
            for i in range(1, model.end):
                _add_body(model, problem, 0, i, weight, size, 1.0)
        else:
            for c in range(3):
                part[j, c, first + c] = 1.0
            first += 3


@kernel
def _add_inequality(problem, count, k, sense, joint, kind):
    """Append an inequality: `sense` times row `k` of ``problem.row`` is at most zero.

    `count` is the number of inequalities before; the new number is returned. The inequality
    belongs to joint `joint`, and `kind` is its bit in a mechanism.

    Reads: problem.row.
    Writes: problem (bound, joint, kind, level).
    """
    n = problem.bound.shape[1]
    for i in range(n):
        problem.bound[count, i] = sense * problem.row[k, i]
    problem.level[count] = -sense * problem.row[k, n]
    problem.joint[count] = joint
    problem.kind[count] = kind
    return count + 1


@kernel
def set_inequalities(model, work, problem, size):
    """Set the inequalities of rest of all joints; return their number.

    No corner pulls, an open corner bears nothing, and friction stays within Coulomb's limit.
    Places of contacts are divided by `size` [m].

    Reads: model.friction, work (normal, point), problem (bound, candidate, part, row).
    Writes: problem (bound, joint, kind, level, row).
    """
    part = problem.part
    row = problem.row
    count = 0
    for j in range(part.shape[0]):
        nx = work.normal[j, 0]
        ny = work.normal[j, 1]
        point = work.point[j]
        x0 = point[0, 0] / size
        y0 = point[0, 1] / size
        x1 = point[1, 0] / size
        y1 = point[1, 1] / size
        length = (y1 - y0) * nx - (x1 - x0) * ny
        for k in range(part.shape[2]):
            fx = part[j, 0, k]
            fy = part[j, 1, k]
            moment = part[j, 2, k]
            row[0, k] = (moment - (x1 * fy - y1 * fx)) / length
            row[1, k] = -(moment - (x0 * fy - y0 * fx)) / length
        for c in range(2):
            kind = HINGE_EXTRADOS if c == 0 else HINGE_INTRADOS
            count = _add_inequality(problem, count, c, -1.0, j, kind)
            if problem.candidate[j, c] == 0:
                count = _add_inequality(problem, count, c, 1.0, j, kind)
        if not np.isinf(model.friction[j]):
            for sense in (-1.0, 1.0):
                for k in range(part.shape[2]):
                    along = sense * (nx * part[j, 1, k] - ny * part[j, 0, k])
                    row[2, k] = along - model.friction[j] * (row[0, k] + row[1, k])
                count = _add_inequality(problem, count, 2, 1.0, j, SLIDING)
    for q in range(count):
        norm = 0.0
        n = problem.bound.shape[1]
        for i in range(n):
            norm = max(norm, abs(problem.bound[q, i]))
        if norm > 0.0:
            for i in range(n):
                problem.bound[q, i] /= norm
            problem.level[q] /= norm
    return count


@kernel
def largest_load_factor(problem, n_row, sense, tilt):
    """Maximise `sense` times the last unknown subject to the inequalities, by the dual simplex.

    `n_row` is the number of inequalities. With a `tilt`, a small cost of every unknown, the
    simplex does not cycle where many multipliers vanish, as in bridges of many spans. The unknowns
    are left in ``problem.vertex[UNKNOWN]``. Return True if the inequalities can be met; False if
    they cannot, or if that takes too many iterations.

    Reads: problem (basis, bound, inverse, level, spare, vertex).
    Writes: problem (active, basis, inverse, spare, vertex).
    """
    bound = problem.bound
    level = problem.level
    basis = problem.basis
    inverse = problem.inverse
    vertex = problem.vertex
    n = bound.shape[1]
    least = LEAST_TILTED if tilt > 0.0 else LEAST
    for i in range(n):
        problem.active[i] = n_row + i
        vertex[LEVEL, i] = BOX
        for k in range(n):
            basis[i, k] = inverse[i, k] = 1.0 if i == k else 0.0
    basis[n - 1, n - 1] = inverse[n - 1, n - 1] = sense
    for k in range(n):
        unused = True
        for q in range(n_row):
            unused = unused and bound[q, k] == 0.0
        if unused:
            vertex[LEVEL, k] = 0.0
    for pivots in range(50 + 20 * n + n_row):
        _set_vertex(problem)
        largest = 0.0
        if tilt > 0.0 and pivots % INVERTED == 0:
            _invert(problem)
        for k in range(n):
            vertex[MULTIPLIER, k] = sense * inverse[n - 1, k]
            if tilt > 0.0:
                for i in range(n):
                    cost = tilt * (1.0 + i / n)
                    if i == n - 1:
                        cost *= sense
                    vertex[MULTIPLIER, k] += cost * inverse[i, k]
            largest = max(largest, abs(vertex[UNKNOWN, k]))
        entering = -1
        worst = FEASIBLE * max(1.0, largest)
        for q in range(n_row):
            violation = bound[q, 0] * vertex[UNKNOWN, 0]
            for k in range(1, n):
                violation += bound[q, k] * vertex[UNKNOWN, k]
            violation -= level[q]
            if violation > worst:
                worst = violation
                entering = q
        if entering < 0:
            for k in range(n):
                vertex[MULTIPLIER, k] = sense * inverse[n - 1, k]
            return True
        leaving = _leaving(problem, entering, least)
        if leaving < 0:
            return False
        problem.active[leaving] = entering
        vertex[LEVEL, leaving] = level[entering]
        for i in range(n):
            basis[leaving, i] = bound[entering, i]
            inverse[i, leaving] /= vertex[WEIGHT, leaving]
            for k in range(n):
                if k != leaving:
                    inverse[i, k] -= vertex[WEIGHT, k] * inverse[i, leaving]
    return False


@kernel
def _leaving(problem, entering, least):
    """Return the place in ``problem.active`` that inequality `entering` takes; -1: none.

    If it is -1 the inequalities contradict each other. Its weight is more than `least`.

    Reads: problem (bound, inverse, vertex).
    Writes: problem.vertex.
    """
    vertex = problem.vertex
    n = vertex.shape[1]
    vertex[WEIGHT] = 0.0
    for k in range(n):
        for i in range(n):
            vertex[WEIGHT, k] += problem.bound[entering, i] * problem.inverse[i, k]
    leaving = -1
    best = np.inf
    size = 0.0
    for k in range(n):
        weight = vertex[WEIGHT, k]
        if weight > least:
            ratio = max(vertex[MULTIPLIER, k], 0.0) / weight
            if ratio < best - 1e-13 or (ratio <= best + 1e-13 and weight > size):
                best = min(ratio, best)
                leaving = k
                size = weight
    return leaving


@kernel
def _invert(problem):
    """Set ``problem.inverse`` to the inverse of the basis, by Gauss and Jordan's elimination.

    Reads: problem (basis, spare).
    Writes: problem (inverse, spare).
    """
    both = problem.spare
    n = both.shape[0]
    for i in range(n):
        for k in range(n):
            both[i, k] = problem.basis[i, k]
            both[i, n + k] = 1.0 if i == k else 0.0
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(both[i, j]) > abs(both[pivot, j]):
                pivot = i
        size = 1.0 / both[pivot, j]
        for k in range(2 * n):
            above = both[j, k]
            both[j, k] = both[pivot, k] * size
            if pivot != j:
                both[pivot, k] = above
        for i in range(n):
            factor = both[i, j]
            if i != j and factor != 0.0:
                for k in range(2 * n):
                    both[i, k] -= factor * both[j, k]
    for i in range(n):
        for k in range(n):
            problem.inverse[i, k] = both[i, n + k]


@kernel
def _set_vertex(problem):
    """Set ``problem.vertex`` to the point at which the active inequalities are tight.

    It is refined once.

    Reads: problem (basis, inverse, vertex).
    Writes: problem.vertex.
    """
    vertex = problem.vertex
    basis = problem.basis
    inverse = problem.inverse
    n = vertex.shape[1]
    for i in range(n):
        vertex[LEFT, i] = vertex[LEVEL, i]
        vertex[UNKNOWN, i] = 0.0
    for _ in range(2):
        for i in range(n):
            for k in range(n):
                vertex[UNKNOWN, i] += inverse[i, k] * vertex[LEFT, k]
        for k in range(n):
            vertex[LEFT, k] = vertex[LEVEL, k]
            for i in range(n):
                vertex[LEFT, k] -= basis[k, i] * vertex[UNKNOWN, i]


@kernel
def find_rest_limit(model, work, problem, sense):
    """Find one end of the range of rest of a chain in a given configuration.

    Contacts are those of ``work.point`` and ``work.normal``; centroids, pulls and open corners are
    those of `problem`. `sense` is 1 for a ground that accelerates towards +x (body force towards
    -x), -1 for the other way. Return `found` and `load_factor` of `RestLimit`; its arrays are left
    in `problem`.
    """
    n_joint = problem.part.shape[0]
    size = 0.0
    weight = 0.0
    for j in range(n_joint):
        for c in range(2):
            size = max(size, abs(work.point[j, c, 0]), abs(work.point[j, c, 1]))
    for i in range(1, model.mass.shape[0] - 1):
        weight += model.mass[i] * model.gravity
    set_resultants(model, problem, weight, size)
    n_row = set_inequalities(model, work, problem, size)
    n = problem.bound.shape[1]
    found = largest_load_factor(problem, n_row, sense, 0.0)
    if not found:
        found = largest_load_factor(problem, n_row, sense, TILT)
    vertex = problem.vertex
    problem.mechanism[:] = 0
    for j in range(n_joint):
        for c in range(3):
            part = problem.part[j, c]
            total = part[n]
            for k in range(n):
                total += part[k] * vertex[UNKNOWN, k]
            problem.reaction[j, c] = total * (weight * size if c == 2 else weight)
    for i in range(n):
        row = problem.active[i]
        if found and row < n_row and vertex[MULTIPLIER, i] > 1e-9:
            problem.mechanism[problem.joint[row]] |= problem.kind[row]
    factor = vertex[UNKNOWN, n - 1]
    return found, np.inf * sense if abs(factor) > NO_LIMIT else factor


def rest_limit(
    model: Model, work: Work, problem: RestProblem, sense: float
) -> RestLimit:
    """Find one end of the range of rest, as `find_rest_limit`; return copies of the arrays."""
    found, factor = find_rest_limit(model, work, problem, sense)
    arrays = problem.mechanism.copy(), problem.reaction.copy()
    return RestLimit(found, factor, *arrays)
