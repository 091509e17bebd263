"""The slow twin of joints that give: explicit springs at many points of each joint.

Each point has a normal spring without tension, a shear spring and dashpots, and slides by
Coulomb's law of its own. Bodies move by central differences, with steps a part of the critical
one. With more points a joint tends to the elastic face of `archfrag.physics.steps.face_law`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from archfrag.physics.interface import Chain
from archfrag.physics.status import Joint

# Of the critical step; damping of the mass while the weight is put on, over that of a mode as
# slow as the first one can be; time of that, in periods of the first mode.
FRACTION = 0.5
RELAXING = 1.4
PERIODS = 20.0


class Springs(NamedTuple):
    """Points of all joints: from the centroids of both bodies, and what each of them bears."""

    arm: (
        np.ndarray
    )  # (2, n_joint, n_point, 2) before and after, in the frames of the bodies [m]
    tangent: np.ndarray  # (n_joint, 2)
    normal: np.ndarray  # (n_joint, n_point) stiffness [N/m]
    shear: np.ndarray  # (n_joint, n_point) [N/m]


def springs_of(chain: Chain, n_point: int) -> Springs:
    """Return points evenly spread over each joint, those at the ends with half of a share."""
    assert chain.joint is not None
    share = np.ones(n_point)
    share[[0, -1]] = 0.5
    share /= share.sum()
    place = np.linspace(0.0, 1.0, n_point)[None, :, None]
    faces = np.stack([chain.face_before, chain.face_after])
    arm = faces[:, :, None, 0] + place * (faces[:, :, None, 1] - faces[:, :, None, 0])
    along = faces[0, :, 1] - faces[0, :, 0]
    length = np.hypot(*along.T)
    normal, shear = (
        chain.joint[:, column, None] * length[:, None] * share
        for column in (Joint.STIFFNESS, Joint.SHEAR)
    )
    return Springs(arm, along / length[:, None], normal, shear)


def frequencies(chain: Chain, springs: Springs) -> np.ndarray:
    """Return the circular frequencies with all points in contact, in ascending order [rad/s]."""
    n_body, (tx, ty) = chain.mass.size, springs.tangent.T
    root = np.sqrt(np.stack([chain.mass, chain.mass, chain.inertia], axis=1))
    total = np.zeros((3 * n_body, 3 * n_body))
    for j, p in np.ndindex(springs.normal.shape):
        for (dx, dy), k in (
            ((ty[j], -tx[j]), springs.normal),
            ((tx[j], ty[j]), springs.shear),
        ):
            row = np.zeros((n_body + 2, 3))
            for side, sign in enumerate((-1.0, 1.0)):
                x, y = springs.arm[side, j, p]
                row[j + side] = sign * dx, sign * dy, sign * (x * dy - y * dx)
            scaled = (row[1 : n_body + 1] / root).ravel()
            total += k[j, p] * np.outer(scaled, scaled)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(total), 0.0))


class ManyPoints:
    """A chain on its springs, brought to rest under its weight."""

    def __init__(self, chain: Chain, n_point: int, delay: float) -> None:
        self.chain = chain
        self.springs = springs_of(chain, n_point)
        self.delay = delay
        self.own = frequencies(chain, self.springs)
        ratio = 0.5 * delay * self.own[-1]
        self.step = (
            FRACTION * 2.0 / self.own[-1] * (math.sqrt(1.0 + ratio * ratio) - ratio)
        )
        self.mass = np.stack([chain.mass, chain.mass, chain.inertia], axis=1)
        self.position = np.zeros((chain.mass.size + 2, 3))
        self.position[1:-1, :2] = chain.centroid
        self.velocity = np.zeros_like(self.position)
        self.slip = np.zeros(self.springs.normal.shape)
        steps = math.ceil(PERIODS * 2.0 * math.pi / self.own[0] / self.step)
        for _ in range(steps):
            self._advance(0.0, RELAXING * self.own[0])
        self.velocity[:] = 0.0

    def _forces(self) -> np.ndarray:
        """Return the forces and moments of all joints on the bodies, (n_body, 3)."""
        x = self.position
        v = self.velocity
        of = self.springs
        cosine = np.cos(x[:, 2])
        sine = np.sin(x[:, 2])
        points = []
        rates = []
        n_joint = len(of.tangent)
        half = 0.5 * (x[:n_joint, 2] + x[1 : n_joint + 1, 2])
        tx = np.cos(half) * of.tangent[:, 0] - np.sin(half) * of.tangent[:, 1]
        ty = np.sin(half) * of.tangent[:, 0] + np.cos(half) * of.tangent[:, 1]
        for side in range(2):
            rows = slice(side, n_joint + side)
            c = cosine[rows, None]
            s = sine[rows, None]
            ax = of.arm[side, ..., 0]
            ay = of.arm[side, ..., 1]
            points.append(
                np.stack([c * ax - s * ay, s * ax + c * ay], axis=-1)
                + x[rows, None, :2]
            )
        where = 0.5 * (points[0] + points[1])
        for side in range(2):
            rows = slice(side, n_joint + side)
            arm = where - x[rows, None, :2]
            turned = np.stack([-arm[..., 1], arm[..., 0]], axis=-1) * v[rows, None, 2:]
            rates.append(v[rows, None, :2] + turned)
        apart = points[1] - points[0]
        rate = rates[1] - rates[0]
        gap = apart[..., 0] * ty[:, None] - apart[..., 1] * tx[:, None]
        opens = rate[..., 0] * ty[:, None] - rate[..., 1] * tx[:, None]
        slides = rate[..., 0] * tx[:, None] + rate[..., 1] * ty[:, None]
        friction = np.minimum(self.chain.friction, 1e6)[:, None]
        press = np.where(
            gap < 0.0, np.maximum(-of.normal * (gap + self.delay * opens), 0.0), 0.0
        )
        spring = np.where(gap < 0.0, -of.normal * gap, 0.0)
        slip = self.slip + self.step * slides
        along = np.clip(
            -of.shear * (slip + self.delay * slides),
            -friction * press,
            friction * press,
        )
        most = friction * spring / of.shear
        self.slip = np.where(gap < 0.0, np.clip(slip, -most, most), 0.0)
        force = np.stack(
            [
                press * ty[:, None] + along * tx[:, None],
                along * ty[:, None] - press * tx[:, None],
            ],
            axis=-1,
        )
        total = np.zeros_like(x)
        for side, sign in enumerate((-1.0, 1.0)):
            rows = slice(side, n_joint + side)
            arm = where - x[rows, None, :2]
            moment = (arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]).sum(
                axis=1
            )
            total[rows, :2] += sign * force.sum(axis=1)
            total[rows, 2] += sign * moment
        return total[1:-1]

    def _advance(self, ground: float, damping: float = 0.0) -> None:
        """Make one step under a ground acceleration [m/s2]."""
        change = self._forces() / self.mass
        change[:, 0] -= ground
        change[:, 1] -= self.chain.gravity
        self.velocity[1:-1] = (1.0 - damping * self.step) * self.velocity[
            1:-1
        ] + self.step * change
        self.position += self.step * self.velocity

    def shake(
        self, ground: Callable[[float], float], duration: float, apart: float
    ) -> np.ndarray:
        """Return positions every `apart` [s] under a ground acceleration, (n, n_body, 3)."""
        found = [self.position[1:-1].copy()]
        steps = math.ceil(duration / self.step)
        for k in range(steps):
            self._advance(ground((k + 0.5) * self.step))
            if (k + 1) * self.step >= len(found) * apart:
                found.append(self.position[1:-1].copy())
        return np.array(found)
