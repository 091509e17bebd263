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
from tests.mechanics.adapters import MODES, Mode

SLIPS = (0, 1, -1)


class TestModes:
    def test_ten_modes_are_distinguished(self):
        modes = [OPEN, *(closed_mode(slip) for slip in SLIPS)]
        modes += [corner_mode(corner, slip) for corner in (0, 1) for slip in SLIPS]
        assert sorted(modes) == list(range(10))

    @pytest.mark.parametrize("slip", SLIPS)
    def test_mode_gives_corner_and_slip(self, slip):
        for corner in (0, 1):
            assert MODES[corner_mode(corner, slip)] == Mode((corner,), slip)
        assert MODES[closed_mode(slip)] == Mode((0, 1), slip)

    def test_an_open_joint_touches_nowhere(self):
        assert MODES[OPEN] == Mode(())


class TestSignorini:
    @pytest.mark.parametrize(
        ("gap_rate", "force", "expected"),
        [(0.0, 3.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 0.0), (2.0, 3.0, 2.0), (-1.0, 4.0, 1.0),
         (1.0, -0.5, 0.5)],
    )  # fmt: skip
    def test_violation(self, gap_rate, force, expected):
        assert signorini_violation(gap_rate, force) == expected


class TestCoulomb:
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
    def test_violation(self, slip, normal, tangential, friction, expected):
        found = coulomb_violation(slip, normal, tangential, friction)
        assert found == pytest.approx(expected, abs=1e-15)
