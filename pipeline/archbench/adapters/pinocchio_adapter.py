"""Pinocchio: semi-implicit Euler steps, contacts by its alternating directions (ADMM).

Carpentier, Le Lidec and Montaut, "From compliant to rigid contact simulation" (RSS 2024).
"""

import numpy as np
import pinocchio as pin
from scipy.sparse import csc_matrix

from archbench.scene import STANDARD_GRAVITY, Array, Corners, Scene

VERSION = f"pinocchio {pin.__version__}"
TOLERANCE = 1e-8  # [m/s]: impulses are counted in mean masses
ITERATIONS = 2000
PROXIMAL = 1e-6
TAU = 0.9
SPARSE_FROM = 12  # voussoirs; a sparse matrix is slower below, twice as fast at 27


class PinocchioStepper:
    """A scene for Pinocchio's solver; the ground motion is a body force.

    Every corner is a contact in every step: its velocity along the normal may close the gap that
    there is at the start (Carpentier et al., section II), and friction acts where it closes.
    """

    def __init__(self, scene: Scene, dt: float) -> None:
        bodies = scene.bodies()
        self.dt = dt
        self.start = bodies.centroid
        self.unconverged = 0
        self.q, self.velocity = scene.initial_state()
        mass = bodies.mass / bodies.mass.mean()
        self.inverse = 1.0 / np.column_stack(
            [mass, mass, bodies.inertia / bodies.mass.mean()]
        )
        self.corners = Corners(scene)
        self.count = count = len(self.corners.joint)
        self.models = pin.StdVec_ConstraintModel()
        self.datas = pin.StdVec_ConstraintData()
        for _ in range(count):
            contact = pin.PointContactConstraintModel(pin.Model())
            contact.setFriction(scene.finite_friction)
            self.models.append(pin.ConstraintModel(contact))
            self.datas.append(self.models[-1].createData())
        self.settings = _solver_settings()
        self.solver = pin.ADMMConstraintSolver(3 * count)
        self.result = pin.ADMMSolverResult()
        # Six columns for each contact, those of the ground at the end.
        self.rows = 3 * np.arange(count)[:, None, None] + np.array([[2], [0]])

    def step(self, acceleration: float) -> None:
        dt = self.dt
        result = self.result
        inverse = self.inverse.ravel()
        jacobian = np.zeros((3 * self.count, 3 * len(self.q) + 3))
        gap, matrix = self.corners.linearise(self.q)
        jacobian[self.rows, self.corners.columns[:, None]] = matrix
        moving = jacobian[:, :-3]
        free = (
            self.velocity - dt * np.array([acceleration, STANDARD_GRAVITY, 0.0])
        ).ravel()
        velocity = moving @ free
        velocity[2::3] += np.maximum(gap[:, 0], 0.0) / dt
        delassus = (moving * inverse) @ moving.T
        # Nothing moves out of the plane; a unit there keeps the matrix from being singular.
        second = np.arange(1, len(delassus), 3)
        delassus[second, second] = 1.0
        if result.isValid():
            result.setConstraintImpulseGuess(result.retrieveConstraintImpulses())
        if len(self.q) >= SPARSE_FROM:
            operator = pin.DelassusOperatorSparse(csc_matrix(delassus))
        else:
            operator = pin.DelassusOperatorDense(delassus)
        self.unconverged += not self.solver.solve(
            operator, velocity, self.models, self.datas, self.settings, result
        )
        impulse = result.retrieveConstraintImpulses()
        self.velocity = (free + inverse * (impulse @ moving)).reshape(-1, 3)
        self.q = self.q + dt * self.velocity

    def centroids(self) -> Array:
        return self.start + self.q[:, :2]


def _solver_settings() -> pin.ADMMSolverSettings:
    chosen = pin.ADMMSolverSettings()
    chosen.max_iterations = ITERATIONS
    for kind in ("feasibility", "complementarity"):
        setattr(chosen, f"absolute_{kind}_tol", TOLERANCE)
        setattr(chosen, f"relative_{kind}_tol", 0.0)
    chosen.admm_update_rule = pin.ADMMUpdateRule.LINEAR
    chosen.mu_prox = PROXIMAL
    chosen.tau = TAU
    chosen.warmstart_rho_with_previous_result = True
    return chosen


build = PinocchioStepper
