"""Curves by maximum likelihood, their bands, and the parts of the dispersion in a class."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime, minimize
from scipy.special import logit, ndtr
from scipy.stats import norm
from sklearn.linear_model import LogisticRegression

from archfrag.errors import FitError, InputError
from archfrag.fragility.fit import fit_brackets, fit_cloud, fit_ida, fit_stripes
from archfrag.fragility.several import split_capacities, split_curves

CAPACITIES = np.exp(np.random.default_rng(3).normal(0.05, 0.4, 37))
INF = np.inf
SEARCH = {
    "method": "Nelder-Mead",
    "options": {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000},
}


def loss_of_brackets(p, lower, upper):
    z_low, z_high = (
        (np.log(np.maximum(end, 1e-300)) - p[0]) / p[1] for end in (lower, upper)
    )
    with np.errstate(divide="ignore"):
        inside = np.log(norm.cdf(z_high) - norm.cdf(z_low))
    return -np.where(lower == upper, norm.logpdf(z_low) - np.log(p[1]), inside).sum()


def bracketed(seed):
    """25 capacities between levels, three of them exact."""
    levels = np.array([0.2, 0.3, 0.4, 0.5, 0.7])
    capacity = 0.4 * np.exp(0.5 * np.random.default_rng(seed).standard_normal(25))
    place = np.searchsorted(levels, capacity)
    lower = np.append(0.0, levels)[place]
    upper = np.append(levels, INF)[place]
    lower[:3] = upper[:3] = [0.33, 0.41, 0.55]
    return lower, upper


TRUNCATED = np.minimum(CAPACITIES, 1.3), np.where(CAPACITIES > 1.3, INF, CAPACITIES)
CASES = [
    (lambda: fit_ida(CAPACITIES, 1.3), lambda p: loss_of_brackets(p, *TRUNCATED)),
    (lambda: fit_brackets(*bracketed(1)), lambda p: loss_of_brackets(p, *bracketed(1))),
    (lambda: fit_brackets(*bracketed(2)), lambda p: loss_of_brackets(p, *bracketed(2))),
]


@pytest.mark.parametrize(("make", "loss"), CASES)
def test_maximum_and_information_of_an_independently_written_likelihood(make, loss):
    fit = make()
    found = minimize(lambda p: loss([p[0], np.exp(p[1])]), [-0.5, -1.0], **SEARCH)
    assert np.log(fit.theta) == pytest.approx(found.x[0], abs=1e-6)
    assert fit.beta == pytest.approx(np.exp(found.x[1]), rel=1e-6)
    assert fit.log_likelihood == pytest.approx(-found.fun, abs=1e-9)
    point = np.array([np.log(fit.theta), fit.beta])
    steps = 1e-4 * np.eye(2)
    slopes = [
        [approx_fprime(point + sign * s, loss, 1e-5) for sign in (1, -1)] for s in steps
    ]
    information = np.array([(up - down) / 2e-4 for up, down in slopes])
    assert fit.covariance == pytest.approx(
        np.linalg.inv(information), rel=3e-3, abs=1e-6
    )


def test_nearly_separated_counts_reach_their_maximum():
    """Where one run in 40,000 keeps beta from 0 the gradient still vanishes."""
    levels = np.array([0.3, 0.30001, 0.6, 0.61])
    n = 20_000
    k = np.array([1, 0, n - 1, n])
    fit = fit_stripes(levels, k, n)
    z = (np.log(levels) - np.log(fit.theta)) / fit.beta
    up, down = (
        np.exp(norm.logpdf(z) - tail) for tail in (norm.logcdf(z), norm.logsf(z))
    )
    slope = k * up - (n - k) * down
    assert np.abs([slope.sum(), (slope * z).sum()]).max() < 1e-8


COUNT = st.integers(0, 50)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(1e-3, 1e3), COUNT, COUNT), min_size=1, max_size=8))
def test_any_counts_give_a_curve_or_a_fit_error(levels):
    im, collapses, survivals = np.array(levels).T
    try:
        fit = fit_stripes(im, collapses, collapses + survivals)
    except FitError:
        return
    assert fit.beta > 0.0
    assert np.isfinite(fit.theta)
    assert np.all(np.linalg.eigvalsh(fit.covariance) >= 0.0)


class TestClouds:
    def test_logistic_line_is_that_of_scikit_learn(self):
        generator = np.random.default_rng(2)
        x = generator.normal(-1.0, 0.6, 300)
        fell = x >= generator.normal(-1.0, 0.4, 300)
        curve = fit_cloud(np.exp(x), fell)
        model = LogisticRegression(
            C=INF, tol=1e-10, max_iter=1000, solver="newton-cholesky"
        )
        model.fit(x[:, None], fell)
        a = curve["intercept"]
        b = curve["slope"]
        assert (a, b) == pytest.approx(
            (model.intercept_[0], model.coef_[0, 0]), rel=1e-6
        )
        low, high = np.exp((logit(ndtr([-1.0, 1.0])) - a) / b)
        assert a + b * np.log(curve["theta"]) == pytest.approx(0.0, abs=1e-12)
        assert curve["beta"] == pytest.approx(0.5 * np.log(high / low))

    def test_events_widen_the_intervals(self):
        """Ten records an event with an error in common: the interval that knows it is wider."""
        generator = np.random.default_rng(8)
        event = np.repeat(np.arange(20), 10)
        x = generator.normal(-1.0, 0.6, 200)
        error = generator.normal(0.0, 0.5, 20)[event] + generator.normal(0.0, 0.2, 200)
        given = np.exp(x), x >= -1.0 + error
        both = fit_cloud(*given), fit_cloud(*given, event.astype(str))
        widths = [np.log(c["theta_interval"][1] / c["theta_interval"][0]) for c in both]
        assert widths[1] > 1.5 * widths[0]


CURVE = fit_stripes([0.2, 0.4, 0.6, 0.8, 1.0], [0, 3, 4, 13, 16], 40)


def test_delta_method_is_that_of_the_numerical_derivative():
    def z(ln_theta, beta):
        return (np.log(0.5) - ln_theta) / beta

    a = np.log(CURVE.theta)
    b = CURVE.beta
    h = 1e-6
    slope = np.array([z(a + h, b) - z(a - h, b), z(a, b + h) - z(a, b - h)]) / (2 * h)
    reach = norm.ppf(0.975) * np.sqrt(slope @ CURVE.covariance @ slope)
    lower, upper = replace(CURVE, confidence=0.95).band([0.5, 0.0])
    assert norm.ppf([lower[0], upper[0]]) == pytest.approx(
        [z(a, b) - reach, z(a, b) + reach]
    )
    assert (lower[1], upper[1]) == (0.0, 0.0)
    errors = CURVE.standard_errors / [1.0, b]
    for interval, error in zip((CURVE.theta_interval, CURVE.beta_interval), errors):
        low, high = np.log(interval)
        assert 0.5 * (high - low) == pytest.approx(1.6448536 * error, rel=1e-6)


MODEL = 0.25
RECORD = 0.35
INTERACTION = 0.1
SHAPE = (12, 20)
STUDIES = 400


def test_known_parts_of_capacities_come_back_and_a_negative_part_is_zero():
    """Mean of squares over 400 studies: standard error of each beta about 1 %."""
    generator = np.random.default_rng(1)
    squares = []
    for _ in range(STUDIES):
        record = generator.normal(0.0, RECORD, (1, 20))
        logs = generator.normal(0.0, MODEL, (12, 1)) + record
        capacity = np.exp(logs + generator.normal(0.0, INTERACTION, SHAPE))
        squares.append(np.square(split_capacities(capacity)))
    truth = [np.hypot(RECORD, INTERACTION), MODEL]
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx(truth, rel=0.04)
    logs = np.random.default_rng(7).normal(size=(1, 30)) * np.ones((5, 1))
    noise = np.random.default_rng(8).normal(0.0, 0.3, (5, 30))
    noise -= noise.mean(axis=1, keepdims=True)
    assert split_capacities(np.exp(logs + noise))[1] == 0.0


def test_sampling_error_of_curves_is_removed():
    generator = np.random.default_rng(9)
    squares = []
    for _ in range(STUDIES):
        logs = generator.normal(0.0, RECORD, SHAPE) + generator.normal(
            0.0, MODEL, (12, 1)
        )
        beta = logs.std(axis=1, ddof=1)
        theta = np.exp(logs.mean(axis=1))
        squares.append(np.square(split_curves(theta, beta, beta / np.sqrt(20))))
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx([RECORD, MODEL], rel=0.05)


def test_shared_records_have_their_error_in_common():
    given = np.exp([0.0, 0.2, 0.4]), np.full(3, 0.4), np.full(3, 0.1)
    own, shared = (split_curves(*given, shared=s) for s in (0.0, 0.75))
    assert own[1] ** 2 == pytest.approx(0.04 - 0.01)
    assert shared[1] ** 2 == pytest.approx(0.04 - 0.0025)


def test_a_curve_of_no_study_is_tabulated_at_intensities_that_are_given():
    curve = fit_ida([0.5, 0.7, 0.9, 1.3])
    assert curve.to_dataframe([0.4, 0.8])["intensity"].tolist() == [0.4, 0.8]
    with pytest.raises(InputError, match="im must be given"):
        curve.to_dataframe()


def test_a_curve_in_another_unit_has_its_likeliest_curve_in_that_unit():
    curve = fit_ida([0.5, 0.7, 0.9, 1.3])
    other = replace(curve, likelihood=curve).in_unit(2.0, "PGA", "g")
    assert other.theta == other.likelihood.theta == curve.theta / 2.0
    assert other.likelihood.beta == curve.beta
