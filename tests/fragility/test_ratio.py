"""Ratios of two arches under the same motions, against Student's t on pairs of capacities."""

import numpy as np
import pytest
from scipy.stats import t as student

from archfrag.errors import FitError
from archfrag.fragility.posterior import fit_capacity_posterior
from archfrag.fragility.risk import HazardCurve, collapse_rate, lognormal_rates
from archfrag.fragility.several import (
    MOST_PARTS,
    crossing_groups,
    left_out,
    parts_of,
    ratios,
)
from archfrag.fragility.verdicts import find_brackets

LEVELS = np.geomspace(0.02, 60.0, 400)
IM = np.geomspace(0.02, 20.0, 2)
HAZARD = HazardCurve(IM, 1e-3 * IM**-2.5)


def estimate(found):
    return fit_capacity_posterior(found).curve


def compared(log_capacities, groups, hazard=None, levels=LEVELS, **options):
    found = [
        find_brackets(np.exp(logs)[:, None] <= levels, levels)
        for logs in log_capacities
    ]
    parts = parts_of(groups)
    without = [tuple(left_out(own, parts, estimate) for own in found)]
    return ratios(tuple(map(estimate, found)), without, hazard, **options)


def pairs(n, per_event=1, seed=4):
    """ln capacities of two arches, (2, n), and the events of their records."""
    generator = np.random.default_rng(seed)
    event = np.arange(n) // per_event
    z = (
        generator.standard_normal((2, n))
        + (per_event > 1) * generator.standard_normal((2, n))[:, event]
    )
    return 0.4 * np.array([z[0], 0.8 * z[0] + 0.6 * z[1]]) + [[0.0], [0.3]], event


@pytest.mark.parametrize(("n", "per_event"), [(6, 2), (8, 1), (24, 1), (30, 2)])
@pytest.mark.parametrize("confidence", [0.9, 0.5])
def test_the_interval_of_medians_is_that_of_paired_capacities_by_events(
    n, per_event, confidence
):
    logs, event = pairs(n, per_event)
    row = compared(logs, event, confidence=confidence)["theta"]
    means = np.bincount(event, logs[1] - logs[0]) / per_event
    error = means.std(ddof=1) / np.sqrt(means.size)
    reach = student.ppf(0.5 + 0.5 * confidence, means.size - 1) * error
    assert np.log(row["ratio"]) == pytest.approx(means.mean(), abs=0.02 * reach + 0.02)
    assert np.log(row["upper"] / row["lower"]) == pytest.approx(2.0 * reach, rel=0.03)
    assert row["ratio"] == row["after"] / row["before"]


def test_rates_are_those_of_the_curves_and_their_interval_is_wide_for_three_events():
    few, many = (compared(*pairs(n, 2), HAZARD)["rate"] for n in (6, 60))
    for row in (few, many):
        assert row["ratio"] == pytest.approx(row["after"] / row["before"])
        assert row["lower"] < row["ratio"] < row["upper"]
    assert few["upper"] / few["lower"] > (many["upper"] / many["lower"]) ** 3
    logs, event = pairs(8)
    shifted = compared(
        [logs[0], logs[0] + np.log(LEVELS[1] / LEVELS[0]) * 20], event, HAZARD
    )
    # A curve that is moved only: rates differ by the power of the hazard, without doubt.
    power = (LEVELS[1] / LEVELS[0]) ** (-2.5 * 20)
    assert [shifted["rate"][k] for k in ("ratio", "lower", "upper")] == pytest.approx(
        [power] * 3, rel=2e-2
    )


def test_equal_arches_have_a_ratio_of_one_without_doubt():
    logs, event = pairs(12)
    for row in compared([logs[0], logs[0]], event, HAZARD).values():
        assert [row[key] for key in ("ratio", "lower", "upper")] == [1.0, 1.0, 1.0]


def test_the_onset_of_motion_is_that_of_each_arch():
    logs, event = pairs(12)
    row = compared(logs, event, HAZARD, onsets=(0.5, 1.0))["rate"]
    found = [find_brackets(np.exp(own)[:, None] <= LEVELS, LEVELS) for own in logs]
    expected = [
        collapse_rate(HAZARD, estimate(own), onset=onset).rate
        for own, onset in zip(found, (0.5, 1.0))
    ]
    assert [row["before"], row["after"]] == pytest.approx(expected)
    assert expected[0] < lognormal_rates(
        HAZARD, estimate(found[0]).theta, estimate(found[0]).beta
    )


def test_groups_are_left_out_as_a_whole_and_many_of_them_together():
    parts = parts_of(["a", "b", "a", "c", "b"])
    assert parts.sum(axis=0).tolist() == [1] * 5
    assert sorted(map(tuple, parts.astype(int).tolist())) == [
        (0, 0, 0, 1, 0),
        (0, 1, 0, 0, 1),
        (1, 0, 1, 0, 0),
    ]
    many = parts_of(np.arange(1000))
    assert many.shape == (MOST_PARTS, 1000)
    assert set(many.sum(axis=1)) == {25}
    with pytest.raises(
        FitError,
        match="of 2 independent motions, earthquakes, first shocks or rows; an",
    ):
        parts_of(["a", "b", "a"])


def test_groups_within_others_are_left_out_with_these_and_crossing_ones_have_cells():
    event = np.arange(12) // 2
    turn = np.arange(12) % 3
    (alone,) = crossing_groups([np.arange(12), turn.astype(str)])
    assert alone.tolist() == turn.tolist()
    (once,) = crossing_groups([event, event + 7])
    assert once.tolist() == event.tolist()
    coarse, fine, cells = crossing_groups([event, turn, np.arange(12)])
    assert (coarse.tolist(), fine.tolist()) == (turn.tolist(), event.tolist())
    assert np.unique(cells).size == 12


def test_first_shocks_in_turn_widen_the_interval_to_hold_the_ratio():
    turn = np.arange(24) % 4
    held = {"record": [], "first shock": []}
    for seed in range(30):
        generator = np.random.default_rng(seed)
        before = 0.3 * generator.standard_normal(24)
        own = 0.05 * generator.standard_normal(24)
        logs = before, before - 0.2 + 0.2 * generator.standard_normal(4)[turn] + own
        for what, groups in zip(held, (np.arange(24), turn)):
            row = compared(logs, groups)["theta"]
            held[what].append(row["lower"] <= np.exp(-0.2) <= row["upper"])
    assert np.mean(held["record"]) < 0.75
    assert np.mean(held["first shock"]) >= 0.8


def test_variances_of_groups_that_cross_add_up():
    rows, records = np.indices((6, 8)).reshape(2, -1)
    generator = np.random.default_rng(3)
    change = (
        0.15 * generator.standard_normal(6)[rows]
        + 0.15 * generator.standard_normal(8)[records]
    )
    logs = 0.3 * generator.standard_normal(48)
    logs = np.array([logs, logs + change])
    found = [find_brackets(np.exp(own)[:, None] <= LEVELS, LEVELS) for own in logs]
    curves = tuple(map(estimate, found))

    def error(*groups):
        ways = map(parts_of, crossing_groups(groups))
        without = [
            tuple(left_out(own, parts, estimate) for own in found) for parts in ways
        ]
        row = ratios(curves, without, HAZARD)
        assert row["rate"]["lower"] < row["rate"]["ratio"] < row["rate"]["upper"]
        return np.log(row["theta"]["upper"] / row["theta"]["ratio"])

    both = error(rows, records)
    assert both > 1.15 * error(rows)
    assert both < error(rows) + error(records)
