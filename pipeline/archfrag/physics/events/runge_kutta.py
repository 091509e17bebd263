"""One Runge-Kutta step of mega-voussoirs, with an error estimate and dense output.

Order 3 (Bogacki and Shampine 1989, *Appl. Math. Lett.* 2(4)) for coarse tolerances, where steps
are cut by samples of the ground motion and by events, hardly by their error; order 5 (Dormand and
Prince 1980, *J. Comput. Appl. Math.* 6(1)) for fine ones. Dense output: Hairer, Norsett and
Wanner, *Solving Ordinary Differential Equations I*, section II.6; of order 3 the cubic that meets
values and rates at both ends.
"""

from typing import NamedTuple

import numpy as np

from archfrag.physics.contact.laws import contact_of
from archfrag.physics.contact.placing import corner_rate_at
from archfrag.physics.ground import ground_after
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.mega_voussoirs.first_level import solve_first_level

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
    """Coefficients of a method whose last stage is the first one of the next step."""

    time: np.ndarray  # (n_stage,) of each stage, over the step
    stage: np.ndarray  # (n_stage, n_stage - 1)
    error: np.ndarray  # (n_stage,)
    dense: np.ndarray  # (n_stage,) of the dense output's highest power
    power: float  # of the error, by which steps are chosen


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
    """Stages and dense output of one step."""

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
    return Stages(
        np.zeros(shape),
        np.zeros(shape),
        np.zeros((N_STAGE, 2)),
        np.zeros(dense),
        np.zeros(dense),
        np.zeros((2, 5)),
    )


@inlined
def _travel(far, time):
    """Return the displacement and velocity of the far springing a time after the beginning of a
    segment.

    The displacement is counted from there.
    """
    a = far[0]
    v = far[1]
    jerk = far[3]
    rise = time * (v + time * (0.5 * a + time * jerk / 6.0))
    return rise, v + time * (a + 0.5 * time * jerk)


@kernel
def sliding_rate(j, position, velocity, work):
    """Return the tangential velocity of the later body at a sliding joint [m/s], and the normal
    there.

    Reads: position, velocity, work (contact, normal, point, side_normal, slide).
    """
    nx, ny, px, py = contact_of(j, work)
    ux, uy = corner_rate_at(j, px, py, position, velocity)
    return nx * uy - ny * ux, nx, ny


@kernel
def keep_stage(mega, stages, stage, position, velocity, ground):
    """Store the last solution of the first level as a stage of the step.

    Writes: mega.work.solved, stages (acceleration, power, velocity).
    """
    work = mega.work
    by_ground = 0.0
    by_friction = 0.0
    last = work.slide.shape[0] - 1
    end = position.shape[0] - 1
    if last == end - 1:
        by_ground -= work.reaction[last, 0] * velocity[end, 0]
        by_ground -= work.reaction[last, 1] * velocity[end, 1]
    # Voussoirs that rest on the far springing move with it.
    power = (
        ground[2] * velocity[end, 0]
        + (ground[3] + mega.model.gravity) * velocity[end, 1]
    )
    by_ground += mega.model.mass[end] * power
    work.solved[end, 0] = ground[2]
    work.solved[end, 1] = ground[3]
    work.solved[end, 2] = 0.0
    for c in range(3):
        stages.velocity[end, stage, c] = velocity[end, c]
        stages.acceleration[end, stage, c] = work.solved[end, c]
    for i in range(1, end):
        for c in range(3):
            stages.velocity[i, stage, c] = velocity[i, c]
            stages.acceleration[i, stage, c] = work.solved[i, c]
        power = ground[0] * velocity[i, 0] + ground[1] * velocity[i, 1]
        by_ground -= mega.model.mass[i] * power
    for j in range(work.slide.shape[0]):
        if work.slide[j] != 0.0:
            rate, nx, ny = sliding_rate(j, position, velocity, work)
            by_friction += rate * (work.reaction[j, 1] * nx - work.reaction[j, 0] * ny)
    stages.power[stage, BY_GROUND] = by_ground
    stages.power[stage, BY_FRICTION] = by_friction


@inlined
def take_step(mega, stages, scheme, step, ground, scale, allowed):
    """Make one step from stage 0; return its error, inf if a stage has no solution."""
    position = mega.next_position
    velocity = mega.next_velocity
    n_stage = scheme.time.shape[0]
    end = position.shape[0] - 1
    for stage in range(1, n_stage):
        for i in range(1, end):
            for c in range(3):
                q = v = 0.0
                for s in range(stage):
                    q += scheme.stage[stage, s] * stages.velocity[i, s, c]
                    v += scheme.stage[stage, s] * stages.acceleration[i, s, c]
                position[i, c] = mega.position[i, c] + step * q
                velocity[i, c] = mega.velocity[i, c] + step * v
        time = scheme.time[stage] * step
        for c, far in ((0, ground.far_x), (1, ground.far_y)):
            moved, velocity[end, c] = _travel(far, time)
            position[end, c] = mega.position[end, c] + moved
        now = ground_after(ground, time)
        if not solve_first_level(mega, position, velocity, now, scale):
            return np.inf
        keep_stage(mega, stages, stage, position, velocity, now)
    worst = total = 0.0
    for i in range(1, end):
        for c in range(3):
            q = v = 0.0
            for s in range(n_stage):
                q += scheme.error[s] * stages.velocity[i, s, c]
                v += scheme.error[s] * stages.acceleration[i, s, c]
            arm = step * mega.model.length[0] if c == 2 else step
            worst = max(worst, abs(q) * arm / allowed[0], abs(v) * arm / allowed[1])
            total += abs(q) + abs(v)
    # The maximum of a number and of none is the number.
    return worst if np.isfinite(total) else np.inf


@inlined
def _set_coefficients(out, start, end, first, last, highest):
    out[0] = start
    out[1] = end - start
    out[2] = first - out[1]
    out[3] = out[1] - last - out[2]
    out[4] = highest


@inlined
def make_dense(mega, stages, scheme, step):
    """Set the coefficients of the dense output of a step."""
    last = scheme.time.shape[0] - 1
    for i in range(1, mega.position.shape[0]):
        v = stages.velocity[i]
        a = stages.acceleration[i]
        for c in range(3):
            dv = da = 0.0
            for s in range(last + 1):
                dv += scheme.dense[s] * v[s, c]
                da += scheme.dense[s] * a[s, c]
            start = mega.position[i, c]
            end = mega.next_position[i, c]
            out = stages.dense_position[i, c]
            _set_coefficients(
                out, start, end, step * v[0, c], step * v[last, c], step * dv
            )
            start = mega.velocity[i, c]
            end = mega.next_velocity[i, c]
            out = stages.dense_velocity[i, c]
            _set_coefficients(
                out, start, end, step * a[0, c], step * a[last, c], step * da
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
    """Evaluate a dense output at a part of the step."""
    left = 1.0 - part
    return r[0] + part * (r[1] + left * (r[2] + part * (r[3] + left * r[4])))


@kernel
def dense_state(stages, part, position, velocity):
    """Set `position` and `velocity` at a part of the step.

    Reads: stages (dense_position, dense_velocity).
    Writes: position, velocity.
    """
    for i in range(1, position.shape[0]):
        for c in range(3):
            position[i, c] = blend(stages.dense_position[i, c], part)
            velocity[i, c] = blend(stages.dense_velocity[i, c], part)
