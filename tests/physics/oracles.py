"""The contact laws and the balance of a chain by the paper's formulas, apart from the package."""

import numpy as np

from archbench.paper import block
from archbench.paper.arch import (
    cross,
    full_motion,
    next_reaction,
    relative_velocity,
    rotated,
)
from tests.physics.adapters import MINUS, PLUS, framed


def corner_rates(problem, velocity):
    """Relative velocity at both corners of all joints (Eq 22), with bias, (m, 2, 2)."""
    bodies = list(zip(problem.position[:, :2], framed(velocity)))
    pairs = zip(problem.work.point, bodies, bodies[1:])
    return np.array([relative_velocity(*pair) for pair in pairs]) + problem.work.bias


def balance_error(problem, solution):
    """Largest part of a reaction that does not follow from the one before it (Eq 35)."""
    model = problem.model
    following = np.vstack([solution.wrench, np.zeros(3)])
    parts = (
        model.mass,
        model.inertia,
        problem.position[:, :2],
        framed(solution.velocity),
    )
    bodies = list(zip(*parts, problem.work.free))[1:-1]
    left = [
        next_reaction(following[i], *body) - following[i + 1]
        for i, body in enumerate(bodies)
    ]
    return np.abs(left).max() / (np.abs(solution.wrench).max() or 1.0)


def corner_forces(problem, wrench):
    """Normal forces at both corners and shear of each joint as if closed, (m, 3)."""
    force = wrench[:, :2]
    n = problem.work.normal
    point = problem.work.point
    moment = wrench[:, 2, None] - cross(point, force[:, None])  # about either corner
    second = moment[:, 0] / cross(point[:, 1] - point[:, 0], n)
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
    n = problem.work.normal[j]
    mu = problem.model.friction[j]
    sliding = problem.work.known[j]
    # Where only one corner bears, the slip is that of this corner.
    weight = np.maximum(forces[:2], 0.0) + 1e-30
    rate = weight @ (rates @ rotated(n)) / weight.sum()
    signorini = block.signorini(rates @ n, forces[:2]).max()
    return max(signorini, coulomb(forces[:2].sum(), forces[2], rate, mu, sliding))


def corner_violation(problem, j, c, rate, force):
    """Violation at a corner by Eqs 23a, 23b and Coulomb's cones of either face."""
    faces = dict(zip((PLUS, MINUS), problem.work.side_normal[j, c]))
    mu = problem.model.friction[j]
    sliding = problem.work.known[j]
    rays = {}
    for sense, n in faces.items():
        ray = sense * rotated(n) if np.isinf(mu) else n + sense * mu * rotated(n)
        rays[sense] = ray / np.linalg.norm(ray)
    least = max(np.linalg.norm(force), -max(n @ rate for n in faces.values()))
    outside = max(cross(rays[PLUS], force), cross(force, rays[MINUS]), 0.0)
    if sliding == 0:
        least = min(least, max(outside, np.linalg.norm(rate)))
    for sense, n in faces.items():
        if sliding != -sense:
            along = 0.0 if sliding else sense * (rotated(n) @ rate)
            off = np.linalg.norm(force - max(force @ rays[sense], 0.0) * rays[sense])
            least = min(least, max(off, abs(n @ rate), along))
    return least


def scale_of(problem):
    """Largest relative velocity of corners that may touch, without reactions."""
    rates = corner_rates(problem, problem.work.free[1:-1])
    return np.abs(rates[problem.work.candidate > 0.5]).max()


def law_violation(problem, solution):
    """Largest violation of Signorini's and Coulomb's laws in a chain [1].

    Joints of which both corners may touch have parallel faces. Velocities count over the largest
    relative velocity without reactions, forces over the largest of them.
    """
    point = problem.work.point
    touching = problem.work.candidate > 0.5
    rates = corner_rates(problem, solution.velocity) / scale_of(problem)
    wrench = solution.wrench / (np.abs(solution.wrench[:, :2]).max() or 1.0)
    forces = corner_forces(problem, wrench)
    worst = 0.0
    for j in range(len(point)):
        if touching[j].all():
            worst = max(worst, closed_violation(problem, j, rates[j], forces[j]))
        elif touching[j].any():
            c = int(np.argmax(touching[j]))
            force = wrench[j, :2]
            arm = np.linalg.norm(point[j, 1] - point[j, 0])
            off = abs(wrench[j, 2] - cross(point[j, c], force)) / arm
            worst = max(worst, off, corner_violation(problem, j, c, rates[j, c], force))
        else:
            worst = max(worst, np.abs(wrench[j]).max())
    return worst


def dense(problem, modes):
    """Contact problem in modes without slip as one dense one: inverse masses, rows, bias, places.

    A row is held at a joint's corner along an axis: (joint, corner, axis) in places.
    """
    model = problem.model
    work = problem.work
    n = problem.model.mass.size - 2
    still = problem.copy(bias=0.0 * work.bias)
    units = np.eye(3 * n).reshape(-1, n, 3)
    matrix = np.stack([corner_rates(still, unit) for unit in units], axis=-1)
    held = [  # both components at a joint's first corner that bears, the normal one at its second
        (j, c, axis)
        for j, mode in enumerate(modes)
        for k, c in enumerate(mode.corners)
        for axis in (np.eye(2) if k == 0 else work.normal[j : j + 1])
    ]
    rows = np.array([axis @ matrix[j, c] for j, c, axis in held])
    bias = np.array([axis @ work.bias[j, c] for j, c, axis in held])
    mass = model.mass[1:-1]
    inertia = model.inertia[1:-1]
    return 1.0 / np.stack([mass, mass, inertia], axis=1).ravel(), rows, bias, held


def balanced(problem, modes):
    """Wrenches on the later bodies in modes without slip, by one dense problem (Eqs 26, 27)."""
    inverse, rows, bias, held = dense(problem, modes)
    free = problem.work.free[1:-1].ravel()
    _, forces = full_motion(inverse, rows, rows, bias, free, ease=0.0)
    wrench = np.zeros((len(modes), 3))
    for force, (j, c, axis) in zip(forces, held):
        wrench[j] += force * np.array([*axis, cross(problem.work.point[j, c], axis)])
    return wrench
