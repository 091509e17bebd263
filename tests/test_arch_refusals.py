"""Geometry that cannot be is refused in one sentence: parameter, value, what is allowed."""

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
    """The sentence, once it is known to be one, raised without a warning before it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(GeometryError) as caught:
            make(*args, **given)
    sentence = str(caught.value)
    assert isinstance(caught.value, InputError)
    assert "\n" not in sentence
    assert not sentence.endswith(".")
    assert ". " not in sentence
    return sentence


POSITIVE = "it must be a finite number greater than 0"
THICK = f"{POSITIVE} m and less than 20 m (2 x radius)"
TURN = f"{POSITIVE} degrees and less than 360 degrees"
SIZE = "it must be between 1e-06 m and 1e+06 m"
WHOLE = "it must be a whole number of at least 2 (a single body is a Block)"
FRICTION = (
    "it must be one number or one for each of the 8 joints, all at least 0 (inf: the limit of "
    "large friction)"
)
LOAD = "it must be one number or one for each of the 7 voussoirs, all at least 0 N and finite"
ANGLES = (
    "must be 8 numbers that increase from 0 at the left springing to 157.5 degrees at the right "
    "one"
)
NUMBERS = [
    ("thickness", 0.0, f"thickness = 0.0 m is impossible; {THICK}"),
    ("thickness", -1.5, f"thickness = -1.5 m is impossible; {THICK}"),
    ("thickness", 20.0, f"thickness = 20.0 m is impossible; {THICK}"),
    ("thickness", NAN, f"thickness = nan m is impossible; {THICK}"),
    ("thickness", "1.5", f"thickness = '1.5' is not numeric; {THICK}"),
    ("thickness", 1.5j, f"thickness = 1.5j is not numeric; {THICK}"),
    ("thickness", [1.5], f"thickness = [1.5] is not a single number; {THICK}"),
    ("thickness", [[1.0], [1.0, 2.0]], f"thickness has rows of unequal length; {THICK}"),
    ("thickness", 1e-9, f"thickness = 1e-09 m is no size of a structure; {SIZE}"),
    ("radius", 0.0, f"radius = 0.0 m is impossible; {POSITIVE} m"),
    ("radius", -INF, f"radius = -inf m is impossible; {POSITIVE} m"),
    ("radius", 1e300, f"radius = 1e+300 m is no size of a structure; {SIZE}"),
    ("radius", True, f"radius = True is not numeric; {POSITIVE} m"),
    ("radius", None, f"radius = None is not numeric; {POSITIVE} m"),
    ("embrace", 0.0, f"embrace = 0.0 degrees is impossible; {TURN}"),
    ("embrace", -10, f"embrace = -10.0 degrees is impossible; {TURN}"),
    ("embrace", 360.0, f"embrace = 360.0 degrees is impossible; {TURN}"),
    ("embrace", INF, f"embrace = inf degrees is impossible; {TURN}"),
    ("density", 0.0, f"density = 0.0 kg/m3 is impossible; {POSITIVE} kg/m3"),
    ("density", NAN, f"density = nan kg/m3 is impossible; {POSITIVE} kg/m3"),
    ("depth", -1.0, f"depth = -1.0 m is impossible; {POSITIVE} m"),
    ("voussoirs", 1, f"voussoirs = 1 makes no arch; {WHOLE}"),
    ("voussoirs", 0, f"voussoirs = 0 makes no arch; {WHOLE}"),
    ("voussoirs", -7, f"voussoirs = -7 makes no arch; {WHOLE}"),
    ("voussoirs", 6.5, f"voussoirs = 6.5 is not a whole number; {WHOLE}"),
    ("voussoirs", NAN, f"voussoirs = nan is not a whole number; {WHOLE}"),
    ("voussoirs", INF, f"voussoirs = inf is not a whole number; {WHOLE}"),
    ("voussoirs", [7], f"voussoirs = [7] is not a whole number; {WHOLE}"),
    ("voussoirs", "seven", f"voussoirs = 'seven' is not numeric; {WHOLE}"),
    ("voussoirs", True, f"voussoirs = True is not numeric; {WHOLE}"),
    ("sector", "yes", "sector = 'yes' is not a choice; it must be True or False"),
    ("friction", -0.1, f"friction = -0.1 is impossible; {FRICTION}"),
    ("friction", NAN, f"friction = nan is impossible; {FRICTION}"),
    ("friction", -INF, f"friction = -inf is impossible; {FRICTION}"),
    ("friction", "inf", f"friction = 'inf' is not numeric; {FRICTION}"),
    ("friction", [0.7] * 7, f"friction has shape (7,), not (8,); {FRICTION}"),
    (
        "friction",
        [0.7, 0.7, 0.7, 0.7, 0.7, -0.2, 0.7, NAN],
        f"friction = -0.2 at joint 5 is impossible; {FRICTION}",
    ),
    ("dead_load", -1.0, f"dead_load = -1.0 N is impossible; {LOAD}"),
    ("dead_load", INF, f"dead_load = inf N is impossible; {LOAD}"),
    (
        "dead_load",
        [0, 0, NAN, 0, 0, 0, 0],
        f"dead_load = nan N at voussoir 2 is impossible; {LOAD}",
    ),
    ("dead_load", [1.0] * 8, f"dead_load has shape (8,), not (7,); {LOAD}"),
    (
        "joints",
        [0, 30, 20, 90, 100, 120, 140, 157.5],
        f"joints[2] = 20 does not exceed the one before it (30); they {ANGLES}",
    ),
    (
        "joints",
        [0, 30, 30, 90, 100, 120, 140, 157.5],
        f"joints[2] = 30 does not exceed the one before it (30); they {ANGLES}",
    ),
    ("joints", [0, 30, 60, 90, 100, 120, 140, 150], f"joints run from 0 to 150; they {ANGLES}"),
    (
        "joints",
        [5, 30, 60, 90, 100, 120, 140, 157.5],
        f"joints run from 5 to 157.5; they {ANGLES}",
    ),
    ("joints", [0, 157.5], f"joints has shape (2,) with voussoirs = 7; it {ANGLES}"),
    (
        "joints",
        [0, 30, NAN, 90, 100, 120, 140, 157.5],
        f"joints[2] = nan is not finite; it {ANGLES}",
    ),
    (
        "joints",
        ["a"] * 8,
        f"joints = ['a', 'a', 'a', 'a', 'a', 'a', ...] is not numeric; it {ANGLES}",
    ),
]


class TestNumbers:
    @pytest.mark.parametrize(("key", "value", "sentence"), NUMBERS)
    def test_circular(self, key, value, sentence):
        assert refusal(circular, **{key: value}) == sentence

    def test_what_overflows(self):
        assert refusal(circular, density=1e308) == (
            "voussoir 0 has a mass of inf kg and an inertia of nan kg m2; both must be finite and "
            "greater than 0, so look again at its size, density, depth and dead_load"
        )

    @pytest.mark.parametrize("name", ["segmental", "pointed", "elliptic", "catenary"])
    @pytest.mark.parametrize(
        ("key", "value"),
        [
            (key, value)
            for key in ("span", "rise", "thickness")
            for value in (0.0, -1.0, NAN, INF, "3", None, False)
        ]
        + [("voussoirs", 1), ("friction", -0.5), ("density", 0.0), ("depth", NAN)]
        + [("dead_load", -3.0), ("joints", [0.0, 0.5]), ("voussoirs", 2.5)],
    )
    def test_every_profile_checks_its_numbers(self, name, key, value):
        sentence = refusal(profile, name, **{key: value})
        assert sentence.startswith(key)
        assert "it must be" in sentence
        if not isinstance(value, list):
            assert re.search(re.escape(f"{key} = {value!r}"), sentence) or f"{value}" in sentence

    @pytest.mark.parametrize(
        ("key", "value", "sentence"),
        [
            ("width", 0.0, f"width = 0.0 m is impossible; {POSITIVE} m"),
            ("height", NAN, f"height = nan m is impossible; {POSITIVE} m"),
            ("density", "heavy", f"density = 'heavy' is not numeric; {POSITIVE} kg/m3"),
            ("depth", 0, f"depth = 0.0 m is impossible; {POSITIVE} m"),
            (
                "friction",
                -1,
                "friction = -1.0 is impossible; it must be one number or one for each of the 1 "
                "joints, all at least 0 (inf: the limit of large friction)",
            ),
        ],
    )
    def test_block(self, key, value, sentence):
        assert refusal(block, **{key: value}) == sentence


class TestProfiles:
    def test_segmental_is_at_most_a_semicircle(self):
        assert refusal(profile, "segmental", rise=5.1) == (
            "rise = 5.1 m is impossible; it must be a finite number at least 1e-05 m and at most "
            "5 m (1e-6 x span and half the span)"
        )

    def test_pointed_is_at_least_a_semicircle(self):
        assert refusal(profile, "pointed", rise=4.9) == (
            "rise = 4.9 m is impossible; it must be a finite number at least 5 m (half the span)"
        )

    def test_segmental_thickness_below_twice_its_radius(self):
        assert refusal(profile, "segmental", rise=2.0, thickness=14.5) == (
            "thickness = 14.5 m is impossible; it must be a finite number greater than 0 m and "
            "less than 14.5 m (2 x radius of the centre line)"
        )

    def test_too_flat_for_its_own_rounding(self):
        assert refusal(profile, "catenary", rise=1e-6).startswith(
            "rise = 1e-06 m is impossible; it must be a finite number at least 1e-05 m"
        )

    @pytest.mark.parametrize(
        ("name", "given", "joint"),
        [
            ("elliptic", {"rise": 2.0, "thickness": 3.0, "voussoirs": 12}, 0),
            ("elliptic", {"rise": 8.0, "thickness": 7.0, "voussoirs": 21}, 10),
            ("catenary", {"rise": 8.0, "thickness": 6.0, "voussoirs": 21}, 10),
            ("pointed", {"rise": 9.0, "thickness": 6.0, "voussoirs": 12}, 5),
            ("pointed", {"rise": 9.0, "thickness": 6.0, "voussoirs": 13}, 6),
        ],
    )
    def test_joints_that_cross_inside_the_ring(self, name, given, joint):
        sentence = refusal(profile, name, **given)
        word = {"elliptic": "ellipse", "catenary": "catenary", "pointed": "pointed arch"}[name]
        start = (
            f"thickness = {given['thickness']} m is impossible for this {word} of span 10.0 m and "
            f"rise {given['rise']} m: joints {joint} and {joint + 1} would cross inside the ring; "
            "it must be less than "
        )
        assert sentence.startswith(start)
        limit = float(sentence.removeprefix(start).removesuffix(" m"))
        assert refusal(profile, name, **{**given, "thickness": 1.0001 * limit}).startswith("thick")
        arch = profile(name, **{**given, "thickness": 0.9999 * limit})
        assert arch.n_voussoir == given["voussoirs"]

    def test_limit_of_a_pointed_arch_in_closed_form(self):
        """The horizontal springings of two voussoirs meet at mid-span; a semicircle's at R."""
        for rise, voussoirs in ((9.0, 2), (5.0, 8), (5.0, 7)):
            given = {"rise": rise, "voussoirs": voussoirs}
            assert profile("pointed", thickness=9.999, **given).n_voussoir == voussoirs
            sentence = refusal(profile, "pointed", thickness=10.0, **given)
            assert sentence.endswith("would cross inside the ring; it must be less than 10 m")

    @pytest.mark.parametrize(
        ("joints", "pair"),
        [
            ([0.0, 0.45, 0.8, 1.0], (1, 2)),
            ([0.0, 0.2, 0.55, 1.0], (1, 2)),
            ([0.0, 0.2, 0.5, 0.55, 1.0], (2, 3)),
        ],
    )
    def test_tightest_joints_of_a_pointed_arch(self, joints, pair):
        given = {"rise": 9.0, "thickness": 6.0, "voussoirs": len(joints) - 1, "joints": joints}
        sentence = refusal(profile, "pointed", **given)
        assert f"joints {pair[0]} and {pair[1]} would cross" in sentence

    def test_joints_too_uneven_round_a_narrow_crown(self):
        joints = [0.0, 0.3, 0.6, 1.0]
        given = {"rise": 60.0, "thickness": 1e-3, "voussoirs": 3}
        assert refusal(profile, "catenary", joints=joints, **given) == (
            "joints 1 and 2 of this catenary of span 10.0 m and rise 60.0 m stand too unevenly "
            "round its crown for a straight-sided voussoir between them; there must be a joint "
            "nearer to the crown, or equal voussoirs"
        )
        assert profile("catenary", **given).n_voussoir == 3

    def test_limit_of_fine_voussoirs_is_the_least_radius_of_curvature(self):
        """b²/a at the springings of a flat ellipse, a²/b at the crown of a tall one."""
        for rise, radius in ((2.0, 0.8), (8.0, 3.125)):
            sentence = refusal(
                profile, "elliptic", rise=rise, thickness=9.0, voussoirs=1998 + (rise > 5)
            )
            limit = float(sentence.split()[-2])
            assert limit == pytest.approx(2.0 * radius, rel=2e-3)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
ABOVE = SQUARE + np.array([0.0, 1.0])
APART = "they must be more than 3.16e-09 m apart"
CONVEX = "must be those of a convex quadrilateral in this order"
TABLE = (
    "it must be an (n, 2) table of finite coordinates in metres with n at least 3 (an arch has 2 "
    "voussoirs or more)"
)


def moved(table, row, to):
    table = table.copy()
    table[row] = to
    return table


def ring_of(angles):
    across = np.column_stack([np.sin(np.radians(angles)), np.cos(np.radians(angles))])
    return 9.0 * across, 11.0 * across


RINGS = {
    "joint of no length": (
        SQUARE,
        moved(ABOVE, 1, [1.0, 0.0]),
        f"joint 1 has no length: its intrados and extrados corners coincide at (1, 0); {APART}",
    ),
    "shared intrados corner": (
        moved(SQUARE, 1, [0.0, 0.0]),
        ABOVE,
        f"the intrados corners of joints 0 and 1 coincide at (0, 0); {APART}",
    ),
    "shared extrados corner": (
        SQUARE,
        moved(ABOVE, 2, [3.0, 1.0]),
        f"the extrados corners of joints 2 and 3 coincide at (3, 1); {APART}",
    ),
    "joints cross": (
        SQUARE,
        moved(ABOVE, 1, [2.5, 1.0]),
        "voussoir 1 cannot be: joints 1 and 2 cross inside the ring; its corners (1, 0), (2, 0), "
        f"(2, 1), (2.5, 1) {CONVEX}",
    ),
    "sides cross": (
        moved(SQUARE, 3, [3.0, 1.0]),
        moved(ABOVE, 3, [3.0, 0.0]),
        "voussoir 2 intersects itself: its intrados and extrados cross between joints 2 and 3; "
        f"its corners (2, 0), (3, 1), (3, 0), (2, 1) {CONVEX}",
    ),
    "folded": (
        SQUARE,
        moved(ABOVE, 1, [1.8, 0.1]),
        "voussoir 1 is folded: a corner of one of joints 1 and 2 lies beyond or on the line of "
        f"the other; its corners (1, 0), (2, 0), (2, 1), (1.8, 0.1) {CONVEX}",
    ),
    "flat": (
        SQUARE,
        moved(moved(ABOVE, 1, [1.2, 0.0]), 0, [-0.2, 0.0]),
        "voussoir 0 has no area: its corners lie on one line; its corners (0, 0), (1, 0), "
        f"(1.2, 0), (-0.2, 0) {CONVEX}",
    ),
    "doubles back": (
        moved(SQUARE, 2, [0.5, -0.5]),
        moved(ABOVE, 2, [0.5, 1.5]),
        "voussoir 1 lies on the same side of joint 1 as voussoir 0: the ring doubles back there; "
        "intrados and extrados must run on along the ring from joint to joint",
    ),
}
TABLES = [
    (SQUARE[:2], ABOVE[:2], {}, f"intrados has shape (2, 2); {TABLE}"),
    (
        SQUARE[:1],
        ABOVE[:1],
        {"free_end": True},
        "intrados has shape (1, 2); it must be an (n, 2) table of finite coordinates in metres "
        "with n at least 2 (a chain has 1 voussoir or more)",
    ),
    (SQUARE, ABOVE[:3], {}, "intrados has 4 points and extrados 3; they must be as many"),
    (SQUARE.T, ABOVE, {}, f"intrados has shape (2, 4); {TABLE}"),
    (
        SQUARE,
        moved(ABOVE, 2, [NAN, 1.0]),
        {},
        f"extrados[2] = (nan, 1.0) is not finite or beyond 1e+06 m; {TABLE}",
    ),
    (
        moved(SQUARE, 0, [-INF, 0.0]),
        ABOVE,
        {},
        f"intrados[0] = (-inf, 0.0) is not finite or beyond 1e+06 m; {TABLE}",
    ),
    ([[0, 0], [1]], ABOVE, {}, f"intrados has rows of unequal length; {TABLE}"),
    ("joints.csv", ABOVE, {}, f"intrados = 'joints.csv' is not numeric; {TABLE}"),
    (SQUARE, ABOVE, {"free_end": 1}, "free_end = 1 is not a choice; it must be True or False"),
    (
        SQUARE,
        ABOVE,
        {"free_end": True, "friction": [0.7] * 4},
        "friction has shape (4,), not (3,); it must be one number or one for each of the 3 "
        "joints, all at least 0 (inf: the limit of large friction)",
    ),
]


class TestFromJoints:
    @pytest.mark.parametrize(("intrados", "extrados", "sentence"), RINGS.values(), ids=RINGS)
    def test_rings_that_cannot_be(self, intrados, extrados, sentence):
        assert refusal(Arch.from_joints, intrados, extrados, 0.7) == sentence

    def test_a_ring_that_overlaps_itself(self):
        intrados, extrados = ring_of(np.linspace(-200.0, 200.0, 12))
        sentence = refusal(Arch.from_joints, intrados, extrados, 0.7)
        assert re.fullmatch(
            r"voussoirs 0 and 9 overlap by \d\.\d+ m; the ring must not cross itself", sentence
        )

    def test_a_ring_that_closes_on_itself_may_be(self):
        intrados, extrados = ring_of(np.linspace(-180.0, 180.0, 13))
        assert Arch.from_joints(intrados, extrados, 0.7).n_voussoir == 12

    def test_a_ring_near_itself_may_be(self):
        """A spiral whose turns lie side by side."""
        angles = np.linspace(0.0, 700.0, 71)
        growth = 1.0 + angles / 1000.0
        intrados, extrados = (growth[:, None] * side for side in ring_of(angles))
        assert Arch.from_joints(intrados, extrados, 0.7).n_voussoir == 70

    @pytest.mark.parametrize(("intrados", "extrados", "more", "sentence"), TABLES)
    def test_tables(self, intrados, extrados, more, sentence):
        given = {"friction": 0.7, **more}
        assert refusal(Arch.from_joints, intrados, extrados, **given) == sentence

    def test_one_voussoir_may_stand_free(self):
        assert Arch.from_joints(SQUARE[:2], ABOVE[:2], 0.7, free_end=True).n_joint == 1


class TestAllowed:
    """What lies just inside the borders is no error."""

    @pytest.mark.parametrize(
        "change",
        [
            {"thickness": 19.9},
            {"embrace": 359.9},
            {"embrace": 0.5},
            {"voussoirs": 7.0},
            {"voussoirs": np.int64(7)},
            {"radius": np.float32(10.0)},
            {"friction": 0.0},
            {"friction": INF},
            {"dead_load": 0},
            {"joints": np.linspace(0.0, 157.5, 8)},
        ],
    )
    def test_circular(self, change):
        for sector in (True, False):
            assert circular(sector=sector, **change).n_voussoir == 7
