"""Event-driven integration: exact motions, convergence, and the arch beyond time stepping."""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.status import Status
from tests.physics.audit import g, pulse, random_scene, sampled, tilted
from tests.validation.scenes import oppenheim

EVENT_DRIVEN = {"method": "event_driven"}


class TestBlock:
    def test_comes_to_rest_through_infinitely_many_impacts(self):
        block = af.Block(1.0, 4.0, friction=5.0)
        run = af.simulate(
            block, af.Motion(np.zeros(10), 0.1), initial=tilted(1.0, 4.0, 0.1), **EVENT_DRIVEN
        )
        assert run.status is Status.STANDING
        assert run.events["impacts"] > 30
        assert run.energy["kinetic"] == 0.0
        lost = block.chain.mass[0] * g * (2.0 * (math.cos(0.1) - 1.0) + 0.5 * math.sin(0.1))
        assert run.energy["impacts"] == pytest.approx(-lost, rel=1e-5)

    def test_a_thrown_block_is_braked_by_friction_and_its_balance_closes(self):
        block = af.Block(1.0, 1.0, friction=0.3)
        thrown = np.array([[1.0, 0.0, 0.0]])
        run = af.simulate(
            block, af.Motion(np.zeros(3), 0.1), rtol=1e-8, initial=(np.zeros((1, 3)), thrown),
            **EVENT_DRIVEN,
        )  # fmt: skip
        assert run.status is Status.STANDING
        assert run.peak_displacement == pytest.approx(1.0 / (2.0 * 0.3 * g), rel=1e-6)
        assert run.energy_error < 1e-7
        assert run.energy["friction"] == pytest.approx(-0.5 * block.chain.mass[0], rel=1e-6)


class TestArch:
    def first_impact(self, rtol):
        run = af.simulate(
            oppenheim(), pulse(0.5, 0.3), rtol=rtol, history=True, follow=0.0, **EVENT_DRIVEN
        )
        change = next(c for c in run.mechanism if c.cause == "impact")
        history = run.history.sel(time=slice(0.0, change.time))
        return change.time, history.displacement.values[-1], history.time.values[-1]

    def test_first_impact_converges_with_the_tolerance(self):
        exact, place, _ = self.first_impact(1e-11)
        errors = []
        for rtol in (1e-5, 1e-7, 1e-9):
            time, found, _ = self.first_impact(rtol)
            errors.append(max(abs(time - exact) / exact, np.abs(found - place).max()))
        assert errors[-1] < 1e-8
        assert errors[0] < 1e-5
        assert errors[2] < errors[0]

    def test_energy_has_no_unexplained_part(self):
        for rtol in (1e-4, 1e-6):
            run = af.simulate(oppenheim(), pulse(0.5, 0.3), rtol=rtol, **EVENT_DRIVEN)
            assert run.energy_error < 10.0 * rtol
            assert run.energy["friction"] <= 0.0
            assert run.energy["impacts"] < -0.01 * run.energy["largest_kinetic"]

    def test_peak_is_that_of_the_history_though_steps_are_long(self):
        run = af.simulate(oppenheim(), pulse(0.5, 0.3), rtol=1e-2, history=True, **EVENT_DRIVEN)
        moved = np.hypot(*np.moveaxis(run.history.displacement.values, -1, 0))
        assert run.peak_displacement == pytest.approx(moved.max(), rel=1e-3)

    def test_history_does_not_change_the_run(self):
        plain = af.simulate(oppenheim(), pulse(0.6, 0.3), **EVENT_DRIVEN)
        kept = af.simulate(oppenheim(), pulse(0.6, 0.3), history=True, **EVENT_DRIVEN)
        assert kept.energy == plain.energy
        assert kept.peak_displacement == plain.peak_displacement

    def test_four_hinges_near_the_onset(self):
        arch = af.Arch.circular(10.0, 1.5, 157.5, 27, 0.7)
        limit = af.onset(arch).plus
        run = af.simulate(arch, sampled(lambda t: 1.01 * limit, 0.3), history=True, **EVENT_DRIVEN)
        first = run.mechanism[1] if run.mechanism[0].model == "rest" else run.mechanism[0]
        assert first.model == "four_hinges"
        assert run.model_time["four_hinges"] > 0.1
        assert sorted(first.joints) == [j for j, _ in af.onset(arch).hinges]

    def test_two_voussoirs_whose_hinges_and_slide_allow_no_finite_motion(self):
        # Two hinges at the springings and a slide at the crown move at first order only.
        arch = af.Arch.pointed(6.0, 5.3, 0.94, voussoirs=2, friction=1.05)
        time = np.arange(0.0, 1.0, 0.01)
        sine = 2.0 * af.onset(arch).plus * g * np.sin(4.0 * math.pi * time)
        for method in ("event_driven", "auto"):
            run = af.simulate(arch, af.Motion(sine, 0.01), method=method)
            assert run.collapsed is False
            assert run.peak_displacement < 0.2

    # Time stepping collapses from 0.6038 g on.
    @pytest.mark.parametrize(
        ("amplitude", "rtol"), [(0.4906183863126449, 1e-4), (0.593843, 1e-4), (0.593843, 1e-5)]
    )
    def test_slips_of_a_rejected_stage_are_not_handed_to_time_stepping(self, amplitude, rtol):
        arch, push = af.Arch.circular(10.0, 1.5, 157.5, 27, 0.7), sampled(lambda t: 1.0, 0.4)
        assert af.simulate(arch, push, amplitude, rtol=rtol, **EVENT_DRIVEN).collapsed is False


class TestAgainstTimeStepping:
    def test_verdicts_of_random_scenes(self):
        rng = np.random.default_rng(41)
        same = compared = 0
        for _ in range(12):
            arch, motion = random_scene(rng)
            one = af.simulate(arch, motion, rtol=1e-5, **EVENT_DRIVEN).collapsed
            other = af.simulate(arch, motion, method="time_stepping", dt=2.5e-4).collapsed
            if one is None or other is None:
                continue
            compared += 1
            same += one == other
        assert compared >= 8
        assert same >= compared - 1


# Time stepping collapses from 0.6038 g on.
@pytest.mark.parametrize(
    ("amplitude", "tolerance"), [(0.4906183863126449, 1e-4), (0.593843, 1e-4), (0.593843, 1e-5)]
)
def test_slips_of_a_rejected_stage_are_not_handed_to_time_stepping(amplitude, tolerance):
    push = af.Motion(np.append(np.full(4000, amplitude * g), np.zeros(3)), 1e-4)
    arch = af.Arch.circular(10.0, 1.5, 157.5, 27, 0.7)
    run = af.simulate(arch, push, rtol=tolerance, **EVENT_DRIVEN)
    assert run.collapsed is False
