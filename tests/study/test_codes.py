"""Demand and capacity in the words of building codes."""

import json
from dataclasses import replace

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.fragility.risk import HazardCurve
from archfrag.report.inputs import summary
from archfrag.report.page import render
from archfrag.study.answer.rates import risk_of
from archfrag.study.answer.tables import code_table, return_periods
from archfrag.study.file.schema import CodeKeys
from archfrag.study.hazard import Hazard
from tests.report import synthetic
from tests.study.small import command, small_study

RATES = HazardCurve(np.array([0.4, 1.0, 8.0]), np.array([0.05, 1e-2, 1e-4]))
NTC = CodeKeys(norm="ntc2018", probability=0.1)
EC8 = CodeKeys(norm="eurocode8", probability=0.1)


@pytest.fixture(scope="module")
def asked():
    """A report with a hazard and the code."""
    study = synthetic.inputs()
    risk = risk_of(study.cube, study.answers, Hazard("PGA", "made", {"mean": RATES}))
    return replace(study, risk=risk, code=NTC)


def test_return_periods_are_those_of_the_codes():
    """475 and 975 years as NTC 2018 rounds them; class IV doubles them."""
    assert {k: round(v) for k, v in return_periods(NTC).items()} == {
        "SLV": 475,
        "SLC": 975,
    }
    longer = CodeKeys(norm="ntc2018", probability=0.1, use_class="IV")
    assert [round(v) for v in return_periods(longer).values()] == [949, 1950]
    assert return_periods(EC8) == {"SD": 475.0, "NC": 2475.0}


def test_demand_capacity_ratio_and_rate(asked):
    rows = code_table(asked.quoted, asked.risk, NTC).set_index("code_state")
    slope = np.log(100.0) / np.log(8.0)  # of the last piece, in logarithms
    demand = (1e-2 * 50.0 / -np.log(0.9)) ** (1.0 / slope) / 9.80665
    curve = asked.quoted["ring"]
    assert rows["demand"]["SLV"] == pytest.approx(demand)
    assert curve(rows["capacity"]["SLC"]) == pytest.approx(0.1)
    assert rows["ratio"]["SLV"] == pytest.approx(rows["capacity"]["SLV"] / demand)
    assert rows["rate"]["SLV"] == asked.risk.arches["ring"].rate.quoted


def test_the_report_and_the_summary_have_the_table(asked):
    page, _ = render(asked)
    for words in ("SLV", "SLC", "ζ_E", "the user chose", "D.M. 17 January 2018"):
        assert words in page
    told = summary(asked)["code"]
    assert [row["code_state"] for row in told["rows"]] == ["SLV", "SLC"]
    assert "code" not in summary(replace(asked, code=None))
    page, _ = render(replace(asked, code=EC8))
    assert "ζ_E" not in page.replace("(ζ_E)", "ζ_E")
    json.dumps(told, allow_nan=False)


def test_a_demand_beyond_the_hazard_curve_is_no_number(asked):
    short = HazardCurve(np.array([0.4, 1.0]), np.array([0.05, 1.5e-3]))
    risk = risk_of(asked.cube, asked.answers, Hazard("PGA", "made", {"mean": short}))
    beyond = replace(asked, risk=risk)
    assert summary(beyond)["code"]["rows"][1]["demand"] is None
    page, _ = render(beyond)
    assert "does not reach a return period" in page


def test_results_give_the_table_in_python():
    seen = {"PGA [g]": [0.2, 0.3, 0.5, 0.4, 0.6], "collapsed": [0, 0, 0, 1, 1]}
    results = af.fit(seen)
    hazard = [[0.05, 0.02], [0.2, 2e-3], [1.0, 1e-5]]
    rows = results.code(hazard, code={"norm": "eurocode8", "probability": 0.1})
    assert results.curve(rows["capacity"][0]) == pytest.approx(0.1)
    assert rows["rate"][0] == results.risk(hazard)["rate"].iloc[0]
    with pytest.raises(InputError, match="code: norm = ec9 must be"):
        results.code(hazard, code={"norm": "ec9", "probability": 0.1})


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (
            "{norm: ntc2018, probability: 0.1}",
            "report.code needs the hazard of the site",
        ),
        (
            "{norm: eurocode8, probability: 0.1, life: 50}",
            "report.code.life is of ntc2018",
        ),
        ("{norm: ntc2018}", "report.code.probability"),
        (
            "{norm: ntc2018, probability: 1}",
            "report.code.probability = 1 must be less than 1",
        ),
    ],
)
def test_validate_refuses(tmp_path, code, words):
    path = small_study(tmp_path)
    result = command("validate", path, "--set", f"report.code={code}")
    assert result.exit_code == 2
    assert words in result.stderr
