"""Curves of a cube's runs that no other test of studies makes."""

import numpy as np
import pytest

from archfrag.fragility.counts import Verdict
from archfrag.study.comparisons import dispersion_split
from archfrag.study.curves import POINTS, Answer, Runs, answer, likeliest

LEVELS = np.geomspace(0.1, 10.0, 60)


def bracketed(capacity, made):
    """Verdicts on both sides of each capacity, of those records that were run."""
    verdict = np.full((capacity.size, LEVELS.size), int(Verdict.NOT_SIMULATED))
    above = np.searchsorted(LEVELS, capacity)
    rows = np.flatnonzero(made)
    verdict[rows, above[rows]] = Verdict.COLLAPSED
    verdict[rows, above[rows] - 1] = Verdict.STANDING
    return verdict


def two_stage(n_fine, n=40, bias=0.2, shift=0.0):
    generator = np.random.default_rng(3)
    fine = np.exp(generator.normal(shift, 0.4, n))
    coarse = fine * np.exp(generator.normal(bias, 0.05, n))
    made = np.arange(n) < n_fine
    full = np.ones(n, bool)
    runs = Runs(
        "arch", "two_stage", bracketed(fine, made), LEVELS, np.ones((n, LEVELS.size)),
        coarse=bracketed(coarse, full), rows=np.arange(n),
    )  # fmt: skip
    return runs, fine


class TestTwoFidelities:
    def test_coarse_capacities_sharpen_the_curve_of_some_fine_ones(self):
        runs, fine = two_stage(n_fine=12)
        found = answer(runs, 0.9)
        alone = answer(two_stage(n_fine=40)[0], 0.9)
        assert found.method == "control variate, jackknife"
        assert found.curve.theta == pytest.approx(np.exp(np.log(fine).mean()), rel=0.04)
        assert found.curve.beta == pytest.approx(np.log(fine).std(ddof=1), rel=0.1)
        some = Runs("arch", "ida", runs.verdict, LEVELS, runs.factor)
        width = [
            np.log(each.theta[1] / each.theta[0]) for each in (found, alone, answer(some, 0.9))
        ]
        assert width[0] < 1.2 * width[1] < 0.8 * width[2]
        assert len(found.im) == len(found.lower) == POINTS

    def test_where_all_records_have_fine_ones_these_decide(self):
        assert "posterior" in answer(two_stage(n_fine=40)[0], 0.9).method

    def test_a_capacity_beyond_the_levels_leaves_it_to_the_fine_ones(self):
        runs, _ = two_stage(n_fine=20)
        runs.coarse[5] = np.where(np.arange(LEVELS.size) == 0, Verdict.STANDING, 4)
        assert "posterior" in answer(runs, 0.9).method


class TestDispersionOfAClass:
    """Capacities exp(record + arch), of which the strongest are beyond the largest level."""

    @staticmethod
    def made(largest, n_arch=30, n_record=60):
        generator = np.random.default_rng(5)
        arch = 0.2 * generator.standard_normal((n_arch, 1))
        record = 0.4 * generator.standard_normal(n_record)
        own = 0.1 * generator.standard_normal((n_arch, n_record))
        capacity = np.exp(arch + record + own)
        levels = LEVELS[largest > LEVELS]
        runs = [
            Runs("a", "stripes", (levels >= row[:, None]).astype(int), levels, np.ones((1, 1)))
            for row in capacity
        ]
        parts = arch.std(ddof=1), np.hypot(record.std(ddof=1), 0.1)
        return runs, [Answer(fit, fit) for fit in map(likeliest, runs)], parts

    @pytest.mark.parametrize("largest", [20.0, 1.5])
    def test_arches_that_withstand_the_largest_level_count(self, largest):
        runs, answers, parts = self.made(largest)
        found = dispersion_split(runs, answers)
        assert found["beta_model"] == pytest.approx(parts[0], rel=0.1)
        assert found["beta_record_to_record"] == pytest.approx(parts[1], rel=0.1)
        assert found["combined"] == pytest.approx(
            np.hypot(found["beta_model"], found["beta_record_to_record"])
        )
        assert found["n_arch"] == 30

    def test_without_two_curves_there_is_none(self):
        runs, answers, _ = self.made(1.5)
        found = dispersion_split(runs[:2], [answers[0], Answer("no curve", "no curve")])
        assert "one arch has no modelling dispersion" in found["none"]
