"""Siconos: planar Moreau-Jean time stepping of rigid bodies, Gauss-Seidel for the contacts."""

from importlib.metadata import version

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn

from archbench.scene import STANDARD_GRAVITY, Array, Corners, Scene

VERSION = f"siconos {version('siconos')}"
TOLERANCE = 1e-6  # stops far short where the default cap of 1,000 holds
SWEEPS = 10000
THETA = 0.5
ACTIVATION = (
    1e-7  # corners so near touch: else rounding opens closed joints for a step [m]
)
SPARSE_FROM = 12  # voussoirs; dense blocks are faster below, four times slower at 27


class SiconosStepper:
    """A scene in Siconos; the ground motion is a body force.

    Relations y = C q + e of the corners (y: gap and slip) are linear. Siconos keeps their arrays;
    they are written anew from the positions at the start of each step: Moreau-Jean with explicit
    Jacobians, without a call back to Python for each contact.
    """

    def __init__(self, scene: Scene, dt: float) -> None:
        self.unconverged = 0
        bodies, (shift, velocity) = scene.bodies(), scene.initial_state()
        self.start = bodies.centroid
        self.mass = bodies.mass
        self.system = sk.NonSmoothDynamicalSystem(0.0, scene.duration + 10.0 * dt)
        self.bodies = []
        self.forces = []
        for i, (mass, inertia) in enumerate(zip(bodies.mass, bodies.inertia)):
            body = sk.LagrangianLinearTIDS(
                shift[i], velocity[i], np.diag([mass, mass, inertia])
            )
            body.setFExtPtr(np.array([0.0, -STANDARD_GRAVITY * mass, 0.0]))
            self.system.insertDynamicalSystem(body)
            self.bodies.append(body)
            self.forces.append(body.fExt())
        self.law = sk.NewtonImpactFrictionNSL(0.0, 0.0, scene.finite_friction, 2)
        self._link(Corners(scene))
        self.integrator = sk.MoreauJeanOSI(THETA)
        self.integrator.setConstraintActivationThreshold(ACTIVATION)
        self.options = sk.solver_options_create(sn.SICONOS_FRICTION_2D_NSGS)
        self.options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = SWEEPS
        self.options.dparam[sn.SICONOS_DPARAM_TOL] = TOLERANCE
        self.problem = sk.FrictionContact(2, self.options)
        if len(self.mass) >= SPARSE_FROM:
            self.problem.setMStorageType(sn.NM_SPARSE_BLOCK)
        self.problem.setKeepLambdaAndYState(True)
        self.clock = sk.TimeDiscretisation(0.0, dt)
        self.simulation = sk.TimeStepping(
            self.system, self.clock, self.integrator, self.problem
        )
        self.simulation.setNewtonOptions(sk.SICONOS_TS_LINEAR)
        self.simulation.setWarnOnNonConvergence(False)
        self.simulation.setDisplayNewtonConvergence(False)

    def _link(self, corners: Corners) -> None:
        """A relation for each corner, with the columns of the bodies that it touches."""
        count = corners.count
        self.corners = corners
        self.kept = []
        self.columns = []
        self.jacobians = []
        self.offsets = []
        for before, after in zip(corners.before.tolist(), corners.after.tolist()):
            touching = [self.bodies[i] for i in (before, after) if i < count]
            zeros = np.zeros((2, 3 * len(touching)), order="F")
            relation = sk.LagrangianLinearTIR(zeros, np.zeros(2))
            self.columns.append(
                slice(0 if before < count else 3, 6 if after < count else 3)
            )
            # Siconos copies what it is given, but what it gives is its own memory.
            self.jacobians.append(relation.jachq())
            self.offsets.append(relation.e())
            self.kept += [relation, sk.Interaction(self.law, relation)]
            self.system.link(self.kept[-1], *touching)
        self._linearise()

    def _linearise(self) -> None:
        """Write C and e at the present positions."""
        q = np.array([body.q() for body in self.bodies])
        value, matrix = self.corners.linearise(q)
        both = np.append(q, np.zeros(3))[self.corners.columns]
        value = value - np.einsum("crq,cq->cr", matrix, both)
        for i, columns in enumerate(self.columns):
            self.jacobians[i][:] = matrix[i, :, columns]
            self.offsets[i][:] = value[i]

    def step(self, acceleration: float) -> None:
        residual = self.options.dparam
        for force, mass in zip(self.forces, self.mass):
            force[0] = -mass * acceleration
        self._linearise()
        self.problem.setHasBeenUpdated(False)
        self.simulation.computeOneStep()
        self.simulation.nextStep()
        self.unconverged += int(not residual[sn.SICONOS_DPARAM_RESIDU] <= TOLERANCE)

    def centroids(self) -> Array:
        return self.start + np.array([body.q()[:2] for body in self.bodies])


build = SiconosStepper
