"""Regression with bounds: an independent likelihood, weights, and least squares without them."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from archfrag.fragility.censored_lines import ABOVE, BELOW, OBSERVED, censored_lines


def data(seed, n=80):
    generator = np.random.default_rng(seed)
    x = generator.normal(size=n)
    y = 0.5 + 1.3 * x + generator.normal(0.0, 0.6, n)
    side = np.where(y > 1.5, ABOVE, np.where(y < -1.5, BELOW, OBSERVED))
    return np.column_stack([np.ones(n), x]), np.clip(y, -1.5, 1.5), side


def test_beats_a_search():
    design, y, side = data(1)

    def loss(p):
        z = (y - design @ p[:2]) / np.exp(p[2])
        terms = np.where(side == ABOVE, norm.logsf(z), norm.logcdf(z))
        return -np.sum(np.where(side == OBSERVED, norm.logpdf(z) - p[2], terms))

    options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 5000}
    best = minimize(loss, [0.0, 1.0, 0.0], method="Nelder-Mead", options=options)
    coefficients, deviation, found = censored_lines(design, y, side, np.ones((1, y.size)))
    assert coefficients[0] == pytest.approx(best.x[:2], abs=1e-6)
    assert deviation[0] == pytest.approx(np.exp(best.x[2]), rel=1e-6)
    assert found[0] == pytest.approx(best.fun, rel=1e-10)


def test_without_bounds_it_is_least_squares():
    design, y, _ = data(2)
    side = np.full(y.size, OBSERVED)
    coefficients, deviation, _ = censored_lines(design, y, side, np.ones((1, y.size)))
    expected, square = np.linalg.lstsq(design, y, rcond=None)[:2]
    assert coefficients[0] == pytest.approx(expected, rel=1e-9)
    assert deviation[0] == pytest.approx(np.sqrt(square[0] / y.size), rel=1e-9)


def test_rows_of_weights_and_of_values_are_separate_fits():
    design, y, side = data(3)
    weight = np.random.default_rng(4).integers(0, 3, (3, y.size)).astype(float)
    together = censored_lines(design, y, side, weight)
    for i in range(3):
        repeat = weight[i].astype(int)
        alone = censored_lines(
            np.repeat(design, repeat, axis=0), np.repeat(y, repeat), np.repeat(side, repeat),
            np.ones((1, repeat.sum())),
        )  # fmt: skip
        for part, other in zip(together, alone, strict=True):
            assert part[i] == pytest.approx(other[0], rel=1e-7)
    shifted = censored_lines(design, np.stack([y, 2.0 * y + 3.0]), side, np.ones((1, y.size)))
    assert shifted[0][1] == pytest.approx(2.0 * shifted[0][0] + [3.0, 0.0], rel=1e-7)
    assert shifted[1][1] == pytest.approx(2.0 * shifted[1][0], rel=1e-7)


def test_an_exact_line_has_no_maximum():
    design, _, _ = data(5)
    side = np.full(len(design), OBSERVED)
    _, deviation, loss = censored_lines(design, design[:, 1], side, np.ones((1, len(design))))
    assert np.isnan(deviation).all()
    assert np.isnan(loss).all()
