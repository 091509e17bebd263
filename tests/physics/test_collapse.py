"""Collapse is a loss of contact that is not regained; losses before that are noted."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.mechanics.status import Status

G = 9.80665
ARCH = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
STEPPED = ("time_stepping", "auto", "event_driven")


def hop():
    """The ground falls away at three times gravity and catches the arch 0.18 m lower."""
    time = np.arange(0.0, 2.0, 1e-3)
    fall = np.where(time < 0.1, 0.0, np.where(time < 0.2, -3.0, np.where(time < 0.4, 1.5, 0.0)))
    return af.Motion(0.0 * time, 1e-3, vertical=G * fall)


class TestHopping:
    @pytest.mark.parametrize("method", STEPPED)
    def test_an_arch_that_hops_and_lands_stands_unless_the_limit_is_below_its_hop(self, method):
        response = af.simulate(ARCH, hop(), method=method, follow=5.0)
        assert response.status == Status.STANDING
        assert not response.collapsed
        assert np.isnan(response.collapse_time)
        assert response.lost_contact_time == pytest.approx(0.1, abs=0.005)
        assert response.lost_contact_joint >= 0
        assert response.lost_contact_mode == "lift_off"
        assert response.widest_gap == pytest.approx(0.1150, rel=0.02)
        limited = af.simulate(ARCH, hop(), method=method, loss_limit=0.05)
        assert limited.collapsed
        assert limited.collapse_mode == "lift_off"
        assert limited.collapse_time == limited.lost_contact_time
        assert limited.end_time > limited.collapse_time

    @pytest.mark.parametrize("method", STEPPED)
    def test_without_a_loss_nothing_is_noted(self, method):
        time = np.arange(0.0, 1.0, 1e-3)
        push = af.Motion(np.where(time < 0.3, 0.45 * G, 0.0), 1e-3)
        response = af.simulate(ARCH, push, method=method)
        assert response.status == Status.STANDING
        assert np.isnan(response.lost_contact_time)
        assert (response.lost_contact_joint, response.lost_contact_mode) == (-1, "none")
        assert response.widest_gap < 0.02

    @pytest.mark.parametrize("limit", [0.0, 0.01, 11.0, np.nan])
    def test_a_limit_that_makes_no_sense_is_refused(self, limit):
        with pytest.raises(InputError, match="loss_limit is"):
            af.simulate(ARCH, hop(), loss_limit=limit)


class TestSlipPastTheEnd:
    @pytest.mark.parametrize("method", STEPPED)
    def test_a_block_that_slides_off_its_pedestal_collapses(self, method):
        block, push = af.Block(0.2, 0.2, friction=0.1), af.Motion(np.full(200, 0.3 * G), 0.01)
        response = af.simulate(block, push, method=method, history=True)
        assert response.collapsed
        assert response.collapse_mode == "sliding"
        # Half its width at 0.3 g less what friction gives; from then on it tips, and slides on.
        tips = np.sqrt(2.0 * 0.1 / (0.2 * G))
        assert tips < response.collapse_time < 1.6 * tips
        before = response.history.sel(time=slice(0.1, 0.95 * tips))
        slid = -0.5 * 0.2 * G * before.time.values**2
        np.testing.assert_allclose(before.displacement.values[:, 0, 0], slid, rtol=2e-2)
        assert np.abs(before.rotation.values).max() < 1e-6


class TestInitialStates:
    still = af.Motion(np.zeros(100), 0.01)

    def lifted(self, height):
        shift = np.zeros((7, 3))
        shift[:, 1] = height
        return shift, np.zeros((7, 3))

    @pytest.mark.parametrize("method", STEPPED)
    def test_an_arch_in_flight_falls_and_lands(self, method):
        response = af.simulate(
            ARCH, self.still, method=method, initial=self.lifted(0.2), history=True
        )
        assert response.status == Status.STANDING
        assert response.lost_contact_time == 0.0
        modes = response.history.contact_mode.values
        assert (modes[0, [0, -1]] == 0).all()
        # Free fall until it lands, after 0.2 s.
        early = response.history.sel(time=slice(0.05, 0.15))
        collapsed = 0.2 - 0.5 * G * early.time.values**2
        np.testing.assert_allclose(early.displacement.values[:, 3, 1], collapsed, atol=2e-3)
        np.testing.assert_allclose(
            early.velocity.values[:, 3, 1], -G * early.time.values, atol=2e-2
        )

    def test_bodies_that_overlap_are_refused(self):
        shift, velocity = self.lifted(0.0)
        shift[3, 1] = -0.02
        with pytest.raises(InputError, match=r"overlap by 0\.0026 of its length"):
            af.simulate(ARCH, self.still, initial=(shift, velocity))


class TestSimilarity:
    """Lengths times four and times times two: the same motion to the last bit (Froude)."""

    @pytest.mark.parametrize("method", ["auto", "time_stepping", "event_driven"])
    def test_a_model_and_its_prototype_behave_alike(self, method):
        time = np.arange(0.0, 1.5, 0.005)
        push = 0.8 * G * np.sin(2.0 * np.pi * time / 0.4)
        small, large = (
            af.simulate(
                af.Arch.circular(2.5 * k**2, 0.375 * k**2, 157.5, voussoirs=7, friction=0.7),
                af.Motion(push, 0.005 * k, vertical=0.3 * push[::-1]),
                method=method,
                follow=10.0 * k,
            )
            for k in (1, 2)
        )
        assert small.peak_displacement > 0.002
        assert large.peak_displacement == 4.0 * small.peak_displacement
        assert large.peak_rotation == small.peak_rotation
        assert large.end_time == 2.0 * small.end_time
        assert large.steps == small.steps
        assert large.status == small.status
        assert large.energy_error == small.energy_error
