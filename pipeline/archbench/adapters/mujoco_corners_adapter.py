"""MuJoCo: soft convex contacts solved by Newton's method, held to the plane by its joints."""

import math

import mujoco
import numpy as np

from archbench.adapters.corners import Corners
from archbench.scene import STANDARD_GRAVITY, Array, Scene

VERSION = f"mujoco {mujoco.__version__}"
ITERATIONS, TOLERANCE = 100, 1e-10
# Near-default contacts sag by centimetres: the time constant is the smallest that is stable, the
# impedance close to one. `impratio` keeps sticking joints from creeping.
IMPRATIO, SOLREF_STEPS, SOLIMP = 10.0, 2.0, "0.99 0.9999 0.0001 0.5 2.0"
RADIUS, REACH, HALF_DEPTH = 1e-3, 0.05, 0.5  # of corners [m]; of faces beyond their joint; [m]


class MujocoStepper:
    """A scene in MuJoCo; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float) -> None:
        self.model = mujoco.MjModel.from_xml_string(_xml(scene, dt))
        self.data, self.start = mujoco.MjData(self.model), scene.bodies().centroid
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


def _xml(scene: Scene, dt: float) -> str:
    """Model with x across, z up and the hinges about −y, so that rotation is anticlockwise."""
    moments = scene.bodies()
    geoms, pairs = _corner_contacts(scene)
    friction = " ".join([repr(scene.finite_friction)] * 2 + ["0"] * 3)
    contacts = [
        f'<pair geom1="{before}" geom2="{after}" condim="3" friction="{friction}" '
        f'solref="{SOLREF_STEPS * dt!r} 1" solimp="{SOLIMP}"/>'
        for before, after in pairs
    ]
    bodies = [
        f'<body pos="{x!r} 0 {z!r}"><inertial pos="0 0 0" mass="{mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        f'<joint type="hinge" axis="0 -1 0"/>{"".join(parts)}</body>'
        for (x, z), mass, inertia, parts in zip(
            moments.centroid.tolist(), moments.mass.tolist(), moments.inertia.tolist(), geoms
        )
    ]
    return f"""<mujoco>
<compiler inertiafromgeom="false" angle="radian"/>
<option timestep="{dt!r}" gravity="0 0 {-STANDARD_GRAVITY!r}" cone="elliptic"
  impratio="{IMPRATIO!r}" iterations="{ITERATIONS}" tolerance="{TOLERANCE!r}"/>
<default><geom contype="0" conaffinity="0"/></default>
<worldbody>{"".join(bodies)}{"".join(geoms[-1])}</worldbody>
<contact>{"".join(contacts)}</contact>
</mujoco>"""


def _corner_contacts(scene: Scene) -> tuple[list[list[str]], list[tuple[str, str]]]:
    """Geoms of each body, then of the ground, and pairs: faces are thin boxes, corners spheres."""
    corners, pairs = Corners(scene), []
    geoms: list[list[str]] = [[] for _ in range(corners.count + 1)]
    bodies = zip(corners.joint.tolist(), corners.before.tolist(), corners.after.tolist())
    for i, (joint, before, after) in enumerate(bodies):
        normal = corners.normal[i]
        if i % 2 == 0:
            along = corners.arm_before[i + 1] - corners.arm_before[i]
            length, angle = float(np.hypot(*along)), -math.atan2(along[1], along[0])
            middle = corners.arm_before[i] + 0.5 * along
            x, z = (middle - 0.1 * length * normal).tolist()
            half = 0.5 * length + REACH * scene.thickness
            geoms[before].append(
                f'<geom name="face{joint}" type="box" pos="{x!r} 0 {z!r}" euler="0 {angle!r} 0" '
                f'size="{half!r} {HALF_DEPTH!r} {0.1 * length!r}"/>'
            )
        x, z = (corners.arm_after[i] + RADIUS * normal).tolist()
        geoms[after].append(
            f'<geom name="corner{i}" type="sphere" pos="{x!r} 0 {z!r}" size="{RADIUS!r}"/>'
        )
        pairs.append((f"face{joint}", f"corner{i}"))
    return geoms, pairs


build = MujocoStepper
