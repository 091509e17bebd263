"""A limit state from a search for collapse: the joint likelihood, and how often it is right."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from archfrag.errors import FitError
from archfrag.fragility import damage
from archfrag.fragility.damage import fit_state_posterior
from archfrag.fragility.posterior import fit_capacity_posterior
from archfrag.fragility.verdicts import Verdict, find_brackets
from archfrag.study.designs import Grid, Ida, ask

LEVELS = np.geomspace(0.35, 5.6, 15)
POINT = np.array([[0.1, np.log(0.4), -0.2, np.log(0.5), 0.9]])


def searched(collapsed, seed):
    """Which runs a search makes, (n_record, n_level), of records that collapse in these."""
    grid = Grid(0, np.arange(len(collapsed)), LEVELS, np.ones(len(collapsed)), 1.0)
    requests = {0: Ida(kind="ida", seed=seed).requests(grid)}
    ask(
        requests,
        lambda cases: collapsed[cases["record"], cases["place"]].astype(np.int8),
    )
    return grid.seen != Verdict.NOT_RUN


def world(seed, n=30, ratio=0.65, beta=0.4, r=0.8, per_event=1):
    """Brackets of collapse, of the state short of it, and of the state by all runs made."""
    generator = np.random.default_rng(seed)
    events = np.sqrt(0.5) * np.repeat(
        generator.standard_normal((2, n // per_event)), per_event, 1
    )
    own = generator.standard_normal((2, n))
    z = own if per_event == 1 else events + np.sqrt(0.5) * own
    collapse = 1.6 * np.exp(0.4 * z[0])
    state = 1.6 * ratio * np.exp(beta * (r * z[0] + np.sqrt(1.0 - r * r) * z[1]))
    fell = collapse[:, None] <= LEVELS
    exceeds = fell | (state[:, None] <= LEVELS)
    made = searched(fell, seed)
    tables = [
        np.where(made, fell, Verdict.NOT_RUN),
        np.where(made & ~fell, exceeds, Verdict.NOT_RUN),
        np.where(made, exceeds, Verdict.NOT_RUN),
    ]
    return [find_brackets(each.astype(int), LEVELS) for each in tables]


@pytest.mark.parametrize("seed", range(4))
def test_probability_of_both_brackets_is_that_of_the_bivariate_normal(seed):
    ends = np.sort(np.random.default_rng(seed).normal(0.0, 0.5, (2, 2)), axis=1)
    r = np.tanh(0.9)
    law = multivariate_normal([0.1, -0.2], [[0.16, 0.2 * r], [0.2 * r, 0.25]])
    found = damage._both(POINT, ends.reshape(4, 1))
    assert np.exp(found[0, 0]) == pytest.approx(
        law.cdf(ends[:, 1], lower_limit=ends[:, 0]), abs=2e-4
    )


def test_the_curve_is_that_of_the_lesser_capacity():
    generator = np.random.default_rng(1)
    z = generator.standard_normal((2, 400_000))
    r = np.tanh(0.9)
    lesser = np.minimum(
        0.1 + 0.4 * z[0], -0.2 + 0.5 * (r * z[0] + np.sqrt(1.0 - r * r) * z[1])
    )
    mean, deviation = damage._of_lesser(POINT)
    assert mean[0] == pytest.approx(lesser.mean(), abs=3e-3)
    assert deviation[0] == pytest.approx(lesser.std(), abs=3e-3)


@pytest.mark.parametrize(
    ("keys", "number"),
    [({}, 30.0), ({"ratio": 0.8}, 30.0), ({"per_event": 3}, 18.0)],
)
def test_intervals_hold_the_truth_where_the_state_alone_is_biased(keys, number):
    held = []
    away = []
    alone = []
    for seed in range(24):
        collapse, short, naive = world(seed, **keys)
        try:
            found = fit_state_posterior(collapse, short, number)
        except FitError:
            continue
        generator = np.random.default_rng(0)
        z = generator.standard_normal((2, 100_000))
        r = keys.get("r", 0.8)
        one = 0.4 * z[0]
        two = np.log(keys.get("ratio", 0.65)) + keys.get("beta", 0.4) * (
            r * z[0] + np.sqrt(1.0 - r * r) * z[1]
        )
        truth = np.log(1.6) + np.median(np.minimum(one, two))
        low, high = found.log_thetas([0.05, 0.95])
        held.append(low <= truth <= high)
        away.append(np.log(found.curve.theta) - truth)
        alone.append(np.log(fit_capacity_posterior(naive).curve.theta) - truth)
    assert len(held) >= 14
    assert np.mean(held) >= 0.8
    assert abs(np.mean(away)) < 0.06
    assert np.mean(alone) < np.mean(away) - 0.03


def test_few_records_with_a_run_below_the_state_give_no_curve():
    collapse, short, _ = world(3, ratio=0.25)
    with pytest.raises(
        FitError, match=r"of the records have a run below it, and 30 % are needed"
    ):
        fit_state_posterior(collapse, short, 30.0)


def test_fewer_independent_records_give_a_wider_interval():
    collapse, short, _ = world(5)
    widths = [
        np.ptp(fit_state_posterior(collapse, short, number).log_thetas([0.05, 0.95]))
        for number in (10.0, 30.0)
    ]
    assert widths[0] > 1.4 * widths[1]


def test_the_same_runs_give_the_same_bits():
    collapse, short, _ = world(5)
    one, two = (fit_state_posterior(collapse, short, 30.0) for _ in range(2))
    assert one.curve.theta == two.curve.theta
    assert np.array_equal(one.density, two.density)
