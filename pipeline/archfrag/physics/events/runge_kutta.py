"""One Runge-Kutta step of mega-voussoirs, with an error estimate and dense output.

Coarse tolerances use order 3 (Bogacki and Shampine 1989, *Appl. Math. Lett.* 2(4)): there steps
are cut by samples of the ground motion and by events, hardly by their error. Fine tolerances use
order 5 (Dormand and Prince 1980, *J. Comput. Appl. Math.* 6(1)). The dense output is that of
Hairer, Norsett and Wanner, *Solving Ordinary Differential Equations I*, section II.6; for order 3
it is the cubic that meets values and rates at both ends.
"""

from typing import NamedTuple

import numpy as np

from archfrag.physics.contact.laws import along, contact_of, cross, force_of
from archfrag.physics.contact.placing import corner_rate_at
from archfrag.physics.ground import ground_after
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.mega_voussoirs.first_level import solve_first_level
from archfrag.physics.numbers import copy_rows

N_STAGE = 7
C = (0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0)
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
E = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
D = (
    -12715105075 / 11282082432,
    0.0,
    87487479700 / 32700410799,
    -10690763975 / 1880347072,
    701980252875 / 199316789632,
    -1453857185 / 822651844,
    69997945 / 29380423,
)
BY_GROUND = 0
BY_FRICTION = 1


@struct()
class Scheme(NamedTuple):
    """Coefficients of a Runge-Kutta method whose last stage is the first of the next step."""

    time: np.ndarray  # (n_stage,) time of each stage, over the step
    stage: np.ndarray  # (n_stage, n_stage - 1)
    error: np.ndarray  # (n_stage,)
    dense: np.ndarray  # (n_stage,) of the dense output's highest power
    power: float  # exponent of the error in the factor to the next step


FIFTH_ORDER = Scheme(np.array(C), A, np.array(E), np.array(D), -0.2)
THIRD_ORDER = Scheme(
    np.array([0.0, 0.5, 0.75, 1.0]),
    np.array(
        [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.75, 0.0], [2 / 9, 1 / 3, 4 / 9]]
    ),
    np.array([-5 / 72, 1 / 12, 1 / 9, -1 / 8]),
    np.zeros(4),
    -1.0 / 3.0,
)


@struct()
class Stages(NamedTuple):
    """Velocities, accelerations and powers in the stages of one step, and its dense output."""

    velocity: np.ndarray  # (n_body + 2, n_stage, 3)
    acceleration: np.ndarray  # (n_body + 2, n_stage, 3)
    power: np.ndarray  # (n_stage, 2) of the ground and of friction [W]
    dense_position: np.ndarray  # (n_body + 2, 3, 5) coefficients over the step
    dense_velocity: np.ndarray  # (n_body + 2, 3, 5)
    dense_work: np.ndarray  # (2, 5) [J]


def new_stages(n_row: int) -> Stages:
    """Allocate stages for a chain with `n_row` rows of bodies."""
    shape = (n_row, N_STAGE, 3)
    dense = (n_row, 3, 5)
    shapes = shape, shape, (N_STAGE, 2), dense, dense, (2, 5)
    return Stages(*map(np.zeros, shapes))


@inlined
def _travel(far, time):
    """Return how far the far springing moves in a `time` [s] from the beginning of a segment.

    `far` is ``Segment.far_x`` or ``Segment.far_y``. The velocity then is returned as well.
    """
    a = far[0]
    v = far[1]
    jerk = far[3]
    rise = time * (v + time * (0.5 * a + time * jerk / 6.0))
    return rise, v + time * (a + 0.5 * time * jerk)


@kernel
def sliding_rate(j, model, position, velocity, work):
    """Return the slip rate of sliding joint `j` [m/s], and its normal (x, y).

    The rate is that of the body after the joint relative to the one before it, along the tangent.

    Reads: model.body, position, velocity, work (contact, normal, point, side_normal, slide).
    """
    nx, ny, px, py = contact_of(j, work)
    rate = cross((nx, ny), corner_rate_at(j, px, py, model, position, velocity))
    return rate, (nx, ny)


@inlined
def far_power(work, velocity):
    """Return the power that the far springing gives, or the work that it gives in an impact.

    It is zero if no joint bears on it.
    """
    last = work.slide.shape[0] - 1
    power = 0.0
    if last == velocity.shape[0] - 2:
        power -= work.reaction[last, 0] * velocity[-1, 0]
        power -= work.reaction[last, 1] * velocity[-1, 1]
    return power


@kernel
def keep_stage(mega, stages, stage, position, velocity, ground):
    """Store the last solution of the first level as stage number `stage` of the step.

    Writes: mega.work.solved, stages (acceleration, power, velocity).
    """
    work = mega.work
    mass = mega.model.mass
    by_friction = 0.0
    end = position.shape[0] - 1
    by_ground = far_power(work, velocity)
    # Voussoirs that rest on the far springing move with it.
    power = ground[2] * velocity[end, 0]
    power += (ground[3] + mega.model.gravity) * velocity[end, 1]
    by_ground += mass[end] * power
    work.solved[end, 0] = ground[2]
    work.solved[end, 1] = ground[3]
    work.solved[end, 2] = 0.0
    copy_rows(velocity, stages.velocity[:, stage], 1, end + 1)
    copy_rows(work.solved, stages.acceleration[:, stage], 1, end + 1)
    for i in range(1, end):
        by_ground -= mass[i] * along(ground, velocity[i])
    for j in range(work.slide.shape[0]):
        if work.slide[j] != 0.0:
            rate, normal = sliding_rate(j, mega.model, position, velocity, work)
            by_friction += rate * cross(normal, force_of(j, work))
    stages.power[stage, BY_GROUND] = by_ground
    stages.power[stage, BY_FRICTION] = by_friction


@inlined
def _weighted(weights, n, rates, i, c):
    """Return the weighted sum of the rates `c` of body `i` in the first `n` stages."""
    total = 0.0
    for s in range(n):
        total += weights[s] * rates[i, s, c]
    return total


@inlined
def take_step(mega, motion, step, ground, allowed):
    """Make one step from stage 0; return its error, inf if a stage has no solution.

    The result is left in ``mega.next_position`` and ``mega.next_velocity``. `allowed` has the
    displacement [m] and the velocity [m/s] that count as an error of one.
    """
    stages = motion.stages
    scheme = motion.scheme
    position = mega.next_position
    velocity = mega.next_velocity
    n_stage = scheme.time.shape[0]
    end = position.shape[0] - 1
    for stage in range(1, n_stage):
        weights = scheme.stage[stage]
        for i in range(1, end):
            for c in range(3):
                q = _weighted(weights, stage, stages.velocity, i, c)
                v = _weighted(weights, stage, stages.acceleration, i, c)
                position[i, c] = mega.position[i, c] + step * q
                velocity[i, c] = mega.velocity[i, c] + step * v
        time = scheme.time[stage] * step
        for c, far in ((0, ground.far_x), (1, ground.far_y)):
            moved, velocity[end, c] = _travel(far, time)
            position[end, c] = mega.position[end, c] + moved
        now = ground_after(ground, time)
        if not solve_first_level(mega, position, velocity, now, motion.acceleration):
            return np.inf
        keep_stage(mega, stages, stage, position, velocity, now)
    worst = total = 0.0
    for i in range(1, end):
        for c in range(3):
            q = abs(_weighted(scheme.error, n_stage, stages.velocity, i, c))
            v = abs(_weighted(scheme.error, n_stage, stages.acceleration, i, c))
            arm = step * mega.model.length[0] if c == 2 else step
            worst = max(worst, q * arm / allowed[0], v * arm / allowed[1])
            total += q + v
    # A maximum may lose nan, a sum does not.
    return worst if np.isfinite(total) else np.inf


@inlined
def _set_coefficients(out, start, end, first, last, highest):
    out[0] = start
    out[1] = end - start
    out[2] = first - out[1]
    out[3] = out[1] - last - out[2]
    out[4] = highest


@inlined
def _set_dense(scheme, step, rates, start, end, out):
    """Set the coefficients of the dense output of positions or velocities, by their rates."""
    last = scheme.time.shape[0] - 1
    for i in range(1, start.shape[0]):
        for c in range(3):
            _set_coefficients(
                out[i, c],
                start[i, c],
                end[i, c],
                step * rates[i, 0, c],
                step * rates[i, last, c],
                step * _weighted(scheme.dense, last + 1, rates, i, c),
            )


@inlined
def make_dense(mega, motion, step):
    """Set the coefficients of the dense output of a step."""
    stages = motion.stages
    scheme = motion.scheme
    last = scheme.time.shape[0] - 1
    out = stages.dense_position
    _set_dense(scheme, step, stages.velocity, mega.position, mega.next_position, out)
    out = stages.dense_velocity
    _set_dense(
        scheme, step, stages.acceleration, mega.velocity, mega.next_velocity, out
    )
    for p in range(2):
        highest = end = 0.0
        for s in range(last + 1):
            highest += step * scheme.dense[s] * stages.power[s, p]
            if s < last:
                end += step * scheme.stage[last, s] * stages.power[s, p]
        first = step * stages.power[0, p]
        final = step * stages.power[last, p]
        _set_coefficients(stages.dense_work[p], 0.0, end, first, final, highest)


@inlined
def blend(r, part):
    """Return the dense output of coefficients `r`, (5,), at `part`, 0 to 1, of the step."""
    left = 1.0 - part
    return r[0] + part * (r[1] + left * (r[2] + part * (r[3] + left * r[4])))


@kernel
def dense_state(stages, part, position, velocity):
    """Set `position` and `velocity` to the dense output at `part`, 0 to 1, of the step.

    Reads: stages (dense_position, dense_velocity).
    Writes: position, velocity.
    """
    for i in range(1, position.shape[0]):
        for c in range(3):
            position[i, c] = blend(stages.dense_position[i, c], part)
            velocity[i, c] = blend(stages.dense_velocity[i, c], part)
