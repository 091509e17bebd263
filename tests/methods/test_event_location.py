"""Events of a mechanism in motion: instants known in closed form, or integrated apart."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import archfrag as af
from tests.mechanics.adapters import CLOSED, MINUS, OPEN, PLUS, Mode
from tests.mechanics.linkages import rotate
from tests.methods.moving import Moving
from tests.methods.rocking import Rocking

g = 9.80665
STILL = (0.0, 0.0, 0.0, 0.0)
NONE = (math.inf, set())
WIDTH, HEIGHT = 1.0, 4.0


def block(friction=0.6):
    """A tall block; corner 0 of its joint lies at x = 0.5 m, corner 1 at x = -0.5 m."""
    return af.Block(WIDTH, HEIGHT, friction=friction).chain


def in_flight(height, tilt=0.0, velocity=(0.0, 0.0, 0.0), ground=STILL):
    position = np.array([[0.0, 0.5 * HEIGHT + height, tilt]])
    return Moving(block(), position, np.array([velocity]), [OPEN], ground)


def sliding(speed, ground=STILL, friction=0.6):
    """A block that slides on its face; friction PLUS points to -x."""
    mode = Mode((0, 1), PLUS if speed > 0.0 else MINUS)
    position, velocity = np.array([[0.0, 0.5 * HEIGHT, 0.0]]), np.array([[speed, 0.0, 0.0]])
    wide = af.Block(8.0, HEIGHT, friction=friction).chain
    return Moving(wide, position, velocity, [mode], ground)


class TestFlight:
    """Bodies without contact move on parabolas, which the integration follows exactly."""

    def test_both_corners_that_land_at_once_are_one_event(self):
        time, used = in_flight(0.05).first_event(0.15)
        assert time == pytest.approx(math.sqrt(2.0 * 0.05 / g), abs=1e-11)
        assert used == {("gap", 0)}

    @pytest.mark.parametrize(("tilt", "rate"), [(0.02, -0.3), (-0.02, 0.3), (1e-4, 0.0)])
    def test_the_corner_that_lands_first(self, tilt, rate):
        def gap(time, across):
            angle = tilt + rate * time
            rise = -0.5 * HEIGHT * math.cos(angle) + across * math.sin(angle)
            return 0.5 * HEIGHT + 0.05 - 0.5 * g * time**2 + rise

        expected = min(brentq(gap, 0.0, 0.15, (x,), xtol=1e-15) for x in (0.5, -0.5))
        time, used = in_flight(0.05, tilt, (0.0, 0.0, rate)).first_event(0.15)
        assert time == pytest.approx(expected, abs=1e-9)
        assert used == {("gap", 0)}

    def test_a_corner_that_lands_and_would_leave_again_inside_the_step(self):
        speed, up, least = 0.1, 5.0, 1e-6
        height = speed**2 / (2.0 * up) - least
        rising = (0.0, 0.0, -g - up, 0.0)
        time, used = in_flight(height, 0.0, (0.0, -speed, 0.0), rising).first_event(0.05)
        expected = (speed - math.sqrt(speed**2 - 2.0 * up * height)) / up
        assert time == pytest.approx(expected, abs=1e-9)
        assert used == {("gap", 0)}

    def test_no_event_where_the_gap_only_becomes_small(self):
        speed, up, least = 0.1, 5.0, 1e-6
        height = speed**2 / (2.0 * up) + least
        rising = (0.0, 0.0, -g - up, 0.0)
        assert in_flight(height, 0.0, (0.0, -speed, 0.0), rising).first_event(0.05) == NONE
        assert in_flight(0.05).first_event(0.1) == NONE


class TestSliding:
    def test_a_slip_that_friction_and_a_changing_ground_end(self):
        # Rate 0.4 - (0.6 g + 3) t - 40 t^2 / 2, both in m/s.
        brake = 0.6 * g + 3.0
        expected = (math.sqrt(brake**2 + 2.0 * 40.0 * 0.4) - brake) / 40.0
        time, used = sliding(0.4, (3.0, 40.0, 0.0, 0.0)).first_event(0.1)
        assert time == pytest.approx(expected, abs=1e-9)
        assert used == {("slip", 0)}

    def test_both_forces_of_a_face_that_vanish_at_once(self):
        # The ground falls away ever faster: at its downward acceleration g nothing compresses.
        time, used = sliding(2.0, (0.0, 0.0, 0.0, -300.0)).first_event(0.05)
        assert time == pytest.approx(g / 300.0, abs=1e-9)
        assert used == {("law", 0)}

    def test_of_two_events_in_a_step_the_first(self):
        # The brake weakens with the pressing force g + rate t; the slip rate is what is left,
        # 0.2 - 0.6 (g t + rate t^2 / 2).
        for rate, kind in ((-10.0 * g, "slip"), (-30.0 * g, "law")):
            slip_end = np.roots([-0.3 * rate, -0.6 * g, 0.2])
            expected = slip_end.min() if kind == "slip" else -g / rate
            assert np.isreal(slip_end).all() == (kind == "slip")
            time, used = sliding(0.2, (0.0, 0.0, 0.0, rate)).first_event(0.12)
            assert time == pytest.approx(expected, abs=1e-9)
            assert used == {(kind, 0)}


class TestRocking:
    """A block that rotates about its right edge (corner 0), clockwise rotations being negative."""

    pivot = (0.5 * WIDTH, 0.0)

    def scene(self, friction, ground, tilt, rate):
        chain = block(friction)
        oracle = Rocking(chain, self.pivot, ground)
        position, velocity = oracle.state(tilt, rate)
        return oracle, Moving(chain, position, velocity, [Mode((0,))], ground)

    def test_landing(self):
        oracle, moving = self.scene(5.0, (1.0, 20.0, 0.0, 0.0), -0.01, 0.1)
        expected, _ = oracle.move(1.0, -0.01, 0.1, lambda t, y: y[0])
        assert 0.01 < expected < 0.09
        time, used = moving.first_event(0.01, 9)
        assert time == pytest.approx(expected, rel=1e-7)
        assert ("gap", 0) in used

    @pytest.mark.parametrize("rate", [60.0, -60.0])
    def test_slide_of_the_edge(self, rate):
        """It sticks while the reaction is in the cone of the ground and in that of its face."""
        friction, ground = 0.3, (0.0, rate, 0.0, 0.0)
        oracle, moving = self.scene(friction, ground, -0.1, 0.0)

        def left(time, state):
            force, _ = oracle.above(time, state, 0, self.pivot)
            along, across = rotate(force, -state[0])
            return min(friction * force[1] - abs(force[0]), friction * across - abs(along))

        assert left(0.0, [-0.1, 0.0]) > 0.0
        expected, _ = oracle.move(1.0, -0.1, 0.0, left)
        time, used = moving.first_event(0.1 * expected, 15)
        assert 0.005 < expected < 0.3
        assert time == pytest.approx(expected, rel=1e-7)
        assert used == {("law", 0)}

    def test_loss_of_the_edge_without_a_friction_limit(self):
        ground = (0.0, 0.0, 0.0, -300.0)
        oracle, moving = self.scene(np.inf, ground, -0.05, -0.5)

        def press(time, state):
            # It sticks while it compresses on both faces.
            force, _ = oracle.above(time, state, 0, self.pivot)
            tilt = state[0]
            return min(force[1], force[1] * math.cos(tilt) - force[0] * math.sin(tilt))

        expected, _ = oracle.move(1.0, -0.05, -0.5, press)
        time, used = moving.first_event(0.1 * expected, 15)
        assert 0.01 < expected < 0.05
        assert time == pytest.approx(expected, rel=1e-7)
        assert used == {("law", 0)}

    def test_a_joint_inside_that_becomes_a_hinge(self):
        """The upper of two blocks that rotate as one is left behind by ground that speeds up."""
        side = np.array([[0.5, 0.0], [0.5, 1.0], [0.5, 4.0]])
        chain = af.Arch.from_joints(side, side - [[1.0, 0.0]], 2.0, free_end=True).chain
        ground = (0.0, 100.0, 0.0, 0.0)
        oracle = Rocking(chain, self.pivot, ground)
        start = -0.02, -0.2

        def pressing(time, state):
            return min(
                sense * oracle.above(time, state, 1, (x, 1.0))[1]
                for sense, x in ((1.0, -0.5), (-1.0, 0.5))
            )

        moving = Moving(chain, *oracle.state(*start), [Mode((0,)), CLOSED], ground)
        assert pressing(0.0, start) > 0.0
        expected, _ = oracle.move(1.0, *start, pressing)
        assert 0.005 < expected < 0.2
        time, used = moving.first_event(0.1 * expected, 15)
        assert time == pytest.approx(expected, rel=1e-7)
        assert used == {("inside", 1)}
