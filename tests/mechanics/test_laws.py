"""Laws of one joint, formula by formula."""

import math

import numpy as np
import pytest

from archfrag.mechanics.laws import (
    CLOSED_MINUS,
    CLOSED_PLUS,
    CLOSED_STICK,
    CORNER_MINUS,
    CORNER_PLUS,
    CORNER_STICK,
    MINUS,
    OPEN,
    PLUS,
    STICK,
    closed_mode,
    corner_mode,
    coulomb_violation,
    cross,
    friction_ray,
    is_closed,
    signorini_violation,
    slip_of,
    touches,
)


class TestModes:
    def test_ten_modes_are_told_apart(self):
        modes = [OPEN, *CORNER_STICK, *CORNER_PLUS, *CORNER_MINUS]
        modes += [CLOSED_STICK, CLOSED_PLUS, CLOSED_MINUS]
        assert sorted(modes) == list(range(10))

    @pytest.mark.parametrize("slip", [STICK, PLUS, MINUS])
    def test_mode_tells_corner_and_slip(self, slip):
        for corner in (0, 1):
            mode = corner_mode(corner, slip)
            assert touches(mode, corner)
            assert not touches(mode, 1 - corner)
            assert slip_of(mode) == slip
            assert not is_closed(mode)
        mode = closed_mode(slip)
        assert is_closed(mode)
        assert touches(mode, 0)
        assert touches(mode, 1)
        assert slip_of(mode) == slip

    def test_an_open_joint_touches_nowhere(self):
        assert not touches(OPEN, 0)
        assert not touches(OPEN, 1)
        assert slip_of(OPEN) == STICK


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

    def test_ray_has_unit_normal_part_and_friction_along_the_tangent(self):
        angle, friction = 0.7, 0.4
        normal = np.array([math.cos(angle), math.sin(angle)])
        tangent = np.array([-normal[1], normal[0]])
        for slip in (PLUS, MINUS):
            ray = np.array(friction_ray(*normal, friction, slip))
            assert ray @ normal == pytest.approx(1.0)
            assert ray @ tangent == pytest.approx(slip * friction)
            assert friction_ray(*normal, math.inf, slip) == pytest.approx(tuple(slip * tangent))

    def test_cross_is_positive_counter_clockwise(self):
        assert cross(1.0, 0.0, 0.0, 1.0) == 1.0
