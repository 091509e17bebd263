"""Random states of arches for the contact problem: resting, hinged, sliding, at impact."""

import numpy as np

import archfrag as af
from archfrag.mechanics.contact.placing import move_faces, place_contacts
from archfrag.mechanics.model import model_of, new_work
from tests.mechanics.adapters import CLOSED, Mode, problem_in, set_modes
from tests.mechanics.linkages import rotate

KINDS = ("resting", "hinged", "sliding", "impact")


def random_ring(rng, n, mu):
    """An arch of n straight-sided voussoirs of different lengths."""
    radius = 10.0
    thickness = radius * rng.uniform(0.08, 0.3)
    embrace = np.deg2rad(rng.uniform(60, 180))
    cuts = np.sort(rng.uniform(0.3, 1.0, n).cumsum())
    angles = np.pi / 2 + embrace / 2 - embrace * np.concatenate([[0], cuts / cuts[-1]])
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return af.Arch.from_joints((radius - thickness / 2) * ray, (radius + thickness / 2) * ray, mu)


def random_state(rng, n, mu, kind):
    """One contact problem of n voussoirs; the last springing follows wherever joints lead it."""
    model = model_of(random_ring(rng, n, mu).chain)
    modes, slip, opened = [CLOSED] * (n + 1), np.zeros(n + 1), np.zeros(n + 1)
    if kind != "resting":
        opened = rng.choice([0, -1, 1], n + 1, p=[0.5, 0.25, 0.25])  # about corner 0, about 1
        modes = [Mode(((sense + 1) // 2,)) if sense else CLOSED for sense in opened]
        opened = opened * 10 ** rng.uniform(-3, -0.7, n + 1)
    if kind == "sliding":
        slip = np.where(rng.random(n + 1) < 0.3, rng.uniform(-0.05, 0.05, n + 1), 0.0)
    work, position = new_work(model), np.zeros((n + 2, 3))
    before = model.corner[0, 0]
    for j, angle in enumerate(np.cumsum(opened)):
        tangent = (before[1] - before[0]) / np.linalg.norm(before[1] - before[0])
        corner = modes[j].corners[0]
        vertex = before[corner] + slip[j] * tangent
        position[j + 1, :2] = vertex - rotate(model.corner[j, 1, corner], angle)
        position[j + 1, 2] = angle
        if j < n:
            before = position[j + 1, :2] + rotate(model.corner[j + 1, 0], angle)
    work.rotated[-1] = np.cos(angle), np.sin(angle)
    move_faces(model, position, work.rotated, work.face, work.tangent)
    place_contacts(model, slip, work.face, work.tangent, work)
    set_modes(modes, work.contact, work.slide)
    work.candidate[:] = work.contact
    work.free[1:-1] = rng.uniform(-9.81, 9.81), -9.81 * (1 + rng.uniform(-0.3, 0.3)), 0.0
    if kind == "impact":
        work.free[1:-1] = rng.normal(size=(n, 3)) * [1.0, 1.0, 0.3] * rng.uniform(0.01, 1)
    return problem_in(model, position, work)
