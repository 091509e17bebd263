"""Curves of parts: shares by a likelihood written once more, their sum, and their bands."""

import numpy as np
import pytest
import scipy

from archfrag.fragility.fit import fit_ida
from archfrag.fragility.parts import divide
from archfrag.fragility.quoted import quoted_band
from archfrag.fragility.risk import contributions
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
    """Of two parts the share is a logistic line of the difference; both are searched on a grid."""
    split = split_of(TAKEN)
    np.testing.assert_array_equal(split.counts, [[0, 0, 1, 1], [0, 1, 1, 2]])
    assert split.n_effective == pytest.approx(6.0**2 / (2**2 + 3**2 + 1**2))
    found = divide(curve, split, LEVELS, LEVELS)
    logs = np.log(LEVELS)
    number = np.array([0, 1, 2, 3])
    centre = (number * logs).sum() / 6.0
    width = np.sqrt((number * (logs - centre) ** 2).sum() / 6.0)
    x = (np.maximum(logs, logs[1]) - centre) / width  # kept below the least collapse

    def loss(line):  # a part has half the difference, with the opposite sign
        share = 1.0 / (1.0 + np.exp(-(line[0] + line[1] * x)))
        seen = split.counts[0] * np.log(share) + split.counts[1] * np.log(1.0 - share)
        return (
            line[0] ** 2 / 16.0
            + line[1] ** 2 / 4.0
            - split.n_effective / 6.0 * seen.sum()
        )

    a, b = scipy.optimize.minimize(loss, [0.0, 0.0], tol=1e-14).x
    share = 1.0 / (1.0 + np.exp(-(a + b * x)))
    np.testing.assert_allclose(
        found[0], curve(LEVELS) * [share, 1.0 - share], rtol=1e-6
    )


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
