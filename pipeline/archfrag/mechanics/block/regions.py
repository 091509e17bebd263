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
def slender_rocking_acceleration(block, side, rotation, ground_x, gravity):
    """`rocking_acceleration` for small rotations of a slender block (Housner 1963) [rad/s2].

    p^2 (theta - alpha sgn theta - k_s), with the exact p and alpha.
    """
    alpha = math.atan2(reach(block, side), block.rise)
    rotating = rocking_mechanism(block, corner_arm(block, side, 0.0), 1.0)
    radius = math.hypot(reach(block, side), block.rise)
    p_square = block.mass * gravity * radius / dot(rotating, rotating)
    return p_square * (rotation + side * alpha + ground_x)


@kernel
def impact_ratio(block, side):
    """Angular velocity after over before an impact that does not slide, from one corner.

    1 - 1.5 sin^2 alpha for a uniform rectangle (Housner 1963). Where it is negative the block
    would have to sink into the ground: it stays flat.

    Parameters
    ----------
    block : RigidBlock
    side : int
        Corner about which the block has rotated.
    """
    other = reach(block, -side)
    gyration = block.inertia / block.mass + block.rise * block.rise
    return (gyration - reach(block, side) * other) / (gyration + other * other)


@kernel
def impact_sticking_friction(block, side):
    """Least friction coefficient at which an impact from rocking about a corner does not slide.

    3 gamma / (1 + 4 gamma^2) for a uniform rectangle of gamma = h/b.
    """
    ratio = impact_ratio(block, side)
    if ratio < 0.0:
        # Both corners stop: the impulse takes all the momentum about the first corner.
        return block.rise / reach(block, side)
    return block.rise * (1.0 - ratio) / (reach(block, side) + reach(block, -side) * ratio)


@kernel
def rocking_friction(block, side, load):
    """Least friction coefficient at which a block that tips from rest does not slide.

    Shenton's condition (1996, *J. Eng. Mech.* 122(7)), here for any distribution of mass. From
    reach/rise at the load where tipping begins it grows towards `painleve_friction`.

    Parameters
    ----------
    block : RigidBlock
    side : int
        Corner over which it tips.
    load : float
        abs(k_s) / (1 + k_v) [1].

    Examples
    --------
    >>> from archfrag.mechanics.block.formulas import CORNER_A, uniform_block
    >>> from archfrag.mechanics.block.regions import rocking_friction
    >>> block = uniform_block(0.2, 1.0, 400.0)
    >>> [round(rocking_friction(block, CORNER_A, load), 4) for load in (0.2, 0.4, 1.0)]
    [0.2, 0.2486, 0.3793]
    """
    along, up = reach(block, side), block.rise
    gyration = block.inertia / block.mass
    return (load * (gyration + along * along) + along * up) / (
        gyration + up * up + load * along * up
    )


@kernel
def sliding_load(block, side, friction):
    """Load beyond which a block that tips from rest slides too: `rocking_friction` inverted.

    Parameters
    ----------
    block : RigidBlock
    side : int
        Corner over which it tips.
    friction : float
        At least reach/rise, where tipping begins; below, the full base slides.

    Returns
    -------
    float
        abs(k_s) / (1 + k_v) [1]; inf where no load makes it slide.
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
    """Motion that starts from rest, by the borders of its regions in closed form.

    Parameters
    ----------
    block : RigidBlock
    ground_x, ground_y : float
        k_s and k_v [1].
    friction : float

    Returns
    -------
    mechanism : int
        Mechanism.
    side : int
        Corner over which the block tips; 0 where it does not.
    """
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
