"""Values that are unusual: of keys, levels and hazards."""

import math
import re

import pytest

import archfrag as af
from archfrag.errors import UnitWarning
from archfrag.properties import PROPERTIES, unusual
from archfrag.study.file.schema import load_study
from archfrag.study.hazard import load_hazard
from archfrag.study.validate import check_study
from tests.study.small import TEXT, small_study


@pytest.mark.parametrize(
    "key", [key for key, row in PROPERTIES.items() if math.isfinite(row.usual[1])]
)
def test_each_is_asked_about_beyond_its_bounds_only(key):
    least, most = PROPERTIES[key].usual
    assert not [*unusual(key, [least, most])]
    (text,) = unusual(key, [most, 2.0 * most], "place")
    assert text.startswith(f"place = {2 * most:.4g}")
    assert text.endswith(PROPERTIES[key].question)
    assert not [*unusual("another key", 1e99)]


def test_a_factor_on_the_thickness_and_a_friction_in_python():
    block = [[(0, 0), (1, 0), (1, 0.5), (0, 0.5)]]
    with pytest.warns(
        UnitWarning, match="thickness_factor = 10: usual are 0.4 to 2.5; is it"
    ):
        af.Arch.from_polygons(
            block, 0.7, ground=[[(0, 0), (1, 0)]], thickness_factor=10.0
        )
    with pytest.warns(
        UnitWarning, match="friction = 35: usual are 0 to 2; was an angle meant"
    ):
        af.Block(0.5, 1.0, friction=35.0)


@pytest.mark.parametrize(
    ("measure", "unit", "levels", "asked"),
    [
        ("PGV", "m/s", "[30, 60]", True),
        ("PGV", "cm/s", "[0.3, 0.6]", True),
        ("PGV", "cm/s", "[30, 60]", False),
        ("Sa(0.5)", "g", "[100, 981]", True),
        ("Sa(0.5)", "g", "[0.1, 1]", False),
        ("PGD", "m", "[10, 50]", True),
        ("CAV", "cm/s", "[0.5, 5]", True),
    ],
)
def test_levels_of_a_study(tmp_path, measure, unit, levels, asked):
    text = TEXT.replace("measure: PGA", f"measure: {measure}").replace(
        "unit: g", f"unit: {unit}"
    )
    path = small_study(tmp_path, text.replace("[0.1, 0.6, 1.2]", levels))
    cautions = check_study(load_study(path))["cautions"]
    named = f"intensity.levels: the largest {measure} = "
    assert any(caution.startswith(named) for caution in cautions) == asked


@pytest.mark.parametrize(
    ("rows", "asked"),
    [
        ("5,0.1\n50,0.01\n900,0.001", "the largest PGA = 8826 m/s2"),
        ("0.0005,0.1\n0.005,0.01\n0.01,0.001", "the largest PGA = 0.09807 m/s2"),
        ("0.05,475\n0.5,100\n0.9,10", "the largest rate = 475 1/year"),
        ("0.05,0.1\n0.9,0.001", ""),
    ],
)
def test_a_hazard_in_another_unit_by_its_size(tmp_path, rows, asked):
    (tmp_path / "h.csv").write_text(f"PGA [g],rate\n{rows}\n")
    messages = load_hazard([tmp_path / "h.csv"], "PGA").messages
    assert bool(messages) == bool(asked)
    path = small_study(tmp_path, TEXT + "risk: {hazard: h.csv}\n")
    cautions = [
        text for text in check_study(load_study(path))["cautions"] if "h.csv" in text
    ]
    assert [re.sub(".*h.csv: ", "", text).partition(":")[0] for text in cautions] == [
        asked
    ] * bool(asked)
