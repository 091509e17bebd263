"""Siconos: planar Moreau-Jean time stepping of rigid bodies, Gauss-Seidel for the contacts."""

from importlib.metadata import version
from typing import Any

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn
from numpy.typing import NDArray

from archbench.adapters.corners import Corners
from archbench.scene import STANDARD_GRAVITY, Scene

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


class _Relations:
    """Linear relations y = C q + e of the corners (y: gap and slip).

    Siconos keeps their arrays; they are written anew from the positions at the start of each step:
    Moreau-Jean with explicit Jacobians, without a call back to Python for each contact.
    """

    def __init__(self, corners: Corners) -> None:
        count, self.corners = corners.count, corners
        pairs = list(zip(corners.before.tolist(), corners.after.tolist()))
        self.touching = [[i for i in pair if i < count] for pair in pairs]
        self.columns = [
            slice(0 if before < count else 3, 6 if after < count else 3) for before, after in pairs
        ]
        self.all = [
            sk.LagrangianLinearTIR(np.zeros((2, 3 * len(pair)), order="F"), np.zeros(2))
            for pair in self.touching
        ]
        # Siconos copies what it is given, but what it gives is its own memory.
        self.jacobians = [relation.jachq() for relation in self.all]
        self.offsets = [relation.e() for relation in self.all]

    def linearise(self, q: NDArray) -> None:
        """Write C and e at the positions `q`, (n_body, 3)."""
        value, matrix = self.corners.linearise(q)
        q = np.vstack([q, np.zeros(3)])
        both = np.hstack([q[self.corners.before], q[self.corners.after]])
        value = value - np.einsum("crq,cq->cr", matrix, both)
        for i, columns in enumerate(self.columns):
            self.jacobians[i][:] = matrix[i, :, columns]
            self.offsets[i][:] = value[i]


class SiconosStepper:
    """A scene in Siconos; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        self.unconverged = 0
        self.tolerance = settings["tolerance"]
        bodies, (shift, velocity) = scene.bodies(), scene.initial_state()
        self.start = bodies.centroid
        self.mass = bodies.mass
        count = len(self.mass)
        self.system = sk.NonSmoothDynamicalSystem(0.0, scene.duration + 10.0 * dt)
        self.bodies, self.forces = [], []
        for i, (mass, inertia) in enumerate(zip(bodies.mass, bodies.inertia)):
            body = sk.LagrangianLinearTIDS(shift[i], velocity[i], np.diag([mass, mass, inertia]))
            body.setFExtPtr(np.array([0.0, -STANDARD_GRAVITY * mass, 0.0]))
            self.system.insertDynamicalSystem(body)
            self.bodies.append(body)
            self.forces.append(body.fExt())
        self.law = sk.NewtonImpactFrictionNSL(0.0, 0.0, scene.finite_friction, 2)
        self.relations, self.interactions = _Relations(Corners(scene)), []
        self.relations.linearise(shift)
        for touching, relation in zip(self.relations.touching, self.relations.all):
            interaction = sk.Interaction(self.law, relation)
            self.system.link(interaction, *(self.bodies[i] for i in touching))
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
            self.relations.linearise(np.array([body.q() for body in self.bodies]))
            self.problem.setHasBeenUpdated(False)
            simulation.computeOneStep()
            simulation.nextStep()
            if not residual[sn.SICONOS_DPARAM_RESIDU] <= self.tolerance:
                self.unconverged += 1

    def centroids(self) -> NDArray:
        return self.start + np.array([body.q()[:2] for body in self.bodies])


build = SiconosStepper
