"""Static balance of voussoirs on elastic faces: rest, and the largest steady acceleration.

Faces are those of `physics.steps.face_law`, along all of their length and without sliding. Under
an acceleration that grows slowly a mechanism turns, its hinges bear on strips that narrow with the
rotation, closed joints shorten under the forces of the load, and the arch becomes flatter by both.
The largest acceleration is where all of these together cost least.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.arch.checks import FloatArray

# Residual over the mean weight of a body; Newton's iterations; displacements that a difference
# quotient takes, over the mean overlap of joints under the weight.
BALANCED = 1e-6
MOST_ITERATIONS = 10
NUDGE = 1e-3
# First displacement of the path over the mean length of joints, its growth and cuts, its most
# steps, and how far the load has to fall for the largest to be behind.
FIRST = 1e-5
QUICKER = 2.0
QUICK = 6
CUT = 0.3
MOST_STEPS = 300
PAST = 0.995
SHORTEST = 1e-4 * FIRST


class SteadyLimit(NamedTuple):
    """The largest steady acceleration in one sense."""

    load: float  # [g]; inf if it grows as far as the balance is followed
    normal: FloatArray  # (n_joint,) normal forces under it [N]


class ElasticArch:
    """Voussoirs on elastic faces without tension that do not slide.

    Parameters
    ----------
    arch : Arch
        With rigid joints, as built.
    stiffness, shear : (n_joint,) array
        Of an area of the joints [Pa/m], finite.
    """

    def __init__(self, arch: Arch, stiffness: FloatArray, shear: FloatArray) -> None:
        chain = arch.chain
        self.n_joint = chain.friction.size
        self.n_body = chain.mass.size
        self.weight = chain.mass * chain.gravity
        self.share = chain.mass / chain.mass.sum()
        self.stiffness = stiffness * arch.joint_depths
        self.shear = shear * arch.joint_depths
        along = chain.face_before[:, 1] - chain.face_before[:, 0]
        self.length = np.hypot(*along.T)
        self.tangent = along / self.length[:, None]
        # Middles of joints from the centroids of the bodies before and after (n_joint, 2, 2).
        self.arm = np.stack([chain.face_before, chain.face_after], axis=1).mean(axis=2)
        self.size = float(self.length.mean())
        overlap = self.weight.sum() / float((self.stiffness * self.length).mean())
        self.nudge = NUDGE * overlap * np.array([1.0, 1.0, 1.0 / self.size])

    def _bear(self, moved: FloatArray, closed: bool = False) -> tuple[NDArray, NDArray]:
        """Return the forces of joints on both bodies, and their normal forces.

        `moved` is the displacement of the bodies before and after each joint,
        (..., n_joint, 2, 3). Joints that are `closed` touch everywhere.
        """
        angle = moved[..., 2]
        sine = np.sin(angle)
        fall = -2.0 * np.sin(0.5 * angle) ** 2
        ax = self.arm[..., 0]
        ay = self.arm[..., 1]
        turned_x = fall * ax - sine * ay
        turned_y = sine * ax + fall * ay
        x = moved[..., 0] + turned_x
        y = moved[..., 1] + turned_y
        dx = x[..., 1] - x[..., 0]
        dy = y[..., 1] - y[..., 0]
        mean = angle.mean(axis=-1)
        bend = 0.5 * (angle[..., 1] - angle[..., 0])
        c = np.cos(mean)
        s = np.sin(mean)
        tx = c * self.tangent[:, 0] - s * self.tangent[:, 1]
        ty = s * self.tangent[:, 0] + c * self.tangent[:, 1]
        slip = tx * dx + ty * dy
        gap = ty * dx - tx * dy
        slope = -2.0 * np.sin(bend)
        half = 0.5 * np.maximum(self.length - abs(slip), 0.0)
        safe = np.where(slope == 0.0, 1e-300, slope)
        zero = np.clip(-gap / safe, -half, half)
        low = np.where((safe > 0.0) | closed, -half, zero)
        high = np.where((safe > 0.0) & (not closed), zero, half)
        l0 = high - low
        l1 = (high**2 - low**2) / 2.0
        l2 = (high**3 - low**3) / 3.0
        normal = -self.stiffness * (gap * l0 + slope * l1)
        moment = np.cos(bend) * self.stiffness * (gap * l1 + slope * l2)
        along = -self.shear * l0 * slip
        fx = normal * ty + along * tx
        fy = along * ty - normal * tx
        # The force acts half way between both middles.
        sign = np.array([-1.0, 1.0])
        px = ax + turned_x - 0.5 * sign * dx[..., None]
        py = ay + turned_y - 0.5 * sign * dy[..., None]
        fx, fy, moment = (each[..., None] * sign for each in (fx, fy, moment))
        return np.stack([fx, fy, px * fy - py * fx + moment], axis=-1), normal

    def _neighbours(self, position: FloatArray) -> FloatArray:
        """Return the displacements of the bodies beside each joint, (n_joint, 2, 3)."""
        ground = np.zeros((1, 3))
        rows = np.concatenate([ground, position, ground])
        return np.stack([rows[: self.n_joint], rows[1 : self.n_joint + 1]], axis=1)

    def _system(
        self, position: FloatArray, closed: bool = False
    ) -> tuple[NDArray, NDArray]:
        """Return the forces of joints on all bodies, (n_body, 3), and their derivative."""
        around = self._neighbours(position)
        n_joint = self.n_joint
        nudges = np.zeros((13, 2, 3))
        nudges[1:7].reshape(6, 6)[:] = np.diag(np.tile(self.nudge, 2))
        nudges[7:] = -nudges[1:7]
        force = self._bear(around[None] + nudges[:, None], closed)[0]
        change = (force[1:7] - force[7:]).reshape(2, 3, n_joint, 2, 3)
        change /= 2.0 * self.nudge[None, :, None, None, None]
        rows = self.n_body + 2
        total = np.zeros((rows, 3))
        stiffness = np.zeros((rows, 3, rows, 3))
        joint = np.arange(n_joint)
        for of in range(2):
            total[of : n_joint + of] += force[0, :, of]
            for by in range(2):
                block = np.moveaxis(change[by, :, :, of], 0, 2)
                stiffness[joint + of, :, joint + by] += block
        inside = slice(1, self.n_body + 1)
        size = 3 * self.n_body
        return total[inside], stiffness[inside, :, inside].reshape(size, size)

    def _balance(
        self, position: FloatArray, load: float, sway: float | None
    ) -> tuple[FloatArray, float, int]:
        """Return positions and load in balance, and iterations; more than allowed: not found.

        The load is that at which the mean displacement against it is `sway`, or else as given.
        """
        size = 3 * self.n_body
        system = np.zeros((size + 1, size + 1))
        left = np.zeros(size + 1)
        system[:size:3, -1] = -self.weight
        system[-1, :size:3], system[-1, -1] = (
            (self.share, 0.0) if sway is not None else (0, 1)
        )
        for iteration in range(MOST_ITERATIONS * (1 if sway is not None else 4)):
            force, system[:-1, :-1] = self._system(position)
            force[:, 0] -= load * self.weight
            force[:, 1] -= self.weight
            left[:-1] = force.ravel()
            left[-1] = 0.0 if sway is None else self.share @ position[:, 0] + sway
            error = np.abs(force / (1.0, 1.0, self.size)).max() / self.weight.mean()
            if error < BALANCED and abs(left[-1]) < BALANCED * FIRST * self.size:
                return position, load, iteration
            try:
                step = np.linalg.solve(system, -left)
            except np.linalg.LinAlgError:
                break
            if not np.isfinite(step).all():
                break
            position = position + step[:-1].reshape(-1, 3)
            load = load + float(step[-1])
        return position, load, 5 * MOST_ITERATIONS

    def rest(self) -> tuple[FloatArray, FloatArray] | None:
        """Return displacements under the weight (n_body, 3) and normal forces (n_joint,); None if
        no balance is found.
        """
        start = np.zeros((self.n_body, 3))
        start[:, 1] = self.weight
        _, closed = self._system(np.zeros((self.n_body, 3)), closed=True)
        position = np.linalg.solve(closed, start.ravel()).reshape(-1, 3)
        position, _, iterations = self._balance(position, 0.0, None)
        if iterations > 4 * MOST_ITERATIONS:
            return None
        return position, self._bear(self._neighbours(position))[1]

    def largest_load(self, rest: FloatArray, sense: float) -> SteadyLimit:
        """Find the largest steady ground acceleration in the sense +1 or -1.

        The mean displacement of the bodies against the acceleration grows step by step, and the
        acceleration is what holds them there, so that the path passes its largest value.
        """
        position = rest
        load = 0.0
        sway = float(-self.share @ rest[:, 0])
        step = FIRST * self.size
        before = (rest, 0.0, math.inf)
        path = [(sway, 0.0)]
        normal = np.zeros(self.n_joint)
        for _ in range(MOST_STEPS):
            ahead = step / before[2]
            start = position + ahead * (position - before[0])
            guess = load + ahead * (load - before[1])
            there, held, iterations = self._balance(start, guess, sway + sense * step)
            if iterations > MOST_ITERATIONS:
                step *= CUT
                if step < SHORTEST * self.size:
                    break
                continue
            before = position, load, step
            position = there
            load = held
            sway = sway + sense * step
            path.append((sway, sense * load))
            loads = np.array(path)[:, 1]
            if sense * load == loads.max():
                normal = self._bear(self._neighbours(position))[1]
            elif sense * load < PAST * loads.max():
                top = int(np.argmax(loads))
                at, near = np.array(path[top - 1 : top + 2]).T
                curve, slope, level = np.polyfit(at - at[1], near, 2)
                return SteadyLimit(float(level - slope**2 / (4.0 * curve)), normal)
            step *= QUICKER if iterations <= QUICK else 1.0
        return SteadyLimit(math.inf, normal)
