"""Least thickness, least friction and onset of motion, beside published and computed values."""

import math
from dataclasses import replace

import numpy as np
import pytest

import archfrag as af
from archfrag.simulation.rest import static_limit
from tests.validation.scenes import HEIGHT, WIDTH, column, least, limit_analysis

TOPIC = "Onset of motion"
RIZZI = "Cocchetti and Rizzi 2020, table 3"
LIMIT = "limit-analysis linear programme"
GILBERT = "Gilbert, Casapulla and Ahmed 2006"


def semicircle(ratio, voussoirs=300, friction=math.inf, **options):
    return af.Arch.circular(10.0, 10.0 * ratio, 180.0, voussoirs, friction, **options)


def moved_to(arch, place, mass):
    """Onset of the same joints with other masses, whose centroids are elsewhere."""
    moved = (place - arch.chain.centroid)[:, None]
    before = arch.chain.face_before.copy()
    after = arch.chain.face_after.copy()
    before[1:] -= moved
    after[:-1] -= moved
    chain = arch.chain._replace(
        centroid=place, mass=mass, face_before=before, face_after=after
    )
    return af.onset(replace(arch, chain=chain))


def on_centre_line(ratio, friction=math.inf):
    """Onset of a semicircle with its weight on the centre line, as Heyman has it."""
    arch = semicircle(ratio, friction=friction)
    middle = np.linspace(math.pi, 0.0, 2 * arch.n_voussoir + 1)[1::2]
    place = 10.0 * np.column_stack([np.cos(middle), np.sin(middle)])
    return moved_to(arch, place, arch.chain.mass)


def vertical_cuts(ratio, n=300):
    """Onset of a semicircle cut by vertical planes; its last pieces have level springings."""
    inner = 10.0 - 5.0 * ratio
    outer = 10.0 + 5.0 * ratio
    x = np.append(inner * np.cos(np.linspace(math.pi, 0.0, n + 1))[:-1], inner)
    low = np.column_stack([x, np.sqrt(inner**2 - x**2 + 1e-18)])
    high = np.column_stack([x, np.sqrt(outer**2 - x**2)])
    high[0] = (-outer, 0.0)
    high[-1] = (outer, 0.0)
    arch = af.Arch.from_joints(low, high, math.inf)
    # The back of the last pieces is an arc, from which a straight side is far.
    back = np.linspace(0.0, math.atan2(high[1, 1], -high[1, 0]), 2001)
    arc = outer * np.column_stack([-np.cos(back), np.sin(back)])
    piece = np.vstack([low[:1], arc, low[1:2]])
    (x, y), (u, v) = piece.T, np.roll(piece, -1, axis=0).T
    area = x * v - u * y
    centre = np.array([(x + u) @ area, (y + v) @ area]) / (3.0 * area.sum())
    mass = arch.chain.mass.copy()
    mass[[0, -1]] = 2000.0 * 0.5 * abs(area.sum())
    place = arch.chain.centroid.copy()
    place[0] = centre
    place[-1] = centre * [-1.0, 1.0]
    return moved_to(arch, place, mass)


class TestSemicircle:
    TOPIC = "Least thickness of a semicircle"
    CENTRE_LINE = "weight on the centre line"

    @pytest.mark.parametrize(
        ("case", "voussoirs", "friction", "sector", "expected", "source"),
        [
            (
                "radial cuts, no sliding",
                300,
                math.inf,
                True,
                0.1075,
                "Milankovitch 1907",
            ),
            ("27 straight voussoirs, no sliding", 27, math.inf, False, 0.1067, LIMIT),
            ("27 straight voussoirs, no sliding", 27, math.inf, False, 0.107, GILBERT),
            ("27 straight voussoirs, friction 0.35", 27, 0.35, False, 0.1512, LIMIT),
            ("27 straight voussoirs, friction 0.35", 27, 0.35, False, 0.151, GILBERT),
        ],
    )
    def test_thickness(
        self, validated, case, voussoirs, friction, sector, expected, source
    ):
        def stands(ratio):
            return af.onset(
                semicircle(ratio, voussoirs, friction, sector=sector)
            ).stands

        allowed = 6e-5 if expected * 1e4 % 10 else 5e-4
        validated(
            case, "t/R", least(stands, 0.05, 0.3, 1e-6), expected, source, abs=allowed
        )

    def test_vertical_cuts(self, validated):
        found = least(lambda ratio: vertical_cuts(ratio).stands, 0.09, 0.13, 1e-6)
        validated(
            "vertical cuts", "t/R", found, 0.1095, "Makris and Alexakis 2013", abs=6e-5
        )

    def test_weight_on_the_centre_line(self, validated):
        found = least(lambda ratio: on_centre_line(ratio).stands, 0.09, 0.13, 1e-6)
        validated(self.CENTRE_LINE, "t/R", found, 0.107426, RIZZI, rel=1e-4)
        hinges = on_centre_line(found + 1e-6).hinges
        haunch = np.array([joint for joint, side in hinges if side == "intrados"])
        name = "haunch hinge from the crown"
        degrees = np.abs(haunch * 0.6 - 90.0).min()
        validated(self.CENTRE_LINE, name, degrees, 54.4963, RIZZI, abs=0.31, unit="deg")
        found = least(lambda mu: on_centre_line(0.10743, mu).stands, 0.36, 0.44, 1e-6)
        name = "friction below which joints slide"
        validated(self.CENTRE_LINE, name, found, 0.395832, RIZZI, rel=1e-3)
        case = f"{self.CENTRE_LINE}, any thickness"
        thick = least(lambda mu: on_centre_line(0.25, mu).stands, 0.30, 0.32, 1e-6)
        validated(case, "least friction", thick, 0.309215, RIZZI, rel=1e-4)
        found = least(
            lambda ratio: on_centre_line(ratio, thick).stands, 0.18, 0.22, 1e-6
        )
        validated(case, "t/R from which it stands", found, 0.200637, RIZZI, rel=2e-3)

    @pytest.mark.parametrize("friction", [0.32, 0.35, 0.38])
    def test_thrust_of_the_mixed_mechanism(self, validated, friction):
        """From moments of half the arch about the contact centre at its springing."""
        found = least(
            lambda ratio: on_centre_line(ratio, friction).stands, 0.1, 0.25, 1e-6
        )
        line = on_centre_line(found + 1e-6, friction).thrust_plus
        half = 150
        middle = np.linspace(math.pi, 0.0, 601)[1:300:2]
        lever = 10.0 * np.cos(middle) - line[0, 0]
        thrust = math.pi / 300 * lever.sum() / (line[half, 1] - line[0, 1])
        case = f"{self.CENTRE_LINE}, friction {friction:g}"
        validated(
            case, "thrust over w r", thrust, 0.5 * math.pi * friction, RIZZI, rel=1e-3
        )


class TestOnset:
    """Least horizontal acceleration of the ground that starts motion."""

    @pytest.mark.parametrize(
        ("shape", "voussoirs", "friction", "sector", "expected", "source"),
        [
            ((10.0, 1.5, 157.5), 7, math.inf, True, 0.37, "Oppenheim 1992"),
            ((10.0, 1.5, 157.5), 7, math.inf, True, 0.37001, LIMIT),
            ((10.0, 1.5, 157.5), 7, math.inf, False, 0.37361, LIMIT),
            ((10.0, 1.5, 157.5), 100, math.inf, True, 0.3535, LIMIT),
            ((10.0, 1.5, 157.5), 300, math.inf, True, 0.3534, LIMIT),
            ((10.0, 1.0, 120.0), 300, math.inf, True, 0.5800, LIMIT),
            ((10.0, 2.0, 140.0), 300, math.inf, True, 0.7711, LIMIT),
            ((10.0, 1.2, 180.0), 300, math.inf, True, 0.0461, LIMIT),
            ((10.0, 1.5, 157.5), 7, 0.4, False, 0.2570, LIMIT),
        ],
    )
    def test_of_an_arch(
        self, validated, shape, voussoirs, friction, sector, expected, source
    ):
        start = af.onset(af.Arch.circular(*shape, voussoirs, friction, sector=sector))
        kind = "" if sector else " straight-sided"
        slides = "" if math.isinf(friction) else f", friction {friction:g}"
        case = f"t/R {shape[1] / 10:g}, embrace {shape[2]:g}°, {voussoirs}{kind} voussoirs{slides}"
        allowed = (
            5e-4
            if source != LIMIT
            else 6e-6
            if voussoirs == 7 and friction > 1
            else 6e-5
        )
        validated(case, "onset", start.plus, expected, source, abs=allowed, unit="g")
        assert start.minus == pytest.approx(start.plus, rel=1e-9)

    def test_hinges_of_oppenheims_arch(self, validated):
        start = af.onset(af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7))
        # Counted from the other springing than ours: the hinges of the mirrored motion.
        for number, (joint, _) in enumerate(start.hinges_minus):
            validated(
                "t/R 0.15, embrace 157.5°, 7 voussoirs",
                f"hinge {number + 1}",
                joint * 22.5,
                (0.0, 67.5, 112.5, 157.5)[number],
                "Oppenheim 1992",
                abs=1e-9,
                unit="deg",
            )

    @pytest.mark.parametrize(("number", "friction"), [(0, math.inf), (1, 0.5)])
    @pytest.mark.parametrize(
        ("profile", "shape"),
        [
            ("circular", (10.0, 1.5, 140.0)),
            ("segmental", (10.0, 2.5, 0.8)),
            ("pointed", (8.0, 5.5, 0.9)),
            ("elliptic", (10.0, 3.5, 1.2)),
            ("catenary", (10.0, 5.0, 0.8)),
        ],
    )
    def test_against_a_linear_programme(
        self, validated, profile, shape, number, friction
    ):
        """Over the forces at both ends of all joints, written from the joints alone."""
        load = np.random.default_rng(number).uniform(0.0, 5e4, 12)
        arch = getattr(af.Arch, profile)(*shape, 12, friction, dead_load=load)
        case = (
            f"{profile}, 12 voussoirs, uneven load {number + 1}, friction {friction:g}"
        )
        start = af.onset(arch)
        source = "scipy linprog (HiGHS)"
        for quantity, ours, sense in (
            ("onset towards +x", start.plus, 1.0),
            ("onset towards −x", -start.minus, -1.0),
        ):
            expected = limit_analysis(arch, sense)
            validated(case, quantity, ours, expected, source, rel=1e-6, unit="g")


class TestColumn:
    """Chains with a free end, by statics."""

    def test_block_and_leaning_column(self, validated):
        for friction in (0.8, 0.15):
            start = af.onset(af.Block(0.2, 1.0, friction=friction))
            case = f"block, b/h 0.2, friction {friction:g}"
            source = "statics: least of b/h and friction"
            validated(
                case,
                "onset",
                start.plus,
                min(0.2, friction),
                source,
                rel=1e-9,
                unit="g",
            )
        right = np.array([[0.25, 0.0], [0.85, 3.0]])
        start = af.onset(
            af.Arch.from_joints(right, right - [0.5, 0.0], 1.0, free_end=True)
        )
        validated(
            "column that leans beyond its base",
            "push that would hold it",
            -start.minus,
            0.05 / 1.5,
            "statics: overhang over height of the centroid",
            rel=1e-9,
            unit="g",
        )
        block = af.Block(0.2, 1.0, friction=0.8)
        validated(
            "block, b/h 0.2",
            "rotation of no return",
            static_limit(block, af.onset(block)),
            math.atan(0.2),
            "statics: angle of the diagonal",
            rel=1e-6,
            unit="rad",
        )

    def test_tapering_column_of_eight_blocks(self, validated):
        thickness = np.diff(HEIGHT)
        below = WIDTH[:-1]
        above = WIDTH[1:]
        mass = 0.5 * (below + above) * thickness
        middle = HEIGHT[:-1] + thickness * (below + 2.0 * above) / (
            3.0 * (below + above)
        )
        slenderness = [
            0.5 * WIDTH[j] / ((mass[j:] @ middle[j:]) / mass[j:].sum() - HEIGHT[j])
            for j in range(8)
        ]
        start = af.onset(column())
        assert start.hinges == [(int(np.argmin(slenderness)), "extrados")]
        validated(
            "column of Dimitri and others 2011",
            "onset",
            start.plus,
            min(slenderness),
            "statics: least slenderness of what stands on a joint",
            rel=1e-9,
            unit="g",
        )
