"""`simulate` and `onset` as a user calls them: answers, histories, refusals."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import STATUS_SENTENCE, InputError
from archfrag.mechanics.status import Status

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 5, 0.7)
PUSH = af.Motion(np.where(np.arange(800) < 250, 6.0, 0.0), 1e-3)
STILL = (np.zeros((5, 3)), np.zeros((5, 3)))


class TestRefusals:
    @pytest.mark.parametrize(
        ("change", "sentence"),
        [
            ({"arch": "arch"}, "arch is str; it must be an archfrag Arch or Block"),
            ({"motion": np.zeros(5)}, "motion is ndarray; it must be an archfrag Motion"),
            ({"method": "newmark"}, "method is 'newmark'; allowed are auto, time_stepping"),
            ({"method": None}, "method is None; allowed are auto, time_stepping"),
            ({"dt": 0.0}, "dt is 0.0; it must be a number, finite and positive"),
            ({"dt": -1e-3}, "dt is -0.001; it must be a number, finite and positive"),
            ({"dt": float("nan")}, "dt is nan; it must be a number"),
            ({"scale": "two"}, "scale is 'two'; it must be a number, finite"),
            ({"scale": float("inf")}, "scale is inf; it must be a number, finite"),
            ({"scale": True}, "scale is True; it must be a number"),
            ({"rtol": 0.0}, "rtol is 0.0; it must be a number, between 0 and 1"),
            ({"follow": -1.0}, "follow is -1.0; it must be a number, finite and not negative"),
            ({"initial": 3}, "initial must be a pair of arrays"),
            ({"initial": (np.zeros((4, 3)),) * 2}, r"initial position has shape \(4, 3\)"),
            ({"initial": (STILL[0], np.full((5, 3), np.nan))}, "initial velocity .* finite"),
        ],
    )
    def test_one_sentence_names_the_argument(self, change, sentence):
        call = {"arch": ARCH, "motion": PUSH, **change}
        with pytest.raises(InputError, match=sentence) as caught:
            af.simulate(**call)
        assert "\n" not in str(caught.value)

    def test_onset_of_something_else(self):
        with pytest.raises(InputError, match="arch is int"):
            af.onset(3)


class TestResponse:
    def test_says_what_ran_and_leaves_its_arguments_alone(self):
        before = PUSH.acceleration.copy()
        initial = tuple(part.copy() for part in STILL)
        response = af.simulate(ARCH, PUSH, initial=initial)
        assert response.method == "time_stepping"
        assert (PUSH.acceleration == before).all()
        assert (initial[0] == 0.0).all()
        assert response.history is None
        assert set(response.events) == {
            "impacts", "openings", "slides", "contact_losses", "rests"
        }  # fmt: skip
        assert response.steps > 100

    def test_standing_has_no_collapse(self):
        response = af.simulate(ARCH, PUSH, scale=0.1)
        assert response.status is Status.STANDING
        assert response.collapsed is False
        assert np.isnan(response.collapse_time)
        assert (response.collapse_joint, response.collapse_mode) == (-1, "none")

    def test_collapse_has_time_joint_and_mode(self):
        response = af.simulate(ARCH, PUSH, scale=3.0)
        assert response.collapsed is True
        assert 0.0 < response.collapse_time <= response.end_time
        assert 0 <= response.collapse_joint <= 5
        assert response.collapse_mode in ("hinging", "sliding", "lift_off", "overturning")

    def test_step_of_the_method_is_its_default(self):
        alone = af.simulate(ARCH, PUSH)
        given = af.simulate(ARCH, PUSH, dt=5e-4)
        other = af.simulate(ARCH, PUSH, dt=1e-3)
        assert alone.steps == given.steps
        assert alone.peak_rotation == given.peak_rotation
        assert other.steps < 0.7 * alone.steps


class TestHistory:
    def test_has_names_units_and_the_peaks_of_the_response(self):
        response = af.simulate(ARCH, PUSH, history=True)
        history = response.history
        units = {name: history[name].attrs.get("units") for name in history.data_vars}
        assert units == {
            "displacement": "m", "rotation": "rad", "velocity": "m s-1",
            "angular_velocity": "rad s-1", "reaction": "N", "moment": "N m",
            "contact_mode": None,
        }  # fmt: skip
        assert all(history[name].attrs["long_name"] for name in history.data_vars)
        assert history.time.attrs["units"] == "s"
        assert list(history.component.values) == ["x", "y"]
        assert history.sizes["voussoir"] == 5
        assert history.sizes["joint"] == 6
        assert (np.diff(history.time) >= 0.0).all()
        largest = np.linalg.norm(history.displacement, axis=2).max()
        assert largest == pytest.approx(response.peak_displacement, rel=1e-3)
        assert np.abs(history.rotation).max() == pytest.approx(response.peak_rotation, rel=1e-3)

    def test_contact_modes_have_meanings(self):
        mode = af.simulate(ARCH, PUSH, history=True).history.contact_mode
        meanings = mode.attrs["flag_meanings"].split()
        assert len(meanings) == mode.attrs["flag_values"].size == 10
        assert set(np.unique(mode)) <= set(mode.attrs["flag_values"])
        assert meanings[0] == "open"
        assert meanings[7] == "closed_sticks"

    def test_springings_bear_the_weight_at_the_end(self):
        response = af.simulate(ARCH, PUSH, history=True)
        assert response.status is Status.STANDING
        weight = ARCH.chain.mass.sum() * 9.80665
        force = response.history.reaction.isel(time=-2).values
        assert force[0, 1] - force[-1, 1] == pytest.approx(weight, rel=0.2)


def test_every_status_has_a_sentence():
    assert set(STATUS_SENTENCE) == set(Status)
    assert all(sentence.strip() for sentence in STATUS_SENTENCE.values())
