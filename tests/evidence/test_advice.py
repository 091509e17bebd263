"""Advice by scene: read off the tables, and nothing else."""

import math

import pandas as pd
import pytest

from archfrag.evidence.advice import advise, choices


def points_of(scene, rows):
    """Charted points of the amplitude of one scene: (method, way, place, cost, error)."""
    table = pd.DataFrame(rows, columns=["method", "way", "place", "cost", "error"])
    return table.assign(
        scene=scene, quantity="amplitude", who="ours", line=table["method"],
        least_cost=table["cost"], floor=1e-7, charted=True, at_floor=False, status="",
    )  # fmt: skip


@pytest.fixture
def points():
    fast = [
        ("time_stepping", "time_stepping 8 ms", 0, 0.002, 5e-2),
        ("time_stepping", "time_stepping 1 ms", 1, 0.016, 8e-3),
        ("auto", "auto 0.1", 0, 0.0026, 5e-2),
        ("auto", "auto 0.001", 1, 0.020, 5e-4),
    ]
    slow = [
        ("time_stepping", "time_stepping 8 ms", 0, 0.004, 9e-2),
        ("auto", "auto 0.1", 0, 0.012, 8e-2),
        ("four_link", "four_link 1e-06", 0, 1e-4, 1e-3),
    ]
    return pd.concat([points_of("arch7_pulse", fast), points_of("arch7_slides", slow)])


def test_the_cheapest_that_gets_there_is_chosen_and_no_baseline(points):
    table = choices(points).set_index(["scene", "level"])
    assert table.loc[("arch7_pulse", 0.1), "way"] == "time_stepping 8 ms"
    assert table.loc[("arch7_pulse", 0.01), "way"] == "time_stepping 1 ms"
    assert table.loc[("arch7_pulse", 1e-3), "way"] == "auto 0.001"
    assert ("arch7_slides", 0.01) not in table.index
    assert table.loc[("arch7_pulse", 0.01), "auto_cost"] == 0.020


def test_where_costs_are_as_good_as_equal_auto_is_named(points):
    points.loc[points["way"] == "auto 0.1", "cost"] = (0.0021, 0.0043)
    table = choices(points).set_index(["scene", "level"])
    assert table.loc[("arch7_pulse", 0.1), ["way", "cost"]].tolist() == ["auto 0.1", 0.0021]
    assert table.loc[("arch7_slides", 0.1), "way"] == "auto 0.1"


def test_an_error_that_auto_does_not_reach_is_said(points):
    only_steps = points[points["method"] == "time_stepping"]
    assert choices(only_steps)["auto_cost"].map(math.isinf).all()
    section = advise({"speed": {"points": only_steps}})
    assert "none gets there" in section.notes[0].rows[0][1]


def test_the_section_names_ways_scenes_and_where_auto_is_dear(points):
    section = advise({"speed": {"points": points}})
    first = section.lead[0]
    assert "To 10 % of the amplitude" in first
    assert "time_stepping 8 ms on arch7_pulse, arch7_slides" in first
    assert "2 ms to 4 ms" in first
    auto = section.lead[-1]
    assert "3 of 4 of these errors" in auto
    assert auto.endswith("not on arch7_slides.")
    row = section.notes[0].rows[1]
    assert row[0].startswith("arch7_slides: Arch of 7 voussoirs with friction 0.36")
    assert row[1:] == ("time_stepping 8 ms, 4 ms (auto 0.1, 12 ms)", "–", "–", "–")


def test_nothing_measured_gives_no_advice():
    assert advise({"growth": {}}) is None


def curves_of(error, known):
    """Rows of two ways and their reference: error of ln theta by way, error of the reference."""
    rows = [("time_stepping 0.1 ms", "reference", 0.0, 90.0)]
    rows += [("time_stepping 4 ms", "way", error, 5.0), ("auto 0.001", "way", 0.01, 30.0)]
    table = pd.DataFrame(rows, columns=["way", "role", "ln_theta_difference", "cpu_seconds"])
    return table.assign(
        study="shipped", method=table["way"].str.split(" ").str[0], runs=450, beta=0.4,
        beta_difference=0.0, sampling_ln_theta=0.08, reference_ln_theta_error=known,
        reference_beta_error=0.01,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("error", "known", "said"),
    [
        (0.05, 0.004, "time_stepping 4 ms is the cheapest way whose theta is off by no more than"),
        (
            0.09,
            0.004,
            "auto 0.001 is the cheapest way whose theta is off by no more",
        ),
        (0.05, 0.02, "no way is shown to be as good as the sample"),
    ],
)
def test_a_curve_needs_a_way_better_than_its_sample_of_records(error, known, said):
    section = advise({"fragility": {"curves": curves_of(error, known)}})
    assert said in section.lead[0]
