"""LMGC90 (compas_lmgc90): non-smooth contact dynamics of polyhedra by Gauss-Seidel sweeps."""

from importlib.metadata import version
from typing import Any

import numpy as np
from compas_lmgc90.solver import Solver
from numpy.typing import NDArray

from archbench.scene import STANDARD_GRAVITY, Scene

# Locking the motion out of the plane, which symmetry forbids anyway, halves the sweeps at 7
# voussoirs; a thin arch (depth 0.3 m) needs ten times as many.
VERSION = f"compas_lmgc90 {version('compas_lmgc90')}"
SETTINGS: dict[str, Any] = {
    "law": "IQS_CLB",
    "alert": 0.02,  # [m]
    "theta": 0.5,
    "depth": 1.0,  # [m]
    "locked": ["Vy"],
}
# The wrapper's own, which it does not let anybody set.
_GRAVITY = 9.81
_FACES = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


class Lmgc90Stepper:
    """A scene in LMGC90, one in a process at a time; the ground motion is a table of forces."""

    unconverged = None

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        if scene.initial is not None:
            raise ValueError("compas_lmgc90 starts from rest; the scene has an initial state")
        density = scene.chain.get("density", 2000.0)
        solver = Solver(dt=dt, theta=settings["theta"], density=density)
        outlines = scene.polygons()
        self.count = len(outlines)
        self.start = scene.bodies().centroid
        half = 0.5 * settings["depth"]
        shapes = [*outlines, *scene.supports()]
        solver.geometry_from_v_f(
            [
                {
                    "vertices": [[float(x), y, float(z)] for y in (half, -half) for x, z in shape],
                    "faces": _FACES,
                }
                for shape in shapes
            ]
        )
        for support in range(self.count, len(shapes)):
            for component in ("Vx", "Vy", "Vz", "Rx", "Ry", "Rz"):
                solver.apply_velocity(support, component, 0.0)
        acceleration = scene.step_means(dt)
        mass = scene.bodies().mass / scene.chain.get("depth", 1.0) * settings["depth"]
        # theta 1/2 takes the mean of the forces at both ends of a step: a table with two points
        # inside each step holds the step's mean.
        time = dt * np.arange(len(acceleration))
        table_time = np.column_stack([time + 1e-6 * dt, time + (1.0 - 1e-6) * dt]).ravel()
        table = np.repeat(acceleration, 2)
        for body in range(self.count):
            solver.apply_force(body, "Fx", np.array([table_time, -mass[body] * table]))
            lift = np.zeros((1, 6))
            lift[0, 0], lift[0, 4] = mass[body] * (_GRAVITY - STANDARD_GRAVITY), 1.0
            solver.apply_force(body, "Fz", lift)
            for component in settings["locked"]:
                solver.apply_velocity(body, component, 0.0)
        solver.contact_law(settings["law"], scene.finite_friction, alert=settings["alert"])
        solver.preprocess()
        self.solver = solver
        self.core = solver.lmgc90
        self.result = self.core.get_initial_state()
        self.origin = self._positions(self.result.bodies)

    def _positions(self, bodies: Any) -> NDArray:
        return np.array([bodies[i] for i in range(self.count)])[:, [0, 2]]

    def advance(self, ground_acceleration: NDArray) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""
        compute = self.core.compute_one_step
        for _ in range(len(ground_acceleration)):
            self.result = compute()

    def centroids(self) -> NDArray:
        return self.start + self._positions(self.result.bodies) - self.origin


build = Lmgc90Stepper
