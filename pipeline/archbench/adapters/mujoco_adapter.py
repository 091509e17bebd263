"""MuJoCo: soft convex contacts solved by Newton's method, held to the plane by its joints."""

import math
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from archbench.adapters.corners import Corners
from archbench.scene import STANDARD_GRAVITY, Scene

# Near-default contacts sag by centimetres: the time constant is the smallest that is stable, the
# impedance close to one. `impratio` keeps sticking joints from creeping. `contacts` are those that
# MuJoCo finds between convex hulls, four at a closed joint, or "corners", two at each joint: half
# the cost, for chains only, and it creeps more.
VERSION = f"mujoco {mujoco.__version__}"
SETTINGS: dict[str, Any] = {
    "impratio": 10.0,
    "solref_steps": 2.0,
    "solimp": [0.99, 0.9999, 0.0001, 0.5, 2.0],
    "iterations": 100,
    "tolerance": 1e-10,
    "integrator": "Euler",
    "jacobian": "auto",
    "depth": 1.0,  # [m]
    "contacts": "hulls",
}


class MujocoStepper:
    """A scene in MuJoCo; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        self.model = mujoco.MjModel.from_xml_string(_xml(scene, dt, settings))
        self.data = mujoco.MjData(self.model)
        self.start = scene.bodies().centroid
        self.most_iterations = settings["iterations"]
        # Looked at once for each call of `advance`, so as not to slow the steps.
        self.unconverged = 0
        shift, velocity = scene.initial_state()
        self.data.qpos[:], self.data.qvel[:] = shift.ravel(), velocity.ravel()
        mujoco.mj_forward(self.model, self.data)

    def advance(self, ground_acceleration: NDArray) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""
        model, data, gravity = self.model, self.data, self.model.opt.gravity
        step = mujoco.mj_step
        for value in ground_acceleration.tolist():
            gravity[0] = -value
            step(model, data)
        if data.solver_niter[0] >= self.most_iterations:
            self.unconverged += 1

    def centroids(self) -> NDArray:
        return self.start + self.data.qpos.reshape(-1, 3)[:, :2]


def _xml(scene: Scene, dt: float, settings: dict[str, Any]) -> str:
    """Model with x across, z up and the hinges about −y, so that rotation is anticlockwise."""
    place = scene.bodies().centroid
    geoms: list[list[str]] = [[] for _ in range(len(place) + 1)]
    assets: list[str] = []
    pairs = (_corner_pairs if settings["contacts"] == "corners" else _hull_pairs)(
        scene, settings, geoms, assets
    )
    friction = " ".join([repr(scene.finite_friction)] * 2 + ["0"] * 3)
    solimp = " ".join(str(value) for value in settings["solimp"])
    contacts = [
        f'<pair geom1="{before}" geom2="{after}" condim="3" friction="{friction}" '
        f'solref="{settings["solref_steps"] * dt!r} 1" solimp="{solimp}"/>'
        for before, after in pairs
    ]
    moments = scene.bodies()
    bodies = [
        f'<body pos="{x!r} 0 {z!r}"><inertial pos="0 0 0" mass="{mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        f'<joint type="hinge" axis="0 -1 0"/>{"".join(parts)}</body>'
        for (x, z), mass, inertia, parts in zip(
            place.tolist(), moments.mass.tolist(), moments.inertia.tolist(), geoms
        )
    ]
    return f"""<mujoco>
<compiler inertiafromgeom="false" angle="radian"/>
<option timestep="{dt!r}" gravity="0 0 {-STANDARD_GRAVITY!r}" cone="elliptic"
  impratio="{settings["impratio"]!r}" iterations="{settings["iterations"]}"
  tolerance="{settings["tolerance"]!r}" integrator="{settings["integrator"]}"
  jacobian="{settings["jacobian"]}"><flag multiccd="enable"/></option>
<default><geom contype="0" conaffinity="0"/></default>
<asset>{"".join(assets)}</asset>
<worldbody>{"".join(bodies)}{"".join(geoms[-1])}</worldbody>
<contact>{"".join(contacts)}</contact>
</mujoco>"""


def _hull_pairs(
    scene: Scene, settings: dict[str, Any], geoms: list[list[str]], assets: list[str]
) -> list[tuple[str, str]]:
    """Voussoirs as convex meshes, each against its neighbours."""
    half = 0.5 * settings["depth"]

    def add(name: str, corners: NDArray, body: int) -> None:
        vertices = " ".join(
            f"{x!r} {y!r} {z!r}" for x, z in corners.tolist() for y in (-half, half)
        )
        assets.append(f'<mesh name="{name}" vertex="{vertices}"/>')
        geoms[body].append(f'<geom name="{name}" type="mesh" mesh="{name}"/>')

    centroid = scene.bodies().centroid
    names = []
    for i, outline in enumerate(scene.polygons()):
        names.append(f"v{i}")
        add(names[-1], outline - centroid[i], i)
    supports = scene.supports()
    for i, outline in enumerate(supports):
        add(f"ground{i}", outline, -1)
    names = ["ground0", *names, *(["ground1"] if len(supports) == 2 else [])]
    return list(pairwise(names))


def _corner_pairs(
    scene: Scene, settings: dict[str, Any], geoms: list[list[str]], assets: list[str]
) -> list[tuple[str, str]]:
    """Two corners of the body behind each joint against the face of the body before it.

    Corners are spheres of a millimetre, faces thin boxes that reach a little beyond the joint.
    """
    radius, reach, half = 1e-3, 0.05 * scene.thickness, 0.5 * settings["depth"]
    corners = Corners(scene)
    bodies = zip(corners.joint.tolist(), corners.before.tolist(), corners.after.tolist())
    pairs = []
    for i, (joint, before, after) in enumerate(bodies):
        normal = corners.normal[i]
        if i % 2 == 0:
            along = corners.arm_before[i + 1] - corners.arm_before[i]
            length, angle = float(np.hypot(*along)), -math.atan2(along[1], along[0])
            middle = corners.arm_before[i] + 0.5 * along
            x, z = (middle - 0.1 * length * normal).tolist()
            geoms[before].append(
                f'<geom name="face{joint}" type="box" pos="{x!r} 0 {z!r}" euler="0 {angle!r} 0" '
                f'size="{0.5 * length + reach!r} {half!r} {0.1 * length!r}"/>'
            )
        x, z = (corners.arm_after[i] + radius * normal).tolist()
        geoms[after].append(
            f'<geom name="corner{i}" type="sphere" pos="{x!r} 0 {z!r}" size="{radius!r}"/>'
        )
        pairs.append((f"face{joint}", f"corner{i}"))
    return pairs


build = MujocoStepper
