"""Designs that stop when the median is known well enough, driven without an arch."""

import numpy as np
import pytest

from archfrag.fragility.quoted import quoted_band
from archfrag.study.design import Ida, Precision, Scattered
from archfrag.study.grids import Grid, ida
from archfrag.study.rounds import LEAST_RECORDS, Rounds, Stop, known_so_far, scattered

LEVELS = np.exp(0.3 * np.linspace(-2.5, 2.5, 15))
N_RECORD = 2000


def play(strand, log_capacity):
    """Notes of the design, and the table of verdicts of a grid."""
    rounds = Rounds({0: strand})
    verdict = np.full((log_capacity.size, LEVELS.size), 4)
    tried, fallen = [], []
    while len(rounds.wanted):
        cases = rounds.wanted
        fell = (np.log(cases["level"]) >= log_capacity[cases["record"]]).astype(np.int8)
        verdict[cases["record"], cases["place"]] = fell
        tried.append(cases["level"])
        fallen.append(fell)
        rounds.answer(fell)
    return rounds.notes[0], verdict, np.concatenate(tried), np.concatenate(fallen)


def play_ida(log_capacity, groups=None, **keys):
    precision = Precision(**({"theta": 0.1, "runs": 10_000} | keys))
    none = np.empty((log_capacity.size, 0))
    grid = Grid(0, np.arange(log_capacity.size), LEVELS, none, groups)
    return play(ida(grid, Ida(kind="ida", checks=0, precision=precision)), log_capacity)


def capacities(seed, beta=0.3, n=N_RECORD):
    return beta * np.random.default_rng(seed).standard_normal(n)


class TestStopping:
    @pytest.mark.parametrize("kind", ["ida", "scattered"])
    def test_it_stops_by_the_interval_that_is_quoted(self, kind):
        if kind == "ida":
            note, verdict, _, _ = play_ida(capacities(1))
            quoted = quoted_band("ida", verdict[: note["records"]], LEVELS, 1.0)
        else:
            design = Scattered(kind="scattered", precision=Precision(theta=0.1, runs=10_000))
            strand = scattered(0, np.arange(N_RECORD), LEVELS, design)
            note, _, tried, fell = play(strand, capacities(2))
            quoted = quoted_band("scattered", fell, tried, 1.0)
            assert note["runs"] == tried.size < 400
        reach = np.abs(np.log(np.array(quoted.theta) / quoted.curve.theta)).max()
        assert note["reached"]
        assert note["half_width"] == pytest.approx(reach, rel=1e-12)
        assert reach <= 0.1
        assert note["records"] > LEAST_RECORDS

    def test_median_is_as_well_known_as_asked(self):
        """90 % is asked for; 25 repeats have a standard error of 6 %."""
        error = []
        for seed in range(25):
            note, verdict, _, _ = play_ida(capacities(seed), theta=0.06)
            found = known_so_far("ida", verdict[: note["records"]], LEVELS)
            error.append(abs(found.log_median))
        assert np.mean(np.array(error) <= 0.06) >= 0.8

    def test_one_narrow_look_is_not_enough(self):
        stop = Stop(Precision(theta=0.1))
        looks = [(0.09, 40), (0.11, 42), (0.09, 45), (0.09, 48)]
        assert [stop.look(width, done, 20) for width, done in looks] == [False] * 3 + [True]
        early = Stop(Precision(theta=0.1))
        assert not early.look(0.01, 10, 20)
        assert not early.look(0.01, 21, 20)

    def test_records_of_shared_events_are_worth_fewer(self):
        shared = np.repeat(capacities(4, n=400), 4)
        groups = np.repeat(np.arange(400), 4).astype(str)
        aware, unaware = play_ida(shared, groups)[0], play_ida(shared)[0]
        assert aware["records"] > 2 * unaware["records"]
