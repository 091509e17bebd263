"""The single block: its formulas, and the motions and reactions they give, by law.

The judge of the solved problems is the contact problem of a chain, which knows nothing of the
closed forms, posed on a chain of one body.
"""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as g
from archfrag.mechanics.block import formulas, plane
from archfrag.mechanics.block.formulas import CORNER_A, CORNER_B, RigidBlock, uniform_block
from archfrag.mechanics.block.motion import (
    LIFT_OFF,
    REST,
    ROCK,
    SLIDE,
    SLIDE_ROCK,
    Solutions,
    base_problem,
    corner_motion,
    corner_problem,
    starting_motion,
)
from archfrag.mechanics.block.regions import painleve_friction, rocking_friction, starting_region
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.blocks import EXACT
from archfrag.mechanics.contact.modes import solve_contact, start_modes
from archfrag.mechanics.contact.path import new_path, solve_by_path
from archfrag.mechanics.contact.placing import move_faces, place_contacts
from archfrag.mechanics.model import model_of, new_state, new_work
from archfrag.methods.time_stepping.motion import Kick
from archfrag.methods.time_stepping.service import clear
from archfrag.methods.time_stepping.step import pose_step
from tests.mechanics.adapters import Mode, Problem, solve

GRID = 400
STEP = 1e-4
NEAR = 1e-9
STILL = 2e-11
RIGHT, LEFT = 0, 1  # a chain's corners of the base: intrados and extrados
BASES = (0.2, 0.7, 2.5)  # b/h
VERTICAL = (0.0, 0.35)


def random_block(rng):
    """Any body with a flat base and its mass centre above it."""
    reaches = rng.uniform(0.1, 1.0, 2)
    return RigidBlock(rng.uniform(10, 1000), rng.uniform(5, 500), *reaches, rng.uniform(0.2, 2))


def vector(*values):
    return np.array(values)


@kernel
def motion_name(x, y, rotation, rise, reach):
    """Motion by velocities (or accelerations over g) of a block that stood flat."""
    slip = x + rise * rotation
    if min(y + reach * rotation, y - reach * rotation) > STILL:
        return LIFT_OFF
    if abs(rotation) * reach > STILL:
        return ROCK if abs(slip) <= STILL else SLIDE_ROCK
    return REST if abs(slip) <= STILL else SLIDE


@kernel
def set_friction(model, friction):
    model.friction[0] = friction
    model.ray[0, 0], model.ray[0, 1] = 1.0, friction


@kernel
def pose_accelerations(model, state, work, ground_x, ground_y):
    """Pose the contact problem of the accelerations over g of a block that stands."""
    place_contacts(model, state.slip, work.face, work.tangent, work)
    work.free[1, 0], work.free[1, 1], work.free[1, 2] = -ground_x, -1.0 - ground_y, 0.0
    work.slide[0] = 0.0
    for k in range(2):
        work.bias[0, k, 0] = work.bias[0, k, 1] = 0.0
        work.candidate[0, k] = work.touch[0, k] = 1.0


@kernel
def solved_motion(model, state, work, path, block, speed):
    """Motion of the problem posed, velocities counted over `speed`; -1 if none is found."""
    solved, _, _, _ = solve_contact(model, state.position, work, True, 0.0, -1.0, EXACT)
    if not solved:
        solved, _, _, _ = solve_by_path(model, state.position, work, path, True)
    x, y, rotation = work.solved[1, 0], work.solved[1, 1], work.solved[1, 2]
    name = motion_name(x / speed, y / speed, rotation / speed, block.rise, block.reach_a)
    return name if solved else -1


@kernel
def first_motions(model, state, work, path, block, ground_x, ground_y, friction, found):
    """Motion that starts at each point, four times: region, block problem, contact problem, step.

    `friction` and `ground_x` (n,); `found` (n, 4) is overwritten.
    """
    clear(state)
    move_faces(model, state.position, work.rotated, work.face, work.tangent)
    speed = STEP * model.gravity
    for i in range(ground_x.size):
        set_friction(model, friction[i])
        set_friction(path.model, friction[i])
        found[i, 0] = starting_region(block, ground_x[i], ground_y, friction[i])[0]
        start = starting_motion(block, ground_x[i], ground_y, friction[i], 1.0)
        found[i, 1] = start.mechanism if start.solutions == 1 else -1
        pose_accelerations(model, state, work, ground_x[i], ground_y)
        found[i, 2] = solved_motion(model, state, work, path, block, 1.0)
        kick = Kick(speed * ground_x[i], speed * ground_y)
        pose_step(model, state, work, kick, STEP, STEP)
        start_modes(state, work, True, False)
        found[i, 3] = solved_motion(model, state, work, path, block, speed)


def border_distance(base, ground_x, ground_y, friction):
    """Distance from the borders of the regions in units of k_s / (1 + k_v) and mu."""
    block = uniform_block(base, 1.0, 1.0)
    load = np.abs(ground_x) / (1.0 + ground_y)
    tipping = np.array([rocking_friction(block, CORNER_A, q) for q in load])
    return np.minimum.reduce(
        [
            np.abs(load - np.minimum(friction, base)),
            np.where(load >= base, np.abs(friction - tipping), np.inf),
            np.where(load >= friction, np.abs(friction - base), np.inf),
        ]
    )


def all_first_motions(base, ground_x, ground_y, friction):
    chain = af.Block(base, 1.0, friction=1.0).chain
    block = RigidBlock(chain.mass[0], chain.inertia[0], 0.5 * base, 0.5 * base, 0.5)
    model = model_of(chain)
    state, work, path = new_state(model), new_work(model), new_path(model)
    state.position[1, :2] = chain.centroid[0]
    found = np.zeros((ground_x.size, 4), np.int64)
    first_motions(model, state, work, path, block, ground_x, ground_y, friction, found)
    return found


class TestRegions:
    @pytest.mark.parametrize("base", BASES)
    @pytest.mark.parametrize("ground_y", VERTICAL)
    def test_four_forms_give_the_same_motion(self, base, ground_y):
        reach = 2.5 * max(base, 0.4)
        load, friction = np.meshgrid(np.linspace(-reach, reach, GRID), np.linspace(0, reach, GRID))
        load, friction = load.ravel(), friction.ravel()
        ground_x = load * (1.0 + ground_y)
        away = border_distance(base, ground_x, ground_y, friction) > NEAR
        assert np.count_nonzero(away) > 0.99 * away.size
        found = all_first_motions(base, ground_x, ground_y, friction)[away]
        assert set(found[:, 0]) == {REST, SLIDE, ROCK, SLIDE_ROCK}
        assert (np.bincount(found[:, 0])[:4] > 0.002 * away.size).all()
        for form in (1, 2, 3):
            assert np.array_equal(found[:, form], found[:, 0])

    @pytest.mark.parametrize("base", BASES)
    @pytest.mark.parametrize("ground_y", VERTICAL)
    def test_right_up_to_their_borders(self, base, ground_y):
        block = uniform_block(base, 1.0, 1.0)
        rng = np.random.default_rng(3)
        low, high = base * rng.uniform(0.02, 0.98, 200), base * rng.uniform(1.02, 4.0, 200)
        curve = np.array([rocking_friction(block, CORNER_A, q) for q in high])
        level = np.full(200, base)
        borders = [
            (low, low, (1, -1)),
            (level, high, (1, 0)),
            (high, level, (0, 1)),
            (high, curve, (0, 1)),
        ]
        for load, friction, across in borders:
            for shift in (-3 * NEAR, 3 * NEAR):
                sign = rng.choice([-1, 1], 200)
                ground_x = sign * (load + shift * across[0]) * (1.0 + ground_y)
                beside = friction + shift * across[1]
                assert (border_distance(base, ground_x, ground_y, beside) > NEAR).all()
                found = all_first_motions(base, ground_x, ground_y, beside)
                assert len(set(found[:, 0])) == 1
                for form in (1, 2, 3):
                    assert np.array_equal(found[:, form], found[:, 0])

    def test_nothing_holds_a_block_whose_ground_falls_faster_than_itself(self):
        ground_x, friction = np.linspace(-2.0, 2.0, 101), np.full(101, 0.5)
        for ground_y in (-1.0, -1.2, -3.0):
            found = all_first_motions(0.5, ground_x, ground_y, friction)
            assert (found[:, :2] == LIFT_OFF).all()
            if ground_y < -1.0:
                assert (found == LIFT_OFF).all()
        heavy = all_first_motions(0.5, ground_x, -0.999, friction)
        assert LIFT_OFF not in heavy

    def test_mirrored_ground_starts_the_mirrored_motion(self):
        rng = np.random.default_rng(8)
        for _ in range(300):
            block = random_block(rng)
            mirror = block._replace(reach_a=block.reach_b, reach_b=block.reach_a)
            ground_x, ground_y = rng.uniform(-2, 2), rng.uniform(-0.9, 1)
            friction = rng.uniform(0.0, 2.0)
            right = starting_motion(block, ground_x, ground_y, friction, g)
            left = starting_motion(mirror, -ground_x, ground_y, friction, g)
            assert right.mechanism == left.mechanism
            assert right.side == -left.side
            assert vector(right.x, right.y, right.rotation) == pytest.approx(
                vector(-left.x, left.y, -left.rotation), rel=1e-12, abs=1e-12
            )
            assert right.centre == pytest.approx(1.0 - left.centre, abs=1e-12)

    def test_contact_centre_moves_to_the_corner_as_the_load_grows(self):
        block = uniform_block(0.2, 1.0, 100.0)
        loads = np.linspace(-0.2, 0.2, 41)
        centres = [starting_motion(block, q, 0.0, 0.9, g).centre for q in loads]
        assert centres == pytest.approx(0.5 - 0.5 * loads / 0.2, abs=1e-12)
        assert starting_motion(block, 0.15, 0.5, 0.9, g).centre == pytest.approx(0.25)
        assert starting_motion(block, 0.9, 0.0, 0.9, g).centre == 0.0
        sliding = starting_motion(block, 0.9, 0.0, 0.1, g)
        assert sliding.centre == pytest.approx(0.25)


class TestGradients:
    """Eqs 1 to 4 and 17: the metric of kinetic energy."""

    def test_gradient_maps_velocity_to_the_point(self):
        rng = np.random.default_rng(1)
        for _ in range(50):
            block = random_block(rng)
            place, rotation = rng.uniform(-1, 1, 2), rng.uniform(-1, 1)
            x, y, tilt = rng.uniform(-1, 1, 3)
            arm = formulas.rotated_arm(*place, rotation)
            n_t = formulas.tangential_gradient(block, arm)
            n_n = formulas.normal_gradient(block, arm)
            velocity = formulas.generalised(block, x, y, tilt)
            d = 1e-6
            later = vector(*formulas.rotated_arm(*place, rotation + d * tilt))
            sooner = vector(*formulas.rotated_arm(*place, rotation - d * tilt))
            moved = vector(x, y) + (later - sooner) / (2 * d)
            assert formulas.point_velocity(n_t, n_n, velocity) == pytest.approx(moved, abs=1e-9)
            kinetic = block.mass * (x * x + y * y) + block.inertia * tilt * tilt
            assert formulas.dot(velocity, velocity) == pytest.approx(kinetic)
            assert formulas.physical(block, velocity) == pytest.approx((x, y, tilt))
            for rate, gradient in (
                (formulas.tangential_gradient_rate, formulas.tangential_gradient),
                (formulas.normal_gradient_rate, formulas.normal_gradient),
            ):
                slope = vector(*gradient(block, later)) - vector(*gradient(block, sooner))
                assert rate(block, arm, tilt) == pytest.approx(slope / (2 * d), abs=1e-8)

    def test_reaction_has_the_same_power_in_both_spaces(self):
        rng = np.random.default_rng(2)
        block = random_block(rng)
        arm = formulas.corner_arm(block, CORNER_B, 0.3)
        n_t, n_n = (
            f(block, arm) for f in (formulas.tangential_gradient, formulas.normal_gradient)
        )
        velocity = formulas.generalised(block, *rng.uniform(-1, 1, 3))
        rate_t, rate_n = formulas.point_velocity(n_t, n_n, velocity)
        psi_t, psi_n = formulas.generalised_reaction(n_t, n_n, 3.0, 7.0)
        assert formulas.dot(psi_t, velocity) == pytest.approx(3.0 * rate_t)
        assert formulas.dot(psi_n, velocity) == pytest.approx(7.0 * rate_n)

    def test_admissible_velocities_keep_the_full_base_out_of_the_ground(self):
        rng = np.random.default_rng(4)
        signs = set()
        for _ in range(200):
            block = random_block(rng)
            x, y, tilt = rng.uniform(-1, 1, 3)
            places = np.linspace(-block.reach_a, block.reach_b, 50)
            least = formulas.least_normal_velocity(block, formulas.generalised(block, x, y, tilt))
            assert least == pytest.approx((y + places * tilt).min())
            signs.add(least > 0)
        assert signs == {True, False}


class TestCoulomb:
    def test_friction_of_a_sliding_contact_dissipates_most(self):
        rng = np.random.default_rng(5)
        for _ in range(200):
            block = random_block(rng)
            n_t = formulas.tangential_gradient(block, formulas.corner_arm(block, CORNER_A, 0.2))
            velocity = formulas.generalised(block, *rng.uniform(-1, 1, 3))
            normal, friction = rng.uniform(0, 10), rng.uniform(0, 1)
            slip = formulas.dot(n_t, velocity)
            right = -math.copysign(friction * normal, slip)
            for other in rng.uniform(-friction * normal, friction * normal, 20):
                assert (
                    formulas.least_dissipation_excess(n_t, velocity, normal, other, friction) < 0.0
                )
            least = formulas.least_dissipation_excess(n_t, velocity, normal, right, friction)
            assert least == pytest.approx(0.0, abs=1e-12)


class TestPlane:
    """Eqs 16 to 20 and Figs 4 to 7."""

    def frame(self, rng):
        block = random_block(rng)
        arm = formulas.corner_arm(block, rng.choice([CORNER_A, CORNER_B]), rng.uniform(-0.5, 0.5))
        omega = rng.uniform(-2, 2)
        gradients = [
            f(block, arm) for f in (formulas.tangential_gradient, formulas.normal_gradient)
        ]
        rates = [
            f(block, arm, omega)
            for f in (formulas.tangential_gradient_rate, formulas.normal_gradient_rate)
        ]
        return block, arm, omega, gradients, rates, plane.rocking_mechanism(block, arm, omega)

    def test_mechanism_is_orthogonal_to_the_plane(self):
        rng = np.random.default_rng(6)
        for _ in range(50):
            block, arm, omega, (n_t, n_n), rates, mechanism = self.frame(rng)
            assert formulas.point_velocity(n_t, n_n, mechanism) == pytest.approx((0, 0), abs=1e-12)
            total = vector(*plane.centripetal_acceleration(n_t, n_n, *rates, mechanism)).sum(
                axis=0
            )
            root = math.sqrt(block.mass)
            assert total == pytest.approx(
                omega**2 * vector(root * arm[0], root * arm[1], 0.0), abs=1e-9
            )
            assert formulas.dot(total, mechanism) == pytest.approx(0.0, abs=1e-9)
            assert plane.contact_acceleration(
                n_t, n_n, *rates, mechanism, tuple(total)
            ) == pytest.approx((0.0, 0.0), abs=1e-9)

    def test_reactions_hold_the_contact_point_and_close_the_balance_in_the_plane(self):
        rng = np.random.default_rng(7)
        for _ in range(50):
            block, _, _, (n_t, n_n), rates, mechanism = self.frame(rng)
            active = formulas.active_force(block, *rng.uniform(-0.5, 0.5, 2), g)
            on_t, on_n = plane.centripetal_projections(*rates, mechanism)
            held = plane.sticking_reaction(n_t, n_n, active, on_t, on_n)
            psi_t, psi_n = formulas.generalised_reaction(n_t, n_n, *held)
            total = vector(active) + psi_t + psi_n
            assert plane.contact_acceleration(
                n_t, n_n, *rates, mechanism, tuple(total[0])
            ) == pytest.approx((0.0, 0.0), abs=1e-9)
            in_plane = vector(*plane.centripetal_acceleration(n_t, n_n, *rates, mechanism))
            left = in_plane.sum(axis=0) - plane.part_in_plane(active, mechanism)
            assert left == pytest.approx(vector(psi_t)[0] + vector(psi_n)[0], abs=1e-7)

    def test_sliding_direction_splits_along_the_motion_and_across_it(self):
        rng = np.random.default_rng(10)
        block, _, _, (n_t, n_n), _, mechanism = self.frame(rng)
        slid = formulas.combine(1.0, mechanism, 1.0, formulas.generalised(block, 0.7, 0.0, 0.0))
        along, across = plane.split_along(n_t, slid)
        assert vector(*along) + across == pytest.approx(n_t)
        assert formulas.dot(across, slid) == pytest.approx(0.0, abs=1e-12)
        assert formulas.dot(along, slid) == pytest.approx(0.7)
        assert formulas.dot(n_n, slid) == pytest.approx(0.0, abs=1e-12)
        assert formulas.dot(across, n_n) == pytest.approx(formulas.dot(n_t, n_n))


def contact_answer(block, corners, rotation, free, friction, bias, slip):
    """The contact problem of a chain of one body that touches flat ground at `corners`."""
    point, touching = np.zeros((1, 2, 2)), np.zeros((1, 2), bool)
    for corner, side in ((RIGHT, CORNER_B), (LEFT, CORNER_A)):
        point[0, corner] = formulas.corner_arm(block, side, rotation)
        touching[0, corner] = side in corners
    up, sense = np.array([[0.0, 1.0]]), int(np.sign(slip))
    return solve(
        Problem(
            mass=vector(block.mass),
            inertia=vector(block.inertia),
            centroid=np.zeros((1, 2)),
            point=point,
            normal=up,
            normal_plus=np.stack([up, up], axis=1),
            normal_minus=np.stack([up, up], axis=1),
            touching=touching,
            sliding=vector(sense),
            bias=-(bias**2) * point,
            friction=vector(friction),
            free=free[None],
            start=[Mode(tuple(np.flatnonzero(touching[0])), sense)],
        )
    )


def least_painleve_friction(block):
    return min(painleve_friction(block, side, 0.0) for side in (CORNER_A, CORNER_B))


def same_answer(found, answer, block, rotation, scale):
    assert answer.solved
    motion, reaction = answer.velocity[0], answer.wrench[0]
    assert vector(found.x, found.y) == pytest.approx(motion[:2], abs=1e-9 * scale)
    size = math.sqrt(block.inertia / block.mass)
    assert size * found.rotation == pytest.approx(size * motion[2], abs=1e-9 * scale)
    forces = vector(found.tangential, found.normal)
    assert forces == pytest.approx(reaction[:2], abs=1e-9 * block.mass * scale)
    if found.normal > 1e-6 * block.mass * scale:
        place = found.centre * (block.reach_a + block.reach_b) - block.reach_a
        x, y = formulas.rotated_arm(place, -block.rise, rotation)
        moment = x * found.normal - y * found.tangential
        assert moment == pytest.approx(reaction[2], abs=1e-9 * block.mass * size * scale)


class TestContactProblem:
    """The block's own answers against the contact problem, over random states."""

    def test_reactions_in_motion_about_a_corner(self):
        rng = np.random.default_rng(21)
        seen = {}
        for _ in range(3000):
            block = random_block(rng)
            side = int(rng.choice([CORNER_A, CORNER_B]))
            rotation, omega = -side * rng.uniform(0, 1.2), rng.uniform(-4, 4)
            slip = rng.choice([0.0, 1.0, -1.0]) * rng.uniform(0.1, 2)
            ground = rng.uniform(-1.5, 1.5, 2) * (1.0, 0.6)
            friction = rng.uniform(0, 1.2) if rng.random() < 0.9 else math.inf
            found = corner_motion(block, side, rotation, omega, slip, *ground, friction, g)
            seen[found.mechanism, found.solutions] = (
                seen.get((found.mechanism, found.solutions), 0) + 1
            )
            if found.solutions != Solutions.ONE:
                assert friction > painleve_friction(block, side, rotation)
                continue
            if slip and math.isinf(friction):
                continue
            free = g * vector(-ground[0], -1.0 - ground[1], 0.0)
            answer = contact_answer(block, (side,), rotation, free, friction, omega, slip)
            reach = math.hypot(formulas.reach(block, side), block.rise)
            same_answer(found, answer, block, rotation, 2 * g + omega**2 * reach)
        assert all(seen[kind, 1] > 200 for kind in (ROCK, SLIDE_ROCK, LIFT_OFF)), seen

    def test_start_and_sliding_on_the_full_base(self):
        rng = np.random.default_rng(22)
        seen = set()
        for _ in range(2000):
            block = random_block(rng)
            ground, friction = rng.uniform(-1.5, 1.5, 2) * (1.0, 0.8), rng.uniform(0, 1.2)
            slip = rng.choice([0.0, 1.0, -1.0])
            found = base_problem(block, formulas.active_force(block, *ground, g), friction, slip)
            if found.solutions != Solutions.ONE:
                assert friction > least_painleve_friction(block)
                continue
            seen.add((found.mechanism, bool(slip)))
            free = g * vector(-ground[0], -1.0 - ground[1], 0.0)
            answer = contact_answer(block, (CORNER_A, CORNER_B), 0.0, free, friction, 0.0, slip)
            same_answer(found, answer, block, 0.0, 2 * g)
        every = {(kind, False) for kind in (REST, SLIDE, ROCK, SLIDE_ROCK, LIFT_OFF)}
        assert seen == every | {(kind, True) for kind in (SLIDE, SLIDE_ROCK, LIFT_OFF)}

    @pytest.mark.parametrize("flat", [True, False])
    def test_impacts(self, flat):
        rng = np.random.default_rng(23)
        seen = {}
        for _ in range(3000):
            block = random_block(rng)
            before = rng.normal(size=3) * (1.0, 0.5, 2.0) - (0.0, 0.5, 0.0)
            friction = rng.uniform(0, 1.2) if rng.random() < 0.9 else math.inf
            side, rotation = int(rng.choice([CORNER_A, CORNER_B])), 0.0
            start = formulas.generalised(block, *before)
            if flat:
                found = base_problem(block, start, friction, 0.0)
            else:
                rotation = -side * rng.uniform(0, 1.2)
                found = corner_problem(block, side, rotation, start, 0.0, 0.0, friction, 0.0)
            seen[found.mechanism] = seen.get(found.mechanism, 0) + 1
            assert found.solutions != Solutions.NONE
            if found.solutions != Solutions.ONE:
                corner = painleve_friction(block, side, rotation)
                assert friction > (least_painleve_friction(block) if flat else corner)
                continue
            if math.isinf(friction):
                continue
            corners = (CORNER_A, CORNER_B) if flat else (side,)
            answer = contact_answer(block, corners, rotation, before, friction, 0.0, 0.0)
            same_answer(found, answer, block, rotation, np.abs(before).max())
        kinds = (REST, SLIDE, ROCK, SLIDE_ROCK, LIFT_OFF) if flat else (ROCK, SLIDE_ROCK, LIFT_OFF)
        assert all(seen.get(kind, 0) > 20 for kind in kinds), seen


class TestEnergy:
    def test_no_impact_gains_energy_and_the_work_of_impulses_is_what_is_lost(self):
        rng = np.random.default_rng(32)
        lost = []
        for _ in range(500):
            block = random_block(rng)
            before = rng.normal(size=3) - (0.0, 0.5, 0.0)
            start = formulas.generalised(block, *before)
            found = base_problem(block, start, rng.uniform(0, 1.2), 0.0)
            end = formulas.generalised(block, found.x, found.y, found.rotation)
            change = 0.5 * (formulas.dot(end, end) - formulas.dot(start, start))
            assert change <= 1e-12
            if math.isnan(found.centre):
                continue
            place = found.centre * (block.reach_a + block.reach_b) - block.reach_a
            arm = (place, -block.rise)
            n_t = formulas.tangential_gradient(block, arm)
            n_n = formulas.normal_gradient(block, arm)
            xi = formulas.generalised_reaction(n_t, n_n, found.tangential, found.normal)
            assert formulas.impulsive_balance(start, end, *xi, (0.3, 0.1, -0.7)) == pytest.approx(
                0.0, abs=1e-8
            )
            work = found.normal * formulas.dot(n_n, end)
            assert work == pytest.approx(0.0, abs=1e-8)
            lost.append(change)
        assert min(lost) < -1.0
