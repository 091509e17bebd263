"""Limit states: answers that a study stores, and curves of two states that must not cross."""

import numpy as np
import pytest

from archfrag.fragility.verdicts import find_brackets
from archfrag.fragility.curve import mixture
from archfrag.fragility.limit_states import (
    MOST_CROSSING,
    above,
    answers_of_states,
    crossing,
    state_to_dict,
    told_order,
)
from archfrag.fragility.quoted import Answer, quoted_band
from tests.export.made import fragility


def test_answers_of_states_are_those_that_were_stored():
    levels = np.geomspace(0.1, 1.0, 6)
    found = quoted_band(find_brackets(np.arange(6) > np.arange(1, 5)[:, None], levels), levels)
    states = [
        {"name": "rotation", "meaning": "it turns", **state_to_dict(found)},
        {"name": "residual", "meaning": "", **state_to_dict(Answer("none does"))},
    ]
    answer = Answer(found.curve, more={"limit_states": {"message": "", "states": states}})
    again = answers_of_states(answer)
    assert list(again) == ["rotation", "residual"]
    own = again["rotation"]
    assert (own.curve, own.theta, own.beta, own.lower) == (
        found.curve, found.theta, found.beta, found.lower,
    )  # fmt: skip
    assert again["residual"].curve == "none does"
    assert answers_of_states(Answer("")) == {}


def test_curves_that_cross_are_told():
    mild, severe = ("rotation", fragility(1.0, 0.6)), ("collapse", fragility(1.1, 0.2))
    assert "those of rotation and collapse by up to 0.19" in told_order([mild, severe])
    assert told_order([severe]) == "The curves of the limit states do not cross."


class TestOrderOfTwo:
    """A milder state is nowhere less probable than a severer one, with the least change."""

    def test_crossing_is_measured(self):
        found = crossing(fragility(1.0, 0.6), fragility(1.1, 0.2))
        assert found == pytest.approx(0.1897, abs=1e-3)
        assert crossing(fragility(1.0, 0.4), fragility(1.5, 0.4)) < 1e-3

    @pytest.mark.parametrize(
        ("mild", "severe"),
        [((1.0, 0.4), (1.0, 0.5)), ((1.0, 0.6), (1.1, 0.2)), ((1.2, 0.4), (1.0, 0.4)),
         ((0.3, 0.2), (1.0, 0.9))],
    )  # fmt: skip
    def test_curves_that_cross_are_moved_as_far_as_needed(self, mild, severe):
        given, other = fragility(*mild), fragility(*severe)
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
        severe = mixture(parts[0], parts)
        assert crossing(above(fragility(1.5, 0.2), severe), severe) <= MOST_CROSSING
