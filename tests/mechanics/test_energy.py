"""Energies and works against sums written out."""

import numpy as np
import pytest

from archfrag.mechanics.energy import ground_work, kinetic_energy, potential_energy

MASS, INERTIA = np.array([2.0, 3.0]), np.array([0.5, 0.25])
VELOCITY = np.array([[1.0, -2.0, 4.0], [0.5, 0.0, -2.0]])


class TestEnergy:
    def test_kinetic(self):
        expected = 0.5 * (2.0 * 5.0 + 0.5 * 16.0 + 3.0 * 0.25 + 0.25 * 4.0)
        assert kinetic_energy(MASS, INERTIA, VELOCITY) == pytest.approx(expected)

    def test_potential_is_weight_times_height(self):
        position = np.array([[9.0, 1.5, 0.3], [7.0, -0.5, 0.1]])
        assert potential_energy(MASS, 10.0, position) == pytest.approx(10.0 * (3.0 - 1.5))

    def test_ground_works_against_the_motion_relative_to_it(self):
        expected = -(2.0 * (0.3 * 1.0 + 0.1 * -2.0) + 3.0 * (0.3 * 0.5))
        assert ground_work(MASS, 0.3, 0.1, VELOCITY) == pytest.approx(expected)
