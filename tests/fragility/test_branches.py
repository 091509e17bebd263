"""Branches of a curve and its mean over theta and beta: both have the mean rate of collapse."""

import numpy as np
import pytest
from scipy.special import ndtr

from archfrag.fragility.curve import Curve
from archfrag.fragility.quoted import capacity_posterior
from archfrag.fragility.risk import (
    HazardCurve,
    branches_of,
    collapse_rate,
    predictive,
)
from archfrag.fragility.verdicts import find_brackets

SITES = {
    "power": HazardCurve([0.01, 3.0], [1.0, (0.01 / 3.0) ** 2.0]),
    "table": HazardCurve(
        [0.01, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6],
        [0.3, 0.05, 0.015, 3.5e-3, 6e-4, 8e-5, 6e-6],
    ),
}


def uncertain(beta=0.4, error=0.15, wide=0.2, correlation=0.3, **more):
    """A curve with standard errors of ln theta and ln beta."""
    between = correlation * error * wide * beta
    covariance = np.array([[error**2, between], [between, (wide * beta) ** 2]])
    return Curve(0.5, beta, covariance, kind="posterior", **more)


def weighted_rate(site, curves, weights):
    return weights @ [collapse_rate(site, each).rate for each in curves]


@pytest.mark.parametrize(
    ("site", "beta", "wide"),
    [
        ("power", 0.25, 0.2),
        ("power", 0.4, 0.3),
        ("table", 0.4, 0.2),
        ("table", 0.6, 0.3),
    ],
)
def test_branches_and_the_predictive_curve_have_the_mean_rate(site, beta, wide):
    hazard = SITES[site]
    curve = uncertain(beta, wide=wide)
    draws = curve.draws(15)
    mean = collapse_rate(hazard, curve, draws).mean
    assert (
        abs(mean / collapse_rate(hazard, curve).rate - 1.0) > 0.01
    )  # that of the medians
    assert weighted_rate(hazard, *branches_of(curve, draws)) == pytest.approx(
        mean, rel=5e-3
    )
    assert collapse_rate(hazard, predictive(curve, draws)).rate == pytest.approx(
        mean, rel=1e-9
    )


def test_rates_of_branches_are_the_closed_form():
    curves, weights = branches_of(curve := uncertain(), curve.draws(15))
    k = 2.0
    site = SITES["power"]
    closed = [
        1e-4 * each.theta**-k * np.exp(0.5 * (k * each.beta) ** 2) for each in curves
    ]
    assert weighted_rate(site, curves, weights) == pytest.approx(
        weights @ closed, rel=1e-9
    )


def test_branches_are_parts_of_the_draws():
    """Parts of the same probability, each with its mean of ln theta and nearly that of ln beta."""
    curve = uncertain()
    draws = np.log(curve.draws(15))
    curves, weights = branches_of(curve, tuple(np.exp(draws)))
    logs = np.log([[each.theta, each.beta] for each in curves]).T
    assert len(curves) == 15
    assert weights.sum() == pytest.approx(1.0, abs=1e-15)
    assert weights.reshape(5, 3).sum(axis=1) == pytest.approx(
        [0.3, 0.3, 0.25, 0.12, 0.03]
    )
    assert logs[0] @ weights == pytest.approx(draws[0].mean(), rel=1e-12)
    assert logs[1] @ weights == pytest.approx(
        draws[1].mean(), abs=0.15 * draws[1].std()
    )
    within = np.sort(draws[1])[[0, int(0.3 * draws.shape[1])]]
    assert np.all((logs[1, :3] >= within[0]) & (logs[1, :3] <= within[1] + 0.05))
    spread = np.sqrt(np.cov(logs, aweights=weights, ddof=0).diagonal()) / draws.std(
        axis=1
    )
    assert np.all((spread > 0.8) & (spread < 1.05))


@pytest.mark.parametrize(("n", "seed"), [(5, 1), (6, 2), (8, 3), (12, 4)])
@pytest.mark.parametrize("slope", [2.0, 2.5, 3.0])
def test_branches_of_few_records_have_the_mean_rate(n, seed, slope):
    """Where the posterior has a long tail of beta: Gauss' quadrature over ln beta was 30 % off."""
    levels = np.geomspace(0.1, 2.0, 15)
    capacity = 0.45 * np.exp(0.4 * np.random.default_rng(seed).standard_normal((n, 1)))
    curve = capacity_posterior(find_brackets(levels >= capacity, levels))[0].curve
    ends = np.array([0.01, 0.02, 5.0])
    hazard = HazardCurve(ends, ends.clip(min=0.02) ** -slope)
    draws = curve.draws(15)
    mean = collapse_rate(hazard, curve, draws).mean
    assert weighted_rate(hazard, *branches_of(curve, draws)) == pytest.approx(
        mean, rel=0.08
    )


def test_the_predictive_curve_is_the_mean_at_each_intensity():
    curve = uncertain()
    im = np.array([0.1, 0.3, 0.5, 1.0])
    theta, beta = curve.draws(15)
    found = predictive(curve, (theta, beta))
    expected = ndtr(np.log(im[:, None] / theta) / beta).mean(axis=1)
    np.testing.assert_allclose(found(im), expected, rtol=1e-12)
    assert found.beta > curve.beta
    assert found(0.15) > curve(0.15)


def test_the_arches_of_a_class_move_together():
    """ln capacity is moved and stretched: a mean of curves keeps its shape in each branch."""
    members = np.array([[0.4, 0.3], [0.6, 0.35]])
    curve = uncertain(
        np.sqrt((members[:, 1] ** 2).mean() + np.log(members[:, 0]).var()),
        members=members,
    )
    curve = Curve(**{**vars(curve), "theta": np.sqrt(0.24)})
    draws = curve.draws(15)
    curves, weights = branches_of(curve, draws)
    for each in curves:
        im = np.geomspace(0.1, 2.0, 7)
        moved = each.theta * (im / curve.theta) ** (each.beta / curve.beta)
        np.testing.assert_allclose(each(moved), curve(im), rtol=1e-12)
    mean = weights @ [each(0.3) for each in curves]
    np.testing.assert_allclose(predictive(curve, draws)(0.3), mean, rtol=0.01)
