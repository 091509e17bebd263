"""Siconos: planar Moreau-Jean time stepping of rigid bodies, Gauss-Seidel for the contacts."""

from importlib.metadata import version
from typing import Any

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn
from numpy.typing import NDArray

from archfrag.evidence.scene import STANDARD_GRAVITY, Scene

# Sweeps stop far short of the tolerance where the default cap of 1,000 holds. Corners within
# `activation` count as touching: without it rounding opens closed joints for a step.
VERSION = f"siconos {version('siconos')}"
SETTINGS: dict[str, Any] = {
    "tolerance": 1e-6,
    "sweeps": 10000,
    "theta": 0.5,
    "activation": 1e-7,  # [m]
    "sparse_from": 12,  # voussoirs; dense blocks are faster below, four times slower at 27
}


class _Corners:
    """Each corner of a body behind a joint against the face of the body before it.

    Siconos gets linear relations y = C q + e (y: gap and slip) in arrays that it shares, and that
    are made anew from the positions at the start of each step: Moreau-Jean with explicit
    Jacobians, without a call back to Python for each contact.

    Parameters
    ----------
    scene : Scene
    centroid : (n_body, 2) ndarray
        At rest [m]; `q` counts from there.
    """

    def __init__(self, scene: Scene, centroid: NDArray) -> None:
        count = len(centroid)
        inner, outer = scene.joint_lines()
        n_joint = count if scene.free_end else count + 1
        middle = 0.5 * (inner + outer)
        travel = np.diff(middle, axis=0, append=middle[-1:] + middle[-1:] - middle[-2:-1])
        along = outer - inner
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        normal *= np.sign(np.sum(normal * travel, axis=1))[:, None]
        normal /= np.hypot(*along.T)[:, None]
        joint = np.repeat(np.arange(n_joint), 2)
        corner = np.column_stack([inner, outer]).reshape(-1, 2)[: 2 * n_joint]
        # The ground is one body more, at the origin, that never moves.
        place = np.vstack([centroid, np.zeros(2)])
        self.before = np.where(joint > 0, joint - 1, count)
        self.after = np.where(joint < count, joint, count)
        self.place, self.normal = place, normal[joint]
        self.arm_before = corner - place[self.before]
        self.arm_after = corner - place[self.after]
        self.touching = [
            [i for i in pair if i < count]
            for pair in zip(self.before.tolist(), self.after.tolist())
        ]
        self.columns = [
            slice(0 if before < count else 3, 6 if after < count else 3)
            for before, after in zip(self.before, self.after)
        ]
        self.jacobians = [np.zeros((2, 3 * len(pair)), order="F") for pair in self.touching]
        self.offsets = [np.zeros(2) for _ in self.touching]
        self.linearise(np.zeros((count, 3)))

    def linearise(self, q: NDArray) -> None:
        """Write C and e at the positions `q`, (n_body, 3), into the arrays shared with Siconos."""
        q = np.vstack([q, np.zeros(3)])
        turn = np.exp(1j * q[:, 2])
        centre = (self.place + q[:, :2]) @ [1.0, 1j]
        arm_before = turn[self.before] * (self.arm_before @ [1.0, 1j])
        arm_after = turn[self.after] * (self.arm_after @ [1.0, 1j])
        apart = centre[self.after] + arm_after - centre[self.before] - arm_before
        normal = turn[self.before] * (self.normal @ [1.0, 1j])
        # The frame turns with the body before the joint, so its arm reaches the other's corner.
        reach = arm_before + apart
        matrix = np.empty((len(apart), 2, 6))
        value = np.empty((len(apart), 2))
        for row, e in enumerate((normal, 1j * normal)):
            value[:, row] = (e.conj() * apart).real
            matrix[:, row, 0], matrix[:, row, 1] = -e.real, -e.imag
            matrix[:, row, 2] = -(reach.conj() * e).imag
            matrix[:, row, 3], matrix[:, row, 4] = e.real, e.imag
            matrix[:, row, 5] = (arm_after.conj() * e).imag
        both = np.hstack([q[self.before], q[self.after]])
        value -= np.einsum("crq,cq->cr", matrix, both)
        for i, columns in enumerate(self.columns):
            self.jacobians[i][:] = matrix[i, :, columns]
            self.offsets[i][:] = value[i]


class SiconosStepper:
    """A scene in Siconos; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        self.version = VERSION
        self.unconverged = 0
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
            body.setFExtPtr(np.array([0.0, -STANDARD_GRAVITY * mass, 0.0]))
            self.system.insertDynamicalSystem(body)
            self.bodies.append(body)
            # Siconos copies what it is given, but what it gives is its own memory.
            self.forces.append(body.fExt())
        self.law = sk.NewtonImpactFrictionNSL(0.0, 0.0, scene.finite_friction, 2)
        self.corners = _Corners(scene, bodies.centroid)
        self.relations, self.interactions = [], []
        for i, touching in enumerate(self.corners.touching):
            relation = sk.LagrangianLinearTIR(self.corners.jacobians[i], self.corners.offsets[i])
            self.corners.jacobians[i], self.corners.offsets[i] = relation.jachq(), relation.e()
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
        if count >= settings["sparse_from"]:
            self.problem.setMStorageType(sn.NM_SPARSE_BLOCK)
        self.problem.setKeepLambdaAndYState(True)
        self.clock = sk.TimeDiscretisation(0.0, dt)
        self.simulation = sk.TimeStepping(self.system, self.clock, self.integrator, self.problem)
        self.simulation.setNewtonOptions(sk.SICONOS_TS_LINEAR)
        self.simulation.setWarnOnNonConvergence(False)
        self.simulation.setDisplayNewtonConvergence(False)

    def advance(self, ground_acceleration: NDArray) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""
        simulation, residual = self.simulation, self.options.dparam
        for value in ground_acceleration.tolist():
            for force, mass in zip(self.forces, self.mass):
                force[0] = -mass * value
            self.corners.linearise(np.array([body.q() for body in self.bodies]))
            self.problem.setHasBeenUpdated(False)
            simulation.computeOneStep()
            simulation.nextStep()
            if not residual[sn.SICONOS_DPARAM_RESIDU] <= self.tolerance:
                self.unconverged += 1

    def centroids(self) -> NDArray:
        return self.start + np.array([body.q()[:2] for body in self.bodies])

    @property
    def contacts(self) -> int | None:
        return int(self.problem.getSizeOutput()) // 2


def build(scene: Scene, dt: float, settings: dict[str, Any]) -> SiconosStepper:
    """Scene in Siconos, ready to step."""
    return SiconosStepper(scene, dt, settings)
