"""Many draws fitted at once are the fits one by one, and those of others."""

import numpy as np
import pytest
import statsmodels.api as sm
from scipy.stats import norm

from archfrag.errors import FitError, InputError
from archfrag.fragility.bands import record_bootstrap_band
from archfrag.fragility.fit import fit_many, fit_stripes
from archfrag.fragility.runs import Resampling

LEVELS = np.exp(0.35 * np.linspace(-2.2, 2.2, 15))


def resampled(n_record, n_draw, seed):
    generator = np.random.default_rng(seed)
    capacity = np.exp(0.35 * generator.standard_normal(n_record))
    times = generator.multinomial(n_record, np.full(n_record, 1.0 / n_record), n_draw)
    return times @ (capacity[:, None] <= LEVELS).astype(float)


class TestManyAreOneByOne:
    @pytest.mark.parametrize("n_record", [3, 8, 30])
    def test_estimates_and_draws_without_maximum(self, n_record):
        draws = resampled(n_record, 120, n_record)
        many = fit_many(LEVELS, draws, n_record)
        assert (0 < many.fitted.sum() < 120) or n_record > 3
        for i, draw in enumerate(draws):
            try:
                one = fit_stripes(LEVELS, draw, n_record)
            except FitError:
                assert not many.fitted[i]
                assert np.isnan([many.theta[i], many.beta[i], many.log_likelihood[i]]).all()
                continue
            assert many.theta[i] == pytest.approx(one.theta, rel=1e-9)
            assert many.beta[i] == pytest.approx(one.beta, rel=1e-9)
            assert many.covariance[i] == pytest.approx(one.covariance, rel=1e-7)
            assert many.log_likelihood[i] == pytest.approx(one.log_likelihood, abs=1e-9)

    def test_nearly_separated_draws_reach_their_maximum(self):
        """Where one run in 40,000 tells beta from 0 the gradient still vanishes."""
        levels = np.array([0.3, 0.30001, 0.6, 0.61])
        many = fit_many(levels, [[1, 0, 19_999, 20_000]], 20_000)
        z = (np.log(levels) - np.log(many.theta[0])) / many.beta[0]
        k, n = np.array([1, 0, 19_999, 20_000]), 20_000
        slope = k * np.exp(norm.logpdf(z) - norm.logcdf(z)) - (n - k) * np.exp(
            norm.logpdf(z) - norm.logsf(z)
        )
        assert abs(slope.sum()) < 1e-8
        assert abs((slope * z).sum()) < 1e-8

    def test_falling_fractions_have_no_curve(self):
        many = fit_many([0.1, 0.2, 0.3], [[3, 2, 1], [1, 2, 3], [0, 0, 0], [0, 0, 4]], 4)
        assert many.fitted.tolist() == [False, True, False, False]

    @pytest.mark.parametrize(
        ("levels", "collapses", "n", "sentence"),
        [
            ([0.1, 0.2], [1, 2], 3, "draws by levels"),
            ([0.1, 0.2], [[1, 2, 3]], 3, "draws by levels"),
            ([0.1, 0.2], [[1, 4]], 3, "between 0 and n"),
            ([0.1, 0.2], [[np.nan, 1]], 3, "between 0 and n"),
            ([0.0, 0.2], [[1, 2]], 3, "positive finite"),
        ],
    )
    def test_impossible_draws(self, levels, collapses, n, sentence):
        with pytest.raises(InputError, match=sentence):
            fit_many(levels, collapses, n)


class TestStatsmodels:
    """Probit regression of statsmodels: the same line, covariance and log-likelihood."""

    @pytest.mark.parametrize("seed", range(4))
    def test_probit_glm(self, seed):
        generator = np.random.default_rng(seed)
        im = np.sort(generator.uniform(0.2, 2.0, 8))
        n = generator.integers(5, 60, 8)
        collapses = generator.binomial(n, norm.cdf(np.log(im / 0.8) / 0.6))
        fit = fit_stripes(im, collapses, n)
        design = sm.add_constant(np.log(im))
        family = sm.families.Binomial(sm.families.links.Probit())
        model = sm.GLM(np.stack([collapses, n - collapses], axis=1), design, family)
        other = model.fit(method="newton", tol=1e-14, maxiter=200, cov_type="nonrobust")
        a, b = other.params
        assert fit.theta == pytest.approx(np.exp(-a / b), rel=1e-6)
        assert fit.beta == pytest.approx(1.0 / b, rel=1e-6)
        assert fit.log_likelihood == pytest.approx(other.llf, abs=1e-6)
        observed = np.linalg.inv(-model.hessian(other.params, observed=True))
        jacobian = np.array([[-1.0 / b, a / b**2], [0.0, -1.0 / b**2]])
        assert fit.covariance == pytest.approx(jacobian @ observed @ jacobian.T, rel=1e-6)


class TestEvents:
    """Whole events are drawn where several records share one."""

    VERDICT = (np.sort(np.random.default_rng(2).lognormal(0.0, 0.35, 24))[:, None] <= LEVELS) * 1

    def band(self, groups, verdict=None):
        verdict = self.VERDICT if verdict is None else verdict
        return record_bootstrap_band(
            verdict, LEVELS, [0.7, 1.0, 1.4], Resampling(3, 200), groups=groups
        )

    def test_an_event_for_each_record_changes_nothing(self):
        names = [f"event {i:02d}" for i in range(24)]
        assert np.array_equal(self.band(names).upper, self.band(None).upper)

    def test_alike_records_of_an_event_are_worth_less(self):
        """Records sorted by capacity, so that those of an event are nearly equal."""
        wide, narrow = self.band(np.arange(24) // 3), self.band(None)
        ratio = (wide.upper - wide.lower) / (narrow.upper - narrow.lower)
        assert np.all(ratio > 1.15)
        assert ratio[1] > 1.5

    def test_order_of_records_does_not_matter(self):
        order = np.random.default_rng(5).permutation(24)
        groups = np.arange(24) // 3
        a, b = self.band(groups), self.band(groups[order], self.VERDICT[order])
        assert np.array_equal(a.lower, b.lower)

    @pytest.mark.parametrize(
        ("groups", "sentence"), [(np.zeros(24), "one event, 0"), ([1, 2], r"shape \(2,\)")]
    )
    def test_impossible_groups(self, groups, sentence):
        with pytest.raises(InputError, match=sentence):
            self.band(groups)
