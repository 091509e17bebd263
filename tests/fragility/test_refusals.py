"""What gives no curve and what is bad input: each is an error that names what is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Curve
from archfrag.fragility.efficiency import compare_measures
from archfrag.fragility.fit import fit_brackets, fit_cloud, fit_ida, fit_stripes
from archfrag.fragility.posterior import fit_capacity_posterior, fit_posterior
from archfrag.fragility.quoted import (
    check_lognormal,
    isotonic_curve,
    quoted_band,
)
from archfrag.fragility.risk import HazardCurve, collapse_rate, level_edges
from archfrag.fragility.several import split_capacities, split_curves
from archfrag.fragility.verdicts import find_brackets

INF = np.inf
CURVE = Curve(0.5, 0.4, np.diag([0.01, 0.005]), 0.0, 5, 30, "ida")
HAZARD = HazardCurve([0.1, 1.0], [1e-2, 1e-4])
LEVELS = np.geomspace(0.1, 1.0, 5)
FOUND = find_brackets(np.arange(5) >= np.array([[1], [2], [3], [4]]), LEVELS)
STATES = np.arange(2) <= np.arange(5)[:, None] + np.zeros((4, 1, 1))


def brackets(*rows, levels=(0.1, 0.2)):
    return find_brackets(np.array(rows), levels)


def measures(found=FOUND, **changed):
    given = {"values": {"PGA": np.ones(4)}, "exponent": {"PGA": 1.0}, "own": "PGA"}
    return compare_measures(found, **given | changed)


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: fit_stripes([0.1, 0.2], [0, 0], 5), "theta lies above 0.2"),
        (lambda: fit_stripes([0.1, 0.2, 0.3], [0, 0, 5], 5), "between 0.2 and 0.3"),
        (lambda: fit_stripes([0.1, 0.2, 0.3], [0, 2, 5], 5), "theta to 0.2"),
        (lambda: fit_stripes([0.1, 0.2], [4, 1], 5), "does not rise"),
        (lambda: fit_stripes([0.1, 0.2], [0, 0], 0), "nothing to fit"),
        (lambda: fit_ida([0.5, 0.5]), "all 2 capacities are 0.5"),
        (lambda: fit_ida([0.5, 0.6], 0.4), "between 0.4 and inf agrees with all"),
        (lambda: fit_ida([0.5, 0.6], 0.5), "between 0.5 and 0.5 agrees with all"),
        (lambda: fit_cloud([0.1, 0.2], [0, 0]), "above"),
        (lambda: fit_cloud([0.1, 0.2, 0.3, 0.4], [1, 1, 0, 0]), "does not rise"),
        (
            lambda: fit_brackets([0.3, 0.2], [0.4, 0.3]),
            "between 0.3 and 0.3 agrees with all",
        ),
        (lambda: fit_brackets([0.0, 0.5], [0.2, INF]), "bracketed from both sides"),
        (lambda: split_capacities([[1.0, 2.0]]), "1 arches"),
        (lambda: split_curves([1], [0.4], [0.1]), "one arch"),
        (lambda: brackets([2, 3]).of_records(), "no run collapsed or survived"),
        (
            lambda: fit_capacity_posterior(brackets([0, 0], [0, 4])),
            "add levels above 0.2",
        ),
        (
            lambda: fit_capacity_posterior(brackets([1, 1], [4, 1])),
            "add levels below 0.1",
        ),
        (
            lambda: fit_capacity_posterior(brackets([0], [1], levels=[0.1])),
            "at 1 level",
        ),
        (lambda: fit_posterior([0.5, 0.5], [0, 1], 1), "at 1 level"),
        (
            lambda: fit_posterior([0.1, 0.2, 0.2], [0, 0, 0], [3, 2, 0]),
            "add levels above 0.2",
        ),
        (
            lambda: fit_posterior([0.1, 0.2], [3, 2], [3, 2]),
            "bounds theta from below.* 0.1, the",
        ),
        (
            lambda: quoted_band(find_brackets([[0]] * 3, [[0.1], [0.2], [0.4]]), 0.1),
            "from above: add levels above 0.4",
        ),
        (
            lambda: quoted_band(find_brackets([[1]] * 3, [[0.1], [0.2], [0.4]]), 0.1),
            "below 0.1.*smaller factor of",
        ),
        (lambda: quoted_band(brackets([2, 3]), 1.0), "no run collapsed"),
        (lambda: quoted_band(FOUND, 1.0, groups=[1] * 4), "one group, 1"),
        (lambda: isotonic_curve(brackets([2, 3])), "no run"),
        (lambda: check_lognormal(brackets([0, 1], [0, 1])), "nothing to test"),
        (lambda: measures(brackets(*[[0, 0]] * 4)), "no measure"),
        (lambda: measures(brackets([0], [0], [1], [1], levels=[1.0])), "single runs"),
    ],
)
def test_data_that_give_no_curve(call, key):
    with pytest.raises(FitError, match=key):
        call()


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: find_brackets([[0, 1]], [0.1, 0.0]), "levels holds 0"),
        (lambda: fit_stripes([-0.1, 0.2], [0, 1], 5), "im holds -0.1"),
        (lambda: fit_stripes([0.1, 0.2], [0, 6], 5), "collapses is 6 at im = 0.2"),
        (lambda: fit_stripes([0.1, 0.2], [0, 1], [5, INF]), "n holds inf"),
        (lambda: fit_stripes([], [], 5), r"im has shape \(0,\)"),
        (lambda: fit_ida([]), r"shape \(0,\)"),
        (lambda: fit_ida([0.5, 0.6], -1.0), "truncate_at holds -1"),
        (lambda: replace(CURVE, confidence=90.0).band(0.5), "confidence is 90"),
        (lambda: HazardCurve([0.2, 0.1], [2e-3, 1e-3]), "has 0.1 after 0.2"),
        (lambda: HazardCurve([0.1, 0.2], [1e-3, 1e-3]), "is 0.001 at all its points"),
        (lambda: HazardCurve([0.1], [1e-3]), "has 1 of 1 points"),
        (lambda: HazardCurve.from_exceedance([0.1, 0.2], [0.2, 0.1], 0.0), "0 years"),
        (lambda: collapse_rate(HAZARD, CURVE, None, 1.0), "confidence is 1"),
        (lambda: collapse_rate(HAZARD, CURVE, ([0.5], [0.0])), "beta holds 0"),
        (lambda: collapse_rate(HAZARD, CURVE).probability_in(0.0), "years holds 0"),
        (lambda: level_edges([0.2, 0.1]), "levels has 0.1 after 0.2"),
    ],
)
def test_bad_input(call, key):
    with pytest.raises(InputError, match=key):
        call()
