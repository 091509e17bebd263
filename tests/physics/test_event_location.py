"""Events of a mechanism in motion: instants known in closed form, or integrated apart."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import archfrag as af
from tests.physics.adapters import MINUS, OPEN, PLUS, Mode
from tests.physics.moving import Moving

g = 9.80665
STILL = (0.0, 0.0, 0.0, 0.0)
WIDTH = 1.0
HEIGHT = 4.0


def block(friction=0.6):
    """A tall block; corner 0 of its joint lies at x = 0.5 m, corner 1 at x = -0.5 m."""
    return af.Block(WIDTH, HEIGHT, friction=friction).chain


def in_flight(height, tilt=0.0, velocity=(0.0, 0.0, 0.0), ground=STILL):
    position = np.array([[0.0, 0.5 * HEIGHT + height, tilt]])
    return Moving(block(), position, np.array([velocity]), [OPEN], ground)


def sliding(speed, ground=STILL, friction=0.6):
    """A block that slides on its face; friction PLUS points to -x."""
    mode = Mode((0, 1), PLUS if speed > 0.0 else MINUS)
    position = np.array([[0.0, 0.5 * HEIGHT, 0.0]])
    velocity = np.array([[speed, 0.0, 0.0]])
    wide = af.Block(8.0, HEIGHT, friction=friction).chain
    return Moving(wide, position, velocity, [mode], ground)


class TestFlight:
    """Bodies without contact move on parabolas, which the integration follows exactly."""

    @pytest.mark.parametrize(("tilt", "rate"), [(0.02, -0.3), (-0.02, 0.3), (0.0, 0.0)])
    def test_the_corner_that_lands_first(self, tilt, rate):
        def gap(time, across):
            angle = tilt + rate * time
            rise = -0.5 * HEIGHT * math.cos(angle) + across * math.sin(angle)
            return 0.5 * HEIGHT + 0.05 - 0.5 * g * time**2 + rise

        expected = min(brentq(gap, 0.0, 0.15, (x,), xtol=1e-15) for x in (0.5, -0.5))
        time, used = in_flight(0.05, tilt, (0.0, 0.0, rate)).first_event(0.15)
        assert time == pytest.approx(expected, abs=1e-9)
        assert used == {("gap", 0)}

    @pytest.mark.parametrize("least", [1e-6, -1e-6])
    def test_a_corner_that_lands_and_would_leave_again_inside_the_step(self, least):
        speed = 0.1
        up = 5.0
        height = speed**2 / (2.0 * up) - least
        rising = (0.0, 0.0, -g - up, 0.0)
        time, used = in_flight(height, 0.0, (0.0, -speed, 0.0), rising).first_event(
            0.05
        )
        if least < 0.0:  # the gap only becomes small
            assert (time, used) == (math.inf, set())
        else:
            expected = (speed - math.sqrt(speed**2 - 2.0 * up * height)) / up
            assert time == pytest.approx(expected, abs=1e-9)
            assert used == {("gap", 0)}


class TestSliding:
    def test_a_slip_that_friction_and_a_changing_ground_end(self):
        # Rate 0.4 - (0.6 g + 3) t - 40 t^2 / 2, both in m/s.
        brake = 0.6 * g + 3.0
        expected = (math.sqrt(brake**2 + 2.0 * 40.0 * 0.4) - brake) / 40.0
        time, used = sliding(0.4, (3.0, 40.0, 0.0, 0.0)).first_event(0.1)
        assert time == pytest.approx(expected, abs=1e-9)
        assert used == {("slip", 0)}

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
