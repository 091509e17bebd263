"""Pinocchio: semi-implicit Euler steps, contacts by its alternating directions (ADMM)."""

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from archbench.adapters.corners import Corners
from archbench.scene import STANDARD_GRAVITY, Scene

# Carpentier, Le Lidec and Montaut, "From compliant to rigid contact simulation" (RSS 2024).
# Impulses are counted in mean masses, so that both tolerances are velocities [m/s].
VERSION = f"pinocchio {pin.__version__}"
SETTINGS: dict[str, Any] = {
    "tolerance": 1e-8,  # [m/s]
    "iterations": 2000,
    "update_rule": "LINEAR",
    "proximal": 1e-6,
    "tau": 0.9,
    "warm": True,
    "sparse_from": 12,  # voussoirs; a sparse matrix is slower below, twice as fast at 27
}


class PinocchioStepper:
    """A scene for Pinocchio's solver; the ground motion is a body force.

    Every corner is a contact in every step: its velocity along the normal may close the gap that
    there is at the start (Carpentier et al., section II), and friction acts where it closes.
    """

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        bodies = scene.bodies()
        self.dt, self.start, self.warm = dt, bodies.centroid, settings["warm"]
        self.q, self.velocity = scene.initial_state()
        self.unconverged = 0
        mass = bodies.mass / bodies.mass.mean()
        self.inverse = 1.0 / np.column_stack([mass, mass, bodies.inertia / bodies.mass.mean()])
        self.corners = Corners(scene)
        self.count = count = len(self.corners.joint)
        self.models, self.datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        for _ in range(count):
            contact = pin.PointContactConstraintModel(pin.Model())
            contact.setFriction(scene.finite_friction)
            self.models.append(pin.ConstraintModel(contact))
            self.datas.append(self.models[-1].createData())
        self.sparse = len(self.q) >= settings["sparse_from"]
        self.settings = _solver_settings(settings)
        self.solver = pin.ADMMConstraintSolver(3 * count)
        self.result = pin.ADMMSolverResult()
        # Six columns for each contact, those of the ground at the end.
        both = np.column_stack([self.corners.before, self.corners.after])
        self.columns = (3 * both[:, :, None] + np.arange(3)).reshape(count, 1, 6)
        self.rows = 3 * np.arange(count)[:, None, None] + np.array([[2], [0]])

    def advance(self, ground_acceleration: NDArray) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""
        dt, result = self.dt, self.result
        jacobian = np.zeros((3 * self.count, 3 * len(self.q) + 3))
        inverse = self.inverse.ravel()
        for value in ground_acceleration.tolist():
            gap, matrix = self.corners.linearise(self.q)
            jacobian[self.rows, self.columns] = matrix
            moving = jacobian[:, :-3]
            free = (self.velocity - dt * np.array([value, STANDARD_GRAVITY, 0.0])).ravel()
            velocity = moving @ free
            velocity[2::3] += np.maximum(gap[:, 0], 0.0) / dt
            delassus = (moving * inverse) @ moving.T
            # Nothing moves out of the plane; a unit there keeps the matrix from being singular.
            across = np.arange(1, len(delassus), 3)
            delassus[across, across] = 1.0
            if self.warm and result.isValid():
                result.setConstraintImpulseGuess(result.retrieveConstraintImpulses())
            operator = (
                pin.DelassusOperatorSparse(csc_matrix(delassus))
                if self.sparse
                else pin.DelassusOperatorDense(delassus)
            )
            converged = self.solver.solve(
                operator, velocity, self.models, self.datas, self.settings, result
            )
            self.unconverged += not converged
            impulse = result.retrieveConstraintImpulses()
            self.velocity = (free + inverse * (impulse @ moving)).reshape(-1, 3)
            self.q = self.q + dt * self.velocity

    def centroids(self) -> NDArray:
        return self.start + self.q[:, :2]


def _solver_settings(settings: dict[str, Any]) -> pin.ADMMSolverSettings:
    chosen = pin.ADMMSolverSettings()
    chosen.max_iterations = settings["iterations"]
    for kind in ("feasibility", "complementarity"):
        setattr(chosen, f"absolute_{kind}_tol", settings["tolerance"])
        setattr(chosen, f"relative_{kind}_tol", 0.0)
    chosen.admm_update_rule = getattr(pin.ADMMUpdateRule, settings["update_rule"])
    chosen.mu_prox, chosen.tau = settings["proximal"], settings["tau"]
    chosen.warmstart_rho_with_previous_result = settings["warm"]
    return chosen


build = PinocchioStepper
