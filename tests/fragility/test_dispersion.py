"""Parts of dispersion of a class, and two settings together, by simulation."""

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.control_variates import estimate_two_fidelity
from archfrag.fragility.dispersion import combine, split_capacities, split_curves

MODEL, RECORD, INTERACTION = 0.25, 0.35, 0.1
ARCHES, RECORDS, STUDIES = 12, 20, 400


def study(generator, shared=True, n_record=RECORDS):
    shape = (ARCHES, n_record)
    record = generator.normal(0.0, RECORD, (1, n_record) if shared else shape)
    logs = generator.normal(0.0, MODEL, (ARCHES, 1)) + record
    return logs + generator.normal(0.0, INTERACTION, shape) if shared else logs


class TestCapacities:
    """Mean of squares over 400 studies: standard error of each beta about 1 %."""

    def test_known_parts_come_back(self):
        generator = np.random.default_rng(1)
        found = [split_capacities(np.exp(study(generator))) for _ in range(STUDIES)]
        betas = np.array([(parts.beta_record_to_record, parts.beta_model) for parts in found])
        truth = [np.hypot(RECORD, INTERACTION), MODEL]
        assert np.sqrt(np.mean(betas**2, axis=0)) == pytest.approx(truth, rel=0.04)
        errors = np.nanmean([parts.standard_errors for parts in found], axis=0)
        assert errors == pytest.approx(betas.std(axis=0), rel=0.2)

    def test_numerical_part_is_taken_from_record_to_record(self):
        capacity = np.exp(study(np.random.default_rng(5)))
        before, less = split_capacities(capacity), split_capacities(capacity, numerical=0.2)
        square = before.beta_record_to_record**2 - 0.04
        assert less.beta_record_to_record**2 == pytest.approx(square)
        assert (less.beta_model, less.beta_numerical) == (before.beta_model, 0.2)

    def test_a_negative_part_is_zero_and_reported(self):
        logs = np.random.default_rng(7).normal(size=(1, 30)) * np.ones((5, 1))
        noise = np.random.default_rng(8).normal(0.0, 0.3, (5, 30))
        noise -= noise.mean(axis=1, keepdims=True)
        parts = split_capacities(np.exp(logs + noise))
        assert parts.beta_model == 0.0
        assert "modelling variance" in parts.notes[0]


class TestCurves:
    def test_sampling_error_is_removed(self):
        generator, squares = np.random.default_rng(9), []
        for _ in range(STUDIES):
            logs = study(generator, False)
            beta, theta = logs.std(axis=1, ddof=1), np.exp(logs.mean(axis=1))
            parts = split_curves(theta, beta, beta / np.sqrt(RECORDS), n_record=RECORDS)
            squares.append([parts.beta_record_to_record**2, parts.beta_model**2])
        assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx([RECORD, MODEL], rel=0.05)

    def test_shared_records_have_their_error_in_common(self):
        given = np.exp([0.0, 0.2, 0.4]), np.full(3, 0.4), np.full(3, 0.1)
        own, shared = (split_curves(*given, n_record=16, shared=s) for s in (0.0, 0.75))
        assert own.beta_model**2 == pytest.approx(0.04 - 0.01)
        assert shared.beta_model**2 == pytest.approx(0.04 - 0.0025)


SLOPE, NOISE, SIGMA = 0.85, 0.08, 0.4


def pair(generator, n=100, m=15):
    x = generator.normal(0.0, SIGMA, n)
    y = 0.1 + SLOPE * x + generator.normal(0.0, NOISE, n)
    y[m:] = np.nan
    return np.exp(x), np.exp(y)


class TestTwoFidelities:
    def test_estimates_and_their_errors(self):
        """400 studies; the standard error of their mean is 0.002."""
        generator = np.random.default_rng(1)
        found = [estimate_two_fidelity(*pair(generator)) for _ in range(400)]
        values = np.array([[np.log(each.theta), each.beta] for each in found])
        errors = np.mean([each.standard_errors for each in found], axis=0)
        truth = [0.1, np.hypot(SLOPE * SIGMA, NOISE)]
        assert values.mean(axis=0) == pytest.approx(truth, abs=0.015)
        assert errors == pytest.approx(values.std(axis=0), rel=0.15)
        expected = np.sqrt((SLOPE * SIGMA) ** 2 / 100 + NOISE**2 / 15)
        assert values[:, 0].std() == pytest.approx(expected, rel=0.15)

    def test_bias_of_the_estimated_coefficient_is_estimated(self):
        """Skewed capacities and a curved relation: c from 8 records biases ln theta; the
        jackknife takes out most of it (1,000 studies, standard error 0.004)."""
        generator, raw, corrected = np.random.default_rng(2), [], []
        for _ in range(1000):
            x = generator.gamma(1.0, 0.4, 60)
            y = x + 0.8 * x**2
            y[8:] = np.nan
            found = estimate_two_fidelity(np.exp(x), np.exp(y))
            corrected.append(np.log(found.theta) - (0.4 + 0.8 * 2.0 * 0.4**2))
            raw.append(corrected[-1] + found.bias[0])
        assert abs(np.mean(raw)) > 0.03
        assert abs(np.mean(corrected)) < 0.5 * abs(np.mean(raw))

    def test_is_the_likeliest_estimate_of_normal_values(self):
        """Anderson 1957: regression on the pairs, moments of the cheap values over all records."""
        coarse, fine = pair(np.random.default_rng(5))
        found = estimate_two_fidelity(coarse, fine)
        x, y = np.log(coarse), np.log(fine[:15])
        slope, intercept = np.polyfit(x[:15], y, 1)
        residual = y - intercept - slope * x[:15]
        raw = np.log(found.theta) + found.bias[0], found.beta + found.bias[1]
        beta = np.sqrt(np.mean(residual**2) + slope**2 * x.var())
        assert raw == pytest.approx((intercept + slope * x.mean(), beta), rel=1e-9)


COARSE, FINE = pair(np.random.default_rng(4))


@pytest.mark.parametrize(
    ("make", "arguments", "more", "kind", "key"),
    [
        (split_capacities, ([[1.0, 2.0]],), {}, FitError, "1 arches"),
        (split_capacities, ([[1.0, np.nan], [1.0, 2.0]],), {}, FitError, "1 records"),
        (split_capacities, (np.eye(2) + 1,), {"numerical": -1.0}, InputError, "dispersion is -1"),
        (split_curves, ([1, 2], [0.4] * 2, [0.1] * 2), {"shared": 1.0}, InputError, "shared is 1"),
        (split_curves, ([1, 2], [0.4, 0.4], [0.1]), {}, InputError, "standard_error"),
        (split_curves, ([1], [0.4], [0.1]), {}, FitError, "one arch"),
        (combine, (0.3, -0.1), {}, InputError, r"-0\.1"),
        (estimate_two_fidelity, (COARSE, FINE[:5]), {}, InputError, "shape"),
        (estimate_two_fidelity, (COARSE[12:], FINE[12:]), {}, FitError, "4 are needed"),
        (estimate_two_fidelity, (np.ones(100), FINE), {}, FitError, "do not vary"),
    ],
)
def test_refusals(make, arguments, more, kind, key):
    more = {"n_record": 9} | more if make is split_curves else more
    with pytest.raises(kind, match=key):
        make(*arguments, **more)
