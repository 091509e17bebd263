"""Motion of a mechanism in few bodies: equations, one step, dense output, projection."""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.acceleration import uniform_force
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.delassus import (
    Contacts,
    ContactWork,
    apply_reactions,
    assemble,
    constrained_rest,
    factorise,
    set_rows,
    substitute,
)
from archfrag.mechanics.kinematics import corner_offset
from archfrag.mechanics.laws import OPEN, STICK, is_closed, slip_of, touches
from archfrag.mechanics.mechanism import accelerate, few_bodies, pose
from archfrag.mechanics.reactions import four_hinges, is_four_hinges
from archfrag.mechanics.types import Chain

# Dormand and Prince 1980, J. Comput. Appl. Math. 6(1); dense output: Hairer, Norsett and Wanner,
# Solving Ordinary Differential Equations I, section II.6.
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
N_POWER = 2
BY_GROUND = 0
BY_FRICTION = 1


class Few(NamedTuple):
    """A mechanism in motion: its chain, its state and room for a step; views, no copies."""

    chain: Chain
    joint: np.ndarray  # (m,) joints of the whole chain
    slip: np.ndarray  # (m,) [m]
    length: np.ndarray  # (m,) [m]
    before: np.ndarray  # (m, 2, 2)
    after: np.ndarray  # (m, 2, 2)
    free: np.ndarray  # (n, 3)
    contacts: Contacts
    work: ContactWork
    position: np.ndarray  # (n, 3) at the beginning of a step
    velocity: np.ndarray  # (n, 3)
    new_position: np.ndarray  # (n, 3) at its end, or wherever it was evaluated last
    new_velocity: np.ndarray  # (n, 3)
    stage_velocity: np.ndarray  # (n, 7, 3)
    stage_acceleration: np.ndarray  # (n, 7, 3)
    stage_power: np.ndarray  # (7, 2) of the ground and of friction [W]
    dense_position: np.ndarray  # (n, 3, 5) coefficients over the step
    dense_velocity: np.ndarray  # (n, 3, 5)
    dense_work: np.ndarray  # (2, 5) [J]
    smooth: np.ndarray  # (m,) no friction [1]


class FewRoom(NamedTuple):
    """What `Few` needs besides a mechanism and `FewBodies`, for the largest number of bodies."""

    before: np.ndarray
    after: np.ndarray
    new_position: np.ndarray
    new_velocity: np.ndarray
    stage_velocity: np.ndarray
    stage_acceleration: np.ndarray
    stage_power: np.ndarray
    dense_position: np.ndarray
    dense_velocity: np.ndarray
    dense_work: np.ndarray
    smooth: np.ndarray


@allocating
def new_few_room(n_body, n_joint):
    """Room for the motion of any mechanism of a chain."""
    return FewRoom(
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, N_STAGE, 3)),
        np.zeros((n_body, N_STAGE, 3)),
        np.zeros((N_STAGE, N_POWER)),
        np.zeros((n_body, 3, 5)),
        np.zeros((n_body, 3, 5)),
        np.zeros((N_POWER, 5)),
        np.zeros(n_joint),
    )


@allocating
def view_motion(mechanism, gravity, bodies, room):
    """The motion of an assembled mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    gravity : float [m/s2]
    bodies : FewBodies
        Cut to the mechanism's size (`archfrag.mechanics.levels.view_few`).
    room : FewRoom

    Returns
    -------
    Few
    """
    n, m = mechanism.count[0], mechanism.count[1]
    bodies.work.mode[:] = mechanism.mode[:m]
    bodies.contacts.candidate[:] = 1
    return Few(
        few_bodies(mechanism, gravity),
        mechanism.joint[:m],
        mechanism.slip[:m],
        mechanism.length[:m],
        room.before[:m],
        room.after[:m],
        bodies.free,
        bodies.contacts,
        bodies.work,
        bodies.position,
        bodies.velocity,
        room.new_position[:n],
        room.new_velocity[:n],
        room.stage_velocity[:n],
        room.stage_acceleration[:n],
        room.stage_power,
        room.dense_position[:n],
        room.dense_velocity[:n],
        room.dense_work,
        room.smooth[:m],
    )


@kernel
def evaluate(few, position, velocity, ground_x, ground_y):
    """Accelerations and reactions of the few bodies, into ``few.work``.

    Parameters
    ----------
    few : Few
    position, velocity : ndarray, (n, 3)
    ground_x, ground_y : float
        Ground acceleration [m/s2].

    Returns
    -------
    bool
        False where the reactions are not unique.
    """
    mode = few.work.mode
    pose(few.chain, position, mode, few.slip, few.length, few.before, few.after, few.contacts)
    uniform_force(position.shape[0], ground_x, ground_y, few.chain.gravity, few.free)
    if is_four_hinges(mode, position.shape[0]) and four_hinges(
        few.chain.mass, few.chain.inertia, velocity, few.free, few.contacts, few.work
    ):
        return True
    return accelerate(few.chain, velocity, few.slip, few.free, few.contacts, few.work)


@kernel
def sliding_rate(few, k, velocity):
    """Tangential velocity of the later body at a sliding joint [m/s]."""
    mode = few.work.mode[k]
    c = 0 if touches(mode, 0) else 1
    sense = slip_of(mode)
    px, py = few.contacts.point[k, c, 0], few.contacts.point[k, c, 1]
    ux = uy = 0.0
    if k < velocity.shape[0]:
        ux = velocity[k, 0] - velocity[k, 2] * (py - few.contacts.centroid[k, 1])
        uy = velocity[k, 1] + velocity[k, 2] * (px - few.contacts.centroid[k, 0])
    if k > 0:
        ux -= velocity[k - 1, 0] - velocity[k - 1, 2] * (py - few.contacts.centroid[k - 1, 1])
        uy -= velocity[k - 1, 1] + velocity[k - 1, 2] * (px - few.contacts.centroid[k - 1, 0])
    nx, ny = few.contacts.normal[k, 0], few.contacts.normal[k, 1]
    if not is_closed(mode):
        if sense >= STICK:
            nx, ny = few.contacts.normal_plus[k, c, 0], few.contacts.normal_plus[k, c, 1]
        else:
            nx, ny = few.contacts.normal_minus[k, c, 0], few.contacts.normal_minus[k, c, 1]
    return nx * uy - ny * ux


@kernel
def keep_stage(few, stage, velocity, ground_x, ground_y):
    """Take the last evaluation over as a stage of the step."""
    by_ground = by_friction = 0.0
    for i in range(velocity.shape[0]):
        for c in range(3):
            few.stage_velocity[i, stage, c] = velocity[i, c]
            few.stage_acceleration[i, stage, c] = few.work.velocity[i, c]
        push = ground_x * velocity[i, 0] + ground_y * velocity[i, 1]
        by_ground -= few.chain.mass[i] * push
    for k in range(few.work.mode.size):
        mode = few.work.mode[k]
        if mode == OPEN or slip_of(mode) == STICK:
            continue
        rate = sliding_rate(few, k, velocity)
        c = 0 if touches(mode, 0) else 1
        nx, ny = few.contacts.normal[k, 0], few.contacts.normal[k, 1]
        if not is_closed(mode):
            if slip_of(mode) > STICK:
                nx, ny = few.contacts.normal_plus[k, c, 0], few.contacts.normal_plus[k, c, 1]
            else:
                nx, ny = few.contacts.normal_minus[k, c, 0], few.contacts.normal_minus[k, c, 1]
        shear = few.work.reaction[k, 1] * nx - few.work.reaction[k, 0] * ny
        by_friction += shear * rate
    few.stage_power[stage, BY_GROUND] = by_ground
    few.stage_power[stage, BY_FRICTION] = by_friction


@inlined
def _at(few, stage, step, i, c):
    q = few.position[i, c]
    v = few.velocity[i, c]
    for s in range(stage):
        q += step * A[stage, s] * few.stage_velocity[i, s, c]
        v += step * A[stage, s] * few.stage_acceleration[i, s, c]
    return q, v


@kernel
def take_step(few, step, ground_x, slope_x, ground_y, slope_y, size, speed):
    """One Runge-Kutta step of order 5 from stage 0, which is known.

    Parameters
    ----------
    few : Few
        `new_position` and `new_velocity` are overwritten, and the stages from 1 on; the last
        evaluation is that at the end of the step.
    step : float [s]
    ground_x, slope_x, ground_y, slope_y : float
        Ground acceleration at the beginning and its rate [m/s2], [m/s3].
    size, speed : float
        Error in position [m] and in velocity [m/s] that counts as one; rotations by the
        length of the first joint.

    Returns
    -------
    possible : bool
    error : float
    """
    n = few.position.shape[0]
    for stage in range(1, N_STAGE):
        for i in range(n):
            for c in range(3):
                q, v = _at(few, stage, step, i, c)
                few.new_position[i, c] = q
                few.new_velocity[i, c] = v
        later = C[stage] * step
        gx, gy = ground_x + slope_x * later, ground_y + slope_y * later
        if not evaluate(few, few.new_position, few.new_velocity, gx, gy):
            return False, np.inf
        keep_stage(few, stage, few.new_velocity, gx, gy)
    worst = total = 0.0
    for i in range(n):
        for c in range(3):
            eq = ev = 0.0
            for stage in range(N_STAGE):
                eq += E[stage] * few.stage_velocity[i, stage, c]
                ev += E[stage] * few.stage_acceleration[i, stage, c]
            arm = few.length[0] if c == 2 else 1.0
            worst = max(worst, abs(eq) * step * arm / size, abs(ev) * step * arm / speed)
            total += abs(eq) + abs(ev)
    # The maximum of a number and of none is the number.
    return True, worst if np.isfinite(total) else np.inf


@inlined
def _coefficients(out, start, end, step, first, last, extra):
    out[0] = start
    out[1] = end - start
    out[2] = step * first - out[1]
    out[3] = out[1] - step * last - out[2]
    out[4] = step * extra


@kernel
def make_dense(few, step):
    """Coefficients of the continuous extension of order 4 over the step."""
    last = N_STAGE - 1
    for i in range(few.position.shape[0]):
        for c in range(3):
            dv = da = 0.0
            for stage in range(N_STAGE):
                dv += D[stage] * few.stage_velocity[i, stage, c]
                da += D[stage] * few.stage_acceleration[i, stage, c]
            q, v = few.stage_velocity[i], few.stage_acceleration[i]
            _coefficients(
                few.dense_position[i, c],
                few.position[i, c],
                few.new_position[i, c],
                step,
                q[0, c],
                q[last, c],
                dv,
            )
            _coefficients(
                few.dense_velocity[i, c],
                few.velocity[i, c],
                few.new_velocity[i, c],
                step,
                v[0, c],
                v[last, c],
                da,
            )
    for p in range(N_POWER):
        extra = end = 0.0
        for stage in range(N_STAGE):
            extra += D[stage] * few.stage_power[stage, p]
            if stage < last:
                end += A[last, stage] * few.stage_power[stage, p]
        first, final = few.stage_power[0, p], few.stage_power[last, p]
        _coefficients(few.dense_work[p], 0.0, step * end, step, first, final, extra)


@inlined
def _blend(r, theta):
    rest = 1.0 - theta
    return r[0] + theta * (r[1] + rest * (r[2] + theta * (r[3] + rest * r[4])))


@kernel
def dense_state(few, theta, position, velocity):
    """State at the part `theta` of the step, into `position` and `velocity`."""
    for i in range(position.shape[0]):
        for c in range(3):
            position[i, c] = _blend(few.dense_position[i, c], theta)
            velocity[i, c] = _blend(few.dense_velocity[i, c], theta)


@kernel
def dense_work(few, kind, theta):
    """Work of the ground or of friction up to the part `theta` of the step [J]."""
    return _blend(few.dense_work[kind], theta)


@kernel
def project(few, position, velocity, limit):
    """Move a state back onto its contacts, after `evaluate` there.

    Joint gaps are closed first, then their rates; both in the metric of kinetic energy, with
    the factors of the last evaluation; after `four_hinges`, and with slips, they are made here.

    Parameters
    ----------
    few : Few
    position, velocity : ndarray, (n, 3)
        Overwritten.
    limit : float
        How far any body may be moved [m], rotations by the length of the first joint.

    Returns
    -------
    bool
        False where a body would have to move farther: nothing was done.
    """
    work, contacts = few.work, few.contacts
    for j in range(work.mode.size):
        for c in range(2):
            ex, ey = corner_offset(j, c, few.before, few.after, few.slip)
            contacts.bias[j, c, 0] = ex
            contacts.bias[j, c, 1] = ey
    anew = is_four_hinges(work.mode, position.shape[0])
    for j in range(work.mode.size):
        anew = anew or slip_of(work.mode[j]) != STICK
    if anew:
        # Across the joints, without friction: along its cone a projection could gain energy.
        assemble(few.chain.mass, few.chain.inertia, contacts, work)
        set_rows(contacts, few.smooth, work)
        factorise(work, 0.0)
    few.free[:] = 0.0
    work.relative[:] = 0.0
    constrained_rest(contacts, work)
    _apply(few)
    farthest = 0.0
    for i in range(position.shape[0]):
        shift = abs(work.velocity[i, 0]) + abs(work.velocity[i, 1])
        farthest = max(farthest, shift, few.length[0] * abs(work.velocity[i, 2]))
    if not farthest <= limit:
        return False
    for i in range(position.shape[0]):
        for c in range(3):
            position[i, c] += work.velocity[i, c]
    contacts.bias[:] = 0.0
    for i in range(position.shape[0]):
        for c in range(3):
            few.free[i, c] = velocity[i, c]
    work.reaction[:] = 0.0
    apply_reactions(few.chain.mass, few.chain.inertia, contacts, few.free, work)
    constrained_rest(contacts, work)
    _apply(few)
    for i in range(position.shape[0]):
        for c in range(3):
            velocity[i, c] = work.velocity[i, c]
    return True


@kernel
def _apply(few):
    work = few.work
    substitute(work, work.unknown)
    for j in range(work.mode.size):
        for c in range(3):
            work.reaction[j, c] = 0.0
        for a in range(work.size[j]):
            x = work.unknown[j, a]
            for c in range(3):
                work.reaction[j, c] += x * work.column[j, a, c]
    apply_reactions(few.chain.mass, few.chain.inertia, few.contacts, few.free, work)
