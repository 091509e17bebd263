"""Maximum likelihood: published data, a brute-force search, invariances, and what cannot be."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime, minimize
from scipy.stats import binom, norm

from archfrag.errors import FitError, InputError
from archfrag.fragility.fit import Fragility, fit_ida, fit_stripes

STRIPES = np.array([0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0])
COLLAPSES = np.array([0, 0, 0, 4, 6, 13, 12, 16])
# fmt: off
CAPACITIES = np.array([
    0.49, 0.62, 0.63, 0.63, 0.65, 0.70, 0.71, 0.72, 0.77, 0.79, 0.80, 0.84, 0.91, 0.92, 0.93,
    0.97, 1.04, 1.04, 1.05, 1.08, 1.08, 1.09, 1.12, 1.13, 1.22, 1.32, 1.33, 1.34, 1.40, 1.40,
    1.47, 1.72, 1.76, 2.15, 2.31, 2.42, 2.50,
])
# fmt: on


def binomial_log_likelihood(ln_theta, beta, im, collapses, n):
    return binom.logpmf(collapses, n, norm.cdf((np.log(im) - ln_theta) / beta)).sum()


def censored_log_likelihood(ln_theta, beta, logs, limit):
    observed = logs[logs <= limit]
    return norm.logpdf(observed, ln_theta, beta).sum() + (logs.size - observed.size) * norm.logsf(
        limit, ln_theta, beta
    )


class TestPublishedData:
    """Baker (2015), Earthquake Spectra 31(1): the author's two example data sets."""

    def test_stripes(self):
        fit = fit_stripes(STRIPES, COLLAPSES, 40)
        assert fit.theta == pytest.approx(1.0761, abs=1e-4)
        assert fit.beta == pytest.approx(0.4292, abs=1e-4)
        assert fit.standard_errors == pytest.approx([0.0717, 0.0839], abs=1e-4)
        assert fit.correlation == pytest.approx(0.810, abs=1e-3)
        assert (fit.kind, fit.n_levels, fit.n_total) == ("stripes", 8, 320)

    def test_truncated_ida(self):
        fit = fit_ida(CAPACITIES, truncate_at=1.3)
        assert fit.theta == pytest.approx(1.0582, abs=1e-4)
        assert fit.beta == pytest.approx(0.3821, abs=1e-4)
        assert (fit.kind, fit.n_levels, fit.n_total) == ("ida_truncated", 22, 37)

    def test_complete_ida(self):
        fit = fit_ida(CAPACITIES)
        logs = np.log(CAPACITIES)
        assert fit.theta == pytest.approx(np.exp(logs.mean()), rel=1e-14)
        assert fit.beta == pytest.approx(
            np.sqrt(((logs - logs.mean()) ** 2).sum() / 36), rel=1e-13
        )
        assert fit.log_likelihood == pytest.approx(
            norm.logpdf(logs, np.log(fit.theta), fit.beta).sum(), rel=1e-12
        )


class TestMaximum:
    """The estimate is where an independently written likelihood is largest."""

    def test_stripes_beat_a_search(self):
        generator = np.random.default_rng(5)
        for _ in range(20):
            im = np.sort(generator.uniform(0.1, 2.0, 6))
            n = generator.integers(3, 40, 6)
            collapses = generator.binomial(n, norm.cdf(np.log(im / 0.8) / 0.6))
            fit = fit_stripes(im, collapses, n)
            found = minimize(
                lambda p: -binomial_log_likelihood(p[0], np.exp(p[1]), im, collapses, n),  # noqa: B023
                [0.0, -1.0],
                method="Nelder-Mead",
                options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000},
            )
            assert np.log(fit.theta) == pytest.approx(found.x[0], abs=1e-6)
            assert fit.beta == pytest.approx(np.exp(found.x[1]), rel=1e-6)
            assert fit.log_likelihood == pytest.approx(-found.fun, abs=1e-9)

    def test_log_likelihood_of_censored_capacities(self):
        fit = fit_ida(CAPACITIES, 1.3)
        logs = np.log(CAPACITIES)
        value = censored_log_likelihood(np.log(fit.theta), fit.beta, logs, np.log(1.3))
        assert fit.log_likelihood == pytest.approx(value, rel=1e-12)
        for step in ([1e-3, 0.0], [-1e-3, 0.0], [0.0, 1e-3], [0.0, -1e-3]):
            near = censored_log_likelihood(
                np.log(fit.theta) + step[0], fit.beta + step[1], logs, np.log(1.3)
            )
            assert near < value

    @pytest.mark.parametrize("kind", ["stripes", "truncated"])
    def test_covariance_is_the_inverse_observed_information(self, kind):
        if kind == "stripes":
            fit = fit_stripes(STRIPES, COLLAPSES, 40)

            def loss(p):
                return -binomial_log_likelihood(p[0], p[1], STRIPES, COLLAPSES, 40)
        else:
            fit = fit_ida(CAPACITIES, 1.3)

            def loss(p):
                return -censored_log_likelihood(p[0], p[1], np.log(CAPACITIES), np.log(1.3))

        def slope(p):
            return approx_fprime(p, loss, 1e-5)

        point = np.array([np.log(fit.theta), fit.beta])
        steps = 1e-4 * np.eye(2)
        information = np.array([(slope(point + s) - slope(point - s)) / 2e-4 for s in steps])
        assert fit.covariance == pytest.approx(np.linalg.inv(information), rel=2e-3)


class TestInvariance:
    def test_unit_of_intensity(self):
        fit = fit_stripes(STRIPES, COLLAPSES, 40)
        other = fit_stripes(9.80665 * STRIPES, COLLAPSES, 40)
        assert other.theta == pytest.approx(9.80665 * fit.theta, rel=1e-12)
        assert other.beta == pytest.approx(fit.beta, rel=1e-12)
        assert other.covariance == pytest.approx(fit.covariance, rel=1e-10)

    def test_empty_levels_order_and_splitting_do_not_matter(self):
        fit = fit_stripes(STRIPES, COLLAPSES, 40)
        order = np.array([3, 0, 7, 1, 5, 2, 6, 4])
        im = np.concatenate([STRIPES[order], [5.0, STRIPES[3]]])
        collapses = np.concatenate([COLLAPSES[order], [0, 1]])
        n = np.concatenate([np.full(8, 40), [0, 10]])
        collapses[0] -= 1
        n[0] -= 10
        other = fit_stripes(im, collapses, n)
        assert other.theta == pytest.approx(fit.theta, rel=1e-12)
        assert other.covariance == pytest.approx(fit.covariance, rel=1e-10)
        assert other.n_levels == 8

    @settings(max_examples=150, deadline=None)
    @given(
        st.lists(
            st.tuples(st.floats(1e-3, 1e3), st.integers(0, 50), st.integers(0, 50)),
            min_size=1,
            max_size=8,
        )
    )
    def test_any_counts_give_a_curve_or_a_fit_error(self, levels):
        im, collapses, standing = np.array(levels).T
        try:
            fit = fit_stripes(im, collapses, collapses + standing)
        except FitError:
            return
        assert fit.beta > 0.0
        assert np.isfinite(fit.theta)
        assert np.all(np.linalg.eigvalsh(fit.covariance) >= 0.0)

    def test_truncation_above_all_capacities_is_the_complete_fit(self):
        assert fit_ida(CAPACITIES, 2.5).to_dict() == fit_ida(CAPACITIES).to_dict()

    def test_censored_values_may_be_infinite(self):
        unseen = np.where(CAPACITIES > 1.3, np.inf, CAPACITIES)
        assert fit_ida(unseen, 1.3).to_dict() == fit_ida(CAPACITIES, 1.3).to_dict()


class TestCurve:
    def test_probability(self):
        fit = fit_stripes(STRIPES, COLLAPSES, 40)
        im = np.array([0.0, fit.theta, fit.theta * np.exp(fit.beta)])
        assert fit.probability(im) == pytest.approx([0.0, 0.5, norm.cdf(1.0)], abs=1e-14)

    @pytest.mark.parametrize("im", [-0.1, np.nan])
    def test_impossible_intensity(self, im):
        with pytest.raises(InputError, match="a number from 0 upwards"):
            fit_stripes(STRIPES, COLLAPSES, 40).probability(im)

    def test_json_round_trip(self):
        fit = fit_ida(CAPACITIES, 1.3)
        copy = Fragility.from_dict(json.loads(json.dumps(fit.to_dict())))
        assert copy == fit
        assert np.array_equal(copy.covariance, fit.covariance)

    def test_incomplete_dictionary(self):
        with pytest.raises(InputError, match="lacks the key 'beta'"):
            Fragility.from_dict({"theta": 1.0})


@pytest.mark.parametrize(
    ("im", "collapses", "n", "sentence"),
    [
        ([0.1, 0.2], [0, 0], 5, "theta lies above 0.2"),
        ([0.1, 0.2], [5, 5], 5, "theta lies below 0.1"),
        ([0.1, 0.2, 0.3, 0.4], [0, 0, 5, 5], 5, "theta lies between 0.2 and 0.3"),
        ([0.1, 0.2, 0.3], [0, 2, 5], 5, "beta tends to 0 and theta to 0.2"),
        ([0.1, 0.1], [1, 4], 5, "all runs are at one level"),
        ([0.1, 0.2], [4, 1], 5, "does not rise with intensity"),
        ([0.1, 0.2], [2, 2], 5, "does not rise with intensity"),
        ([0.1, 0.2], [5, 0], 5, "does not rise with intensity"),
        ([0.1, 0.2], [0, 0], 0, "nothing to fit"),
    ],
)
def test_stripes_without_a_curve(im, collapses, n, sentence):
    with pytest.raises(FitError, match=sentence):
        fit_stripes(im, collapses, n)


@pytest.mark.parametrize(
    ("im", "collapses", "n", "sentence"),
    [
        ([-0.1, 0.2], [0, 1], 5, "im holds -0.1"),
        ([0.0, 0.2], [0, 1], 5, "im holds 0; intensities are positive"),
        ([np.nan, 0.2], [0, 1], 5, "im holds nan"),
        ([np.inf, 0.2], [0, 1], 5, "im holds inf"),
        ([0.1, 0.2], [0, 6], 5, "collapses is 6 at im = 0.2, more than the n = 5"),
        ([0.1, 0.2], [0, -1], 5, "collapses holds -1"),
        ([0.1, 0.2], [0, 1.5], 5, "collapses holds 1.5"),
        ([0.1, 0.2], [0, np.nan], 5, "collapses holds nan"),
        ([0.1, 0.2], [0, 1], [5, np.inf], "n holds inf"),
        ([0.1, 0.2], [0, 1, 2], 5, r"collapses has shape \(3,\)"),
        ([0.1, 0.2], [0, 1], [5], r"n has shape \(1,\)"),
        ([], [], 5, r"im has shape \(0,\)"),
        (0.1, 0, 5, r"im has shape \(\)"),
    ],
)
def test_stripes_that_cannot_be(im, collapses, n, sentence):
    with pytest.raises(InputError, match=sentence):
        fit_stripes(im, collapses, n)


@pytest.mark.parametrize(
    ("capacities", "limit", "kind", "sentence"),
    [
        ([], None, InputError, r"shape \(0,\)"),
        ([0.5, -1.0], None, InputError, "capacities holds -1"),
        ([0.5, np.nan], 1.0, InputError, "capacities holds nan"),
        ([0.5, np.inf], None, InputError, "infinite only where truncate_at is given"),
        ([0.5, 0.6], -1.0, InputError, "truncate_at is -1"),
        ([0.5, 0.6], np.nan, InputError, "truncate_at is nan"),
        ([0.5], None, FitError, "all 1 capacities are 0.5"),
        ([0.5, 0.5], 0.7, FitError, "all 2 capacities are 0.5"),
        ([0.5, 0.6], 0.4, FitError, "theta lies above"),
        ([0.5, 0.6], 0.5, FitError, "all observed capacities equal truncate_at = 0.5"),
    ],
)
def test_capacities_without_a_curve(capacities, limit, kind, sentence):
    with pytest.raises(kind, match=sentence):
        fit_ida(capacities, limit)
