"""Newton's Kamino: rigid bodies in single precision, contacts by proximal ADMM, on the CPU.

Tsounis, Grandia and Bächer, arXiv:2504.19771.
"""

from importlib.metadata import version

import newton
import numpy as np
import warp as wp
from newton.solvers import SolverKamino

from archbench.adapters.corners import Corners
from archbench.scene import STANDARD_GRAVITY, Array, Scene, load_scene

VERSION = f"newton {version('newton')}, warp {version('warp-lang')}"
# Tighter is below what single precision reaches; the mean mass is one, so that it is [m/s].
TOLERANCE, ITERATIONS = 1e-5, 200
# Warm starts with the last impulses unscaled, or a penalty of one, need twice the iterations.
PENALTY, WARM = 0.3, 0.9
RECOVERY = 0.01  # fraction of an overlap that a step removes
HALF_DEPTH = 0.5  # [m]


class KaminoStepper:
    """A scene in Newton, x across and z up; the ground motion is a change of gravity.

    The contacts are given: both corners of each joint at both sides of the depth, open or not, as
    a corner may close within a step.
    """

    def __init__(self, scene: Scene, dt: float) -> None:
        bodies, (shift, velocity) = scene.bodies(), scene.initial_state()
        self.dt, self.unconverged = dt, 0
        self.corners, self.start = Corners(scene), bodies.centroid
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        SolverKamino.register_custom_attributes(builder)
        # Shapes only give contacts their bodies and their friction.
        shape = newton.ModelBuilder.ShapeConfig(density=0.0, mu=scene.finite_friction)
        mean = bodies.mass.mean()
        for i, (x, z) in enumerate(bodies.centroid + shift[:, :2]):
            rotation = wp.quat_from_axis_angle(wp.vec3(0.0, -1.0, 0.0), float(shift[i, 2]))
            place = wp.transform(wp.vec3(x, 0.0, z), rotation)
            inertia = wp.mat33(np.diag([bodies.inertia[i] / mean] * 3))
            body = builder.add_body(xform=place, mass=bodies.mass[i] / mean, inertia=inertia)
            builder.add_shape_sphere(body, radius=1e-3, cfg=shape)
        builder.add_shape_sphere(-1, radius=1e-3, cfg=shape)
        self.model = builder.finalize(device="cpu")
        count = self.model.rigid_contact_max = 2 * len(self.corners.joint)
        self.points = newton.Contacts(count, 0, device="cpu")
        self.points.rigid_contact_shape0.assign(np.tile(self.corners.before, 2))
        self.points.rigid_contact_shape1.assign(np.tile(self.corners.after, 2))
        self.points.rigid_contact_count.fill_(count)
        self.solver = SolverKamino(self.model, _config(self.model))
        self.state, self.next = self.model.state(), self.model.state()
        moving = np.zeros((len(velocity), 6))
        moving[:, [0, 2, 4]] = velocity * [1.0, 1.0, -1.0]
        self.state.body_qd.assign(moving)

    def _positions(self) -> Array:
        pose = self.state.body_q.numpy().astype(float)
        rotation = -2.0 * np.arctan2(pose[:, 4], pose[:, 6])
        return np.column_stack([pose[:, [0, 2]] - self.start, rotation])

    def _place_contacts(self) -> None:
        """Corners in their bodies, and their feet on the face in the bodies before."""
        corners, q = self.corners, self._positions()
        gap, _ = corners.linearise(q)
        q = np.vstack([q, np.zeros(3)])
        rotation = np.exp(1j * q[:, 2])
        centre = (corners.place + q[:, :2]) @ [1.0, 1j]
        normal, corner = corners.normal @ [1.0, 1j], corners.arm_after @ [1.0, 1j]
        before, after = corners.before, corners.after
        reach = centre[after] + rotation[after] * corner - centre[before]
        foot = reach / rotation[before] - gap[:, 0] * normal
        for array, plane, depth in (
            (self.points.rigid_contact_point0, foot, HALF_DEPTH),
            (self.points.rigid_contact_point1, corner, HALF_DEPTH),
            (self.points.rigid_contact_normal, rotation[before] * normal, 0.0),
        ):
            x, z = np.tile(plane.real, 2), np.tile(plane.imag, 2)
            array.assign(np.column_stack([x, np.repeat([depth, -depth], len(plane)), z]))

    def step(self, acceleration: float) -> None:
        self.model.set_gravity((-acceleration, 0.0, -STANDARD_GRAVITY))
        self._place_contacts()
        self.solver.step(self.state, self.next, None, self.points, self.dt)
        self.state, self.next = self.next, self.state
        self.unconverged += int(not self.solver.status.numpy()["converged"][0])

    def centroids(self) -> Array:
        return self.start + self._positions()[:, :2]


def _config(model: newton.Model) -> SolverKamino.Config:
    config = SolverKamino.Config.from_model(model)
    admm = config.padmm
    admm.primal_tolerance = admm.dual_tolerance = admm.compl_tolerance = TOLERANCE
    admm.max_iterations, admm.rho_0, admm.warmstart_scale = ITERATIONS, PENALTY, WARM
    config.constraints.gamma, config.constraints.delta = RECOVERY, 0.0
    config.dynamics.cull_speculative_contacts = False
    return config


def prepare() -> None:
    """Have Warp compile the kernels: a minute once, later they are loaded."""
    KaminoStepper(load_scene("block_sine"), 1e-3).step(0.0)


build = KaminoStepper
