"""Rest range of a chain: the largest steady horizontal body force that it bears at rest.

Rest is the contact problem with w = 0: reactions in equilibrium with the body forces, pressing at
every joint and inside Coulomb's cone. In a chain all reactions follow from those at joint 0, so
that the unknowns are its force, its moment and the load factor k: four numbers. The largest k is
found by the dual simplex method on the joints' inequalities, whose cost is proportional to their
number (static theorem; Livesley 1978, *Int. J. Num. Meth. Eng.* 12(12)). That is Eq 13 for a
block, and the least load of Eq 28 for an arch, by its dual. The inequalities that are tight at
the end with a positive multiplier are the hinges and sliding joints of the mechanism.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating

FEASIBLE = 1e-12
BOX = 1e5
NO_LIMIT = 1e3
N_UNKNOWN = 4
HINGE_INTRADOS = 1
HINGE_EXTRADOS = 2
SLIDING = 4


class RestLimit(NamedTuple):
    """One end of the range of rest."""

    found: bool  # False: no admissible reactions for any load factor
    load_factor: float  # signed largest k in the direction asked for [g]; inf: no limit
    mechanism: np.ndarray  # (n_joint,) int8: bits HINGE_INTRADOS, HINGE_EXTRADOS, SLIDING
    reaction: np.ndarray  # (n_joint, 3) on the body after each joint, about the origin, at k
    iterations: int


@allocating
def _add_pull(constant, pull, centroid, weight, size, sense):
    """Add a force on a body, or its opposite, to the resultants of a joint."""
    constant[0] += sense * pull[0] / weight
    constant[1] += sense * pull[1] / weight
    moment = pull[2] + centroid[0] * pull[1] - centroid[1] * pull[0]
    constant[2] += sense * moment / (weight * size)


@allocating
def resultants(mass, centroid, n_joint, gravity, weight, size, pull):
    """Force and moment about the origin at each joint, (n_joint, 3, 5): x, y, moment.

    Columns: by the force and the moment at joint 0 (of a chain with a free end not used), by the
    load factor, constant. Forces are over the weight, moments over weight times size. `pull`
    (n_body, 3) has the forces of ties and their moments about the centroids.
    """
    part = np.zeros((n_joint, 3, 5))
    if n_joint == mass.size:
        for i in range(mass.size):
            w = mass[i] * gravity / weight
            part[0, 0, 3] += w
            part[0, 1, 4] += w
            part[0, 2, 3] -= w * centroid[i, 1] / size
            part[0, 2, 4] += w * centroid[i, 0] / size
            _add_pull(part[0, :, 4], pull[i], centroid[i], weight, size, -1.0)
    else:
        part[0, 0, 0] = part[0, 1, 1] = part[0, 2, 2] = 1.0
    for j in range(1, n_joint):
        w = mass[j - 1] * gravity / weight
        part[j] = part[j - 1]
        part[j, 0, 3] -= w
        part[j, 1, 4] -= w
        part[j, 2, 3] += w * centroid[j - 1, 1] / size
        part[j, 2, 4] -= w * centroid[j - 1, 0] / size
        _add_pull(part[j, :, 4], pull[j - 1], centroid[j - 1], weight, size, 1.0)
    return part


@allocating
def joint_inequalities(part, point, normal, candidate, friction):
    """Inequalities ``a x <= b`` of rest; joint and bit of a mechanism of each.

    `part` is that of `resultants`, `point` over its size.
    """
    n_joint = part.shape[0]
    a, b = np.zeros((8 * n_joint, N_UNKNOWN)), np.zeros(8 * n_joint)
    joint, kind = np.zeros(8 * n_joint, np.int64), np.zeros(8 * n_joint, np.int8)
    count = 0
    for j in range(n_joint):
        nx, ny = normal[j, 0], normal[j, 1]
        x0, y0, x1, y1 = point[j, 0, 0], point[j, 0, 1], point[j, 1, 0], point[j, 1, 1]
        length = (y1 - y0) * nx - (x1 - x0) * ny
        fx, fy, moment = part[j, 0], part[j, 1], part[j, 2]
        row_0 = (moment - (x1 * fy - y1 * fx)) / length
        row_1 = -(moment - (x0 * fy - y0 * fx)) / length
        for c in range(2):
            row = row_0 if c == 0 else row_1
            for sense in (-1.0, 1.0):
                if sense < 0.0 or not candidate[j, c]:
                    a[count], b[count] = sense * row[:4], -sense * row[4]
                    joint[count], kind[count] = j, HINGE_EXTRADOS if c == 0 else HINGE_INTRADOS
                    count += 1
        if not np.isinf(friction[j]):
            for sense in (-1.0, 1.0):
                row = sense * (nx * fy - ny * fx) - friction[j] * (row_0 + row_1)
                a[count], b[count] = row[:4], -row[4]
                joint[count], kind[count] = j, SLIDING
                count += 1
    for q in range(count):
        norm = np.abs(a[q]).max()
        if norm > 0.0:
            a[q] /= norm
            b[q] /= norm
    return a[:count], b[:count], joint[:count], kind[:count]


@allocating
def largest_load_factor(a, b, sense):
    """Dual simplex: maximise ``sense * x[3]`` subject to ``a x <= b`` in four unknowns.

    Returned: whether it is feasible, x, the rows that are tight (beyond those of `a`, sides of the
    bounding box), their multipliers, iterations.
    """
    n_row = b.size
    active = n_row + np.arange(N_UNKNOWN)
    basis, inverse = np.eye(N_UNKNOWN), np.eye(N_UNKNOWN)
    basis[3, 3] = inverse[3, 3] = sense
    level = np.full(N_UNKNOWN, BOX)
    x, multiplier, weights = np.empty(N_UNKNOWN), np.empty(N_UNKNOWN), np.empty(N_UNKNOWN)
    for k in range(N_UNKNOWN):
        if np.all(a[:, k] == 0.0):
            level[k] = 0.0
    for iteration in range(50 + 20 * N_UNKNOWN + n_row):
        _vertex(basis, inverse, level, x)
        for k in range(N_UNKNOWN):
            multiplier[k] = sense * inverse[3, k]
        entering, worst = -1, FEASIBLE * max(1.0, np.abs(x).max())
        for q in range(n_row):
            violation = a[q, 0] * x[0] + a[q, 1] * x[1] + a[q, 2] * x[2] + a[q, 3] * x[3] - b[q]
            if violation > worst:
                worst, entering = violation, q
        if entering < 0:
            return True, x, active, multiplier, iteration
        for k in range(N_UNKNOWN):
            weights[k] = 0.0
            for i in range(N_UNKNOWN):
                weights[k] += a[entering, i] * inverse[i, k]
        leaving, best, size = -1, np.inf, 0.0
        for k in range(N_UNKNOWN):
            if weights[k] > 1e-11:
                ratio = max(multiplier[k], 0.0) / weights[k]
                if ratio < best - 1e-13 or (ratio <= best + 1e-13 and weights[k] > size):
                    best, leaving, size = min(ratio, best), k, weights[k]
        if leaving < 0:
            return False, x, active, multiplier, iteration
        active[leaving], level[leaving] = entering, b[entering]
        for i in range(N_UNKNOWN):
            basis[leaving, i] = a[entering, i]
            inverse[i, leaving] /= weights[leaving]
            for k in range(N_UNKNOWN):
                if k != leaving:
                    inverse[i, k] -= weights[k] * inverse[i, leaving]
    return False, x, active, multiplier, -1


@allocating
def _vertex(basis, inverse, level, x):
    """Return the point where the active inequalities are tight, refined once."""
    left = level.copy()
    for i in range(N_UNKNOWN):
        x[i] = 0.0
    for _ in range(2):
        for i in range(N_UNKNOWN):
            for k in range(N_UNKNOWN):
                x[i] += inverse[i, k] * left[k]
        for k in range(N_UNKNOWN):
            left[k] = level[k]
            for i in range(N_UNKNOWN):
                left[k] -= basis[k, i] * x[i]


@allocating
def rest_limit(mass, centroid, point, normal, candidate, friction, gravity, sense, pull):
    """One end of the range of rest of a chain in a given configuration.

    A candidate of 0 is an open corner, which bears nothing. `sense` is 1 for a ground that
    accelerates towards +x (body force towards -x), -1 for the other way. `pull` is that of
    `resultants`.
    """
    n_joint, weight, size = point.shape[0], 0.0, np.abs(point).max()
    for i in range(mass.size):
        weight += mass[i] * gravity
    part = resultants(mass, centroid, n_joint, gravity, weight, size, pull)
    a, b, joint, kind = joint_inequalities(part, point / size, normal, candidate, friction)
    if n_joint == mass.size:
        a[:, :3] = 0.0
    mechanism = np.zeros(n_joint, np.int8)
    reaction = np.zeros((n_joint, 3))
    found, x, active, multiplier, iterations = largest_load_factor(a, b, sense)
    for i in range(N_UNKNOWN):
        if found and active[i] < b.size and multiplier[i] > 1e-9:
            mechanism[joint[active[i]]] |= kind[active[i]]
    for j in range(n_joint):
        for c in range(3):
            total = part[j, c, 4]
            for k in range(N_UNKNOWN):
                total += part[j, c, k] * x[k]
            reaction[j, c] = total * (weight * size if c == 2 else weight)
    load_factor = np.inf * sense if abs(x[3]) > NO_LIMIT else x[3]
    return RestLimit(found, load_factor, mechanism, reaction, iterations)
