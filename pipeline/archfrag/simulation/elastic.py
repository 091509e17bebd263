"""Static balance of voussoirs on elastic faces: rest, and the largest steady acceleration.

Faces are those of `physics.steps.face_law`, along all of their length and without sliding. Under
an acceleration that grows slowly a mechanism turns, its hinges bear on strips that narrow with the
rotation, closed joints shorten under the forces of the load, and the arch becomes flatter by both.
The displacement is followed until the acceleration that holds the balance has passed its largest
value.
"""

from typing import Any

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.checks import FloatArray
from archfrag.physics.state import model_of
from archfrag.system import Deferred

sparse = Deferred("scipy.sparse")
linear = Deferred("scipy.sparse.linalg")

# BALANCED: largest residual over the mean weight of a body. MOST_ITERATIONS: of Newton's method.
# NUDGE: displacements of difference quotients over the mean overlap of joints under the weight.
BALANCED = 1e-6
MOST_ITERATIONS = 10
NUDGE = 1e-3
# FIRST: first step of the path over the mean length of joints. QUICKER: its growth after at most
# QUICK iterations. CUT: its reduction where no balance is found, down to SHORTEST. MOST_STEPS: of
# the path. PAST: part of the largest load to which the load has to fall for the path to end.
FIRST = 1e-5
QUICKER = 2.0
QUICK = 6
CUT = 0.3
MOST_STEPS = 300
PAST = 0.995
SHORTEST = 1e-4 * FIRST
# LARGE: unknowns from which numpy's solution has other last bits with another number of threads.
LARGE = 96


def _rotated(
    vector: FloatArray, cosine: FloatArray, sine: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotate vectors (2, n_joint, ...) by an angle, given by cosine and sine; return x and y."""
    x, y = vector
    return cosine * x - sine * y, sine * x + cosine * y


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve by operations in the same order, whatever the number of threads of the BLAS."""
    if right.size < LARGE:
        return np.asarray(np.linalg.solve(matrix, right))
    return np.asarray(linear.splu(sparse.csc_array(matrix)).solve(right))


class ElasticArch:
    """Voussoirs on elastic faces without tension that do not slide.

    Parameters
    ----------
    arch : Arch
        With rigid joints, as built.
    stiffness, shear : (n_joint,) array
        Stiffness of the joints per area [Pa/m], finite.
    """

    def __init__(self, arch: Arch, stiffness: FloatArray, shear: FloatArray) -> None:
        chain = arch.chain
        self.weight = chain.mass * chain.gravity
        self.share = chain.mass / chain.mass.sum()
        # Columns, as of all that is known of joints (n_joint, 1).
        self.stiffness = (stiffness * arch.joint_depths)[:, None]
        self.shear = (shear * arch.joint_depths)[:, None]
        # Bodies before and after each joint, the grounds counted (n_joint, 2).
        model = model_of(chain)
        self.pair = arch.pairs + 1
        self.bodies = slice(1, model.end)
        self.around = (1, model.mass.size - model.end), (0, 0)
        along = chain.face_before[:, 1] - chain.face_before[:, 0]
        self.length = np.hypot(*along.T)
        self.tangent = (along / self.length[:, None]).T[..., None]
        # Middles of joints from the centroids of the bodies before and after (2, n_joint, 2).
        faces = np.stack([chain.face_before, chain.face_after], axis=1)
        self.arm = np.moveaxis(faces.mean(axis=2), -1, 0)
        self.size = self.length.mean()
        stiff = stiffness * arch.joint_depths * self.length
        overlap = self.weight.sum() / stiff.mean()
        self.nudge = NUDGE * overlap * np.array([1.0, 1.0, 1.0 / self.size])

    def _bear(
        self,
        position: FloatArray,
        nudges: FloatArray | float = 0.0,
        closed: bool = False,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the force of each joint on the bodies before and after it, and its normal force.

        Shapes are (..., n_joint, 2, 3): x, y and moment about the centroid [N, N, N m], and
        (..., n_joint). `position` is the displacement of the bodies (n_body, 3) [m, m, rad].
        `nudges` are added to it at the bodies before and after each joint, (..., n_joint, 2, 3).
        If `closed`, all joints are in contact along all of their length.
        """
        moved = np.pad(position, self.around)[self.pair] + nudges
        x, y, angle = np.moveaxis(moved, -1, 0)
        fall = -2.0 * np.sin(0.5 * angle) ** 2
        turned_x, turned_y = _rotated(self.arm, fall, np.sin(angle))
        dx = np.diff(x + turned_x)
        dy = np.diff(y + turned_y)
        mean = angle.mean(axis=-1, keepdims=True)
        bend = 0.5 * np.diff(angle)
        tx, ty = _rotated(self.tangent, np.cos(mean), np.sin(mean))
        slip = tx * dx + ty * dy
        gap = ty * dx - tx * dy
        slope = -2.0 * np.sin(bend)
        half = 0.5 * np.maximum(self.length[:, None] - abs(slip), 0.0)
        safe = np.where(slope == 0.0, 1e-300, slope)
        zero = np.clip(-gap / safe, -half, half)
        low = np.where((safe > 0.0) | closed, -half, zero)
        high = np.where((safe > 0.0) & (not closed), zero, half)
        l0 = high - low
        l1 = (high**2 - low**2) / 2.0
        l2 = (high**3 - low**3) / 3.0
        normal = -self.stiffness * (gap * l0 + slope * l1)
        moment = np.cos(bend) * self.stiffness * (gap * l1 + slope * l2)
        along = -self.shear * l0 * slip
        # The force acts half way between both middles.
        sign = np.array([-1.0, 1.0])
        fx = (normal * ty + along * tx) * sign
        fy = (along * ty - normal * tx) * sign
        px = self.arm[0] + turned_x - 0.5 * sign * dx
        py = self.arm[1] + turned_y - 0.5 * sign * dy
        turn = px * fy - py * fx + moment * sign
        return np.stack([fx, fy, turn], axis=-1), normal[..., 0]

    def _system(
        self, position: FloatArray, closed: bool = False
    ) -> tuple[FloatArray, Any]:
        """Return the forces of joints on all bodies, and their derivatives by displacements.

        Shapes are (n_body, 3) and (3 n_body, 3 n_body).
        """
        steps = np.diag(np.tile(self.nudge, 2)).reshape(6, 1, 2, 3)
        nudges = np.concatenate([0.0 * steps[:1], steps, -steps])
        force = self._bear(position, nudges, closed)[0]
        change = (force[1:7] - force[7:]).reshape(2, 3, *force.shape[1:])
        change /= 2.0 * self.nudge[:, None, None, None]
        rows = self.weight.size + sum(self.around[0])
        total = np.zeros((rows, 3))
        np.add.at(total, self.pair, force[0])
        stiffness = np.zeros((rows, rows, 3, 3))
        blocks = self.pair[:, :, None], self.pair[:, None]
        np.add.at(stiffness, blocks, change.transpose(2, 3, 0, 4, 1))
        bodies = self.bodies
        inside = stiffness[bodies, bodies].swapaxes(1, 2)
        return total[bodies], inside.reshape(total[bodies].size, -1)

    def _balance(
        self, position: FloatArray, load: float, sway: float, held: bool = False
    ) -> tuple[FloatArray, float, int]:
        """Find balance by Newton's method; return displacements, load [g] and iterations.

        `position` and `load` are where it begins. If `held`, the load stays as given. If not, it
        is that at which the mean displacement against it is `sway` [m]. There are more than 4
        `MOST_ITERATIONS` iterations if no balance is found.
        """
        size = position.size
        system = np.zeros((size + 1, size + 1))
        left = np.zeros(size + 1)
        system[:size:3, -1] = -self.weight
        system[-1, :size:3] = (not held) * self.share
        system[-1, -1] = held
        for iteration in range(MOST_ITERATIONS * (1 + 3 * held)):
            force, system[:-1, :-1] = self._system(position)
            force[:, 0] -= load * self.weight
            force[:, 1] -= self.weight
            left[:-1] = force.ravel()
            left[-1] = (not held) * (self.share @ position[:, 0] + sway)
            error = np.abs(force / (1.0, 1.0, self.size)).max() / self.weight.mean()
            if error < BALANCED and abs(left[-1]) < BALANCED * FIRST * self.size:
                return position, load, iteration
            try:
                step = _solved(system, -left)
            except (np.linalg.LinAlgError, RuntimeError):  # singular
                break
            if not np.isfinite(step).all():
                break
            position = position + step[:-1].reshape(-1, 3)
            load = load + step[-1]
        return position, load, 5 * MOST_ITERATIONS

    def rest(self) -> tuple[FloatArray, FloatArray] | None:
        """Return the displacements of bodies and the normal forces of joints under the weight.

        Shapes are (n_body, 3) [m, m, rad] and (n_joint,) [N]. None if no balance is found.
        """
        start = np.zeros((self.weight.size, 3))
        _, closed = self._system(start, closed=True)
        start[:, 1] = self.weight
        position = _solved(closed, start.ravel()).reshape(-1, 3)
        position, _, iterations = self._balance(position, 0.0, 0.0, held=True)
        if iterations > 4 * MOST_ITERATIONS:
            return None
        return position, self._bear(position)[1]

    def largest_load(self, rest: FloatArray, sense: float) -> tuple[float, FloatArray]:
        """Find the largest steady ground acceleration [g]; return it and the normal forces [N].

        `rest` are the displacements under the weight, `sense` is +1 or -1 for acceleration towards
        +x or -x. The acceleration is inf if it grows as far as the balance is followed. The normal
        forces are those of all joints under it, (n_joint,).

        The mean displacement of the bodies against the acceleration grows step by step. In each
        step the acceleration is found that holds them there, so that the path passes its largest
        value.
        """
        position = rest
        load = 0.0
        sway = -self.share @ rest[:, 0]
        step = FIRST * self.size
        before = (rest, 0.0, np.inf)
        path = [(sway, 0.0)]
        normal = np.zeros(self.length.size)
        for _ in range(MOST_STEPS):
            ahead = step / before[2]
            start = position + ahead * (position - before[0])
            guess = load + ahead * (load - before[1])
            there, held, iterations = self._balance(start, guess, sway + sense * step)
            if iterations > MOST_ITERATIONS:
                step *= CUT
                if step < SHORTEST * self.size:
                    break
                continue
            before = position, load, step
            position = there
            load = held
            sway = sway + sense * step
            path.append((sway, sense * load))
            loads = np.array(path)[:, 1]
            if sense * load == loads.max():
                normal = self._bear(position)[1]
            elif sense * load < PAST * loads.max():
                top = int(np.argmax(loads))
                at, near = np.array(path[top - 1 : top + 2]).T
                curve, slope, level = np.polyfit(at - at[1], near, 2)
                return float(level - slope**2 / (4.0 * curve)), normal
            step *= QUICKER if iterations <= QUICK else 1.0
        return np.inf, normal
