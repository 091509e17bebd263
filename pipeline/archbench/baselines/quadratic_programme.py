"""Each step a strictly convex quadratic programme in the velocities, with associative friction.

As Loetstedt (1982, *SIAM J. Appl. Math.* 42(2); 1984, *SIAM J. Sci. Stat. Comput.* 5(2), 370-393)
and Glocker and Pfeiffer (1996, *Multibody Dynamics with Unilateral Contacts*), with Signorini's
law on the velocities of a step as Anitescu and Potra have it (1997, *Nonlinear Dynamics* 14,
231-247): of all velocities that the joints admit, those nearest to the velocities without
reactions, in the metric of the masses (Gauss's principle). With two contacts at each joint
(`step`) these are

    minimise (w - w_free) M (w - w_free)   with   u_n + b +- mu u_t >= 0   at every corner,

two linear inequalities a corner in the plane. Coulomb's cone of reactions is exact; slip has a
part mu times its size normal to the joint, as under the associated flow rule (Anitescu 2006,
*Math. Program.* 105, 113-143). Where friction is infinite a corner that touches gets u_n + b >= 0
and u_t = 0; one that closes in the step gets both in a second pass.

`docs/evidence.md` says what the method gets wrong. It costs 11 to 12.5 iterations of the solver a
step whatever the number of voussoirs.
"""

from typing import Any

import numpy as np

from archbench.baselines.common import Case, integrate
from archbench.baselines.corners import (
    accept_corners,
    corner_case,
    new_corners,
    pose_corners,
)
from archfrag.physics.ground import Grounds, Impulse
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.state import Clock
from archfrag.physics.status import Count, Wait

# A corner without friction limit sticks from the start where its gap is below this part of the
# joint; multipliers below NEGLIGIBLE of the largest, and slip slower than that part of what
# gravity gives in a step, are what an interior-point method leaves of zero.
TOUCHING = 1e-7
NEGLIGIBLE = 1e-6


class Programme:
    """The quadratic programme of a step, in velocities times root mass over gravity times step."""

    def __init__(self, case: Case, tolerance: float) -> None:
        # The only use of either package here; whoever calls has seen that they are there.
        import piqp
        from scipy.sparse import csc_matrix

        self._solver_of = piqp.SparseSolver
        self._matrix = csc_matrix
        self._solved = piqp.PIQP_SOLVED
        self._unfinished = piqp.PIQP_MAX_ITER_REACHED
        self._tolerance = tolerance
        self.case = case
        self.corners = new_corners(case.model)
        model = case.model
        self._root = np.sqrt(
            np.stack([model.mass, model.mass, model.inertia], axis=1)[1:-1]
        ).ravel()
        n_joint = model.friction.size
        self._size = self._root.size
        place = 3 * np.arange(n_joint)[:, None] - 3 + np.arange(6)
        self._column = np.repeat(place, 4, axis=0).reshape(-1, 6)
        self._inside = (self._column >= 0) & (self._column < self._size)
        self.rough = np.isinf(model.friction)
        self._mu = np.where(self.rough, 0.0, model.friction)[:, None]
        self.multiplier = np.zeros((n_joint, 2, 2))
        self._set_up_for: np.ndarray | None = None

    def _rows(self, chosen: np.ndarray) -> tuple[Any, np.ndarray]:
        """Matrix of some rows, and where in all rows its values come from."""
        inside = self._inside[chosen]
        source = (6 * chosen[:, None] + np.arange(6))[inside]
        columns = self._column[chosen][inside]
        matrix = self._matrix(
            (np.arange(source.size, dtype=float), (np.nonzero(inside)[0], columns)),
            shape=(chosen.size, self._size),
        )
        return matrix, source[matrix.data.astype(int)]

    def pose(self) -> Impulse:
        """Write the programme of the next step."""
        case = self.case
        corners = self.corners
        impulse = Impulse(*pose_corners(case, corners))
        self.unit = case.model.gravity * float(case.state.clock[Clock.STEP])
        normal = corners.row[:, :, 0]
        tangential = corners.row[:, :, 1]
        mu = self._mu[..., None]
        rough = self.rough[:, None]
        second = np.where(rough[..., None], tangential, normal - mu * tangential)
        row = np.stack([normal + mu * tangential, second], axis=2)
        row *= np.sqrt(corners.inverse)[:, None, None]
        self.norm = np.linalg.norm(row, axis=-1)
        self.row = row / self.norm[..., None]
        self.low = -corners.bias[..., None] / (self.unit * self.norm)
        self.low[self.rough, :, 1] = -np.inf
        self.sticks = np.zeros(self.low.shape, bool)
        self.sticks[..., 1] = rough & (
            corners.gap <= TOUCHING * case.model.length[:, None]
        )
        self.linear = -self._root * case.work.free[1:-1].ravel() / self.unit
        return impulse

    def _set_up(self) -> None:
        """A solver for the corners that stick now."""
        self._set_up_for = self.sticks
        self._above = np.flatnonzero(np.isfinite(self.low))
        self._equal = np.flatnonzero(self.sticks)
        self._above_matrix, self._above_source = self._rows(self._above)
        self._equal_matrix, self._equal_source = self._rows(self._equal)
        self._solver = self._solver_of()
        settings = self._solver.settings
        settings.eps_abs = settings.eps_rel = self._tolerance
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = self._tolerance

    def solve(self) -> tuple[int, bool, bool]:
        """Solve the programme as it stands; iterations, solved, usable."""
        fresh = self._set_up_for is None or not np.array_equal(
            self._set_up_for, self.sticks
        )
        if fresh:
            self._set_up()
        values = self.row.ravel()
        low = self.low.ravel()[self._above]
        self._above_matrix.data = values[self._above_source]
        self._equal_matrix.data = values[self._equal_source]
        equal: Any = (self._equal_matrix, np.zeros(self._equal.size))
        if not self._equal.size:
            equal = (None, None)
        if fresh:
            ones = np.ones(self._size)
            n = np.arange(self._size + 1)
            metric = self._matrix((ones, n[:-1], n), shape=(self._size, self._size))
            self._solver.setup(metric, self.linear, *equal, self._above_matrix, low)
        else:
            self._solver.update(
                c=self.linear, A=equal[0], b=equal[1], G=self._above_matrix, h_l=low
            )
        status = self._solver.solve()
        result = self._solver.result
        self.solution = np.array(result.x)
        self.multiplier[:] = 0.0
        self.multiplier.ravel()[self._above] = result.z_l
        self.multiplier.ravel()[self._equal] = -result.y
        solved = status == self._solved
        usable = (solved or status == self._unfinished) and np.isfinite(
            self.solution
        ).all()
        return int(result.info.iter), solved, bool(usable)

    def close_rough(self) -> bool:
        """Let corners without friction limit stick where the solved step closes them.

        Returns whether there are any, and the programme has to be solved again.
        """
        compressive = self.multiplier[..., 0] > NEGLIGIBLE * max(
            self.multiplier.max(), 0.0
        )
        closes = compressive & self.rough[:, None] & ~self.sticks[..., 1]
        self.sticks = self.sticks.copy()
        self.sticks[..., 1] |= closes
        return bool(closes.any())

    def take_solution(self) -> None:
        """Velocities, impulses and what each contact does, from a solved programme."""
        case = self.case
        corners = self.corners
        unit = self.unit
        work = case.work
        mu = self._mu
        rough = self.rough[:, None]
        work.solved[1:-1] = (unit * self.solution / self._root).reshape(-1, 3)
        both = np.hstack([work.solved[: rough.size], work.solved[1 : rough.size + 1]])
        impulse = self.multiplier * unit / self.norm
        # In flight no multiplier means anything: what the lightest body weighs in a step counts.
        least = NEGLIGIBLE * max(
            unit * float(case.model.mass[1:-1].min()), impulse.max()
        )
        first = impulse[..., 0]
        second = impulse[..., 1]
        normal = np.where(rough, first, first + second)
        tangential = np.where(rough, second, mu * (first - second))
        speed = np.einsum("jkc,jc->jk", corners.row[:, :, 1], both)
        slides = ~rough & (abs(speed) > NEGLIGIBLE * unit)
        sense = np.where(second <= least, 1.0, np.where(first <= least, -1.0, 0.0))
        work.contact[:] = touches = normal > least
        corners.slide[:] = np.where(touches & slides, sense, 0.0)
        corners.impulse[..., 0] = np.where(touches, normal, 0.0)
        corners.impulse[..., 1] = np.where(touches, tangential, 0.0)

    def make_step(self) -> None:
        """Solve and make one step, and leave in the clock how it goes on."""
        state = self.case.state
        impulse = self.pose()
        iterations, solved, usable = self.solve()
        while usable and self.rough.any() and self.close_rough():
            more, solved, usable = self.solve()
            iterations += more
        state.count[Count.ITERATIONS] += iterations
        if not usable:
            state.clock[Clock.CODE] = Wait.UNSOLVED
            return
        self.take_solution()
        accept_corners(self.case, self.corners, impulse, solved)


def run(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
    solver_tolerance: float,
) -> Outcomes:
    """Integrate one chain; arguments and result as `archfrag.physics.steps.run.run`."""
    case = corner_case(chain, grounds, factor, from_rest, options, frames, log)
    programme = Programme(case, solver_tolerance)

    def advance() -> None:
        while case.state.clock[Clock.CODE] == Wait.GO:
            programme.make_step()

    return integrate(case, advance, position, velocity, from_rest)
