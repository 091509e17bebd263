"""Arches on piers, under fill, of uneven depth: beside programmes and sums written here."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import fixed_quad
from scipy.optimize import linprog

import archfrag as af
from tests.piers import ends_of, on_piers
from tests.validation.scenes import g


def figure(corners):
    """Area and centroid of a polygon, from the triangles of its first corner."""
    first = corners[0]
    rest = corners[1:] - corners[0]
    double = rest[:-1, 0] * rest[1:, 1] - rest[:-1, 1] * rest[1:, 0]
    return 0.5 * double.sum(), first + double @ (rest[:-1] + rest[1:]) / (
        3.0 * double.sum()
    )


def largest_load(lines, bodies, friction, sense):
    """Largest k for which joint forces balance weights and k times them, by a programme.

    Static theorem: `lines` (n_joint, 2, 2) [m], `bodies` pairs of weight and centroid. Unknown
    are both normal forces and the shear of each joint, and k; forces in units of all weights.
    """
    n_body = len(bodies)
    n_joint = len(lines)
    total = sum(weight for weight, _ in bodies)
    rows = np.zeros((3 * n_body, 3 * n_joint + 1))
    right = np.zeros(3 * n_body)
    for j, (inner, outer) in enumerate(lines):
        along = (outer - inner) / np.hypot(*(outer - inner))
        across = np.array([along[1], -along[0]])
        for k, (point, way) in enumerate(
            [(inner, across), (outer, across), (inner, along)]
        ):
            for body, sign in ((j, 1.0), (j - 1, -1.0)):
                if 0 <= body < n_body:
                    arm = point - bodies[body][1]
                    moment = arm[0] * way[1] - arm[1] * way[0]
                    rows[3 * body : 3 * body + 3, 3 * j + k] = sign * np.array(
                        [*way, moment]
                    )
    for body, (weight, _) in enumerate(bodies):
        rows[3 * body, -1] = -weight / total
        right[3 * body + 1] = weight / total
    cone = np.zeros((2 * n_joint, 3 * n_joint + 1))
    for j, own in enumerate(friction):
        if math.isfinite(own):
            cone[2 * j : 2 * j + 2, 3 * j : 3 * j + 3] = [
                [-own, -own, 1.0],
                [-own, -own, -1.0],
            ]
    found = linprog(
        np.append(np.zeros(3 * n_joint), -sense),
        A_ub=cone,
        b_ub=np.zeros(2 * n_joint),
        A_eq=rows,
        b_eq=right,
        method="highs-ds",
        bounds=[(0, None), (0, None), (None, None)] * n_joint + [(None, None)],
        options={
            "primal_feasibility_tolerance": 1e-10,
            "dual_feasibility_tolerance": 1e-10,
        },
    )
    return found.x[-1] if found.success else math.nan


def own_pier(side, inner, outer, height, width, base_width, courses, above):
    """Corners of the courses of a pier from its base up, and its level joints, by hand."""
    base = inner[1] - height
    top = outer[1] + above

    def face(y):
        part = (y - base) / (top - base)
        return np.array([inner[0] + side * ((1 - part) * base_width + part * width), y])

    level = [base + height * k / courses for k in range(courses)]
    lines = [np.array([[inner[0], y], face(y)]) for y in level]
    courses = [np.array([*a, *b[::-1]]) for a, b in pairwise(lines)]
    head = [*lines[-1][::-1], inner, outer, [outer[0], top], face(top)]
    return [*courses, np.array(head)], lines


def portal(generator):
    """A random arch on piers, and by hand its joints and bodies."""
    profile = generator.choice(
        ["circular", "segmental", "pointed", "elliptic", "catenary"]
    )
    span = generator.uniform(4.0, 16.0)
    voussoirs = int(generator.integers(4, 16))
    given = {"thickness": generator.uniform(0.12, 0.25) * span, "voussoirs": voussoirs}
    depth = generator.uniform(0.5, 2.0, voussoirs)
    if profile == "circular":
        given |= {"radius": 0.5 * span, "embrace": generator.uniform(70.0, 180.0)}
    else:
        rise = generator.uniform(
            *{"segmental": (0.15, 0.5), "pointed": (0.5, 0.9)}.get(profile, (0.4, 0.8))
        )
        given |= {"span": span, "rise": rise * span}
    if profile in ("circular", "segmental"):
        given["sector"] = False
    ring = getattr(af.Arch, profile)(**given, depth=depth, friction=0.7, density=1900.0)
    ends = np.stack([ring.intrados, ring.extrados], axis=1)
    reach = max(abs(ends[k, 1, 0] - ends[k, 0, 0]) for k in (0, -1))
    width = reach + generator.uniform(0.1, 0.4, 2) * span
    piers = {
        "height": generator.uniform(0.3, 1.5, 2) * span,
        "width": width,
        "base_width": width * generator.uniform(1.0, 1.5, 2),
        "courses": generator.integers(1, 4, 2),
        "above": generator.uniform(0.0, 2.0, 2),
        "density": generator.uniform(1500.0, 2500.0, 2),
        "depth": generator.uniform(1.0, 3.0, 2),
    }
    shape = [
        [piers[key][k] for key in ("height", "width", "base_width", "courses", "above")]
        for k in (0, 1)
    ]
    left, low_left = own_pier(-1.0, *ends[0], *shape[0])
    right, low_right = own_pier(1.0, *ends[-1], *shape[1])
    lines = np.array([*low_left, *ends, *low_right[::-1]])
    stones = [np.array([*a, *b[::-1]]) for a, b in pairwise(ends)]
    heavy = g * piers["density"] * piers["depth"]
    weighed = [
        (left, np.full(len(left), heavy[0])),
        (stones, 1900.0 * g * depth),
        (right[::-1], np.full(len(right), heavy[1])),
    ]
    bodies = []
    for corners, densities in weighed:
        for each, density in zip(corners, densities):
            area, centroid = figure(each)
            bodies.append((density * abs(area), centroid))
    friction = (
        math.inf
        if generator.random() < 0.5
        else generator.uniform(0.45, 0.9, len(lines))
    )
    return ring, piers, lines, bodies, friction


def test_onset_of_random_portals():
    """Forty, half of them with friction of each joint: any profile, uneven piers, both senses."""
    generator = np.random.default_rng(32)
    known = 0
    slid = 0
    for _ in range(40):
        ring, piers, lines, bodies, friction = portal(generator)
        own = ring.intrados, ring.extrados, friction
        heavy = {"density": 1900.0, "depth": ring.parameters["depth"]}
        if np.ndim(friction):  # as a study file gives it
            arch = af.Arch.from_joints(*own, **heavy, ends=ends_of(**piers))
        else:
            arch = on_piers(af.Arch.from_joints(*own, **heavy), **piers)
        left, right = piers["courses"]
        assert (arch.springings, arch.n_joint) == (
            (left, len(lines) - 1 - right),
            len(lines),
        )
        start = af.onset(arch)
        slid += bool(start.sliding or start.sliding_minus)
        for ours, sense in ((start.plus, 1.0), (-start.minus, -1.0)):
            each = np.broadcast_to(friction, len(lines))
            theirs = largest_load(lines, bodies, each, sense)
            assert ours == pytest.approx(theirs, abs=1e-9, nan_ok=True)
            known += math.isfinite(theirs)
    assert (known > 60, slid > 5) == (True, True)


RING = af.Arch.circular(5.0, 0.8, 150.0, 9, 0.7, depth=3.0)
FILL = {
    "height_over_crown": 0.6,
    "unit_weight": 18e3,
    "backing_height": 2.0,
    "backing_unit_weight": 22e3,
}


class TestFill:
    """A ring of exact sectors under fill and backing, beside integrals of its circle."""

    def bodies(self):
        """Weights of the voussoirs and their loads [N], and where they act [m], by hand."""
        level = 5.4 + 0.6
        backed = 5.0 * math.cos(math.radians(75.0)) + 2.0

        def load(angle):  # of a unit of angle from above
            y = 5.4 * math.cos(angle)
            height = 18e3 * (level - max(y, backed)) + 22e3 * max(backed - y, 0.0)
            return 3.0 * height * 5.4 * math.cos(angle)

        turn = math.acos(backed / 5.4)
        found = []
        for i in range(9):
            left, right = (math.radians(150.0 * (k / 9 - 0.5)) for k in (i, i + 1))
            ends = sorted(
                {left, right, *(t for t in (-turn, turn) if left < t < right)}
            )
            weight, moment = (
                sum(
                    fixed_quad(np.vectorize(f), a, b, n=20)[0]
                    for a, b in pairwise(ends)
                )
                for f in (load, lambda t: 5.4 * math.sin(t) * load(t))
            )
            x = moment / weight
            found.append((weight, np.array([x, math.sqrt(5.4**2 - x * x)])))
        bare = RING.chain
        return [
            (m * g, c, *each) for m, c, each in zip(bare.mass, bare.centroid, found)
        ]

    def test_masses_and_reactions(self):
        arch = RING.filled(**FILL)
        own, place, load, at = map(np.array, zip(*self.bodies()))
        weight = own + load
        centroid = (own[:, None] * place + load[:, None] * at) / weight[:, None]
        np.testing.assert_allclose(arch.chain.mass * g, weight, rtol=1e-12)
        np.testing.assert_allclose(arch.chain.centroid, centroid, rtol=0, atol=1e-12)
        apart = [((point - centroid) ** 2).sum(axis=1) for point in (place, at)]
        inertia = RING.chain.inertia + (own * apart[0] + load * apart[1]) / g
        np.testing.assert_allclose(arch.chain.inertia, inertia, rtol=1e-12)
        still = af.Motion(np.zeros(5), 0.01)
        reaction = af.simulate(arch, still, history=True).history.reaction.values[0]
        change = reaction[:-1, :2] - reaction[1:, :2]
        scale = weight.sum()
        np.testing.assert_allclose(change[:, 0], 0.0, atol=1e-12 * scale)
        np.testing.assert_allclose(change[:, 1], weight, atol=1e-12 * scale)
        assert reaction[0, 1] - reaction[-1, 1] == pytest.approx(scale, rel=1e-12)

    def test_onset_from_moments_about_its_hinges(self):
        """At onset the arch is a linkage: three moments give reaction and load."""
        start = af.onset(RING.filled(**FILL))
        own, place, load, at = map(np.array, zip(*self.bodies()))
        hinges = [(j, getattr(RING, side)[j]) for j, side in start.hinges]
        (first, base), rows, right = hinges[0], [], []
        for joint, point in hinges[1:]:
            part = slice(first, joint)
            arms = np.concatenate([place[part], at[part]]) - point
            force = np.concatenate([own[part], load[part]])
            arm = base - point
            # Moment of the reaction (h, v) at the first hinge, of k weights to the left, and of
            # the weights.
            rows.append([-arm[1], arm[0], force @ arms[:, 1]])
            right.append(force @ arms[:, 0])
        assert start.plus == pytest.approx(np.linalg.solve(rows, right)[2], rel=1e-12)

    def test_drawn_sectors_carry_the_same(self):
        outlines = []
        for i in range(9):
            angle = math.radians(150.0 / 9)
            corners = [
                RING.intrados[i],
                RING.intrados[i + 1],
                RING.extrados[i + 1],
                RING.extrados[i],
            ]
            bulge = math.tan(angle / 4.0)
            outlines.append(np.column_stack([corners, [-bulge, 0.0, bulge, 0.0]]))
        ground = [np.array([RING.intrados[k], RING.extrados[k]]) for k in (0, -1)]
        drawn = af.Arch.from_polygons(outlines, 0.7, ground=ground, depth=3.0)
        for ours, theirs in zip(
            drawn.filled(**FILL).chain[:7], RING.filled(**FILL).chain[:7]
        ):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)

    def test_horseshoe_and_piers(self):
        """Backs that face down carry nothing, and tops of piers carry what stands on them."""
        ring = af.Arch.circular(5.0, 0.8, 230.0, 12, 0.7)
        load = (ring.filled(0.6, 18e3).chain.mass - ring.chain.mass) * g
        whole = 18e3 * (2.0 * 5.4 * 6.0 - 0.5 * math.pi * 5.4**2)
        assert load.sum() == pytest.approx(whole, rel=1e-12)
        assert load[0] == 0.0 < load[1]
        bare = af.Arch.circular(
            5.0, 0.8, 230.0, 8, 0.7
        ).chain  # its first back turns at its top
        full = af.Arch.circular(5.0, 0.8, 230.0, 8, 0.7).filled(0.6, 18e3).chain
        moment = full.mass[0] * full.centroid[0] - bare.mass[0] * bare.centroid[0]
        x, y = moment / (full.mass[0] - bare.mass[0])
        assert y == pytest.approx(math.sqrt(5.4**2 - x * x), rel=1e-8)
        bare = on_piers(
            RING, 4.0, [2.0, 3.0], courses=2, above=[0.0, 1.0], depth=[4.0, 5.0]
        )
        load = (bare.filled(0.6, 18e3).chain.mass - bare.chain.mass) * g
        out, up = RING.extrados[-1]
        inner = RING.intrados[-1, 0]
        top = 18e3 * np.array(
            [
                4.0 * (2.0 - out + inner) * (6.0 - up),
                5.0 * (3.0 - out + inner) * (5.0 - up),
            ]
        )
        np.testing.assert_allclose(
            load[[0, 1, -2, -1]], [0.0, top[0], top[1], 0.0], rtol=1e-12
        )


@pytest.mark.parametrize("friction", [math.inf, 0.55])
def test_lune_of_a_dome(friction):
    """Depth in proportion to the distance from the axis: another onset than of an even one."""
    even = af.Arch.circular(10.0, 2.0, 160.0, 15, friction, sector=False)
    ends = np.stack([even.intrados, even.extrados], axis=1)
    stones = [figure(np.array([*a, *b[::-1]])) for a, b in pairwise(ends)]
    depth = np.array([0.05 + 0.2 * abs(place[0]) for _, place in stones])
    lune = af.Arch.circular(10.0, 2.0, 160.0, 15, friction, sector=False, depth=depth)
    bodies = [
        (2000.0 * g * abs(area) * d, place) for (area, place), d in zip(stones, depth)
    ]
    start = af.onset(lune)
    for ours, sense in ((start.plus, 1.0), (-start.minus, -1.0)):
        theirs = largest_load(ends, bodies, np.full(16, friction), sense)
        assert ours == pytest.approx(theirs, abs=1e-9)
    assert abs(start.plus - af.onset(even).plus) > 0.005
