"""Curves of parts: shares by hand, their sum, and their bands."""

import math

import numpy as np
import pytest
import scipy

from archfrag.fragility.fit import fit_ida
from archfrag.fragility.quoted import quoted_band
from archfrag.fragility.risk import contributions
from archfrag.fragility.several import divide
from archfrag.fragility.verdicts import find_brackets

LEVELS = np.array([0.2, 0.4, 0.6, 0.8])
#           0.2  0.4  0.6  0.8
TAKEN = (("", "", "pier", "ring"), ("", "ring", "ring", "ring"), ("", "", "", "pier"))


def split_of(taken):
    kind = np.array([["pier", "ring", ""].index(part) for row in taken for part in row])
    kind = kind.reshape(len(taken), -1)
    return contributions(kind < 2, kind, ("pier", "ring"))


@pytest.fixture
def curve():
    return fit_ida([0.5, 0.3, 0.7])


def test_a_pier_and_a_ring_by_hand(curve):
    """At 0.5 between the levels, and at 0.1 below the least collapse, which is at 0.4."""
    split = split_of(TAKEN)
    np.testing.assert_array_equal(split.counts, [[0, 0, 1, 1], [0, 1, 1, 2]])
    assert split.n_effective == pytest.approx(
        6.0**2 / (2**2 + 3**2 + 1**2)
    )  # 2.57 of 3
    found = divide(curve, split, LEVELS, [0.5, 0.1])
    for place, near in enumerate((0.5, 0.4)):
        weights = [
            math.exp(-((math.log(near / level) / 0.3) ** 2) / 2.0) for level in LEVELS
        ]
        pier = (weights[2] + weights[3]) / sum(weights)
        ring = (weights[1] + weights[2] + 2.0 * weights[3]) / sum(weights)
        pier, ring = (each * split.n_effective / 3.0 + 0.5 for each in (pier, ring))
        whole = curve((0.5, 0.1)[place])
        expected = [whole * pier / (pier + ring), whole * ring / (pier + ring)]
        np.testing.assert_allclose(found[0, :, place], expected, rtol=1e-12)


@pytest.mark.parametrize("im", [[0.0], [1e-9, 0.05], [0.2, 0.5, 40.0]])
def test_parts_add_up_to_the_curve(curve, im):
    value, lower, upper = divide(curve, split_of(TAKEN), LEVELS, im)
    np.testing.assert_allclose(value.sum(axis=0), curve(im), rtol=1e-14)
    assert (
        np.diff([0.0 * lower, lower, upper, 0.0 * upper + 1.0], axis=0) >= 0.0
    ).all()


def test_one_part_has_the_curve_and_its_band():
    capacity = np.array([[0.3], [0.35], [0.5], [0.55], [0.7], [0.75]])
    collapsed = capacity <= LEVELS
    split = contributions(collapsed, np.zeros_like(collapsed, int), ("pier",))
    brackets = find_brackets(collapsed.astype(int), LEVELS)
    curve = quoted_band(brackets, np.linspace(0.0, 1.0, 200))
    value, lower, upper = divide(curve, split, LEVELS, [0.3, 0.5])
    np.testing.assert_allclose(value[0], curve([0.3, 0.5]), rtol=1e-14)
    band = curve.band([0.3, 0.5])
    np.testing.assert_allclose([lower[0], upper[0]], band, atol=0.02)


def test_bands_hold_the_truth():
    """In 150 studies of 16 records whose weak motions take the pier and strong ones the ring."""
    generator = np.random.default_rng(8)
    levels = np.linspace(0.1, 1.5, 15)
    at = np.array([0.3, 0.6, 1.2])

    def pier(im):
        return 1.0 / (1.0 + np.exp(1.5 * np.log(im / 0.6)))

    truth = scipy.stats.norm.cdf(np.log(at / 0.6) / 0.45) * [pier(at), 1.0 - pier(at)]
    held = np.zeros_like(truth)
    for _ in range(150):
        capacity = 0.6 * np.exp(0.45 * generator.standard_normal(16))
        collapsed = levels >= capacity[:, None]
        kind = (generator.random((16, 1)) > pier(levels)).astype(int)
        split = contributions(collapsed, kind, ("pier", "ring"))
        curve = quoted_band(find_brackets(collapsed.astype(int), levels), at)
        _, lower, upper = divide(curve, split, levels, at)
        held += (lower <= truth) & (truth <= upper)
    assert (held / 150.0).min() >= 0.87
    assert (held / 150.0).mean() <= 0.99
