"""Siconos: planar Moreau-Jean time stepping of rigid bodies, Gauss-Seidel for the contacts."""

import math
from typing import Any

import numpy as np
import siconos
import siconos.kernel as sk
import siconos.numerics as sn
from numpy.typing import NDArray

from peers.scene import STANDARD_GRAVITY, Scene

SETTINGS: dict[str, Any] = {
    "tolerance": 1e-6,
    "sweeps": 2000,
    "theta": 0.5,
    "activation": 1e-7,  # [m]
}


class _Corner(sk.LagrangianScleronomousR):
    """A corner of the body behind a joint against the face of the body before it.

    Parameters
    ----------
    before, after : (2,) ndarray or None
        The corner in the frame of either body, from its centroid [m]; None: the ground, whose
        corner stands at `fixed`.
    normal : (2,) ndarray
        Of the face before the joint, towards the body behind it, at rest.
    start : (n_body, 2) ndarray
        Centroids at rest, as `q` counts displacements from there [m].
    """

    def __init__(
        self,
        before: NDArray | None,
        after: NDArray | None,
        normal: NDArray,
        start: NDArray,
        fixed: NDArray,
    ) -> None:
        super().__init__()
        self.before, self.after, self.normal = before, after, normal
        self.start, self.fixed = start, fixed
        size = 3 * len(start)
        self.jacobian = np.zeros((2, size), order="F")
        self.setJachqPtr(self.jacobian)

    def _point(self, corner: NDArray, q: Any, body: int) -> tuple[float, float, float, float]:
        """Place of a corner and its arm from the centroid."""
        x, y, turn = q[3 * body], q[3 * body + 1], q[3 * body + 2]
        c, s = math.cos(turn), math.sin(turn)
        arm_x, arm_y = c * corner[0] - s * corner[1], s * corner[0] + c * corner[1]
        return self.start[body, 0] + x + arm_x, self.start[body, 1] + y + arm_y, arm_x, arm_y

    def _state(self, q: Any) -> tuple[float, ...]:
        last = len(self.start) - 1
        turn = 0.0 if self.before is None else q[2]
        c, s = math.cos(turn), math.sin(turn)
        n_x, n_y = c * self.normal[0] - s * self.normal[1], s * self.normal[0] + c * self.normal[1]
        if self.before is None:
            a_x, a_y, arm_ax, arm_ay = self.fixed[0], self.fixed[1], 0.0, 0.0
        else:
            a_x, a_y, arm_ax, arm_ay = self._point(self.before, q, 0)
        if self.after is None:
            b_x, b_y, arm_bx, arm_by = self.fixed[0], self.fixed[1], 0.0, 0.0
        else:
            b_x, b_y, arm_bx, arm_by = self._point(self.after, q, last)
        return n_x, n_y, b_x - a_x, b_y - a_y, arm_ax, arm_ay, arm_bx, arm_by

    def computeh(self, q: Any, z: Any, y: Any) -> None:  # the library's name
        n_x, n_y, d_x, d_y, *_ = self._state(q.tolist())
        y[0] = n_x * d_x + n_y * d_y
        y[1] = -n_y * d_x + n_x * d_y

    def computeJachq(self, q: Any, z: Any) -> None:  # noqa: N802, the library's name
        n_x, n_y, d_x, d_y, arm_ax, arm_ay, arm_bx, arm_by = self._state(q.tolist())
        jacobian = self.jacobian
        for row, (e_x, e_y) in enumerate(((n_x, n_y), (-n_y, n_x))):
            column = 0
            if self.before is not None:
                # The normal turns with the body before the joint: its arm reaches to the corner
                # of the body behind it.
                reach_x, reach_y = arm_ax + d_x, arm_ay + d_y
                jacobian[row, 0] = -e_x
                jacobian[row, 1] = -e_y
                jacobian[row, 2] = reach_y * e_x - reach_x * e_y
                column = 3
            if self.after is not None:
                jacobian[row, column] = e_x
                jacobian[row, column + 1] = e_y
                jacobian[row, column + 2] = arm_bx * e_y - arm_by * e_x

    def computeDotJachq(self, *_: Any) -> None:  # noqa: N802, the library's name
        """Not used by time stepping, but asked for."""


class SiconosStepper:
    """A scene in Siconos; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        self.version = f"siconos {getattr(siconos, '__version__', '4.4')}"
        self.unconverged: int | None = 0
        self.tolerance = settings["tolerance"]
        bodies = scene.bodies()
        self.start = bodies.centroid
        self.mass = bodies.mass
        count = len(self.mass)
        self.system = sk.NonSmoothDynamicalSystem(0.0, scene.duration + 10.0 * dt)
        self.bodies, self.forces = [], []
        for mass, inertia in zip(bodies.mass, bodies.inertia):
            body = sk.LagrangianLinearTIDS(
                np.zeros(3), np.zeros(3), np.diag([mass, mass, inertia])
            )
            force = np.array([0.0, -STANDARD_GRAVITY * mass, 0.0])
            body.setFExtPtr(force)
            self.system.insertDynamicalSystem(body)
            self.bodies.append(body)
            self.forces.append(force)
        self.law = sk.NewtonImpactFrictionNSL(0.0, 0.0, scene.friction, 2)
        self.relations, self.interactions = [], []
        inner, outer = scene.joint_lines()
        joints = count if scene.chain["kind"] == "block" else count + 1
        for joint in range(joints):
            touching = [i for i in (joint - 1, joint) if 0 <= i < count]
            along = outer[joint] - inner[joint]
            normal = np.array([-along[1], along[0]]) / np.hypot(*along)
            if normal @ (inner[min(joint + 1, count)] - inner[min(joint, count - 1)]) < 0.0:
                normal = -normal
            for corner in (inner[joint], outer[joint]):
                relation = _Corner(
                    corner - self.start[joint - 1] if joint > 0 else None,
                    corner - self.start[joint] if joint < count else None,
                    normal,
                    self.start[touching],
                    corner,
                )
                interaction = sk.Interaction(self.law, relation)
                self.system.link(interaction, *(self.bodies[i] for i in touching))
                self.relations.append(relation)
                self.interactions.append(interaction)
        self.integrator = sk.MoreauJeanOSI(settings["theta"])
        self.integrator.setConstraintActivationThreshold(settings["activation"])
        self.options = sk.solver_options_create(sn.SICONOS_FRICTION_2D_NSGS)
        self.options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = settings["sweeps"]
        self.options.dparam[sn.SICONOS_DPARAM_TOL] = self.tolerance
        self.problem = sk.FrictionContact(2, self.options)
        self.problem.setKeepLambdaAndYState(True)
        self.clock = sk.TimeDiscretisation(0.0, dt)
        self.simulation = sk.TimeStepping(self.system, self.clock, self.integrator, self.problem)
        self.simulation.setNewtonOptions(sk.SICONOS_TS_LINEAR)
        self.simulation.setWarnOnNonConvergence(False)
        self.simulation.setDisplayNewtonConvergence(False)

    def advance(self, ground_acceleration: NDArray) -> None:
        simulation, residual = self.simulation, self.options.dparam
        for value in ground_acceleration.tolist():
            for force, mass in zip(self.forces, self.mass):
                force[0] = -mass * value
            simulation.computeOneStep()
            simulation.nextStep()
            if not residual[sn.SICONOS_DPARAM_RESIDU] <= self.tolerance:
                self.unconverged += 1

    def centroids(self) -> NDArray:
        return self.start + np.array([body.q()[:2] for body in self.bodies])

    @property
    def contacts(self) -> int | None:
        return int(self.simulation.indexSet(1).size())


def build(scene: Scene, dt: float, settings: dict[str, Any]) -> SiconosStepper:
    """Scene in Siconos, ready to step."""
    return SiconosStepper(scene, dt, settings)
