"""Ordered limit states: nesting, crossing, and the joint fit against an independent likelihood."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from archfrag.fragility.curve import mixture
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.limit_states import (
    MOST_CROSSING,
    above,
    crossing,
    fit_limit_states,
    nest_exceedance,
)
from tests.export.made import fragility

LEVELS = np.geomspace(0.05, 2.0, 10)
NAMES = ("motion", "contact lost", "collapse")


def runs(seed, beta, n=40):
    """Thresholds 0.2, 0.3, 0.5 of demand with one error per run; beta of each state given."""
    error = np.random.default_rng(seed).normal(size=(n, LEVELS.size, 1))
    z = np.log(LEVELS[:, None] / np.array([0.2, 0.3, 0.5])) / np.asarray(beta)
    return (z >= error).astype(int)


CROSSING = runs(2, [0.2, 0.4, 1.2])


def test_more_severe_implies_less_severe():
    codes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0], [4, 1, 2], [0, 4, 4], [1, 4, 0], [4, 4, 4]])
    assert nest_exceedance(codes).tolist() == [
        [1, 1, 0], [1, 1, 1], [1, 0, 0], [1, 1, -1], [0, 0, 0], [1, -1, 0], [-1, -1, -1],
    ]  # fmt: skip


class TestCurves:
    def test_curves_that_do_not_cross_are_those_of_fit_stripes(self):
        exceeded = runs(1, [0.4, 0.4, 0.4])
        found, _ = fit_limit_states(exceeded, LEVELS, NAMES)
        assert {fit.kind for fit, _ in found} == {"stripes"}
        for i, (fit, _) in enumerate(found):
            assert fit == fit_stripes(LEVELS, exceeded[:, :, i].sum(axis=0), 40)

    def test_crossing_curves_are_replaced_by_the_likeliest_ordered_ones(self):
        exceeded = runs(3, [0.2, 0.4, 1.2])
        exceeded[:5, :, 1] = 4
        found, message = fit_limit_states(exceeded, LEVELS, NAMES)
        assert "one beta" in message
        fits = [fit for fit, _ in found]
        assert np.all(np.diff([fit.probability(LEVELS) for fit in fits], axis=0) < 0)
        nested = nest_exceedance(exceeded).reshape(-1, 3)
        x = np.broadcast_to(np.log(LEVELS), (40, LEVELS.size)).ravel()
        high, low = (nested == 1).sum(axis=1), 3 - (nested == 0).sum(axis=1)

        def loss(p):
            cumulative = norm.cdf((x[:, None] - p[:3]) / np.exp(p[3]))
            cumulative = np.column_stack([np.ones(x.size), cumulative, np.zeros(x.size)])
            rows = np.arange(x.size)
            p_run = cumulative[rows, high] - cumulative[rows, low + 1]
            return -np.log(np.maximum(p_run, 1e-300)).sum()

        options = {"xatol": 1e-9, "fatol": 1e-11, "maxiter": 8000, "maxfev": 8000}
        start = [*np.log([0.2, 0.3, 0.5]), -0.7]
        best = minimize(loss, start, method="Nelder-Mead", options=options)
        assert [np.log(fit.theta) for fit in fits] == pytest.approx(best.x[:3], abs=1e-6)
        assert [fit.beta for fit in fits] == pytest.approx([np.exp(best.x[3])] * 3, rel=1e-6)
        assert fits[0].log_likelihood == pytest.approx(-best.fun, rel=1e-9)

    def test_errors_of_the_curves(self):
        """100 simulated studies with one beta, of which some cross."""
        studies = [fit_limit_states(runs(i, [0.4] * 3), LEVELS, NAMES)[0] for i in range(100)]
        values, errors = [
            np.array([[value(fit) for fit, _ in fits] for fits in studies])
            for value in (lambda f: (np.log(f.theta), f.beta), lambda f: f.standard_errors)
        ]
        assert values[:, :, 0].mean(axis=0) == pytest.approx(np.log([0.2, 0.3, 0.5]), abs=0.01)
        assert values[:, :, 1].mean() == pytest.approx(0.4, abs=0.01)
        assert errors.mean(axis=0) == pytest.approx(values.std(axis=0), rel=0.25)


class TestTies:
    """States that no run separates; the others are fitted jointly all the same."""

    def test_two_states_with_the_same_exceedances(self):
        three, _ = fit_limit_states(CROSSING, LEVELS, NAMES)
        for twice in (0, 1, 2):
            columns = np.sort([0, 1, 2, twice])
            found, _ = fit_limit_states(CROSSING[:, :, columns], LEVELS, "abcd")
            theta = [fit.theta for fit, _ in found]
            assert theta[twice] == theta[twice + 1]
            expected = [three[i][0].theta for i in columns]
            assert theta == pytest.approx(expected, rel=1e-9)

    def test_states_that_all_runs_exceed_or_none(self):
        every = np.ones((40, 10, 1), int)
        exceeded = np.concatenate([every, CROSSING, 0 * every], axis=-1)
        first, *_, last = fit_limit_states(exceeded, LEVELS, "abcde")[0]
        assert first[0] is last[0] is None
        assert "every run" in str(first[1])
        assert "no run" in str(last[1])

    def test_separated_states_have_a_posterior_curve(self):
        exceeded = runs(4, [0.4, 0.4, 0.4])
        exceeded[:, :, 0] = LEVELS > 0.1
        fit, none = fit_limit_states(exceeded, LEVELS, NAMES)[0][0]
        step = LEVELS[LEVELS <= 0.1][-1], LEVELS[LEVELS > 0.1][0]
        assert step[0] < fit.theta < step[1]
        assert (fit.kind == "posterior") == ("no likeliest curve" in str(none))


class TestOrderOfTwo:
    """A milder state is nowhere less probable than a severer one, with the least change."""

    def test_crossing_is_measured(self):
        found = crossing(fragility(1.0, 0.6), fragility(1.1, 0.2))
        assert found == pytest.approx(0.1897, abs=1e-3)
        assert crossing(fragility(1.0, 0.4), fragility(1.5, 0.4)) < 1e-3

    @pytest.mark.parametrize(
        ("mild", "severe"),
        [((1.0, 0.4), (1.0, 0.5)), ((1.0, 0.6), (1.1, 0.2)), ((1.2, 0.4), (1.0, 0.4)),
         ((0.3, 0.2), (1.0, 0.9))],
    )  # fmt: skip
    def test_curves_that_cross_are_moved_as_far_as_needed(self, mild, severe):
        given, other = fragility(*mild), fragility(*severe)
        found = above(given, other)
        assert crossing(given, other) > MOST_CROSSING >= crossing(found, other)
        assert found.theta == min(given.theta, other.theta)
        assert min(mild[1], severe[1]) <= found.beta <= max(mild[1], severe[1])
        if mild[1] != severe[1]:  # not farther than needed
            assert crossing(found, other) > 0.9 * MOST_CROSSING

    def test_curves_that_do_not_cross_stay(self):
        given = fragility(1.0, 0.4)
        assert above(given, fragility(1.5, 0.41)) is given

    def test_below_a_class_of_unlike_arches(self):
        parts = [fragility(theta, 0.1) for theta in (0.5, 2.0)]
        severe = mixture(parts[0], parts)
        assert crossing(above(fragility(1.5, 0.2), severe), severe) <= MOST_CROSSING
