"""Exact solutions without our methods: the static theorem as a linear programme, a block."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.optimize import OptimizeResult, bisect, linprog

from archbench.scene import STANDARD_GRAVITY, Corners, Scene

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(60)
_NODE = 0.5 * (_NODE + 1.0)
_WEIGHT = 0.5 * _WEIGHT


@dataclass(frozen=True)
class Rocking:
    """A rigid rectangle that rocks on its base corners without slipping (Housner 1963).

    `alpha`: angle between its side and its diagonal [rad]; `frequency`: sqrt(3 g / (4 R)) with R
    half its diagonal [1/s].
    """

    alpha: float
    frequency: float

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """That of a scene's block."""
        width = scene.chain["width"]
        height = scene.chain["height"]
        half_diagonal = 0.5 * math.hypot(width, height)
        return cls(
            math.atan2(width, height),
            math.sqrt(0.75 * STANDARD_GRAVITY / half_diagonal),
        )

    @property
    def ratio(self) -> float:
        """Angular velocity after an inelastic impact over that before (Housner 1963)."""
        return 1.0 - 1.5 * math.sin(self.alpha) ** 2

    def amplitudes(self, start: float, count: int) -> list[float]:
        """Largest rotations after the first `count` impacts of a release from `start` [rad].

        Between impacts p² cos(alpha − theta) + theta'² / 2 stays. Rotations of any size.
        """
        found = []
        peak = start
        for _ in range(count):
            drop = math.cos(self.alpha - peak) - math.cos(self.alpha)
            peak = self.alpha - math.acos(math.cos(self.alpha) + self.ratio**2 * drop)
            found.append(peak)
        return found

    def quarter(self, peak: float) -> float:
        """Time from a standstill at `peak` to the impact [s]."""
        rotation = peak * (1.0 - _NODE**2)
        # Differences of cosines as products, which keep their digits at small rotations.
        apart = 2.0 * np.sin(0.5 * peak * _NODE**2)
        apart *= np.sin(self.alpha - peak + 0.5 * (peak - rotation))
        speed = self.frequency * np.sqrt(2.0 * apart)
        return float(np.sum(_WEIGHT * 2.0 * peak * _NODE / speed))

    def time_to_rest(self, start: float) -> float:
        """Sum of the infinitely many half periods of a release from `start` [s]."""
        peaks = self.amplitudes(start, 400)
        total = self.quarter(start) + 2.0 * sum(self.quarter(peak) for peak in peaks)
        # What remains is a geometric series: a half period is as the root of its small amplitude.
        return total + 2.0 * self.quarter(peaks[-1]) * self.ratio / (1.0 - self.ratio)

    def grazing(self, start: float, push: float) -> tuple[float, float]:
        """Speed at `start` that brings the corner back to the ground without any speed, and when.

        By the potential of weight and a steady ground acceleration `push` [g] over its inertia.
        """
        tilt = self.alpha - start * np.append(_NODE**2, 1.0)
        upright = math.cos(self.alpha) + push * math.sin(self.alpha)
        drop = self.frequency**2 * (upright - np.cos(tilt) - push * np.sin(tilt))
        time = np.sum(_WEIGHT * 2.0 * start * _NODE / np.sqrt(2.0 * drop[:-1]))
        return math.sqrt(2.0 * drop[-1]), float(time)


def largest_load(scene: Scene, sense: float = 1.0) -> float:
    """Largest steady ground acceleration for which admissible reactions exist.

    A normal and a shear force at both ends of each joint, in balance with the weights and the
    inertia forces, within Coulomb's cone (Livesley 1978, *Int. J. Numer. Meth. Eng.* 12).
    """
    found = _programme(scene, sense)
    if found.status == 3:
        return math.inf
    return float(found.x[-1]) if found.status == 0 else math.nan


def least_friction(scene: Scene, width: float = 1e-9) -> float:
    """Least Coulomb coefficient at which the scene's chain bears its own weight."""

    def missing(friction: float) -> float:
        chain = {**scene.chain, "friction": friction}
        return 0.5 - (_programme(replace(scene, chain=chain), 0.0).status == 0)

    return float(bisect(missing, 0.0, 10.0, xtol=width)) + width


def _programme(scene: Scene, sense: float) -> OptimizeResult:
    """Balance of each body; unknowns are normal and shear of each contact, and the load."""
    corners = Corners(scene)
    count = 2 * len(corners.joint)
    _, matrix = corners.linearise(np.zeros((corners.count, 3)))
    wrench = np.zeros((len(corners.joint), 2, 3 * corners.count + 3))
    np.put_along_axis(
        wrench, np.repeat(corners.columns[:, None], 2, axis=1), matrix, axis=2
    )
    weight = scene.bodies().mass / scene.bodies().mass.sum()
    inertia, balance = np.zeros((2, 3 * corners.count))
    inertia[::3] = -sense * weight
    balance[1::3] = weight
    cone = np.zeros((count, count + 1))
    normal = np.arange(0, count, 2)
    for row, sign in ((normal, 1.0), (normal + 1, -1.0)):
        cone[row, normal] = -scene.friction
        cone[row, normal + 1] = sign
    within = (None, None) if math.isinf(scene.friction) else (cone, np.zeros(count))
    return linprog(
        np.append(np.zeros(count), -1.0 if sense else 0.0),
        *within,
        np.column_stack([wrench.reshape(count, -1).T[:-3], inertia]),
        balance,
        bounds=[*[(0, None), (None, None)] * (count // 2), (None, None)],
        options={f"{kind}_feasibility_tolerance": 1e-10 for kind in ("primal", "dual")},
    )
