"""The section on risk: what its dictionary holds, and figures that a browser can draw."""

from xml.etree import ElementTree

import numpy as np
import pytest

from archfrag.fragility.hazard_curve import HazardCurve
from archfrag.report.risk_section import risk_section
from archfrag.report.summary import Scale
from archfrag.study.hazard import Hazard
from archfrag.study.risk import risk_of
from tests.report.synthetic import answers_of, cube, motions

SCALE = Scale("PGA", "g", 1.0 / 9.80665)
IM = np.geomspace(0.2, 4.0, 8)
HAZARD = Hazard(
    "PGA", "a.csv", {"mean": HazardCurve(IM, 2e-3 * IM**-2.0), "0.84": HazardCurve(IM, 1e-2 / IM)}
)


@pytest.fixture(scope="module")
def risk():
    data = cube(names=("ring", "slab"), items=motions(12))
    return risk_of(data, {"ring": answers_of(data)["ring"].curve, "slab": "no curve"}, HAZARD)


@pytest.mark.parametrize("width", [7.4, 3.4])
def test_figures_and_tables(risk, width):
    section = risk_section(risk, SCALE, width)
    ring, slab = section["arches"]
    assert slab == {"name": "slab", "none": "no curve", "cautions": ()}
    for picture in (ring["picture"], ring["shares"]):
        assert ElementTree.fromstring(picture.svg.replace("xlink:", "")) is not None
        assert "mathdefault" not in picture.svg
    rows = section["table"].rows
    assert [row[0] for row in rows] == ["ring", "slab"]
    assert all(len(row) == len(section["table"].heads) for row in rows)
    for table in (ring["levels"], ring["contributions"]):
        assert all(len(row) == len(table.heads) for row in table.rows)
    assert sum(float(row[2]) for row in ring["levels"].rows) == pytest.approx(1.0, abs=0.01)
    assert f"{risk.arches['ring'].rate.rate:.2g} a year" in ring["picture"].caption


def test_no_risk_no_section():
    assert risk_section(None, SCALE) is None
