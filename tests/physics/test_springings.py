"""Springings that have moved or move: independent limit analysis, energy, and methods."""

import math
import re

import numpy as np
import pytest
from click.testing import CliRunner

import archfrag as af
from archfrag.cli import main
from archfrag.simulation.arguments import base_positions
from archfrag.simulation.simulate import results_of_runs
from archfrag.simulation.springings import ground_of
from tests.nearby import nearby

ARCH = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
TIME = np.arange(0.0, 6.0, 0.005)
PULSE = af.Motion(
    6.0 * np.sin(2.0 * np.pi * TIME) * np.exp(-((TIME - 2.0) ** 2)), 0.005
)
RING = af.Arch.segmental(6.0, 2.0, 0.6, voussoirs=9, friction=0.6)
BRIDGE = af.Bridge([RING, RING], piers=[{"height": 3.0, "width": 1.6, "courses": 3}])


def least_spread(arch):
    """Spread at which a symmetric arch with a joint at its crown falls, by limit analysis.

    Each half hinges at the crown's extrados and at the intrados of one joint; below that joint
    the voussoirs keep to their springing. The arch stands while the thrust, which goes through
    both hinges, stays inside all joints of the half that has moved.
    """
    crown = arch.n_voussoir // 2
    weight = arch.chain.mass[:crown] * 9.80665
    centroid = arch.chain.centroid[:crown]
    inner = arch.intrados[: crown + 1]
    outer = arch.extrados[: crown + 1]

    def holds(joint, spread):
        hinge = inner[joint] - [0.5 * spread, 0.0]
        arm = outer[crown] - inner[joint]
        reach = -hinge[0] / np.hypot(*arm)  # the crown's hinge stays on the axis
        if not 0.0 < reach < 1.0:
            return False
        turn = math.acos(reach) - math.atan2(arm[1], arm[0])
        rotation = np.array(
            [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
        )

        def placed(points, body):
            away = points - inner[joint]
            return hinge + (away @ rotation.T if body >= joint else away)

        places = np.array([placed(centroid[i], i) for i in range(crown)])
        top = placed(outer[crown], crown)
        moving = slice(joint, crown)
        moment = (weight[moving] * (places[moving, 0] - hinge[0])).sum()
        thrust = moment / (top[1] - hinge[1])
        for j in range(crown + 1):
            # What lies between this joint and the crown, where thrust is all that acts.
            about = []
            for end in (inner[j], outer[j]):
                x, y = placed(end, j if j >= joint else -1)
                turning = (weight[j:] * (places[j:, 0] - x)).sum()
                about.append(thrust * (top[1] - y) - turning)
            # The resultant passes between the two corners.
            if about[0] < -1e-9 * moment or about[1] > 1e-9 * moment:
                return False
        return True

    # A joint that is open by a finite angle cannot close again slowly: its hinge stays.
    step = -2.0 * inner[0, 0] / 800.0
    spread = 0.0
    hinge_at = next(joint for joint in range(crown) if holds(joint, 0.0))
    while step > 1e-8:
        if holds(hinge_at, spread + step):
            spread += step
        else:
            step *= 0.5
    return spread


class TestLeastSpread:
    @pytest.mark.parametrize("number", range(20))
    def test_is_that_of_limit_analysis(self, number):
        rng = np.random.default_rng(number)
        arch = af.Arch.circular(
            10.0,
            rng.uniform(1.3, 2.2),
            rng.uniform(120.0, 175.0),
            voussoirs=2 * int(rng.integers(3, 8)),
            friction=math.inf,
        )
        expected = least_spread(arch)
        path = af.springing_path(arch, spread=1.05 * expected)
        assert 1.05 * path.limit == pytest.approx(1.0, rel=1e-3)

    def test_arch_at_a_fraction_of_it_stands_and_beyond_is_refused(self):
        arch = af.Arch.circular(10.0, 1.6, 150.0, voussoirs=8, friction=math.inf)
        limit = least_spread(arch)
        assert af.onset(af.move_springing(arch, spread=0.9 * limit)).stands
        with pytest.raises(
            af.errors.StabilityError, match=r"falls at spread 2\.86\d* m"
        ):
            af.move_springing(arch, spread=1.1 * limit)

    @pytest.mark.parametrize(
        ("prestress", "spread"), [(8e3, 0.02), (0.0, 0.05), (0.0, 0.02)]
    )
    def test_a_tied_arch_that_nothing_holds_is_refused(self, prestress, spread):
        """The tie pulls it until hinges make a mechanism; less of the movement it withstands."""
        ring = af.Arch.segmental(8.0, 3.0, 0.9, voussoirs=6, friction=0.7)
        tied = ring.tied(level=1.6, area=3e-4, prestress=prestress)
        path = af.springing_path(tied, spread=spread)
        assert path.arch is None
        assert 0.015 < spread * path.limit < 0.0195
        assert af.onset(
            af.move_springing(tied, spread=0.9 * spread * path.limit)
        ).stands
        with pytest.raises(
            af.errors.StabilityError, match=r"falls at spread .* with its ties"
        ):
            af.move_springing(tied, spread=spread)


class TestRefusals:
    def test_an_arch_that_does_not_stand_has_no_path(self):
        thin = af.Arch.circular(10.0, 0.5, 175.0, voussoirs=20, friction=math.inf)
        with pytest.raises(af.errors.StabilityError, match="weight"):
            af.springing_path(thin, spread=0.1)

    def test_a_movement_larger_than_the_arch_is_a_wrong_unit(self):
        with pytest.raises(af.errors.InputError, match=r"spread is 50000\.0"):
            af.move_springing(ARCH, spread=5e4)

    def test_what_changes_the_arch_as_built_comes_before(self):
        moved = af.move_springing(ARCH, spread=0.1)
        with pytest.raises(af.errors.GeometryError, match="recessed comes before"):
            moved.recessed(0.1)
        for arch, name in (
            (moved, "springings"),
            (ARCH.tied(level=6.0, area=1e-3), "ties"),
        ):
            with pytest.raises(af.errors.GeometryError, match=f"has {name} already"):
                arch.filled(height_over_crown=0.5, unit_weight=18e3)


def test_the_other_springing_is_the_mirror_image():
    right, left = (
        af.springing_path(ARCH, settlement=0.2, springing=s) for s in ("right", "left")
    )
    assert right.plus[-1] == pytest.approx(left.minus[-1], rel=1e-9)
    assert right.plus[-1] != pytest.approx(left.plus[-1], rel=1e-3)


# Impacts are chaotic: after an inward movement equal tolerances differ more.
@pytest.mark.parametrize(
    ("moved", "error"),
    [
        ({"spread": 0.1}, 0.02),
        ({"spread": -0.05}, 0.05),
        ({"settlement": 0.15}, 0.02),
        ({"rotation": 2.0}, 0.02),
    ],
)
def test_methods_agree_on_an_arch_that_has_moved(moved, error):
    arch = af.move_springing(ARCH, **moved)
    events = af.simulate(arch, PULSE, 0.5, method="event_driven", rtol=1e-7)
    steps = af.simulate(arch, PULSE, 0.5, method="time_stepping", rtol=1e-5)
    both = af.simulate(arch, PULSE, 0.5)
    assert events.status == steps.status == both.status
    assert not events.collapsed
    assert events.energy_error < 1e-6
    assert steps.peak_rotation == pytest.approx(events.peak_rotation, rel=error)
    assert both.peak_rotation == pytest.approx(events.peak_rotation, rel=0.1)


def apart(delay):
    """Wave speed at which the right base of ARCH is later by `delay` [s]."""
    places = base_positions(ARCH)
    return (places["right"] - places["left"]) / delay


class TestBases:
    def test_they_are_where_the_ground_is(self):
        chain = ARCH.chain
        ends = chain.face_before[0, :, 0], chain.face_after[-1, :, 0]
        left, right = (end.mean() for end in ends)
        assert base_positions(ARCH) == {"left": left, "right": right}
        block = af.Block(width=0.2, height=1.0, friction=0.8)
        assert base_positions(block) == {"left": pytest.approx(0.0)}

    def test_a_wave_from_the_right_reaches_the_left_base_last(self):
        places = base_positions(BRIDGE)
        assert list(places) == ["left", "pier 1", "right"]
        ground = ground_of(PULSE, BRIDGE, wave_speed=-430.0)
        lead = len(ground.motion.acceleration) - len(PULSE.acceleration)
        ahead = [(x - places["left"]) / 430.0 for x in places.values()]
        assert lead == math.ceil(ahead[-1] / 0.005)
        time = 0.005 * np.arange(len(ground.horizontal))
        for k in (1, 2):
            since = time - (0.005 * lead - ahead[k])
            own = np.interp(since, PULSE.time, PULSE.acceleration, 0.0, 0.0)
            found = ground.horizontal + ground.apart[:, k - 1, 0]
            assert found == pytest.approx(own, abs=1e-12)
            assert not ground.apart[:, k - 1, 1].any()

    @pytest.mark.parametrize("moved", [{"spread": 0.01}, {"rotation": 0.3}])
    def test_the_mirror_of_a_pier_that_moves(self, moved):
        """Of a symmetric bridge: one way bears towards +x what the other bears towards -x."""
        back = {name: -value for name, value in moved.items()}
        path, mirror = (
            af.springing_path(BRIDGE, **each, springing="pier 1")
            for each in (moved, back)
        )
        assert path.plus == pytest.approx(mirror.minus, rel=1e-9)
        assert path.minus == pytest.approx(mirror.plus, rel=1e-9)
        assert path.plus[-1] < path.plus[0]
        with pytest.raises(af.errors.InputError, match="must be left or pier 1 or"):
            af.springing_path(BRIDGE, **moved, springing="pier 2")

    def test_energy_closes_where_every_base_moves(self):
        own = {
            "pier 1": 0.05,
            "right": af.Motion(0.5 * PULSE.acceleration[::-1], 0.005),
        }
        factors = [0.5, 0.8, 1.1, 1.4, 1.7]
        runs = [af.simulate(BRIDGE, PULSE, factor, bases=own) for factor in factors]
        for run in runs:
            energy = run.energy
            given = sum(
                energy[name]
                for name in ("ground", "friction", "impacts", "balance_error")
            )
            left = energy["kinetic"] + energy["potential"] - given
            assert abs(left) < 1e-10 * abs(energy["ground"])
            assert run.energy_error < 1e-3
        together = af.simulate_many(BRIDGE, PULSE, factors, bases=own)
        assert together.peak_rotation.values.tolist() == [
            run.peak_rotation for run in runs
        ]

    def test_a_wave_on_a_bridge_has_its_mirror(self):
        """Relative to the left base, which moves first and last."""
        with pytest.raises(af.errors.InputError, match="event_driven, which takes one"):
            af.simulate(BRIDGE, PULSE, method="event_driven")
        speed = np.ptp(list(base_positions(BRIDGE).values())) / 0.1
        first, last = (
            np.median(
                [
                    af.simulate(
                        BRIDGE, motion, sense, wave_speed=sense * speed
                    ).peak_rotation
                    for motion in nearby(0.8 * PULSE)
                ]
            )
            for sense in (-1.0, 1.0)
        )
        assert first == pytest.approx(last, rel=0.05)


class TestMotionsOfBases:
    def test_a_delay_is_a_motion_of_its_own(self):
        size = len(TIME) + 4
        late = 0.005 * np.arange(size) - 0.0173
        wave = np.interp(late, PULSE.time, PULSE.acceleration, 0.0, 0.0)
        given = (
            {"bases": {"right": 0.0173}},
            {"bases": {"right": af.Motion(wave, 0.005)}},
            {"wave_speed": apart(0.0173)},
        )
        peaks = [af.simulate(ARCH, PULSE, 0.5, **each).peak_rotation for each in given]
        assert peaks[0] == peaks[1] != af.simulate(ARCH, PULSE, 0.5).peak_rotation
        assert peaks[2] == pytest.approx(peaks[0], rel=1e-6)

    def test_a_wave_from_the_right_is_the_mirror_of_one_from_the_left(self):
        rightwards = af.simulate(ARCH, -1.0 * PULSE, 0.5, wave_speed=apart(0.02))
        leftwards = af.simulate(ARCH, PULSE, 0.5, wave_speed=-apart(0.02))
        assert leftwards.peak_rotation == pytest.approx(
            rightwards.peak_rotation, rel=0.02
        )
        lead = len(leftwards.motion.acceleration) - len(TIME)
        assert lead in (4, 5)
        assert not leftwards.motion.acceleration[:lead].any()

    def test_records_start_later_if_another_base_moves_before(self):
        both = PULSE.then(PULSE, gap=1.0)
        for delay, later in ((0.1, 0.0), (-0.1, 0.1)):
            given = {"bases": {"right": delay}}
            starts = results_of_runs(ARCH, [both, PULSE], [0.1, 0.1], **given)[2]
            expected = [both.record_start + later, 0.0]
            assert starts.tolist() == pytest.approx(expected)

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"wave_speed": 0.0}, "size of wave_speed is 0.0; it must be"),
            ({"wave_speed": "fast"}, "wave_speed is 'fast'; it must be"),
            ({"wave_speed": 1e3, "bases": {"right": 0.1}}, "are both given"),
            ({"bases": {"pier 1": 0.1}}, "'pier 1'; allowed for this arch are right"),
            ({"bases": {"left": 0.1}}, "'left'; allowed for this arch are right"),
            ({"bases": {"right": 61.0}}, "bases.right is 61.0; it must be"),
            ({"bases": {"right": "late"}}, "bases.right is 'late'; it must be"),
            ({"bases": 0.1}, "bases is 0.1; it must be a mapping"),
            (
                {"bases": {"right": af.Motion(TIME, 0.01)}},
                "the motion of right has a time step of 0.01 s and the motion of the left",
            ),
        ],
    )
    def test_what_cannot_move_is_refused(self, given, message):
        with pytest.raises(af.errors.InputError, match=message):
            af.simulate(ARCH, PULSE, **given)

    def test_equal_motions_change_no_bit(self):
        plain = af.simulate(ARCH, PULSE)
        for own in (PULSE, 0.0):
            same = af.simulate(ARCH, PULSE, bases={"right": own})
            assert same.peak_rotation == plain.peak_rotation
            assert same.residual_displacement == plain.residual_displacement

    # Each time that events leave a stretch to steps adds to the energy error.
    @pytest.mark.parametrize(
        ("delay", "error"), [(0.02, 1e-4), (0.1, 1e-4), (0.4, 5e-4)]
    )
    def test_energy_closes_and_methods_agree(self, delay, error):
        motions = nearby(0.8 * PULSE)
        by_steps, by_events = (
            [
                af.simulate(
                    ARCH, motion, bases={"right": delay}, method=method, rtol=rtol
                )
                for motion in motions
            ]
            for method, rtol in (("time_stepping", 1e-4), ("event_driven", 1e-8))
        )
        energy = by_steps[0].energy
        given = (
            energy["ground"]
            + energy["friction"]
            + energy["impacts"]
            + energy["balance_error"]
        )
        left = energy["kinetic"] + energy["potential"] - given
        assert abs(left) < 1e-10 * abs(energy["ground"])
        assert max(run.energy_error for run in by_events) < error
        steps, events = (
            [run.peak_rotation for run in each] for each in (by_steps, by_events)
        )
        chaos = max(np.ptp(steps), np.ptp(events))
        assert chaos < 0.2 * np.median(events)
        apart = abs(np.median(steps) - np.median(events))
        assert apart < max(0.05 * np.median(events), chaos)

    def test_a_block_between_feels_only_its_own_ground(self):
        block = af.Block(width=0.2, height=1.0, friction=0.8)
        for given in ({"bases": {"right": 0.1}}, {"wave_speed": 100.0}):
            with pytest.raises(af.errors.InputError, match="no right base"):
                af.simulate(block, PULSE, **given)

    def test_runs_side_by_side_have_the_bits_of_one(self):
        factors = [0.3, 0.6, 0.9, 1.2, 1.5]
        together = af.simulate_many(
            ARCH, PULSE, factors, bases={"right": 0.1}
        ).peak_rotation.values.tolist()
        alone = [
            af.simulate(ARCH, PULSE, f, bases={"right": 0.1}).peak_rotation
            for f in factors
        ]
        assert together == alone

    @pytest.mark.parametrize("method", ["auto", "time_stepping", "event_driven"])
    def test_an_arch_rests_while_the_springings_do_not_move(self, method):
        late = np.append(
            np.zeros(1000), 0.02 * np.sin(np.linspace(0.0, 2.0 * np.pi, 100))
        )
        own = {"right": af.Motion(late, 0.01)}
        stiff = af.Arch.circular(4.0, 0.88, 130.0, 5, 0.5)
        run = af.simulate(
            stiff, af.Motion(np.zeros(1100), 0.01), method=method, bases=own
        )
        assert run.status.name == "STANDING"
        assert run.model_time["rest"] > 9.9

    def test_a_run_at_rest_keeps_nothing_of_the_one_before(self):
        """Whose right base was moving when it collapsed."""

        def reactions():
            run = af.simulate(ARCH, 0.3 * PULSE, method="time_stepping", history=True)
            return run.history.reaction.values[0]

        before = reactions()
        given = {"method": "time_stepping", "bases": {"right": 0.1}}
        assert af.simulate(ARCH, PULSE, 8.0, **given).end_time < TIME[-1]
        assert np.array_equal(reactions(), before)

    @pytest.mark.parametrize("scale", [0.75, 1.0, 2.0])
    def test_events_end_where_the_arch_stands_still(self, scale):
        draw = np.random.default_rng(442766272)
        time = np.arange(2000) * 1e-3
        given = zip(draw.uniform(0.7, 6.0, 12), draw.uniform(0.0, 6.28, 12))
        wave = sum(np.sin(2.0 * np.pi * f * time + p) for f, p in given) * np.hanning(
            2000
        )
        motion = af.Motion(wave * 4.0 / np.abs(wave).max(), 1e-3)
        arch = af.Arch.elliptic(8.756, 3.36, 1.12, 13, friction=0.43664)
        given = {"method": "event_driven", "bases": {"right": 0.0172}}
        run = af.simulate(arch, motion, scale, **given)
        assert run.status.name == "STANDING"
        assert run.end_time < 4.0


def test_command_shows_the_onset_against_the_spread():
    given = (
        "onset --radius 10 --thickness 1.5 --embrace 157.5 --voussoirs 7 --friction 0.7"
    )
    done = CliRunner().invoke(main, [*given.split(), "--spread", "4"])
    assert done.exit_code == 0, done.output
    assert "falls at a spread of 2.26" in done.output
    rows = [
        line.split()
        for line in done.output.splitlines()
        if re.fullmatch(r"[\d. -]+", line)
    ]
    assert [float(value) for value in rows[0]] == pytest.approx(
        [0.0, 0.37, 0.37], abs=1e-4
    )
    assert len(rows) >= 10
