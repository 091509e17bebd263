"""Limit states that a study stores, and curves of two states that must not cross."""

from dataclasses import replace

import numpy as np
import pytest

from archfrag.fragility.curve import Curve
from archfrag.fragility.quoted import quoted_band
from archfrag.fragility.risk import mean_of
from archfrag.fragility.several import (
    MOST_CROSSING,
    above,
    crossing,
    crossing_words,
)
from archfrag.fragility.verdicts import find_brackets
from tests.export.made import fragility

LEVELS = np.geomspace(0.1, 1.0, 6)


@pytest.fixture
def curve():
    return quoted_band(
        find_brackets(np.arange(6) > np.arange(1, 5)[:, None], LEVELS), LEVELS
    )


def test_limit_states_are_those_that_were_stored(curve):
    states = (
        replace(curve, state="rotation", meaning="it turns"),
        Curve(reason="none does", state="residual"),
    )
    answer = replace(curve, states=states, crossings="none")
    answer = Curve.from_dict(answer.to_dict(), "ring")
    own, without = answer.states
    assert own.to_dict() == curve.to_dict()
    assert {answer.name, own.name, without.name} == {"ring"}
    assert (own.state, own.meaning, without.reason) == (
        "rotation",
        "it turns",
        "none does",
    )
    assert list(answer.limit_states) == ["rotation", "collapse"]


def test_a_curve_says_the_same_in_another_unit(curve):
    whole = replace(
        curve,
        states=(replace(curve, state="rotation"),),
        n_undecided=2,
        extremes=(curve, Curve(reason="x")),
    )
    in_g = whole.in_unit(9.80665, "PGA", "g")
    im = LEVELS / 9.80665
    assert in_g(im) == pytest.approx(curve(LEVELS), rel=1e-12)
    assert in_g.quantile(0.1) * 9.80665 == pytest.approx(curve.quantile(0.1))
    for one, other in ((in_g, curve), (in_g.limit_states["rotation"], curve)):
        assert np.array(one.band(im)) == pytest.approx(
            np.array(other.band(LEVELS)), rel=1e-9
        )
        assert np.array(one.theta_interval) * 9.80665 == pytest.approx(
            other.theta_interval
        )
    assert (
        f"the median is {curve.theta / 9.80665:.4g} g if all collapse, not known"
        in repr(in_g)
    )


def test_curves_that_cross_are_told():
    mild = fragility(1.0, 0.6)
    severe = fragility(1.1, 0.2)
    words = crossing_words([replace(mild, state="rotation"), severe])
    assert "those of rotation and collapse by up to 0.19" in words
    assert crossing_words([severe]) == "The curves of the limit states do not cross."


class TestOrderOfTwo:
    """A milder state is nowhere less probable than a severer one, with the least change."""

    def test_crossing_is_measured(self):
        found = crossing(fragility(1.0, 0.6), fragility(1.1, 0.2))
        assert found == pytest.approx(0.1897, abs=1e-3)
        assert crossing(fragility(1.0, 0.4), fragility(1.5, 0.4)) < 1e-3

    @pytest.mark.parametrize(
        ("mild", "severe"),
        [
            ((1.0, 0.4), (1.0, 0.5)),
            ((1.0, 0.6), (1.1, 0.2)),
            ((1.2, 0.4), (1.0, 0.4)),
            ((0.3, 0.2), (1.0, 0.9)),
        ],
    )
    def test_curves_that_cross_are_moved_as_far_as_needed(self, mild, severe):
        given = fragility(*mild)
        other = fragility(*severe)
        found = above(given, other)
        assert crossing(given, other) > MOST_CROSSING >= crossing(found, other)
        assert found.theta == min(given.theta, other.theta)
        assert min(mild[1], severe[1]) <= found.beta <= max(mild[1], severe[1])
        if mild[1] != severe[1]:  # not farther than needed
            assert crossing(found, other) > 0.9 * MOST_CROSSING

    def test_curves_that_do_not_cross_stay(self):
        given = fragility(1.0, 0.4)
        assert above(given, fragility(1.5, 0.41)) is given

    def test_below_a_class_of_unlike_arches(self):
        parts = [fragility(theta, 0.1) for theta in (0.5, 2.0)]
        severe = mean_of(parts[0], np.vstack([fit.parts for fit in parts]), "mixture")
        assert crossing(above(fragility(1.5, 0.2), severe), severe) <= MOST_CROSSING
