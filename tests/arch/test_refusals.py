"""Geometry that cannot be is refused: parameter, value, what is allowed."""

import math
import warnings

import numpy as np
import pytest

from archfrag.arch import Arch
from archfrag.errors import GeometryError

NAN = math.nan


def circular(**change):
    given = {
        "radius": 10.0,
        "thickness": 1.5,
        "embrace": 157.5,
        "voussoirs": 7,
        "friction": 0.7,
    }
    return Arch.circular(**{**given, **change})


def profile(name, **change):
    given = {
        "span": 10.0,
        "rise": 5.0,
        "thickness": 0.5,
        "voussoirs": 7,
        "friction": 0.7,
    }
    return getattr(Arch, name)(**{**given, **change})


def refusal(make, *args, **given):
    """The message, raised without a warning before it."""
    with (
        warnings.catch_warnings(action="error"),
        pytest.raises(GeometryError) as caught,
    ):
        make(*args, **given)
    return str(caught.value)


# Parameter, value, and what the message begins with; "must be" and what is allowed follow.
NUMBERS = [
    ("thickness", 0.0, "thickness = 0.0"),
    ("thickness", "1.5", "thickness = '1.5'"),
    ("thickness", [[1.0], [1.0, 2.0]], "thickness = [[1.0], [1.0, 2.0]]"),
    ("thickness", 1e-9, "thickness = 1e-09"),
    ("embrace", 360.0, "embrace = 360.0"),
    ("depth", -1.0, "depth = -1.0"),
    ("voussoirs", 6.5, "voussoirs = 6.5"),
    ("voussoirs", 2001, "voussoirs = 2001"),
    ("sector", "yes", "sector = 'yes'"),
    ("friction", [0.7] * 7, "friction of shape (7,)"),
    ("friction", [0.7] * 5 + [-0.2, 0.7, NAN], "friction[5] = -0.2"),
    ("dead_load", [0, 0, NAN, 0, 0, 0, 0], "dead_load[2] = nan"),
    ("dead_load", [1.0] * 8, "dead_load of shape (8,)"),
    (
        "joint_positions",
        [0, 30, 30, 90, 100, 120, 140, 157.5],
        "joint_positions[2] = 30.0",
    ),
]


@pytest.mark.parametrize(("key", "value", "start"), NUMBERS)
def test_numbers_of_a_circular_arch(key, value, start):
    message = refusal(circular, **{key: value})
    assert message.startswith(f"{start} is impossible; it must be ")


@pytest.mark.parametrize("name", ["segmental", "pointed", "elliptic", "catenary"])
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("span", 0.0),
        ("rise", NAN),
        ("thickness", "3"),
        ("voussoirs", 1),
        ("depth", NAN),
        ("friction", -0.5),
        ("density", 0.0),
        ("dead_load", -3.0),
        ("joint_positions", [0.0, 0.5]),
    ],
)
def test_every_profile_checks_its_numbers(name, key, value):
    assert refusal(profile, name, **{key: value}).startswith(key)


def test_proportions_and_what_overflows():
    assert "at most 5 m" in refusal(profile, "segmental", rise=5.1)
    assert "at least 5 m" in refusal(profile, "pointed", rise=4.9)
    assert "less than 14.5 m" in refusal(profile, "segmental", rise=2.0, thickness=14.5)
    tiny = {"intrados": 1e-90 * SQUARE, "extrados": 1e-90 * ABOVE}
    assert "and an inertia of 0 kg m2; both must be finite" in refusal(
        Arch.from_joints, **tiny, friction=0.7
    )


@pytest.mark.parametrize(
    ("name", "rise", "thickness", "voussoirs"),
    [
        ("elliptic", 8.0, 7.0, 21),
        ("catenary", 8.0, 6.0, 21),
        ("pointed", 9.0, 6.0, 12),
        ("pointed", 9.0, 40.0, 13),
    ],
)
def test_joints_that_cross_inside_the_ring(name, rise, thickness, voussoirs):
    given = {"rise": rise, "thickness": thickness, "voussoirs": voussoirs}
    assert "must neither cross nor touch inside the ring" in refusal(
        profile, name, **given
    )


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
ABOVE = SQUARE + np.array([0.0, 1.0])


def moved(table, row, to):
    table = table.copy()
    table[row] = to
    return table


def ring_of(angles):
    across = np.column_stack([np.sin(np.radians(angles)), np.cos(np.radians(angles))])
    return 9.0 * across, 11.0 * across


@pytest.mark.parametrize(
    ("intrados", "extrados", "more", "start"),
    [
        (
            SQUARE,
            moved(ABOVE, 1, [1.0, 0.0]),
            {},
            "voussoir 0 is no convex quadrilateral: its",
        ),
        (
            moved(SQUARE, 1, [0.0, 0.0]),
            ABOVE,
            {},
            "voussoir 0 is no convex quadrilateral: its",
        ),
        (
            SQUARE,
            moved(ABOVE, 1, [2.5, 1.0]),
            {},
            "voussoir 1 is no convex quadrilateral: its",
        ),
        (
            moved(SQUARE, 2, [0.5, -0.5]),
            moved(ABOVE, 2, [0.5, 1.5]),
            {},
            "voussoir 1 lies on the same side of joint 1 as voussoir 0",
        ),
        (*ring_of(np.linspace(-200.0, 200.0, 12)), {}, "voussoirs 0 and 9 overlap by "),
        (SQUARE[:2], ABOVE[:2], {}, "intrados of shape (2, 2) is impossible"),
        (SQUARE, ABOVE[:3], {}, "intrados has 4 points and extrados 3"),
        (SQUARE, moved(ABOVE, 2, [NAN, 1.0]), {}, "extrados[2, 0] = nan is impossible"),
        (SQUARE, ABOVE, {"free_end": 1}, "free_end = 1 is impossible"),
        (
            SQUARE,
            ABOVE,
            {"free_end": True, "friction": [0.7] * 4},
            "friction of shape (4,) is ",
        ),
    ],
)
def test_joints_that_cannot_be(intrados, extrados, more, start):
    given = {"friction": 0.7, **more}
    assert refusal(Arch.from_joints, intrados, extrados, **given).startswith(start)


def test_a_ring_that_closes_on_itself_or_lies_near_itself_may_be():
    assert (
        Arch.from_joints(*ring_of(np.linspace(-180.0, 180.0, 13)), 0.7).n_voussoir == 12
    )
    angles = np.linspace(0.0, 700.0, 71)
    spiral = [(1.0 + angles / 1000.0)[:, None] * side for side in ring_of(angles)]
    assert Arch.from_joints(*spiral, 0.7).n_voussoir == 70
