"""Correlations, ground-motion models and targets of a selection."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.motions.selection import (
    Rupture,
    conditional_spectrum,
    correlation,
    predict,
    read_target,
    spectrum_target,
    target,
)
from archfrag.motions.selection.models import Prediction

PERIODS = np.array([0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])
NEAR = Rupture(magnitude=7.0, distance_km=12.0, vs30_mps=400.0)
FAR = Rupture(
    magnitude=7.6, distance_km=60.0, vs30_mps=400.0, mechanism="RS", dip=40.0, weight=0.5
)


class TestCorrelation:
    # Figure 4 of Baker and Jayaram (2008), as digitised in pygmm's own tests (MIT).
    FIGURE_4 = (
        (0.5, 0.0100194, 0.681997), (0.5, 0.049796, 0.59341), (0.5, 0.099442, 0.47521),
        (0.5, 0.20032, 0.672082), (0.5, 0.74873, 0.854452), (0.5, 1.9892, 0.516177),
        (0.5, 9.9058, 0.112522), (10.0, 0.019795, 0.054988), (10.0, 0.074206, 0.015245),
        (10.0, 0.149147, 0.000766), (10.0, 0.49277, 0.111672), (10.0, 2.4883, 0.51624),
    )  # fmt: skip

    @pytest.mark.parametrize(("first", "second", "read_off"), FIGURE_4)
    def test_figure_of_the_paper(self, first, second, read_off):
        assert correlation(first, second) == pytest.approx(read_off, abs=0.005)

    def test_pygmm_computes_the_same(self):
        from pygmm.baker_jayaram_2008 import calc_correls

        grid = np.geomspace(0.01, 10.0, 61)
        for period in grid:
            assert correlation(grid, period) == pytest.approx(
                calc_correls(grid, period), abs=1e-12
            )

    @pytest.mark.parametrize("period", [0.009, 10.1, np.nan, -1.0])
    def test_outside_of_the_fit(self, period):
        with pytest.raises(InputError, match=r"^period .* is outside 0\.01 to 10 s"):
            correlation(1.0, period)


class TestModels:
    @pytest.mark.parametrize("model", ["ASK14", "BSSA14", "CB14", "CY14", "I14", "ASB14"])
    @pytest.mark.parametrize("mechanism", ["SS", "RS"])
    def test_all_are_within_a_factor_of_two_of_each_other(self, model, mechanism):
        rupture = Rupture(6.5, 20.0, 500.0, mechanism=mechanism, dip=60.0)
        found = predict(rupture, model, [0.1, 1.0])
        middle = predict(rupture, "BSSA14", [0.1, 1.0])
        assert np.abs(found.ln_median - middle.ln_median).max() < np.log(2.0)
        assert ((found.sd > 0.5) & (found.sd < 0.9)).all()
        assert found.notes == ()

    def test_site_is_on_the_footwall(self):
        """No hanging-wall term: at negative Rx the model does not know how far."""
        import pygmm

        rupture = Rupture(7.0, 10.0, 500.0, "RS", dip=40.0, joyner_boore_km=8.0, top_km=1.0)
        model = pygmm.CampbellBozorgnia2014(
            pygmm.Scenario(
                mag=7.0, dist_rup=10.0, dist_jb=8.0, dist_x=-1.0, v_s30=500.0, dip=40.0,
                mechanism="RS", depth_tor=1.0,
            )
        )  # fmt: skip
        found = np.exp(predict(rupture, "CB14", [0.2, 1.0]).ln_median)
        assert found == pytest.approx(model.interp_spec_accels([0.2, 1.0]))

    def test_beyond_what_is_recommended_is_noted(self):
        found = predict(Rupture(6.5, 20.0, 1600.0), "CY14", [1.0])
        assert found.notes == ("CY14 is recommended for Vs30 up to 1500 m/s, not 1600 m/s",)

    @pytest.mark.parametrize(
        ("change", "model", "periods", "reason"),
        [
            ({}, "CY08", [1.0], r"^ground-motion model 'CY08' must be one of ASK14, BSSA14"),
            ({}, "ASB14", [5.0], r"^period 5 s is outside 0\.01 to 4 s of the model ASB14$"),
            ({"region": "mars"}, "CY14", [1.0], r"^region 'mars' is none of the model CY14"),
            ({"mechanism": "NS"}, "I14", [1.0], r"^mechanism 'NS' is none of the model I14"),
            ({"mechanism": "XX"}, "I14", [1.0], r"^mechanism 'XX' of a rupture must be one of"),
            ({"vs30_mps": 0.0}, "CY14", [1.0], r"^vs30_mps = 0\.0 of a rupture must be a number"),
        ],
    )
    def test_refusals(self, change, model, periods, reason):
        facts = {"magnitude": 6.5, "distance_km": 20.0, "vs30_mps": 500.0} | change
        with pytest.raises(InputError, match=reason):
            predict(Rupture(**facts), model, periods)


class TestConditionalSpectrum:
    def test_schur_complement_of_the_joint_normal(self):
        """One rupture: mean and covariance as any joint normal is conditioned."""
        known, level = 4, 0.5
        mu, sd, _ = predict(NEAR, "CY14", PERIODS)
        joint = np.outer(sd, sd) * correlation(PERIODS[:, None], PERIODS)
        others = np.delete(np.arange(PERIODS.size), known)
        gain = joint[others, known] / joint[known, known]
        found = conditional_spectrum(NEAR, level, PERIODS[known], PERIODS)
        assert found.ln_mean[others] == pytest.approx(
            mu[others] + gain * (np.log(level) - mu[known]), abs=1e-12
        )
        expected = joint[np.ix_(others, others)] - np.outer(gain, joint[known, others])
        assert found.covariance[np.ix_(others, others)] == pytest.approx(expected, abs=1e-12)
        assert found.median[known] == pytest.approx(level)
        assert (found.covariance[known] == 0.0).all()

    def test_brute_force_of_a_mixture(self):
        """Two ruptures, two models: spectra drawn, those kept that have Sa(T*)."""
        rng, level, known = np.random.default_rng(5), 0.4, 4
        root = np.linalg.cholesky(correlation(PERIODS[:, None], PERIODS) + 1e-12 * np.eye(7))
        kept = []
        for rupture, weight in ((NEAR, 2 / 3), (FAR, 1 / 3)):
            for model, part in (("CY14", 0.75), ("BSSA14", 0.25)):
                mu, sd, _ = predict(rupture, model, PERIODS)
                drawn = mu + sd * (rng.standard_normal((400_000, 7)) @ root.T)
                near = drawn[np.abs(drawn[:, known] - np.log(level)) < 0.02]
                kept.append((near, weight * part))
        mean = sum(part * rows.mean(axis=0) for rows, part in kept)
        apart = [(rows - mean, part) for rows, part in kept]
        covariance = sum(part * (rows.T @ rows) / len(rows) for rows, part in apart)
        found = conditional_spectrum(
            [NEAR, FAR], level, 1.0, PERIODS, {"CY14": 3.0, "BSSA14": 1.0}
        )
        assert found.ln_mean == pytest.approx(mean, abs=0.03)
        assert found.covariance == pytest.approx(covariance, abs=0.02)

    def test_values_of_a_published_calculation(self, monkeypatch):
        """T* = 0.2 s: medians and sd before and after, as in pygmm's own tests (MIT)."""
        periods = [0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0]
        median = np.array([0.2858, 0.3276, 0.4503, 0.5914, 0.4653, 0.2582, 0.1131, 0.0440])
        sd = np.array([0.4985, 0.4941, 0.4985, 0.5326, 0.6078, 0.6430, 0.6628, 0.6699])
        monkeypatch.setattr(target, "predict", lambda *_: Prediction(np.log(median), sd, ()))
        found = conditional_spectrum(NEAR, 1.1067, 0.2, periods)
        expected = [0.4791, 0.5333, 0.7122, 1.1067, 0.7518, 0.3614, 0.1379, 0.0480]
        assert found.median == pytest.approx(expected, rel=1e-3)
        expected = [0.2360, 0.2696, 0.3111, 0.0, 0.4507, 0.5760, 0.6412, 0.6658]
        assert found.sd == pytest.approx(expected, abs=2e-4)

    @pytest.mark.parametrize(
        ("arguments", "reason"),
        [
            ((NEAR, 0.0, 1.0), r"^level = 0\.0 g of Sa\(1\.0 s\) must be a number above 0$"),
            ((NEAR, 0.3, -1.0), r"^conditioning period -1\.0 s must be a number above 0$"),
            ((NEAR, 0.3, 1.0, [0.5, 0.5]), r"^periods: 0\.5 s is there twice$"),
            ((NEAR, 0.3, 1.0, [0.5, 12.0]), r"^period 12 s is outside 0\.01 to 10 s"),
            (([], 0.3, 1.0), r"^a conditional spectrum needs at least one rupture and one model$"),
            ((NEAR, 0.3, 1.0, [0.5], {"CY14": 0.0}), r"^weight 0\.0 of model CY14 must be"),
        ],
    )
    def test_refusals(self, arguments, reason):
        with pytest.raises(InputError, match=reason):
            conditional_spectrum(*arguments)


class TestGivenSpectrum:
    def test_csv_of_a_conditional_spectrum_is_that_spectrum(self, tmp_path):
        made = conditional_spectrum(NEAR, 0.5, 1.0, PERIODS)
        rows = zip(made.periods[::-1], made.median[::-1], made.sd[::-1])
        path = tmp_path / "target.csv"
        path.write_text("period_s,Sa_g,sd\n" + "".join(f"{t},{m},{s}\n" for t, m, s in rows))
        found = read_target(path)
        assert found.conditioning == 1.0
        assert found.ln_mean == pytest.approx(made.ln_mean)
        assert found.covariance == pytest.approx(made.covariance, abs=1e-9)

    def test_scatter_without_conditioning(self):
        found = spectrum_target([0.5, 1.0], [0.4, 0.2], [0.6, 0.7])
        assert found.covariance[0, 1] == pytest.approx(0.6 * 0.7 * correlation(0.5, 1.0))

    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("T,Sa_g\n1,2\n", r"column 'period_s' is missing; a target has period_s, Sa_g"),
            ("period_s,Sa_g\n", r"the target has no rows$"),
            ("period_s,Sa_g\n1,x\n", r"line 2: Sa_g = 'x' is not a finite number$"),
            ("period_s,Sa_g\n1,\n", r"line 2: Sa_g = '' is not a finite number$"),
            ("period_s,Sa_g\n1\n", r"line 2: Sa_g = None is not a finite number$"),
            ("period_s,Sa_g\n1,-2\n", r"median Sa -2 g must be above 0$"),
            ("period_s,Sa_g,sd\n1,2,-1\n", r"sd -1 must not be below 0$"),
            (
                "period_s,Sa_g,sd\n1,2,0\n2,2,0\n3,2,.5\n",
                r"sd is 0 at 2 periods; it may be at one",
            ),
            ("period_s,Sa_g\n0,2\n", r"periods \[0\.0\] must be positive numbers of seconds$"),
            ("period_s,Sa_g\n1,2\n1,3\n", r"periods: 1 s is there twice$"),
        ],
    )
    def test_bad_file(self, tmp_path, text, reason):
        path = tmp_path / "target.csv"
        path.write_text(text)
        with pytest.raises(InputError, match=reason) as caught:
            read_target(path)
        assert str(caught.value).startswith(str(path))
