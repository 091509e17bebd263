"""MuJoCo: soft convex contacts solved by Newton's method, held to the plane by its joints."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from peers.scene import STANDARD_GRAVITY, Scene

# Near-default contacts sag by centimetres: the time constant is the smallest that is stable, the
# impedance close to one. `impratio` keeps sticking joints from creeping.
SETTINGS: dict[str, Any] = {
    "impratio": 10.0,
    "solref_steps": 2.0,
    "solimp": [0.99, 0.9999, 0.0001, 0.5, 2.0],
    "iterations": 100,
    "tolerance": 1e-10,
    "integrator": "Euler",
    "depth": 1.0,
}


class MujocoStepper:
    """A scene in MuJoCo; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float, settings: dict[str, Any]) -> None:
        self.version = f"mujoco {mujoco.__version__}"
        self.model = mujoco.MjModel.from_xml_string(_xml(scene, dt, settings))
        self.data = mujoco.MjData(self.model)
        self.start = scene.bodies().centroid
        self.most_iterations = settings["iterations"]
        # Looked at once for each call of `advance`, so as not to slow the steps.
        self.unconverged: int | None = 0
        mujoco.mj_forward(self.model, self.data)

    def advance(self, ground_acceleration: NDArray) -> None:
        model, data, gravity = self.model, self.data, self.model.opt.gravity
        step = mujoco.mj_step
        for value in ground_acceleration.tolist():
            gravity[0] = -value
            step(model, data)
        if data.solver_niter[0] >= self.most_iterations:
            self.unconverged += 1

    def centroids(self) -> NDArray:
        return self.start + self.data.qpos.reshape(-1, 3)[:, :2]

    @property
    def contacts(self) -> int | None:
        return int(self.data.ncon)


def _xml(scene: Scene, dt: float, settings: dict[str, Any]) -> str:
    """Model with x across, z up and the hinges about −y, so that the turn is counter-clockwise."""
    half = 0.5 * settings["depth"]
    solimp = " ".join(str(value) for value in settings["solimp"])
    assets, bodies, pairs = [], [], []
    moments = scene.bodies()
    outlines = scene.polygons()

    def geom(name: str, corners: NDArray) -> str:
        low, high = corners.min(axis=0), corners.max(axis=0)
        if np.allclose(np.sort(corners, axis=0), np.sort([low, low, high, high], axis=0)):
            middle, size = 0.5 * (low + high), 0.5 * (high - low)
            return (
                f'<geom name="{name}" type="box" pos="{middle[0]!r} 0 {middle[1]!r}" '
                f'size="{size[0]!r} {half!r} {size[1]!r}"/>'
            ).replace("np.float64(", "").replace(")", "")
        vertices = " ".join(
            f"{float(x)!r} {y!r} {float(z)!r}" for x, z in corners for y in (-half, half)
        )
        assets.append(f'<mesh name="{name}" vertex="{vertices}"/>')
        return f'<geom name="{name}" type="mesh" mesh="{name}"/>'

    for i, outline in enumerate(outlines):
        x, z = (float(value) for value in moments.centroid[i])
        mass, inertia = float(moments.mass[i]), float(moments.inertia[i])
        bodies.append(
            f'<body name="v{i}" pos="{x!r} 0 {z!r}">'
            f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} '
            f'{inertia!r}"/>'
            f'<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
            f'<joint type="hinge" axis="0 -1 0"/>'
            f"{geom(f'v{i}', outline - moments.centroid[i])}</body>"
        )
    supports = scene.supports()
    for i, outline in enumerate(supports):
        bodies.append(geom(f"ground{i}", outline))
    names = ["ground0", *(f"v{i}" for i in range(len(outlines)))]
    if len(supports) == 2:
        names.append("ground1")
    friction = " ".join([repr(scene.friction)] * 2 + ["0"] * 3)
    for before, after in zip(names[:-1], names[1:]):
        pairs.append(
            f'<pair geom1="{before}" geom2="{after}" condim="3" friction="{friction}" '
            f'solref="{settings["solref_steps"] * dt!r} 1" solimp="{solimp}"/>'
        )
    return f"""<mujoco>
<compiler inertiafromgeom="false" angle="radian"/>
<option timestep="{dt!r}" gravity="0 0 {-STANDARD_GRAVITY!r}" cone="elliptic"
  impratio="{settings["impratio"]!r}" iterations="{settings["iterations"]}"
  tolerance="{settings["tolerance"]!r}" integrator="{settings["integrator"]}">
<flag multiccd="enable"/></option>
<default><geom contype="0" conaffinity="0"/></default>
<asset>{"".join(assets)}</asset>
<worldbody>{"".join(bodies)}</worldbody>
<contact>{"".join(pairs)}</contact>
</mujoco>"""


def build(scene: Scene, dt: float, settings: dict[str, Any]) -> MujocoStepper:
    """Scene in MuJoCo, ready to step."""
    return MujocoStepper(scene, dt, settings)
