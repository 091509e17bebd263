"""What may be exported, and names and units in the receivers."""

import pytest

from archfrag.errors import FitError, InputError
from archfrag.export.curve_set import CurveSet
from archfrag.export.receivers import in_core_measure, openquake_measure, pelicun_measure
from tests.export.made import MADE, curve_set, fragility


def make(**states):
    return CurveSet({"ring": states}, "PGA", (1.0, 8.0), MADE)


class TestCurveSet:
    @pytest.mark.parametrize(
        ("curves", "message"),
        [
            ({}, "there is no arch"),
            ({"ring": {}}, "there is no limit state"),
            ({"ring": {"no blank": fragility(1, 1)}}, "limit state 'no blank': a name has"),
            (
                {"ring": {"a": "none", "b": "none"}, "wall": {"b": "none", "a": "none"}},
                "arch 'wall' has the limit states b, a, not a, b",
            ),
        ],
    )
    def test_refused(self, curves, message):
        with pytest.raises(InputError, match=message):
            CurveSet(curves, "PGA", (1.0, 8.0), MADE)

    def test_states_out_of_order_are_refused(self):
        with pytest.raises(InputError, match="'mild' has a lower median than 'severe'"):
            make(severe=fragility(2.0, 0.3), none="no curve", mild=fragility(1.0, 0.3))

    def test_an_arch_without_a_curve_is_left_out_with_its_message(self):
        curves = curve_set(tower=dict.fromkeys(("rocking", "damage", "collapse"), "it stood"))
        assert list(curves.complete) == ["ring-7", "wall+2"]
        assert curves.left_out == {
            "tower": "rocking: it stood; damage: it stood; collapse: it stood"
        }
        with pytest.raises(FitError, match="no curve to export for X: ring: a: it stood"):
            make(a="it stood").require_curves("X")

    def test_curves_that_cross_are_named(self):
        assert curve_set().cautions == []
        (caution,) = make(a=fragility(1.0, 0.6), b=fragility(1.1, 0.2)).cautions
        assert "arch 'ring': the curve of 'b' lies above that of 'a'" in caution


class TestReceivers:
    @pytest.mark.parametrize(
        ("measure", "name", "unit", "si"),
        [
            ("PGA", "PGA", "g", 9.80665),
            ("SA(0.50)", "SA(0.5)", "g", 9.80665),
            ("AvgSA(0.2,1)", "AvgSA", "g", 9.80665),
            ("PGV", "PGV", "cm/s", 0.01),
            ("PGD", "PGD", "cm", 0.01),
            ("FIV3(0.7)", "FIV3(0.7)", "cm/s", 0.01),
            ("CAV", "CAV", "g s", 9.80665),
            ("Arias", "IA", "m/s", 1.0),
        ],
    )
    def test_openquake(self, measure, name, unit, si):
        named = openquake_measure(measure)
        assert named[:2] == (name, unit)
        assert named.factor * si == pytest.approx(1.0, rel=1e-15)

    def test_what_a_receiver_has_no_name_for_is_one_message(self):
        for ask, measure in (
            (openquake_measure, "HI"), (pelicun_measure, "AvgSA(0.2,1)"), (in_core_measure, "CAV"),
        ):  # fmt: skip
            with pytest.raises(InputError, match="has no name for the intensity measure"):
                ask(measure)
        with pytest.raises(InputError, match="its PGD is permanent ground deformation"):
            pelicun_measure("PGD")

    def test_notes_state_what_the_measure_must_be(self):
        assert "RotD50 of two horizontal" in openquake_measure("RotD50(Sa(0.5))").note
        assert "from 0.2 to 1 s" in openquake_measure("AvgSA(0.2,1)").note
        assert openquake_measure("PGA").note == ""
