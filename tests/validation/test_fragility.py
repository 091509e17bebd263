"""Fits, rates of collapse and exported curves beside published data and closed forms."""

import csv
import io
import math

import lxml.etree
import numpy as np
import pytest
import statsmodels.api as sm
from scipy.stats import norm

import archfrag as af
from archfrag.export.writers import nrml_continuous, pelicun_table
from archfrag.fragility.risk import HazardCurve, collapse_rate
from tests.export.made import curve_set, fragility

BAKER = "Baker 2015, the author's data"
STRIPES = np.array([0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0])
COLLAPSES = np.array([0, 0, 0, 4, 6, 13, 12, 16])
CAPACITIES = [
    0.49,
    0.62,
    0.63,
    0.63,
    0.65,
    0.70,
    0.71,
    0.72,
    0.77,
    0.79,
    0.80,
    0.84,
    0.91,
    0.92,
    0.93,
    0.97,
    1.04,
    1.04,
    1.05,
    1.08,
    1.08,
    1.09,
    1.12,
    1.13,
    1.22,
    1.32,
    1.33,
    1.34,
    1.40,
    1.40,
    1.47,
    1.72,
    1.76,
    2.15,
    2.31,
    2.42,
    2.50,
]


class TestFits:
    TOPIC = "Fragility fits"

    def test_stripes(self, validated):
        fit = af.fit_stripes(STRIPES, COLLAPSES, 40)
        errors = fit.standard_errors
        for name, ours, reference, allowed in (
            ("theta", fit.theta, 1.0761, 6e-5),
            ("beta", fit.beta, 0.4292, 6e-5),
            ("standard error of ln theta", errors[0], 0.0717, 6e-5),
            ("standard error of beta", errors[1], 0.0839, 6e-5),
            ("correlation", fit.correlation, 0.810, 6e-4),
        ):
            validated(
                "stripes: 8 levels of 40 runs",
                name,
                ours,
                reference,
                BAKER,
                abs=allowed,
            )

    def test_capacities(self, validated):
        fit = af.fit_ida(CAPACITIES, truncate_at=1.3)
        case = "37 capacities, truncated at 1.3"
        validated(case, "theta", fit.theta, 1.0582, BAKER, abs=6e-5)
        validated(case, "beta", fit.beta, 0.3821, BAKER, abs=6e-5)
        fit = af.fit_ida(CAPACITIES)
        logs = np.log(CAPACITIES)
        source = "moments of the logarithms"
        validated(
            "37 capacities", "theta", fit.theta, np.exp(logs.mean()), source, rel=1e-12
        )
        validated(
            "37 capacities", "beta", fit.beta, logs.std(ddof=1), source, rel=1e-12
        )

    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_probit(self, validated, seed):
        im = np.geomspace(0.2, 2.0, 9)
        chance = norm.cdf(np.log(im / 0.7) / 0.4)
        fell = np.random.default_rng(seed).binomial(30, chance)
        fit = af.fit_stripes(im, fell, 30)
        link = sm.families.Binomial(sm.families.links.Probit())
        model = sm.GLM(
            np.column_stack([fell, 30 - fell]), sm.add_constant(np.log(im)), link
        )
        a, b = model.fit(tol=1e-13).params
        case = f"drawn stripes {seed}: 9 levels of 30 runs"
        source = "statsmodels, probit"
        validated(case, "theta", fit.theta, math.exp(-a / b), source, rel=1e-6)
        validated(case, "beta", fit.beta, 1.0 / b, source, rel=1e-6)


class TestRisk:
    TOPIC = "Rate of collapse"

    @pytest.mark.parametrize("k", [0.5, 1.0, 2.5, 4.0, 8.0])
    @pytest.mark.parametrize(("theta", "beta"), [(0.2, 0.15), (3.0, 0.8)])
    def test_hazard_that_is_a_power(self, validated, k, theta, beta):
        im = np.geomspace(0.05, 2.0, 9)
        rate = collapse_rate(
            HazardCurve(im, 1e-4 * im**-k), fragility(theta, beta)
        ).rate
        validated(
            f"hazard 1e-4 a^−{k:g}, theta {theta:g}, beta {beta:g}",
            "rate of collapse",
            rate,
            1e-4 * theta**-k * math.exp(0.5 * (k * beta) ** 2),
            "closed form, Cornell and others 2002",
            rel=1e-8,
            unit="1/year",
        )

    def test_poisson(self, validated):
        curve = HazardCurve.from_exceedance([0.1, 0.2, 0.4], [0.5, 0.1, 0.02], 50.0)
        for rate, probability in zip(curve.rate[1:], (0.1, 0.02)):
            validated(
                f"{probability:.0%} in 50 years",
                "return period",
                1.0 / rate,
                -50.0 / math.log1p(-probability),
                "Poisson process",
                rel=1e-9,
                unit="years",
            )


class TestExports:
    TOPIC = "Exported curves"

    def test_openquake(self, validated):
        root = lxml.etree.fromstring(nrml_continuous(curve_set("PGV")).encode())
        for params in root.iter("{*}params"):
            arch = params.getparent().get("id")
            state = params.get("ls")
            fit = curve_set("PGV").curves[arch][state]
            mean = 100 * fit.theta * math.exp(0.5 * fit.beta**2)
            moments = {
                "mean": mean,
                "stddev": mean * math.sqrt(math.expm1(fit.beta**2)),
            }
            case = f"OpenQuake, {arch}, {state}"
            source = "moments of a lognormal"
            for name, moment in moments.items():
                validated(
                    case, name, params.get(name), moment, source, rel=1e-9, unit="cm/s"
                )

    def test_pelicun(self, validated):
        curves = curve_set("Sa(0.5)")
        source = "theta over standard gravity"
        table = csv.DictReader(io.StringIO(pelicun_table(curves)))
        for row, states in zip(table, curves.curves.values()):
            for number, (state, fit) in enumerate(states.items(), start=1):
                case = f"pelicun, {row['ID']}, {state}"
                found = row[f"LS{number}-Theta_0"]
                validated(
                    case,
                    "median",
                    found,
                    fit.theta / 9.80665,
                    source,
                    rel=1e-12,
                    unit="g",
                )
