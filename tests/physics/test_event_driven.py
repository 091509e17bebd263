"""Event-driven integration of arches: energy, histories, and mechanisms that once misled it."""

import functools

import numpy as np
import pytest

import archfrag as af
from tests.validation.scenes import g, oppenheim, pulse, sampled

simulate = functools.partial(af.simulate, method="event_driven")
MANY = af.Arch.circular(10.0, 1.5, 157.5, 27, 0.7)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_energy_has_no_unexplained_part(rtol):
    run = simulate(oppenheim(), pulse(0.5, 0.3), rtol=rtol)
    assert run.energy_error < 10.0 * rtol
    assert run.energy["friction"] <= 0.0
    assert run.energy["impacts"] < -0.01 * run.energy["largest_kinetic"]


def test_a_history_changes_nothing_and_has_the_peak_though_steps_are_long():
    plain = simulate(oppenheim(), pulse(0.5, 0.3), rtol=1e-2)
    kept = simulate(oppenheim(), pulse(0.5, 0.3), rtol=1e-2, history=True)
    assert (kept.energy, kept.peak_displacement) == (
        plain.energy,
        plain.peak_displacement,
    )
    moved = np.hypot(*np.moveaxis(kept.history.displacement.values, -1, 0))
    assert kept.peak_displacement == pytest.approx(moved.max(), rel=1e-3)


@pytest.mark.parametrize("method", ["event_driven", "auto"])
def test_two_voussoirs_whose_hinges_and_slide_allow_no_finite_motion(method):
    # Two hinges at the springings and a slide at the crown move at first order only.
    arch = af.Arch.pointed(6.0, 5.3, 0.94, voussoirs=2, friction=1.05)
    sine = (
        2.0 * af.onset(arch).plus * g * np.sin(4.0 * np.pi * np.arange(0.0, 1.0, 0.01))
    )
    run = af.simulate(arch, af.Motion(sine, 0.01), method=method)
    assert run.collapsed is False
    assert run.peak_displacement < 0.2


# Time stepping collapses from 0.6038 g on.
@pytest.mark.parametrize(
    ("amplitude", "rtol"),
    [(0.4906183863126449, 1e-4), (0.593843, 1e-4), (0.593843, 1e-5)],
)
def test_slips_of_a_rejected_stage_are_not_handed_to_time_stepping(amplitude, rtol):
    assert (
        simulate(MANY, sampled(lambda t: 1.0, 0.4), amplitude, rtol=rtol).collapsed
        is False
    )
