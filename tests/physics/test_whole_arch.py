"""Laws of an arch: equilibrium, standstill, energy, symmetry. Values are in tests/validation."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.status import Status
from tests.validation.scenes import g, oppenheim, pulse


class TestRest:
    def test_nothing_moves_for_a_minute(self):
        arch = af.Arch.circular(10.0, 1.2, 180.0, 27, 0.7, sector=False)
        still = np.zeros((27, 3))
        for initial in (None, (still, still)):
            response = af.simulate(arch, af.Motion(np.zeros(6001), 0.01), initial=initial)
            assert response.status is Status.STANDING
            assert response.peak_displacement <= 1e-9

    def test_a_motion_inside_the_range_of_rest_moves_nothing(self):
        arch = oppenheim()
        limit = af.onset(arch).plus
        noise = np.random.default_rng(1).uniform(-1, 1, 2000)
        motion = af.Motion((limit - 1e-9) * g * noise / np.abs(noise).max(), 0.01)
        response = af.simulate(arch, motion)
        assert response.peak_displacement == 0.0
        assert response.steps == 0
        beyond = af.simulate(arch, motion, scale=1.001)
        assert beyond.steps > 0


class TestEnergy:
    @pytest.mark.parametrize("follow", [0.0, 20.0])
    def test_the_balance_closes_in_motion_and_at_rest(self, follow):
        energy = af.simulate(oppenheim(), pulse(0.5, 0.3), follow=follow).energy
        assert (energy["kinetic"] > 0.0) == (follow == 0.0)
        gained = energy["kinetic"] + energy["potential"]
        given = energy["ground"] + energy["friction"] + energy["impacts"] + energy["balance_error"]
        assert gained == pytest.approx(given, abs=1e-9 * energy["largest_kinetic"])

    def test_no_run_gains_energy(self):
        rng = np.random.default_rng(11)
        for _ in range(30):
            voussoirs, friction = int(rng.integers(3, 15)), rng.uniform(0.45, 1.0)
            arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs, friction)
            motion = pulse(rng.uniform(0.4, 1.2), rng.uniform(0.1, 0.5))
            response = af.simulate(arch, motion)
            largest = response.energy["largest_kinetic"]
            assert response.energy["friction"] <= 0.0
            assert response.energy["impacts"] <= 0.0
            assert response.energy["balance_error"] <= 1e-2 * largest  # ten times the tolerance
            assert response.status in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)
