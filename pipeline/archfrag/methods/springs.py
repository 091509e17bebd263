"""Joints of penalty springs: their forces, their stiffness matrix and its highest frequency.

Each joint has a contact at either corner, with a normal and a shear spring (Cundall and Strack
1979; Cundall 1988, *Int. J. Rock Mech. Min. Sci.* 25, 107-116; Lemos 2007, *Int. J. Archit.
Heritage* 1, 190-213). A corner touches where the later face overlaps the earlier one, vertex on
face as in Eqs 23a and 23b. Where two vertices meet, their normals differ; over a short slip, the
rounding of UDEC's corners, one turns into the other, so that the force has no jump there. Unlike
UDEC's arcs, this rounding does not draw the hinge inwards.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.kinematics import joint_lengths, unit_tangent
from archfrag.mechanics.laws import MINUS, OPEN, PLUS, STICK, closed_mode, corner_mode

# Half the bandwidth of a stiffness matrix: neighbours share a joint, each has 3 coordinates.
BAND = 6
BISECTIONS = 24


class Sum(IntEnum):
    """Entries of ``Springs.sums``."""

    ELASTIC = 0  # energy in the springs now [J]
    FRICTION = 1  # work of sliding since they were booked last [J]
    DAMPING = 2  # work of the dashpots since then [J]
    OVERLAP = 3  # largest overlap so far, over the length of its joint [1]


N_SUM = len(Sum)


class Springs(NamedTuple):
    """Constants of the joints and what they remember from one step to the next."""

    normal_stiffness: np.ndarray  # (n_joint,) of either corner [N/m]
    shear_stiffness: np.ndarray  # (n_joint,) [N/m]
    rounding: np.ndarray  # (n_joint,) slip over which the normal turns [m]
    length: np.ndarray  # (n_joint,) [m]
    tangent_before: np.ndarray  # (n_joint, 2) of the faces, in the frames of their bodies
    tangent_after: np.ndarray
    turn: np.ndarray  # (n_body, 2) cosine and sine of the rotations
    shear: np.ndarray  # (n_joint, 2) force of the shear spring on the later body [N]
    normal_damper: np.ndarray  # (n_joint, 2) forces of the dashpots [N]
    shear_damper: np.ndarray
    touch: np.ndarray  # (n_joint, 2) int8: whether a corner touches
    slide: np.ndarray  # (n_joint, 2) int8: sense of friction there; STICK
    slip: np.ndarray  # (n_joint,) at the corner that is nearer to contact [m]
    mode: np.ndarray  # (n_joint,) int8: contact mode
    force: np.ndarray  # (n_joint, 2, 2) on the later body at each corner [N]
    point: np.ndarray  # (n_joint, 2, 2) where it acts [m]
    total: np.ndarray  # (n_body, 3) of the joints on each body [N], [N m]
    sums: np.ndarray  # (len(Sum),)


@allocating
def new_springs(chain, stiffness, shear_ratio, rounding):
    """Joints whose springs bear nothing yet.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    stiffness : float
        Normal stiffness of a joint, for each unit of its area [Pa/m], at a depth of 1 m.
    shear_ratio : float
        Shear over normal stiffness.
    rounding : float
        Over the length of a joint.

    Returns
    -------
    Springs
    """
    n_body, n_joint = chain.mass.size, chain.friction.size
    length = joint_lengths(chain)
    tangent_before, tangent_after = np.empty((n_joint, 2)), np.empty((n_joint, 2))
    for j in range(n_joint):
        tangent_before[j, 0], tangent_before[j, 1] = unit_tangent(chain.face_before[j])
        tangent_after[j, 0], tangent_after[j, 1] = unit_tangent(chain.face_after[j])
    return Springs(
        0.5 * stiffness * length,
        0.5 * stiffness * shear_ratio * length,
        rounding * length,
        length,
        tangent_before,
        tangent_after,
        np.zeros((n_body, 2)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2), np.int8),
        np.zeros((n_joint, 2), np.int8),
        np.zeros(n_joint),
        np.zeros(n_joint, np.int8),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_body, 3)),
        np.zeros(N_SUM),
    )


class Side(NamedTuple):
    """One of the two bodies at a joint: a body of the chain, or the ground."""

    x: float  # centroid [m]
    y: float
    cosine: float  # of its rotation
    sine: float
    ux: float  # velocity [m/s]
    uy: float
    spin: float  # [rad/s]


@inlined
def _side(body, springs, position, velocity):
    if 0 <= body < position.shape[0]:
        return Side(
            position[body, 0], position[body, 1], springs.turn[body, 0], springs.turn[body, 1],
            velocity[body, 0], velocity[body, 1], velocity[body, 2],
        )  # fmt: skip
    return Side(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def _turned(side, x, y):
    """A vector of the body's frame in the ground frame."""
    return side.cosine * x - side.sine * y, side.sine * x + side.cosine * y


@inlined
def _contact_frame(corner, rounding, ax, ay, bx, by, mx, my, dx, dy):
    """Tangent of a contact, gap, slip, weight of the earlier face, and way of the contact point.

    Parameters
    ----------
    corner : int
    rounding : float [m]
    ax, ay, bx, by, mx, my : float
        Unit tangents of the earlier face, the later one and between them.
    dx, dy : float
        From the earlier face's corner to the later one's [m].
    """
    slip = mx * dx + my * dy
    turned = min(max(slip / rounding, -1.0), 1.0)
    weight = 0.5 + (0.5 - corner) * turned
    tx = weight * ax + (1.0 - weight) * bx
    ty = weight * ay + (1.0 - weight) * by
    norm = 1.0 / np.sqrt(tx * tx + ty * ty)
    tx *= norm
    ty *= norm
    # What makes the normal the gradient of the gap, in both slip and rotation.
    arc = (0.5 - corner) * 0.5 * rounding * (1.0 - turned * turned)
    bow = arc * ((ay - by) * mx - (ax - bx) * my)
    return tx, ty, ty * dx - tx * dy + bow, slip, weight, arc


@inlined
def _middle(ax, ay, bx, by):
    mx, my = ax + bx, ay + by
    square = mx * mx + my * my
    if square < 1e-12:
        return ax, ay
    norm = 1.0 / np.sqrt(square)
    return mx * norm, my * norm


@inlined
def _clear_contact(springs, j, c):
    springs.touch[j, c] = 0
    springs.slide[j, c] = STICK
    springs.shear[j, c] = 0.0
    springs.normal_damper[j, c] = 0.0
    springs.shear_damper[j, c] = 0.0
    springs.force[j, c, 0] = 0.0
    springs.force[j, c, 1] = 0.0


@kernel
def press_joints(chain, springs, position, velocity, step, damping):
    """Forces of all joints at the end of a step, into `springs`.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    springs : Springs
        Its shear springs and dashpots hold what they bore before the step.
    position : ndarray, (n_body, 3)
        After the step.
    velocity : ndarray, (n_body, 3)
        With which the bodies moved over it.
    step : float [s]
    damping : float
        Dashpot over spring [s].
    """
    n_body, n_joint = chain.mass.size, chain.friction.size
    total, sums = springs.total, springs.sums
    for i in range(n_body):
        springs.turn[i, 0] = np.cos(position[i, 2])
        springs.turn[i, 1] = np.sin(position[i, 2])
        total[i, 0] = total[i, 1] = total[i, 2] = 0.0
    elastic = friction_work = damping_work = 0.0
    for j in range(n_joint):
        earlier = _side(j - 1, springs, position, velocity)
        later = _side(j, springs, position, velocity)
        kn, ks, mu = springs.normal_stiffness[j], springs.shear_stiffness[j], chain.friction[j]
        ax, ay = _turned(earlier, springs.tangent_before[j, 0], springs.tangent_before[j, 1])
        bx, by = _turned(later, springs.tangent_after[j, 0], springs.tangent_after[j, 1])
        mx, my = _middle(ax, ay, bx, by)
        nearest = np.inf
        for c in range(2):
            ex, ey = _turned(earlier, chain.face_before[j, c, 0], chain.face_before[j, c, 1])
            ex += earlier.x
            ey += earlier.y
            lx, ly = _turned(later, chain.face_after[j, c, 0], chain.face_after[j, c, 1])
            dx, dy = lx + later.x - ex, ly + later.y - ey
            tx, ty, gap, slip, weight, arc = _contact_frame(
                c, springs.rounding[j], ax, ay, bx, by, mx, my, dx, dy
            )
            if gap < nearest:
                nearest = gap
                springs.slip[j] = slip
            if gap >= 0.0 and not springs.touch[j, c]:
                continue
            px, py = ex + weight * dx + arc * tx, ey + weight * dy + arc * ty
            ux = later.ux - later.spin * (py - later.y)
            ux -= earlier.ux - earlier.spin * (py - earlier.y)
            uy = later.uy + later.spin * (px - later.x)
            uy -= earlier.uy + earlier.spin * (px - earlier.x)
            opened = (ty * ux - tx * uy) * step
            slid = (tx * ux + ty * uy) * step
            shear_before = springs.shear[j, c]
            normal_damper = springs.normal_damper[j, c]
            shear_damper = springs.shear_damper[j, c]
            if gap >= 0.0:
                _clear_contact(springs, j, c)
            else:
                spring = -kn * gap
                normal = max(spring - damping * kn * (ty * ux - tx * uy), 0.0)
                shear = shear_before - ks * slid
                damper = -damping * ks * (tx * ux + ty * uy)
                slide = STICK
                if abs(shear + damper) > mu * normal:
                    slide = PLUS if shear + damper > 0.0 else MINUS
                    # The dashpot gives way first: it must not load the spring.
                    shear = min(max(shear, -mu * normal), mu * normal)
                    damper = slide * mu * normal - shear
                springs.touch[j, c] = 1
                springs.slide[j, c] = slide
                springs.shear[j, c] = shear
                springs.normal_damper[j, c] = normal - spring
                springs.shear_damper[j, c] = damper
                fx = normal * ty + (shear + damper) * tx
                fy = (shear + damper) * ty - normal * tx
                springs.force[j, c, 0], springs.force[j, c, 1] = fx, fy
                springs.point[j, c, 0], springs.point[j, c, 1] = px, py
                elastic += 0.5 * (kn * gap * gap + shear * shear / ks)
                sums[Sum.OVERLAP] = max(sums[Sum.OVERLAP], -gap / springs.length[j])
                if j > 0:
                    total[j - 1, 0] -= fx
                    total[j - 1, 1] -= fy
                    total[j - 1, 2] -= (px - earlier.x) * fy - (py - earlier.y) * fx
                if j < n_body:
                    total[j, 0] += fx
                    total[j, 1] += fy
                    total[j, 2] += (px - later.x) * fy - (py - later.y) * fx
            # By the trapezoidal rule, with which central differences balance energy.
            shear = springs.shear[j, c]
            friction_work += 0.5 * (shear + shear_before) * (slid + (shear - shear_before) / ks)
            damping_work += 0.5 * (normal_damper + springs.normal_damper[j, c]) * opened
            damping_work += 0.5 * (shear_damper + springs.shear_damper[j, c]) * slid
        springs.mode[j] = _mode_of(springs.touch[j], springs.slide[j])
    sums[Sum.ELASTIC] = elastic
    sums[Sum.FRICTION] += friction_work
    sums[Sum.DAMPING] += damping_work


@inlined
def _mode_of(touch, slide):
    if touch[0] and touch[1]:
        return closed_mode(slide[0] if slide[0] == slide[1] else STICK)
    if touch[0]:
        return corner_mode(0, slide[0])
    if touch[1]:
        return corner_mode(1, slide[1])
    return OPEN


@kernel
def _add_spring(band, j, n_body, x, y, stiffness, earlier, later, px, py):
    """Add a spring of direction (x, y) at a point of joint `j`; columns of `band` go down."""
    row = np.int64(3 * (j - 1))
    sides = (-1.0, 1.0)
    for p in range(6):
        body_p = j - 1 + p // 3
        if body_p < 0 or body_p >= n_body:
            continue
        centre = earlier if p < 3 else later
        value_p = sides[p // 3] * _along(p % 3, x, y, px - centre[0], py - centre[1])
        for q in range(p + 1):
            body_q = j - 1 + q // 3
            if body_q < 0 or body_q >= n_body:
                continue
            other = earlier if q < 3 else later
            value_q = sides[q // 3] * _along(q % 3, x, y, px - other[0], py - other[1])
            band[row + q, p - q] += stiffness * value_p * value_q


@kernel
def _along(coordinate, x, y, rx, ry):
    """What a unit of a body's coordinate moves a point by along (x, y)."""
    if coordinate == 0:
        return x
    if coordinate == 1:
        return y
    return rx * y - ry * x


@kernel
def stiffness_matrix(chain, springs, position, before, after, every, band):
    """Elastic stiffness of the joints about a configuration.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    springs : Springs
    position : ndarray, (n_body, 3)
    before, after : ndarray, (n_joint, 2, 2)
        Faces there, as of `archfrag.mechanics.kinematics.move_faces`.
    every : bool
        All corners; else those only that touch, by ``springs.touch``.
    band : ndarray, (3 n_body, 6)
        Overwritten with the lower band: ``band[i, k]`` couples coordinates i and i + k.
    """
    n_body = chain.mass.size
    band[:, :] = 0.0
    for j in range(chain.friction.size):
        ax, ay = unit_tangent(before[j])
        bx, by = unit_tangent(after[j])
        mx, my = _middle(ax, ay, bx, by)
        ex = ey = lx = ly = 0.0
        if j > 0:
            ex, ey = position[j - 1, 0], position[j - 1, 1]
        if j < n_body:
            lx, ly = position[j, 0], position[j, 1]
        for c in range(2):
            if not (every or springs.touch[j, c]):
                continue
            dx = after[j, c, 0] - before[j, c, 0]
            dy = after[j, c, 1] - before[j, c, 1]
            tx, ty, _, _, weight, arc = _contact_frame(
                c, springs.rounding[j], ax, ay, bx, by, mx, my, dx, dy
            )
            px = before[j, c, 0] + weight * dx + arc * tx
            py = before[j, c, 1] + weight * dy + arc * ty
            for x, y, stiffness in (
                (ty, -tx, springs.normal_stiffness[j]),
                (tx, ty, springs.shear_stiffness[j]),
            ):
                _add_spring(band, j, n_body, x, y, stiffness, (ex, ey), (lx, ly), px, py)


@kernel
def factorise(band):
    """Cholesky factor of a banded matrix, in place; False if it is not positive definite."""
    size = band.shape[0]
    for i in range(size):
        pivot = band[i, 0]
        if not pivot > 0.0:
            return False
        root = np.sqrt(pivot)
        band[i, 0] = root
        reach = min(BAND, size - i)
        for k in range(1, reach):
            band[i, k] /= root
        for k in range(1, reach):
            for m in range(k, reach):
                band[i + k, m - k] -= band[i, k] * band[i, m]
    return True


@kernel
def solve_factored(band, vector):
    """Solve with a factor from `factorise`; `vector`, (3 n_body,), is overwritten."""
    size = band.shape[0]
    for i in range(size):
        vector[i] /= band[i, 0]
        for k in range(1, min(BAND, size - i)):
            vector[i + k] -= band[i, k] * vector[i]
    for i in range(size - 1, -1, -1):
        for k in range(1, min(BAND, size - i)):
            vector[i] -= band[i, k] * vector[i + k]
        vector[i] /= band[i, 0]


@allocating
def highest_frequency(chain, springs, position, before, after):
    """Bound from above on the circular frequencies of a chain with all its corners touching.

    Fewer contacts only lower them (Rayleigh). A number above all squares of frequencies, and no
    other, makes it times the masses less the stiffness positive definite: this is bisected.

    Parameters
    ----------
    chain, springs, position, before, after
        As in `stiffness_matrix`.

    Returns
    -------
    float
        At most 1e-6 of itself too high [rad/s].
    """
    size = 3 * chain.mass.size
    stiffness, trial = np.empty((size, BAND)), np.empty((size, BAND))
    stiffness_matrix(chain, springs, position, before, after, True, stiffness)
    mass = np.empty(size)
    low = 0.0
    for i in range(size):
        mass[i] = chain.inertia[i // 3] if i % 3 == 2 else chain.mass[i // 3]
        low = max(low, stiffness[i, 0] / mass[i])
    if not np.isfinite(low):
        return np.inf
    high = low
    for _ in range(64):
        high *= 2.0
        if _is_above(high, stiffness, mass, trial):
            break
        low = high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _is_above(middle, stiffness, mass, trial):
            high = middle
        else:
            low = middle
    return np.sqrt(high)


@kernel
def _is_above(square, stiffness, mass, trial):
    for i in range(mass.size):
        for k in range(BAND):
            trial[i, k] = -stiffness[i, k]
        trial[i, 0] += square * mass[i]
    return factorise(trial)
