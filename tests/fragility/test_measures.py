"""Measures compared on simulated studies in which the best one and its dispersion are known."""

import numpy as np
import pytest

from archfrag.fragility.efficiency import compare_measures
from archfrag.fragility.verdicts import find_brackets

LEVELS = np.geomspace(0.2, 16.0, 18)
THETA = 0.2
BETA = 0.25


def study(seed, n=44, *, own="PGA", levels=LEVELS, top=None):
    """Collapse by PGV alone; PGA depends on magnitude too, IA is the square of a noisy PGV."""
    generator = np.random.default_rng(seed)
    magnitude = generator.uniform(5.5, 7.5, n)
    distance = generator.uniform(5.0, 60.0, n)
    pgv = np.exp(generator.normal(-2.0, 0.5, n))
    tilt = -0.3 * (magnitude - 6.5)
    pga = 8.0 * pgv * np.exp(tilt + generator.normal(0.0, 0.35, n))
    arias = (pgv * np.exp(generator.normal(0.0, 0.3, n))) ** 2
    values = {"PGA": pga, "PGV": pgv, "IA": arias}
    capacity = THETA * np.exp(generator.normal(0.0, BETA, n))
    factor = (levels / pga[:, None])[:, :top]
    collapsed = factor * pgv[:, None] >= capacity[:, None]
    found = find_brackets(collapsed, factor * values[own][:, None])
    exponent = {"PGA": 1.0, "PGV": 1.0, "IA": 2.0}
    known = {"values": values, "exponent": exponent, "own": own}
    return {"brackets": found, **known, "magnitude": magnitude, "distance": distance}


def seventeen(seed, events, ratio):
    """Measures that scatter by 0.4 about capacity, the last by `ratio` times that; 24 or more."""
    generator = np.random.default_rng(seed)
    event = np.repeat(np.arange(events), 30 // events)
    alike = generator.standard_normal((events, 17))[event]
    scatter = np.sqrt(0.5) * (alike + generator.standard_normal(alike.shape))
    value = np.exp(0.4 * scatter * np.append(np.ones(16), ratio))
    levels = np.geomspace(0.01, 100.0, 300)
    names = [f"m{i}" for i in range(17)]
    return compare_measures(
        find_brackets(levels > value[:, :1], levels),
        dict(zip(names, value.T)),
        dict.fromkeys(names, 1.0),
        "m0",
        event=event.astype(str),
    )


def rows_of(table):
    return {row["measure"]: row for row in table["rows"]}


class TestGrid:
    @pytest.mark.parametrize(
        "levels", [LEVELS, np.geomspace(0.05, 40.0, 12), LEVELS[:10]]
    )
    def test_known_curve_comes_back(self, levels):
        """Mean over 40 studies; levels far apart widen nothing, low ones leave bounds."""
        studies = (study(seed, levels=levels) for seed in range(40))
        found = [rows_of(compare_measures(**each))["PGV"] for each in studies]
        theta, beta = np.array([[np.log(row["theta"]), row["beta"]] for row in found]).T
        assert np.mean(theta) == pytest.approx(np.log(THETA), abs=0.02)
        assert np.sqrt(np.mean(beta**2)) == pytest.approx(BETA, rel=0.06)
        assert (found[0]["n_bracketed"] < found[0]["n_records"]) == (levels.size == 10)

    def test_best_measure_and_its_advantage(self):
        table = compare_measures(**study(1))
        rows = rows_of(table)
        assert table["best"] == "PGV"
        assert table["p_value"] < 0.05
        assert table["ratio"] == pytest.approx(
            rows["PGV"]["beta"] / rows["PGA"]["beta"]
        )
        assert "PGV is the most efficient" in table["message"]
        own = compare_measures(**study(1, own="PGV"))  # levels of PGV
        assert rows_of(own)["IA"]["beta"] == pytest.approx(rows["IA"]["beta"])
        assert (own["best"], own["p_value"], own["ratio"]) == ("PGV", 1.0, 1.0)
        assert "scaled by" in own["message"]

    @pytest.mark.parametrize("events", [30, 8])
    def test_advantage_is_claimed_where_there_is_one(self, events):
        """Of 17 measures of equal scatter the best is called better in 5 % of studies at most."""
        by_chance = 0
        better = 0
        for seed in range(200):
            by_chance += seventeen(seed, events, 1.0)["p_value"] < 0.05
            if seed < 40:
                table = seventeen(seed, events, 0.3)
                better += table["best"] == "m16" and table["p_value"] < 0.05
        assert by_chance <= 18
        assert better >= 36

    @pytest.mark.parametrize("top", [18, 9])
    def test_sufficiency(self, top):
        """PGA capacity depends on magnitude by -0.3; with 9 levels a third is known as a bound."""
        slopes = []
        insufficient = 0
        sufficient = 0
        for seed in range(40):
            rows = rows_of(compare_measures(**study(seed, top=top)))
            slopes.append(rows["PGA"]["slope_magnitude"])
            insufficient += rows["PGA"]["p_magnitude"] < 0.05
            sufficient += bool(rows["PGV"]["sufficient"])
        assert np.mean(slopes) == pytest.approx(-0.3, abs=0.06)
        assert insufficient >= 20
        assert sufficient >= 31

    @pytest.mark.parametrize(
        ("events", "records", "top"), [(15, 2, 40), (8, 3, 40), (6, 4, 40), (8, 3, 22)]
    )
    def test_records_of_one_event_count_once_for_magnitude(self, events, records, top):
        """Nothing depends on magnitude; at 22 levels a third of the capacities are bounds."""
        event = np.repeat(np.arange(events), records)
        rejected = 0
        count = 400 if top == 40 else 150
        for seed in range(count):
            generator = np.random.default_rng(seed)
            alike = generator.standard_normal(events)[event]
            own = generator.standard_normal(event.size)
            levels = np.geomspace(0.2, 5.0, 40)[:top]
            fell = np.log(levels) > 0.4 * np.sqrt(0.5) * (alike + own)[:, None]
            magnitude = generator.uniform(5.5, 7.5, events)[event]
            table = compare_measures(
                find_brackets(fell, levels),
                {"PGA": np.ones(event.size)},
                {"PGA": 1.0},
                "PGA",
                magnitude=magnitude,
                event=event.astype(str),
            )
            rejected += table["rows"][0]["p_magnitude"] < 0.05
            assert table["n_test"] == 1
        assert 0.025 <= rejected / count <= 0.085
