"""Time stepping: rest, what each step and each impact take, residual, symmetry, the end."""

import functools
import sys

import numpy as np
import pytest

import archfrag as af
from archfrag.physics.contact.path import solve_with_fallback
from archfrag.physics.contact.placing import move_faces, relative_velocity
from archfrag.physics.energy import energies_of
from archfrag.physics.ground import grounds_of, impulse_between
from archfrag.physics.interface import Options
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.shared import clear
from archfrag.physics.state import Clock, model_of
from archfrag.physics.status import Count, Energy, Status, Wait
from archfrag.physics.steps.run import new_rigid_runs
from archfrag.physics.steps.service import go_on
from archfrag.physics.steps.step import accept_step, pose_step, time_before
from tests.validation.scenes import g, oppenheim, pulse, sampled

simulate = functools.partial(af.simulate, method="time_stepping")


@kernel
def code_of(runs, until, solved):
    """Why a run waits that has made a step, or could not."""
    go_on(runs, until, (solved, not solved, False, False))
    return int(runs.state.clock[Clock.CODE])


@kernel
def step_through(runs, lengths, kinds):
    """Step a chain through steps of given lengths; the worst energy balance of one of them [J].

    Counted in `kinds` (5,): steps, with a slip, with an impact, with an opening, with a corner.
    """
    model = runs.model
    state = runs.state
    work = runs.work
    clear(state)
    state.clock[Clock.FACTOR] = 1.0
    move_faces(model, state.position, work)
    worst = 0.0
    clock = state.clock
    energy = state.energy
    for length in lengths:
        clock[Clock.STEP], time = length, clock[Clock.TIME]
        if kinds[0] % 3 == 0:  # reactions before an expected impact
            clock[Clock.IMPACT] = time + 0.5 * length
        span = time_before(state, length)
        impulse = impulse_between(runs.grounds, clock, time, time + length)
        pose_step(runs, impulse)
        solved, _ = solve_with_fallback(model, state, work, runs.path)
        if not solved:
            return np.inf
        kinetic, potential = energies_of(model, state)
        before = kinetic + potential
        done = 0.0
        for i in range(1, state.position.shape[0] - 1):
            for c in range(2):
                mean = 0.5 * (state.velocity[i, c] + work.solved[i, c])
                done -= model.mass[i] * mean * (impulse.x if c == 0 else impulse.y)
        # The velocities of both instants at the contacts of the middle.
        relative_velocity(model, work.position, work.solved, work.pivot, work.relative)
        for j in range(state.slip.size):
            for c in range(3):
                mean = 0.5 * (work.earlier[j, c] + work.relative[j, c])
                done += (work.reaction[j, c] + span * state.force[j, c]) * mean
        slides = makes = opens = corner = False
        for j in range(state.slip.size):
            slides = slides or work.slide[j] != 0.0
            corner = corner or work.contact[j, 0] != work.contact[j, 1]
            for k in range(2):
                makes = makes or work.contact[j, k] > state.contact[j, k]
                opens = opens or work.contact[j, k] < state.contact[j, k]
        for kind, found in enumerate((True, slides, makes, opens, corner)):
            kinds[kind] += found
        collapsed, broken = accept_step(runs, impulse, True)
        if collapsed or broken:
            return worst
        kinetic, potential = energies_of(model, state)
        worst = max(worst, abs(kinetic + potential - before - done))
        recorded = (
            energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
        )
        recorded += energy[Energy.BALANCE_ERROR] - state.clock[Clock.START]
        # The sums of all steps up to now hold the rounding of each.
        worst = max(worst, 0.1 * abs(kinetic + potential - recorded))
    return worst


def runs_of(arch, motion, steps=2e-5):
    """A run of a chain under a motion, whose shortest steps are `steps`."""
    options = Options(steps, 1e-3, 1e-3, 1.0, 10, 0.5, 64, 1e-2, 0.0, 1e-3, 1e-6)
    runs = new_rigid_runs(model_of(arch.chain))
    return runs._replace(grounds=grounds_of([motion]), options=options)


def stepped(arch, motion, lengths):
    """State, worst energy balance and kinds of steps of a chain, every step integrated."""
    kinds = np.zeros(5, np.int64)
    runs = runs_of(arch, motion)
    runs.state.position[:, :2] = runs.model.centroid
    worst = step_through(runs, lengths, kinds)
    return runs.state, worst, kinds


class TestRest:
    """What stands does not creep."""

    thin = af.Arch.circular(10.0, 1.2, 180.0, 27, 0.7, sector=False)

    def test_steps_without_rest_detection_do_not_creep(self):
        limit = af.onset(self.thin).plus
        noise = np.random.default_rng(3).uniform(-0.9, 0.9, 6001) * limit * g
        state, _, kinds = stepped(self.thin, (noise, None, 0.01), np.full(3000, 2e-3))
        # Rounding wanders up to what one degenerate step allows.
        away = state.position[1:-1, :2] - self.thin.chain.centroid
        assert np.abs(away).max() <= 1e-7
        assert kinds[0] == 3000

    def test_nothing_moves_for_a_minute(self):
        still = np.zeros((27, 3))
        for initial in (None, (still, still)):
            response = af.simulate(
                self.thin, af.Motion(np.zeros(6001), 0.01), initial=initial
            )
            assert response.status is Status.STANDING
            assert response.peak_displacement <= 1e-9

    def test_what_only_the_ground_held_up_falls_when_the_record_ends(self):
        right = np.array([[0.25, 0.0], [0.80, 3.0]])
        column = af.Arch.from_joints(right, right - [0.5, 0.0], 1.0, free_end=True)
        still = np.zeros((1, 3))
        held = af.Motion(np.full(101, 0.04 * g), 0.01)
        assert simulate(column, held, initial=(still, still)).collapsed is True


@pytest.mark.parametrize(
    ("solved", "else_"), [(True, Wait.PAUSE), (False, Wait.UNSOLVED)]
)
@pytest.mark.parametrize(
    ("time", "steps", "ends"),
    [(0.5, 10, None), (2.0, 10, Wait.AT_END), (0.5, 1e9, Wait.EXHAUSTED)],
)
def test_a_run_ends_in_time_though_every_step_needs_service(
    time, steps, ends, solved, else_
):
    runs = runs_of(af.Block(0.6, 1.8, friction=0.4), (np.zeros(2), None, 0.1), 1e-3)
    runs.state.clock[Clock.TIME] = time
    runs.state.count[Count.STEPS] = steps
    assert code_of(runs, 2.0, solved) == (else_ if ends is None else ends)


def test_residual_falls_with_the_step(monkeypatch):
    # Measured in every step, with the reactions of the step that led to a state.
    monkeypatch.setattr(
        sys.modules["archfrag.simulation.simulate"], "CHECK_INTERVAL", 1
    )
    coarse, fine = (
        simulate(oppenheim(), pulse(0.5, 0.3), dt=dt, follow=0.0).residual
        for dt in (1e-3, 2.5e-4)
    )
    assert 0.0 < fine < 0.5 * coarse < 1e-2


class TestEnergy:
    """Contacts take energy and never give any; the balance states where it went."""

    @pytest.mark.parametrize(
        ("voussoirs", "friction"), [(7, 0.7), (7, 0.36), (15, 0.4), (1, 0.3)]
    )
    def test_each_step_changes_energy_by_the_work_of_ground_and_contacts(
        self, voussoirs, friction
    ):
        # Whatever the lengths of the steps: drawn here, each apart, over a range of 100.
        rng = np.random.default_rng(39)
        arch = af.Block(1.0, 2.0, friction)
        if voussoirs > 1:
            arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs, friction)
        time = np.arange(0.0, 8.0, 1e-3)
        wave = 6.0 * np.sin(9.0 * time) * np.sin(0.4 * time)
        lengths = 10.0 ** rng.uniform(-4.6, -2.6, 20_000)
        state, worst, kinds = stepped(arch, (wave, 0.5 * wave[::-1], 1e-3), lengths)
        assert worst <= 1e-12 * state.energy[Energy.LARGEST_KINETIC]
        assert (kinds[:4] > 50).all()

    @pytest.mark.parametrize("follow", [0.0, 20.0])
    def test_the_balance_closes_in_motion_and_at_rest(self, follow):
        energy = af.simulate(oppenheim(), pulse(0.5, 0.3), follow=follow).energy
        assert (energy["kinetic"] > 0.0) == (follow == 0.0)
        gained = energy["kinetic"] + energy["potential"]
        given = (
            energy["ground"]
            + energy["friction"]
            + energy["impacts"]
            + energy["balance_error"]
        )
        assert gained == pytest.approx(given, abs=1e-9 * energy["largest_kinetic"])

    def test_an_impact_takes_what_it_takes_by_events_and_not_more_by_a_part_of_the_step(
        self,
    ):
        arch = oppenheim()
        still = af.Motion(np.zeros(80), 1e-4)
        push = sampled(
            lambda t: np.where(t < 0.3, 1.5 * af.onset(arch).plus, 0.0), 1.2, dt=1e-3
        )
        run = simulate(
            arch, push, method="event_driven", rtol=1e-8, history=True, follow=0.0
        )
        impacts = np.array(
            [each.time for each in run.mechanism if each.cause == "impact"]
        )
        moves = run.history
        taken = 0.0
        excess = 0.0
        for before, at, after in zip(impacts, impacts[1:], impacts[2:]):
            if at < 0.31 or at - before < 8e-3 or after - at < 4e-3:
                continue
            start = moves.isel(time=np.searchsorted(moves.time.values, at - 4e-3) - 1)
            place, motion = (
                np.column_stack([start[a], start[b]])
                for a, b in (
                    ("displacement", "rotation"),
                    ("velocity", "angular_velocity"),
                )
            )
            exact, ours = (
                simulate(arch, still, initial=(place, motion), follow=0.0, **by).energy
                for by in ({"method": "event_driven", "rtol": 1e-9}, {})
            )
            taken -= exact["impacts"]
            excess += sum(exact[kind] - ours[kind] for kind in ("kinetic", "potential"))
        assert taken > 0.0
        assert abs(excess) < 0.005 * taken


def test_a_mirrored_arch_and_motion_give_the_mirrored_response():
    rng = np.random.default_rng(36)
    angle = np.radians(
        168.0 - np.concatenate([[0.0], rng.uniform(0.6, 1.4, 8).cumsum()]) * 18
    )
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    lines = 9.2 * ray, (10.8 + 0.05 * np.arange(9))[:, None] * ray
    flip = np.array([-1.0, 1.0])
    dead = rng.uniform(0.0, 5e4, 8)
    one = af.Arch.from_joints(*lines, 0.7, dead_load=dead)
    mirrored = ((line * flip)[::-1] for line in lines)
    two = af.Arch.from_joints(*mirrored, 0.7, dead_load=dead[::-1])
    start = af.onset(one)
    assert start.plus == pytest.approx(af.onset(two).minus, rel=1e-9)
    assert start.plus != pytest.approx(start.minus, rel=1e-3)
    motion = sampled(lambda t: 1.3 * start.plus, 0.25)
    right, left = (
        simulate(arch, motion, scale=scale, history=True).history
        for arch, scale in ((one, 1.0), (two, -1.0))
    )
    n = int(np.searchsorted(right.time.values, 0.35))
    image = left.displacement.values[:n, ::-1] * flip
    assert right.displacement.values[:n] == pytest.approx(image, abs=1e-9)
    assert np.abs(image).max() > 1e-3


def test_a_run_goes_on_after_its_record_until_rest_within_its_limit():
    motion = pulse(0.5, 0.3)
    total, part = (
        simulate(oppenheim(), motion, follow=limit) for limit in (20.0, 0.05)
    )
    assert total.status is Status.STANDING
    assert total.end_time > motion.duration + 0.1
    assert (part.status, part.collapsed) == (Status.UNFINISHED, None)
    assert part.end_time == pytest.approx(motion.duration + 0.05, abs=1e-3)
