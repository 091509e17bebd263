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
from archfrag.export.command import crossing
from archfrag.export.formats import (
    NAMESPACE,
    in_core_sets,
    named_measure,
    nrml_continuous,
    nrml_discrete,
    pelicun_description,
    pelicun_table,
)
from tests.export.made import STATES, curve_set, fragility, lognormal

G = 9.80665
NONE = dict.fromkeys(STATES, "all runs stood & nothing fell")


def parsed(text):
    root = lxml.etree.fromstring(text.encode("utf-8"))
    (model,) = root
    assert root.tag == f"{{{NAMESPACE}}}nrml"
    return model


def test_arches_without_a_curve_and_curves_that_cross_are_named():
    curves = curve_set(tower=dict.fromkeys(STATES, "it stood"))
    assert list(curves.complete) == ["ring-7", "wall+2"]
    assert curves.left_out == {"tower": "it stood"}
    assert crossing(fragility(1.0, 0.6), fragility(1.1, 0.2)) == pytest.approx(0.1897, abs=1e-3)
    assert crossing(fragility(1.0, 0.4), fragility(1.5, 0.4)) < 1e-3


@pytest.mark.parametrize(
    ("receiver", "measure", "name", "unit", "si", "note"),
    [
        ("OpenQuake", "PGA", "PGA", "g", G, ""),
        ("OpenQuake", "SA(0.50)", "SA(0.5)", "g", G, ""),
        ("OpenQuake", "RotD50(Sa(0.5))", "SA(0.5)", "g", G, "RotD50 of two horizontal"),
        ("OpenQuake", "AvgSA(0.2,1)", "AvgSA", "g", G, "from 0.2 to 1 s"),
        ("OpenQuake", "Arias", "IA", "m/s", 1.0, ""),
        ("pelicun", "PGV", "Peak Ground Velocity", "cmps", 0.01, ""),
        ("IN-CORE", "Sa(0.5)", "0.5 Sec Sa", "g", G, ""),
    ],
)
def test_names_of_measures(receiver, measure, name, unit, si, note):
    named = named_measure(receiver, measure)
    assert named[:2] == (name, unit)
    assert named.factor * si == pytest.approx(1.0, rel=1e-15)
    assert note in named.note
    assert bool(note) == bool(named.note)


def test_measures_that_a_receiver_does_not_know():
    for receiver, measure, message in (
        ("OpenQuake", "HI", "no name for the intensity measure HI"),
        ("pelicun", "PGD", "its PGD is permanent ground deformation"),
    ):
        with pytest.raises(InputError, match=message):
            named_measure(receiver, measure)


class TestNrml:
    @pytest.mark.parametrize("write", [nrml_continuous, nrml_discrete])
    def test_structure(self, write):
        description, states, *functions = parsed(write(curve_set(tower=NONE)))
        assert "PGA in g" in description.text
        assert "No curve for tower: all runs stood & nothing fell" in description.text
        assert "0" * 64 in description.text
        assert states.text == "rocking damage collapse"
        assert [each.get("id") for each in functions] == ["ring-7", "wall+2"]
        for each in functions:
            assert each[0].get("imt") == "PGA"
            assert [child.get("ls") for child in each[1:]] == list(STATES)

    @pytest.mark.parametrize("beta", [0.05, 1.0])
    def test_levels_hold_the_curve_and_are_close_enough_between(self, beta):
        states = {name: fragility(f, beta) for name, f in zip(STATES, (2.0, 3.0, 4.0))}
        curves = curve_set(**{"ring-7": states})
        imls, *rows = parsed(nrml_discrete(curves))[2]
        levels = np.array(imls.text.split(), dtype=float) * G
        assert (np.diff(levels) > 0).all()
        assert levels[0] <= curves.levels[0] < curves.levels[1] <= levels[-1]
        between = np.geomspace(levels[0], levels[-1], 5000)
        for row in rows:
            theta, poes = states[row.get("ls")].theta, np.array(row.text.split(), dtype=float)
            exact = [lognormal(im, theta, beta) for im in levels]
            np.testing.assert_allclose(poes, exact, rtol=0, atol=1e-12)
            assert np.isclose(levels, theta, rtol=1e-14, atol=0).any()
            assert poes[-1] > 0.9999
            exact = [lognormal(im, theta, beta) for im in between]
            assert np.abs(np.interp(between, levels, poes) - exact).max() < 1e-4


def test_pelicun():
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
    with pytest.raises(InputError, match="arch 'ring_7' would have the id 'ring_7'"):
        pelicun_table(curve_set(ring_7=curves.curves["ring-7"]))


def test_in_core():
    curves = curve_set("Sa(0.2)", tower=NONE)
    sets = in_core_sets(curves)
    assert list(sets) == ["ring-7", "wall+2"]
    for arch, text in sets.items():
        content = json.loads(text)
        assert content["demandTypes"] == ["0.2 Sec Sa"]
        assert "0" * 64 in content["description"]
        fits = [*curves.complete[arch].values()]
        for curve, fit in zip(content["fragilityCurves"], [*fits, fits[-1]], strict=True):
            (rule,) = curve["rules"]
            assert rule["condition"] == ["sa > 0"]
            for im in (0.1, 0.5, 2.0):
                value = eval(rule["expression"], {"math": math, "scipy": scipy, "sa": im})
                expected = lognormal(im * G, fit.theta, fit.beta)
                assert value == pytest.approx(expected, abs=1e-12)
    states = {f"s{n}": fragility(n + 1.0, 0.4) for n in range(5)}
    (text, _) = in_core_sets(curve_set(**{"ring-7": states, "wall+2": states})).values()
    named = [each["description"] for each in json.loads(text)["fragilityCurves"]]
    assert named == ["LS_0: s1", "LS_1: s2", "LS_2: s3", "LS_3: s4"]
