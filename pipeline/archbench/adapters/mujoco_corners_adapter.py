"""MuJoCo: soft convex contacts solved by Newton's method, held to the plane by its joints."""

import math

import mujoco
import numpy as np

from archbench.scene import STANDARD_GRAVITY, Array, Corners, Scene

VERSION = f"mujoco {mujoco.__version__}"
ITERATIONS = 100
TOLERANCE = 1e-10
# Near-default contacts sag by centimetres: the time constant is the smallest that is stable, the
# impedance close to one. `impratio` keeps sticking joints from creeping.
IMPRATIO = 10.0
SOLREF_STEPS = 2.0
SOLIMP = (0.99, 0.9999, 0.0001, 0.5, 2.0)
# Of corners, in lengths of their face. A corner that sinks in by more than its radius in one step
# is pushed out by the end of the face.
RADIUS = 0.02
HALF_DEPTH = 0.5


class MujocoStepper:
    """A scene in MuJoCo; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float) -> None:
        self.model = _model(scene, dt)
        self.data = mujoco.MjData(self.model)
        self.start = scene.bodies().centroid
        # Looked at once for each sample, so as not to slow the steps.
        self.unconverged = 0
        shift, velocity = scene.initial_state()
        self.data.qpos[:], self.data.qvel[:] = shift.ravel(), velocity.ravel()
        mujoco.mj_forward(self.model, self.data)

    def step(self, acceleration: float) -> None:
        self.model.opt.gravity[0] = -acceleration
        mujoco.mj_step(self.model, self.data)

    def centroids(self) -> Array:
        self.unconverged += int(self.data.solver_niter[0] >= ITERATIONS)
        return self.start + self.data.qpos.reshape(-1, 3)[:, :2]


def _model(scene: Scene, dt: float) -> mujoco.MjModel:
    """Model with x across, z up and the hinges about −y, so that rotation is anticlockwise."""
    spec = mujoco.MjSpec()
    moments = scene.bodies()
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    option = spec.option
    option.timestep = dt
    option.gravity = [0.0, 0.0, -STANDARD_GRAVITY]
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPRATIO
    option.iterations = ITERATIONS
    option.tolerance = TOLERANCE
    bodies = []
    for (x, z), mass, inertia in zip(moments.centroid, moments.mass, moments.inertia):
        own = {"mass": mass, "inertia": [inertia] * 3, "ipos": [0.0] * 3}
        bodies.append(
            spec.worldbody.add_body(pos=[x, 0.0, z], explicitinertial=True, **own)
        )
        bodies[-1].add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
        bodies[-1].add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        bodies[-1].add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
    _add_contacts(spec, [*bodies, spec.worldbody], scene, SOLREF_STEPS * dt)
    return spec.compile()


def _add_contacts(spec: mujoco.MjSpec, bodies: list, scene: Scene, time: float) -> None:
    """Pairs of a thin box, a face, and a sphere, a corner of the body on its other side."""
    corners = Corners(scene)
    silent = {"contype": 0, "conaffinity": 0}
    friction = [scene.finite_friction] * 2 + [0.0] * 3
    sides = (
        (corners.before, corners.arm_before, corners.after, corners.arm_after, 1.0),
        (corners.after, corners.arm_after, corners.before, corners.arm_before, -1.0),
    )
    for side, (owner, arm, other, reach, sense) in enumerate(sides):
        for i, joint in enumerate(corners.joint):
            normal = sense * corners.normal[i]
            face = f"face{joint} {side}"
            corner = f"corner{i} {side}"
            if i % 2 == 0:
                along = arm[i + 1] - arm[i]
                length = np.hypot(*along)
                half_angle = -0.5 * math.atan2(along[1], along[0])
                x, z = arm[i] + 0.5 * along - 0.1 * length * normal
                bodies[owner[i]].add_geom(
                    name=face,
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    pos=[x, 0.0, z],
                    **silent,
                    quat=[math.cos(half_angle), 0.0, math.sin(half_angle), 0.0],
                    size=[0.5 * length, HALF_DEPTH, 0.1 * length],
                )
            radius = RADIUS * np.hypot(*(arm[i | 1] - arm[i & ~1]))
            x, z = reach[i] + radius * normal
            bodies[other[i]].add_geom(
                name=corner,
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                pos=[x, 0.0, z],
                size=[radius, 0.0, 0.0],
                **silent,
            )
            spec.add_pair(
                geomname1=face,
                geomname2=corner,
                condim=3,
                friction=friction,
                solref=[time, 1.0],
                solimp=SOLIMP,
            )


build = MujocoStepper
