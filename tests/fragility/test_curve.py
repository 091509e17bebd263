"""The lognormal curve, its band, and the parts of its dispersion in a class."""

import numpy as np
import pytest
from scipy.stats import norm

from archfrag.fragility.curve import split_capacities, split_curves
from archfrag.fragility.fit import fit_stripes

STRIPES = fit_stripes([0.2, 0.4, 0.6, 0.8, 1.0], [0, 3, 4, 13, 16], 40)


def test_delta_method_is_that_of_the_numerical_derivative():
    def z(ln_theta, beta):
        return (np.log(0.5) - ln_theta) / beta

    a, b, h = np.log(STRIPES.theta), STRIPES.beta, 1e-6
    slope = np.array([z(a + h, b) - z(a - h, b), z(a, b + h) - z(a, b - h)]) / (2 * h)
    reach = norm.ppf(0.975) * np.sqrt(slope @ STRIPES.covariance @ slope)
    lower, upper = STRIPES.band([0.5, 0.0], confidence=0.95)
    assert norm.ppf([lower[0], upper[0]]) == pytest.approx([z(a, b) - reach, z(a, b) + reach])
    assert (lower[1], upper[1]) == (0.0, 0.0)
    errors = STRIPES.standard_errors / [1.0, b]
    for interval, error in zip((STRIPES.theta_interval(), STRIPES.beta_interval()), errors):
        low, high = np.log(interval)
        assert 0.5 * (high - low) == pytest.approx(1.6448536 * error, rel=1e-6)


MODEL, RECORD, INTERACTION = 0.25, 0.35, 0.1
SHAPE, STUDIES = (12, 20), 400


def test_known_parts_of_capacities_come_back_and_a_negative_part_is_zero():
    """Mean of squares over 400 studies: standard error of each beta about 1 %."""
    generator, squares = np.random.default_rng(1), []
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
    generator, squares = np.random.default_rng(9), []
    for _ in range(STUDIES):
        logs = generator.normal(0.0, RECORD, SHAPE) + generator.normal(0.0, MODEL, (12, 1))
        beta, theta = logs.std(axis=1, ddof=1), np.exp(logs.mean(axis=1))
        squares.append(np.square(split_curves(theta, beta, beta / np.sqrt(20))))
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx([RECORD, MODEL], rel=0.05)


def test_shared_records_have_their_error_in_common():
    given = np.exp([0.0, 0.2, 0.4]), np.full(3, 0.4), np.full(3, 0.1)
    own, shared = (split_curves(*given, shared=s) for s in (0.0, 0.75))
    assert own[1] ** 2 == pytest.approx(0.04 - 0.01)
    assert shared[1] ** 2 == pytest.approx(0.04 - 0.0025)
