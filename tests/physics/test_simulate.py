"""`simulate` and `onset` as a user calls them: answers, histories, refusals."""

import functools
import sys

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.physics.methods.registry import OWN_STEP
from archfrag.physics.status import Cause, Status
from archfrag.simulation.response import summary
from archfrag.simulation.rest import own_time
from tests.piers import on_piers

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 5, 0.7)
PUSH = af.Motion(np.where(np.arange(800) < 250, 6.0, 0.0), 1e-3)
LATE = af.Motion(
    np.where(np.arange(2000) < 1000, 0.0, 6.0) * (np.arange(2000) < 1250), 1e-3
)
STILL = (np.zeros((5, 3)), np.zeros((5, 3)))


class TestResponse:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"arch": "arch"}, "arch is str; it must be an archfrag Arch or Block"),
            (
                {"motion": np.zeros(5)},
                "motion is ndarray; it must be an archfrag Motion",
            ),
            (
                {"method": "newmark"},
                "method is 'newmark'; allowed are auto, time_stepping",
            ),
            ({"dt": 0.0}, "dt is 0.0; it must be a finite number from 1e-09 to 10"),
            ({"scale": "two"}, "scale is 'two'; it must be a finite number$"),
            ({"initial": 3}, "initial must be a pair of arrays"),
            (
                {"initial": (np.zeros((4, 3)),) * 2},
                r"initial position has shape \(4, 3\)",
            ),
            (
                {"initial": (STILL[0], np.full((5, 3), np.nan))},
                "initial velocity .* finite",
            ),
        ],
    )
    def test_one_message_names_the_argument(self, change, message):
        call = {"arch": ARCH, "motion": PUSH, **change}
        with pytest.raises(InputError, match=message):
            af.simulate(**call)

    def test_standing_has_no_collapse_and_collapse_has_time_joint_and_mode(self):
        response = af.simulate(ARCH, PUSH, scale=0.1, history=True)
        assert response.status is Status.STANDING
        assert response.collapsed is False
        assert np.isnan(response.collapse_time)
        assert (response.collapse_joint, response.collapse_mode) == (-1, "none")
        (only,) = response.mechanism
        assert (only.model, only.until) == ("rest", response.end_time)
        response = af.simulate(ARCH, PUSH, scale=3.0)
        assert (response.collapsed, response.method) == (True, "auto")
        assert 0.0 < response.collapse_time <= response.end_time
        assert 0 <= response.collapse_joint <= 5
        assert response.collapse_mode in (
            "hinging",
            "sliding",
            "lift_off",
            "overturning",
        )

    def test_steps_follow_the_tolerance_unless_one_is_given(self):
        alone = af.simulate(ARCH, PUSH, method="time_stepping")
        tight = af.simulate(ARCH, PUSH, method="time_stepping", rtol=1e-4)
        fixed = af.simulate(
            ARCH, PUSH, method="time_stepping", dt=OWN_STEP * own_time(ARCH)
        )
        moving = fixed.model_time["all_voussoirs"]
        assert fixed.steps == pytest.approx(
            moving / (1.28e-3 * np.sqrt(1.5 / 9.80665)), rel=0.02
        )
        assert 2.0 * alone.steps < fixed.steps
        assert 1.5 * alone.steps < tight.steps
        assert alone.peak_rotation == pytest.approx(fixed.peak_rotation, rel=0.02)
        with pytest.raises(InputError, match="takes one of them"):
            af.simulate(ARCH, PUSH, method="time_stepping", rtol=1e-4, dt=1e-3)


class TestHistory:
    def test_has_names_units_and_the_peaks_of_the_response(self):
        response = af.simulate(ARCH, PUSH, history=True)
        history = response.history
        units = {name: history[name].attrs.get("units") for name in history.data_vars}
        assert units == {
            "displacement": "m",
            "rotation": "rad",
            "velocity": "m s-1",
            "angular_velocity": "rad s-1",
            "reaction": "N",
            "moment": "N m",
            "contact_mode": None,
        }
        assert (history.sizes["voussoir"], history.sizes["joint"]) == (5, 6)
        assert np.abs(history.rotation).max() == pytest.approx(
            response.peak_rotation, rel=1e-3
        )

    @pytest.mark.parametrize("method", ["auto", "event_driven"])
    def test_what_is_left_is_where_the_history_ends(self, method):
        arch = af.Arch.circular(10.0, 1.5, 157.5, 7, friction=0.35)
        time = np.arange(0.0, 3.0, 0.01)
        shaken = 6.0 * np.sin(3.0 * np.pi * time) * np.sin(np.pi * time / 3.0)
        response = af.simulate(
            arch, af.Motion(shaken, 0.01), method=method, history=True
        )
        last = response.history.isel(time=-1)
        moved = np.hypot(*last["displacement"].values.T).max()
        assert 0.1 < response.residual_displacement == pytest.approx(moved, rel=1e-9)
        rotated = np.abs(last["rotation"].values).max()
        assert response.residual_rotation == pytest.approx(rotated, rel=1e-9)
        assert response.residual_rotation < response.peak_rotation


class TestMechanism:
    def test_entries_follow_each_other_to_the_end_of_the_run(self):
        response = af.simulate(ARCH, LATE, history=True)
        log = response.mechanism
        assert len(log) > 5
        assert (log[0].time, log[0].model, log[0].joints) == (0.0, "rest", {})
        assert [change.until for change in log[:-1]] == [
            change.time for change in log[1:]
        ]
        assert log[-1].until == response.end_time
        logged = dict.fromkeys(response.model_time, 0.0)
        for change in log:
            logged[change.model] += change.until - change.time
        assert logged == pytest.approx(response.model_time, abs=1e-9)
        assert {change.cause for change in log} <= {
            cause.name.lower() for cause in Cause
        }
        assert summary(log).startswith(f"{len(log) - 2} changes of the mechanism (")

    def test_motion_starts_with_the_hinges_of_the_onset(self):
        start = af.onset(ARCH)
        for sign, hinges in ((1.0, start.hinges), (-1.0, start.hinges_minus)):
            steady = np.full(400, sign * 1.01 * start.plus * 9.80665)
            log = af.simulate(ARCH, af.Motion(steady, 1e-3), history=True).mechanism
            first = next(change for change in log if change.joints)
            assert first.joints == {joint: f"hinge {side}" for joint, side in hinges}

    def test_it_states_the_contact_modes_of_the_history(self):
        """Wherever the arch moves, the log and each frame agree on every joint."""
        response = af.simulate(ARCH, PUSH, scale=1.2, history=True)
        meanings = response.history.contact_mode.attrs["flag_meanings"].split()
        log = response.mechanism
        place = (
            np.searchsorted([c.time for c in log], response.history.time, side="right")
            - 1
        )
        compared = 0
        for i, mode in zip(place, response.history.contact_mode.values):
            if log[i].model == "rest":
                continue
            for joint, code in enumerate(mode):
                side, _, verb = meanings[code].partition("_")
                reported = log[i].joints.get(joint, "closed")
                assert (reported == "open") == (side == "open")
                assert reported.startswith(f"hinge {side}") == (
                    side in ("intrados", "extrados")
                )
                assert ("slid" in reported) == ("slides" in verb)
                compared += 1
        assert compared > 1000

    def test_a_joint_slides_towards_where_its_later_voussoir_goes(self):
        block = af.Block(1.0, 1.0, friction=0.1)
        response = af.simulate(block, af.Motion(np.full(300, 3.0), 1e-3), history=True)
        # The ground accelerates to the right: the block stays behind, towards its extrados.
        assert response.history.displacement[50, 0, 0] < -0.001
        sliding = next(change for change in response.mechanism if change.joints)
        assert sliding.joints == {0: "slides towards extrados"}

    def test_a_log_has_a_bound_and_a_history_changes_nothing(self, monkeypatch):
        stepped = functools.partial(af.simulate, ARCH, PUSH, method="time_stepping")
        without = stepped()
        kept = stepped(history=True)
        assert (without.work, without.energy) == (kept.work, kept.energy)
        monkeypatch.setattr(
            sys.modules["archfrag.simulation.simulate"], "LARGEST_LOG", 6
        )
        bounded = stepped(history=True).mechanism
        assert bounded[:5] == kept.mechanism[:5]
        assert len(bounded) == 6
        assert np.isnan(bounded[5].until)


RING = af.Arch.segmental(8.0, 3.0, 0.7, 9, friction=0.6)
AT_REST = {
    "ring": RING,
    "depths": af.Arch.segmental(
        8.0, 3.0, 0.7, 9, friction=0.6, depth=[1.0] * 3 + [0.7] * 6
    ),
    "piers": on_piers(RING, 2.5, 1.5, courses=2),
    "fill": RING.filled(0.5, 18e3),
    "tied": RING.tied(level=1.5, area=5e-4, prestress=2e4),
    "recessed": RING.recessed(0.05, 0.02),
    "moved": af.move_springing(RING, spread=0.02, settlement=-0.01),
    "stiff": af.Arch.circular(4.0, 0.88, 130.0, 5, 0.5),
    "model": af.Arch.circular(0.2, 0.03, 157.5, 7, 0.7),
    "block": af.Block(width=0.5, height=5.0, friction=0.8),
}


class TestNeverRests:
    """An arch in equilibrium stands by contact dynamics alone, whatever its keys."""

    @pytest.mark.parametrize("method", ["auto", "time_stepping", "event_driven"])
    @pytest.mark.parametrize("arch", AT_REST.values(), ids=AT_REST)
    def test_it_stands_where_nothing_moves_it(self, arch, method):
        still = af.Motion(np.zeros(300), 0.01)
        run = af.simulate(arch, still, method=method, rests=False, follow=5.0)
        assert run.status is Status.STANDING
        assert run.energy_error < 1e-9
        assert run.events["impacts"] == 0
        assert run.peak_displacement < 1e-9

    @pytest.mark.parametrize("method", ["auto", "time_stepping", "event_driven"])
    def test_it_moves_as_one_that_rests_where_it_has_to(self, method):
        runs = [
            af.simulate(ARCH, PUSH, method=method, rests=rests)
            for rests in (True, False)
        ]
        assert [run.status for run in runs] == [Status.STANDING] * 2
        both = [run.peak_rotation for run in runs]
        assert both[1] == pytest.approx(both[0], rel=0.02)

    @pytest.mark.parametrize(
        ("voussoirs", "thickness"), [(4, 1.0), (5, 0.88), (7, 0.88)]
    )
    def test_limit_load_of_a_stiff_arch(self, voussoirs, thickness):
        arch = af.Arch.circular(4.0, thickness, 130.0, voussoirs, 0.5)
        load = af.limit_load(arch)
        assert load == pytest.approx(af.onset(arch).plus, rel=2e-3)
        assert load == pytest.approx(
            af.limit_load(arch, method="event_driven"), rel=1e-3
        )
