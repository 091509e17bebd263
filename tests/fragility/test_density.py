"""What a curve keeps of its posterior: bands at any intensity, draws, a copy in JSON."""

import json

import numpy as np
import pytest
from scipy.special import ndtr

from archfrag.fragility.curve import Curve
from archfrag.fragility.posterior import fit_posterior
from archfrag.fragility.quoted import capacity_posterior
from archfrag.fragility.risk import HazardCurve, collapse_rate, lognormal_rates
from archfrag.fragility.verdicts import find_brackets

LEVELS = np.array([0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4])
BEND = HazardCurve(
    np.array([0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0]),
    np.array([0.3, 0.05, 6e-3, 6e-4, 4e-5, 1.5e-6, 3e-8]),
)


def records(n, seed=5, levels=LEVELS):
    capacity = 0.45 * np.exp(0.4 * np.random.default_rng(seed).standard_normal((n, 1)))
    return capacity_posterior(find_brackets(levels >= capacity, levels))[0]


def single(n=12, seed=2):
    generator = np.random.default_rng(seed)
    im = 0.3 * np.exp(0.5 * generator.standard_normal(n))
    return fit_posterior(im, im >= 0.3 * np.exp(0.4 * generator.standard_normal(n)), 1)


@pytest.mark.parametrize(
    "known", [records(24), records(6), single()], ids=["24", "6", "single"]
)
class TestBand:
    def test_beyond_the_levels_it_is_that_of_the_posterior(self, known):
        curve = known.with_band(np.linspace(0.0, 0.42, 120))
        for im in (0.42, 0.5, 0.8, 3.0):
            value, low, high = curve.at(im)
            assert (low, high) == pytest.approx(known.band(im), abs=2e-4)
            assert low < value < high
        assert curve.at(0.0)[1:] == (0.0, 0.0)
        assert curve.at(np.inf)[1:] == (1.0, 1.0)
        np.testing.assert_array_equal(curve.band(curve.im), (curve.lower, curve.upper))

    def test_it_is_the_same_in_another_unit_and_from_a_file(self, known):
        curve = known.with_band(np.linspace(0.0, 0.42, 120))
        stored = Curve.from_dict(json.loads(json.dumps(curve.to_dict())))
        assert stored.at(0.8) == curve.at(0.8)
        assert stored.draws(3)[1].tolist() == curve.draws(3)[1].tolist()
        assert curve.in_unit(0.01, "PGA", "x").at(80.0) == pytest.approx(
            curve.at(0.8), abs=1e-9
        )
        table = curve.to_dataframe([0.2, 0.8])
        assert table[["lower", "upper"]].iloc[1].tolist() == list(curve.at(0.8)[1:])


def test_a_curve_has_the_band_of_its_posterior_also_without_points():
    known = records(8)
    assert known.curve.at(0.3)[1:] == pytest.approx(known.band(0.3), abs=2e-4)


@pytest.mark.parametrize("n", [5, 8, 24])
def test_draws_have_the_quantiles_of_the_posterior(n):
    known = records(n, 9, np.geomspace(0.1, 2.0, 15))
    theta, beta = known.curve.draws(15)
    tails = [0.05, 0.5, 0.95]
    np.testing.assert_allclose(
        np.log(np.quantile(theta, tails)),
        known.log_thetas(tails),
        atol=0.03 * np.log(theta).std(),
    )
    np.testing.assert_allclose(np.quantile(beta, tails), known.betas(tails), rtol=0.02)
    im = np.array([0.2, 0.4, 0.8])
    drawn = np.quantile(
        ndtr(np.log(im / theta[:, None]) / beta[:, None]), [0.05, 0.95], axis=0
    )
    np.testing.assert_allclose(drawn, known.band(im), atol=0.01)


@pytest.mark.parametrize(("n", "seed"), [(5, 1), (5, 2), (8, 3), (24, 4)])
def test_the_band_of_a_rate_is_that_of_the_posterior(n, seed):
    """Against the rate at every node; normal draws put the upper end 20 % too low."""
    known = records(n, seed, np.geomspace(0.1, 2.0, 15))
    beta = np.broadcast_to(known.beta[:, None], known.density.shape)
    rates = lognormal_rates(BEND, np.exp(known.log_theta), beta).ravel()
    order = np.argsort(rates)
    below = np.cumsum(known.density.ravel()[order])
    low, high = np.interp([0.05, 0.95], below / below[-1], rates[order])
    found = collapse_rate(BEND, known.curve, known.curve.draws(15))
    assert found.lower == pytest.approx(low, rel=0.05)
    assert found.upper == pytest.approx(high, rel=0.12)


def test_draws_of_a_curve_that_was_moved_move_with_it():
    curve = records(12).curve
    moved = Curve(
        **{**vars(curve), "theta": 2.0 * curve.theta, "beta": 0.5 * curve.beta}
    )
    for one, two, factor in zip(curve.draws(15), moved.draws(15), (2.0, 0.5)):
        np.testing.assert_allclose(two, factor * one, rtol=1e-12)
