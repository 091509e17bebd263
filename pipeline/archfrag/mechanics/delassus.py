"""Linear algebra of a chain's joints: the Delassus operator and its factorisation.

For given modes of the joints the contact problem is linear. The bodies are eliminated and what
remains is block-tridiagonal in the joints, at most 3 x 3 a block: two normal forces and one
shear force at a closed joint, one force at a corner of an open one. It is factorised directly,
at a cost proportional to the number of joints.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.laws import (
    CLOSED_STICK,
    MINUS,
    OPEN,
    STICK,
    friction_ray,
    is_closed,
    slip_of,
    touches,
)

TOLERANCE = 1e-11
MAX_REFINEMENTS = 6


class Contacts(NamedTuple):
    """Where and how the joints of a chain may touch, at one instant."""

    centroid: np.ndarray  # (n_body, 2) ground frame [m]
    point: np.ndarray  # (n_joint, 2, 2) corner, xy: contact points [m]
    normal: np.ndarray  # (n_joint, 2) common normal of a closed joint [1]
    normal_plus: np.ndarray  # (n_joint, 2, 2) corner, xy: normal for slip PLUS [1]
    normal_minus: np.ndarray  # (n_joint, 2, 2) corner, xy: normal for slip MINUS [1]
    candidate: np.ndarray  # (n_joint, 2) int8: 1 where the corner may touch
    slip: np.ndarray  # (n_joint,) int8: sense of a slip under way, 0 if it is not known
    bias: np.ndarray  # (n_joint, 2, 2) corner, xy: added to the relative velocity [w]


class ContactWork(NamedTuple):
    """Room for one contact problem; what it holds on return is the solution."""

    velocity: np.ndarray  # (n_body, 3) w: x, y, rotation
    reaction: np.ndarray  # (n_joint, 3) on the body after the joint: x, y, moment about `pivot`
    mode: np.ndarray  # (n_joint,) int8
    pivot: np.ndarray  # (n_joint, 2) middle of the contact points
    relative: np.ndarray  # (n_joint, 3) relative velocity at the pivot, without bias
    delassus: np.ndarray  # (n_joint, 3, 3) diagonal blocks, unit forces at the pivots
    coupling: np.ndarray  # (n_joint, 3, 3) block of joint j with joint j + 1
    size: np.ndarray  # (n_joint,) rows of the present mode
    row: np.ndarray  # (n_joint, 3, 3) constrained directions of the present mode
    column: np.ndarray  # (n_joint, 3, 3) reaction directions of the present mode
    factor: np.ndarray  # (n_joint, 3, 3) factorised blocks, reciprocals on the diagonal
    exchange: np.ndarray  # (n_joint, 3) int8: row exchanges of the factorisation
    lower: np.ndarray  # (n_joint, 3, 3) block of joint j with joint j - 1, in the modes
    upper: np.ndarray  # (n_joint, 3, 3) eliminated block of joint j with joint j + 1
    unknown: np.ndarray  # (n_joint, 3) multipliers of the present mode
    rest: np.ndarray  # (n_joint, 3) what the constrained directions still move
    best_mode: np.ndarray  # (n_joint,) int8


@allocating
def contact_work(n_body, n_joint):
    """Allocate the room that `solve_contact` needs.

    Parameters
    ----------
    n_body, n_joint : int
        Numbers of bodies and joints.

    Returns
    -------
    ContactWork
        Zeros; modes OPEN.
    """
    block = (n_joint, 3, 3)
    return ContactWork(
        np.zeros((n_body, 3)),
        np.zeros((n_joint, 3)),
        np.zeros(n_joint, np.int8),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 3)),
        np.zeros(block),
        np.zeros(block),
        np.zeros(n_joint, np.int64),
        np.zeros(block),
        np.zeros(block),
        np.zeros(block),
        np.zeros((n_joint, 3), np.int8),
        np.zeros(block),
        np.zeros(block),
        np.zeros((n_joint, 3)),
        np.zeros((n_joint, 3)),
        np.zeros(n_joint, np.int8),
    )


@kernel
def assemble(mass, inertia, contacts, work):
    """Inverse inertia seen at the joints (Delassus operator) for unit wrenches at the pivots."""
    n_body = mass.size
    n_joint = work.mode.size
    for j in range(n_joint):
        work.pivot[j, 0] = 0.5 * (contacts.point[j, 0, 0] + contacts.point[j, 1, 0])
        work.pivot[j, 1] = 0.5 * (contacts.point[j, 0, 1] + contacts.point[j, 1, 1])
    for j in range(n_joint):
        block = work.delassus[j]
        block[:] = 0.0
        for body in (j - 1, j):
            if 0 <= body < n_body:
                rx = work.pivot[j, 0] - contacts.centroid[body, 0]
                ry = work.pivot[j, 1] - contacts.centroid[body, 1]
                im = 1.0 / mass[body]
                ii = 1.0 / inertia[body]
                block[0, 0] += im + ry * ry * ii
                block[0, 1] -= rx * ry * ii
                block[0, 2] -= ry * ii
                block[1, 1] += im + rx * rx * ii
                block[1, 2] += rx * ii
                block[2, 2] += ii
        block[1, 0] = block[0, 1]
        block[2, 0] = block[0, 2]
        block[2, 1] = block[1, 2]
        if j + 1 < n_joint:
            rx = work.pivot[j, 0] - contacts.centroid[j, 0]
            ry = work.pivot[j, 1] - contacts.centroid[j, 1]
            sx = work.pivot[j + 1, 0] - contacts.centroid[j, 0]
            sy = work.pivot[j + 1, 1] - contacts.centroid[j, 1]
            im = 1.0 / mass[j]
            ii = 1.0 / inertia[j]
            block = work.coupling[j]
            block[0, 0] = -im - ry * sy * ii
            block[0, 1] = ry * sx * ii
            block[0, 2] = ry * ii
            block[1, 0] = rx * sy * ii
            block[1, 1] = -im - rx * sx * ii
            block[1, 2] = -rx * ii
            block[2, 0] = sy * ii
            block[2, 1] = -sx * ii
            block[2, 2] = -ii


@inlined
def _set_direction(out, j, k, px, py, dx, dy):
    out[j, k, 0] = dx
    out[j, k, 1] = dy
    out[j, k, 2] = px * dy - py * dx


@kernel
def set_rows(contacts, friction, work):
    """Constrained and reaction directions of all joints in their present modes."""
    row, column = work.row, work.column
    for j in range(work.mode.size):
        mode = work.mode[j]
        if mode == OPEN:
            work.size[j] = 0
            continue
        slip = slip_of(mode)
        px = contacts.point[j, 0, 0] - work.pivot[j, 0]
        py = contacts.point[j, 0, 1] - work.pivot[j, 1]
        if is_closed(mode):
            nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
            _set_direction(row, j, 0, px, py, nx, ny)
            _set_direction(row, j, 1, -px, -py, nx, ny)
            fx = fy = 0.0
            if slip == STICK:
                _set_direction(row, j, 2, 0.0, 0.0, -ny, nx)
                work.size[j] = 3
            else:
                work.size[j] = 2
                fx, fy = -slip * friction[j] * ny, slip * friction[j] * nx
            for k in range(work.size[j]):
                column[j, k, 0] = row[j, k, 0] + fx
                column[j, k, 1] = row[j, k, 1] + fy
                column[j, k, 2] = row[j, k, 2]
            continue
        corner = 0 if touches(mode, 0) else 1
        if corner == 1:
            px, py = -px, -py
        if slip == MINUS:
            nx, ny = contacts.normal_minus[j, corner, 0], contacts.normal_minus[j, corner, 1]
        else:
            nx, ny = contacts.normal_plus[j, corner, 0], contacts.normal_plus[j, corner, 1]
        _set_direction(row, j, 0, px, py, nx, ny)
        if slip == STICK:
            _set_direction(row, j, 1, px, py, -ny, nx)
            work.size[j] = 2
            for k in range(2):
                for c in range(3):
                    column[j, k, c] = row[j, k, c]
        else:
            fx, fy = friction_ray(nx, ny, friction[j], slip)
            _set_direction(column, j, 0, px, py, fx, fy)
            work.size[j] = 1


@inlined
def _project(row, block, column, n_row, n_column, transpose, out):
    for a in range(n_row):
        if transpose:
            t0 = row[a, 0] * block[0, 0] + row[a, 1] * block[0, 1] + row[a, 2] * block[0, 2]
            t1 = row[a, 0] * block[1, 0] + row[a, 1] * block[1, 1] + row[a, 2] * block[1, 2]
            t2 = row[a, 0] * block[2, 0] + row[a, 1] * block[2, 1] + row[a, 2] * block[2, 2]
        else:
            t0 = row[a, 0] * block[0, 0] + row[a, 1] * block[1, 0] + row[a, 2] * block[2, 0]
            t1 = row[a, 0] * block[0, 1] + row[a, 1] * block[1, 1] + row[a, 2] * block[2, 1]
            t2 = row[a, 0] * block[0, 2] + row[a, 1] * block[1, 2] + row[a, 2] * block[2, 2]
        for b in range(n_column):
            out[a, b] = t0 * column[b, 0] + t1 * column[b, 1] + t2 * column[b, 2]


@inlined
def _factorise_block(f, exchange, n):
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(f[i, k]) > abs(f[p, k]):
                p = i
        exchange[k] = p
        if p != k:
            for c in range(n):
                f[k, c], f[p, c] = f[p, c], f[k, c]
        if f[k, k] == 0.0:
            return False
        f[k, k] = 1.0 / f[k, k]
        for i in range(k + 1, n):
            f[i, k] *= f[k, k]
            for c in range(k + 1, n):
                f[i, c] -= f[i, k] * f[k, c]
    return True


@inlined
def _solve_block(f, exchange, n, x0, x1, x2):
    if n == 3:
        p = exchange[0]
        if p == 1:
            x0, x1 = x1, x0
        elif p == 2:
            x0, x2 = x2, x0
        if exchange[1] == 2:
            x1, x2 = x2, x1
        x1 -= f[1, 0] * x0
        x2 -= f[2, 0] * x0 + f[2, 1] * x1
        x2 *= f[2, 2]
        x1 = (x1 - f[1, 2] * x2) * f[1, 1]
        x0 = (x0 - f[0, 1] * x1 - f[0, 2] * x2) * f[0, 0]
    elif n == 2:
        if exchange[0] == 1:
            x0, x1 = x1, x0
        x1 -= f[1, 0] * x0
        x1 *= f[1, 1]
        x0 = (x0 - f[0, 1] * x1) * f[0, 0]
    elif n == 1:
        x0 *= f[0, 0]
    return x0, x1, x2


@kernel
def factorise(work, compliance):
    """Block-tridiagonal factorisation for the present modes; False if a pivot vanishes."""
    n_joint = work.mode.size
    for j in range(n_joint):
        n = work.size[j]
        f = work.factor[j]
        _project(work.row[j], work.delassus[j], work.column[j], n, n, False, f)
        for a in range(n):
            r = work.row[j, a]
            d = work.delassus[j]
            f[a, a] += compliance * (
                r[0] * (r[0] * d[0, 0] + 2.0 * r[1] * d[0, 1] + 2.0 * r[2] * d[0, 2])
                + r[1] * (r[1] * d[1, 1] + 2.0 * r[2] * d[1, 2])
                + r[2] * r[2] * d[2, 2]
            )
        if j > 0:
            m = work.size[j - 1]
            if m > 0 and n > 0:
                low = work.lower[j]
                up = work.upper[j - 1]
                _project(work.row[j], work.coupling[j - 1], work.column[j - 1], n, m, True, low)
                for a in range(n):
                    for b in range(n):
                        s = 0.0
                        for c in range(m):
                            s += low[a, c] * up[c, b]
                        f[a, b] -= s
        if not _factorise_block(f, work.exchange[j], n):
            return False
        if j + 1 < n_joint:
            m = work.size[j + 1]
            if m > 0 and n > 0:
                up = work.upper[j]
                _project(work.row[j], work.coupling[j], work.column[j + 1], n, m, False, up)
                for b in range(m):
                    x0, x1, x2 = up[0, b], up[1, b], up[2, b]
                    x0, x1, x2 = _solve_block(f, work.exchange[j], n, x0, x1, x2)
                    up[0, b], up[1, b], up[2, b] = x0, x1, x2
    return True


@kernel
def substitute(work, increment):
    """Solve the factorised system for the right-hand side ``-work.rest``."""
    n_joint = work.mode.size
    rest = work.rest
    for j in range(n_joint):
        n = work.size[j]
        x0, x1, x2 = -rest[j, 0], -rest[j, 1], -rest[j, 2]
        if j > 0 and n > 0:
            m = work.size[j - 1]
            low = work.lower[j]
            for b in range(m):
                z = increment[j - 1, b]
                x0 -= low[0, b] * z
                if n > 1:
                    x1 -= low[1, b] * z
                if n > 2:
                    x2 -= low[2, b] * z
        x0, x1, x2 = _solve_block(work.factor[j], work.exchange[j], n, x0, x1, x2)
        increment[j, 0], increment[j, 1], increment[j, 2] = x0, x1, x2
    for j in range(n_joint - 2, -1, -1):
        n = work.size[j]
        up = work.upper[j]
        for b in range(work.size[j + 1]):
            z = increment[j + 1, b]
            for a in range(n):
                increment[j, a] -= up[a, b] * z


@kernel
def apply_reactions(mass, inertia, contacts, free_velocity, work):
    """Velocities of the bodies, and relative ones at the pivots, from the joint reactions."""
    n_body = mass.size
    n_joint = work.mode.size
    for body in range(n_body):
        fx = work.reaction[body, 0]
        fy = work.reaction[body, 1]
        rx = work.pivot[body, 0] - contacts.centroid[body, 0]
        ry = work.pivot[body, 1] - contacts.centroid[body, 1]
        m = work.reaction[body, 2] + rx * fy - ry * fx
        if body + 1 < n_joint:
            gx = work.reaction[body + 1, 0]
            gy = work.reaction[body + 1, 1]
            rx = work.pivot[body + 1, 0] - contacts.centroid[body, 0]
            ry = work.pivot[body + 1, 1] - contacts.centroid[body, 1]
            fx -= gx
            fy -= gy
            m -= work.reaction[body + 1, 2] + rx * gy - ry * gx
        work.velocity[body, 0] = free_velocity[body, 0] + fx / mass[body]
        work.velocity[body, 1] = free_velocity[body, 1] + fy / mass[body]
        work.velocity[body, 2] = free_velocity[body, 2] + m / inertia[body]
    relative_velocity(contacts, work.velocity, work.pivot, work.relative)


@kernel
def relative_velocity(contacts, velocity, pivot, out):
    """Velocity of the body after each joint relative to the one before it, at `pivot`.

    Parameters
    ----------
    contacts : Contacts
    velocity : ndarray, (n_body, 3)
    pivot : ndarray, (n_joint, 2) [m]
    out : ndarray, (n_joint, 3)
        Overwritten: x, y, rotation.
    """
    n_body = velocity.shape[0]
    for j in range(pivot.shape[0]):
        ux = uy = uw = 0.0
        if j < n_body:
            w = velocity[j, 2]
            ux = velocity[j, 0] - w * (pivot[j, 1] - contacts.centroid[j, 1])
            uy = velocity[j, 1] + w * (pivot[j, 0] - contacts.centroid[j, 0])
            uw = w
        if j > 0:
            w = velocity[j - 1, 2]
            ux -= velocity[j - 1, 0] - w * (pivot[j, 1] - contacts.centroid[j - 1, 1])
            uy -= velocity[j - 1, 1] + w * (pivot[j, 0] - contacts.centroid[j - 1, 0])
            uw -= w
        out[j, 0] = ux
        out[j, 1] = uy
        out[j, 2] = uw


@inlined
def corner_velocity(j, corner, contacts, work):
    """Relative velocity with bias of the two faces at a corner."""
    px = contacts.point[j, corner, 0] - work.pivot[j, 0]
    py = contacts.point[j, corner, 1] - work.pivot[j, 1]
    ux = work.relative[j, 0] - work.relative[j, 2] * py + contacts.bias[j, corner, 0]
    uy = work.relative[j, 1] + work.relative[j, 2] * px + contacts.bias[j, corner, 1]
    return ux, uy


@kernel
def constrained_rest(contacts, work):
    """What the constrained directions still move, into ``work.rest``; its largest magnitude."""
    largest = 0.0
    rest = work.rest
    for j in range(work.mode.size):
        mode = work.mode[j]
        rest[j, 0] = rest[j, 1] = rest[j, 2] = 0.0
        if mode == OPEN:
            continue
        if is_closed(mode):
            nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
            ux, uy = corner_velocity(j, 0, contacts, work)
            vx, vy = corner_velocity(j, 1, contacts, work)
            rest[j, 0] = nx * ux + ny * uy
            rest[j, 1] = nx * vx + ny * vy
            if mode == CLOSED_STICK:
                rest[j, 2] = 0.5 * (nx * (uy + vy) - ny * (ux + vx))
        else:
            corner = 0 if touches(mode, 0) else 1
            ux, uy = corner_velocity(j, corner, contacts, work)
            nx, ny = work.row[j, 0, 0], work.row[j, 0, 1]
            rest[j, 0] = nx * ux + ny * uy
            if slip_of(mode) == STICK:
                rest[j, 1] = nx * uy - ny * ux
        for a in range(work.size[j]):
            largest = max(largest, abs(rest[j, a]))
    return largest


@kernel
def solve_modes(mass, inertia, contacts, friction, free_velocity, work, scale, compliance, exact):
    """Solve the linear problem of the present modes.

    Returns
    -------
    float
        Largest constrained velocity left; inf if the factorisation broke down.
    """
    n_joint = work.mode.size
    set_rows(contacts, friction, work)
    for j in range(n_joint):
        work.reaction[j, 0] = work.reaction[j, 1] = work.reaction[j, 2] = 0.0
    if not factorise(work, compliance):
        return np.inf
    relative_velocity(contacts, free_velocity, work.pivot, work.relative)
    left = constrained_rest(contacts, work)
    for _ in range(MAX_REFINEMENTS if exact else 1):
        substitute(work, work.unknown)
        for j in range(n_joint):
            for a in range(work.size[j]):
                x = work.unknown[j, a]
                for c in range(3):
                    work.reaction[j, c] += x * work.column[j, a, c]
        apply_reactions(mass, inertia, contacts, free_velocity, work)
        before = left
        left = constrained_rest(contacts, work)
        if left <= 0.1 * TOLERANCE * scale or not left < before:
            break
    return left


@kernel
def velocity_scale(contacts, free_velocity, work):
    """Largest relative velocity with bias that the joints would have without reactions."""
    relative_velocity(contacts, free_velocity, work.pivot, work.relative)
    scale = 0.0
    for j in range(work.mode.size):
        for corner in range(2):
            if contacts.candidate[j, corner]:
                px = contacts.point[j, corner, 0] - work.pivot[j, 0]
                py = contacts.point[j, corner, 1] - work.pivot[j, 1]
                ux = work.relative[j, 0] - work.relative[j, 2] * py
                uy = work.relative[j, 1] + work.relative[j, 2] * px
                scale = max(scale, abs(ux), abs(uy))
    return scale
