"""The baseline that solves each step as a quadratic programme: its law, and what that costs."""

import functools
import importlib.util

import numpy as np
import pytest
from scipy.optimize import nnls

import archfrag as af
from archfrag.errors import InputError
from archfrag.mechanics.status import Status
from archfrag.mechanics.types import GroundMotion, Options
from archfrag.methods.base import start
from archfrag.methods.contact_dynamics.quadratic_programme import Programme
from archfrag.methods.contact_dynamics.step import corner_case
from archfrag.simulation.history import empty_frames
from archfrag.simulation.mechanism import empty_log
from tests.methods import corner_scenes as scenes
from tests.physics.audit import g, pulse

METHOD = "quadratic_programme"
simulate = functools.partial(af.simulate, method=METHOD)
needs_solver = pytest.mark.skipif(
    importlib.util.find_spec("piqp") is None,
    reason="piqp, of the extra `baselines`, is not installed",
)


def test_a_missing_solver_is_one_message_that_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs the package piqp.*archfrag\[baselines\]"):
        simulate(scenes.arch(), pulse(0.1, 0.1))


def posed(arch, velocity):
    """The programme of a closed arch with given velocities."""
    position = np.zeros((arch.n_voussoir, 3))
    position[:, :2] = arch.chain.centroid
    ground = GroundMotion(np.zeros(3), np.zeros(3), 0.01)
    options = Options(1e-3, 1e-3, 1e-3, 0.0, 10, 0.5, 64, 1e-3, 0.0)
    frames = empty_frames(0, arch.n_voussoir, arch.n_joint)
    case = corner_case(
        arch.chain, ground, False, options, frames, empty_log(0, arch.n_joint)
    )  # fmt: skip
    start(case, position, velocity, False)
    programme = Programme(case, 1e-11)
    programme.pose()
    return programme


@needs_solver
class TestProgramme:
    def test_solution_is_that_of_least_squares_on_the_reactions(self):
        """Moreau: what is left of the free velocities is their projection on a polar cone."""
        rng = np.random.default_rng(2)
        arch = scenes.arch(5)
        for _ in range(5):
            # Corners that overlap a little at the positions of the step have no bias.
            programme = posed(arch, 1e-3 * rng.normal(size=(5, 3)))
            programme.low[:] = 0.0
            programme.solve()
            dense = np.zeros((programme.low.size, 21))
            for r, row in enumerate(programme.row.reshape(-1, 6)):
                dense[r, 3 * (r // 4) : 3 * (r // 4) + 6] = row
            dense = dense[:, 3:18]
            free = -programme.linear
            multiplier, _ = nnls(dense.T, -free)
            expected = free + dense.T @ multiplier
            assert abs(programme.solution - expected).max() < 1e-6 * abs(free).max()


@needs_solver
class TestRest:
    def test_an_arch_shaken_below_its_onset_does_not_creep(self):
        response = scenes.shaken_below_onset(METHOD)
        assert response.status == Status.STANDING
        assert response.peak_displacement < 1e-9

    def test_associative_onset_of_a_sliding_arch(self):
        """validation/, section 2: 0.2570 g, straight-sided, mu 0.4."""
        moved = [
            simulate(
                scenes.arch(friction=0.4), af.Motion(np.full(201, a * g), 1e-3), dt=1e-3,
                follow=0.0,
            ).peak_displacement
            for a in (0.2565, 0.2575)
        ]  # fmt: skip
        assert moved[0] < 1e-9
        assert moved[1] > 1e-5


@needs_solver
class TestAssociativeFriction:
    def test_a_thrown_block_leaves_the_ground(self):
        """Projected on the cone u_n >= mu u_t, a speed v becomes v mu / (1 + mu^2) upwards."""
        response, speed = scenes.thrown_block(METHOD)
        rise = response.history.displacement.values[:, 0, 1].max()
        lift = 0.4 / (1.0 + 0.4**2)
        assert rise == pytest.approx(lift**2 / (2.0 * g), rel=0.02)
        assert speed == pytest.approx(1.0 - 0.4 * g * 0.1, rel=2e-3)
        assert response.energy_error > 0.1

    def test_a_pushed_block_hovers_at_mu_times_the_slip_of_a_step(self):
        block = af.Block(1.0, 0.5, friction=0.4)
        for dt in (2e-3, 1e-3):
            response = simulate(
                block, af.Motion(np.full(301, -0.6 * g), 1e-3), dt=dt, history=True, follow=0.0
            )
            last = response.history.isel(time=-3)  # the last steps may be shorter
            slip, rise = last.displacement.values[0]
            assert slip == pytest.approx(0.1 * g * float(last.time) ** 2, rel=3e-3)
            assert rise == pytest.approx(0.4 * last.velocity.values[0, 0] * dt, rel=5e-3)


@needs_solver
class TestImpact:
    @pytest.mark.parametrize("friction", [0.8, np.inf])
    def test_rocking_loses_what_housner_gives(self, friction):
        assert abs(scenes.rocking_errors(METHOD, friction, 2.5e-4)).max() < 6e-3


@needs_solver
class TestValidation:
    def test_keystone_before_the_first_impact(self):
        assert np.abs(scenes.keystone_errors(METHOD)).max() < 1e-4

    def test_collapse_amplitude(self):
        """As gauss_seidel and LMGC90 (0.688 to 0.700 g) at this step."""
        assert simulate(scenes.arch(), pulse(0.675, 0.3), dt=1e-3).collapsed is False
        assert simulate(scenes.arch(), pulse(0.700, 0.3), dt=1e-3).collapsed is True

    def test_first_steps_are_those_of_time_stepping(self):
        difference = scenes.first_steps(METHOD) - scenes.first_steps("time_stepping")
        assert abs(difference).max() < 1e-8

    def test_balance_and_residual_where_nothing_slides(self):
        response = scenes.shaken_arch(METHOD)
        assert response.status == Status.STANDING
        assert response.energy_error < 5e-4
        assert response.residual < 1e-3
        assert response.work["unconverged"] == 0
