"""Contact dynamics by Gauss-Seidel sweeps: what it must give, and what it counts."""

import functools
import math

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.status import Status
from archfrag.methods.contact_dynamics.gauss_seidel import solve_corner
from tests.methods import corner_scenes as scenes
from tests.physics.audit import g, pulse

METHOD = "gauss_seidel"
simulate = functools.partial(af.simulate, method=METHOD)


class TestOneContact:
    def test_laws_hold_for_random_contacts(self):
        rng = np.random.default_rng(1)
        seen = set()
        for _ in range(2000):
            root = rng.normal(size=(2, 2))
            operator = root @ root.T + 0.2 * np.eye(2)
            free, mu = rng.normal(size=2), rng.choice([0.0, 0.3, 0.7, math.inf])
            w_nn, w_nt, w_tt = operator[0, 0], operator[0, 1], operator[1, 1]
            r_n, r_t, touches, slide = solve_corner(w_nn, w_nt, w_tt, free[0], free[1], mu)
            u_n, u_t = free + operator @ [r_n, r_t]
            if np.isfinite(mu) and min(w_nn - mu * w_nt, w_nn + mu * w_nt) <= 0.0:
                continue
            seen.add((touches, slide))
            assert r_n >= 0.0
            assert min(r_n, u_n) == pytest.approx(0.0, abs=1e-10)
            if np.isfinite(mu):
                assert abs(r_t) <= mu * r_n * (1.0 + 1e-12)
            if slide != 0.0:
                assert slide * r_t >= 0.0
                assert slide * u_t <= 1e-10
            elif touches:
                assert u_t == pytest.approx(0.0, abs=1e-10)
        assert seen == {(False, 0.0), (True, 0.0), (True, 1.0), (True, -1.0)}


class TestRest:
    def test_an_arch_shaken_below_its_onset_does_not_creep(self):
        response = scenes.shaken_below_onset(METHOD)
        assert response.status == Status.STANDING
        assert response.collapsed is False
        assert response.peak_displacement < 1e-6


class TestCoulomb:
    def test_a_sliding_block_slows_down_by_mu_g_and_stays_on_the_ground(self):
        response, speed = scenes.thrown_block(METHOD)
        assert speed == pytest.approx(1.0 - 0.4 * g * 0.1, rel=1e-8)
        path = response.history.displacement.values[:, 0]
        assert path[-1, 0] == pytest.approx(1.0 / (0.8 * g), rel=1e-5)
        assert abs(path[:, 1]).max() < 1e-9
        assert response.energy_error < 1e-7


class TestImpact:
    def test_rocking_loses_what_housner_gives(self):
        coarse = abs(scenes.rocking_errors(METHOD, 0.8, 1e-3))
        fine = abs(scenes.rocking_errors(METHOD, 0.8, 2.5e-4))
        assert fine.max() < 6e-3
        assert fine.max() < 0.5 * coarse.max()


class TestValidation:
    def test_keystone_before_the_first_impact(self):
        assert np.abs(scenes.keystone_errors(METHOD)).max() < 1e-4

    def test_largest_displacement_is_that_of_lmgc90_at_this_step(self):
        assert scenes.shaken_arch(METHOD).peak_displacement == pytest.approx(0.165, abs=1e-3)

    @pytest.mark.parametrize(("tp", "stands", "falls"), [(0.3, 0.675, 0.700), (0.5, 0.450, 0.456)])
    def test_collapse_amplitude_is_that_of_lmgc90_at_this_step(self, tp, stands, falls):
        """LMGC90: 0.688 to 0.700 g; just below, single amplitudes collapse already."""
        assert simulate(scenes.arch(), pulse(stands, tp), dt=1e-3).collapsed is False
        assert simulate(scenes.arch(), pulse(falls, tp), dt=1e-3).collapsed is True

    def test_first_steps_are_those_of_time_stepping(self):
        difference = scenes.first_steps(METHOD) - scenes.first_steps("time_stepping")
        assert abs(difference).max() < 1e-8

    def test_energy_is_accounted_for(self):
        response = scenes.shaken_arch(METHOD)
        assert response.energy_error < 5e-4
        assert response.energy["impacts"] < 0.0
        assert response.status == Status.STANDING


class TestSweeps:
    def test_steps_at_the_cap_are_counted_and_the_run_goes_on(self):
        five = simulate(scenes.arch(), pulse(0.5, 0.3), follow=0.0, settings={"sweeps": 5})
        many = simulate(scenes.arch(), pulse(0.5, 0.3), follow=0.0)
        assert five.work["unconverged"] > 0.8 * five.steps
        assert five.work["sweeps"] <= 5 * five.steps
        assert five.end_time == many.end_time > 0.9
        assert five.residual > 0.01
        assert many.work["unconverged"] == 0
        assert many.residual < 0.1 * five.residual

    def test_they_grow_faster_than_the_number_of_voussoirs(self):
        small, large = (
            simulate(scenes.arch(n), pulse(0.5, 0.1), follow=0.0).work["sweeps"] for n in (7, 27)
        )
        assert large > 10 * small

    def test_a_run_cut_off_in_motion_is_neither_collapse_nor_survival(self):
        response = simulate(scenes.arch(), pulse(0.6, 0.1), follow=0.0)
        assert response.status == Status.UNFINISHED
        assert response.collapsed is None
