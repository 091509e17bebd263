"""Contact points of a chain: each corner behind a joint against the face of the body before it."""

import numpy as np
from numpy.typing import NDArray

from archbench.scene import Scene

Array = NDArray[np.float64]


class Corners:
    """Two contact points at each joint, for solvers that are given theirs.

    Attributes
    ----------
    joint, before, after : (n_contact,) ndarray of int
        Joint, and the bodies on both sides of it; the ground is the body after the last.
    place : (n_body + 1, 2) ndarray
        Centroids at rest, of the ground the origin [m]; positions `q` count from there.
    normal : (n_contact, 2) ndarray
        Of the face of the body before, at rest.
    arm_before, arm_after : (n_contact, 2) ndarray
        Corner from either centroid, at rest [m].
    """

    def __init__(self, scene: Scene) -> None:
        centroid = scene.bodies().centroid
        self.count = count = len(centroid)
        inner, outer = scene.joint_lines()
        n_joint = count if scene.free_end else count + 1
        middle = 0.5 * (inner + outer)
        travel = np.diff(middle, axis=0, append=middle[-1:] + middle[-1:] - middle[-2:-1])
        along = outer - inner
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        normal *= np.sign(np.sum(normal * travel, axis=1))[:, None]
        normal /= np.hypot(*along.T)[:, None]
        self.joint = np.repeat(np.arange(n_joint), 2)
        corner = np.column_stack([inner, outer]).reshape(-1, 2)[: 2 * n_joint]
        self.place = np.vstack([centroid, np.zeros(2)])
        self.before = np.where(self.joint > 0, self.joint - 1, count)
        self.after = np.where(self.joint < count, self.joint, count)
        self.normal = normal[self.joint]
        self.arm_before = corner - self.place[self.before]
        self.arm_after = corner - self.place[self.after]

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """Gap and slip of each contact, and their derivatives.

        Parameters
        ----------
        q : (n_body, 3) ndarray
            Displacements and rotations from rest [m], [rad].

        Returns
        -------
        value : (n_contact, 2) ndarray [m]
            Along the normal of the body before, and across it (anticlockwise).
        matrix : (n_contact, 2, 6) ndarray
            By the positions of the body before, then of the body after.
        """
        q = np.vstack([q, np.zeros(3)])
        rotation = np.exp(1j * q[:, 2])
        centre = (self.place + q[:, :2]) @ [1.0, 1j]
        arm_before = rotation[self.before] * (self.arm_before @ [1.0, 1j])
        arm_after = rotation[self.after] * (self.arm_after @ [1.0, 1j])
        apart = centre[self.after] + arm_after - centre[self.before] - arm_before
        normal = rotation[self.before] * (self.normal @ [1.0, 1j])
        # The frame rotates with the body before, so its arm reaches the other's corner.
        reach = arm_before + apart
        matrix = np.empty((len(apart), 2, 6))
        value = np.empty((len(apart), 2))
        for row, e in enumerate((normal, 1j * normal)):
            value[:, row] = (e.conj() * apart).real
            matrix[:, row, 0], matrix[:, row, 1] = -e.real, -e.imag
            matrix[:, row, 2] = -(reach.conj() * e).imag
            matrix[:, row, 3], matrix[:, row, 4] = e.real, e.imag
            matrix[:, row, 5] = (arm_after.conj() * e).imag
        return value, matrix
