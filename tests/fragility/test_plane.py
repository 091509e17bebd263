"""P(collapse | two intensities): the likeliest plane, its band, and what it gains where it can."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr

from archbench.bands import coverage_of_planes
from archfrag.errors import FitError
from archfrag.fragility.plane import fit_plane
from archfrag.fragility.posterior import fit_capacity_posterior, fit_posterior
from archfrag.fragility.verdicts import find_brackets

LEVELS = np.geomspace(0.25, 4.0, 15)


def records(seed, n=30, gamma=0.5, beta=0.3):
    """ln capacities, and ln ratio of the two measures on which they depend."""
    generator = np.random.default_rng(seed)
    s = 0.6 * generator.standard_normal(n)
    return gamma * s + beta * generator.standard_normal(n), s


def stripes(logs, levels=LEVELS):
    return find_brackets(np.exp(logs)[:, None] <= levels, levels)


def cloud(seed, n=60, **world):
    logs, s = records(seed, n, **world)
    level = np.exp(0.7 * np.random.default_rng(seed + 99).standard_normal(n))[:, None]
    return find_brackets(np.exp(logs)[:, None] <= level, level), s


class TestLikeliest:
    def test_of_single_runs_it_is_that_of_a_probit(self):
        found, s = cloud(1)
        x = np.log(found.levels[:, 0])
        collapsed = found.verdict[:, 0]
        rows = np.column_stack([np.ones(x.size), x, s + x])
        loss = lambda p: -log_ndtr((2 * collapsed - 1) * (rows @ p)).sum()  # noqa: E731
        best = minimize(loss, [0.0, 1.0, 0.0], method="BFGS", options={"gtol": 1e-9})
        plane = fit_plane(found, np.exp(s), 1.0)
        np.testing.assert_allclose(plane.coefficients, best.x, rtol=2e-5)

    def test_of_records_it_is_that_of_their_brackets(self):
        logs, s = records(2)
        found = stripes(logs)
        low = np.log(np.maximum(found.lower, 1e-300))
        high = np.log(found.upper)

        def loss(p):
            shift = p[0] + p[2] * s
            upper = ndtr((p[1] + p[2]) * high + shift)
            return -np.log(upper - ndtr((p[1] + p[2]) * low + shift)).sum()

        best = minimize(
            loss,
            [0.0, 3.0, -1.0],
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 5000},
        )
        plane = fit_plane(found, np.exp(s), 1.0)
        np.testing.assert_allclose(plane.coefficients, best.x, rtol=1e-5)

    def test_of_single_runs_it_does_not_hang_on_how_a_record_is_scaled(self):
        """x2 / x1^k is not asked for at another level."""
        found, s = cloud(3)
        x = np.log(found.levels[:, 0])
        one, two = (fit_plane(found, np.exp(s + (1 - k) * x), k) for k in (1.0, 0.3))
        np.testing.assert_allclose(one.coefficients, two.coefficients, rtol=1e-6)
        im = np.exp([-0.5, 0.0, 0.5])
        np.testing.assert_allclose(one.at(im, im), two.at(im, im), atol=0.02)
        assert one.gain == pytest.approx(two.gain, abs=0.01)


class TestExact:
    """Each capacity stands at both of two ratios: the second measure has no effect."""

    def test_along_the_first_measure_it_is_the_curve(self):
        logs = np.repeat(0.4 * np.random.default_rng(4).standard_normal(15), 2)
        found = stripes(logs)
        s = np.tile([-0.5, 0.5], 15)
        plane = fit_plane(found, np.exp(s), 1.0)
        curve = fit_capacity_posterior(found)
        chance, low, high = plane.at(LEVELS, LEVELS)
        np.testing.assert_allclose(chance, curve.curve(LEVELS), atol=0.01)
        np.testing.assert_allclose([low, high], curve.band(LEVELS), atol=0.015)
        assert not plane.gains

    def test_where_single_runs_scatter_too(self):
        generator = np.random.default_rng(11)
        logs = 0.3 * generator.standard_normal(
            (30, 1)
        ) + 0.3 * generator.standard_normal((30, 15))
        found = find_brackets(np.repeat(logs <= np.log(LEVELS), 2, 0), LEVELS)
        s = [-0.5, 0.5]
        plane = fit_plane(found, np.exp(np.tile(s, 30)), 1.0)
        curve = fit_capacity_posterior(found)
        np.testing.assert_allclose(
            plane.at(LEVELS, LEVELS)[0], curve.curve(LEVELS), atol=0.01
        )

    def test_of_single_runs_too(self):
        (found, _), s = cloud(5, 30, gamma=0.0, beta=0.5), np.repeat([-0.5, 0.5], 30)
        found = find_brackets(
            np.tile(found.verdict, (2, 1)), np.tile(found.levels, (2, 1))
        )
        plane = fit_plane(found, np.exp(s), 1.0)
        curve = fit_posterior(*found.single_runs(), 1)
        chance, low, high = plane.at(LEVELS, LEVELS)
        np.testing.assert_allclose(chance, curve.curve(LEVELS), atol=0.02)
        np.testing.assert_allclose([low, high], curve.band(LEVELS), atol=0.04)

    def test_units_change_nothing_but_draws(self):
        logs, s = records(6)
        one = fit_plane(stripes(logs), np.exp(s), 2.0)
        two = fit_plane(
            stripes(logs + np.log(9.8), 9.8 * LEVELS), np.exp(s) * 100 / 9.8**2, 2.0
        )
        assert two.gain == pytest.approx(one.gain, abs=0.01)  # of draws
        np.testing.assert_allclose(two.at(9.8, 100.0), one.at(1.0, 1.0), atol=0.01)


class TestEvents:
    def test_copies_in_one_event_tell_no_more_than_the_record(self):
        """n of three records that are alike is that of one, but for what n itself adds."""
        logs, s = records(7, 16)
        once = fit_plane(stripes(logs), np.exp(s), 1.0)
        event = np.repeat(np.arange(16), 3)
        copied = np.repeat([logs, s], 3, axis=1)
        grouped, alone = (
            fit_plane(stripes(copied[0]), np.exp(copied[1]), 1.0, groups)
            for groups in (event, None)
        )
        widths = [
            np.diff(plane.at(1.0, 1.0)[1:])[0] for plane in (once, grouped, alone)
        ]
        assert widths[1] == pytest.approx(widths[0], rel=0.1)
        assert widths[2] < 0.75 * widths[0]
        assert grouped.gain == pytest.approx(once.gain, abs=0.05)
        assert alone.p_value < 0.3 * grouped.p_value

    @pytest.mark.parametrize(
        "name", ["stripes, 24 records, 3 an event", "cloud, 60 records"]
    )
    def test_the_band_holds_and_no_effect_gains_nothing(self, name):
        found = coverage_of_planes(name, 0.0, 5)
        assert found["band"] > 0.75
        assert found["gain"] <= 0.2

    def test_scatter_of_single_runs_is_in_the_plane(self):
        found = coverage_of_planes(
            "stripes, 30 records, single runs scatter by 0.2", 0.3, 8
        )
        assert found["band"] > 0.75


class TestGain:
    def test_a_measure_that_tells_gains_and_is_tabulated(self):
        logs, s = records(8, gamma=0.6)
        plane = fit_plane(stripes(logs), np.exp(s), 1.0)
        assert plane.gains
        assert (
            "times as likely as by x1 alone, more than chance explains (p = "
            in repr(plane)
        )
        table = plane.to_dataframe(9)
        assert list(table) == ["x1 [1]", "x2 [1]", "probability", "lower", "upper"]
        one, two, chance, low, high = table.values.T
        assert ((low <= chance) & (chance <= high)).all()
        ratio = np.log(two / one)
        assert s.min() - 1e-9 <= ratio.min() < ratio.max() <= s.max() + 1e-9
        assert not table.isna().any(axis=None)

    def test_what_is_held_back_was_not_learned_from(self):
        """Seen runs are always likelier by a plane; runs held back are not without an effect."""
        gains = []
        for seed in range(20, 28):
            logs, s = records(seed, 24, gamma=0.0)
            gains.append(
                fit_plane(stripes(logs), np.exp(s), 1.0, np.arange(24) // 2).gain
            )
        assert np.mean(gains) < -0.005

    def test_no_gain_no_figure(self):
        logs, s = records(9, gamma=0.0)
        plane = fit_plane(stripes(logs), np.exp(s), 1.0)
        for show in (plane.to_dataframe, plane.plot):
            with pytest.raises(
                FitError, match=r"which chance can explain .* use the curve in x1"
            ):
                show()

    def test_runs_are_drawn_over_contours(self):
        logs, s = records(8, gamma=0.6)
        ax = fit_plane(stripes(logs), np.exp(s), 1.0).plot()
        drawn = {line.get_label(): line.get_xdata().size for line in ax.lines}
        assert drawn["collapsed"] + drawn["survived"] == logs.size * LEVELS.size
        assert ax.get_xlabel() == "x1 [1]"


def test_refusals():
    logs, s = records(10)
    for part, ratio, message in (
        (7, s, "of 7 independent earthquakes or records; .* needs 8"),
        (30, 0.0 * s, "say the same .* 1.000.; choose another"),
        (30, 0.01 * s, "say the same"),
    ):
        with pytest.raises(FitError, match=message):
            fit_plane(stripes(logs[:part]), np.exp(ratio[:part]), 1.0)
    with pytest.raises(
        FitError, match="without scatter agrees with all runs; add records"
    ):
        fit_plane(stripes(0.5 * s), np.exp(s), 1.0)
