"""LMGC90 (compas_lmgc90): non-smooth contact dynamics of polyhedra by Gauss-Seidel sweeps."""

from importlib.metadata import version
from typing import Any

import numpy as np
from compas_lmgc90.solver import Solver

from archbench.scene import STANDARD_GRAVITY, Array, Scene

VERSION = f"compas_lmgc90 {version('compas_lmgc90')}"
LAW = "IQS_CLB"  # alert distance [m]
ALERT = 0.02
THETA = 0.5
# A thin arch (depth 0.3 m) needs ten times the sweeps; locking the motion out of the plane, which
# symmetry forbids anyway, halves them at 7 voussoirs.
DEPTH = 1.0  # [m]
LOCKED = ("Vy",)
_GRAVITY = 9.81  # the wrapper's own, which it does not let anybody set
_FACES = [
    [3, 2, 1, 0],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
]


class Lmgc90Stepper:
    """A scene in LMGC90, one in a process at a time; the ground motion is a table of forces."""

    unconverged = None

    def __init__(self, scene: Scene, dt: float) -> None:
        if scene.initial is not None:
            raise ValueError(
                "compas_lmgc90 starts from rest; the scene has an initial state"
            )
        solver = Solver(dt=dt, theta=THETA, density=scene.chain.get("density", 2000.0))
        outlines = scene.polygons()
        self.count = len(outlines)
        self.start = scene.bodies().centroid
        depths = (0.5 * DEPTH, -0.5 * DEPTH)
        shapes = [*outlines, *scene.supports()]
        vertices = [
            [[x, y, z] for y in depths for x, z in shape.tolist()] for shape in shapes
        ]
        solver.geometry_from_v_f(
            [{"vertices": each, "faces": _FACES} for each in vertices]
        )
        for support in range(self.count, len(shapes)):
            for component in ("Vx", "Vy", "Vz", "Rx", "Ry", "Rz"):
                solver.apply_velocity(support, component, 0.0)
        acceleration = scene.step_means(dt)
        mass = scene.bodies().mass / scene.chain.get("depth", 1.0) * DEPTH
        # theta 1/2 takes the mean of the forces at both ends of a step: a table with two points
        # inside each step holds the step's mean.
        time = dt * np.arange(len(acceleration))
        table_time = np.column_stack(
            [time + 1e-6 * dt, time + (1.0 - 1e-6) * dt]
        ).ravel()
        table = np.repeat(acceleration, 2)
        for body in range(self.count):
            solver.apply_force(body, "Fx", np.array([table_time, -mass[body] * table]))
            lift = np.zeros((1, 6))
            lift[0, 0] = mass[body] * (_GRAVITY - STANDARD_GRAVITY)
            lift[0, 4] = 1.0
            solver.apply_force(body, "Fz", lift)
            for component in LOCKED:
                solver.apply_velocity(body, component, 0.0)
        solver.contact_law(LAW, scene.finite_friction, alert=ALERT)
        solver.preprocess()
        self.solver = solver
        self.core = solver.lmgc90
        self.result = self.core.get_initial_state()
        self.origin = self._positions(self.result.bodies)

    def _positions(self, bodies: Any) -> Array:
        return np.array([bodies[i] for i in range(self.count)])[:, [0, 2]]

    def step(self, acceleration: float) -> None:
        self.result = self.core.compute_one_step()

    def centroids(self) -> Array:
        return self.start + self._positions(self.result.bodies) - self.origin


build = Lmgc90Stepper
