"""States of arches: in motion on four hinges, resting, sliding, at impact."""

from itertools import pairwise

import numpy as np

import archfrag as af
from archbench.paper.arch import cross, mechanism_of, rotated
from archfrag.physics.contact.placing import move_faces, place_contacts
from archfrag.physics.state import model_of, new_work
from tests.physics.adapters import CLOSED, Mode, Problem, set_modes

KINDS = ("resting", "hinged", "sliding", "impact")


def rotate(vector, angle):
    c = np.cos(angle)
    s = np.sin(angle)
    return c * vector + s * rotated(vector)


def joined(chain, voussoirs, position):
    """Mass, inertia and centroid of voussoirs that move as one."""
    m = chain.mass[voussoirs]
    centroid = m @ position[voussoirs, :2] / m.sum()
    arm = position[voussoirs, :2] - centroid
    return m.sum(), (chain.inertia[voussoirs] + m * (arm**2).sum(1)).sum(), centroid


def hinged_arch(arch, hinges, tilt, rate):
    """Position, velocity (n, 3) and modes of an arch that is rigid between hinges (joint, corner).

    Its first body has rotated, and rotates, by so much. None where hinges would have to close.
    """
    joints, corners = zip(*hinges)
    rest = np.array([(arch.intrados, arch.extrados)[c][j] for j, c in hinges])
    angle = np.array([tilt, 0.0, 0.0])
    for _ in range(30):  # closure of the linkage: two equations for two rotations
        arms = [rotate(rest[k + 1] - rest[k], angle[k]) for k in range(3)]
        gap = sum(arms) - (rest[3] - rest[0])
        step = np.linalg.solve(
            np.column_stack([rotated(arms[1]), rotated(arms[2])]), -gap
        )
        angle[1:] += step
    if np.abs(gap).max() > 1e-12 or np.abs(angle).max() > 0.3:
        return None
    opened = np.diff([0.0, *angle, 0.0])
    if any((by > 0.0) != (corner == 1) for by, corner in zip(opened, corners)):
        return None
    hinge = rest[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(arms, axis=0)])
    chain = arch.chain
    position = np.column_stack([chain.centroid, np.zeros(chain.mass.size)])
    velocity = np.zeros_like(position)
    bodies = [slice(*ends) for ends in pairwise(joints)]
    for k, body in enumerate(bodies):
        position[body, :2] = hinge[k] + rotate(chain.centroid[body] - rest[k], angle[k])
        position[body, 2] = angle[k]
    centroid = np.array([joined(chain, body, position)[2] for body in bodies])
    motion = rate * mechanism_of(centroid, hinge)
    for k, body in enumerate(bodies):
        arm = position[body, :2] - centroid[k]
        velocity[body, :2] = motion[k, :2] + motion[k, 2] * rotated(arm)
        velocity[body, 2] = motion[k, 2]
    at = dict(hinges)
    modes = [Mode((at[j],)) if j in at else CLOSED for j in range(arch.n_joint)]
    return position, velocity, modes


def random_hinged_arch(rng, friction):
    """An arch on four hinges, alternating between its edges."""
    while True:
        voussoirs = int(rng.integers(4, 21))
        thickness = rng.uniform(1.2, 3.0)
        embrace = rng.uniform(110.0, 170.0)
        arch = af.Arch.circular(10.0, thickness, embrace, voussoirs, friction)
        joints = np.sort(rng.choice(arch.n_joint, 4, replace=False))
        first = int(rng.integers(2))
        hinges = [(int(j), (first + k) % 2) for k, j in enumerate(joints)]
        tilt = 10.0 ** rng.uniform(-3.5, -1.7) * (1.0 if first == 1 else -1.0)
        lines = [
            (arch.intrados, arch.extrados)[c][j] - (arch.intrados, arch.extrados)[d][i]
            for (i, d), (j, c) in (hinges[:2], hinges[2:])
        ]
        if abs(cross(*lines)) < 0.2 * np.linalg.norm(lines[0]) * np.linalg.norm(
            lines[1]
        ):
            continue
        state = hinged_arch(arch, hinges, tilt, rng.uniform(-0.5, 0.5))
        if state is not None:
            return arch, state


def random_ring(rng, n, mu):
    """An arch of n straight-sided voussoirs of different lengths."""
    thickness = 10.0 * rng.uniform(0.08, 0.3)
    embrace = rng.uniform(60, 180)
    cuts = np.concatenate([[0.0], rng.uniform(0.3, 1.0, n).cumsum()])
    joints = embrace * cuts / cuts[-1]
    return af.Arch.circular(
        10.0, thickness, embrace, n, mu, sector=False, joint_positions=joints
    )


def random_state(rng, n, mu, kind):
    """One contact problem of n voussoirs; the last springing follows wherever joints lead it."""
    model = model_of(random_ring(rng, n, mu).chain)
    modes = [CLOSED] * (n + 1)
    slip = np.zeros(n + 1)
    opened = np.zeros(n + 1)
    if kind != "resting":
        opened = rng.choice(
            [0, -1, 1], n + 1, p=[0.5, 0.25, 0.25]
        )  # about corner 0, about 1
        modes = [Mode(((sense + 1) // 2,)) if sense else CLOSED for sense in opened]
        opened = opened * 10 ** rng.uniform(-3, -0.7, n + 1)
    if kind == "sliding":
        slip = np.where(rng.random(n + 1) < 0.3, rng.uniform(-0.05, 0.05, n + 1), 0.0)
    work = new_work(model)
    position = np.zeros((n + 2, 3))
    before = model.corner[0, 0]
    for j, angle in enumerate(np.cumsum(opened)):
        tangent = (before[1] - before[0]) / np.linalg.norm(before[1] - before[0])
        corner = modes[j].corners[0]
        vertex = before[corner] + slip[j] * tangent
        position[j + 1, :2] = vertex - rotate(model.corner[j, 1, corner], angle)
        position[j + 1, 2] = angle
        if j < n:
            before = position[j + 1, :2] + rotate(model.corner[j + 1, 0], angle)
    work.rotated[-1] = np.cos(angle), np.sin(angle)
    move_faces(model, position, work)
    place_contacts(model, slip, work)
    set_modes(modes, work.contact, work.slide)
    work.candidate[:] = work.contact
    work.free[1:-1] = (
        rng.uniform(-9.81, 9.81),
        -9.81 * (1 + rng.uniform(-0.3, 0.3)),
        0.0,
    )
    if kind == "impact":
        work.free[1:-1] = (
            rng.normal(size=(n, 3)) * [1.0, 1.0, 0.3] * rng.uniform(0.01, 1)
        )
    return Problem(model, position, work)
