"""Closed forms of a block: impact, Shenton's and Painleve's frictions, regions of first motion.

They follow from the formulas of `archbench.paper.block` by elimination and hold for any
distribution of mass.
"""

import math

from archbench.paper.block import (
    CORNER_A,
    CORNER_B,
    LIFT_OFF,
    REST,
    ROCK,
    SLIDE,
    SLIDE_ROCK,
    Mechanism,
    RigidBlock,
    corner_arm,
    gradient,
    reach,
)


def impact_ratio(block: RigidBlock, side: int) -> float:
    """Angular velocity after over before an impact without sliding (Eq 21).

    1 - 1.5 sin^2 alpha for a uniform rectangle (Housner 1963). Where it is negative the block
    stays flat.
    """
    other = reach(block, -side)
    gyration = block.inertia / block.mass + block.rise * block.rise
    return (gyration - reach(block, side) * other) / (gyration + other * other)


def rocking_friction(block: RigidBlock, side: int, load: float) -> float:
    """Least friction at which a block that tips from rest over a corner does not slide.

    Shenton's condition (1996, *J. Eng. Mech.* 122(7)), here for any distribution of mass, by the
    load abs(k_s)/(1 + k_v).
    """
    along = reach(block, side)
    up = block.rise
    gyration = block.inertia / block.mass
    square = gyration + up * up + load * along * up
    return (load * (gyration + along * along) + along * up) / square


def sliding_load(block: RigidBlock, side: int, friction: float) -> float:
    """Load beyond which a block that tips slides too: `rocking_friction` inverted; inf if none."""
    along = reach(block, side)
    up = block.rise
    gyration = block.inertia / block.mass
    rest = gyration + along * along - friction * along * up
    return (
        (friction * (gyration + up * up) - along * up) / rest
        if rest > 0.0
        else math.inf
    )


def painleve_friction(block: RigidBlock, side: int, rotation: float) -> float:
    """Least friction of Painleve's paradox at a corner; inf if there is none.

    There N_n N- or N_n N+ of Eq 20 vanishes. At least 4/3 for a uniform rectangle.
    """
    n = gradient(block, corner_arm(block, side, rotation))
    coupling = abs(n[0] @ n[1])
    return float(n[1] @ n[1] / coupling) if coupling > 0.0 else math.inf


def starting_region(
    block: RigidBlock, ground_x: float, ground_y: float, friction: float
) -> Mechanism:
    """Motion that starts from rest, by closed borders."""
    vertical = 1.0 + ground_y
    if vertical <= 0.0:
        return LIFT_OFF
    load = abs(ground_x) / vertical
    side = CORNER_A if ground_x > 0.0 else CORNER_B
    slenderness = reach(block, side) / block.rise
    if load <= min(friction, slenderness):
        return REST
    if friction <= slenderness:
        return SLIDE
    return SLIDE_ROCK if friction < rocking_friction(block, side, load) else ROCK
