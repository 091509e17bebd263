"""Mean loss and average annual loss: against oq-vmtk's formulas, in closed form, what is refused.

oq-vmtk (GEMScienceTools, openquake/vmtk/postprocessor.py, commit eb195222): a vulnerability
function is the sum of ratios times differences of neighbouring probabilities of exceedance, and an
average annual loss the sum of that function, linear between its points, at the middles of the
hazard's points times the differences of the rates. Both are written here once more.
"""

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import HazardCurve, collapse_rate
from archfrag.fragility.several import (
    average_annual_loss,
    checked_ratios,
    loss_steps,
    vulnerability,
)

SPREAD = np.array([[4e-3, 1e-3], [1e-3, 3e-3]])
RATIOS = {"motion": 0.02, "rotation": 0.3, "collapse": 1.0}
# Almost all of the rates is from within it, where oq-vmtk's sum is.
HAZARD = HazardCurve(
    [1e-3, 0.05, 0.2, 0.6, 1.5, 19.0], [0.9, 0.08, 0.01, 8e-4, 4e-5, 1e-12]
)


def arch(rotation=0.5, motion=0.3):
    states = (
        Curve(motion, 0.35, SPREAD, kind="posterior", state="motion"),
        Curve(rotation, 0.35, SPREAD, kind="posterior", state="rotation"),
        Curve(reason="all runs collapse", state="impact"),
    )
    return Curve(0.8, 0.4, SPREAD, kind="posterior", states=states)


def loss_by_oq_vmtk(poes, ratios):
    """(n, n_state) probabilities of exceedance and ratios, from mild to severe."""
    further = np.hstack([poes[:, 1:], np.zeros((len(poes), 1))])
    return (poes - further) @ ratios


def annual_loss_by_oq_vmtk(vulnerability_points, hazard_points):
    im, loss = vulnerability_points
    at, rate = hazard_points
    middle = 0.5 * (at[1:] + at[:-1])
    ordinates = np.interp(
        middle, np.hstack([0.0, im, 20.0]), np.hstack([0.0, loss, 1.0])
    )
    return ordinates @ -np.diff(rate)


def annual_loss(curve, ratios, hazard=HAZARD):
    return average_annual_loss(
        hazard, loss_steps(curve, ratios), 15, 0.9, lambda curve: 0.0
    )


def test_vulnerability_is_that_of_oq_vmtk():
    curve = arch()
    im = np.geomspace(0.05, 10.0, 50)
    states = curve.limit_states
    poes = np.stack([states[name](im) for name in RATIOS], axis=1)
    expected = loss_by_oq_vmtk(poes, np.array(list(RATIOS.values())))
    loss, lower, upper = vulnerability(loss_steps(curve, RATIOS), im)
    np.testing.assert_allclose(loss, expected, rtol=1e-6, atol=1e-12)
    assert ((lower <= loss) & (loss <= upper)).all()


def test_average_annual_loss_is_that_of_oq_vmtk():
    """On points of the curve and the hazard so dense that its sum is the integral."""
    curve = arch()
    at = np.geomspace(1e-3, 19.0, 60001)
    loss = vulnerability(loss_steps(curve, RATIOS), at)[0]
    expected = annual_loss_by_oq_vmtk((at, loss), (at, HAZARD.rate_at(at)))
    assert annual_loss(curve, RATIOS)["aal"] == pytest.approx(expected, rel=1e-6)


def test_a_collapse_that_costs_all_loses_as_often_as_it_happens():
    curve = arch()
    rate = collapse_rate(HAZARD, curve, curve.draws(15))
    found = annual_loss(arch(), {"collapse": 1})
    assert list(found.values()) == [rate.rate, rate.mean, rate.lower, rate.upper, False]


def test_closed_form_of_a_power_law():
    power = HazardCurve([0.01, 3.0], [1.0, (0.01 / 3.0) ** 2])
    curve = arch()
    rates = {
        k: 1e-4 * c.theta**-2 * np.exp(2 * c.beta**2)
        for k, c in curve.limit_states.items()
    }
    expected = (
        0.02 * rates["motion"] + 0.28 * rates["rotation"] + 0.7 * rates["collapse"]
    )
    found = annual_loss(curve, RATIOS, power)
    assert found["aal"] == pytest.approx(expected, rel=1e-9)
    assert found["aal_lower"] < found["aal"] < found["aal_mean"] < found["aal_upper"]


def test_states_that_cross_are_moved_as_in_exports():
    """Rotation as likely as collapse or more, so that no step takes a loss away."""
    (rotation, low), (collapse, high) = loss_steps(
        arch(0.85), {"rotation": 0.4, "collapse": 1.0}
    )
    assert (low, high) == (0.4, 0.6)
    im = np.geomspace(0.05, 5.0, 50)
    assert (collapse(im) - rotation(im)).max() <= 0.0101
    assert rotation.theta == collapse.theta == 0.8


@pytest.mark.parametrize(
    ("ratios", "error", "message"),
    [
        ({"rotation": 0.4}, InputError, "has no ratio of collapse"),
        ({"collapse": 1.5}, InputError, "collapse=1.5; a ratio lies from 0 to 1"),
        (
            {"collapse": float("nan")},
            InputError,
            "collapse=nan; a ratio lies from 0 to 1",
        ),
        (
            {"fall": 0.4, "collapse": 1},
            InputError,
            "names 'fall', which is no limit state here",
        ),
        (
            {"rotation": 0.4, "collapse": 0.3},
            InputError,
            "rotation=0.4 and collapse=0.3; collapse",
        ),
        (
            {"motion": 0.4, "rotation": 0.3, "collapse": 1},
            InputError,
            "rotation is severer",
        ),
        (
            {"impact": 0.4, "collapse": 1},
            FitError,
            "'impact' of the consequences has no curve: all",
        ),
    ],
)
def test_refusals(ratios, error, message):
    with pytest.raises(error, match=message):
        loss_steps(arch(), checked_ratios(ratios))
