"""The contact laws and the balance of a chain, written out apart from the package in numpy.

Axes of a joint: normal n from the earlier body to the later one, tangent t = n rotated by +90
degrees, from corner 0 to corner 1. Reactions act on the later body.
"""

import itertools

import numpy as np

from archbench.paper import block
from archbench.paper.arch import cross, full_motion, rotated
from tests.mechanics.adapters import CLOSED, MINUS, OPEN, PLUS, Mode, framed


def motion_matrix(problem):
    """B of the relative velocities B w at both corners, (m, 2, 2, 3 n), without bias."""
    n, m = problem.mass.size, problem.friction.size
    matrix = np.zeros((m, 2, 2, n, 3))
    for j, c in itertools.product(range(m), range(2)):
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if 0 <= body < n:
                arm = problem.point[j, c] - problem.centroid[body]
                matrix[j, c, :, body, :2] = sign * np.eye(2)
                matrix[j, c, :, body, 2] = sign * rotated(arm)
    return matrix.reshape(m, 2, 2, 3 * n)


def masses(problem):
    """Diagonal of the mass matrix, (3 n,)."""
    return np.stack([problem.mass, problem.mass, problem.inertia], axis=1).ravel()


def corner_rates(problem, velocity):
    """Relative velocity at both corners of all joints, with bias, (m, 2, 2)."""
    centroid, motion = framed(problem.centroid)[:, None], framed(velocity)[:, None]
    m = problem.friction.size
    after, before = (
        motion[i : i + m, :, :2]
        + motion[i : i + m, :, 2:] * rotated(problem.point - centroid[i : i + m])
        for i in (1, 0)
    )
    return after - before + problem.bias


def balance_error(problem, solution):
    """Largest part of M (w - w_free) - H r, over the largest force and moment."""
    n, m = problem.mass.size, problem.friction.size
    load = np.zeros((n, 3))
    for j in range(m):
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if 0 <= body < n:
                force, moment = solution.wrench[j, :2], solution.wrench[j, 2]
                about = moment - cross(problem.centroid[body], force)
                load[body] += sign * np.array([*force, about])
    gain = masses(problem).reshape(n, 3) * (solution.velocity - problem.free)
    return np.abs(gain - load).max() / (np.abs(solution.wrench).max() or 1.0)


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


def law_violation(problem, solution, enough=np.inf, matrix=None):
    """Largest violation of Signorini's and Coulomb's laws in a chain [1].

    Joints of which both corners may touch have parallel faces. Velocities count over the largest
    relative velocity without reactions, forces over the largest of them. Beyond `enough` no more
    joints are looked at.
    """
    touching = problem.touching
    matrix = motion_matrix(problem) if matrix is None else matrix
    free = matrix @ problem.free.ravel() + problem.bias
    rates = matrix @ solution.velocity.ravel() + problem.bias
    rates /= np.abs(free[touching]).max()
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
        if not worst < enough:
            return worst
    return worst


def mode_rows(problem, j, mode):
    """Constraints of a joint in a mode and the reactions they admit, in pairs.

    Returns
    -------
    list of (corner weights (2,), direction (2,), force directions (2, 2) by corner)
        Constrained is the weighted sum of both corners' rates along the direction.
    """
    mu = problem.friction[j]
    if mode.corners == CLOSED.corners:
        n, t = problem.normal[j], rotated(problem.normal[j])
        force = n + mode.slip * mu * t if mode.slip else n
        rows = [(np.eye(2)[c], n, np.eye(2)[c][:, None] * force) for c in range(2)]
        if not mode.slip:
            rows.append((np.array([0.5, 0.5]), t, np.full((2, 1), 0.5) * t))
        return rows
    rows = []
    for c in mode.corners:
        n = problem.normal_minus[j, c] if mode.slip == MINUS else problem.normal_plus[j, c]
        at = np.eye(2)[c]
        if not mode.slip:
            rows += [(at, n, at[:, None] * n), (at, rotated(n), at[:, None] * rotated(n))]
        else:
            ray = mode.slip * rotated(n) if np.isinf(mu) else n + mode.slip * mu * rotated(n)
            rows.append((at, n, at[:, None] * ray))
    return rows


def possible_modes(problem, j):
    """All modes of a joint that its touching corners and its friction admit."""
    corners = [c for c in range(2) if problem.touching[j, c]]
    found = [OPEN]
    for some in [(c,) for c in corners] + ([(0, 1)] if len(corners) == 2 else []):
        for slip in (0, PLUS, MINUS):
            if problem.sliding[j] and slip != problem.sliding[j]:
                continue
            if len(some) == 2 and slip and np.isinf(problem.friction[j]):
                continue
            found.append(Mode(some, slip))
    return found


class Dense:
    """The linear problem of given modes, by dense matrices."""

    def __init__(self, problem):
        self.problem, self.matrix = problem, motion_matrix(problem)
        self.inverse = 1.0 / masses(problem)
        self.rows = {}

    def _rows_of(self, j, mode):
        """Constrained directions, those of their forces, bias and wrenches of unit forces."""
        if (j, mode) not in self.rows:
            found = mode_rows(self.problem, j, mode)
            row = [np.einsum("c,d,cdk->k", w, d, self.matrix[j]) for w, d, _ in found]
            column = [np.einsum("cd,cdk->k", f, self.matrix[j]) for *_, f in found]
            bias = [w @ self.problem.bias[j] @ d for w, d, _ in found]
            about = [cross(self.problem.point[j], f).sum() for *_, f in found]
            wrench = [[*f.sum(0), moment] for (*_, f), moment in zip(found, about)]
            width = self.inverse.size
            self.rows[j, mode] = (
                np.reshape(row, (-1, width)), np.reshape(column, (-1, width)),
                np.array(bias), np.reshape(wrench, (-1, 3)),
            )  # fmt: skip
        return self.rows[j, mode]

    def rows_of(self, modes):
        return [np.concatenate(parts) for parts in zip(*map(self._rows_of, range(99), modes))]

    def lacking_rank(self, modes):
        """How many reactions in these modes are not determined by the motion."""
        row = self.rows_of(modes)[0] * np.sqrt(self.inverse)
        if row.size == 0:
            return 0
        row /= np.linalg.norm(row, axis=1)[:, None]
        return len(row) - np.linalg.matrix_rank(row, tol=1e-9)

    def solve(self, modes, ease=1e-10):
        """Motion, and reactions on the later bodies with moments about the origin.

        Constraints are eased by a part of their own compliance, which chooses among reactions
        that are not unique.
        """
        row, column, bias, unit = self.rows_of(modes)
        free = self.problem.free
        velocity, unknown = full_motion(self.inverse, row, column, bias, free.ravel(), ease)
        counts = [len(self._rows_of(j, mode)[0]) for j, mode in enumerate(modes)]
        wrench = np.zeros((len(counts), 3))
        np.add.at(wrench, np.repeat(np.arange(len(counts)), counts), unknown[:, None] * unit)
        return velocity.reshape(free.shape), wrench
