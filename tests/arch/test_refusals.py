"""Geometry that cannot be is refused: parameter, value, what is allowed."""

import math
import re
import warnings

import numpy as np
import pytest

from archfrag.arch import Arch, Block
from archfrag.errors import GeometryError, InputError

NAN, INF = math.nan, math.inf


def circular(**change):
    given = {"radius": 10.0, "thickness": 1.5, "embrace": 157.5, "voussoirs": 7, "friction": 0.7}
    return Arch.circular(**{**given, **change})


def profile(name, **change):
    given = {"span": 10.0, "rise": 5.0, "thickness": 0.5, "voussoirs": 7, "friction": 0.7}
    return getattr(Arch, name)(**{**given, **change})


def block(**change):
    return Block(**{"width": 0.2, "height": 1.0, "friction": 0.8, **change})


def refusal(make, *args, **given):
    """The message: one line, raised without a warning before it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(GeometryError) as caught:
            make(*args, **given)
    message = str(caught.value)
    assert isinstance(caught.value, InputError)
    assert "\n" not in message
    return message


# Parameter, value, and what the message begins with; "must be" and what is allowed follow.
NUMBERS = [
    ("thickness", 0.0, "thickness = 0.0 m is impossible"),
    ("thickness", 20.0, "thickness = 20.0 m is impossible"),
    ("thickness", "1.5", "thickness = '1.5' is not numeric"),
    ("thickness", [1.5], "thickness = [1.5] is not a single number"),
    ("thickness", [[1.0], [1.0, 2.0]], "thickness has rows of unequal length"),
    ("thickness", 1e-9, "thickness = 1e-09 m is no size of a structure"),
    ("embrace", 360.0, "embrace = 360.0 degrees is impossible"),
    ("depth", -1.0, "depth = -1.0 m is impossible"),
    ("voussoirs", 1, "voussoirs = 1 makes no arch"),
    ("voussoirs", 6.5, "voussoirs = 6.5 is not an integer"),
    ("voussoirs", 2001, "voussoirs = 2001 is too many"),
    ("sector", "yes", "sector = 'yes' is not a choice"),
    ("friction", [0.7] * 7, "friction has shape (7,), not (8,)"),
    ("friction", [0.7] * 5 + [-0.2, 0.7, NAN], "friction = -0.2 at joint 5 is impossible"),
    ("dead_load", [0, 0, NAN, 0, 0, 0, 0], "dead_load = nan N at voussoir 2 is impossible"),
    ("dead_load", [1.0] * 8, "dead_load has shape (8,), not (7,)"),
    ("joints", [0, 30, 30, 90, 100, 120, 140, 157.5], "joints = ["),
    ("joints", [5, 30, 60, 90, 100, 120, 140, 157.5], "joints = [5, 30,"),
    (
        "joints",
        [0, 157.5],
        "joints = [0, 157.5] cannot be; it must be 8 numbers that",
    ),
    ("joints", [0, 30, NAN, 90, 100, 120, 140, 157.5], "joints = [0, 30, nan"),
]


class TestNumbers:
    @pytest.mark.parametrize(("key", "value", "start"), NUMBERS)
    def test_circular(self, key, value, start):
        message = refusal(circular, **{key: value})
        assert message.startswith(start)
        assert re.search("must be", message)

    def test_what_overflows(self):
        assert "voussoir 0 has a mass of inf kg" in refusal(circular, density=1e308)

    @pytest.mark.parametrize("name", ["segmental", "pointed", "elliptic", "catenary"])
    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("span", 0.0), ("rise", NAN), ("thickness", "3"), ("voussoirs", 1), ("depth", NAN),
            ("friction", -0.5), ("density", 0.0), ("dead_load", -3.0), ("joints", [0.0, 0.5]),
        ],
    )  # fmt: skip
    def test_every_profile_checks_its_numbers(self, name, key, value):
        message = refusal(profile, name, **{key: value})
        assert message.startswith(key)
        assert "it must be" in message

    @pytest.mark.parametrize(
        ("key", "value"),
        [("width", 0.0), ("height", None), ("density", "heavy"), ("friction", -1)],
    )
    def test_block(self, key, value):
        assert refusal(block, **{key: value}).startswith(f"{key} = ")


class TestProfiles:
    @pytest.mark.parametrize(
        ("name", "given", "allowed"),
        [
            ("segmental", {"rise": 5.1}, "at least 1e-05 m and at most 5 m (1e-6 x span and half"),
            ("pointed", {"rise": 4.9}, "at least 5 m (half the span)"),
            ("segmental", {"rise": 2.0, "thickness": 14.5}, "less than 14.5 m (2 x radius of the"),
        ],
    )
    def test_proportions(self, name, given, allowed):
        assert allowed in refusal(profile, name, **given)

    @pytest.mark.parametrize(
        ("name", "given", "joint"),
        [
            ("elliptic", {"rise": 8.0, "thickness": 7.0, "voussoirs": 21}, 10),
            ("catenary", {"rise": 8.0, "thickness": 6.0, "voussoirs": 21}, 10),
            ("pointed", {"rise": 9.0, "thickness": 6.0, "voussoirs": 12}, 5),
            ("pointed", {"rise": 9.0, "thickness": 6.0, "voussoirs": 13}, 6),
        ],
    )
    def test_joints_that_cross_inside_the_ring(self, name, given, joint):
        message = refusal(profile, name, **given)
        assert f"joints {joint} and {joint + 1} would cross inside the ring" in message
        limit = float(message.split()[-2])
        assert refusal(profile, name, **{**given, "thickness": 1.0001 * limit}).startswith("thick")
        arch = profile(name, **{**given, "thickness": 0.9999 * limit})
        assert arch.n_voussoir == given["voussoirs"]

    @pytest.mark.parametrize(("rise", "voussoirs"), [(9.0, 2), (5.0, 8)])
    def test_limit_of_a_pointed_arch_in_closed_form(self, rise, voussoirs):
        """The horizontal springings of two voussoirs meet at mid-span; a semicircle's at R."""
        given = {"rise": rise, "voussoirs": voussoirs}
        assert profile("pointed", thickness=9.999, **given).n_voussoir == voussoirs
        assert refusal(profile, "pointed", thickness=10.0, **given).endswith("less than 10 m")

    def test_joints_too_uneven_round_a_narrow_crown(self):
        given = {"rise": 60.0, "thickness": 1e-3, "voussoirs": 3}
        message = refusal(profile, "catenary", joints=[0.0, 0.3, 0.6, 1.0], **given)
        assert message.startswith("joints 1 and 2 of this catenary of span 10.0 m")
        assert profile("catenary", **given).n_voussoir == 3

    def test_limit_of_fine_voussoirs_is_the_least_radius_of_curvature(self):
        """b²/a at the springings of a flat ellipse, a²/b at the crown of a tall one."""
        for rise, radius in ((2.0, 0.8), (8.0, 3.125)):
            given = {"rise": rise, "thickness": 9.0, "voussoirs": 1998 + (rise > 5)}
            limit = float(refusal(profile, "elliptic", **given).split()[-2])
            assert limit == pytest.approx(2.0 * radius, rel=2e-3)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
ABOVE = SQUARE + np.array([0.0, 1.0])


def moved(table, row, to):
    table = table.copy()
    table[row] = to
    return table


def ring_of(angles):
    across = np.column_stack([np.sin(np.radians(angles)), np.cos(np.radians(angles))])
    return 9.0 * across, 11.0 * across


# Intrados, extrados, and what the message begins with.
RINGS = [
    (SQUARE, moved(ABOVE, 1, [1.0, 0.0]), "joint 1 has no length"),
    (moved(SQUARE, 1, [0.0, 0.0]), ABOVE, "the intrados corners of joints 0 and 1 coincide"),
    (SQUARE, moved(ABOVE, 2, [3.0, 1.0]), "the extrados corners of joints 2 and 3 coincide"),
    (SQUARE, moved(ABOVE, 1, [2.5, 1.0]), "voussoir 1 is no convex quadrilateral: its"),
    (
        moved(SQUARE, 3, [3.0, 1.0]), moved(ABOVE, 3, [3.0, 0.0]),
        "voussoir 2 is no convex quadrilateral",
    ),
    (SQUARE, moved(ABOVE, 1, [1.8, 0.1]), "voussoir 1 is no convex quadrilateral"),
    (
        SQUARE, moved(moved(ABOVE, 1, [1.2, 0.0]), 0, [-0.2, 0.0]),
        "voussoir 0 is no convex quadrilateral",
    ),
    (
        moved(SQUARE, 2, [0.5, -0.5]), moved(ABOVE, 2, [0.5, 1.5]),
        "voussoir 1 lies on the same side of joint 1 as voussoir 0",
    ),
    (*ring_of(np.linspace(-200.0, 200.0, 12)), "voussoirs 0 and 9 overlap by "),
]  # fmt: skip
TABLES = [
    (SQUARE[:2], ABOVE[:2], {}, "intrados has shape (2, 2)"),
    (SQUARE, ABOVE[:3], {}, "intrados has 4 points and extrados 3"),
    (SQUARE.T, ABOVE, {}, "intrados has shape (2, 4)"),
    (SQUARE, moved(ABOVE, 2, [NAN, 1.0]), {}, "extrados[2] = (nan, 1.0) is not finite or beyond"),
    (SQUARE, ABOVE, {"free_end": 1}, "free_end = 1 is not a choice"),
    (SQUARE, ABOVE, {"free_end": True, "friction": [0.7] * 4}, "friction has shape (4,), not (3,"),
]


class TestFromJoints:
    @pytest.mark.parametrize(("intrados", "extrados", "start"), RINGS)
    def test_rings_that_cannot_be(self, intrados, extrados, start):
        assert refusal(Arch.from_joints, intrados, extrados, 0.7).startswith(start)

    @pytest.mark.parametrize(("intrados", "extrados", "more", "start"), TABLES)
    def test_tables(self, intrados, extrados, more, start):
        given = {"friction": 0.7, **more}
        assert refusal(Arch.from_joints, intrados, extrados, **given).startswith(start)

    def test_a_ring_that_closes_on_itself_or_lies_near_itself_may_be(self):
        intrados, extrados = ring_of(np.linspace(-180.0, 180.0, 13))
        assert Arch.from_joints(intrados, extrados, 0.7).n_voussoir == 12
        angles = np.linspace(0.0, 700.0, 71)
        spiral = [(1.0 + angles / 1000.0)[:, None] * side for side in ring_of(angles)]
        assert Arch.from_joints(*spiral, 0.7).n_voussoir == 70


@pytest.mark.parametrize(
    "change",
    [
        {"thickness": 19.9}, {"embrace": 359.9}, {"voussoirs": np.int64(7)}, {"friction": 0.0},
        {"radius": np.float32(10.0)}, {"friction": INF}, {"dead_load": 0},
        {"joints": np.linspace(0.0, 157.5, 8)},
    ],
)  # fmt: skip
def test_just_inside_the_bounds_is_no_error(change):
    for sector in (True, False):
        assert circular(sector=sector, **change).n_voussoir == 7
