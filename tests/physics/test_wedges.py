"""Closing joints that were missed: voussoirs ran into each other, or were moved apart in no time.

Each scene broke the bounds here by what its name states, by `auto` at its default tolerance, while
it was reported as an ordinary answer.
"""

import numpy as np
import pytest

import archfrag as af
from archbench.measures import energy_gain, overlaps
from archfrag.mechanics.status import Status
from tests.physics.irregular import irregular_scene

# Several impacts between two frames explain a move of 1e-3 (as time stepping has); no more.
DEEPEST, MOST_ENERGY, FARTHEST = 1e-4, 1e-2, 5e-3
# What was missed in scenes of `irregular_scene`, by seed.
SEEDS = {
    59: "overlap of 8.6e-3 for 220 frames, energy error 2e-5",
    49: "overlap of 2.3e-3, infinite friction",
    608: "overlap of 1.9e-3",
    261: "overlap of 7.4e-3, energy error 0.87 in a collapse; by all others it stands",
    570: "free end: voussoirs moved by half a joint at snap-through, energy error 0.93",
    633: "overlap of 1.3e-3, energy made 6e-3 after the end of the motion",
    667: "energy error 4e-2, infinite friction",
}


def largest_jump(arch, time, displacement, rotation, velocity, angular_velocity):
    """Largest displacement between frames, over a joint, that the velocities do not explain.

    A body that moves by a law is displaced by the interval times a velocity between the two, an
    impact in the interval included. Rotations count at the corner farthest from the centroid.
    """
    chain = arch.chain
    arm = np.linalg.norm(chain.face_after[: arch.n_voussoir], axis=2).max(axis=1)
    moved = np.diff(np.concatenate([displacement, (arm * rotation)[..., None]], axis=2), axis=0)
    speed = np.concatenate([velocity, (arm * angular_velocity)[..., None]], axis=2)
    span = np.diff(time)[:, None, None]
    first, change = speed[:-1] * span, np.diff(speed, axis=0) * span
    square = np.sum(change**2, axis=2)
    part = np.sum((moved - first) * change, axis=2) / np.where(square == 0.0, np.inf, square)
    beyond = moved - first - np.clip(part, 0.0, 1.0)[..., None] * change
    joint = np.linalg.norm(np.diff(chain.face_after, axis=1), axis=2).min()
    return np.linalg.norm(beyond, axis=2).max() / joint


@pytest.mark.parametrize("seed", SEEDS)
def test_irregular_scene(seed):
    """Run a scene as a study does, and look at every frame."""
    arch, motion = irregular_scene(seed)[:2]
    response = af.simulate(arch, motion, history=True)
    history = response.history
    time = history.time.values
    shift, tilt = history.displacement.values, history.rotation.values
    speed, spin = history.velocity.values, history.angular_velocity.values
    deepest = overlaps(arch, shift, tilt).max()
    farthest = largest_jump(arch, time, shift, tilt, speed, spin)
    late, still = time >= motion.duration, af.Motion(np.zeros(3), motion.dt)
    gain = energy_gain(arch, still, *(each[late] for each in (time, shift, speed, spin)))
    assert response.status in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)
    assert deepest <= DEEPEST
    assert farthest <= FARTHEST
    assert response.energy_error <= MOST_ENERGY
    assert gain <= MOST_ENERGY
