"""The rate shared out: nothing lost, nothing twice."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.fragility.contributions import (
    contributions,
    implied_collapses,
    level_edges,
    value_bins,
)


def scene(n_record=30, n_level=6, seed=4):
    generator = np.random.default_rng(seed)
    fell = generator.random((n_record, n_level)) < np.linspace(0.0, 0.9, n_level)
    return np.geomspace(1e-3, 1e-5, n_level), fell, generator.integers(0, 3, fell.shape)


NAMES = ("a", "b", "c")


def test_categories_and_unassigned_add_up_to_each_level():
    rates, fell, kind = scene()
    found = contributions(rates, fell, kind, NAMES)
    np.testing.assert_allclose(found.rate.sum(axis=0) + found.unassigned, rates, rtol=1e-14)
    assert found.unassigned[0] == rates[0]
    assert found.fraction.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(found.counts.sum(axis=0), fell.sum(axis=0))


def test_weights_are_the_hazards_not_the_counts():
    """One mechanism below, another above: with equal counts their fractions are the rates'."""
    fell = np.ones((10, 2), dtype=bool)
    kind = np.tile([0, 1], (10, 1))
    found = contributions([9e-4, 1e-4], fell, kind, ("low", "high"))
    np.testing.assert_allclose(found.fraction, [0.9, 0.1])
    np.testing.assert_allclose([found.lower, found.upper], [[0.9, 0.1]] * 2)


def test_band_is_that_of_resampled_records():
    """At one level it is the band of a binomial fraction of records."""
    fell = np.ones((400, 1), dtype=bool)
    kind = (np.arange(400) >= 100).astype(int)[:, None]
    found = contributions([1e-4], fell, kind, ("few", "many"))
    half = 1.645 * np.sqrt(0.25 * 0.75 / 400)
    assert found.lower[0] == pytest.approx(0.25 - half, abs=0.006)
    assert found.upper[0] == pytest.approx(0.25 + half, abs=0.006)


def test_nothing_collapsed():
    found = contributions([1e-4], [[False], [False]], [[0], [0]], ("a",))
    assert np.isnan(found.fraction[0])
    assert found.unassigned[0] == 1e-4


def test_gaps_of_a_bisection_follow_from_their_neighbours():
    fell = [[0, 0, 1, 0, 0], [0, 0, 0, 0, 0], [0, 1, 0, 0, 1]]
    known = [[0, 1, 1, 0, 0], [0, 1, 0, 0, 0], [1, 1, 1, 0, 1]]
    kind = [[-1, -1, 2, -1, -1], [-1] * 5, [-1, 0, -1, -1, 1]]
    filled, way = implied_collapses(fell, known, kind)
    assert filled.astype(int).tolist() == [[0, 0, 1, 1, 1], [0] * 5, [0, 1, 0, 0, 1]]
    assert way[0].tolist() == [-1, -1, 2, 2, 2]
    assert way[2].tolist() == [-1, 0, -1, -1, 1]


def test_bins_hold_their_lower_end_and_what_is_not_known():
    place, names = value_bins([4.0, 6.0, 6.99, 7.0, np.nan], [6.0, 7.0], "km")
    assert place.tolist() == [0, 1, 1, 2, 3]
    assert names == ("below 6 km", "6 to 7 km", "7 km and more", "not known")


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"level_rate": [1e-3]}, "level_rate has shape"),
        ({"level_rate": [-1.0] * 6}, "rates are from 0 upwards"),
        ({"category": np.full((30, 6), 3)}, "category holds 3"),
        ({"confidence": 0.0}, "confidence is 0"),
    ],
)
def test_refusals(changed, sentence):
    rates, fell, kind = scene()
    given = {"level_rate": rates, "collapsed": fell, "category": kind, "categories": NAMES}
    with pytest.raises(InputError, match=sentence):
        contributions(**given | changed)


def test_levels_that_do_not_increase():
    with pytest.raises(InputError, match="levels must be"):
        level_edges([0.2, 0.1])
