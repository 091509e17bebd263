"""Second level: reactions propagated from joint to joint inside mega-voussoirs (Eqs 34, 35),
against the contact problem of all voussoirs and against the balance itself."""

from collections import Counter

import numpy as np
import pytest

from archbench.paper.arch import contact_centre
from tests.physics.adapters import CLOSED, OPEN, Posed
from tests.physics.linkages import random_hinged_arch
from tests.physics.oracles import balance_error, balanced, corner_forces, law_violation

g = 9.80665


def states(seed, friction, count):
    """Arches in motion on four hinges under pushes that keep or break their mechanism."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        arch, state = random_hinged_arch(rng, friction)
        push = rng.uniform(-1.5, 1.5) * g
        lift = rng.uniform(-0.3, 0.3) * g
        yield Posed(arch.chain, *state, push, lift)


def assert_same(posed, theirs):
    """Both levels in the modes of the contact problem: its motion, its reactions, its laws."""
    followed = posed.with_modes(theirs.modes)
    ours = followed.by_levels()
    problem = posed.problem
    assert ours.solved
    assert law_violation(problem, ours) < 1e-9
    assert balance_error(problem, ours) < 1e-11
    scale = np.abs(theirs.velocity).max() + g
    assert np.abs(ours.velocity - theirs.velocity).max() < 1e-9 * scale
    force = np.abs(theirs.wrench).max()
    assert np.abs(ours.wrench - theirs.wrench).max() < 1e-9 * force
    assert followed.margins()[1] > -1e-9 * force
    # Where it bears, a reaction meets its closed joint between both ends (Eq 34).
    for wrench, face, touching in zip(
        ours.wrench, problem.work.point, problem.work.candidate
    ):
        if np.hypot(*wrench[:2]) > 1e-3 * force and touching.all():
            assert -1e-6 < contact_centre(wrench, face) < 1.0 + 1e-6


@pytest.mark.parametrize("friction", [0.36, 0.7, np.inf])
class TestAgainstTheContactProblem:
    def test_motion_and_reactions_are_the_same_where_reactions_are_unique(
        self, friction
    ):
        count = Counter()
        for posed in states(11, friction, 90):
            problem = posed.problem
            theirs = posed.by_contact_problem()
            assert theirs.solved
            assert law_violation(problem, theirs) < 1e-9
            unknown = sum(
                len(mode.corners) + (mode != OPEN and not mode.slip)
                for mode in theirs.modes
            )
            if unknown > problem.work.free[1:-1].size:
                count["not unique"] += 1
                continue
            count["new modes"] += theirs.modes != posed.modes
            assert_same(posed, theirs)
        assert count["not unique"] <= 10
        assert count["new modes"] >= 60


@pytest.mark.parametrize("friction", [0.36, 0.7, np.inf])
class TestMarginsInside:
    """What is left of the laws at closed joints, from the contact centre of Eq 34."""

    def test_are_those_of_the_dense_balance_and_end_where_modes_change(self, friction):
        kept = broken = 0
        for posed in states(12, friction, 90):
            modes = posed.modes
            problem = posed.problem
            forces = corner_forces(problem, balanced(problem, modes))
            value, least = posed.margins()
            inside = [j for j, mode in enumerate(modes) if mode == CLOSED]
            size = np.abs(forces).max()
            press = forces[:, :2].sum(1)
            shear = forces[:, 2]
            expected = np.full((len(modes), 2), np.inf)
            if np.isfinite(friction):
                expected = np.stack(
                    [friction * press - shear, friction * press + shear], axis=1
                )
            expected = np.hstack([forces[:, :2], expected])
            assert value[inside] == pytest.approx(expected[inside], abs=1e-9 * size)
            assert np.isnan(np.delete(value, inside, axis=0)).all()
            assert least == min(value[inside].ravel(), default=np.inf)
            solved = posed.by_contact_problem().modes
            if least < -1e-9 * size:
                broken += 1
                assert solved != modes
            else:
                kept += all(solved[j] == CLOSED for j in inside)
        assert broken > 40
        assert kept > 1
