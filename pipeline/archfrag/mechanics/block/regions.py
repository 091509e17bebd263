"""Closed forms of a block: regions of starting motion, rocking equation, impact, Painleve.

They follow from the formulas in `formulas` and `plane` by elimination and hold for any
distribution of mass; the values for a uniform rectangle stand beside them.
"""

import math

from archfrag.mechanics.block.formulas import (
    CORNER_A,
    CORNER_B,
    active_force,
    corner_arm,
    dot,
    normal_gradient,
    reach,
    tangential_gradient,
)
from archfrag.mechanics.block.motion import LIFT_OFF, REST, ROCK, SLIDE, SLIDE_ROCK
from archfrag.mechanics.block.plane import rocking_mechanism
from archfrag.mechanics.compile import kernel


@kernel
def rocking_acceleration(block, side, rotation, ground_x, ground_y, gravity):
    """Angular acceleration about a corner that sticks: Eq 15 along the mechanism [rad/s2].

    Reactions have no power in the mechanism and drop out.
    """
    rotating = rocking_mechanism(block, corner_arm(block, side, rotation), 1.0)
    return dot(active_force(block, ground_x, ground_y, gravity), rotating) / dot(
        rotating, rotating
    )


@kernel
def impact_ratio(block, side):
    """Angular velocity after over before an impact, without sliding, from rocking about a corner.

    1 - 1.5 sin^2 alpha for a uniform rectangle (Housner 1963). Where it is negative the block
    would have to sink into the ground: it stays flat.
    """
    other = reach(block, -side)
    gyration = block.inertia / block.mass + block.rise * block.rise
    return (gyration - reach(block, side) * other) / (gyration + other * other)


@kernel
def rocking_friction(block, side, load):
    """Least friction at which a block that tips from rest over a corner does not slide.

    Shenton's condition (1996, *J. Eng. Mech.* 122(7)), here for any distribution of mass, by the
    load abs(k_s)/(1 + k_v). From reach/rise at the load where tipping begins it grows towards
    `painleve_friction`.
    """
    along, up = reach(block, side), block.rise
    gyration = block.inertia / block.mass
    return (load * (gyration + along * along) + along * up) / (
        gyration + up * up + load * along * up
    )


@kernel
def sliding_load(block, side, friction):
    """Load beyond which a block that tips from rest slides too: `rocking_friction` inverted.

    The friction is at least reach/rise, where tipping begins; inf where no load makes it slide.
    """
    along, up = reach(block, side), block.rise
    gyration = block.inertia / block.mass
    rest = gyration + along * along - friction * along * up
    if not rest > 0.0:
        return math.inf
    return (friction * (gyration + up * up) - along * up) / rest


@kernel
def painleve_friction(block, side, rotation):
    """Least friction coefficient for Painleve's paradox at a corner; inf if there is none.

    Where `archfrag.mechanics.block.plane.sliding_stiffness` vanishes for one sense of slip. At
    least 4/3 for a uniform rectangle, whatever its sides and its rotation.
    """
    arm = corner_arm(block, side, rotation)
    n_t, n_n = tangential_gradient(block, arm), normal_gradient(block, arm)
    coupling = abs(dot(n_t, n_n))
    return dot(n_n, n_n) / coupling if coupling > 0.0 else math.inf


@kernel
def starting_region(block, ground_x, ground_y, friction):
    """Motion that starts from rest, and the corner it tips over or 0, by closed borders."""
    vertical = 1.0 + ground_y
    if vertical <= 0.0:
        return LIFT_OFF, 0
    load = abs(ground_x) / vertical
    side = CORNER_A if ground_x > 0.0 else CORNER_B
    slenderness = reach(block, side) / block.rise
    if load <= min(friction, slenderness):
        return REST, 0
    if friction <= slenderness:
        return SLIDE, 0
    if friction < rocking_friction(block, side, load):
        return SLIDE_ROCK, side
    return ROCK, side
