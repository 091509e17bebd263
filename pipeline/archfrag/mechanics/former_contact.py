"""The contact problem of a chain of rigid bodies: accelerations, impacts and time steps alike.

Find the velocities (or accelerations) w of the bodies and the reactions r of the joints with

    M (w - w_free) = H r,   0 <= H_n' w + b_n  _|_  r_n >= 0,   |r_t| <= mu r_n opposing slip.

Every joint is in one of ten modes (`laws`). For given modes the problem is linear (`delassus`).
The modes are found by a Newton iteration that starts from those of the last state (`newton`)
and, where that does not settle, by following the solution's path from all joints open
(`homotopy`): direct methods both. No relaxation sweep is used.

A chain with all its joints closed is three times hyperstatic: its reactions are not unique
though its motion is. A relative compliance of `COMPLIANCE` on each contact row picks, of all
admissible reactions, those of joints that are equal springs in the limit of infinite stiffness;
steps of the proximal-point iteration then remove the compliance from the motion.

Coulomb's law is taken whole: slip has no part normal to the joint. Under the associated flow
rule, which limit analysis and quadratic programmes use, a sliding joint would also dilate by mu
times its slip. The two agree wherever nothing slides; a case where they differ is
`tests/physics/test_contact.py::TestCoulomb`.
"""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import (
    TOLERANCE,
    Contacts,
    ContactWork,
    apply_reactions,
    assemble,
    contact_work,
    velocity_scale,
)
from archfrag.mechanics.homotopy import follow_path
from archfrag.mechanics.laws import CLOSED_STICK, OPEN, is_closed
from archfrag.mechanics.newton import active_set
from archfrag.mechanics.status import Status

__all__ = ["COMPLIANCE", "ContactWork", "Contacts", "contact_work", "solve_contact"]

COMPLIANCE = 1e-10
PATH_COMPLIANCE = 1e-6
PATHS = 9
SOFT_PATHS = 3
# Where a corner neither presses nor parts, rounding decides: such a state may break a law by
# this much, relative, and its residual says so.
DEGENERATE = 1e-8
SOLVED = int(Status.STANDING)
UNSOLVED = int(Status.NO_CONTACT_SOLUTION)


@kernel
def newton_contact(mass, inertia, contacts, friction, free_velocity, work):
    """Solve one contact problem by the Newton iteration alone; arguments as `solve_contact`.

    Returns
    -------
    status : int
        As `solve_contact`; unsolved means that the path has to be followed.
    iterations : int
    """
    assemble(mass, inertia, contacts, work)
    scale = velocity_scale(contacts, free_velocity, work)
    if scale == 0.0:
        # Nothing approaches, or nothing can touch: a chain in flight has no contact.
        for j in range(work.mode.size):
            if not (contacts.candidate[j, 0] or contacts.candidate[j, 1]):
                work.mode[j] = OPEN
        work.reaction[:] = 0.0
        apply_reactions(mass, inertia, contacts, free_velocity, work)
        return SOLVED, 0
    if not np.isfinite(scale):
        return UNSOLVED, 0
    solved, iterations = active_set(
        mass,
        inertia,
        contacts,
        friction,
        free_velocity,
        work,
        scale,
        COMPLIANCE,
        TOLERANCE,
        100 + 4 * work.mode.size,
        True,
    )
    return (SOLVED if solved else UNSOLVED), iterations


@kernel
def _stick_rough(friction, mode):
    """Closed joints without friction limit stick again, whatever a path took them through.

    A corner of such a joint may slide, without a normal force; a whole face may not.
    """
    for j in range(mode.size):
        if np.isinf(friction[j]) and is_closed(mode[j]):
            mode[j] = CLOSED_STICK


@allocating
def path_contact(mass, inertia, contacts, friction, free_velocity, work, paths=PATHS):
    """Solve one contact problem that the Newton iteration has not; as `solve_contact`.

    `paths` bounds the attempts, each along another path; with fewer than all of them slightly
    compliant joints are not tried.
    """
    n_joint = work.mode.size
    limit = 100 + 4 * n_joint
    scale = velocity_scale(contacts, free_velocity, work)
    if not np.isfinite(scale):
        return UNSOLVED, 0, 0, False
    iterations = 0
    breaks = 0
    for attempt in range(paths):
        compliance = PATH_COMPLIANCE * 0.01 ** (attempt % 3)
        _, more_breaks = follow_path(
            mass,
            inertia,
            contacts,
            friction,
            free_velocity,
            work,
            scale,
            compliance,
            attempt,
            100 + 20 * n_joint,
        )
        breaks += max(more_breaks, 1)
        _stick_rough(friction, work.mode)
        while compliance > 2.0 * COMPLIANCE:
            _, more = active_set(
                mass,
                inertia,
                contacts,
                friction,
                free_velocity,
                work,
                scale,
                compliance,
                TOLERANCE,
                limit,
                False,
            )
            iterations += more
            compliance *= 0.1
        for tolerance in (TOLERANCE, DEGENERATE):
            solved, more = active_set(
                mass,
                inertia,
                contacts,
                friction,
                free_velocity,
                work,
                scale,
                COMPLIANCE,
                tolerance,
                limit,
                True,
            )
            iterations += more
            if solved:
                return SOLVED, iterations, breaks, False
    for attempt in range(SOFT_PATHS if paths == PATHS else 0):
        compliance = PATH_COMPLIANCE * 10.0**attempt
        _, more_breaks = follow_path(
            mass,
            inertia,
            contacts,
            friction,
            free_velocity,
            work,
            scale,
            compliance,
            attempt,
            100 + 20 * n_joint,
        )
        breaks += max(more_breaks, 1)
        _stick_rough(friction, work.mode)
        solved, more = active_set(
            mass,
            inertia,
            contacts,
            friction,
            free_velocity,
            work,
            scale,
            compliance,
            DEGENERATE,
            limit,
            False,
        )
        iterations += more
        if solved:
            return SOLVED, iterations, breaks, True
    return UNSOLVED, iterations, breaks, False


@allocating
def solve_contact(mass, inertia, contacts, friction, free_velocity, work):
    """Solve one contact problem.

    Parameters
    ----------
    mass, inertia : ndarray, (n_body,) [kg], [kg m2]
    contacts : Contacts
    friction : ndarray, (n_joint,)
    free_velocity : ndarray, (n_body, 3)
        Velocities (or accelerations) that the bodies would have without reactions.
    work : ContactWork
        ``work.mode`` holds the modes to start from; on return `work` holds the solution.

    Returns
    -------
    status : int
        ``Status.STANDING`` if solved, ``Status.NO_CONTACT_SOLUTION`` if not: then what `work`
        holds breaks a law and must not be used as motion.
    iterations : int
        Linear problems solved by the Newton iteration.
    breaks : int
        Pieces of the solution path followed; 0 where the Newton iteration sufficed.
    compliant : bool
        Whether the solution is that of slightly compliant joints (relative compliance 1e-6 to
        1e-4). Where a ring closes, its last gaps contradict each other by the square of their
        size, and of the many ways to leave one of them open by 1e-10 m rounding finds none.
    """
    status, iterations = newton_contact(mass, inertia, contacts, friction, free_velocity, work)
    if status == SOLVED:
        return SOLVED, iterations, 0, False
    status, more, breaks, compliant = path_contact(
        mass, inertia, contacts, friction, free_velocity, work
    )
    return status, iterations + more, breaks, compliant
