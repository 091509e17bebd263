"""Curves of classes of arches: mixtures, their lognormal equivalent, quantiles, sensitivity."""

import numpy as np
import pytest
from scipy.special import ndtr

from archfrag.errors import InputError
from archfrag.fragility.classes import (
    capacity_curves,
    class_curve,
    mean_curve,
    quantile_curves,
    sensitivities,
)


class TestMixture:
    def test_one_arch_is_its_own_class(self):
        alone = class_curve([0.9], [0.4])
        im = np.linspace(0.0, 3.0, 31)
        assert (alone.theta, alone.beta) == pytest.approx((0.9, 0.4))
        assert alone.beta_model == 0.0
        assert alone.median == pytest.approx(0.9, rel=1e-12)
        assert alone.misfit < 1e-15
        np.testing.assert_allclose(alone.probability(im), alone.equivalent(im), atol=1e-15)

    def test_lognormal_thetas_of_equal_beta_are_a_lognormal_again(self):
        # A normal mean with normal scatter about it: variances add.
        u = (np.arange(20_000) + 0.5) / 20_000
        from scipy.special import ndtri

        between = class_curve(1.2 * np.exp(0.25 * ndtri(u)), np.full(u.size, 0.3))
        assert between.theta == pytest.approx(1.2, rel=1e-9)
        assert between.beta == pytest.approx(np.hypot(0.25, 0.3), rel=1e-3)
        assert between.misfit < 2e-4

    def test_variance_is_that_of_capacities_drawn_from_the_class(self):
        rng = np.random.default_rng(3)
        theta, beta, weights = [0.5, 1.0, 2.5], [0.2, 0.5, 0.3], [1.0, 2.0, 1.0]
        arch = rng.choice(3, 200_000, p=np.array(weights) / 4.0)
        logs = np.log(np.array(theta)[arch]) + np.array(beta)[arch] * rng.normal(size=arch.size)
        found = class_curve(theta, beta, weights)
        assert np.log(found.theta) == pytest.approx(logs.mean(), abs=0.01)
        assert found.beta == pytest.approx(logs.std(), rel=0.01)
        assert found.beta**2 == pytest.approx(found.beta_record_to_record**2 + found.beta_model**2)
        im = np.array([0.4, 0.9, 1.5, 3.0])
        drawn = (np.exp(logs)[:, None] <= im).mean(axis=0)
        np.testing.assert_allclose(found.probability(im), drawn, atol=0.005)
        assert found.probability(found.median) == pytest.approx(0.5, abs=1e-12)
        assert found.misfit > 0.01

    def test_arches_without_a_curve_are_left_out(self):
        some = class_curve([1.0, np.nan, 2.0], [0.3, 0.3, np.nan], [1.0, 5.0, 5.0])
        assert (some.theta, some.weights.tolist()) == (1.0, [1.0])

    @pytest.mark.parametrize(
        ("theta", "beta", "weights", "part"),
        [
            ([1.0], [0.3, 0.3], None, "shapes"),
            ([0.0], [0.3], None, "theta holds 0"),
            ([1.0], [np.inf], None, "beta holds inf"),
            ([np.nan], [0.3], None, "no arch"),
            ([1.0], [0.3], [0.0], "no arch"),
            ([1.0], [0.3], [-1.0], "weights holds -1"),
            ([1.0], [0.3], [1.0, 1.0], "weights has shape"),
        ],
    )
    def test_bad_input_is_refused(self, theta, beta, weights, part):
        with pytest.raises(InputError, match=part):
            class_curve(theta, beta, weights)


class TestCurvesOfAnyKind:
    def test_fractions_of_records_that_collapse_an_arch(self):
        curves = capacity_curves(
            [[0.5, 1.5, np.inf, np.nan], [np.nan] * 4, [1.0, 1.0, 1.0, 1.0]], [0.5, 1.0, 2.0]
        )
        np.testing.assert_allclose(curves[0], [1 / 3, 1 / 3, 2 / 3])
        assert np.isnan(curves[1]).all()
        np.testing.assert_allclose(curves[2], [0.0, 1.0, 1.0])
        np.testing.assert_allclose(mean_curve(curves), [1 / 6, 2 / 3, 5 / 6])

    def test_mean_of_members_is_the_mixture(self):
        found = class_curve([0.5, 1.0, 2.0], [0.3, 0.4, 0.2], [1.0, 3.0, 2.0])
        im = np.linspace(0.1, 4.0, 9)
        mean = mean_curve(found.members(im), found.weights)
        np.testing.assert_allclose(mean, found.probability(im), atol=1e-14)

    def test_quantiles_of_ten_curves(self):
        curves = np.linspace(0.1, 1.0, 10)[:, None] * np.array([1.0, 0.5])
        found = quantile_curves(curves[::-1], [0.1, 0.5, 0.9, 1.0])
        np.testing.assert_allclose(found[:, 0], [0.1, 0.5, 0.9, 1.0])
        np.testing.assert_allclose(found[:, 1], [0.05, 0.25, 0.45, 0.5])

    def test_a_weight_of_three_is_three_arches(self):
        curves = ndtr(np.array([[-1.0], [0.2], [1.3]]))
        repeated = curves[[0, 1, 1, 1, 2]]
        q = [0.05, 0.3, 0.5, 0.79, 0.95]
        np.testing.assert_array_equal(
            quantile_curves(curves, q, [1.0, 3.0, 1.0]), quantile_curves(repeated, q)
        )

    def test_quantiles_are_from_zero_to_one(self):
        with pytest.raises(InputError, match=r"quantiles holds 1\.5"):
            quantile_curves([[0.5]], [1.5])


class TestSensitivity:
    def test_ranks_decide_and_the_strongest_comes_first(self):
        rng = np.random.default_rng(1)
        thickness, friction = rng.normal(size=(2, 400))
        theta = np.exp(2.0 * thickness) + 0.0 * friction
        found = sensitivities(
            theta, {"friction": friction, "thickness": thickness, "fixed": np.ones(400)}
        )
        assert [s.parameter for s in found] == ["thickness", "friction", "fixed"]
        assert found[0].correlation == pytest.approx(1.0)
        assert found[1].lower < 0.0 < found[1].upper
        assert np.isnan(found[2].correlation)

    def test_ties_share_their_rank(self):
        # By hand: ranks 1.5 1.5 3 4 5 against 1 2 3 4 5; Pearson's r of those is 9.5/sqrt(95).
        found = sensitivities([1, 1, 2, 3, 4], {"a": [1, 2, 3, 4, 5]})[0]
        assert found.correlation == pytest.approx(9.5 / np.sqrt(95.0))

    def test_intervals_hold_the_truth(self):
        # Spearman's correlation of a normal pair is 6/pi arcsin(rho/2).
        rng = np.random.default_rng(7)
        truth, inside = 6.0 / np.pi * np.arcsin(0.25), 0
        for _ in range(400):
            x, e = rng.normal(size=(2, 40))
            found = sensitivities(x, {"a": 0.5 * x + np.sqrt(0.75) * e})[0]
            inside += found.lower <= truth <= found.upper
        assert 0.86 <= inside / 400 <= 0.94

    def test_arches_without_the_parameter_are_left_out(self):
        found = sensitivities([1.0, 2.0, np.nan, 4.0], {"a": [1.0, 2.0, 3.0, np.nan]})[0]
        assert (found.n_arch, found.correlation) == (2, pytest.approx(1.0))
        assert np.isnan(found.lower)

    def test_lengths_must_be_equal(self):
        with pytest.raises(InputError, match="parameter a has shape"):
            sensitivities([1.0, 2.0], {"a": [1.0]})
