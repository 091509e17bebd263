"""The report says of each thing that a study may model whether it is modelled."""

from dataclasses import replace
from itertools import product

import lxml.html
import numpy as np
import pandas as pd
import pytest

import archfrag as af
from archfrag.report.html import ERRORS
from archfrag.report.limits import (
    aspects,
    errors_and_costs,
    errors_of,
    errors_sentence,
    short,
)
from archfrag.report.page import render
from tests.piers import on_piers
from tests.report import synthetic

# By key: its value in an arch, what the report says then, and what it says otherwise.
KEYS = {
    "fill": (
        {"height_over_crown": 0.3, "unit_weight": 18e3},
        "Fill is modelled",
        "Fill is not",
    ),
    "dead_load": (500.0, "A dead load is modelled", "No dead load"),
    "strength": (5e6, "Crushing is modelled", "Crushing is not"),
    "joints": (
        {"stiffness": 3e10, "damping": 0.05},
        "Joints give: by",
        "Joints do not give",
    ),
    "springings": (
        {"spread": 0.02, "springing": "left"},
        "A springing has moved",
        "Movement of",
    ),
    "ties": ([{"level": 1.0, "area": 1e-3}], "Ties are modelled as", "Ties are not"),
    "ends": (
        {"height": 3.0, "width": 1.0},
        "Piers are modelled",
        "Piers are not",
    ),
    "recess": (
        {"intrados": [0.0, 0.02]},
        "Lost mortar is modelled",
        "Lost mortar is not",
    ),
    "vertical": (
        "used",
        "Vertical ground motion is modelled",
        "Vertical ground motion is not",
    ),
    "bases": (
        {"bases": {"right": 0.4}},
        "left one: right 0.4 s later.",
        "the same ground motion",
    ),
    "friction": (0.6, "slide against Coulomb friction", "cannot slide"),
}
RIGID = {"stiffness": float("inf"), "damping": 0.05}
OTHERWISE = {
    "joints": RIGID,
    "vertical": "not used",
    "bases": {},
    "friction": "inf",
    "dead_load": 0.0,
}


def told(had):
    """Limits of one arch that has some of the keys, as one text."""
    given = {
        key: value[0] if key in had else OTHERWISE.get(key)
        for key, value in KEYS.items()
    }
    vertical = given.pop("vertical")
    method = given.pop("bases")
    return " ".join(
        each.sentence for each in aspects({"ring": [given]}, vertical, method)
    )


def test_every_combination_is_told_as_it_is():
    for flags in product((False, True), repeat=len(KEYS)):
        had = {key for key, flag in zip(KEYS, flags, strict=True) if flag}
        text = told(had)
        for key, (_, with_it, without) in KEYS.items():
            assert (with_it in text, without in text) == (key in had, key not in had)
        assert "Spandrel walls are not modelled." in text


def test_fill_without_weight_is_no_fill():
    empty = {
        "height_over_crown": 0.3,
        "unit_weight": 0.0,
        "backing_height": 0.0,
        "inertia": 1.0,
    }
    dense = {"backing_unit_weight": 2e4}
    for more, modelled in (
        ({}, False),
        (dense, False),
        (dense | {"backing_height": 1.0}, True),
    ):
        told = short(aspects({"ring": [{"friction": 0.6, "fill": empty | more}]}))
        assert ("fill as weight" in told.partition("Not modelled")[0]) is modelled
        ring = af.Arch.segmental(8.0, 3.0, 0.9, voussoirs=6, friction=0.7)
        drawn = {mark.role for mark in ring.filled(**empty | more).marks}
        assert ("earth" in drawn) is modelled


def test_only_some_arches_have_it():
    bare = {"friction": 0.6}
    tied = {"friction": 0.6, "ties": KEYS["ties"][0]}
    words = short(
        aspects({"before": [bare], "after": [tied, tied], "both": [bare, tied]})
    )
    assert "ties (after, some arches of both)" in words.partition("Not modelled")[0]
    many = short(aspects({f"a{i}": [tied if i else bare] for i in range(6)}))
    assert "ties (5 of 6)" in many


def test_a_movement_or_load_of_zero_is_none():
    given = {
        "springings": {"spread": 0.0, "springing": "right"},
        "dead_load": [0.0, 0.0],
    }
    text = " ".join(each.sentence for each in aspects({"ring": [given]}))
    assert "Movement of springings is not modelled." in text
    assert "No dead load is modelled." in text


def test_nothing_is_said_of_springings_of_a_column():
    text = " ".join(each.sentence for each in aspects({"column": [{}]}, spanning=False))
    assert "springing" not in text.lower()
    assert "Crushing is not modelled" in text


@pytest.fixture(scope="module")
def bridge():
    ring = af.Arch.segmental(8.0, 3.0, 0.6, 9, 0.6)
    arch = (
        on_piers(ring, 3.0, 1.5)
        .filled(0.4, 18e3)
        .tied(level=0.8, area=8e-4, prestress=2e4)
    )
    return af.onset(arch)


def test_a_report_denies_nothing_that_its_arch_has(bridge):
    page = lxml.html.document_fromstring(
        render(synthetic.inputs(arches={"ring": bridge}))[0]
    ).text_content()
    for words in ("Fill is modelled", "Ties are modelled", "Piers are modelled"):
        assert words in page
    for words in (
        "no fill",
        "the ring alone",
        "joint 0 is the left springing",
        "ties, vertical",
    ):
        assert words not in page
    assert "Joint 0 is the left springing of a span, the base of a pier" in page
    assert "fill as weight, piers, ties." in page


RING = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)


@pytest.mark.parametrize(
    ("arch", "own"),
    [
        (RING, ["0.001", "rigid", "1 of 3 spans"]),
        (af.jointed(RING, 3e10), ["0.001", "inset", "1 of 3 spans"]),
        (af.jointed(RING, 3e10, model="face"), ["face", "1 of 3 spans"]),
        (
            af.jointed(RING, 3e10, model="face", points=2),
            ["two corners", "1 of 3 spans"],
        ),
        (
            af.Bridge([RING] * 2, piers={"height": 3.0, "width": 3.0}),
            ["0.001", "rigid"],
        ),
        (af.Block(0.5, 2.0, 0.7), ["0.001"]),
    ],
    ids=["rigid", "inset", "face", "corners", "bridge", "block"],
)
def test_errors_that_a_study_has_are_marked_and_cost_as_much_as_it_does(arch, own):
    table = errors_of(synthetic.inputs(), arch, synthetic.answer_of(3.0))
    assert table.loc[table["own"], "what"].tolist() == [*own, "6 records"]
    assert (table.loc[table["own"], "cost"] == 1.0).all()
    spread = np.log(1.2 / 0.8) / 2.0 / 1.6449  # as 90 % are 0.8 to 1.2 theta
    records = table[table["kind"] == "records"]
    np.testing.assert_allclose(
        records["error"], spread * (records["cost"]) ** -0.5, rtol=1e-4
    )


@pytest.mark.parametrize(
    "ends", [(np.nan, np.nan), (2.0, np.inf), (0.0, 3.0), (3.0, 3.0)]
)
def test_records_have_no_error_where_theta_has_no_finite_interval(ends):
    answer = replace(synthetic.answer_of(3.0), intervals=(ends, (0.3, 0.6)))
    table = errors_of(synthetic.inputs(), RING, answer)
    assert {*table["kind"]} == {"auto", "joints", "spans"}
    assert "nan" not in errors_and_costs(table).svg


def test_errors_of_few_records():
    """None is of less than a record, and an error may be more than theta."""
    wide = replace(synthetic.answer_of(3.0), intervals=((0.03, 300.0), (0.3, 0.6)))
    table = errors_of(synthetic.inputs(n_record=2), RING, wide)
    records = table[table["kind"] == "records"]
    assert records["what"].tolist() == ["2 records", "6 records", "20 records"]
    assert "its 2 records (280 %)" in errors_sentence(table)


def test_the_last_section_says_which_error_is_the_largest():
    page = lxml.html.document_fromstring(render(synthetic.inputs())[0])
    assert page.xpath("//section/@id")[-1] == "errors"
    words = page.xpath("//section[@id='errors']")[0].text_content()
    table = pd.read_csv(ERRORS)
    rigid = table.query("kind == 'joints' and what == 'rigid'")["error"].item()
    assert f"rigid joints ({100 * rigid:.2g} %)" in words
    assert "its 6 records (" in words
    assert words.strip().endswith("taking it alone makes an error of 46 %.")
