"""Runs gathered from grids and scattered motions, and their resampling."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.fragility.runs import Resampling, gather_runs


def test_grid_and_the_same_runs_scattered_are_equal():
    generator = np.random.default_rng(1)
    verdict = generator.integers(0, 5, (6, 4))
    im = np.array([0.1, 0.2, 0.3, 0.4])
    record = np.repeat(np.arange(6), 4)
    grid = gather_runs(verdict, im)
    flat = gather_runs(verdict.ravel(), np.tile(im, 6), record=record)
    assert np.array_equal(grid.collapses, flat.collapses)
    assert np.array_equal(grid.n, flat.n)
    assert grid.n.sum() == np.count_nonzero(verdict < 2)
    assert grid.collapses.sum() == np.count_nonzero(verdict == 1)
    assert grid.records_repeat


def test_own_intensity_for_each_run():
    runs = gather_runs([1, 0, 1], [0.3, 0.1, 0.2])
    assert runs.levels.tolist() == [0.1, 0.2, 0.3]
    assert runs.totals[0].tolist() == [0.0, 1.0, 1.0]
    assert not runs.records_repeat


def test_events_are_resampled_whole():
    verdict = np.array([[1, 1], [1, 1], [0, 0], [0, 0]])
    runs = gather_runs(verdict, [0.1, 0.2], event=["a", "a", "", ""])
    assert runs.group.max() == 2
    collapses, n = runs.resample(Resampling(seed=1, resamples=200))
    assert set(collapses[:, 0]) <= {0.0, 2.0, 4.0, 6.0}
    assert n.mean() == pytest.approx(4.0, abs=0.2)
    assert np.all(collapses[:, 0] == collapses[:, 1])


def test_resampling_has_the_variance_of_the_mean():
    generator = np.random.default_rng(2)
    runs = gather_runs((generator.random((50, 1)) < 0.3).astype(int), [1.0])
    collapses, _ = runs.resample(Resampling(seed=3, resamples=4000))
    p = runs.totals[0][0] / 50
    assert collapses.std() == pytest.approx(np.sqrt(50 * p * (1 - p)), rel=0.05)


def test_many_intensities_are_gathered_without_loss():
    generator = np.random.default_rng(3)
    im = np.exp(generator.normal(size=3000))
    verdict = (generator.random(3000) < 0.4).astype(int)
    runs = gather_runs(verdict, im)
    assert runs.levels.size == 500
    assert runs.totals[0].sum() == verdict.sum()
    assert runs.totals[1].sum() == 3000
    coarse = runs.binned(40)
    assert coarse.levels.size == 40
    assert coarse.totals[0].sum() == verdict.sum()
    assert coarse.totals[1] @ np.log(coarse.levels) == pytest.approx(np.log(im).sum(), abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"verdict": [2, 3], "im": 0.1}, "no run that"),
        ({"verdict": [0, 1], "im": [0.1, 0.2, 0.3]}, "one intensity per run"),
        ({"verdict": [0, 1], "im": [0.1, -0.2]}, "-0.2"),
        ({"verdict": [0, 1], "im": [0.1, 0.2], "record": [1]}, "record"),
        ({"verdict": [0, 1], "im": [0.1, 0.2], "event": ["a"]}, "event"),
        ({"verdict": 1, "im": 0.1}, "n_record"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        gather_runs(**arguments)


def test_bad_resampling_is_refused():
    with pytest.raises(InputError, match="99"):
        Resampling(seed=1, resamples=99)
    with pytest.raises(InputError, match="confidence"):
        Resampling(seed=1, confidence=1.0)
