"""Files for receivers: their structure, and the lognormal law found again in them."""

import csv
import io
import json
import math

import lxml.etree
import numpy as np
import pytest
import scipy.stats

from archfrag.errors import InputError
from archfrag.export.curve_set import crossing
from archfrag.export.in_core import in_core_sets
from archfrag.export.nrml import NAMESPACE, nrml_continuous, nrml_discrete
from archfrag.export.pelicun import pelicun_description, pelicun_table
from archfrag.export.receivers import named_measure
from tests.export.made import STATES, curve_set, fragility, lognormal

G = 9.80665
NONE = dict.fromkeys(STATES, "all runs stood & nothing fell")


def parsed(text):
    root = lxml.etree.fromstring(text.encode("utf-8"))
    (model,) = root
    assert root.tag == f"{{{NAMESPACE}}}nrml"
    return model


def tags(element):
    return [lxml.etree.QName(child).localname for child in element]


def test_arches_without_a_curve_and_curves_that_cross_are_named():
    curves = curve_set(tower=dict.fromkeys(STATES, "it stood"))
    assert list(curves.complete) == ["ring-7", "wall+2"]
    assert curves.left_out == {"tower": "rocking: it stood; damage: it stood; collapse: it stood"}
    assert crossing(fragility(1.0, 0.6), fragility(1.1, 0.2)) == pytest.approx(0.1897, abs=1e-3)
    assert crossing(fragility(1.0, 0.4), fragility(1.5, 0.4)) < 1e-3


class TestReceivers:
    @pytest.mark.parametrize(
        ("measure", "name", "unit", "si"),
        [
            ("PGA", "PGA", "g", G),
            ("SA(0.50)", "SA(0.5)", "g", G),
            ("AvgSA(0.2,1)", "AvgSA", "g", G),
            ("PGV", "PGV", "cm/s", 0.01),
            ("FIV3(0.7)", "FIV3(0.7)", "cm/s", 0.01),
            ("CAV", "CAV", "g s", G),
            ("Arias", "IA", "m/s", 1.0),
        ],
    )
    def test_openquake(self, measure, name, unit, si):
        named = named_measure("OpenQuake", measure)
        assert named[:2] == (name, unit)
        assert named.factor * si == pytest.approx(1.0, rel=1e-15)

    @pytest.mark.parametrize(
        ("ask", "measure", "message"),
        [
            ("OpenQuake", "HI", "no name for the intensity measure HI"),
            ("pelicun", "AvgSA(0.2,1)", "no name for the intensity measure"),
            ("IN-CORE", "CAV", "no name for the intensity measure CAV"),
            ("pelicun", "PGD", "its PGD is permanent ground deformation"),
        ],
    )
    def test_measures_that_a_receiver_does_not_know(self, ask, measure, message):
        with pytest.raises(InputError, match=message):
            named_measure(ask, measure)

    def test_notes_state_what_the_measure_must_be(self):
        assert "RotD50 of two horizontal" in named_measure("OpenQuake", "RotD50(Sa(0.5))").note
        assert "from 0.2 to 1 s" in named_measure("OpenQuake", "AvgSA(0.2,1)").note
        assert named_measure("OpenQuake", "PGA").note == ""


class TestNrml:
    @pytest.mark.parametrize("write", [nrml_continuous, nrml_discrete])
    def test_structure(self, write):
        model = parsed(write(curve_set(tower=NONE)))
        assert model.get("id") == "my_study"
        assert tags(model) == ["description", "limitStates", *["fragilityFunction"] * 2]
        description, states, *functions = model
        assert "PGA in g" in description.text
        assert "No curve for tower: rocking: all runs stood & nothing fell" in description.text
        assert "0" * 64 in description.text
        assert states.text == "rocking damage collapse"
        assert [each.get("id") for each in functions] == ["ring-7", "wall+2"]
        for each in functions:
            assert each[0].get("imt") == "PGA"
            assert [child.get("ls") for child in each[1:]] == list(STATES)

    def test_mean_and_deviation_are_those_of_the_intensity(self):
        curves = curve_set("PGV")
        for function in parsed(nrml_continuous(curves))[2:]:
            imls, *params = function
            assert function.get("format") == "continuous"
            assert function.get("shape") == "logncdf"
            assert imls.get("minIML") == "0.0"
            for each in params:
                fit = curves.curves[function.get("id")][each.get("ls")]
                capacity = 100 * fit.theta * np.exp(fit.beta * np.linspace(-9, 9, 20001))
                density = np.exp(-0.5 * np.linspace(-9, 9, 20001) ** 2) / math.sqrt(2 * math.pi)
                mean = np.sum(capacity * density) * 18 / 20000
                square = np.sum(capacity**2 * density) * 18 / 20000
                assert float(each.get("mean")) == pytest.approx(mean, rel=1e-9)
                assert float(each.get("stddev")) == pytest.approx(
                    math.sqrt(square - mean**2), rel=1e-9
                )
                assert lognormal(float(imls.get("maxIML")) / 100, fit.theta, fit.beta) > 0.9999

    @pytest.mark.parametrize("beta", [0.05, 1.0])
    def test_levels_hold_the_curve_and_are_close_enough_between(self, beta):
        states = {name: fragility(f, beta) for name, f in zip(STATES, (2.0, 3.0, 4.0))}
        curves = curve_set(**{"ring-7": states})
        function = parsed(nrml_discrete(curves))[2]
        imls, *rows = function
        levels = np.array(imls.text.split(), dtype=float) * G
        assert (np.diff(levels) > 0).all()
        for row in rows:
            fit = states[row.get("ls")]
            poes = np.array(row.text.split(), dtype=float)
            exact = [lognormal(im, fit.theta, beta) for im in levels]
            np.testing.assert_allclose(poes, exact, rtol=0, atol=1e-12)
            assert np.isclose(levels, fit.theta, rtol=1e-14, atol=0).any()
            assert poes[-1] > 0.9999
            assert levels[0] <= curves.levels[0] < curves.levels[1] <= levels[-1]
            between = np.geomspace(levels[0], levels[-1], 5000)
            exact = [lognormal(im, fit.theta, beta) for im in between]
            assert np.abs(np.interp(between, levels, poes) - exact).max() < 1e-4


class TestPelicun:
    def test_rows_and_description(self):
        curves = curve_set("Sa(0.5)", tower=NONE)
        rows = list(csv.DictReader(io.StringIO(pelicun_table(curves))))
        assert [row["ID"] for row in rows] == ["ring_7", "wall_2"]
        fixed = {
            "Demand-Type": "Spectral Acceleration|0.5", "Demand-Unit": "g", "Demand-Offset": "0",
            "Demand-Directional": "1", "Incomplete": "0",
        }  # fmt: skip
        for row, states in zip(rows, curves.complete.values()):
            assert row.items() >= fixed.items()
            for number, fit in enumerate(states.values(), start=1):
                assert row[f"LS{number}-Family"] == "lognormal"
                assert float(row[f"LS{number}-Theta_0"]) == pytest.approx(fit.theta / G, rel=1e-14)
                assert float(row[f"LS{number}-Theta_1"]) == fit.beta
        about = json.loads(pelicun_description(curves))
        assert about["_GeneralInformation"]["archfrag"]["cube_sha256"] == "0" * 64
        assert list(about["_GeneralInformation"]["LeftOut"]) == ["tower"]
        assert about["ring_7"]["LimitStates"]["LS3"]["DS3"]["Description"] == "collapse"

    def test_ids_that_would_coincide(self):
        states = curve_set().curves["ring-7"]
        with pytest.raises(InputError, match="arch 'ring_7' would have the id 'ring_7'"):
            pelicun_table(curve_set(ring_7=states))


class TestInCore:
    def test_expressions(self):
        curves = curve_set("Sa(0.2)", tower=NONE)
        sets = in_core_sets(curves)
        assert list(sets) == ["ring-7", "wall+2"]
        for arch, text in sets.items():
            content = json.loads(text)
            assert content["demandTypes"] == ["0.2 Sec Sa"]
            assert content["curveParameters"][0]["fullName"] == "0.2 Sec Sa"
            assert "0" * 64 in content["description"]
            fits = [*curves.complete[arch].values()]
            found = content["fragilityCurves"]
            assert len(found) == 4
            for curve, fit in zip(found, [*fits, fits[-1]]):
                (rule,) = curve["rules"]
                assert rule["condition"] == ["sa > 0"]
                for im in (0.1, 0.5, 2.0):
                    value = eval(rule["expression"], {"math": math, "scipy": scipy, "sa": im})
                    assert value == pytest.approx(
                        lognormal(im * G, fit.theta, fit.beta), abs=1e-12
                    )

    def test_no_more_than_four_states(self):
        states = {f"s{n}": fragility(n + 1.0, 0.4) for n in range(5)}
        curves = curve_set(states=(), **{"ring-7": states, "wall+2": states})
        with pytest.raises(InputError, match="takes 4 limit states at most; there are 5"):
            in_core_sets(curves)
