"""Ties: an independent equation of motion, rigid and powerless limits, energy, and methods."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from tests.piers import on_piers

GRAVITY = 9.80665
TIME = np.arange(0.0, 6.0, 0.005)
PULSE = af.Motion(
    9.0 * np.sin(2.0 * np.pi * TIME) * np.exp(-((TIME - 2.0) ** 2)), 0.005
)
ARCH = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
NO_FOLLOW = {"follow": 0.0}


def thrown(arch, rate):
    """A block that rotates about its right edge at first."""
    shift, velocity = np.zeros((2, arch.n_voussoir, 3))
    arm = arch.centroids - [0.2, 0.0]
    velocity[:, 0] = -rate * arm[:, 1]
    velocity[:, 1] = rate * arm[:, 0]
    velocity[:, 2] = rate
    return shift, velocity


class TestBlock:
    """A block rocks about its right edge, held by a tie to the ground on its left."""

    BLOCK = af.Block(width=0.4, height=2.0, friction=math.inf, density=2000.0)
    FOOT = np.array([-1.3, 0.0])
    TOP = np.array([-0.2, 2.0])
    AREA = 2e-6
    MODULUS = 2e11

    def peak(self, strength):
        """Largest rotation by the block's own equation of motion."""
        mass = 1600.0
        pivot = np.array([0.2, 0.0])
        centre = np.array([0.0, 1.0])
        inertia = mass * (0.4**2 + 2.0**2) / 12.0 + mass * (0.2**2 + 1.0)
        length = np.hypot(*(self.TOP - self.FOOT))
        stiffness = self.AREA * self.MODULUS / length

        def rates(_, state):
            angle, rate, plastic = state
            turn = np.array(
                [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            )
            weight = turn @ (centre - pivot)
            end = turn @ (self.TOP - pivot)
            line = self.FOOT - pivot - end
            stretch = np.hypot(*line) - length - plastic
            force = min(max(stiffness * stretch, 0.0), strength)
            along = force * line / np.hypot(*line)
            moment = -mass * GRAVITY * weight[0] + end[0] * along[1] - end[1] * along[0]
            speed = rate * (end[0] * line[1] - end[1] * line[0]) / np.hypot(*line)
            grows = max(-speed, 0.0) if stiffness * stretch >= strength else 0.0
            return rate, moment / inertia, grows

        def stops(_, state):
            return state[1]

        stops.terminal = True
        given = {"rtol": 1e-10, "atol": 1e-12, "max_step": 1e-3}
        found = solve_ivp(rates, (0.0, 3.0), (0.0, -0.35, 0.0), events=stops, **given)
        return abs(found.y[0, -1])

    @pytest.mark.parametrize("strength", [math.inf, 3000.0])
    @pytest.mark.parametrize(
        ("method", "options", "error"),
        [("event_driven", {"rtol": 1e-9}, 1e-6), ("time_stepping", {"dt": 2e-4}, 1e-4)],
    )
    def test_peak_is_that_of_its_own_equation_of_motion(
        self, strength, method, options, error
    ):
        ends = [(-1, *self.FOOT), (0, *self.TOP)]
        tied = self.BLOCK.tied(
            ends=ends, area=self.AREA, modulus=self.MODULUS, strength=strength
        )
        still = af.Motion(np.zeros(8000), 1e-4)
        options = {"method": method, "history": True, "follow": 0.0, **options}
        start = thrown(tied, -0.35)
        expected = self.peak(strength)
        peaks = [
            -af.simulate(
                arch, still, initial=start, **options
            ).history.rotation.values.min()
            for arch in (tied, self.BLOCK)
        ]
        assert peaks[0] == pytest.approx(expected, rel=error)
        assert peaks[1] > 1.1 * expected


class TestLimits:
    def test_a_tie_without_strength_changes_no_bit(self):
        powerless = ARCH.tied(level=6.0, area=1e-3, strength=1e-300)
        for method in ("time_stepping", "auto"):
            one, other = (
                af.simulate(arch, PULSE, method=method) for arch in (ARCH, powerless)
            )
            assert one.peak_rotation == other.peak_rotation
            assert one.residual_displacement == other.residual_displacement

    def test_two_blocks_tied_without_give_are_one(self):
        halves = [
            [(-0.2, 0), (0.2, 0), (0.2, 1), (-0.2, 1)],
            [(-0.2, 1), (0.2, 1), (0.2, 2), (-0.2, 2)],
        ]
        ground = [[(-0.2, 0), (0.2, 0)]]
        column = af.Arch.from_polygons(halves, friction=5.0, ground=ground)
        for x in (-0.2, 0.2):
            ends = [(0, x, 0.0), (1, x, 2.0)]
            column = column.tied(ends=ends, area=1.0, modulus=1e15, prestress=1e7)
        block = af.Block(width=0.4, height=2.0, friction=5.0)
        still = af.Motion(np.zeros(100), 0.01)
        for method, options in (
            ("time_stepping", {"dt": 1e-3}),
            ("event_driven", {"rtol": 1e-8}),
        ):
            peaks = [
                af.simulate(
                    arch, still, initial=thrown(arch, -0.3), method=method, **options
                )
                for arch in (column, block)
            ]
            assert peaks[0].peak_rotation == pytest.approx(
                peaks[1].peak_rotation, rel=1e-5
            )

    def test_prestress_holds_and_a_slack_tie_does_not_change_the_onset(self):
        start = af.onset(ARCH).plus
        assert af.onset(ARCH.tied(level=6.0, area=1e-3)).plus == pytest.approx(
            start, rel=1e-9
        )
        assert (
            af.onset(ARCH.tied(level=6.0, area=1e-3, prestress=3e4)).plus > start + 0.02
        )

    def test_its_ends_are_where_the_level_meets_the_outer_faces(self):
        moved = af.move_springing(ARCH, spread=0.2, settlement=0.1)
        for arch in (ARCH, moved):
            ((left, right),) = arch.tied(level=6.0, area=1e-3).tie_lines
            assert left[1] == right[1] == pytest.approx(6.0, abs=1e-12)
            assert left[0] < arch.extrados[2, 0]
            assert right[0] - left[0] > 17.0
            free = arch.tied(level=6.0, area=1e-3).chain.tie[0, 7]
            assert free == pytest.approx(right[0] - left[0], abs=1e-12)

    def test_its_thrust_line_goes_through_contact_centres_alone(self):
        onset = af.onset(ARCH.tied(level=6.0, area=1e-3, prestress=3e4))
        assert onset.thrust_line("+x").tolist() == onset.thrust_plus.tolist()


class TestSway:
    """A block that leans over its edge hangs on an elastic tie, whose sway nothing damps."""

    LEAN = math.radians(
        -15.0
    )  # beyond the 11 degrees at which it would fall without the tie

    def hanging(self, size=1.0):
        """The block with a tie that holds it there, how it lies, and how it would rotate."""
        c = np.cos(self.LEAN)
        s = np.sin(self.LEAN)
        turn = np.array([[c, -s], [s, c]])
        pivot = size * np.array([0.2, 0.0])
        middle, foot, top = (
            size * np.array(point)
            for point in ([0.0, 1.0], TestBlock.FOOT, TestBlock.TOP)
        )
        centre, end = (turn @ (point - pivot) for point in (middle, top))
        line = foot - pivot - end
        length = np.hypot(*line)
        force = 1600.0 * size**2 * GRAVITY * centre[0] * length
        force /= end[0] * line[1] - end[1] * line[0]
        block = af.Block(width=0.4 * size, height=2.0 * size, friction=math.inf)
        row = block.tied(ends=[(-1, *foot), (0, *top)], area=1.0).chain.tie.copy()
        row[0, 6:8] = force / (0.002 * length), 0.998 * length
        tied = af.Arch(**{**vars(block), "chain": block.chain._replace(tie=row)})
        shift = np.array([[*(pivot + centre - middle), self.LEAN]])
        return tied, shift, np.array([-centre[1], centre[0], 1.0])

    @pytest.mark.parametrize("method", ["time_stepping", "event_driven"])
    @pytest.mark.parametrize(
        ("rate", "status"), [(0.01, "STANDING"), (0.05, "UNFINISHED")]
    )
    def test_it_stands_if_it_is_calm(self, method, rate, status):
        tied, shift, way = self.hanging()
        still = af.Motion(np.zeros(10), 0.01)
        run = af.simulate(tied, still, initial=(shift, rate * way[None]), method=method)
        assert run.status.name == status
        assert run.residual_rotation == pytest.approx(abs(self.LEAN), abs=0.05)

    def test_a_run_that_follows_for_less_than_the_calm_is_unfinished(self):
        tied, shift, way = self.hanging()
        start = shift, 0.01 * way[None]
        still = af.Motion(np.zeros(10), 0.01)
        run = af.simulate(
            tied, still, initial=start, method="time_stepping", follow=9.0
        )
        assert run.status.name == "UNFINISHED"

    @pytest.mark.parametrize("size", [1.0 / 16.0, 1.0, 4.0])
    def test_the_calm_lasts_as_long_as_the_arch_is_large(self, size):
        tied, shift, way = self.hanging(size)
        unit = math.sqrt(size)  # Froude's: as times of models do
        rate = (
            0.01
            / unit
            * np.array([size, size, 1.0])
            * way
            / np.array([size, size, 1.0])
        )
        still = af.Motion(np.zeros(10), 0.01 * unit)
        found = [
            af.simulate(
                tied, still, initial=(shift, rate[None]), follow=follow * unit
            ).status.name
            for follow in (9.0, 10.0)
        ]
        assert found == ["UNFINISHED", "STANDING"]


def pulled_slowly(spread, tie, parts=40):
    """Where an arch comes to rest by contact dynamics under a tie that pulls more and more.

    The tie is so soft that its pull does not depend on where the arch goes; None if it falls.
    """
    place = spread.chain.start.copy()
    still = af.Motion(np.zeros(2), 0.005)
    row = spread.tied(**{**tie, "prestress": 0.0}).chain.tie[0].copy()
    for part in np.arange(1, parts + 1) / parts:
        ends = []
        for body, x, y in ((int(row[0]), *row[2:4]), (int(row[1]), *row[4:6])):
            c = np.cos(place[body - 1, 2])
            s = np.sin(place[body - 1, 2])
            ends.append(place[body - 1, :2] + [c * x - s * y, s * x + c * y])
        length = np.hypot(*np.subtract(*ends))
        row[6] = part * tie["prestress"] / (1e3 * length)
        row[7] = -999.0 * length
        pulled = spread.changed(chain=spread.chain._replace(tie=row[None]))
        start = place - spread.chain.start, np.zeros_like(place)
        given = {"method": "time_stepping", "history": True}
        run = af.simulate(pulled, still, initial=start, **given)
        last = run.history.isel(time=-1)
        place = spread.chain.start + np.column_stack([last.displacement, last.rotation])
        if run.collapsed or np.abs(place - spread.chain.start).max() > 0.3:
            return None
    return place


RING = af.Arch.segmental(span=8.0, rise=3.0, thickness=0.6, voussoirs=9, friction=0.6)
ARCHES = {"ring": RING, "piers": on_piers(RING, 4.0, [2.0, 2.6], courses=2)}


class TestSpread:
    """An arch that has spread follows the prestress of a tie."""

    @pytest.mark.parametrize("arch", ARCHES.values(), ids=ARCHES)
    @pytest.mark.parametrize(
        "moved", [{"spread": 0.01}, {"spread": 0.01, "settlement": 0.02}]
    )
    def test_it_comes_to_rest_where_contact_dynamics_does(self, arch, moved):
        spread = af.move_springing(arch, **moved)
        for prestress in (2e4, 6e4):
            tie = {"level": 1.0, "area": 3e-4, "prestress": prestress}
            tied = spread.tied(**tie)
            assert af.onset(tied).stands
            assert np.abs(tied.chain.start - spread.chain.start).max() > 1e-4
            expected = pulled_slowly(spread, tie)
            assert tied.chain.start == pytest.approx(expected, abs=2e-4)
            ((left, right),) = tied.tie_lines
            *_, stiffness, free, _, _ = tied.chain.tie[0]
            tension = stiffness * (np.hypot(*(right - left)) - free)
            assert tension == pytest.approx(prestress, abs=0.1)

    @pytest.mark.parametrize("arch", ARCHES.values(), ids=ARCHES)
    def test_too_much_names_the_tie_and_the_largest_prestress(self, arch):
        spread = af.move_springing(arch, spread=0.01)
        tie = {"level": 1.0, "area": 3e-4}
        with pytest.raises(
            af.errors.StabilityError, match=r"tie 1 \(level 1 m\) .* up to"
        ) as info:
            spread.tied(**tie, prestress=2e5)
        most = float(str(info.value).split("up to ")[1].split()[0])
        assert af.onset(spread.tied(**tie, prestress=0.99 * most)).stands
        assert pulled_slowly(spread, {**tie, "prestress": 1.1 * most}) is None

    def test_a_second_tie_and_a_small_prestress(self):
        spread = af.move_springing(RING, spread=0.01)
        little = spread.tied(level=1.0, area=3e-4, prestress=1e3)
        assert little.chain.start is spread.chain.start
        both = spread.tied(level=1.0, area=3e-4, prestress=2e4)
        both = both.tied(level=1.5, area=3e-4, prestress=3e4)
        assert af.onset(both).stands
        first = both.chain.tie[0, 6] * (
            np.hypot(*np.diff(both.tie_lines[0], axis=0)[0]) - both.chain.tie[0, 7]
        )
        assert 0.0 <= first < 2e4 + 1.0

    def test_what_it_draws_moves_with_its_bodies(self):
        tied = af.move_springing(RING, spread=0.03).tied(
            level=1.0, area=3e-4, prestress=6e4
        )
        for outline, centre in zip(tied.outlines, tied.chain.start):
            middle = outline.mean(axis=0)
            assert np.hypot(*(middle - centre[:2])) < 0.05
        assert tied.built is RING


def test_too_much_prestress_of_a_block_is_named():
    tied = af.Block(width=0.4, height=2.0, friction=0.8).tied(
        ends=[(-1, -1.3, 0.0), (0, -0.2, 2.0)], area=1e-4, prestress=2e4
    )
    with pytest.raises(
        af.errors.StabilityError, match=r"tie 1: 20000 N, at most \d+ N"
    ):
        af.simulate(tied, PULSE)


def test_too_much_prestress_of_an_arch_as_built_is_named():
    tied = ARCH.tied(level=6.0, area=1e-3, prestress=2e6)
    with pytest.raises(
        af.errors.StabilityError, match=r"tie 1 .level 6 m.: 2e.06 N, at most"
    ) as info:
        af.simulate(tied, PULSE)
    most = float(str(info.value).split("at most ")[1].split()[0])
    stands = [
        af.onset(ARCH.tied(level=6.0, area=1e-3, prestress=part * most)).stands
        for part in (0.99, 1.01)
    ]
    assert stands == [True, False]
    assert "its own weight" not in str(info.value)


SCENES = {
    "elastic": {"level": 6.0, "area": 1e-4},
    "prestressed": {"level": 6.0, "area": 2e-4, "prestress": 1e4},
    "yields": {"level": 6.0, "area": 1e-4, "strength": 2e4},
    "breaks": {"level": 6.0, "area": 1e-4, "rupture": 0.02},
    "low": {"level": 3.0, "area": 1e-4},
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_methods_agree_and_energy_closes(scene):
    tied = ARCH.tied(**scene)
    events = af.simulate(tied, PULSE, 0.7, method="event_driven", rtol=1e-7)
    steps = af.simulate(tied, PULSE, 0.7, method="time_stepping", rtol=1e-4)
    both = af.simulate(tied, PULSE, 0.7)
    assert not events.collapsed
    assert events.status == steps.status == both.status
    assert events.energy_error < 1e-6
    assert steps.peak_rotation == pytest.approx(events.peak_rotation, rel=0.01)
    assert both.peak_rotation == pytest.approx(events.peak_rotation, rel=0.05)
    assert af.simulate(ARCH, PULSE, 0.7).peak_rotation != pytest.approx(
        both.peak_rotation, rel=0.01
    )
    energy = steps.energy
    given = (
        energy["ground"]
        + energy["friction"]
        + energy["impacts"]
        + energy["balance_error"]
    )
    left = energy["kinetic"] + energy["potential"] - given
    assert abs(left) < 1e-9 * energy["largest_kinetic"]


def test_runs_side_by_side_have_the_bits_of_one():
    tied = ARCH.tied(level=6.0, area=1e-4, strength=2e4).tied(
        level=3.0, area=1e-4, prestress=1e3
    )
    factors = [0.5, 0.7, 0.9, 1.1, 1.3]
    together = af.simulate_many(tied, PULSE, factors).peak_rotation.values.tolist()
    assert together == [
        af.simulate(tied, PULSE, factor).peak_rotation for factor in factors
    ]


class TestRefusals:
    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"area": 1e-3}, "either its level or its ends"),
            ({"area": 1e-3, "level": 60.0}, "level = 60 m is impossible"),
            ({"area": 0.0, "level": 6.0}, "area = 0"),
            (
                {"area": 1e-3, "level": 6.0, "prestress": 2e4, "strength": 1e4},
                "prestress",
            ),
            ({"area": 1e-3, "ends": [(-1, 0, 0), (7, 1, 0)]}, "not both springings"),
            (
                {"area": 1e-4, "level": 6.0, "prestress": 2e4, "rupture": 1e-3},
                "rupture = 0.001 m .* 0.01784 m longer at rest, by its prestress of 20000 N",
            ),
        ],
    )
    def test_message_names_what_is_wrong(self, given, message):
        with pytest.raises(af.errors.GeometryError, match=message):
            ARCH.tied(**given)
