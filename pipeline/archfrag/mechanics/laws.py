"""Contact modes of a joint as numbers, in histories and logs of the mechanism.

A joint has two corners, 0 (intrados) and 1 (extrados). Which of them touch, and whether they
stick or slide, is its *mode*: 0 open; 1 to 3 touching at corner 0, 4 to 6 at corner 1, 7 to 9 at
both, each sticking, with friction along the tangent, or with friction against it.
"""

from archfrag.mechanics.compile import kernel

OPEN = 0
CLOSED_STICK = 7


@kernel
def corner_mode(corner, slip):
    """Mode of a joint that touches at one corner only; `slip` is the sense of its friction."""
    return 1 + 3 * corner + (0 if slip == 0 else (1 if slip > 0 else 2))


@kernel
def closed_mode(slip):
    """Mode of a joint that touches at both corners."""
    return CLOSED_STICK + (0 if slip == 0 else (1 if slip > 0 else 2))
