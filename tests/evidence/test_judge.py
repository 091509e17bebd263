"""Measures outside every method: known motions, judged."""

import numpy as np
import pytest

import archfrag as af
from archfrag.evidence.judge import drift, energy_gain, overlap

BLOCK = af.Block(0.2, 1.0, friction=0.8)


def rocked(angle):
    """The block turned about its right base corner by `angle` (clockwise) [rad]."""
    centre = BLOCK.chain.centroid[0]
    corner = np.array([0.1, 0.0])
    turn = np.array([[np.cos(-angle), -np.sin(-angle)], [np.sin(-angle), np.cos(-angle)]])
    return turn @ (centre - corner) + corner - centre


class TestOverlap:
    @pytest.mark.parametrize("angle", [0.05, 0.2])
    def test_a_block_on_its_corner_overlaps_nothing(self, angle):
        assert overlap(BLOCK, rocked(angle)[None, None], np.array([[-angle]])) < 1e-12

    def test_a_block_sunk_by_a_tenth_of_its_width_does(self):
        sunk = np.array([[[0.0, -0.02]]])
        assert overlap(BLOCK, sunk, np.zeros((1, 1))) == pytest.approx(0.1)

    def test_turned_about_its_centre_it_does(self):
        angle = 0.1
        depth = 0.1 * np.sin(angle) - 0.5 * (1.0 - np.cos(angle))
        found = overlap(BLOCK, np.zeros((1, 1, 2)), np.array([[angle]]))
        assert found == pytest.approx(depth / 0.2, rel=0.02)


class TestEnergyGain:
    def fall(self, factor):
        """A body in free fall whose speed is `factor` times what gravity gives."""
        time = np.linspace(0.0, 1.0, 2001)
        g = BLOCK.chain.gravity
        displacement, velocity = np.zeros((2, time.size, 1, 2))
        displacement[:, 0, 1] = -0.5 * g * time**2
        velocity[:, 0, 1] = -g * time * factor
        still = af.Motion(np.zeros(3), 0.01)
        return energy_gain(BLOCK, still, time, displacement, velocity, np.zeros((time.size, 1)))

    def test_free_fall_gains_nothing(self):
        assert self.fall(1.0) < 1e-12

    def test_a_fall_that_is_too_fast_gains(self):
        assert self.fall(1.1) == pytest.approx((1.21 - 1.0) / 1.21, rel=1e-6)

    def test_a_body_left_behind_by_the_ground_takes_the_ground_s_work(self):
        time = np.linspace(0.0, 0.5, 501)
        acceleration = 3.0
        motion = af.Motion(np.full(501, acceleration), 0.001)
        displacement, velocity = np.zeros((2, time.size, 1, 2))
        displacement[:, 0, 0] = -0.5 * acceleration * time**2
        velocity[:, 0, 0] = -acceleration * time
        turning = np.zeros((time.size, 1))
        assert energy_gain(BLOCK, motion, time, displacement, velocity, turning) < 1e-12
        still = af.Motion(np.zeros(501), 0.001)
        assert energy_gain(BLOCK, still, time, displacement, velocity, turning) == 1.0


def test_drift_is_the_largest_displacement():
    assert drift(np.array([[[0.0, 0.0], [3.0, 4.0]], [[1.0, 0.0], [0.0, 0.0]]])) == 5.0
