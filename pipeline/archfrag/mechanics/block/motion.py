"""How a single block moves: starting motion, reactions in motion, impact with friction.

All are one problem, as section 2.5 of the paper points out (Eq 21): an active vector S, the force
of smooth dynamics or the velocity before an impact, and the reactions that the contact laws add
to it give the acceleration or the velocity afterwards. `base_problem` solves it for a block that
stands flat, where the contact centre is unknown (Eq 14), `corner_problem` for contact at one
corner (Eqs 15 to 20). Each tries the mechanisms that there are and takes the one that breaks no
law; that two of them obey all laws, or none, happens only in Painleve's paradox and is reported.
"""

import math
from enum import IntEnum
from typing import NamedTuple

from archfrag.mechanics.block.formulas import (
    CORNER_A,
    CORNER_B,
    active_force,
    combine,
    contact_centre,
    corner_arm,
    dot,
    generalised,
    generalised_reaction,
    normal_gradient,
    normal_gradient_rate,
    physical,
    reach,
    tangential_gradient,
    tangential_gradient_rate,
)
from archfrag.mechanics.block.plane import (
    centripetal_projections,
    inside_cone,
    rocking_mechanism,
    sliding_ray,
    sliding_stiffness,
    sticking_reaction,
)
from archfrag.mechanics.compile import kernel

SAME = 1e-9


class Mechanism(IntEnum):
    """How a block moves, or starts to move."""

    REST = 0  # the full base stays
    SLIDE = 1  # the full base slides
    ROCK = 2  # rotates about a corner that does not slide
    SLIDE_ROCK = 3  # rotates about a corner that slides
    LIFT_OFF = 4  # no reaction: the ground does not hold the block


class Solutions(IntEnum):
    """How many motions obey all laws; not one only in Painleve's paradox."""

    NONE = 0  # an impact without a collision would have to follow; given is the free motion
    ONE = 1
    SEVERAL = 2  # the laws do not decide; the first one found is given


REST, SLIDE, ROCK = int(Mechanism.REST), int(Mechanism.SLIDE), int(Mechanism.ROCK)
SLIDE_ROCK, LIFT_OFF = int(Mechanism.SLIDE_ROCK), int(Mechanism.LIFT_OFF)


class BlockMotion(NamedTuple):
    """Answer of a contact problem of the block.

    Forces and accelerations of smooth dynamics; impulses and velocities after an impact.
    """

    mechanism: int  # Mechanism
    solutions: int  # Solutions
    side: int  # CORNER_A or CORNER_B where contact is at a corner, 0 otherwise
    sense: int  # of the slip along t; 0 if the contact sticks
    centre: float  # e of the contact centre (Eq 14) [1]; nan without a reaction
    tangential: float  # R_t [N], or I_t [N s]
    normal: float  # R_n [N], or I_n [N s]
    x: float  # of G along t [m/s2], or [m/s]
    y: float  # of G along n
    rotation: float  # [rad/s2], or [rad/s]
    slip: float  # of the contact along t [m/s2], or [m/s]


@kernel
def _without_reaction(block, active, n_t, solutions):
    x, y, rotation = physical(block, active)
    slip = dot(n_t, active)
    return BlockMotion(LIFT_OFF, solutions, 0, 0, math.nan, 0.0, 0.0, x, y, rotation, slip)


@kernel
def _answer(block, mechanism, side, sense, place, tangential, normal, result, slip):
    x, y, rotation = physical(block, result)
    centre = contact_centre(block, place)
    return BlockMotion(mechanism, 1, side, sense, centre, tangential, normal, x, y, rotation, slip)


@kernel
def _of_several(first, second, speed):
    """The first of two admissible motions, and whether the second is another one."""
    apart = abs(first.x - second.x) + abs(first.y - second.y)
    apart += abs(first.slip - second.slip)
    if apart <= SAME * speed:
        return first
    return BlockMotion(first[0], 2, *first[2:])


@kernel
def _keep(best, found, speed):
    return found if best.solutions == 0 else _of_several(best, found, speed)


@kernel
def _flat(block, active, friction, sense, sliding):
    """Rest (sense 0) or sliding of the full base; and whether that is admissible.

    The normal reaction stands where the block does not rotate (Eqs 13, 14).
    """
    x, y, rotation = physical(block, active)
    normal = -block.mass * y
    tangential = -block.mass * x if sense == 0 else -sense * friction * normal
    slip = x + tangential / block.mass
    moment = block.inertia * rotation + block.rise * tangential
    good = inside_cone(tangential, normal, friction) if sense == 0 else normal > 0.0
    place = -moment / normal if normal > 0.0 else math.nan
    good = good and -block.reach_a <= place <= block.reach_b
    if sense == 0:
        slip = 0.0
    else:
        good = good and (sliding or sense * slip > 0.0) and not math.isinf(friction)
    moved = slip * math.sqrt(block.mass), 0.0, 0.0
    mechanism = REST if sense == 0 else SLIDE
    return good, _answer(block, mechanism, 0, sense, place, tangential, normal, moved, slip)


@kernel
def _corner(block, side, rotation, active, on_t, on_n, friction, sense, sliding):
    """Contact at one corner that sticks (sense 0) or slides; and whether the laws admit it."""
    arm = corner_arm(block, side, rotation)
    n_t, n_n = tangential_gradient(block, arm), normal_gradient(block, arm)
    free = dot(n_n, active) - on_n
    good = True
    if sense == 0:
        tangential, normal = sticking_reaction(n_t, n_n, active, on_t, on_n)
        good = inside_cone(tangential, normal, friction)
    else:
        ray_t, ray_n = sliding_ray(friction, sense)
        stiffness = sliding_stiffness(n_t, n_n, friction, sense)
        size = -free / stiffness if stiffness != 0.0 else -1.0
        tangential, normal = size * ray_t, size * ray_n
        good = size > 0.0
    psi_t, psi_n = generalised_reaction(n_t, n_n, tangential, normal)
    moved = combine(1.0, active, 1.0, combine(1.0, psi_t, 1.0, psi_n))
    slip = 0.0
    mechanism = ROCK
    if sense != 0:
        slip = dot(n_t, moved) - on_t
        good = good and (sliding or sense * slip > 0.0)
        mechanism = SLIDE_ROCK
    place = side * reach(block, side)
    return good, _answer(block, mechanism, side, sense, place, tangential, normal, moved, slip)


@kernel
def base_problem(block, active, friction, slip):
    """Contact problem of a block that stands flat on its base.

    `active` is S, the generalised force or the velocity before an impact (Eq 21); `slip` the one
    in progress along t [m/s], 0 if there is none, and for an impact.
    """
    n_t = tangential_gradient(block, (0.0, -block.rise))
    speed = math.sqrt(dot(active, active) / block.mass)
    best = _without_reaction(block, active, n_t, 0)
    sliding = slip != 0.0
    gap_a = dot(normal_gradient(block, corner_arm(block, CORNER_A, 0.0)), active)
    gap_b = dot(normal_gradient(block, corner_arm(block, CORNER_B, 0.0)), active)
    if gap_a >= 0.0 and gap_b >= 0.0:
        best = _without_reaction(block, active, n_t, 1)
    for sense in (0, 1, -1):
        if sliding and sense * slip <= 0.0:
            continue
        good, found = _flat(block, active, friction, sense, sliding)
        if good:
            best = _keep(best, found, speed)
        for side in (CORNER_A, CORNER_B):
            good, found = _corner(block, side, 0.0, active, 0.0, 0.0, friction, sense, sliding)
            if good and side * found.rotation < 0.0:
                best = _keep(best, found, speed)
    return best


@kernel
def corner_problem(block, side, rotation, active, on_t, on_n, friction, slip):
    """Contact problem of a block that touches the ground at one corner (Eqs 15 to 20).

    `on_t` and `on_n` are those of `plane.centripetal_projections`, zero for an impact; the others
    as in `base_problem`.
    """
    arm = corner_arm(block, side, rotation)
    n_t, n_n = tangential_gradient(block, arm), normal_gradient(block, arm)
    speed = math.sqrt(dot(active, active) / block.mass) + abs(on_t) + abs(on_n)
    best = _without_reaction(block, active, n_t, 0)
    sliding = slip != 0.0
    if dot(n_n, active) - on_n >= 0.0:
        best = _without_reaction(block, active, n_t, 1)
    for sense in (0, 1, -1):
        if sliding and sense * slip <= 0.0:
            continue
        good, found = _corner(block, side, rotation, active, on_t, on_n, friction, sense, sliding)
        if good:
            best = _keep(best, found, speed)
    return best


@kernel
def starting_motion(block, ground_x, ground_y, friction, gravity):
    """Which motion starts from rest, and with what reactions (section 2.4, Eqs 12 to 20).

    Of a ground acceleration k_s towards +t and k_v upwards, over g.

    Examples
    --------
    >>> from archfrag.mechanics.block.formulas import uniform_block
    >>> from archfrag.mechanics.block.motion import Mechanism, starting_motion
    >>> block = uniform_block(0.2, 1.0, 400.0)
    >>> for k_s, mu in ((0.1, 0.5), (0.25, 0.5), (0.25, 0.18), (0.25, 0.201), (-0.25, 0.5)):
    ...     start = starting_motion(block, k_s, 0.0, mu, 9.80665)
    ...     print(Mechanism(start.mechanism).name, round(start.centre, 3))
    REST 0.25
    ROCK 0.0
    SLIDE 0.05
    SLIDE_ROCK 0.0
    ROCK 1.0
    """
    return base_problem(block, active_force(block, ground_x, ground_y, gravity), friction, 0.0)


@kernel
def corner_motion(
    block, side, rotation, angular_velocity, slip, ground_x, ground_y, friction, gravity
):
    """Accelerations and reactions while the block rotates about a corner (section 2.5, Eqs 15-20).

    The rotation is positive about A and negative about B [rad]; `slip` is the corner's
    velocity along t [m/s], 0 where it sticks or starts to slide now.
    """
    arm = corner_arm(block, side, rotation)
    on_t, on_n = centripetal_projections(
        tangential_gradient_rate(block, arm, angular_velocity),
        normal_gradient_rate(block, arm, angular_velocity),
        generalised(block, 0.0, 0.0, angular_velocity),
    )
    active = active_force(block, ground_x, ground_y, gravity)
    return corner_problem(block, side, rotation, active, on_t, on_n, friction, slip)


@kernel
def rocking_impact(block, side, angular_velocity, slip, friction):
    """Impact at the end of a rocking, or slide-rocking, about a corner (Eqs 8, 9, 11, 21).

    Angular velocity (closing: negative for A, positive for B) and slip of the corner are those
    before the impact. ROCK, SLIDE_ROCK: the block goes on about one corner while the other leaves
    the ground. REST, SLIDE: both corners stay.
    """
    before = rocking_mechanism(block, corner_arm(block, side, 0.0), angular_velocity)
    return base_problem(
        block, combine(1.0, before, 1.0, generalised(block, slip, 0.0, 0.0)), friction, 0.0
    )
