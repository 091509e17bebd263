"""Unfinished runs and solver failures are counted, and counted as neither."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict, count_verdicts

VERDICTS = np.array(
    [
        [[0, 0, 1, 3], [0, 2, 1, 1]],
        [[0, 1, 1, 1], [0, 2, 3, 1]],
    ],
    dtype=np.int8,
)


def test_counts_per_level():
    counts = count_verdicts(VERDICTS)
    assert counts.standing.tolist() == [4, 1, 0, 0]
    assert counts.collapsed.tolist() == [0, 1, 3, 3]
    assert counts.unfinished.tolist() == [0, 2, 0, 0]
    assert counts.solver_failures.tolist() == [0, 0, 1, 1]
    assert counts.n.tolist() == [4, 2, 3, 3]
    assert counts.runs.tolist() == [4, 4, 4, 4]


def test_failures_leave_the_fraction_alone():
    verdict = np.array([[1], [0], [1], [0]])
    with_failures = np.array([[1], [0], [1], [0], [2], [3], [3]])
    a, b = count_verdicts(verdict), count_verdicts(with_failures)
    assert (a.collapsed / a.n).tolist() == (b.collapsed / b.n).tolist() == [0.5]


@pytest.mark.parametrize("foreign", [5, -1, np.nan])
def test_a_missing_run_is_told(foreign):
    with pytest.raises(InputError, match=r"none of 0 \(standing\)"):
        count_verdicts(np.array([[0.0, foreign]]))


def test_cells_without_a_run_count_as_nothing():
    counts = count_verdicts(np.array([[0, 4], [4, 4], [1, 1]]))
    assert counts.runs.tolist() == counts.n.tolist() == [2, 1]
    assert counts.collapsed.tolist() == [1, 1]


def test_a_single_value_is_no_table():
    with pytest.raises(InputError, match="levels last"):
        count_verdicts(Verdict.STANDING)
