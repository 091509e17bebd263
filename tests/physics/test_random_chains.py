"""Irregular chains under random motions: laws in every frame, verdicts by two methods.

A scene follows from its seed alone: an arch of 2 to 15 voussoirs, one in ten a free-standing
column, no two joints alike; 2 to 4 s of motion, one to five times what starts the chain.
"""

import numpy as np
import pytest

import archfrag as af
from archbench.measures import energy_gain, overlaps
from archfrag.errors import GeometryError
from archfrag.physics.status import Status
from tests.validation.scenes import g

ANSWERS = Status.STANDING, Status.COLLAPSED, Status.UNFINISHED
# Several impacts between two frames explain a move of 1e-3 (as time stepping has); no more.
DEEPEST = 1e-4
MOST_ENERGY = 1e-2
FARTHEST = 5e-3
# Closing joints that `auto` once missed while it reported an ordinary answer.
SEEDS = {
    59: "overlap of 8.6e-3 for 220 frames, energy error 2e-5",
    49: "overlap of 2.3e-3, infinite friction",
    608: "overlap of 1.9e-3",
    261: "overlap of 7.4e-3, energy error 0.87 in a collapse; by all others it stands",
    570: "free end: voussoirs moved by half a joint at snap-through, energy error 0.93",
    633: "overlap of 1.3e-3, energy made 6e-3 after the end of the motion",
    667: "energy error 4e-2, infinite friction",
}


def irregular_scene(seed):
    """An arch that stands and a motion for it."""
    rng = np.random.default_rng(seed)
    while True:
        try:
            arch = irregular_chain(rng)
        except GeometryError:
            continue
        start = af.onset(arch)
        onset = min(start.plus, start.minus) if start.stands else 0.0
        if 0.02 < onset < 1.5:
            break
    most = min(2.0, max(0.6, 5.0 * onset))
    peak = float(np.exp(rng.uniform(np.log(max(0.3, onset)), np.log(most))))
    dt = float(rng.choice([0.001, 0.002]))
    time = np.arange(0.0, rng.uniform(2.0, 4.0), dt)
    horizontal = wave(rng, time) * peak * g
    vertical = None
    if rng.random() < 0.6:
        vertical = wave(rng, time) * rng.uniform(0.0, 0.3) * g
    return arch, af.Motion(horizontal, dt, vertical)


def irregular_chain(rng):
    friction = np.inf if rng.random() < 0.1 else float(rng.uniform(0.2, 0.9))
    voussoirs = int(rng.integers(2, 16))
    size = float(np.exp(rng.uniform(np.log(1.0), np.log(15.0))))
    free = bool(rng.random() < 0.1)
    inner, outer = (
        column_joints(rng, voussoirs) if free else arch_joints(rng, voussoirs)
    )
    load = rng.uniform(0.0, 2e4, voussoirs) * size**2 if rng.random() < 0.3 else None
    return af.Arch.from_joints(
        size * inner, size * outer, friction, dead_load=load, free_end=free
    )


def arch_joints(rng, voussoirs):
    """Ends of joints about an ellipse of about unit size, each moved, rotated and drawn out."""
    half = rng.uniform(np.radians(50.0), np.radians(90.0))
    spacing = 2.0 * half / voussoirs
    angle = np.linspace(0.5 * np.pi + half, 0.5 * np.pi - half, voussoirs + 1)
    angle[1:-1] += rng.uniform(-0.3, 0.3, voussoirs - 1) * spacing
    lean = angle + rng.uniform(-1.0, 1.0, voussoirs + 1) * min(0.15, 0.4 * spacing)
    thickness = rng.uniform(0.12, 0.35) * rng.uniform(0.85, 1.15, voussoirs + 1)
    reach = rng.uniform(0.97, 1.03, voussoirs + 1)
    rise = rng.uniform(0.6, 1.5)
    middle = np.column_stack([reach * np.cos(angle), rise * reach * np.sin(angle)])
    # The normal of the ellipse at a radial angle, leant over.
    outward = np.column_stack([rise * np.cos(lean), np.sin(lean)])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    arm = 0.5 * thickness[:, None] * outward
    return middle - arm, middle + arm


def column_joints(rng, voussoirs):
    """Ends of joints of a column of unit height; the last pair is its free face."""
    height = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, voussoirs))])
    height /= height[-1]
    half = 0.5 * rng.uniform(0.15, 0.4) * rng.uniform(0.9, 1.1, voussoirs + 1)
    tilt = rng.uniform(-0.1, 0.1, voussoirs + 1) / voussoirs
    tilt[0] = 0.0
    arm = np.column_stack([half, tilt])
    middle = np.column_stack([np.zeros(voussoirs + 1), height])
    return middle + arm, middle - arm


def wave(rng, time):
    """A sum of eight sines under a window, its largest value 1."""
    frequency = np.exp(rng.uniform(np.log(0.4), np.log(10.0), 8))
    phase = rng.uniform(0.0, 2.0 * np.pi, 8)
    found = rng.normal(size=8) @ np.sin(
        2.0 * np.pi * np.outer(frequency, time) + phase[:, None]
    )
    found *= np.minimum(1.0, np.minimum(time, time[-1] - time) / 0.2)
    return found / np.abs(found).max()


def largest_jump(arch, time, displacement, rotation, velocity, angular_velocity):
    """Largest displacement between frames, over a joint, that the velocities do not explain.

    A body that moves by a law is displaced by the interval times a velocity between the two, an
    impact in the interval included. Rotations count at the corner farthest from the centroid.
    """
    chain = arch.chain
    arm = np.linalg.norm(chain.face_after[: arch.n_voussoir], axis=2).max(axis=1)
    moved = np.diff(
        np.concatenate([displacement, (arm * rotation)[..., None]], axis=2), axis=0
    )
    speed = np.concatenate([velocity, (arm * angular_velocity)[..., None]], axis=2)
    span = np.diff(time)[:, None, None]
    first = speed[:-1] * span
    change = np.diff(speed, axis=0) * span
    square = np.sum(change**2, axis=2)
    part = np.sum((moved - first) * change, axis=2) / np.where(
        square == 0.0, np.inf, square
    )
    beyond = moved - first - np.clip(part, 0.0, 1.0)[..., None] * change
    joint = np.linalg.norm(np.diff(chain.face_after, axis=1), axis=2).min()
    return np.linalg.norm(beyond, axis=2).max() / joint


@pytest.mark.parametrize("seed", SEEDS)
def test_voussoirs_neither_overlap_nor_jump_nor_gain_energy(seed):
    arch, motion = irregular_scene(seed)
    response = af.simulate(arch, motion, history=True)
    history = response.history
    time = history.time.values
    shift = history.displacement.values
    tilt = history.rotation.values
    speed = history.velocity.values
    spin = history.angular_velocity.values
    late = time >= motion.duration
    still = af.Motion(np.zeros(3), motion.dt)
    gain = energy_gain(
        arch, still, *(each[late] for each in (time, shift, speed, spin))
    )
    assert response.status in ANSWERS
    assert overlaps(arch, shift, tilt).max() <= DEEPEST
    assert largest_jump(arch, time, shift, tilt, speed, spin) <= FARTHEST
    assert max(response.energy_error, gain) <= MOST_ENERGY


# What made it: a slip that ended inside a long step, an impact off the middle of its step,
# reactions carried up to an impact where joints open.
@pytest.mark.parametrize("seed", [930283, 930270, 930852])
def test_contacts_of_time_stepping_give_no_energy(seed):
    energy = af.simulate(*irregular_scene(seed), method="time_stepping").energy
    assert energy["balance_error"] <= 1e-4 * energy["largest_kinetic"]


def test_steps_are_solved_contacts_take_energy_and_verdicts_are_those_of_events():
    steps = fallbacks = same = 0
    for seed in range(40):
        scene = irregular_scene(seed)
        run = af.simulate(*scene, method="time_stepping")
        steps = steps + run.steps
        fallbacks = fallbacks + run.fallbacks
        assert run.status in ANSWERS
        assert max(run.energy["friction"], run.energy["impacts"]) <= 0.0
        assert run.energy["balance_error"] <= 1e-3 * run.energy["largest_kinetic"]
        same += run.collapsed == af.simulate(*scene, method="event_driven").collapsed
    assert fallbacks < 3e-4 * steps
    assert same >= 38
