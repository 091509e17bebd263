"""The midpoint step and ties of the kernels against their slow twin in plain numpy."""

import math

import numpy as np
import pytest

from archbench.paper import stepping
from archbench.paper.arch import full_motion, rotated
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.state import new_work
from archfrag.physics.status import Tie, TieWork
from tests.physics.adapters import Problem, framed, modes_of
from tests.physics.linkages import random_hinged_arch, rotate
from tests.physics.oracles import dense
from tests.physics.test_time_stepping import runs_of, step_through

STEP = 1e-3
GROUND = 1.5, -0.4  # acceleration [m/s2]


def stepped(arch, position, velocity):
    """Model, state and workspace of a chain after one step."""
    runs = runs_of(arch, (np.full(3, GROUND[0]), np.full(3, GROUND[1]), 0.1))
    runs.state.position[1:-1] = position
    runs.state.velocity[1:-1] = velocity
    worst = step_through(runs, np.array([STEP]), np.zeros(5, np.int64))
    assert math.isfinite(worst)
    return runs.model, runs.state, runs.work


@pytest.mark.parametrize("friction", [0.7, np.inf])
def test_a_step_goes_by_its_middle_and_aims_beyond_its_end(friction):
    rng = np.random.default_rng(4)
    aimed = 0
    for _ in range(12):
        arch, (position, velocity, _) = random_hinged_arch(rng, friction)
        model, state, work = stepped(arch, position, velocity)
        middle = stepping.middle_of(position, velocity, STEP)
        assert np.abs(work.position[1:-1] - middle).max() < 1e-12
        ground = STEP * GROUND[0], STEP * GROUND[1]
        free = stepping.free_velocity(velocity, ground, STEP, model.gravity)
        assert work.free[1:-1] == pytest.approx(free, abs=1e-12)
        end = stepping.end_of(middle, work.solved[1:-1], STEP)
        assert np.abs(state.position[1:-1] - end).max() < 1e-12
        there = new_work(model)
        bodies = framed(velocity)
        move_faces(model, work.position, there)
        for j, normal in enumerate(work.normal):
            for k, corner in enumerate(work.point[j]):
                pair = [(corner - work.position[i, :2], bodies[i]) for i in (j, j + 1)]
                offset = there.face[j, 1, k] - there.face[j, 0, k]
                if (
                    normal @ offset < -1e-9
                    or abs(rotated(normal) @ stepping.offset_at(1e-6, *pair)) > 1e-12
                ):
                    continue  # overlap is corrected slowly; a face that slides turns
                expected = normal @ stepping.contact_bias(
                    offset, STEP, 0.5 * STEP, *pair
                )
                assert normal @ work.bias[j, k] == pytest.approx(
                    expected, rel=1e-5, abs=1e-6
                )
                aimed += 1
    assert aimed > 50


def tie_rows(model, position):
    """Rates of elongation of ties by the velocities of bodies (k, 3 n), and elongations (k,)."""
    rows = np.zeros((len(model.tie), len(position), 3))
    stretch = []
    for row, tie in zip(rows, model.tie):
        bodies = tie[[Tie.BODY_0, Tie.BODY_1]].astype(int)
        arms = [
            rotate(tie[[x, x + 1]], position[body, 2])
            for x, body in zip((Tie.X_0, Tie.X_1), bodies)
        ]
        ends = [position[body, :2] + arm for body, arm in zip(bodies, arms)]
        length = np.linalg.norm(ends[1] - ends[0])
        line = (ends[1] - ends[0]) / length
        stretch.append(length - tie[Tie.LENGTH])
        for sense, body, arm in zip((-1.0, 1.0), bodies, arms):
            row[body] += sense * np.array([*line, rotated(arm) @ line])
    return rows[:, 1:-1].reshape(len(rows), -1), np.array(stretch)


def test_impulses_of_ties_are_those_of_their_law_in_all_modes():
    rng = np.random.default_rng(7)
    modes = set()
    while len(modes) < 3:
        arch, (position, velocity, _) = random_hinged_arch(rng, np.inf)
        low = arch.intrados[:, 1].min()
        high = arch.intrados[:, 1].max()
        for level in low + (high - low) * rng.uniform(0.2, 0.8, 2):
            arch = arch.tied(
                level=level, area=1e-4, strength=10.0 ** rng.uniform(3.0, 7.0)
            )
        model, _, work = stepped(arch, position, velocity)
        joints = modes_of(work)
        if any(mode.slip for mode in joints):
            continue
        inverse, rows, bias, _ = dense(Problem(model, work.position, work), joints)
        if len(rows) == rows.shape[1] or np.linalg.matrix_rank(rows) < len(rows):
            continue  # nothing moves, or reactions are not unique
        tie, stretch = tie_rows(model, work.position)
        free, _ = full_motion(
            inverse, rows, rows, bias, work.free[1:-1].ravel(), ease=0.0
        )
        answers = [
            full_motion(inverse, rows, rows, 0.0 * bias, -inverse * row, ease=0.0)[0]
            for row in tie
        ]
        found = stepping.tie_impulses(
            tie @ free,
            tie @ np.array(answers).T,
            tie @ velocity.ravel(),
            stretch,
            model.tie[:, Tie.STIFFNESS],
            model.tie[:, Tie.STRENGTH],
            STEP,
        )
        size = STEP * model.mass.sum() * model.gravity
        assert work.tie[:, TieWork.IMPULSE] == pytest.approx(
            found, rel=1e-6, abs=1e-9 * size
        )
        solved = free + found @ np.array(answers)
        assert work.solved[1:-1].ravel() == pytest.approx(
            solved, abs=1e-9 * np.abs(solved).max()
        )
        modes |= set(work.tie[:, TieWork.MODE].tolist())
