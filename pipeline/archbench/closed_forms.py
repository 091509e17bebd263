"""What a single block does, in closed form or by one quadrature: nothing of our methods in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from archbench.scene import STANDARD_GRAVITY, Scene

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(60)
_NODE, _WEIGHT = 0.5 * (_NODE + 1.0), 0.5 * _WEIGHT


@dataclass(frozen=True)
class Rocking:
    """A rigid rectangle that rocks on its base corners without slipping (Housner 1963).

    `alpha` is the angle between its side and its diagonal [rad], `frequency` the square root of
    3 g / (4 R) with R half its diagonal [1/s].
    """

    alpha: float
    frequency: float

    @classmethod
    def of(cls, scene: Scene) -> Rocking:
        """That of a scene's block."""
        width, height = scene.chain["width"], scene.chain["height"]
        half_diagonal = 0.5 * math.hypot(width, height)
        return cls(math.atan2(width, height), math.sqrt(0.75 * STANDARD_GRAVITY / half_diagonal))

    @property
    def ratio(self) -> float:
        """Angular velocity after an inelastic impact over that before (Housner 1963)."""
        return 1.0 - 1.5 * math.sin(self.alpha) ** 2

    def amplitudes(self, start: float, count: int) -> list[float]:
        """Largest rotations after the first `count` impacts of a release from `start` [rad].

        Between impacts p² cos(alpha − theta) + theta'² / 2 stays; an impact leaves `ratio`² of
        the kinetic energy. Rotations of any size.
        """
        found, peak = [], start
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


def slip_under_rectangle(scene: Scene) -> float:
    """Final slip of a block that only slides, under a rectangular pulse [m].

    It gains (A − mu) g t_p and loses it at mu g: (A − mu) g t_p² / 2 · A / mu (Newmark 1965,
    Géotechnique 15, 139-160).
    """
    push, friction, time = scene.motion["amplitude"], scene.friction, scene.motion["duration"]
    return 0.5 * (push - friction) * STANDARD_GRAVITY * time**2 * push / friction


def rest_limits(scene: Scene) -> tuple[float, float]:
    """Ground accelerations to either side at which a block with a load on its back starts [g].

    The smaller of friction and of the centroid's distance to the corner over its height.
    """
    across, up = scene.bodies().centroid[0].tolist()
    half = 0.5 * scene.chain["width"]
    return min(scene.friction, (half + across) / up), min(scene.friction, (half - across) / up)
