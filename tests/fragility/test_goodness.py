"""The test of fit: right size with shared and with own records, power, and its estimate of rho."""

import numpy as np
import pytest

from archfrag.errors import FitError
from archfrag.fragility.goodness import check_lognormal
from archfrag.fragility.runs import Resampling, gather_runs

LEVELS = np.geomspace(0.1, 1.2, 12)


def grid(generator, n=30, rho=1.0):
    noise = np.sqrt(rho) * generator.normal(size=(n, 1))
    noise = noise + np.sqrt(1.0 - rho) * generator.normal(size=(n, LEVELS.size))
    return (np.log(LEVELS) >= -1.0 + 0.4 * noise).astype(int)


@pytest.mark.parametrize("rho", [1.0, 0.5])
def test_size_where_records_are_shared(rho):
    """100 lognormal studies: p is below 0.5 in half and below 0.1 in a tenth of them.

    Three standard errors are 15 and 9 %. With runs drawn as independent, p of shared records is
    above 0.5 in nearly all.
    """
    p = np.array(
        [
            check_lognormal(
                gather_runs(grid(np.random.default_rng(i), rho=rho), LEVELS), Resampling(i, 100)
            ).p_value
            for i in range(100)
        ]
    )
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.15)
    assert np.mean(p < 0.1) == pytest.approx(0.1, abs=0.09)


def test_size_where_each_run_has_its_own_motion():
    p = []
    for i in range(40):
        generator = np.random.default_rng(i)
        x = generator.normal(-1.0, 0.6, 150)
        verdict = (x >= generator.normal(-1.0, 0.4, 150)).astype(int)
        found = check_lognormal(gather_runs(verdict, np.exp(x)), Resampling(i, 100))
        assert np.isnan(found.record_correlation)
        p.append(found.p_value)
    assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.24)


def test_two_populations_are_found():
    generator = np.random.default_rng(1)
    centre = np.where(np.arange(40) < 20, -1.7, -0.5)[:, None]
    verdict = (np.log(LEVELS) >= generator.normal(centre, 0.12)).astype(int)
    found = check_lognormal(gather_runs(verdict, LEVELS), Resampling(1, 200))
    assert found.p_value < 0.01
    assert "does not describe" in found.message


def test_correlation_of_a_record_is_recovered():
    generator = np.random.default_rng(2)
    for rho in (0.3, 0.9):
        runs = gather_runs(grid(generator, n=400, rho=rho), LEVELS)
        found = check_lognormal(runs, Resampling(3, 100))
        assert found.record_correlation == pytest.approx(rho, abs=0.07)
    monotone = check_lognormal(gather_runs(grid(generator), LEVELS), Resampling(3, 100))
    assert monotone.record_correlation == 1.0
    assert "Nothing here contradicts" in monotone.message


def test_without_a_curve_there_is_nothing_to_test():
    with pytest.raises(FitError, match="nothing to test"):
        check_lognormal(gather_runs([[0, 1], [0, 1]], [0.1, 0.2]), Resampling(1, 100))
