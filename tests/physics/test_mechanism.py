"""Mega-voussoirs: assembled and split without loss, and their reactions by the two levels."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.contact.placing import (
    clearance,
    corner_slip,
    move_faces,
)
from archfrag.mechanics.mega_voussoirs.assemble import (
    assemble,
    gather_state,
    new_mega_voussoirs,
    split_state,
)
from archfrag.mechanics.model import model_of, new_work
from tests.mechanics.adapters import CLOSED, MINUS, OPEN, PLUS, Mode, set_modes, views_of
from tests.validation.scenes import oppenheim

INNER, OUTER = Mode((0,)), Mode((1,))
PATTERNS = {
    "four hinges": {0: OUTER, 2: INNER, 4: OUTER, 7: INNER},
    "split hinges": {0: OUTER, 2: INNER, 4: OUTER, 5: OUTER, 7: INNER},
    "every joint open": dict(enumerate([OUTER, INNER, INNER, OUTER, OUTER, INNER, OUTER, INNER])),
    "a joint that slides without opening": {0: OUTER, 3: Mode((0, 1), PLUS), 5: INNER, 7: OUTER},
    "a corner that slides": {1: Mode((1,), MINUS), 2: INNER, 4: Mode((1,), PLUS), 6: INNER},
    "a part at rest beside a part in motion": {3: INNER, 4: OUTER, 5: INNER},
    "contact lost": {0: OUTER, 3: OPEN, 6: INNER, 7: OUTER},
}


def rigid_state(mega, rng, size=0.02):
    """Random positions and velocities of mega-voussoirs, and of their voussoirs."""
    n = mega.count[0]
    mega.position[1 : n + 1, :2] = mega.model.centroid[1 : n + 1]
    mega.position[1 : n + 1, 2] = 0.0
    mega.position[1 : n + 1] += rng.uniform(-size, size, (n, 3))
    mega.velocity[1 : n + 1] = rng.uniform(-1.0, 1.0, (n, 3))
    position, velocity = np.zeros((2, mega.group.size, 3))
    split_state(mega, mega.position, mega.velocity, position, velocity)
    return position, velocity


def momentum(model, position, velocity):
    """Momentum, and moment of momentum about the origin."""
    linear = (model.mass[:, None] * velocity[:, :2]).sum(0)
    spin = model.mass * (position[:, 0] * velocity[:, 1] - position[:, 1] * velocity[:, 0])
    return np.append(linear, (spin + model.inertia * velocity[:, 2]).sum())


def kinetic(model, velocity):
    return 0.5 * (model.mass @ (velocity[:, :2] ** 2).sum(1) + model.inertia @ velocity[:, 2] ** 2)


@pytest.mark.parametrize("free_end", [False, True])
@pytest.mark.parametrize("pattern", PATTERNS.values(), ids=PATTERNS.keys())
class TestGrouping:
    def build(self, pattern, free_end, slips=0.0):
        arch = oppenheim()
        if free_end:
            side = np.array([[0.5 - 0.01 * k, 1.0 * k] for k in range(9)])
            arch = af.Arch.from_joints(side, side - [[1.0, 0.0]], 0.7, free_end=True)
        model = model_of(arch.chain)
        n_joint = model.friction.size
        contact, slide, mega = np.ones((n_joint, 2)), np.zeros(n_joint), new_mega_voussoirs(model)
        modes = [pattern.get(j, CLOSED) for j in range(n_joint)]
        set_modes(modes, contact, slide)
        slip = np.random.default_rng(1).uniform(-slips, slips, n_joint)
        assemble(model, contact, slide, slip, mega)
        return model, modes, slip, views_of(mega)

    def test_as_many_bodies_as_move(self, pattern, free_end):
        *_, mega = self.build(pattern, free_end)
        assert mega.count[1] == mega.work.slip.size == len(pattern)
        assert mega.count[0] == mega.position.shape[0] - 2 == len(pattern) - (not free_end)
        assert list(mega.joint[: len(pattern)]) == sorted(pattern)

    def test_split_and_assembled_again_is_the_same_state(self, pattern, free_end):
        model, _, _, mega = self.build(pattern, free_end, slips=0.05)
        position, velocity = rigid_state(mega, np.random.default_rng(2))
        before = mega.position.copy(), mega.velocity.copy()
        mega.position[:], mega.velocity[:] = 0.0, 0.0
        gather_state(model, position, velocity, mega)
        assert mega.position == pytest.approx(before[0], abs=1e-13)
        assert mega.velocity == pytest.approx(before[1], abs=1e-12)

    def test_momentum_and_energy_are_kept(self, pattern, free_end):
        model, _, _, mega = self.build(pattern, free_end, slips=0.05)
        position, velocity = rigid_state(mega, np.random.default_rng(3))
        rows = mega.position.shape[0]
        bodies = mega.model._replace(
            mass=mega.model.mass[:rows], inertia=mega.model.inertia[:rows]
        )
        expected = momentum(bodies, mega.position, mega.velocity)
        assert momentum(model, position, velocity) == pytest.approx(expected, rel=1e-12)
        expected = kinetic(bodies, mega.velocity)
        assert kinetic(model, velocity) == pytest.approx(expected, rel=1e-12)

    def test_joints_inside_stay_closed(self, pattern, free_end):
        model, modes, slip, mega = self.build(pattern, free_end, slips=0.05)
        position, _ = rigid_state(mega, np.random.default_rng(4), size=0.5)
        work = new_work(model)
        move_faces(model, position, work.rotated, work.face, work.tangent)
        for j in (j for j, mode in enumerate(modes) if mode == CLOSED):
            for k in range(2):
                assert clearance(j, k, work.face, work.tangent) == pytest.approx(0.0, abs=1e-13)
                apart = work.face[j, 1, k] - work.face[j, 0, k]
                found = corner_slip(j, *apart, k == 0, work.tangent)
                assert found == pytest.approx(slip[j], abs=1e-13)
