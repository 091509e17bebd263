"""Each step a strictly convex quadratic programme in the velocities, with associative friction.

The way of Loetstedt (1982, *SIAM J. Appl. Math.* 42(2); 1984, *SIAM J. Sci. Stat. Comput.* 5(2),
370-393) and Glocker and Pfeiffer (1996, *Multibody Dynamics with Unilateral Contacts*), with
Signorini's law on the velocities of a step as Anitescu and Potra have it (1997, *Nonlinear
Dynamics* 14, 231-247): of all velocities that the joints admit, those nearest to the velocities
without reactions, in the metric of the masses (Gauss's principle). With two contacts at each
joint (`corner_contacts`) these are

    minimise (w - w_free) M (w - w_free)   with   u_n + b +- mu u_t >= 0   at every corner,

two linear inequalities a corner in the plane. Coulomb's cone of reactions is exact; the price is
that slip has a part mu times its size normal to the joint, as under the associated flow rule of
limit analysis (Anitescu 2006, *Math. Program.* 105, 113-143, uses it knowingly). Where friction is
infinite a corner that touches gets u_n + b >= 0 and u_t = 0; one that closes in the step gets both
in a second pass.

What it gets wrong, as measured:

- Slip lifts. A block pushed along the ground hovers at mu times its slip in one step (0.235 mm at
  0.59 m/s, mu 0.4, 1 ms): an error of first order in the step. A contact that slides fast from one
  instant to the next, as after an impact, is thrown: a block set off at v leaves the ground at
  mu v / (1 + mu^2), 6.1 mm high for 1 m/s and mu 0.4, whatever the step, and 12 % of its energy
  has no law to explain it. Coulomb's law then fails by the whole velocity.
- Where little slides the difference is small but shows: on the arch of `gauss_seidel` with 7
  voussoirs nothing slides, and its verdicts are the same; with 27 and 81 the largest displacement
  is 1 % and 4 % off what Gauss-Seidel converges to, the contact laws by 0.02 to 0.03.
- Impacts are of first order in the step, and verdicts near collapse follow the step, as there.

It costs 11 to 12.5 iterations of the solver a step whatever the number of voussoirs.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from archfrag.mechanics.collapse import JointState, new_joint_state
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.ledger import new_ledger
from archfrag.mechanics.status import Count, Status
from archfrag.mechanics.types import (
    Chain,
    Frames,
    GroundMotion,
    Ledger,
    MechanismLog,
    Options,
    Outcome,
)
from archfrag.methods.corner_contacts import (
    BACKWARD,
    FORWARD,
    FREE,
    GO,
    STICKING,
    Clock,
    Corners,
    accept_step,
    begin,
    corner_velocity,
    finish,
    gather_joints,
    new_corners,
    pose_step,
)
from archfrag.methods.stepping import Kick

UNFINISHED = int(Status.UNFINISHED)
WORK_BOUND = int(Status.WORK_BOUND)
NO_SOLUTION = int(Status.NO_CONTACT_SOLUTION)

# A corner without friction limit sticks from the start where its gap is below this part of the
# joint; multipliers below NEGLIGIBLE of the largest, and slip slower than that part of what
# gravity gives in a step, are what an interior-point method leaves of nought.
TOUCHING = 1e-7
NEGLIGIBLE = 1e-6
THETA = 0.5


class Programme(NamedTuple):
    """The quadratic programme of a step, in velocities times root mass over gravity times step."""

    root: np.ndarray  # (n_body, 3) roots of the masses and inertias
    row: np.ndarray  # (n_row, 6) on the body before, on the body after; of length one
    norm: np.ndarray  # (n_row,) by which rows were divided
    low: np.ndarray  # (n_row,) lower bounds; -inf: none
    linear: np.ndarray  # (n_body, 3) minus the free velocities
    multiplier: np.ndarray  # (n_row,)
    solution: np.ndarray  # (n_body, 3)
    sticks: np.ndarray  # (n_row,) int8: 1 where the row is an equality


class Case(NamedTuple):
    """What all steps of a run share."""

    chain: Chain
    ground: GroundMotion
    options: Options
    corners: Corners
    joints: JointState
    ledger: Ledger
    frames: Frames
    log: MechanismLog
    programme: Programme


@allocating
def new_programme(chain):
    """Room for the programmes of a chain: rows 4 j + 2 corner + (0, 1) are those of a corner.

    Returns
    -------
    Programme
    """
    n_body, n_row = chain.mass.size, 4 * chain.friction.size
    root = np.empty((n_body, 3))
    for i in range(n_body):
        root[i, 0] = root[i, 1] = np.sqrt(chain.mass[i])
        root[i, 2] = np.sqrt(chain.inertia[i])
    return Programme(
        root,
        np.zeros((n_row, 6)),
        np.ones(n_row),
        np.zeros(n_row),
        np.zeros((n_body, 3)),
        np.zeros(n_row),
        np.zeros((n_body, 3)),
        np.zeros(n_row, np.int8),
    )


@kernel
def _write_row(r, j, corner, along, case):
    """Row of the inequality on u_n + along u_t; `along` infinite: of u_t alone."""
    corners, programme = case.corners, case.programme
    nx, ny = corners.normal[j, corner, 0], corners.normal[j, corner, 1]
    lever, row = corners.lever[j, corner], programme.row[r]
    one, slope = (0.0, 1.0) if np.isinf(along) else (1.0, along)
    square = 0.0
    for side in range(2):
        body, sign, at = j - side, 1.0 - 2.0 * side, 3 * (1 - side)
        if not 0 <= body < programme.root.shape[0]:
            row[at] = row[at + 1] = row[at + 2] = 0.0
            continue
        turn = one * lever[2 * side] + slope * lever[2 * side + 1]
        row[at] = sign * (one * nx - slope * ny) / programme.root[body, 0]
        row[at + 1] = sign * (one * ny + slope * nx) / programme.root[body, 1]
        row[at + 2] = sign * turn / programme.root[body, 2]
        square += row[at] ** 2 + row[at + 1] ** 2 + row[at + 2] ** 2
    norm = np.sqrt(square)
    programme.norm[r] = norm
    for k in range(6):
        row[k] /= norm


@kernel
def pose_programme(case, position, velocity):
    """Write the quadratic programme of the next step; returns what the ground gives in it.

    Parameters
    ----------
    case : Case
    position, velocity : ndarray, (n_body, 3)

    Returns
    -------
    archfrag.methods.stepping.Kick
    """
    chain, corners, programme = case.chain, case.corners, case.programme
    step = case.options.time_step
    kick = pose_step(chain, case.ground, corners, case.joints, position, velocity, step, THETA)
    unit = chain.gravity * step
    for j in range(chain.friction.size):
        mu = chain.friction[j]
        for corner in range(2):
            r = 4 * j + 2 * corner
            bias = corners.bias[j, corner]
            rough = np.isinf(mu)
            _write_row(r, j, corner, 0.0 if rough else mu, case)
            _write_row(r + 1, j, corner, np.inf if rough else -mu, case)
            programme.low[r] = -bias / (unit * programme.norm[r])
            programme.low[r + 1] = -np.inf if rough else -bias / (unit * programme.norm[r + 1])
            touching = corners.gap[j, corner] <= TOUCHING * corners.length[j]
            programme.sticks[r + 1] = rough and touching
    for i in range(velocity.shape[0]):
        for k in range(3):
            programme.linear[i, k] = -programme.root[i, k] * corners.free[i, k] / unit
    return kick


@kernel
def close_rough(case):
    """Let corners without friction limit stick where the solved step closes them.

    Returns
    -------
    bool
        Whether there are any, and the programme has to be solved again.
    """
    programme, again = case.programme, False
    largest = 0.0
    for r in range(programme.multiplier.size):
        largest = max(largest, programme.multiplier[r])
    for j in range(case.chain.friction.size):
        for corner in range(2):
            r = 4 * j + 2 * corner
            pressed = programme.multiplier[r] > NEGLIGIBLE * largest
            if np.isinf(case.chain.friction[j]) and pressed and not programme.sticks[r + 1]:
                programme.sticks[r + 1] = 1
                again = True
    return again


@kernel
def take_solution(case):
    """Velocities, impulses and what each contact does, from a solved programme."""
    chain, corners, programme = case.chain, case.corners, case.programme
    unit = chain.gravity * case.options.time_step
    velocity = corners.work.velocity
    for i in range(velocity.shape[0]):
        for k in range(3):
            velocity[i, k] = unit * programme.solution[i, k] / programme.root[i, k]
    # In flight no multiplier means anything: what the lightest body weighs in a step counts.
    largest = unit * np.min(chain.mass)
    for r in range(programme.low.size):
        programme.multiplier[r] *= unit / programme.norm[r]
        largest = max(largest, programme.multiplier[r])
    least = NEGLIGIBLE * largest
    for j in range(chain.friction.size):
        mu = chain.friction[j]
        for corner in range(2):
            r = 4 * j + 2 * corner
            first, second = programme.multiplier[r], programme.multiplier[r + 1]
            _, u_t = corner_velocity(j, corner, corners, velocity)
            slides = abs(u_t) > NEGLIGIBLE * unit
            state = STICKING
            if np.isinf(mu):
                normal, tangential = first, second
            else:
                normal, tangential = first + second, mu * (first - second)
                if slides and second <= least:
                    state = FORWARD
                elif slides and first <= least:
                    state = BACKWARD
            if normal <= least:
                normal, tangential, state = 0.0, 0.0, FREE
            corners.impulse[j, corner, 0], corners.impulse[j, corner, 1] = normal, tangential
            corners.state[j, corner] = state
    gather_joints(corners)


@allocating
def accept_programme(case, position, velocity, kick, converged):
    """Make the step of a solved programme; returns as `corner_contacts.accept_step`."""
    count = case.ledger.count
    count[Count.STEPS] += 1
    count[Count.UNCONVERGED] += not converged
    take_solution(case)
    return accept_step(
        case.chain, case.corners, case.joints, case.ledger, case.frames, case.log, case.options,
        position, velocity, kick, case.options.time_step, THETA, converged,
    )  # fmt: skip


class Solver:
    """The interior-point solver, set up anew only where other corners stick.

    Parameters
    ----------
    programme : Programme
    tolerance : float
    """

    def __init__(self, programme: Programme, tolerance: float) -> None:
        # The only use of either package here; whoever calls has seen that they are there.
        import piqp
        from scipy.sparse import csc_matrix

        self._new: Callable[[], Any] = piqp.SparseSolver
        self._solved = piqp.PIQP_SOLVED
        self._unfinished = piqp.PIQP_MAX_ITER_REACHED
        self._matrix = csc_matrix
        self._programme = programme
        self._tolerance = tolerance
        self._sticks: np.ndarray | None = None
        n_row, n_body = programme.low.size, programme.root.shape[0]
        joint = np.arange(n_row) // 4
        column = 3 * (joint[:, None] - 1) + np.arange(6)
        self._inside = (column >= 0) & (column < 3 * n_body)
        self._column = column
        self._shape = 3 * n_body

    def _rows(self, chosen: np.ndarray) -> tuple[Any, np.ndarray]:
        """Compressed columns of some rows, and where their values come from."""
        inside = self._inside[chosen]
        row = np.repeat(np.arange(chosen.size), inside.sum(axis=1))
        column = self._column[chosen][inside]
        source = (6 * chosen[:, None] + np.arange(6))[inside]
        order = np.lexsort((row, column))
        start = np.searchsorted(column[order], np.arange(self._shape + 1))
        matrix = self._matrix(
            (np.zeros(order.size), row[order], start), shape=(chosen.size, self._shape)
        )
        return matrix, source[order]

    def _set_up(self) -> None:
        programme = self._programme
        self._sticks = programme.sticks.copy()
        self._equal = np.flatnonzero(programme.sticks)
        self._above = np.flatnonzero(np.isfinite(programme.low))
        self._above_matrix, self._above_source = self._rows(self._above)
        self._equal_matrix, self._equal_source = self._rows(self._equal)
        self._nought = np.zeros(self._equal.size)
        self._solver = self._new()
        settings = self._solver.settings
        settings.eps_abs = settings.eps_rel = self._tolerance
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = self._tolerance
        self._metric = self._matrix(
            (np.ones(self._shape), np.arange(self._shape), np.arange(self._shape + 1)),
            shape=(self._shape, self._shape),
        )

    def solve(self) -> tuple[int, bool, bool]:
        """Solve the programme as it stands.

        Returns
        -------
        iterations : int
        solved : bool
        usable : bool
            Whether what there is may at least be used as an unconverged step.
        """
        programme = self._programme
        fresh = self._sticks is None or not np.array_equal(self._sticks, programme.sticks)
        if fresh:
            self._set_up()
        values = programme.row.ravel()
        self._above_matrix.data = values[self._above_source]
        self._equal_matrix.data = values[self._equal_source]
        linear, low = programme.linear.ravel(), programme.low[self._above]
        if fresh:
            equal = (self._equal_matrix, self._nought) if self._equal.size else (None, None)
            self._solver.setup(self._metric, linear, *equal, self._above_matrix, low)
        else:
            equal = (self._equal_matrix, self._nought) if self._equal.size else (None, None)
            self._solver.update(c=linear, A=equal[0], b=equal[1], G=self._above_matrix, h_l=low)
        status = self._solver.solve()
        result = self._solver.result
        programme.solution[:] = result.x.reshape(-1, 3)
        programme.multiplier[:] = 0.0
        programme.multiplier[self._above] = result.z_l
        programme.multiplier[self._equal] = -result.y
        solved = status == self._solved
        return int(result.info.iter), solved, solved or status == self._unfinished


def run(
    chain: Chain,
    ground: GroundMotion,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
    solver_tolerance: float,
) -> Outcome:
    """Integrate one chain; arguments and result as `archfrag.methods.former_stepping.run`.

    Parameters
    ----------
    solver_tolerance : float
        Residuals and duality gap at which a programme counts as solved, where one is what
        gravity gives in a step.
    """
    corners = new_corners(chain, ground, position)
    joints = new_joint_state(chain.friction.size)
    ledger = new_ledger()
    case = Case(chain, ground, options, corners, joints, ledger, frames, log, new_programme(chain))
    begin(
        chain, ground, corners, joints, ledger, frames, log, options, position, velocity, from_rest
    )
    solver = Solver(case.programme, solver_tolerance)
    clock, count = corners.clock, ledger.count
    rough = bool(np.isinf(chain.friction).any())
    stop = clock[Clock.RECORD_END] + options.follow - 1e-9 * options.time_step
    code = GO
    while code == GO:
        if clock[Clock.TIME] >= stop:
            code = UNFINISHED
        elif count[Count.STEPS] >= options.max_steps:
            code = WORK_BOUND
        else:
            code = _step(case, solver, position, velocity, rough)
    return finish(chain, corners, joints, ledger, options, position, velocity, code)


def _step(
    case: Case, solver: Solver, position: np.ndarray, velocity: np.ndarray, rough: bool
) -> int:
    kick = Kick(*pose_programme(case, position, velocity))
    iterations, solved, usable = solver.solve()
    case.ledger.count[Count.ITERATIONS] += iterations
    while rough and usable and close_rough(case):
        iterations, solved, usable = solver.solve()
        case.ledger.count[Count.ITERATIONS] += iterations
    if not usable or not np.isfinite(case.programme.solution).all():
        return NO_SOLUTION
    return int(accept_programme(case, position, velocity, kick, solved))
