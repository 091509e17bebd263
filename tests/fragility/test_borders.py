"""Brackets of capacity: islands, ends, cells that were not run."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.fragility.borders import fill_verdicts, find_brackets

LEVELS = np.array([0.1, 0.2, 0.3, 0.4, 0.5])


def test_rules_differ_at_islands_only():
    verdict = [[0, 0, 1, 1, 1], [0, 1, 0, 0, 1], [0, 0, 0, 0, 0], [1, 1, 1, 1, 1]]
    fewest, first = find_brackets(verdict, LEVELS), find_brackets(verdict, LEVELS, "first")
    assert fewest.lower.tolist() == [0.2, 0.4, 0.5, 0.0]
    assert fewest.upper.tolist() == [0.3, 0.5, np.inf, 0.1]
    assert fewest.contradictions.tolist() == [0, 1, 0, 0]
    assert first.lower.tolist() == [0.2, 0.1, 0.5, 0.0]
    assert first.contradictions.tolist() == [0, 2, 0, 0]
    assert fewest.middle[0] == pytest.approx(np.sqrt(0.06))
    assert np.isnan(fewest.middle[2:]).all()


def test_cells_that_decide_nothing_widen_the_bracket():
    found = find_brackets([[0, 4, 2, 1, 4], [4, 4, 4, 4, 3]], LEVELS)
    assert (found.lower[0], found.upper[0]) == (0.1, 0.4)
    assert (found.lower[1], found.upper[1], found.decided[1]) == (0.0, np.inf, 0)


def test_bisected_grid_is_filled_to_the_grid_it_stands_for():
    generator = np.random.default_rng(1)
    capacity = generator.uniform(0.05, 0.6, 40)
    whole = (capacity[:, None] <= LEVELS).astype(int)
    bisected = np.full(whole.shape, 4)
    for row, cells in zip(whole, bisected, strict=True):
        low, high = -1, LEVELS.size
        while high - low > 1:
            middle = (low + high) // 2
            cells[middle] = row[middle]
            low, high = (low, middle) if row[middle] else (middle, high)
    assert np.count_nonzero(bisected == 4) > 50
    assert np.array_equal(fill_verdicts(bisected), whole)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="fewest, first"):
        find_brackets([[0, 1]], [0.1, 0.2], "last")
    with pytest.raises(InputError, match="rise"):
        find_brackets([[0, 1]], [0.2, 0.1])
    with pytest.raises(InputError, match="shape"):
        find_brackets([[0, 1]], [0.1, 0.2, 0.3])
    with pytest.raises(InputError, match="n_record"):
        fill_verdicts([0, 1])
