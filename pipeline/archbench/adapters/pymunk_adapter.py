"""pymunk (Chipmunk2D): sequential impulses with position correction, in the plane."""

import math

import numpy as np
import pymunk

from archbench.scene import STANDARD_GRAVITY, Array, Scene

VERSION = f"pymunk {pymunk.version}, Chipmunk {pymunk.chipmunk_version}"
ITERATIONS = 200  # [m]
SLOP = 1e-5
# Position correction pushes the arch open at its hinges: at Chipmunk's usual rate (6.3 a second)
# and above it the early motion is too large by a quarter to four times; at 0.1 a second it is
# within one part in a hundred of the other solvers, and the joints do not sink into each other.
CORRECTION_RATE = 0.1  # [1/s]


class PymunkStepper:
    """A scene in pymunk; the ground motion is a body force."""

    unconverged = None

    def __init__(self, scene: Scene, dt: float) -> None:
        self.space = pymunk.Space()
        self.dt = dt
        self.space.iterations = ITERATIONS
        self.space.collision_slop = SLOP
        # Chipmunk's bias is the part of an overlap that is left after one second.
        self.space.collision_bias = math.exp(-CORRECTION_RATE)
        self.friction = math.sqrt(scene.finite_friction)
        bodies, (shift, velocity) = scene.bodies(), scene.initial_state()
        self.moving: list[pymunk.Body] = []
        for i, outline in enumerate(scene.polygons()):
            body = pymunk.Body(bodies.mass[i], bodies.inertia[i])
            body.position = tuple(bodies.centroid[i] + shift[i, :2])
            body.velocity = tuple(velocity[i, :2])
            body.angle = shift[i, 2]
            body.angular_velocity = velocity[i, 2]
            self.space.add(body, self._shape(body, outline - bodies.centroid[i]))
            self.moving.append(body)
        for outline in scene.supports():
            self.space.add(self._shape(self.space.static_body, outline))

    def _shape(self, body: pymunk.Body, corners: Array) -> pymunk.Poly:
        shape = pymunk.Poly(body, [tuple(corner) for corner in corners])
        shape.friction = self.friction
        shape.elasticity = 0.0
        return shape

    def step(self, acceleration: float) -> None:
        self.space.gravity = (-acceleration, -STANDARD_GRAVITY)
        self.space.step(self.dt)

    def centroids(self) -> Array:
        return np.array([tuple(body.position) for body in self.moving])


build = PymunkStepper
