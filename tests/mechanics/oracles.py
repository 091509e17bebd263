"""The contact laws and the balance of a chain by the paper's formulas, apart from the package.

Axes of a joint: normal n from the earlier body to the later one, tangent t = n rotated by +90
degrees, from corner 0 to corner 1. Reactions act on the later body.
"""

import numpy as np

from archbench.paper import block
from archbench.paper.arch import cross, full_motion, next_reaction, relative_velocity, rotated
from tests.mechanics.adapters import MINUS, PLUS, framed


def corner_rates(problem, velocity):
    """Relative velocity at both corners of all joints (Eq 22), with bias, (m, 2, 2)."""
    bodies = list(zip(framed(problem.centroid), framed(velocity)))
    pairs = zip(problem.point, bodies, bodies[1:])
    return np.array([relative_velocity(*pair) for pair in pairs]) + problem.bias


def balance_error(problem, solution):
    """Largest part of a reaction that does not follow from the one before it (Eq 35)."""
    p, following = problem, np.vstack([solution.wrench, np.zeros(3)])
    bodies = zip(p.mass, p.inertia, p.centroid, solution.velocity, p.free)
    left = [next_reaction(following[i], *body) - following[i + 1] for i, body in enumerate(bodies)]
    return np.abs(left).max() / (np.abs(solution.wrench).max() or 1.0)


def corner_forces(problem, wrench):
    """Normal forces at both corners and shear of each joint as if closed, (m, 3)."""
    force, n = wrench[:, :2], problem.normal
    moment = wrench[:, 2, None] - cross(problem.point, force[:, None])  # about either corner
    along = problem.point[:, 1] - problem.point[:, 0]
    second = moment[:, 0] / cross(along, n)
    return np.stack([(force * n).sum(1) - second, second, cross(n, force)], axis=1)


def coulomb(normal, shear, rate, friction, sliding):
    """Violation of Eq 6: the residual of the projection on the admissible shear forces."""
    if sliding:
        return abs(shear - sliding * friction * normal)
    if np.isinf(friction):
        return min(abs(rate), max(abs(normal), rate * shear))
    return block.coulomb(rate, shear, normal, friction)


def closed_violation(problem, j, rates, forces):
    """Violation at a joint whose faces are parallel: Eq 5 at either corner, Eq 6 between them."""
    n, t = problem.normal[j], rotated(problem.normal[j])
    signorini = block.signorini(rates @ n, forces[:2]).max()
    # Where only one corner bears, the slip is that of this corner.
    weight = np.maximum(forces[:2], 0.0) + 1e-30
    rate = weight @ (rates @ t) / weight.sum()
    return max(
        signorini,
        coulomb(forces[:2].sum(), forces[2], rate, problem.friction[j], problem.sliding[j]),
    )


def corner_violation(problem, j, c, rate, force):
    """Violation at a corner by Eqs 23a, 23b and Coulomb's cones of either face."""
    faces = {PLUS: problem.normal_plus[j, c], MINUS: problem.normal_minus[j, c]}
    mu = problem.friction[j]
    rays = {}
    for sense, n in faces.items():
        ray = sense * rotated(n) if np.isinf(mu) else n + sense * mu * rotated(n)
        rays[sense] = ray / np.linalg.norm(ray)
    size = np.linalg.norm(force)
    least = max(size, -max(n @ rate for n in faces.values()))
    outside = max(cross(rays[PLUS], force), cross(force, rays[MINUS]), 0.0)
    if problem.sliding[j] == 0:
        least = min(least, max(outside, np.linalg.norm(rate)))
    for sense, n in faces.items():
        if problem.sliding[j] == -sense:
            continue
        along = 0.0 if problem.sliding[j] else sense * (rotated(n) @ rate)
        off = np.linalg.norm(force - max(force @ rays[sense], 0.0) * rays[sense])
        least = min(least, max(off, abs(n @ rate), along))
    return least


def scale_of(problem):
    """Largest relative velocity of corners that may touch, without reactions."""
    return np.abs(corner_rates(problem, problem.free)[problem.touching]).max()


def law_violation(problem, solution):
    """Largest violation of Signorini's and Coulomb's laws in a chain [1].

    Joints of which both corners may touch have parallel faces. Velocities count over the largest
    relative velocity without reactions, forces over the largest of them.
    """
    touching = problem.touching
    rates = corner_rates(problem, solution.velocity) / scale_of(problem)
    wrench = solution.wrench / (np.abs(solution.wrench[:, :2]).max() or 1.0)
    forces = corner_forces(problem, wrench)
    worst = 0.0
    for j in range(problem.friction.size):
        if touching[j].all():
            worst = max(worst, closed_violation(problem, j, rates[j], forces[j]))
        elif touching[j].any():
            c = int(np.argmax(touching[j]))
            force = wrench[j, :2]
            arm = np.linalg.norm(problem.point[j, 1] - problem.point[j, 0])
            off = abs(wrench[j, 2] - cross(problem.point[j, c], force)) / arm
            worst = max(worst, off, corner_violation(problem, j, c, rates[j, c], force))
        else:
            worst = max(worst, np.abs(wrench[j]).max())
    return worst


def balanced(problem, modes):
    """Wrenches on the later bodies in modes without slip, by one dense problem (Eqs 26, 27).

    Constrained are both components at a joint's first corner that bears, the normal one at its
    second.
    """
    n = problem.mass.size
    still = problem.but(bias=np.zeros_like(problem.bias))
    units = np.eye(3 * n).reshape(-1, n, 3)
    matrix = np.stack([corner_rates(still, unit) for unit in units], axis=-1)
    held = [
        (j, c, axis)
        for j, mode in enumerate(modes)
        for k, c in enumerate(mode.corners)
        for axis in (np.eye(2) if k == 0 else problem.normal[j : j + 1])
    ]
    rows = np.array([axis @ matrix[j, c] for j, c, axis in held])
    bias = np.array([axis @ problem.bias[j, c] for j, c, axis in held])
    inverse = 1.0 / np.stack([problem.mass, problem.mass, problem.inertia], axis=1).ravel()
    _, forces = full_motion(inverse, rows, rows, bias, problem.free.ravel(), ease=0.0)
    wrench = np.zeros((len(modes), 3))
    for force, (j, c, axis) in zip(forces, held):
        wrench[j] += force * np.array([*axis, cross(problem.point[j, c], axis)])
    return wrench
