"""Non-smooth contact dynamics: contacts relaxed one by one by block Gauss-Seidel sweeps.

What LMGC90 does (Moreau 1988, CISM 302, 1-82; Jean 1999, *Comput. Methods Appl. Mech. Engrg.* 177,
235-257; Dubois, Acary and Jean 2018, *C. R. Mecanique* 346, 247-262; Acary and Brogliato 2008,
*Numerical Methods for Nonsmooth Dynamical Systems*, chapter 13): two contacts at each joint
(`corner_contacts`), each solved exactly for given impulses at all others, in sweeps over the chain
to and fro, from the impulses of the step before. A step ends when a sweep changes the impulses by
less than `sweep_tolerance`, in the norm that the Delassus operator of each contact gives, or at
`sweeps` sweeps: then it counts as unconverged, and the run goes on, as those codes do.
"""

import numpy as np

from archfrag.mechanics.collapse import new_joint_state
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.ledger import new_ledger
from archfrag.mechanics.status import Count, Status
from archfrag.methods.corner_contacts import (
    BACKWARD,
    FORWARD,
    FREE,
    GO,
    STICKING,
    Clock,
    accept_step,
    begin,
    corner_velocity,
    finish,
    gather_joints,
    new_corners,
    pose_step,
    push_corner,
)

UNFINISHED = int(Status.UNFINISHED)
WORK_BOUND = int(Status.WORK_BOUND)


@inlined
def _rough_slip(w_nn, w_nt, w_tt, free_n, free_t):
    """Sliding without a normal impulse: where friction is infinite, the limit of a steep cone."""
    if w_nt == 0.0:
        return -free_n / w_nn, 0.0, STICKING
    tangential = -free_n / w_nt
    return 0.0, tangential, FORWARD if tangential > 0.0 else BACKWARD


@kernel
def solve_corner(w_nn, w_nt, w_tt, free_n, free_t, friction):
    """Signorini's and Coulomb's laws at one contact, solved exactly.

    Find r with u = free + W r, 0 <= u_n _|_ r_n >= 0 and abs(r_t) <= friction r_n opposing u_t.

    Parameters
    ----------
    w_nn, w_nt, w_tt : float
        Delassus operator W of the contact [1/kg].
    free_n, free_t : float
        Velocity, bias included, without the impulse of this contact [m/s].
    friction : float
        inf: the limit of large friction.

    Returns
    -------
    normal, tangential : float
        Impulse r [N s].
    state : int
        FREE, STICKING, FORWARD or BACKWARD.
    """
    if free_n >= 0.0:
        return 0.0, 0.0, FREE
    determinant = w_nn * w_tt - w_nt * w_nt
    normal = (w_nt * free_t - w_tt * free_n) / determinant
    tangential = (w_nt * free_n - w_nn * free_t) / determinant
    if normal > 0.0 and (np.isinf(friction) or abs(tangential) <= friction * normal):
        return normal, tangential, STICKING
    if np.isinf(friction):
        return _rough_slip(w_nn, w_nt, w_tt, free_n, free_t)
    first = 1.0 if tangential > 0.0 else -1.0
    for sense in (first, -first):
        stiffness = w_nn + sense * friction * w_nt
        if stiffness <= 0.0:
            continue
        normal = -free_n / stiffness
        tangential = sense * friction * normal
        if sense * (free_t + w_nt * normal + w_tt * tangential) <= 0.0:
            return normal, tangential, FORWARD if sense > 0.0 else BACKWARD
    # No sliding is admissible here for the present impulses elsewhere (Painleve): another sweep
    # may find one, else the step stays unconverged.
    normal = -free_n / w_nn
    return normal, first * friction * normal, FORWARD if first > 0.0 else BACKWARD


@kernel
def prepare_sweeps(chain, corners, delassus):
    """Operators of the single contacts, and the velocities that the last impulses give.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    corners : archfrag.methods.corner_contacts.Corners
        Posed; ``work.velocity`` is overwritten.
    delassus : ndarray, (n_joint, 2, 3)
        Overwritten: normal, mixed and tangential entry for each corner [1/kg].
    """
    velocity = corners.work.velocity
    for i in range(velocity.shape[0]):
        for k in range(3):
            velocity[i, k] = corners.free[i, k]
    for j in range(delassus.shape[0]):
        for corner in range(2):
            w = delassus[j, corner]
            w[:] = 0.0
            for side in range(2):
                body = j - side
                if 0 <= body < velocity.shape[0]:
                    a = corners.lever[j, corner, 2 * side]
                    b = corners.lever[j, corner, 2 * side + 1]
                    w[0] += 1.0 / chain.mass[body] + a * a / chain.inertia[body]
                    w[1] += a * b / chain.inertia[body]
                    w[2] += 1.0 / chain.mass[body] + b * b / chain.inertia[body]
            normal, tangential = corners.impulse[j, corner, 0], corners.impulse[j, corner, 1]
            if normal != 0.0 or tangential != 0.0:
                push_corner(j, corner, chain, corners, normal, tangential, velocity)


@kernel
def sweep(chain, corners, delassus, backward):
    """Solve every contact once, in the order of the joints or against it.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    corners : archfrag.methods.corner_contacts.Corners
        Impulses, states and ``work.velocity`` are changed.
    delassus : ndarray, (n_joint, 2, 3)
    backward : bool

    Returns
    -------
    change, total : float
        Sum over the contacts of r W r, of the change of their impulses and of themselves [J].
    """
    velocity = corners.work.velocity
    n_contact = 2 * delassus.shape[0]
    change = total = 0.0
    for place in range(n_contact):
        k = n_contact - 1 - place if backward else place
        j, corner = k // 2, k % 2
        w_nn, w_nt, w_tt = delassus[j, corner, 0], delassus[j, corner, 1], delassus[j, corner, 2]
        impulse = corners.impulse[j, corner]
        u_n, u_t = corner_velocity(j, corner, corners, velocity)
        free_n = u_n + corners.bias[j, corner] - w_nn * impulse[0] - w_nt * impulse[1]
        free_t = u_t - w_nt * impulse[0] - w_tt * impulse[1]
        normal, tangential, state = solve_corner(
            w_nn, w_nt, w_tt, free_n, free_t, chain.friction[j]
        )
        more_n, more_t = normal - impulse[0], tangential - impulse[1]
        corners.state[j, corner] = state
        if more_n != 0.0 or more_t != 0.0:
            impulse[0], impulse[1] = normal, tangential
            push_corner(j, corner, chain, corners, more_n, more_t, velocity)
        change += w_nn * more_n**2 + 2.0 * w_nt * more_n * more_t + w_tt * more_t**2
        total += w_nn * normal**2 + 2.0 * w_nt * normal * tangential + w_tt * tangential**2
    return change, total


@kernel
def solve_step(chain, corners, delassus, sweeps, sweep_tolerance):
    """Sweep a posed step until the impulses settle.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    corners : archfrag.methods.corner_contacts.Corners
    delassus : ndarray, (n_joint, 2, 3)
        Room.
    sweeps : int
        Bound on their number.
    sweep_tolerance : float
        Relative change of the impulses in a sweep below which the step is solved.

    Returns
    -------
    done : int
        Sweeps made.
    converged : bool
    """
    prepare_sweeps(chain, corners, delassus)
    for done in range(1, sweeps + 1):
        change, total = sweep(chain, corners, delassus, done % 2 == 0)
        if change <= sweep_tolerance * sweep_tolerance * total:
            return done, True
    return sweeps, False


@allocating
def run(
    chain,
    ground,
    position,
    velocity,
    from_rest,
    options,
    frames,
    log,
    theta,
    sweep_tolerance,
    sweeps,
):
    """Integrate one chain; arguments and result as `archfrag.methods.former_stepping.run`.

    Parameters
    ----------
    theta : float
        Weight of the velocities after a step in the change of position; 1/2: no numerical
        damping.
    sweep_tolerance, sweeps : float
        See `solve_step`.
    """
    corners = new_corners(chain, ground, position)
    joints = new_joint_state(chain.friction.size)
    ledger = new_ledger()
    delassus = np.zeros((chain.friction.size, 2, 3))
    begin(
        chain, ground, corners, joints, ledger, frames, log, options, position, velocity, from_rest
    )
    count, clock, step = ledger.count, corners.clock, options.time_step
    stop = clock[Clock.RECORD_END] + options.follow
    code = GO
    while code == GO:
        if clock[Clock.TIME] >= stop - 1e-9 * step:
            code = UNFINISHED
            break
        if count[Count.STEPS] >= options.max_steps:
            code = WORK_BOUND
            break
        kick = pose_step(chain, ground, corners, joints, position, velocity, step, theta)
        done, converged = solve_step(chain, corners, delassus, int(sweeps), sweep_tolerance)
        count[Count.STEPS] += 1
        count[Count.SWEEPS] += done
        count[Count.UNCONVERGED] += not converged
        gather_joints(corners)
        code = accept_step(
            chain, corners, joints, ledger, frames, log, options, position, velocity, kick, step,
            theta, converged,
        )  # fmt: skip
    return finish(chain, corners, joints, ledger, options, position, velocity, code)
