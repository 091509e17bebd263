"""Baselines with two contacts a joint: Gauss-Seidel sweeps, and a quadratic programme a step."""

import functools
import importlib.util
import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

import archfrag as af
from archbench.exact import Rocking
from archfrag.errors import InputError
from archfrag.mechanics.status import Status
from archfrag.mechanics.types import GroundMotion, Options
from archfrag.methods.base import start
from archfrag.methods.contact_dynamics.gauss_seidel import solve_corner
from archfrag.methods.contact_dynamics.quadratic_programme import Programme
from archfrag.methods.contact_dynamics.step import corner_case
from archfrag.simulation.history import empty_frames
from archfrag.simulation.mechanism import empty_log
from tests.physics.audit import g, pulse, tilted

SWEEPS, PROGRAMME = "gauss_seidel", "quadratic_programme"
needs_solver = pytest.mark.skipif(
    importlib.util.find_spec("piqp") is None,
    reason="piqp, of the extra `baselines`, is not installed",
)
both = pytest.mark.parametrize("method", [SWEEPS, pytest.param(PROGRAMME, marks=needs_solver)])
# The table of other solvers, section A: LMGC90 and Siconos at 0.5 ms agree in all digits.
KEYSTONE = {0.2: -0.01621, 0.4: -0.04211}


def arch_of(voussoirs=7, friction=0.7):
    """The arch of the table of other solvers, section A."""
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs, friction, sector=False)


def thrown_block(method):
    """A low block set sliding by a blow: response, and its velocity after 0.1 s [m/s]."""
    response = af.simulate(
        af.Block(1.0, 0.5, friction=0.4), af.Motion(np.zeros(3), 0.01), method=method,
        history=True, initial=(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])), follow=2.0,
    )  # fmt: skip
    history = response.history
    return response, float(np.interp(0.1, history.time, history.velocity[:, 0, 0]))


def rocking_errors(method, friction, dt):
    """Relative errors of the amplitudes after two impacts against Housner's block."""
    slenderness, width = 0.2, 1.0
    height = width / math.tan(slenderness)
    exact = Rocking(slenderness, math.sqrt(0.75 * g / math.hypot(0.5 * width, 0.5 * height)))
    tops = np.array(exact.amplitudes(0.5 * slenderness, 3))
    swings = np.array([exact.quarter(0.5 * slenderness), *(2.0 * exact.quarter(a) for a in tops)])
    times = np.cumsum(swings)
    response = af.simulate(
        af.Block(width, height, friction=friction), af.Motion(np.zeros(3), 0.01), method=method,
        dt=dt, history=True, initial=tilted(width, height, 0.5 * slenderness), follow=4.5,
    )  # fmt: skip
    tilt, time = abs(response.history.rotation.values[:, 0]), response.history.time.values
    found = [tilt[(time > times[k]) & (time < times[k + 1])].max() for k in range(2)]
    return np.abs(found / tops[:2] - 1.0)


@functools.cache
def shaken_arch(method):
    """The arch under 0.5 g of section A, to the end."""
    return af.simulate(arch_of(), pulse(0.5, 0.3), method=method, dt=1e-3, history=True)


def first_steps(method):
    """Displacements and rotations in the first 0.1 s, at 0.1 ms a step."""
    history = af.simulate(
        arch_of(), af.Motion(np.full(101, 0.5 * g), 1e-3), method=method, dt=1e-4, history=True,
        follow=0.0,
    ).history.drop_duplicates("time")  # fmt: skip
    state = np.concatenate([history.displacement.values, history.rotation.values[..., None]], -1)
    # Frames of some methods lie in the middle of their steps.
    return CubicSpline(history.time.values, state.reshape(len(state), -1))(
        np.arange(1, 100) * 1e-3
    )


@both
class TestBoth:
    def test_an_arch_shaken_below_its_onset_does_not_creep(self, method):
        arch = arch_of()
        noise = np.random.default_rng(5).uniform(-1.0, 1.0, 101) * 0.9 * af.onset(arch).plus * g
        response = af.simulate(arch, af.Motion(noise, 0.01), method=method)
        assert response.status == Status.STANDING
        assert response.peak_displacement < (1e-6 if method == SWEEPS else 1e-9)

    def test_rocking_loses_what_housner_gives(self, method):
        assert rocking_errors(method, 0.8, 2.5e-4).max() < 6e-3

    def test_keystone_before_the_first_impact(self, method):
        history = shaken_arch(method).history
        found = np.interp(list(KEYSTONE), history.time, history.displacement[:, 3, 0])
        assert found == pytest.approx(list(KEYSTONE.values()), abs=1e-4)

    def test_collapse_amplitude_is_that_of_lmgc90_at_this_step(self, method):
        """LMGC90: 0.688 to 0.700 g; just below, single amplitudes collapse already."""
        for amplitude, falls in ((0.675, False), (0.700, True)):
            run = af.simulate(arch_of(), pulse(amplitude, 0.3), method=method, dt=1e-3)
            assert run.collapsed is falls

    def test_first_steps_are_those_of_time_stepping(self, method):
        assert abs(first_steps(method) - first_steps("time_stepping")).max() < 1e-8

    def test_energy_is_accounted_for(self, method):
        response = shaken_arch(method)
        assert response.status == Status.STANDING
        assert response.energy_error < 5e-4
        assert response.energy["impacts"] < 0.0
        assert response.residual < 1e-3
        assert response.work["unconverged"] == 0


class TestSweeps:
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

    def test_a_sliding_block_slows_down_by_mu_g_and_stays_on_the_ground(self):
        response, speed = thrown_block(SWEEPS)
        assert speed == pytest.approx(1.0 - 0.4 * g * 0.1, rel=1e-8)
        path = response.history.displacement.values[:, 0]
        assert path[-1, 0] == pytest.approx(1.0 / (0.8 * g), rel=1e-5)
        assert abs(path[:, 1]).max() < 1e-9
        assert response.energy_error < 1e-7

    def test_steps_at_the_cap_are_counted_and_the_run_goes_on(self):
        simulate = functools.partial(af.simulate, arch_of(), method=SWEEPS, follow=0.0)
        five, many = simulate(pulse(0.5, 0.3), settings={"sweeps": 5}), simulate(pulse(0.5, 0.3))
        assert five.work["unconverged"] > 0.8 * five.steps
        assert five.work["sweeps"] <= 5 * five.steps
        assert five.end_time == many.end_time > 0.9
        assert many.work["unconverged"] == 0
        assert many.residual < 0.1 * five.residual
        assert five.residual > 0.01

    def test_they_grow_faster_than_the_number_of_voussoirs(self):
        small, large = (
            af.simulate(arch_of(n), pulse(0.5, 0.1), method=SWEEPS, follow=0.0).work["sweeps"]
            for n in (7, 27)
        )
        assert large > 10 * small


def test_a_missing_solver_is_one_message_that_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs the package piqp.*archfrag\[baselines\]"):
        af.simulate(arch_of(), pulse(0.1, 0.1), method=PROGRAMME)


@needs_solver
class TestProgramme:
    def test_solution_is_that_of_least_squares_on_the_reactions(self):
        """Moreau: what is left of the free velocities is their projection on a polar cone."""
        rng = np.random.default_rng(2)
        arch = arch_of(5)
        position = np.column_stack([arch.chain.centroid, np.zeros(5)])
        ground = GroundMotion(np.zeros(3), np.zeros(3), 0.01)
        options = Options(1e-3, 1e-3, 1e-3, 0.0, 10, 0.5, 64, 1e-3, 0.0)
        for _ in range(5):
            output = empty_frames(0, 5, arch.n_joint), empty_log(0, arch.n_joint)
            case = corner_case(arch.chain, ground, False, options, *output)
            start(case, position, 1e-3 * rng.normal(size=(5, 3)), False)
            programme = Programme(case, 1e-11)
            programme.pose()
            # Corners that overlap a little at the positions of the step have no bias.
            programme.low[:] = 0.0
            programme.solve()
            dense = np.zeros((programme.low.size, 21))
            for r, row in enumerate(programme.row.reshape(-1, 6)):
                dense[r, 3 * (r // 4) : 3 * (r // 4) + 6] = row
            dense, free = dense[:, 3:18], -programme.linear
            multiplier, _ = nnls(dense.T, -free)
            expected = free + dense.T @ multiplier
            assert abs(programme.solution - expected).max() < 1e-6 * abs(free).max()

    def test_associative_onset_of_a_sliding_arch(self):
        """validation/, section 2: 0.2570 g, straight-sided, mu 0.4."""
        moved = [
            af.simulate(
                arch_of(friction=0.4), af.Motion(np.full(201, a * g), 1e-3), method=PROGRAMME,
                dt=1e-3, follow=0.0,
            ).peak_displacement
            for a in (0.2565, 0.2575)
        ]  # fmt: skip
        assert moved[0] < 1e-9
        assert moved[1] > 1e-5

    def test_a_thrown_block_leaves_the_ground(self):
        """Projected on the cone u_n >= mu u_t, a speed v becomes v mu / (1 + mu^2) upwards."""
        response, speed = thrown_block(PROGRAMME)
        rise = response.history.displacement.values[:, 0, 1].max()
        lift = 0.4 / (1.0 + 0.4**2)
        assert rise == pytest.approx(lift**2 / (2.0 * g), rel=0.02)
        assert speed == pytest.approx(1.0 - 0.4 * g * 0.1, rel=2e-3)
        assert response.energy_error > 0.1

    def test_a_pushed_block_hovers_at_mu_times_the_slip_of_a_step(self):
        block, push = af.Block(1.0, 0.5, friction=0.4), af.Motion(np.full(301, -0.6 * g), 1e-3)
        for dt in (2e-3, 1e-3):
            run = af.simulate(block, push, method=PROGRAMME, dt=dt, history=True, follow=0.0)
            last = run.history.isel(time=-3)  # the last steps may be shorter
            slip, rise = last.displacement.values[0]
            assert slip == pytest.approx(0.1 * g * float(last.time) ** 2, rel=3e-3)
            assert rise == pytest.approx(0.4 * last.velocity.values[0, 0] * dt, rel=5e-3)

    def test_without_a_friction_limit_housner_holds_too(self):
        assert rocking_errors(PROGRAMME, np.inf, 2.5e-4).max() < 6e-3
