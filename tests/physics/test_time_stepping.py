"""Motion in time against closed forms, equations of motion integrated apart, and bookkeeping."""

import functools
import sys

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.path import solve_with_fallback
from archfrag.mechanics.contact.placing import move_faces, relative_velocity
from archfrag.mechanics.energy import energies_of
from archfrag.mechanics.ground import Impulse, grounds_of, impulse_between
from archfrag.mechanics.model import Clock, model_of
from archfrag.mechanics.status import Count, Energy, Status
from archfrag.mechanics.types import Options
from archfrag.methods.common import AT_END, EXHAUSTED, PAUSE, UNSOLVED, clear
from archfrag.methods.time_stepping.run import new_one
from archfrag.methods.time_stepping.service import code_after
from archfrag.methods.time_stepping.step import accept_step, pose_step, time_before
from tests.physics.audit import g, impulse, pulse, random_scene, sampled
from tests.physics.irregular import irregular_scene

simulate = functools.partial(af.simulate, method="time_stepping")


@kernel
def code_of(state, options, until, solved):
    """Why a run waits that has made a step, or could not."""
    return code_after(state, options, until, (solved, not solved, False, False))


@pytest.fixture
def every_step_measured(monkeypatch):
    """Contact laws measured in every step instead of in every sixty-fourth."""
    monkeypatch.setattr(sys.modules["archfrag.simulate"], "CHECK_INTERVAL", 1)


@kernel
def step_on(model, state, work, path, pushes, step, moved_by):
    """Step a chain at rest through every push, whatever its rest range; whether all is solved."""
    clear(state)
    move_faces(model, state.position, work.rotated, work.face, work.tangent)
    state.clock[Clock.STEP] = step
    for i in range(pushes.size):
        impulse = Impulse(pushes[i], 0.0)
        pose_step(model, state, work, impulse, step, step)
        solved, compliant = solve_with_fallback(model, state, work, path)
        if compliant or not solved:
            return False
        accept_step(model, state, work, impulse, True, 0.5)
        for j in range(1, state.position.shape[0] - 1):
            for c in range(2):
                away = abs(state.position[j, c] - model.centroid[j, c])
                moved_by[i] = max(moved_by[i], away)
    return True


@kernel
def step_at_random(model, grounds, state, work, path, lengths, kinds):
    """Step a chain through steps of given lengths; the worst energy balance of one of them [J].

    Counted in `kinds` (5,): steps, with a slip, with an impact, with an opening, with a corner.
    """
    clear(state)
    state.clock[Clock.FACTOR] = 1.0
    move_faces(model, state.position, work.rotated, work.face, work.tangent)
    worst, shortest, clock, energy = 0.0, 2e-5, state.clock, state.energy
    for length in lengths:
        clock[Clock.STEP], time = length, clock[Clock.TIME]
        if kinds[0] % 3 == 0:  # reactions before an expected impact
            clock[Clock.IMPACT] = time + 0.5 * length
        span = time_before(state, length)
        impulse = impulse_between(grounds, clock, time, time + length)
        pose_step(model, state, work, impulse, length, shortest)
        solved, _ = solve_with_fallback(model, state, work, path)
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
        relative_velocity(work.position, work.solved, work.pivot, work.relative)
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
        collapsed, broken = accept_step(model, state, work, impulse, True, 0.5)
        if collapsed or broken:
            return worst
        kinetic, potential = energies_of(model, state)
        worst = max(worst, abs(kinetic + potential - before - done))
        recorded = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
        recorded += energy[Energy.BALANCE_ERROR] - state.clock[Clock.START]
        # The sums of all steps up to now hold the rounding of each.
        worst = max(worst, 0.1 * abs(kinetic + potential - recorded))
    return worst


class TestImpacts:
    """Energy that a located impact takes, against events: not more by a part of the step."""

    def test_reactions_act_up_to_an_impact(self):
        arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
        samples = 1.5 * g * af.onset(arch).plus * (np.arange(0.0, 1.2, 1e-3) < 0.3)
        push = af.Motion(samples, 1e-3)
        run = simulate(arch, push, method="event_driven", rtol=1e-8, history=True, follow=0.0)
        moves, still = run.history, af.Motion(np.zeros(80), 1e-4)
        impacts = np.array([each.time for each in run.mechanism if each.cause == "impact"])
        taken = excess = 0.0
        for before, at, after in zip(impacts, impacts[1:], impacts[2:]):
            if at < 0.31 or at - before < 8e-3 or after - at < 4e-3:
                continue
            k = np.searchsorted(moves.time.values, at - 4e-3) - 1
            place, motion = (
                np.concatenate([moves[a].values[k], moves[b].values[k][:, None]], axis=1)
                for a, b in (("displacement", "rotation"), ("velocity", "angular_velocity"))
            )
            exact, ours = (
                simulate(arch, still, initial=(place, motion), follow=0.0, **by).energy
                for by in ({"method": "event_driven", "rtol": 1e-9}, {})
            )
            taken -= exact["impacts"]
            excess += sum(exact[kind] - ours[kind] for kind in ("kinetic", "potential"))
        assert taken > 0.0
        assert abs(excess) < 0.005 * taken


class TestRest:
    """What stands does not creep, even when every step is integrated."""

    def test_steps_without_rest_detection_do_not_creep(self):
        arch = af.Arch.circular(10.0, 1.2, 180.0, 27, 0.7, sector=False)
        step = 2e-3
        limit = af.onset(arch).plus
        noise = np.random.default_rng(3).uniform(-1.0, 1.0, 6001) * 0.9 * limit * g
        edges = np.arange(-0.5, 3000.0) * step
        pushes = impulse(noise, 0.01, edges[:-1], edges[1:])
        model, moved_by = model_of(arch.chain), np.zeros(pushes.size)
        one = new_one(model)
        one.state.position[:, :2] = model.centroid
        assert step_on(model, one.state, one.work, one.path, pushes, step, moved_by)
        # Rounding wanders up to what one degenerate step allows, and stays there.
        assert max(moved_by) <= 1e-7
        assert max(moved_by[1500:]) <= 2.0 * max(moved_by[:1500]) + 1e-9

    def test_what_only_the_ground_held_up_falls_when_the_record_ends(self):
        right = np.array([[0.25, 0.0], [0.80, 3.0]])
        column = af.Arch.from_joints(right, right - [0.5, 0.0], 1.0, free_end=True)
        still = np.zeros((1, 3))
        held = af.Motion(np.full(101, 0.04 * g), 0.01)
        response = simulate(column, held, initial=(still, still))
        assert response.collapsed is True

    @pytest.mark.parametrize(("solved", "else_"), [(True, PAUSE), (False, UNSOLVED)])
    @pytest.mark.parametrize(
        ("time", "steps", "ends"), [(0.5, 10, None), (2.0, 10, AT_END), (0.5, 1e9, EXHAUSTED)]
    )
    def test_ends_in_time_though_every_step_needs_service(self, time, steps, ends, solved, else_):
        state = new_one(model_of(af.Block(0.6, 1.8, friction=0.4).chain)).state
        state.clock[Clock.TIME], state.count[Count.STEPS] = time, steps
        assert state.clock[Clock.FASTEST] == 0.0
        options = Options(1e-3, 1e-3, 1e-3, 1.0, 10, 0.5, 64, 1e-2, 0.0, 1e-3, 1e-6)
        found = code_of(state, options, 2.0, solved)
        assert found == (else_ if ends is None else ends)


class TestFreeFlight:
    """Nothing holds a body up: lift-off under vertical ground motion is ballistic."""

    def test_height_of_a_block_thrown_by_the_ground(self):
        block = af.Block(1.0, 2.0, friction=0.6)
        time = 0.03
        still = np.zeros(400)
        down = np.where(np.arange(400) * 1e-4 <= time, -2.0 * g, 0.0)
        thrown = simulate(block, af.Motion(still, 1e-4, down), dt=1e-4)
        assert thrown.status is Status.STANDING
        assert thrown.peak_displacement == pytest.approx(g * time**2, rel=0.02)
        assert thrown.peak_rotation < 1e-9


class TestSignorini:
    """No voussoir enters another; lost contact is collapse, and nothing else is."""

    def test_residual_falls_with_the_step(self, every_step_measured):
        # A state is measured with the reactions of the step that led to it.
        arch = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)
        found = [
            simulate(arch, pulse(0.5, 0.3), dt=dt, follow=0.0).residual for dt in (1e-3, 2.5e-4)
        ]
        assert 0.0 < found[1] < 0.5 * found[0] < 1e-2

    def test_contact_problems_of_every_step_of_real_motions_are_solved(self):
        rng = np.random.default_rng(33)
        steps = fallbacks = 0
        for _ in range(20):
            response = simulate(*random_scene(rng))
            assert response.status in (Status.STANDING, Status.COLLAPSED)
            steps += response.steps
            fallbacks += response.fallbacks
        assert fallbacks < 1e-4 * steps


class TestEnergy:
    """Contacts take energy and never give any; the balance states where it went."""

    @pytest.mark.parametrize(("voussoirs", "friction"), [(7, 0.7), (7, 0.36), (15, 0.4), (1, 0.3)])
    def test_each_step_changes_energy_by_the_work_of_ground_and_contacts(
        self, voussoirs, friction
    ):
        # Whatever the lengths of the steps: drawn here, each apart, over a range of 100.
        rng, arch = np.random.default_rng(39), af.Block(1.0, 2.0, friction)
        if voussoirs > 1:
            arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs, friction)
        time = np.arange(0.0, 8.0, 1e-3)
        wave = 6.0 * np.sin(9.0 * time) * np.sin(0.4 * time)
        model = model_of(arch.chain)
        grounds = grounds_of([(wave, 0.5 * wave[::-1], 1e-3)])
        one, kinds = new_one(model), np.zeros(5, np.int64)
        one.state.position[1:-1, :2] = arch.chain.centroid
        lengths = 10.0 ** rng.uniform(-4.6, -2.6, 20_000)
        worst = step_at_random(model, grounds, one.state, one.work, one.path, lengths, kinds)
        assert worst <= 1e-12 * one.state.energy[Energy.LARGEST_KINETIC]
        assert (kinds[:4] > 50).all()

    # What made it: a slip that ended inside a long step, an impact off the middle of its step,
    # reactions carried up to an impact where joints open.
    @pytest.mark.parametrize("seed", [930283, 930270, 930852])
    def test_contacts_give_none(self, seed):
        scene = irregular_scene(seed)
        energy = simulate(scene.arch, scene.motion).energy
        assert energy["balance_error"] <= 1e-4 * energy["largest_kinetic"]


class TestSymmetry:
    """The laws know no left and right."""

    def test_mirrored_arch_and_motion_give_the_mirrored_response(self):
        rng = np.random.default_rng(36)
        angle = np.radians(168.0 - np.concatenate([[0.0], rng.uniform(0.6, 1.4, 8).cumsum()]) * 18)
        ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        inner, outer = 9.2 * ray, (10.8 + 0.05 * np.arange(9))[:, None] * ray
        flip = np.array([-1.0, 1.0])
        dead = rng.uniform(0.0, 5e4, 8)
        one = af.Arch.from_joints(inner, outer, 0.7, dead_load=dead)
        two = af.Arch.from_joints(
            (inner * flip)[::-1], (outer * flip)[::-1], 0.7, dead_load=dead[::-1]
        )
        assert af.onset(one).plus == pytest.approx(af.onset(two).minus, rel=1e-9)
        assert af.onset(one).plus != pytest.approx(af.onset(one).minus, rel=1e-3)
        motion = sampled(lambda t: 1.3 * af.onset(one).plus, 0.25)
        right = simulate(one, motion, history=True)
        left = simulate(two, motion, scale=-1.0, history=True)
        n = int(np.searchsorted(right.history.time.values, 0.35))
        mirrored = left.history.displacement.values[:n, ::-1] * flip
        assert right.history.displacement.values[:n] == pytest.approx(mirrored, abs=1e-9)
        assert np.abs(mirrored).max() > 1e-3


class TestFollowing:
    """The end of the record is not the end of the motion."""

    def test_goes_on_until_rest_within_its_limit(self):
        arch = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)
        motion = pulse(0.5, 0.3)
        total = simulate(arch, motion)
        assert total.status is Status.STANDING
        assert total.end_time > motion.duration + 0.1
        part = simulate(arch, motion, follow=0.05)
        assert part.status is Status.UNFINISHED
        assert part.collapsed is None
        assert part.end_time == pytest.approx(motion.duration + 0.05, abs=1e-3)

    def test_rest_and_motion_make_up_the_total_time(self):
        arch = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)
        quiet = np.zeros(20000)
        pushed = pulse(0.5, 0.3).acceleration
        motion = af.Motion(np.concatenate([quiet, pushed, quiet, quiet]), 1e-4)
        response = simulate(arch, motion, dt=5e-4)
        spent = response.model_time
        assert sum(spent.values()) == pytest.approx(response.end_time, abs=1e-3)
        assert response.end_time == pytest.approx(motion.duration, abs=1e-3)
        assert spent["rest"] > 3.0
        assert spent["all_voussoirs"] == pytest.approx(response.steps * 5e-4, abs=2e-3)
        alone = simulate(arch, af.Motion(np.concatenate([pushed, quiet]), 1e-4), dt=5e-4)
        assert response.peak_displacement == pytest.approx(alone.peak_displacement, rel=0.05)
