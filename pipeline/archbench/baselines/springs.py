"""Joints of penalty springs: their forces, their stiffness and its highest frequency.

Each joint has a contact at either corner, with a normal and a shear spring. A corner touches where
the later face overlaps the earlier one, vertex on face as in Eqs 23a and 23b. Where two vertices
meet, their normals differ; over a short slip, the rounding of UDEC's corners, one passes into the
other, so that the force has no jump there.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archbench.baselines.common import write_rows
from archfrag.physics.contact.placing import AFTER, BEFORE
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.state import Model, State, Work


class Sum(IntEnum):
    """Entries of ``Springs.sums``."""

    ELASTIC = 0  # energy in the springs now [J]
    FRICTION = 1  # work of sliding since it was recorded last [J]
    DAMPING = 2  # work of dashpots since then [J]


@struct()
class Springs(NamedTuple):
    """Constants of the joints and what they remember from one step to the next."""

    normal_stiffness: np.ndarray  # (n_joint,) of either corner [N/m]
    shear_stiffness: np.ndarray  # (n_joint,) [N/m]
    rounding: np.ndarray  # (n_joint,) slip over which the normal rotates [m]
    damping: float  # dashpots over springs [s]
    shear: np.ndarray  # (n_joint, 2) force of the shear spring on the later body [N]
    dashpot: np.ndarray  # (n_joint, 2, 2) normal and shear forces of the dashpots [N]
    force: np.ndarray  # (n_joint, 2, 2) on the later body at each corner [N]
    point: np.ndarray  # (n_joint, 2, 2) where it acts [m]
    total: np.ndarray  # (n_body + 2, 3) of the joints on each body [N], [N m]
    sums: np.ndarray  # (len(Sum),)
    moved: np.ndarray  # (1,) when a body was too fast for rest last [s]


def new_springs(
    model: Model, stiffness: float, shear_ratio: float, rounding: float
) -> Springs:
    """Joints whose springs bear nothing yet, without damping."""
    n_joint = model.length.size
    normal = 0.5 * stiffness * model.length
    dashpot, force, point = np.zeros((3, n_joint, 2, 2))
    return Springs(
        normal_stiffness=normal,
        shear_stiffness=shear_ratio * normal,
        rounding=rounding * model.length,
        damping=0.0,
        shear=np.zeros((n_joint, 2)),
        dashpot=dashpot,
        force=force,
        point=point,
        total=np.zeros((model.mass.size, 3)),
        sums=np.zeros(len(Sum)),
        moved=np.zeros(1),
    )


@inlined
def _contact_frame(j, k, work, rounding):
    """Tangent of a contact, its gap, and where it acts; tx, ty, gap, px, py."""
    ax = work.tangent[j, BEFORE, 0]
    ay = work.tangent[j, BEFORE, 1]
    bx = work.tangent[j, AFTER, 0]
    by = work.tangent[j, AFTER, 1]
    ex = work.face[j, BEFORE, k, 0]
    ey = work.face[j, BEFORE, k, 1]
    dx = work.face[j, AFTER, k, 0] - ex
    dy = work.face[j, AFTER, k, 1] - ey
    mx = ax + bx
    my = ay + by
    square = mx * mx + my * my
    if square < 1e-12:
        mx = ax
        my = ay
        square = 1.0
    norm = 1.0 / math.sqrt(square)
    mx = mx * norm
    my = my * norm
    passed = min(max((mx * dx + my * dy) / rounding, -1.0), 1.0)
    weight = 0.5 + (0.5 - k) * passed
    tx = weight * ax + (1.0 - weight) * bx
    ty = weight * ay + (1.0 - weight) * by
    norm = 1.0 / math.sqrt(tx * tx + ty * ty)
    tx = tx * norm
    ty = ty * norm
    # What makes the normal the gradient of the gap, in both slip and rotation.
    arc = (0.5 - k) * 0.5 * rounding * (1.0 - passed * passed)
    gap = ty * dx - tx * dy + arc * ((ay - by) * mx - (ax - bx) * my)
    return tx, ty, gap, ex + weight * dx + arc * tx, ey + weight * dy + arc * ty


@inlined
def _corner_rates(j, tx, ty, px, py, position, state):
    """Parting and tangential velocity of the faces of joint j at a point."""
    x = position
    v = state.velocity
    ux = v[j + 1, 0] - v[j + 1, 2] * (py - x[j + 1, 1])
    ux -= v[j, 0] - v[j, 2] * (py - x[j, 1])
    uy = v[j + 1, 1] + v[j + 1, 2] * (px - x[j + 1, 0])
    uy -= v[j, 1] + v[j, 2] * (px - x[j, 0])
    return ty * ux - tx * uy, tx * ux + ty * uy


@inlined
def _law(kn, ks, friction, damping, gap, corner_rate, sliding, shear):
    """Forces of a contact that overlaps: springs without tension, dashpots, Coulomb's limit.

    Returns normal, tangential, shear, slide.
    """
    normal = max(-kn * gap - damping * kn * corner_rate, 0.0)
    tangential = shear - damping * ks * sliding
    slide = 0.0
    if abs(tangential) > friction * normal:
        slide = 1.0 if tangential > 0.0 else -1.0
        # The dashpot yields first: it must not load the spring.
        shear = min(max(shear, -friction * normal), friction * normal)
        tangential = slide * friction * normal
    return normal, tangential, shear, slide


@inlined
def _add_force(j, k, fx, fy, position, springs):
    """Put the force of a contact on the bodies on either side."""
    springs.force[j, k, 0] = fx
    springs.force[j, k, 1] = fy
    for side in range(2):
        sign = 2.0 * side - 1.0
        total = springs.total[j + side]
        px = springs.point[j, k, 0] - position[j + side, 0]
        py = springs.point[j, k, 1] - position[j + side, 1]
        total[0] += sign * fx
        total[1] += sign * fy
        total[2] += sign * (px * fy - py * fx)


@kernel
def press_joints(model, state, work, springs, step):
    """Forces of all joints at the end of a step, into `springs`; modes into `work`."""
    sums = springs.sums
    contact = work.contact
    springs.total[:, :] = 0.0
    sums[Sum.ELASTIC] = 0.0
    for j in range(contact.shape[0]):
        kn = springs.normal_stiffness[j]
        ks = springs.shear_stiffness[j]
        slides = (0.0, 0.0)
        for k in range(2):
            tx, ty, gap, px, py = _contact_frame(j, k, work, springs.rounding[j])
            normal = tangential = shear = slide = spring = 0.0
            if gap >= 0.0 and contact[j, k] == 0.0:
                continue
            springs.point[j, k, 0] = px
            springs.point[j, k, 1] = py
            corner_rate, sliding = _corner_rates(
                j, tx, ty, px, py, work.position, state
            )
            before = springs.shear[j, k]
            dashpot = springs.dashpot[j, k]
            contact[j, k] = 1.0 if gap < 0.0 else 0.0
            if gap < 0.0:
                spring = -kn * gap
                normal, tangential, shear, slide = _law(
                    kn,
                    ks,
                    model.friction[j],
                    springs.damping,
                    gap,
                    corner_rate,
                    sliding,
                    before - ks * sliding * step,
                )
                sums[Sum.ELASTIC] += 0.5 * (kn * gap * gap + shear * shear / ks)
            slides = (slide, slides[1]) if k == 0 else (slides[0], slide)
            fx = normal * ty + tangential * tx
            fy = tangential * ty - normal * tx
            _add_force(j, k, fx, fy, work.position, springs)
            # By the trapezoidal rule, with which central differences balance energy.
            slip = sliding * step + (shear - before) / ks
            sums[Sum.FRICTION] += 0.5 * (shear + before) * slip
            sums[Sum.DAMPING] += (
                0.5 * (dashpot[0] + normal - spring) * corner_rate * step
            )
            sums[Sum.DAMPING] += (
                0.5 * (dashpot[1] + tangential - shear) * sliding * step
            )
            springs.shear[j, k] = shear
            dashpot[0] = normal - spring
            dashpot[1] = tangential - shear
        first = slides[0] if contact[j, 0] > 0.5 else slides[1]
        second = slides[1] if contact[j, 1] > 0.5 else first
        work.slide[j] = first if first == second else 0.0


@kernel
def corner_gradients(state, work, springs, row):
    """Parting and tangential velocity at each corner by the bodies' coordinates."""
    for j in range(row.shape[0]):
        for k in range(2):
            tx, ty, _, px, py = _contact_frame(j, k, work, springs.rounding[j])
            write_rows(j, ty, -tx, px, py, state.position, row[j, k])


def stiffness_matrix(
    model: Model, state: State, work: Work, springs: Springs, part: np.ndarray
) -> np.ndarray:
    """Elastic stiffness of the joints about a configuration, (3 n_body, 3 n_body)."""
    n_joint = model.length.size
    row = np.zeros((n_joint, 2, 2, 6))
    corner_gradients(state, work, springs, row)
    stiffness = np.stack([springs.normal_stiffness, springs.shear_stiffness], axis=1)
    stiffness = stiffness[:, None] * part[..., None]
    block = np.einsum("jkap,jka,jkaq->jpq", row, stiffness, row)
    stiffness = np.zeros((3 * model.mass.size, 3 * model.mass.size))
    for j in range(n_joint):
        stiffness[3 * j : 3 * j + 6, 3 * j : 3 * j + 6] += block[j]
    return stiffness[3:-3, 3:-3]


def highest_frequency(
    model: Model, state: State, work: Work, springs: Springs
) -> float:
    """Highest circular frequency of a chain with all its corners touching [rad/s].

    Fewer contacts only lower it (Rayleigh).
    """
    root = np.sqrt(
        np.stack([model.mass, model.mass, model.inertia], axis=1)[1:-1]
    ).ravel()
    stiffness = stiffness_matrix(
        model, state, work, springs, np.ones(work.contact.shape)
    )
    return float(np.sqrt(np.linalg.eigvalsh(stiffness / np.outer(root, root))[-1]))
