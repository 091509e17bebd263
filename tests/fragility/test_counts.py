"""Verdicts counted, and the border between survival and collapse of each record."""

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import count_verdicts, find_brackets

LEVELS = np.array([0.2, 0.3, 0.4, 0.5, 0.7])
INF = np.inf


class TestCounts:
    def test_each_verdict_at_each_level(self):
        counts = count_verdicts([[0, 1, 4], [0, 2, 4], [1, 3, 1]])
        assert counts.standing.tolist() == [2, 0, 0]
        assert counts.collapsed.tolist() == [1, 1, 1]
        assert counts.unfinished.tolist() == [0, 1, 0]
        assert counts.solver_failures.tolist() == [0, 1, 0]
        assert counts.n.tolist() == [3, 1, 1]
        assert counts.runs.tolist() == [3, 3, 1]

    @pytest.mark.parametrize("foreign", [5, -1, np.nan])
    def test_a_missing_run_is_refused(self, foreign):
        with pytest.raises(InputError, match=r"of 0 \(standing\)"):
            count_verdicts(np.array([[0.0, foreign]]))


class TestBracketsOfRecords:
    @pytest.mark.parametrize(
        ("row", "ends", "contradictions"),
        [
            ([0, 0, 1, 1, 1], (0.3, 0.4), 0),
            ([1, 1, 1, 1, 1], (0.0, 0.2), 0),
            ([0, 0, 0, 0, 0], (0.7, INF), 0),
            ([0, 1, 0, 0, 1], (0.5, 0.7), 1),
            ([0, 2, 3, 1, 4], (0.2, 0.5), 0),
            ([0, 1, 2, 0, 1], (0.2, 0.3), 1),
        ],
    )
    def test_border_is_the_one_that_the_fewest_verdicts_contradict(
        self, row, ends, contradictions
    ):
        for order in (slice(None), slice(None, None, -1)):
            found = find_brackets([row[order]], LEVELS[order])
            assert (found.lower[0], found.upper[0]) == ends
            assert found.contradictions[0] == contradictions

    def test_undecided_records_are_left_out(self):
        found = find_brackets([[0, 0, 1, 1, 1], [2, 3, 2, 4, 2], [1, 0, 0, 0, 0]], LEVELS)
        assert (found.lower[1], found.upper[1], found.decided[1]) == (0.0, INF, 0)
        assert found.known().lower.size == 2
        assert found.middle[0] == pytest.approx(np.sqrt(0.12))
        assert np.isnan(found.middle[1])
        with pytest.raises(FitError, match="no run collapsed or stood"):
            find_brackets([[2, 3]], [0.1, 0.2]).known()

    def test_bisected_grid_is_filled_to_the_grid_it_stands_for(self):
        capacity = np.random.default_rng(1).uniform(0.1, 0.9, 40)
        full = (capacity[:, None] <= LEVELS).astype(int)
        bisected = np.full(full.shape, 4)
        for row, cells in zip(full, bisected, strict=True):
            low, high = -1, LEVELS.size
            while high - low > 1:
                middle = (low + high) // 2
                cells[middle] = row[middle]
                low, high = (low, middle) if row[middle] else (middle, high)
        assert np.count_nonzero(bisected == 4) > 50
        assert np.array_equal(find_brackets(bisected, LEVELS).filled, full)

    @pytest.mark.parametrize(
        ("verdict", "levels", "key"),
        [
            ([[0, 1]], [0.1], r"levels has shape \(1,\)"),
            ([[0, 1]], [0.1, 0.0], "levels holds 0"),
            ([0, 1], [0.1, 0.2], "n_record"),
            ([[0, 7]], [0.1, 0.2], "verdict holds 7"),
        ],
    )
    def test_tables_that_are_refused(self, verdict, levels, key):
        with pytest.raises(InputError, match=key):
            find_brackets(verdict, levels)
