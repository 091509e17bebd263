"""Arches in motion on four hinges: their configurations."""

from typing import NamedTuple

import numpy as np

from archbench.paper.arch import cross, mechanism_of, rotated
from tests.mechanics.adapters import CLOSED, Mode


class Hinged(NamedTuple):
    """An arch of which four hinges have opened, rigid between them."""

    position: np.ndarray  # (n, 3) centroid, rotation
    velocity: np.ndarray  # (n, 3)
    modes: list  # of its joints
    joints: list  # of its hinges
    hinge: np.ndarray  # (4, 2) where they are
    bodies: list  # voussoirs of each of the three bodies


def rotate(vector, angle):
    c, s = np.cos(angle), np.sin(angle)
    return c * vector + s * rotated(vector)


def joined(chain, voussoirs, position):
    """Mass, inertia and centroid of voussoirs that move as one."""
    m = chain.mass[voussoirs]
    centroid = m @ position[voussoirs, :2] / m.sum()
    arm = position[voussoirs, :2] - centroid
    return m.sum(), (chain.inertia[voussoirs] + m * (arm**2).sum(1)).sum(), centroid


def hinged_arch(arch, hinges, tilt, rate):
    """Arch whose first body between hinges (joint, corner) has rotated, and rotates, by so much.

    None where the hinges would have to close meanwhile.
    """
    joints, corners = zip(*hinges)
    rest = np.array([(arch.intrados, arch.extrados)[c][j] for j, c in hinges])
    angle = np.array([tilt, 0.0, 0.0])
    for _ in range(30):  # closure of the linkage: two equations for two rotations
        arms = [rotate(rest[k + 1] - rest[k], angle[k]) for k in range(3)]
        gap = sum(arms) - (rest[3] - rest[0])
        step = np.linalg.solve(np.column_stack([rotated(arms[1]), rotated(arms[2])]), -gap)
        angle[1:] += step
    if np.abs(gap).max() > 1e-12 or np.abs(angle).max() > 0.3:
        return None
    opened = np.diff([0.0, *angle, 0.0])
    if any((by > 0.0) != (corner == 1) for by, corner in zip(opened, corners)):
        return None
    hinge = rest[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(arms, axis=0)])
    chain = arch.chain
    position = np.column_stack([chain.centroid, np.zeros(chain.mass.size)])
    bodies = [np.arange(joints[k], joints[k + 1]) for k in range(3)]
    for k, body in enumerate(bodies):
        position[body, :2] = hinge[k] + rotate(chain.centroid[body] - rest[k], angle[k])
        position[body, 2] = angle[k]
    centroid = np.array([joined(chain, body, position)[2] for body in bodies])
    motion = rate * mechanism_of(centroid, hinge)
    velocity = np.zeros_like(position)
    for k, body in enumerate(bodies):
        arm = position[body, :2] - centroid[k]
        velocity[body, :2] = motion[k, :2] + motion[k, 2] * rotated(arm)
        velocity[body, 2] = motion[k, 2]
    modes = [CLOSED] * chain.friction.size
    for joint, corner in hinges:
        modes[joint] = Mode((corner,))
    return Hinged(position, velocity, modes, list(joints), hinge, bodies)


def random_hinged_arch(rng, make):
    """An arch by ``make(voussoirs)`` on four hinges, alternating between its edges."""
    while True:
        arch = make(int(rng.integers(4, 21)))
        joints = np.sort(rng.choice(arch.n_joint, 4, replace=False))
        first = int(rng.integers(2))
        hinges = [(int(j), (first + k) % 2) for k, j in enumerate(joints)]
        tilt = 10.0 ** rng.uniform(-3.5, -1.7) * (1.0 if first == 1 else -1.0)
        lines = [
            (arch.intrados, arch.extrados)[c][j] - (arch.intrados, arch.extrados)[d][i]
            for (i, d), (j, c) in (hinges[:2], hinges[2:])
        ]
        if abs(cross(*lines)) < 0.2 * np.linalg.norm(lines[0]) * np.linalg.norm(lines[1]):
            continue
        state = hinged_arch(arch, hinges, tilt, rng.uniform(-0.5, 0.5))
        if state is not None:
            return arch, state
