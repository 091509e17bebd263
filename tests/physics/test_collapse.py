"""Collapse is a loss of contact that is not regained; losses before that are noted."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.physics.status import Status
from tests.validation.scenes import g, oppenheim, sampled

STILL = af.Motion(np.zeros(100), 0.01)
every_method = pytest.mark.parametrize(
    "method", ["time_stepping", "auto", "event_driven"]
)


def hop():
    """The ground falls away at three times gravity and catches the arch 0.18 m lower."""
    time = np.arange(0.0, 2.0, 1e-3)
    fall = np.where(
        time < 0.1, 0.0, np.where(time < 0.2, -3.0, np.where(time < 0.4, 1.5, 0.0))
    )
    return af.Motion(0.0 * time, 1e-3, vertical=g * fall)


def shifted(voussoirs, height):
    """Initial state at rest in which some voussoirs stand higher [m]."""
    shift = np.zeros((7, 3))
    shift[voussoirs, 1] = height
    return shift, np.zeros((7, 3))


@every_method
def test_an_arch_that_hops_and_lands_stands_unless_the_limit_is_below_its_hop(method):
    response = af.simulate(oppenheim(), hop(), method=method, follow=5.0)
    assert (response.status, response.collapsed) == (Status.STANDING, False)
    assert np.isnan(response.collapse_time)
    assert response.lost_contact_time == pytest.approx(0.1, abs=0.005)
    assert response.lost_contact_joint >= 0
    assert response.lost_contact_mode == "lift_off"
    assert response.widest_gap == pytest.approx(0.1150, rel=0.02)
    limited = af.simulate(oppenheim(), hop(), method=method, loss_limit=0.05)
    assert limited.collapsed
    assert limited.collapse_mode == "lift_off"
    assert limited.collapse_time == limited.lost_contact_time < limited.end_time


@every_method
def test_without_a_loss_nothing_is_noted(method):
    response = af.simulate(
        oppenheim(), sampled(lambda t: 0.45, 0.3, dt=1e-3), method=method
    )
    assert response.status == Status.STANDING
    assert np.isnan(response.lost_contact_time)
    assert (response.lost_contact_joint, response.lost_contact_mode) == (-1, "none")
    assert response.widest_gap < 0.02


@every_method
def test_a_block_that_slides_off_its_pedestal_collapses(method):
    block = af.Block(0.2, 0.2, friction=0.1)
    push = af.Motion(np.full(200, 0.3 * g), 0.01)
    response = af.simulate(block, push, method=method, history=True)
    assert response.collapsed
    assert response.collapse_mode == "sliding"
    # Half its width at 0.3 g less what friction gives; from then on it tips, and slides on.
    tips = np.sqrt(2.0 * 0.1 / (0.2 * g))
    assert tips < response.collapse_time < 1.6 * tips
    before = response.history.sel(time=slice(0.1, 0.95 * tips))
    slid = -0.5 * 0.2 * g * before.time.values**2
    np.testing.assert_allclose(before.displacement.values[:, 0, 0], slid, rtol=2e-2)
    assert np.abs(before.rotation.values).max() < 1e-6


@every_method
def test_an_arch_in_flight_falls_and_lands(method):
    given = {"initial": shifted(slice(None), 0.2), "history": True}
    response = af.simulate(oppenheim(), STILL, method=method, **given)
    assert response.status == Status.STANDING
    assert response.lost_contact_time == 0.0
    assert not response.history.contact_mode.values[0, [0, -1]].any()
    # Free fall until it lands, after 0.2 s.
    early = response.history.sel(time=slice(0.05, 0.15))
    place = early.displacement[:, 3, 1]
    speed = early.velocity[:, 3, 1]
    time = early.time.values
    np.testing.assert_allclose(place, 0.2 - 0.5 * g * time**2, atol=2e-3)
    np.testing.assert_allclose(speed, -g * time, atol=2e-2)


@pytest.mark.parametrize(
    ("given", "message"),
    [({"loss_limit": value}, "loss_limit is") for value in (0.0, 0.01, 11.0, np.nan)]
    + [({"initial": shifted(3, -0.02)}, r"overlap by 0\.0026 of its length")],
)
def test_limits_and_states_that_make_no_sense_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        af.simulate(oppenheim(), STILL, **given)


@every_method
def test_a_model_and_its_prototype_behave_alike_to_the_last_bit(method):
    """Lengths times four and times times two (Froude)."""
    push = 0.8 * g * np.sin(2.0 * np.pi * np.arange(0.0, 1.5, 0.005) / 0.4)
    small, large = (
        af.simulate(
            af.Arch.circular(
                2.5 * k**2, 0.375 * k**2, 157.5, voussoirs=7, friction=0.7
            ),
            af.Motion(push, 0.005 * k, vertical=0.3 * push[::-1]),
            method=method,
            follow=10.0 * k,
        )
        for k in (1, 2)
    )
    assert small.peak_displacement > 0.002
    assert large.peak_displacement == 4.0 * small.peak_displacement
    assert large.end_time == 2.0 * small.end_time
    for name in ("peak_rotation", "steps", "status", "energy_error"):
        assert getattr(large, name) == getattr(small, name)
