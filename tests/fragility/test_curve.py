"""The lognormal curve, its band, and the parts of its dispersion in a class."""

import json

import numpy as np
import pytest
from scipy.stats import norm

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Fragility, split_capacities, split_curves
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


def test_json_round_trip():
    copy = Fragility.from_dict(json.loads(json.dumps(STRIPES.to_dict())))
    assert copy == STRIPES
    assert np.array_equal(copy.covariance, STRIPES.covariance)


MODEL, RECORD, INTERACTION = 0.25, 0.35, 0.1
ARCHES, RECORDS, STUDIES = 12, 20, 400


def study(generator, shared=True):
    shape = (ARCHES, RECORDS)
    record = generator.normal(0.0, RECORD, (1, RECORDS) if shared else shape)
    logs = generator.normal(0.0, MODEL, (ARCHES, 1)) + record
    return logs + generator.normal(0.0, INTERACTION, shape) if shared else logs


def test_known_parts_of_capacities_come_back():
    """Mean of squares over 400 studies: standard error of each beta about 1 %."""
    generator = np.random.default_rng(1)
    betas = np.array([split_capacities(np.exp(study(generator))) for _ in range(STUDIES)])
    truth = [np.hypot(RECORD, INTERACTION), MODEL]
    assert np.sqrt(np.mean(betas**2, axis=0)) == pytest.approx(truth, rel=0.04)


def test_a_negative_part_is_zero():
    logs = np.random.default_rng(7).normal(size=(1, 30)) * np.ones((5, 1))
    noise = np.random.default_rng(8).normal(0.0, 0.3, (5, 30))
    noise -= noise.mean(axis=1, keepdims=True)
    assert split_capacities(np.exp(logs + noise))[1] == 0.0


def test_sampling_error_of_curves_is_removed():
    generator, squares = np.random.default_rng(9), []
    for _ in range(STUDIES):
        logs = study(generator, shared=False)
        beta, theta = logs.std(axis=1, ddof=1), np.exp(logs.mean(axis=1))
        squares.append(np.square(split_curves(theta, beta, beta / np.sqrt(RECORDS))))
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx([RECORD, MODEL], rel=0.05)


def test_shared_records_have_their_error_in_common():
    given = np.exp([0.0, 0.2, 0.4]), np.full(3, 0.4), np.full(3, 0.1)
    own, shared = (split_curves(*given, shared=s) for s in (0.0, 0.75))
    assert own[1] ** 2 == pytest.approx(0.04 - 0.01)
    assert shared[1] ** 2 == pytest.approx(0.04 - 0.0025)


@pytest.mark.parametrize(
    ("make", "arguments", "more", "kind", "key"),
    [
        (STRIPES.band, (0.5, 90.0), {}, InputError, "confidence is 90"),
        (Fragility.from_dict, ({"theta": 1.0},), {}, InputError, "'beta'"),
        (split_capacities, ([[1.0, 2.0]],), {}, FitError, "1 arches"),
        (split_capacities, ([[1.0, np.nan], [1.0, 2.0]],), {}, FitError, "1 records"),
        (split_curves, ([1, 2], [0.4] * 2, [0.1] * 2), {"shared": 1.0}, InputError, "shared is 1"),
        (split_curves, ([1, 2], [0.4, 0.4], [0.1]), {}, InputError, "standard_error"),
        (split_curves, ([1], [0.4], [0.1]), {}, FitError, "one arch"),
    ],
)
def test_refusals(make, arguments, more, kind, key):
    with pytest.raises(kind, match=key):
        make(*arguments, **more)
