"""Time stepping over a part of the motion: what it is given and what it gives back."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from archfrag.mechanics.collapse import new_joint_state
from archfrag.mechanics.kinematics import clearance, move_faces
from archfrag.mechanics.ledger import new_ledger
from archfrag.mechanics.status import Count, Energy, Model, Status
from archfrag.mechanics.types import Frames, GroundMotion, MechanismLog, Options
from archfrag.methods.former_stepping import advance
from archfrag.methods.rest import leave_rest, read_joints
from archfrag.methods.stepping import new_stepper
from tests.physics.audit import g, pulse, random_scene


class Part:
    """One chain on its way, advanced piece by piece."""

    def __init__(self, arch, motion, dt, initial=None):
        n, joints = arch.n_voussoir, arch.n_joint
        self.chain = arch.chain
        self.position, self.velocity = np.zeros((2, n, 3))
        self.position[:, :2] = arch.chain.centroid
        vertical = motion.vertical if motion.vertical is not None else 0.0 * motion.acceleration
        self.ground = GroundMotion(motion.acceleration, vertical, motion.dt)
        self.options = Options(dt, 1e-6, 1e-6, 0.0, 10**7, 0.5, 64, 0.0, 0.0)
        self.stepper = new_stepper(self.chain, self.ground, self.position)
        self.joints = new_joint_state(joints)
        self.ledger = new_ledger()
        if initial is not None:
            self.position += initial
            read_joints(self.chain, self.stepper, self.joints, self.position)
        self.frames = Frames(
            np.zeros(0), np.zeros((0, n, 3)), np.zeros((0, n, 3)), np.zeros((0, joints, 3)),
            np.zeros((0, joints), np.int8),
        )  # fmt: skip
        self.log = MechanismLog(
            np.zeros(0), np.zeros(0, np.int8), np.zeros(0, np.int32), np.zeros(0, np.int8),
            np.zeros((0, joints), np.int8),
        )  # fmt: skip
        self.time = 0.0

    def advance(self, until, calm_steps=0):
        # Half a step less: rounding of the sum of steps must not add one.
        until -= 0.5 * self.options.time_step
        status, self.time, *_ = advance(
            self.chain, self.ground, self.options, self.stepper, self.joints, self.ledger,
            self.frames, self.log, self.position, self.velocity, self.time, until, calm_steps,
        )  # fmt: skip
        return status


def arch():
    return af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)


class TestSynchronised:
    """Positions and velocities on return belong to one instant."""

    def test_rocking_block_at_second_order(self):
        half, up, tilt, span = 0.2, 1.0, 0.08, 0.4
        radius, slender = math.hypot(half, up), math.atan(half / up)
        squared = 0.75 * g / radius
        exact = solve_ivp(
            lambda _, y: [y[1], -squared * math.sin(slender - y[0])], (0.0, span), [tilt, 0.0],
            rtol=1e-12, atol=1e-14,
        ).y[:, -1]  # fmt: skip
        assert exact[0] > 0.0
        across = half - (half * math.cos(tilt) - up * math.sin(tilt))
        rise = half * math.sin(tilt) + up * math.cos(tilt) - up
        errors = []
        for dt in (2e-3, 1e-3, 5e-4):
            part = Part(
                af.Block(2 * half, 2 * up, friction=3.0), af.Motion(np.zeros(100), 0.01), dt,
                np.array([[across, rise, -tilt]]),
            )  # fmt: skip
            assert part.advance(span) == Status.UNFINISHED
            assert part.time == pytest.approx(span)
            found = -np.array([part.position[0, 2], part.velocity[0, 2]])
            errors.append(np.abs(found - exact) / np.abs(exact))
        errors = np.array(errors)
        assert (errors[-1] < 4e-6).all()
        assert errors[:-1] / errors[1:] == pytest.approx(np.full((2, 2), 4.0), rel=0.1)

    def test_velocities_move_the_hinges_without_opening_or_closing_them(self):
        part = Part(arch(), pulse(0.5, 0.3), 1e-3)
        part.advance(0.25)
        ahead = part.position + 1e-6 * part.velocity
        gaps = []
        for position in (part.position, ahead):
            faces = np.zeros((2, 8, 2, 2))
            move_faces(part.chain, position, *faces)
            corner = {1: 0, 4: 1}
            gaps.append(
                [clearance(j, corner[m], *faces) for j, m in enumerate(part.joints.mode) if m < 7]
            )
        assert len(gaps[0]) >= 4
        assert np.abs(gaps).max() < 1e-10


class TestHandingOver:
    """A run in pieces is the run in one, but for errors of second order."""

    def test_pieces_before_the_first_impact(self):
        differences = []
        for dt in (2e-3, 1e-3, 5e-4):
            whole, pieces = (Part(arch(), pulse(0.5, 0.3), dt) for _ in range(2))
            whole.advance(0.4)
            for until in (0.1, 0.18, 0.26, 0.33, 0.4):
                assert pieces.advance(until) == Status.UNFINISHED
            assert pieces.time == pytest.approx(whole.time, abs=1e-9)
            assert np.abs(whole.velocity).max() > 0.1
            differences.append(
                [
                    np.abs(pieces.position - whole.position).max(),
                    np.abs(pieces.velocity - whole.velocity).max(),
                ]
            )
        differences = np.array(differences)
        assert (differences[0] < [2e-6, 2e-5]).all()
        # Half a kick and half a kick are a whole one: what is left is of a higher order.
        assert (differences[:-1] > 3.0 * differences[1:]).all()

    def test_energy_is_booked_through_every_change_of_hands(self):
        rng = np.random.default_rng(41)
        for _ in range(4):
            scene, motion = random_scene(rng)
            part = Part(scene, motion, 5e-4)
            rounding = 1e-14 * scene.chain.mass.sum() * g * 10.0
            status, hops, rested = Status.UNFINISHED, 0, 0.0
            while part.time < 3.0 and status != Status.COLLAPSED:
                status = part.advance(part.time + 0.0375)
                hops += 1
                energy = part.ledger.energy
                gained = energy[Energy.KINETIC] + energy[Energy.POTENTIAL]
                given = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
                given += energy[Energy.STRAY]
                largest = energy[Energy.LARGEST_KINETIC]
                assert gained == pytest.approx(given, abs=1e-9 * largest + rounding)
                assert status in (Status.UNFINISHED, Status.STANDING, Status.COLLAPSED)
                if status == Status.STANDING:
                    until, _ = leave_rest(part.chain, part.ground, part.stepper.rest, part.time)
                    rested += until - part.time
                    part.time = until
            assert hops > 10
            # What one step of free fall gives is within the error of leaving rest.
            fall = scene.chain.mass.sum() * (g * part.options.time_step) ** 2
            assert 0.0 < energy[Energy.STRAY_PEAK] < 1e-3 * largest + fall
            moving = part.ledger.model_time[Model.ALL_VOUSSOIRS]
            assert moving + rested == pytest.approx(part.time)


class TestReturn:
    """When it comes back."""

    def test_where_no_mode_has_changed_for_so_many_steps(self):
        calm = 12
        part = Part(arch(), pulse(0.5, 0.3), 1e-3)
        assert part.advance(10.0, calm) == Status.UNFINISHED
        assert part.ledger.count[Count.LOG_ENTRIES] > 0
        mode = part.joints.mode.copy()
        assert (mode != 7).sum() >= 4
        steps = part.ledger.count[Count.STEPS]
        assert calm < steps < 60
        part.advance(part.time + 5e-3)
        assert (part.joints.mode == mode).all()

    def test_at_rest_with_the_range_in_which_it_stays(self):
        part = Part(arch(), af.Motion(np.zeros(50), 0.01), 1e-3)
        assert part.advance(10.0) == Status.STANDING
        assert part.time == pytest.approx(1e-3)
        assert (part.velocity == 0.0).all()
        start = af.onset(arch())
        assert part.stepper.rest == pytest.approx([start.plus, start.minus], rel=1e-9)

    def test_when_it_has_collapsed(self):
        part = Part(arch(), pulse(0.9, 0.5), 1e-3)
        assert part.advance(10.0) == Status.COLLAPSED
        assert 0.3 < part.time < 3.0
