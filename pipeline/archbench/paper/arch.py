"""The arch: Eqs 22 to 35 of Sinopoli's paper; Eqs 24 and 25 are the laws of the block.

A body is its centroid (2,) and its velocity (3,) or acceleration: x, y and rotation. Joint j lies
between bodies j - 1 and j, reactions act on the later one. Of three mega-voussoirs on four hinges
the rows of `hinge` (4, 2) are C1, C12, C23 and C3.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def cross(a: Array, b: Array) -> Array:
    """Vector product of vectors of the plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def rotated(a: Array) -> Array:
    """Vectors rotated by +90 degrees."""
    return np.stack([-a[..., 1], a[..., 0]], axis=-1)


def relative_velocity(
    point: Array, before: tuple[Array, Array], after: tuple[Array, Array]
):
    """Velocity at a point of the body after a joint relative to the one before it (Eq 22).

    Bodies are (centroid, velocity).
    """
    (place, motion), (later_place, later) = before, after
    there = later[:2] + later[2] * rotated(point - later_place)
    return there - motion[:2] - motion[2] * rotated(point - place)


def gaps(before: Array, after: Array, corner: int) -> Array:
    """Gap at a corner of two faces (2, 2), from either face's normal (Eqs 23a, 23b) [m].

    The corner is closed where the larger vanishes, unless the faces have slipped.
    """
    apart = after[corner] - before[corner]
    tangents = np.array([before[1] - before[0], after[1] - after[0]])
    normals = -rotated(tangents / np.linalg.norm(tangents, axis=1)[:, None])
    return normals @ apart


def full_motion(
    inverse: Array,
    row: Array,
    column: Array,
    bias: Array,
    free: Array,
    ease: float = 1e-10,
) -> tuple[Array, Array]:
    """Motion of all voussoirs, and multipliers, for given contact modes (Eqs 26, 27).

    The rows' velocities (k, 3 n) vanish with their bias; the columns' reactions see to it. `free`
    are velocities or accelerations without reactions (3 n,), `inverse` the inverse masses and
    inertias. Rows are eased by a part of their own compliance, which chooses among reactions that
    are not unique.
    """
    operator = row * inverse @ column.T
    operator += ease * np.diag(np.einsum("ak,k,ak->a", row, inverse, row))
    multiplier = np.linalg.solve(operator, -(row @ free + bias))
    return free + inverse * (column.T @ multiplier), multiplier


def least_load(mass: Array, mechanism: Array) -> float:
    """Load k_s at which a mechanism's velocities (n, 3) have no power any more (Eq 28) [g]."""
    return float(-(mass @ mechanism[:, 1]) / (mass @ mechanism[:, 0]))


def hinge_matrix(centroid: Array, hinge: Array) -> Array:
    """J of the relative velocities J u' (Eq 22) of three bodies at their four hinges, (8, 9)."""
    matrix = np.zeros((4, 2, 3, 3))
    for j in range(4):
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if 0 <= body < 3:
                matrix[j, :, body, :2] = sign * np.eye(2)
                matrix[j, :, body, 2] = sign * rotated(hinge[j] - centroid[body])
    return matrix.reshape(8, 9)


def mechanism_of(centroid: Array, hinge: Array) -> Array:
    """The motion that the hinges allow, (3, 3); the first body rotates at 1 rad/s (Eq 16)."""
    free = np.linalg.svd(hinge_matrix(centroid, hinge))[2][-1]
    return (free / free[2]).reshape(3, 3)


def hinged_motion(
    mass: Array, inertia: Array, centroid: Array, hinge: Array, spin: Array, free: Array
) -> tuple[Array, Array]:
    """Accelerations of three hinged bodies (3, 3), and forces on the later bodies (4, 2).

    The balance of the bodies (Eqs 17, 18, 26): nine equations for eight forces and one rate.
    """
    matrix = hinge_matrix(centroid, hinge)
    square = np.zeros((4, 2))
    for j in range(4):
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if 0 <= body < 3:
                square[j] -= sign * spin[body] ** 2 * (hinge[j] - centroid[body])
    centripetal = np.linalg.lstsq(matrix, -square.ravel(), rcond=None)[0]
    along = mechanism_of(centroid, hinge).ravel()
    masses = np.stack([mass, mass, inertia], axis=1).ravel()
    system = np.column_stack([-matrix.T, masses * along])
    unknown = np.linalg.solve(system, masses * (free.ravel() - centripetal))
    acceleration = centripetal + unknown[8] * along
    return acceleration.reshape(3, 3), unknown[:8].reshape(4, 2)


def middle_reactions(
    mass: float,
    inertia: float,
    centroid: Array,
    hinge: Array,
    acceleration: Array,
    free: Array,
) -> tuple[Array, float]:
    """R^(1,2) and R^(3,2) on the middle body, and what of its balance they leave (Eqs 29 to 33).

    The paper's first level: reactions without power on the middle body (Eq 30) point at its
    rotation centre (Eq 31) and balance it (Eqs 29, 32) in the plane across its motion (Eq 33).
    This holds where the outer bodies have no mass; their weight and inertia add parts along the
    velocities of C12 and C23. All arguments but the hinges are the middle body's; `acceleration`
    is with reactions, `free` without.
    """
    root = np.sqrt([mass, mass, inertia])
    lines = hinge[[0, 3]] - hinge[[1, 2]]
    unit = lines / np.linalg.norm(lines, axis=1)[:, None]
    h = np.column_stack([unit, cross(hinge[1:3] - centroid, unit)]) / root
    needed = root * (acceleration - free)
    mechanism = np.cross(h[0], h[1])
    in_plane = needed - (needed @ mechanism) / (mechanism @ mechanism) * mechanism
    found = np.linalg.lstsq(h.T, in_plane, rcond=None)[0]
    return found, float(np.abs(h.T @ found - needed).max())


def contact_centre(wrench: Array, face: Array) -> float:
    """e at which a reaction meets a face (2, 2) (Eq 34): 0 at its first corner, 1 at its second.

    The wrench is the force and the moment about the origin.
    """
    along = face[1] - face[0]
    return float((wrench[2] - cross(face[0], wrench[:2])) / cross(along, wrench[:2]))


def next_reaction(
    wrench: Array,
    mass: float,
    inertia: float,
    centroid: Array,
    acceleration: Array,
    free: Array,
) -> Array:
    """Reaction behind a voussoir from the one before it, by its balance (Eq 35).

    Wrenches are force and moment about the origin on the later body.
    """
    gain = np.array([mass, mass, inertia]) * (acceleration - free)
    return wrench - [gain[0], gain[1], gain[2] + cross(centroid, gain[:2])]
