"""Collapses shared out to categories: every collapse once, intervals that hold what they say."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict
from archfrag.fragility.deaggregate import deaggregate, wilson

NAMES = ("hinging", "sliding", "lift-off")


def scene(n_record=30, n_level=6, seed=4):
    generator = np.random.default_rng(seed)
    verdict = generator.choice([0, 1, 2, 3], (n_record, n_level), p=[0.3, 0.6, 0.05, 0.05])
    category = generator.integers(0, 3, verdict.shape)
    return verdict, category


class TestCounts:
    def test_every_collapse_is_counted_once_and_nothing_else(self):
        verdict, category = scene()
        found = deaggregate(verdict, category, NAMES)
        fell = verdict == Verdict.COLLAPSED
        for i in range(3):
            for level in range(6):
                same = fell[:, level] & (category[:, level] == i)
                assert found.counts[i, level] == same.sum()
        np.testing.assert_array_equal(found.counts.sum(axis=0), fell.sum(axis=0))
        np.testing.assert_array_equal(found.collapsed, fell.sum(axis=0))
        np.testing.assert_array_equal(found.n, fell.sum(axis=0) + (verdict == 0).sum(axis=0))

    def test_shares_add_up_and_probabilities_to_the_fraction_of_collapses(self):
        found = deaggregate(*scene(), NAMES)
        np.testing.assert_allclose(found.fraction.sum(axis=0), 1.0)
        np.testing.assert_allclose(found.overall.sum(), 1.0)
        np.testing.assert_allclose(found.probability.sum(axis=0), found.collapsed / found.n)

    def test_category_of_a_run_that_stood_does_not_matter(self):
        verdict, category = scene()
        other = np.where(verdict == Verdict.COLLAPSED, category, -7)
        a, b = deaggregate(verdict, category, NAMES), deaggregate(verdict, other, NAMES)
        np.testing.assert_array_equal(a.counts, b.counts)

    def test_a_level_without_collapse_has_no_shares(self):
        verdict, category = scene()
        verdict[:, 2] = Verdict.STANDING
        verdict[:, 3] = Verdict.SOLVER_FAILURE
        found = deaggregate(verdict, category, NAMES)
        for values in (found.fraction, found.lower, found.upper):
            assert np.isnan(values[:, [2, 3]]).all()
            assert np.isfinite(values[:, [0, 1, 4, 5]]).all()
        assert (found.probability[:, 2] == 0.0).all()
        assert np.isnan(found.probability[:, 3]).all()

    def test_nothing_collapsed(self):
        found = deaggregate(np.zeros((4, 2), int), np.zeros((4, 2), int), NAMES)
        assert not found.counts.any()
        assert found.n_effective == 0.0
        assert np.isnan(found.overall).all()
        assert np.isnan(found.overall_upper).all()


class TestIntervals:
    @pytest.mark.parametrize(
        ("k", "n", "low", "high"),
        [(5, 10, 0.2366, 0.7634), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0),
         (1, 20, 0.0089, 0.2361)],
    )  # fmt: skip
    def test_tabulated_values(self, k, n, low, high):
        ends = wilson([k], [n], confidence=0.95)
        assert np.concatenate(ends) == pytest.approx([low, high], abs=5e-5)

    def test_ends_are_where_the_score_test_rejects(self):
        """At each end the fraction seen lies a normal quantile from the fraction supposed."""
        low, high = wilson([3.0, 7.5], [12.0, 12.0], confidence=0.8)
        for end in (low, high):
            away = (np.array([3.0, 7.5]) / 12.0 - end) / np.sqrt(end * (1.0 - end) / 12.0)
            np.testing.assert_allclose(np.abs(away), 1.2815515655446004)

    def test_coverage_at_a_level(self):
        generator = np.random.default_rng(11)
        k = generator.binomial(25, 0.3, 20_000)
        low, high = wilson(k, np.full(k.size, 25), 0.9)
        held = np.mean((low <= 0.3) & (high >= 0.3))
        assert 0.86 < held < 0.94

    def test_repeated_records_do_not_narrow_the_overall_interval(self):
        """All levels of a record tell the same: ten copies know no more than one."""
        verdict, category = scene(n_level=1)
        once = deaggregate(verdict, category, NAMES)
        tenfold = deaggregate(np.repeat(verdict, 10, 1), np.repeat(category, 10, 1), NAMES)
        assert tenfold.counts.sum() == 10 * once.counts.sum()
        assert tenfold.n_effective == pytest.approx(once.n_effective)
        np.testing.assert_allclose(tenfold.overall_lower, once.overall_lower)
        np.testing.assert_allclose(tenfold.overall_upper, once.overall_upper)

    def test_overall_interval_holds_where_records_fall_alike(self):
        """Category by record, collapses of unequal number: coverage at least nominal."""
        generator = np.random.default_rng(5)
        held = []
        for _ in range(1500):
            first = generator.integers(0, 8, 24)
            verdict = (np.arange(8) >= first[:, None]).astype(int)
            category = np.broadcast_to(generator.random((24, 1)) < 0.4, verdict.shape).astype(int)
            found = deaggregate(verdict, category, ("a", "b"))
            held.append(found.overall_lower[1] <= 0.4 <= found.overall_upper[1])
        assert 0.86 < np.mean(held) < 0.95

    def test_effective_number_of_unequal_records(self):
        verdict = np.array([[1, 1, 1], [0, 0, 1]])
        found = deaggregate(verdict, np.zeros((2, 3), int), ("a",))
        assert found.n_effective == pytest.approx(16.0 / 10.0)


class TestRefusals:
    @pytest.mark.parametrize(
        ("verdict", "category", "confidence", "sentence"),
        [
            ([[1, 0]], [[0]], 0.9, r"verdict has shape \(1, 2\), category \(1, 1\)"),
            ([1, 0], [0, 0], 0.9, r"verdict has shape \(2,\)"),
            ([[1, 0]], [[3, 0]], 0.9, "category holds 3 for a run that collapsed; .* from 0 to 2"),
            ([[1, 0]], [[-1, 0]], 0.9, "category holds -1"),
            ([[7, 0]], [[0, 0]], 0.9, "verdict holds 7"),
            ([[1, 0]], [[0, 0]], 1.0, "confidence is 1; it lies between 0 and 1"),
        ],
    )
    def test_one_sentence(self, verdict, category, confidence, sentence):
        with pytest.raises(InputError, match=sentence):
            deaggregate(verdict, category, NAMES, confidence=confidence)
