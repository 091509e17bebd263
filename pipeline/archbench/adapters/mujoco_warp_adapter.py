"""MuJoCo Warp: MuJoCo's scene by its engine for GPUs, here on a CPU, in single precision."""

import mujoco_warp as mjw
import numpy as np
import warp as wp

from archbench.adapters.mujoco_corners_adapter import MujocoStepper
from archbench.scene import STANDARD_GRAVITY, Array, Scene

VERSION = f"mujoco_warp {mjw.__version__}, warp {wp.__version__}"
CONTACTS = 8  # room for each body, and rows for each contact
ROWS = 4


class MujocoWarpStepper(MujocoStepper):
    """A scene in MuJoCo Warp; the ground motion is a body force."""

    def __init__(self, scene: Scene, dt: float) -> None:
        super().__init__(scene, dt)
        contacts = CONTACTS * (len(self.start) + 2)
        room = {"nconmax": contacts, "njmax": ROWS * contacts}
        with wp.ScopedDevice("cpu"):
            self.warp = mjw.put_model(self.model)
            self.state = mjw.put_data(self.model, self.data, **room)
            self.step(0.0)  # compiles, which no clock may see
            self.state = mjw.put_data(self.model, self.data, **room)

    def step(self, acceleration: float) -> None:
        self.warp.opt.gravity.assign(
            np.array([[-acceleration, 0.0, -STANDARD_GRAVITY]])
        )
        with wp.ScopedDevice("cpu"):
            mjw.step(self.warp, self.state)

    def centroids(self) -> Array:
        self.unconverged += int(
            self.state.solver_niter.numpy()[0] >= self.warp.opt.iterations
        )
        return self.start + self.state.qpos.numpy().reshape(-1, 3)[:, :2]


build = MujocoWarpStepper
