"""pymunk (Chipmunk2D): sequential impulses with position correction, in the plane."""

import math
from typing import Any

import numpy as np
import pymunk
from numpy.typing import NDArray

from archbench.scene import STANDARD_GRAVITY, Scene

# Position correction pushes the arch open at its hinges: at Chipmunk's usual rate (6.3 a second)
# and above it the early motion is too large by a quarter to four times; at 0.1 a second it is
# within one part in a hundred of the other solvers, and the joints do not sink into each other.
VERSION = f"pymunk {pymunk.version}, Chipmunk {pymunk.chipmunk_version}"
SETTINGS: dict[str, Any] = {
    "iterations": 200,
    "collision_slop": 1e-5,  # [m]
    "correction_rate": 0.1,  # [1/s]
}


class PymunkStepper:
    """A scene in pymunk; the ground motion is a body force."""

    unconverged = None

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        self.space = pymunk.Space()
        self.dt = dt
        self.space.iterations = settings["iterations"]
        self.space.collision_slop = settings["collision_slop"]
        # Chipmunk's bias is the part of an overlap that is left after one second.
        self.space.collision_bias = math.exp(-settings["correction_rate"])
        friction = math.sqrt(scene.finite_friction)
        bodies, (shift, velocity) = scene.bodies(), scene.initial_state()
        self.moving: list[pymunk.Body] = []
        for i, outline in enumerate(scene.polygons()):
            body = pymunk.Body(bodies.mass[i], bodies.inertia[i])
            body.position = tuple(bodies.centroid[i] + shift[i, :2])
            body.velocity = tuple(velocity[i, :2])
            body.angle, body.angular_velocity = shift[i, 2], velocity[i, 2]
            self.space.add(body, self._shape(body, outline - bodies.centroid[i], friction))
            self.moving.append(body)
        for outline in scene.supports():
            self.space.add(self._shape(self.space.static_body, outline, friction))

    def _shape(self, body: pymunk.Body, corners: NDArray, friction: float) -> pymunk.Poly:
        shape = pymunk.Poly(body, [tuple(corner) for corner in corners])
        shape.friction = friction
        shape.elasticity = 0.0
        return shape

    def advance(self, ground_acceleration: NDArray) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""
        space, dt = self.space, self.dt
        for value in ground_acceleration.tolist():
            space.gravity = (-value, -STANDARD_GRAVITY)
            space.step(dt)

    def centroids(self) -> NDArray:
        return np.array([tuple(body.position) for body in self.moving])


build = PymunkStepper
