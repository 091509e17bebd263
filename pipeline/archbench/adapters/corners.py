"""Contact points of a chain: each corner behind a joint against the face of the body before it."""

import numpy as np

from archbench.scene import Array, Scene


class Corners:
    """Two contact points at each joint, for solvers that are given theirs.

    `joint`, `before`, `after` are (n_contact,): the joint and the bodies on both sides; the ground
    is the body after the last. `columns` (n_contact, 6) are those of both bodies among all
    positions. `normal` is that of the face of the body before, `arm_before` and `arm_after` reach
    from either centroid (`place`) to the corner, (n_contact, 2) each, at rest [m].
    """

    def __init__(self, scene: Scene) -> None:
        centroid = scene.bodies().centroid
        self.count = count = len(centroid)
        inner, outer = scene.joint_lines()
        n_joint = count if scene.free_end else count + 1
        middle = 0.5 * (inner + outer)
        travel = np.diff(
            middle, axis=0, append=middle[-1:] + middle[-1:] - middle[-2:-1]
        )
        along = outer - inner
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        normal *= np.sign(np.sum(normal * travel, axis=1))[:, None]
        normal /= np.hypot(*along.T)[:, None]
        self.joint = np.repeat(np.arange(n_joint), 2)
        corner = np.column_stack([inner, outer]).reshape(-1, 2)[: 2 * n_joint]
        self.place = np.vstack([centroid, np.zeros(2)])
        self.before = np.where(self.joint > 0, self.joint - 1, count)
        self.after = np.where(self.joint < count, self.joint, count)
        both = np.column_stack([self.before, self.after])
        self.columns = (3 * both[:, :, None] + np.arange(3)).reshape(-1, 6)
        self.normal = normal[self.joint]
        self.arm_before = corner - self.place[self.before]
        self.arm_after = corner - self.place[self.after]

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """Gap and slip of each contact [m], and their derivatives, at positions (n_body, 3).

        Values (n_contact, 2) are along the normal of the body before, and across it
        (anticlockwise); derivatives (n_contact, 2, 6) by the body before, then by that after.
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
            spin = -(reach.conj() * e).imag, (arm_after.conj() * e).imag
            matrix[:, row] = np.column_stack(
                [-e.real, -e.imag, spin[0], e.real, e.imag, spin[1]]
            )
        return value, matrix
