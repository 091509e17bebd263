"""Mega-voussoirs: assembled from joints' modes and split into voussoirs without loss."""

import numpy as np
import pytest

import archfrag as af
from archfrag.physics.contact.placing import clearance, corner_slip, move_faces
from archfrag.physics.mega_voussoirs.assemble import (
    assemble,
    gather_state,
    new_mega_voussoirs,
    split_state,
)
from archfrag.physics.state import model_of, new_work
from tests.physics.adapters import CLOSED, MINUS, OPEN, PLUS, Mode, set_modes, views_of
from tests.validation.scenes import oppenheim

INNER = Mode((0,))
OUTER = Mode((1,))
PATTERNS = {
    "four hinges": {0: OUTER, 2: INNER, 4: OUTER, 7: INNER},
    "split hinges": {0: OUTER, 2: INNER, 4: OUTER, 5: OUTER, 7: INNER},
    "every joint open": dict(
        enumerate([OUTER, INNER, INNER, OUTER, OUTER, INNER, OUTER, INNER])
    ),
    "a joint that slides without opening": {
        0: OUTER,
        3: Mode((0, 1), PLUS),
        5: INNER,
        7: OUTER,
    },
    "a corner that slides": {
        1: Mode((1,), MINUS),
        2: INNER,
        4: Mode((1,), PLUS),
        6: INNER,
    },
    "a part at rest beside a part in motion": {3: INNER, 4: OUTER, 5: INNER},
    "contact lost": {0: OUTER, 3: OPEN, 6: INNER, 7: OUTER},
}


@pytest.fixture(params=[(p, f) for p in PATTERNS for f in (False, True)], ids=str)
def moving(request):
    """Model, joints that move, slips; mega-voussoirs in a random motion, its voussoirs' states."""
    name, free_end = request.param
    arch = oppenheim()
    pattern = PATTERNS[name]
    if free_end:
        side = np.array([[0.5 - 0.01 * k, 1.0 * k] for k in range(9)])
        arch = af.Arch.from_joints(side, side - [[1.0, 0.0]], 0.7, free_end=True)
    model = model_of(arch.chain)
    rng = np.random.default_rng(2)
    contact = np.ones((arch.n_joint, 2))
    slide = np.zeros(arch.n_joint)
    set_modes([pattern.get(j, CLOSED) for j in range(arch.n_joint)], contact, slide)
    slip = rng.uniform(-0.05, 0.05, arch.n_joint)
    mega = new_mega_voussoirs(model)
    assemble(model, contact, slide, slip, mega)
    mega = views_of(mega)
    n = len(pattern) - (not free_end)
    assert (mega.count[0], mega.count[1]) == (mega.position.shape[0] - 2, len(pattern))
    assert mega.count[0] == n
    assert list(mega.joint[: len(pattern)]) == sorted(pattern)
    mega.position[1:-1] = np.column_stack([mega.model.centroid[1 : n + 1], np.zeros(n)])
    mega.position[1:-1] += rng.uniform(-0.3, 0.3, (n, 3))
    mega.velocity[1:-1] = rng.uniform(-1.0, 1.0, (n, 3))
    position, velocity = np.zeros((2, mega.group.size, 3))
    split_state(mega, mega.position, mega.velocity, position, velocity)
    return model, pattern, slip, mega, position, velocity


def momentum(mass, inertia, position, velocity):
    """Momentum along x and y, about the origin, and kinetic energy."""
    spin = mass * (position[:, 0] * velocity[:, 1] - position[:, 1] * velocity[:, 0])
    energy = mass @ (velocity[:, :2] ** 2).sum(1) + inertia @ velocity[:, 2] ** 2
    return [
        *(mass @ velocity[:, :2]),
        (spin + inertia * velocity[:, 2]).sum(),
        0.5 * energy,
    ]


def test_split_and_assembled_again_is_the_same_state(moving):
    model, _, _, mega, position, velocity = moving
    before = mega.position.copy(), mega.velocity.copy()
    mega.position[:] = 0.0
    mega.velocity[:] = 0.0
    gather_state(model, position, velocity, mega)
    assert mega.position == pytest.approx(before[0], abs=1e-13)
    assert mega.velocity == pytest.approx(before[1], abs=1e-12)


def test_momentum_and_energy_are_kept(moving):
    model, _, _, mega, position, velocity = moving
    rows = slice(mega.position.shape[0])
    bodies = mega.model.mass[rows], mega.model.inertia[rows]
    expected = momentum(*bodies, mega.position, mega.velocity)
    assert momentum(model.mass, model.inertia, position, velocity) == (
        pytest.approx(expected, rel=1e-12)
    )


def test_joints_inside_stay_closed(moving):
    model, pattern, slip, _, position, _ = moving
    work = new_work(model)
    move_faces(model, position, work)
    for j in set(range(len(slip))) - set(pattern):
        for k in range(2):
            assert clearance(j, k, work) == pytest.approx(0.0, abs=1e-13)
            apart = work.face[j, 1, k] - work.face[j, 0, k]
            found = corner_slip(j, tuple(apart), k == 0, work)
            assert found == pytest.approx(slip[j], abs=1e-13)
