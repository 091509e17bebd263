"""Non-smooth contact dynamics: contacts relaxed one by one by block Gauss-Seidel sweeps.

What LMGC90 does (Moreau 1988; Jean 1999; Dubois, Acary and Jean 2018; Acary and Brogliato 2008,
*Numerical Methods for Nonsmooth Dynamical Systems*, chapter 13): two contacts at each joint
(`corners`), each solved exactly for given impulses at all others, in sweeps to and fro over the
chain. A step ends when a sweep changes the impulses by less than `sweep_tolerance`, in the norm
that the Delassus operator of each contact gives, or at `sweeps` sweeps: then it counts as
unconverged, and the run goes on, as those codes do.
"""

import math

import numpy as np

from archbench.baselines.common import integrate
from archbench.baselines.corners import (
    accept_corners,
    corner_case,
    new_corners,
    pose_corners,
)
from archfrag.physics.ground import Grounds
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.state import Clock
from archfrag.physics.status import Count, Wait


@kernel
def solve_corner(w_nn, w_nt, w_tt, free_n, free_t, friction):
    """Signorini's and Coulomb's laws at one contact (Eqs 5, 6), solved exactly.

    Returns normal, tangential, touches, slide.

    Find r with u = free + W r, 0 <= u_n _|_ r_n >= 0 and abs(r_t) <= friction r_n opposing u_t.
    """
    if free_n >= 0.0:
        return 0.0, 0.0, False, 0.0
    determinant = w_nn * w_tt - w_nt * w_nt
    normal = (w_nt * free_t - w_tt * free_n) / determinant
    tangential = (w_nt * free_n - w_nn * free_t) / determinant
    if normal > 0.0 and (math.isinf(friction) or abs(tangential) <= friction * normal):
        return normal, tangential, True, 0.0
    if math.isinf(friction):  # sliding on the limit of a steep cone
        if w_nt == 0.0:
            return -free_n / w_nn, 0.0, True, 0.0
        tangential = -free_n / w_nt
        return 0.0, tangential, True, math.copysign(1.0, tangential)
    first = 1.0 if tangential > 0.0 else -1.0
    for sense in (first, -first):
        stiffness = w_nn + sense * friction * w_nt
        if stiffness <= 0.0:
            continue
        normal = -free_n / stiffness
        tangential = sense * friction * normal
        if sense * (free_t + w_nt * normal + w_tt * tangential) <= 0.0:
            return normal, tangential, True, sense
    # No sliding is admissible here for the present impulses elsewhere (Painleve): another sweep
    # may find one, else the step stays unconverged.
    normal = -free_n / w_nn
    return normal, first * friction * normal, True, first


@inlined
def _velocity(j, row, solved):
    """Relative velocity along a row of joint j."""
    before = row[0] * solved[j, 0] + row[1] * solved[j, 1] + row[2] * solved[j, 2]
    after = (
        row[3] * solved[j + 1, 0]
        + row[4] * solved[j + 1, 1]
        + row[5] * solved[j + 1, 2]
    )
    return before + after


@inlined
def _push(j, row, inverse, impulse, solved):
    """Change the velocities of the bodies at joint j by an impulse along a row [N s]."""
    for c in range(3):
        solved[j, c] += inverse[c] * row[c] * impulse
        solved[j + 1, c] += inverse[c + 3] * row[c + 3] * impulse


@kernel
def prepare_sweeps(case, corners, delassus):
    """Operators of the single contacts, and the velocities that the last impulses give."""
    solved = case.work.solved
    for i in range(solved.shape[0]):
        for c in range(3):
            solved[i, c] = case.work.free[i, c]
    for j in range(delassus.shape[0]):
        inverse = corners.inverse[j]
        for k in range(2):
            normal = corners.row[j, k, 0]
            tangential = corners.row[j, k, 1]
            w = delassus[j, k]
            w[0] = w[1] = w[2] = 0.0
            for c in range(6):
                w[0] += inverse[c] * normal[c] * normal[c]
                w[1] += inverse[c] * normal[c] * tangential[c]
                w[2] += inverse[c] * tangential[c] * tangential[c]
            _push(j, normal, inverse, corners.impulse[j, k, 0], solved)
            _push(j, tangential, inverse, corners.impulse[j, k, 1], solved)


@kernel
def sweep(case, corners, delassus, backward):
    """Solve every contact once, in the order of the joints or against it; change, total."""
    work = case.work
    solved = case.work.solved
    n_contact = 2 * delassus.shape[0]
    change = total = 0.0
    for place in range(n_contact):
        contact = n_contact - 1 - place if backward else place
        j = contact // 2
        k = contact % 2
        w_nn = delassus[j, k, 0]
        w_nt = delassus[j, k, 1]
        w_tt = delassus[j, k, 2]
        normal = corners.row[j, k, 0]
        tangential = corners.row[j, k, 1]
        impulse = corners.impulse
        old_n = impulse[j, k, 0]
        old_t = impulse[j, k, 1]
        u_n = _velocity(j, normal, solved)
        u_t = _velocity(j, tangential, solved)
        free_n = u_n + corners.bias[j, k] - w_nn * old_n - w_nt * old_t
        free_t = u_t - w_nt * old_n - w_tt * old_t
        r_n, r_t, touches, slide = solve_corner(
            w_nn, w_nt, w_tt, free_n, free_t, case.model.friction[j]
        )
        more_n = r_n - old_n
        more_t = r_t - old_t
        work.contact[j, k] = 1.0 if touches else 0.0
        corners.slide[j, k] = slide
        if more_n != 0.0 or more_t != 0.0:
            impulse[j, k, 0] = r_n
            impulse[j, k, 1] = r_t
            _push(j, normal, corners.inverse[j], more_n, solved)
            _push(j, tangential, corners.inverse[j], more_t, solved)
        change += w_nn * more_n**2 + 2.0 * w_nt * more_n * more_t + w_tt * more_t**2
        total += w_nn * r_n**2 + 2.0 * w_nt * r_n * r_t + w_tt * r_t**2
    return change, total


@kernel
def make_steps(case, corners, delassus, sweep_tolerance, sweeps):
    """Step until something is due, or the run is over; see `run` and `prepare_sweeps`."""
    clock = case.state.clock
    while clock[Clock.CODE] == Wait.GO:
        impulse = pose_corners(case, corners)
        prepare_sweeps(case, corners, delassus)
        done = 0
        converged = False
        while done < sweeps and not converged:
            done += 1
            change, total = sweep(case, corners, delassus, done % 2 == 0)
            converged = change <= sweep_tolerance * sweep_tolerance * total
        case.state.count[Count.SWEEPS] += done
        accept_corners(case, corners, impulse, converged)


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
    sweep_tolerance: float,
    sweeps: float,
) -> Outcomes:
    """Integrate one chain; arguments and result as `archfrag.physics.steps.run.run`."""
    case = corner_case(chain, grounds, factor, from_rest, options, frames, log)
    corners = new_corners(case.model)
    delassus = np.zeros((chain.friction.size, 2, 3))

    def advance() -> None:
        make_steps(case, corners, delassus, sweep_tolerance, int(sweeps))

    return integrate(case, advance, position, velocity, from_rest)
