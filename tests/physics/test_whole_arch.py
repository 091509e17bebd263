"""Laws of an arch: equilibrium, standstill, energy, symmetry. Values are in tests/validation."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.status import Status
from tests.validation.scenes import g, pulse


def oppenheim(voussoirs=7, **options):
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs, **{"friction": 0.7, **options})


class TestStaticTheorem:
    def test_hinges_of_oppenheims_arch(self):
        start = af.onset(oppenheim())
        sides = ["extrados", "intrados", "extrados", "intrados"]
        assert start.hinges == list(zip([0, 2, 4, 7], sides))
        assert start.hinges_minus == list(zip([0, 3, 5, 7], sides[1:] + sides[:1]))
        assert start.sliding == []

    def test_thrust_passes_through_the_hinges_and_stays_in_the_joints(self):
        arch = oppenheim()
        start = af.onset(arch)
        for joint, side in start.hinges:
            corner = (arch.extrados if side == "extrados" else arch.intrados)[joint]
            assert start.thrust_plus[joint] == pytest.approx(corner, abs=1e-6)
        radius = np.hypot(*start.thrust.T)
        assert (radius >= 9.25 - 1e-9).all()
        assert (radius <= 10.75 + 1e-9).all()


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

    def test_vertical_acceleration_acts_through_the_direction_of_the_force(self):
        arch = oppenheim()
        limit = af.onset(arch).plus
        for vertical in (-0.3, 0.0, 0.4):
            steady = np.full(200, 1.0)
            inside = af.Motion(
                0.999 * limit * (1 + vertical) * g * steady, 0.01, vertical * g * steady
            )
            outside = af.Motion(
                1.01 * limit * (1 + vertical) * g * steady, 0.01, vertical * g * steady
            )
            assert af.simulate(arch, inside).steps == 0
            assert af.simulate(arch, outside).steps > 0

    def test_a_ring_too_thin_falls(self):
        thin = af.Arch.circular(10.0, 0.95, 180.0, 27, 0.7, sector=False)
        still = np.zeros((27, 3))
        response = af.simulate(thin, af.Motion(np.zeros(400), 0.01), initial=(still, still))
        assert response.collapsed
        assert 1.1 < response.lost_contact_time < 1.5
        assert response.lost_contact_time <= response.collapse_time < response.end_time


class TestSignorini:
    def test_unfinished_is_neither_collapse_nor_survival(self):
        response = af.simulate(oppenheim(), pulse(0.5, 0.3), follow=0.0)
        assert response.status is Status.UNFINISHED
        assert response.collapsed is None


class TestEnergy:
    @pytest.mark.parametrize("follow", [0.0, 20.0])
    def test_the_balance_closes_in_motion_and_at_rest(self, follow):
        energy = af.simulate(oppenheim(), pulse(0.5, 0.3), follow=follow).energy
        assert (energy["kinetic"] > 0.0) == (follow == 0.0)
        gained = energy["kinetic"] + energy["potential"]
        given = energy["ground"] + energy["friction"] + energy["impacts"] + energy["balance_error"]
        assert gained == pytest.approx(given, abs=1e-9 * energy["largest_kinetic"])

    def test_what_no_law_explains_is_small_and_of_second_order_before_impacts(self):
        arch = oppenheim()
        time = np.arange(0.0, 0.4, 1e-4)
        push = af.Motion(np.where(time < 0.2, 0.6 * g, 0.0), 1e-4)
        errors = [
            af.simulate(arch, push, method="time_stepping", dt=dt, follow=0.0).energy_error
            for dt in (2e-3, 1e-3, 5e-4)
        ]
        assert errors[-1] < 1e-5
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
        assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.25)

    def test_no_run_gains_energy(self):
        rng = np.random.default_rng(11)
        for _ in range(30):
            arch = oppenheim(int(rng.integers(3, 15)), friction=rng.uniform(0.45, 1.0))
            motion = pulse(rng.uniform(0.4, 1.2), rng.uniform(0.1, 0.5))
            response = af.simulate(arch, motion)
            largest = response.energy["largest_kinetic"]
            assert response.energy["friction"] <= 0.0
            assert response.energy["impacts"] <= 0.0
            assert response.energy["balance_error"] <= 1e-2 * largest  # ten times the tolerance
            assert response.status in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)


class TestSymmetry:
    def test_mirrored_motion_gives_the_mirrored_response_before_impacts(self):
        arch = oppenheim()
        motion = pulse(0.5, 0.3)
        right = af.simulate(arch, motion, history=True).history
        left = af.simulate(arch, motion, scale=-1.0, history=True).history
        n = int(np.searchsorted(right.time.values, 0.4))
        mirrored = left.displacement.values[:n, ::-1] * np.array([-1.0, 1.0])
        assert np.abs(right.displacement.values[:n] - mirrored).max() < 1e-9

    def test_two_runs_are_equal_to_the_last_bit(self):
        one, two = (af.simulate(oppenheim(27), pulse(0.6, 0.3)) for _ in range(2))
        assert one.energy == two.energy
        assert one.peak_displacement == two.peak_displacement
