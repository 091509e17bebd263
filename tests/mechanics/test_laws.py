"""Laws of one joint, formula by formula."""

import math

import pytest

from archfrag.mechanics.laws import (
    OPEN,
    closed_mode,
    corner_mode,
    coulomb_violation,
    signorini_violation,
)
from tests.mechanics.adapters import MODES

SLIPS = (0, 1, -1)


def test_modes_are_numbered_by_corner_and_slip():
    modes = [OPEN, *(corner_mode(corner, slip) for corner in (0, 1) for slip in SLIPS)]
    modes += [closed_mode(slip) for slip in SLIPS]
    assert modes == list(range(10))
    assert len(set(MODES)) == 10


@pytest.mark.parametrize(
    ("gap_rate", "force", "expected"),
    [(0.0, 3.0, 0.0), (2.0, 0.0, 0.0), (2.0, 3.0, 2.0), (-1.0, 4.0, 1.0), (1.0, -0.5, 0.5)],
)
def test_violation_of_signorini(gap_rate, force, expected):
    assert signorini_violation(gap_rate, force) == expected


@pytest.mark.parametrize(
    ("slip", "normal", "tangential", "friction", "expected"),
    [
        (0.0, 1.0, 0.3, 0.5, 0.0),
        (0.0, 1.0, 0.7, 0.5, 0.2),
        (2.0, 1.0, -0.5, 0.5, 0.0),
        (2.0, 1.0, 0.5, 0.5, 1.0),
        (1.0, 1.0, 0.0, math.inf, 1.0),
        (0.0, 1.0, 9.0, math.inf, 0.0),
        (1.0, 0.0, 0.4, math.inf, 0.4),
    ],
)
def test_violation_of_coulomb(slip, normal, tangential, friction, expected):
    found = coulomb_violation(slip, normal, tangential, friction)
    assert found == pytest.approx(expected, abs=1e-15)
