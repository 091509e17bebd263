"""Mega-voussoirs: assembled and split without loss, and their reactions by the two levels."""

import functools
from collections import Counter

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.acceleration import centripetal_bias, find_touching, uniform_force
from archfrag.mechanics.delassus import contact_work, velocity_scale
from archfrag.mechanics.energy import kinetic_energy
from archfrag.mechanics.former_contact import solve_contact
from archfrag.mechanics.kinematics import (
    clearance,
    empty_contacts,
    joint_lengths,
    measure_slip,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import CLOSED_STICK, slip_of, touches
from archfrag.mechanics.levels import new_few_bodies, solve_levels
from archfrag.mechanics.mechanism import (
    GROUND,
    assemble_mechanism,
    gather_state,
    new_mechanism,
    split_state,
)
from archfrag.mechanics.status import Status
from tests.physics.audit import g, sampled
from tests.physics.random_states import problem_residual

PATTERNS = {
    "four hinges": {0: 4, 2: 1, 4: 4, 7: 1},
    "split hinges": {0: 4, 2: 1, 4: 4, 5: 4, 7: 1},
    "every joint open": dict(enumerate([4, 1, 1, 4, 4, 1, 4, 1])),
    "a joint that slides whole": {0: 4, 3: 8, 5: 1, 7: 4},
    "a corner that slides": {1: 6, 2: 1, 4: 5, 6: 1},
    "a part at rest beside a part in motion": {3: 1, 4: 4, 5: 1},
    "contact lost": {0: 4, 3: 0, 6: 1, 7: 4},
}


def arch_of(voussoirs=7, friction=0.7):
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs, friction)


def rigid_state(chain, mechanism, rng, size=0.02):
    """Random positions and velocities of mega-voussoirs, spread over their voussoirs."""
    n, n_mega = chain.mass.size, mechanism.count[0]
    mega_position = np.zeros((n, 3))
    mega_position[:n_mega, :2] = mechanism.centroid[:n_mega]
    mega_position[:n_mega] += rng.uniform(-size, size, (n_mega, 3))
    mega_velocity = rng.uniform(-1.0, 1.0, (n, 3))
    position, velocity = np.zeros((2, n, 3))
    split_state(mechanism, mega_position, mega_velocity, position, velocity)
    return mega_position, mega_velocity, position, velocity


def momentum(chain, position, velocity):
    """Momentum, and moment of momentum about the origin."""
    linear = (chain.mass[:, None] * velocity[:, :2]).sum(0)
    spin = chain.mass * (position[:, 0] * velocity[:, 1] - position[:, 1] * velocity[:, 0])
    return np.append(linear, (spin + chain.inertia * velocity[:, 2]).sum())


@pytest.mark.parametrize("free_end", [False, True])
@pytest.mark.parametrize("pattern", PATTERNS.values(), ids=PATTERNS.keys())
class TestGrouping:
    def build(self, pattern, free_end, slips=0.0):
        arch = arch_of()
        if free_end:
            side = np.array([[0.5 - 0.01 * k, 1.0 * k] for k in range(9)])
            arch = af.Arch.from_joints(side, side - [[1.0, 0.0]], 0.7, free_end=True)
        chain = arch.chain
        n_joint = chain.friction.size
        mode = np.full(n_joint, CLOSED_STICK, np.int8)
        for joint, kind in pattern.items():
            mode[joint] = kind
        slip = np.random.default_rng(1).uniform(-slips, slips, n_joint)
        mechanism = new_mechanism(chain.mass.size, n_joint)
        assemble_mechanism(chain, mode, slip, joint_lengths(chain), mechanism)
        return chain, mode, slip, mechanism

    def test_as_many_bodies_as_move(self, pattern, free_end):
        *_, mechanism = self.build(pattern, free_end)
        assert mechanism.count[1] == len(pattern)
        assert mechanism.count[0] == len(pattern) - (not free_end)
        assert list(mechanism.joint[: len(pattern)]) == sorted(pattern)

    def test_mass_is_kept(self, pattern, free_end):
        chain, _, _, mechanism = self.build(pattern, free_end)
        moving = chain.mass[mechanism.group != GROUND].sum()
        assert mechanism.mass[: mechanism.count[0]].sum() == pytest.approx(moving, rel=1e-14)

    def test_split_and_assembled_again_is_the_same_state(self, pattern, free_end):
        chain, _, _, mechanism = self.build(pattern, free_end, slips=0.05)
        rng = np.random.default_rng(2)
        mega_position, mega_velocity, position, velocity = rigid_state(chain, mechanism, rng)
        again, rates = np.zeros((2, *mega_position.shape))
        gather_state(chain, mechanism, position, velocity, again, rates)
        n = mechanism.count[0]
        assert again[:n] == pytest.approx(mega_position[:n], abs=1e-13)
        assert rates[:n] == pytest.approx(mega_velocity[:n], abs=1e-12)

    def test_momentum_and_energy_are_kept(self, pattern, free_end):
        chain, _, _, mechanism = self.build(pattern, free_end, slips=0.05)
        rng = np.random.default_rng(3)
        mega_position, mega_velocity, position, velocity = rigid_state(chain, mechanism, rng)
        n = mechanism.count[0]
        linear = (mechanism.mass[:n, None] * mega_velocity[:n, :2]).sum(0)
        x, v = mega_position[:n], mega_velocity[:n]
        spin = mechanism.mass[:n] * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])
        turning = (spin + mechanism.inertia[:n] * v[:, 2]).sum()
        total = momentum(chain, position, velocity)
        assert total == pytest.approx(np.append(linear, turning), rel=1e-12)
        few = kinetic_energy(mechanism.mass[:n], mechanism.inertia[:n], v)
        assert kinetic_energy(chain.mass, chain.inertia, velocity) == pytest.approx(few, rel=1e-12)

    def test_joints_inside_stay_closed(self, pattern, free_end):
        chain, mode, slip, mechanism = self.build(pattern, free_end, slips=0.05)
        rng = np.random.default_rng(4)
        _, _, position, _ = rigid_state(chain, mechanism, rng, size=0.5)
        before, after = np.zeros((2, mode.size, 2, 2))
        move_faces(chain, position, before, after)
        for j in np.flatnonzero(mode == CLOSED_STICK):
            for corner in range(2):
                assert clearance(j, corner, before, after) == pytest.approx(0.0, abs=1e-13)
                slipped = measure_slip(j, corner, before, after)
                assert slipped == pytest.approx(slip[j], abs=1e-13)


class Problem:
    """The contact problem of accelerations of a chain in a given state."""

    def __init__(self, arch):
        self.chain = chain = arch.chain
        n, joints = chain.mass.size, chain.friction.size
        self.length = joint_lengths(chain)
        self.before, self.after = np.zeros((2, joints, 2, 2))
        self.pivot, self.moved = np.zeros((joints, 2)), np.zeros((joints, 3))
        self.contacts = empty_contacts(n, joints)
        self.free = np.zeros((n, 3))
        self.mechanism, self.room = new_mechanism(n, joints), new_few_bodies(n, joints)
        self.general, self.levels = contact_work(n, joints), contact_work(n, joints)

    def pose(self, position, velocity, mode, push):
        chain, contacts, joints = self.chain, self.contacts, self.length.size
        self.velocity, self.slip = velocity, np.zeros(joints)
        move_faces(chain, position, self.before, self.after)
        for j in range(joints):
            gaps = [clearance(j, c, self.before, self.after) for c in range(2)]
            slipped = measure_slip(j, int(np.argmin(gaps)), self.before, self.after)
            self.slip[j] = slipped if abs(slipped) > 1e-8 else 0.0
        place_contacts(position, self.before, self.after, self.slip, self.length, contacts)
        find_touching(
            self.before, self.after, self.length, velocity, mode, 1e-7, 1e-7, 1e-7,
            self.pivot, self.moved, contacts,
        )  # fmt: skip
        # Frames lie between the instants at which a run brings its state onto the contacts.
        for j in range(joints):
            contacts.slip[j] = slip_of(mode[j])
            for corner in range(2):
                contacts.candidate[j, corner] = touches(mode[j], corner)
        uniform_force(chain.mass.size, push, 0.0, chain.gravity, self.free)
        centripetal_bias(contacts, mode, self.slip, velocity, contacts.bias)
        self.general.pivot[:] = self.pivot
        self.scale = velocity_scale(contacts, self.free, self.general)
        self.mode = mode

    def is_rigid(self):
        """Whether voussoirs of a mega-voussoir move as one: not while all are stepped."""
        inside = self.moved[self.mode == CLOSED_STICK]
        return np.abs(inside).max(initial=0.0) < 1e-12 * np.abs(self.velocity).max()

    def by_contact_problem(self):
        chain = self.chain
        self.general.mode[:] = self.mode
        return solve_contact(
            chain.mass, chain.inertia, self.contacts, chain.friction, self.free, self.general
        )[0]

    def residual(self, work):
        """Of a solution, by the laws alone."""
        return problem_residual(self.contacts, self.chain.friction, self.free, work, g)

    def by_levels(self):
        self.levels.mode[:] = self.mode
        return solve_levels(
            self.chain, self.contacts, self.slip, self.length, self.velocity, self.free,
            self.scale, self.mechanism, self.room, self.levels,
        )  # fmt: skip


@functools.cache
def moving_states(voussoirs, friction):
    """An arch, and states of its run under 1.5 times its onset: every joint inside a
    mega-voussoir exactly closed."""
    arch = af.Arch.circular(10.0, 2.0, 140.0, voussoirs, friction)
    amplitude, span = 1.5 * af.onset(arch).plus, 0.8
    push = sampled(lambda t: amplitude * np.where(t < 0.4 * span, 1.0, -0.6), span, 0.005)
    run = af.simulate(arch, push, method="event_driven", rtol=1e-8, history=True, follow=0.5)
    history = run.history
    place = history.displacement.values + arch.chain.centroid
    position = np.concatenate([place, history.rotation.values[..., None]], axis=-1)
    speed = history.velocity.values, history.angular_velocity.values[..., None]
    velocity = np.concatenate(speed, axis=-1)
    acceleration = np.interp(history.time.values, push.time, push.acceleration, right=0.0)
    modes = history.contact_mode.values
    return arch, list(zip(position, velocity, modes, acceleration))


# Least part of the states in which every mega-voussoir is rigid, by the number of voussoirs.
LEAST_COMPARED = {3: 0.95, 7: 0.95, 27: 0.85, 81: 0.35}


@pytest.mark.parametrize("friction", [0.36, 0.5, 0.7, np.inf])
@pytest.mark.parametrize("voussoirs", LEAST_COMPARED)
class TestLevels:
    """Equal to the contact problem, in motion and in mechanism, in states of real runs.

    Frames written while all voussoirs are stepped are left out: no mega-voussoir is rigid there.
    """

    def compare(self, voussoirs, friction, pushes):
        """Counts of states by what came out; asserts that solutions of one mechanism are one."""
        arch, states = moving_states(voussoirs, friction)
        problem = Problem(arch)
        count = Counter(states=len(states))
        for (position, velocity, mode, _), push in zip(states, pushes):
            problem.pose(position, velocity, mode, push)
            if np.abs(velocity).max() < 1e-6 or not problem.is_rigid():
                continue
            count["compared"] += 1
            solved, rounds = problem.by_levels()
            assert problem.by_contact_problem() == Status.STANDING
            ours, theirs = problem.levels, problem.general
            count["changed"] += (theirs.mode != mode).any()
            count["rounds"] += rounds > 1
            if not solved:
                count["left to the contact problem"] += 1
            elif (ours.mode != theirs.mode).any():
                count["other mechanism"] += 1
                assert max(problem.residual(ours), problem.residual(theirs)) < 1e-9
            else:
                scale = np.abs(theirs.velocity).max() + g
                assert np.abs(ours.velocity - theirs.velocity).max() < 1e-9 * scale
                force = np.abs(theirs.reaction).max()
                assert np.abs(ours.reaction - theirs.reaction).max() < 1e-9 * force
        assert count["compared"] >= LEAST_COMPARED[voussoirs] * count["states"]
        return count

    def test_along_the_run_in_one_round_nearly_always(self, voussoirs, friction):
        _, states = moving_states(voussoirs, friction)
        count = self.compare(voussoirs, friction, [push for *_, push in states])
        assert count["other mechanism"] == 0
        assert count["left to the contact problem"] <= 0.01 * count["compared"]
        assert count["rounds"] <= 0.05 * count["compared"]

    def test_from_modes_that_are_wrong_for_another_push(self, voussoirs, friction):
        _, states = moving_states(voussoirs, friction)
        pushes = np.random.default_rng(1).uniform(-3.0, 3.0, len(states)) * g
        count = self.compare(voussoirs, friction, pushes)
        assert count["changed"] > 0.3 * count["compared"]
        # Under friction two motions may both obey the laws; seen where it is infinite only.
        most = 0.02 if np.isinf(friction) else 0.0
        assert count["other mechanism"] <= most * count["compared"]
        assert count["left to the contact problem"] <= 0.3 * count["compared"]
