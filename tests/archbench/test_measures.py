"""Measures outside every method: known motions, judged."""

import numpy as np
import pytest

import archfrag as af
from archbench.measures import energy_gain, joint_faces, overlap_depth, overlaps

BLOCK = af.Block(0.2, 1.0, friction=0.8)
FACE = np.array([[0.0, 0.0], [0.0, 1.0]])  # of the earlier body, which lies at x < 0


def rotated(angle, about, points):
    """Points rotated counter-clockwise about another."""
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (points - about) @ matrix.T + about


def least_translation(one, other):
    """Shortest translation that parts two convex outlines; 0 if apart. Separating axes."""
    least = np.inf
    for outline in (one, other):
        for x, y in np.roll(outline, -1, axis=0) - outline:
            normal = np.array([y, -x]) / np.hypot(x, y)
            least = min(least, (one @ normal).max() - (other @ normal).min())
    return max(least, 0.0)


def test_overlap_of_two_bodies_is_the_least_translation_that_parts_them():
    rng = np.random.default_rng(11)
    depths = []
    behind = np.array([[-2.0, 1.2], [-2.0, -0.2]])
    ahead = np.array([[2.0, 1.1], [2.0, -0.1]])
    for _ in range(1000):
        angle = rng.uniform(-0.2, 0.2)
        away = rng.uniform([-0.05, -0.4], [0.05, 0.4])
        body = rotated(angle, [0.0, 0.5], np.concatenate([FACE, ahead])) + away
        depths.append(least_translation(np.concatenate([FACE, behind]), body))
        found = overlap_depth(FACE, body[:2])
        assert found == pytest.approx(depths[-1], rel=1e-9, abs=1e-14)
    assert 500 < np.count_nonzero(depths) < 995


@pytest.mark.parametrize("slip", [-0.999, 1e-9, 0.0, 0.3, 1.2])
def test_overlap_of_a_slipped_joint_is_how_far_it_is_sunk(slip):
    for sunk in (-1e-3, 0.0, 1e-4):
        depth = max(sunk, 0.0) if abs(slip) < 1.0 else 0.0
        assert overlap_depth(FACE, np.add(FACE, [-sunk, slip])) == pytest.approx(
            depth, abs=1e-16
        )


@pytest.mark.parametrize(("joint", "corner", "angle"), [(2, 1, -2e-3), (3, 0, 2e-3)])
def test_overlap_in_an_arch_is_at_the_joint_that_was_rotated(joint, corner, angle):
    arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    rest = np.zeros((1, 7, 2)), np.zeros((1, 7))
    assert overlaps(arch, *rest).max() < 1e-14
    pivot = joint_faces(arch, *rest)[0][0, joint, corner]
    centre = arch.chain.centroid[joint:]
    for sense, depth in ((1.0, np.sin(2e-3)), (-1.0, 0.0)):
        shift = np.zeros((1, 7, 2))
        angles = np.zeros((1, 7))
        angles[0, joint:] = sense * angle
        shift[0, joint:] = rotated(sense * angle, pivot, centre) - centre
        found = overlaps(arch, shift, angles)[0]
        assert found[joint] == pytest.approx(depth, rel=1e-9, abs=1e-14)
        assert np.delete(found, [joint, 7]).max() < 1e-14


@pytest.mark.parametrize(
    ("axis", "acceleration", "ground", "factor", "gain"),
    [
        (1, -BLOCK.chain.gravity, 0.0, 1.0, 0.0),
        (1, -BLOCK.chain.gravity, 0.0, 1.1, 0.21 / 1.21),
        (0, -3.0, 3.0, 1.0, 0.0),
        (0, -3.0, 0.0, 1.0, 1.0),
    ],
    ids=[
        "free fall",
        "a fall that is too fast",
        "left behind by the ground",
        "by nothing",
    ],
)
def test_energy_gain_of_a_body(axis, acceleration, ground, factor, gain):
    """In free fall, or left behind by the ground; its speed `factor` times what it should be."""
    time = np.linspace(0.0, 0.5, 501)
    displacement, velocity = np.zeros((2, time.size, 1, 2))
    displacement[:, 0, axis] = 0.5 * acceleration * time**2
    velocity[:, 0, axis] = factor * acceleration * time
    motion = af.Motion(np.full(501, ground), 0.001)
    spin = np.zeros((time.size, 1))
    found = energy_gain(BLOCK, motion, time, displacement, velocity, spin)
    assert found == pytest.approx(gain, rel=1e-6, abs=1e-12)
