"""Bridges of several spans: geometry, names of joints, fill, ties, drawings, refusals."""

import json
from itertools import pairwise

import numpy as np
import pytest
import shapely

import archfrag as af
from archfrag.arch.facts import facts_of, facts_text
from archfrag.errors import GeometryError
from archfrag.study.file.arches import ArchEntry
from tests.arch.test_drawing import draw

PIER = {"height": 4.0, "width": 1.2, "courses": 2}
FILL = {"height_over_crown": 0.5, "unit_weight": 18e3}


def ring(radius=2.5, thickness=0.5, voussoirs=9, **more):
    more = {"sector": False, "friction": 0.6} | more
    return af.Arch.circular(radius, thickness, 180.0, voussoirs, **more)


BRIDGES = {
    "equal": af.Bridge([ring()] * 3, PIER),
    "rings meet": af.Bridge([ring()] * 2, {**PIER, "width": 1.0, "courses": 4}),
    "unequal": af.Bridge(
        [ring(2.0), ring(3.0, 0.6, 7), ring(2.5, 0.4, 8)],
        [{**PIER, "height": 3.0, "courses": 1}, {**PIER, "width": 1.6, "courses": 3}],
    ),
    "battered": af.Bridge([ring()] * 3, {**PIER, "base_width": 2.0, "above": 0.8}),
    "on end piers": af.Bridge([ring()] * 2, PIER, [None, {**PIER, "courses": 3}]),
}
each_bridge = pytest.mark.parametrize(
    "bridge", BRIDGES.values(), ids=[name.replace(" ", "-") for name in BRIDGES]
)


def by_hand(rings, piers):
    """Return outlines, and joints (body before, body after, corner 0, corner 1), in order.

    `rings` are (radius, thickness, voussoirs), `piers` (width, height, courses).
    """
    n_below = sum(courses - 1 for _, _, courses in piers)
    count = n_below + sum(n for _, _, n in rings) + len(piers)
    below, spine, legs, road = [], [], [], []
    left = -rings[0][0] + 0.5 * rings[0][1]
    for k, (radius, thickness, n) in enumerate(rings):
        first = n_below + len(spine)
        centre = left + radius - 0.5 * thickness
        angle = np.pi * (1.0 - np.arange(n + 1) / n)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        inner, outer = (
            [centre, 0.0] + (radius + side * 0.5 * thickness) * way for side in (-1, 1)
        )
        spine += [np.array([*inner[i : i + 2], *outer[[i + 1, i]]]) for i in range(n)]
        for i in range(n + 1):
            before = first + i - 1 if k + i else -1
            last = k == len(piers) and i == n
            after = count + k if last else first + i
            road.append((before, after, inner[i], outer[i]))
        left = centre + radius - 0.5 * thickness
        if k == len(piers):
            break
        width, height, courses = piers[k]
        beds = [height * (j / courses - 1.0) for j in range(courses + 1)]
        bodies = [n_below + len(spine)]
        bodies[:0] = [len(below) + j for j in range(courses - 1)]
        for j, (low, high) in enumerate(pairwise(beds)):
            box = np.array(shapely.box(left, low, left + width, high).exterior.coords)
            (spine if j == courses - 1 else below).append(box[:-1])
            under = bodies[j - 1] if j else count + k
            legs.append((under, bodies[j], [left + width, low], [left, low]))
        left += width
    return [*below, *spine], [*legs, *road]


HAND = {
    "equal": ([(2.5, 0.5, 9)] * 3, [(1.2, 4.0, 2)] * 2),
    "rings meet": ([(2.5, 0.5, 9)] * 2, [(1.0, 4.0, 4)]),
    "unequal": (
        [(2.0, 0.5, 9), (3.0, 0.6, 7), (2.5, 0.4, 8)],
        [(1.2, 3.0, 1), (1.6, 4.0, 3)],
    ),
}


@pytest.mark.parametrize("name", HAND)
def test_bodies_and_joints_are_those_of_a_bridge_by_hand_in_the_order_of_chains(name):
    bridge = BRIDGES[name]
    outlines, joints = by_hand(*HAND[name])
    assert (bridge.n_voussoir, bridge.n_joint) == (len(outlines), len(joints))
    for body, outline in enumerate(outlines):
        shape = shapely.Polygon(outline)
        ours = shapely.Polygon(bridge.outlines[body])
        assert ours.symmetric_difference(shape).area < 1e-12, body
        assert bridge.chain.mass[body] == pytest.approx(2000.0 * shape.area, rel=1e-12)
        centroid = np.array(shape.centroid.coords[0])
        np.testing.assert_allclose(bridge.centroids[body], centroid, atol=1e-12)
    before, after, *ends = zip(*joints)
    assert bridge.chain.body.tolist() == [*map(list, zip(before, after))]
    np.testing.assert_allclose(bridge.intrados, ends[0], atol=1e-12)
    np.testing.assert_allclose(bridge.extrados, ends[1], atol=1e-12)


@each_bridge
class TestBridges:
    def test_faces_of_a_joint_coincide_and_normals_point_to_the_body_after(
        self, bridge
    ):
        chain = bridge.chain
        frame = np.vstack([chain.centroid, np.zeros((len(bridge.bases), 2))])
        before, after = (frame[chain.body[:, side], None] for side in (0, 1))
        faces = np.stack([bridge.intrados, bridge.extrados], axis=1)
        np.testing.assert_allclose(chain.face_before + before, faces, atol=1e-12)
        np.testing.assert_allclose(chain.face_after + after, faces, atol=1e-12)
        along = faces[:, 1] - faces[:, 0]
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        middle = faces.mean(axis=1)
        for side, sign in ((0, -1.0), (1, 1.0)):
            inside = (chain.body[:, side] >= 0) & (
                chain.body[:, side] < len(chain.mass)
            )
            away = sign * (frame[chain.body[:, side]] - middle)
            assert ((away * normal).sum(axis=1) > 0.0)[inside].all()

    def test_every_joint_and_body_is_in_one_part_and_has_a_name(self, bridge):
        joints = sorted(joint for part in bridge.parts for joint in part.joints)
        bodies = sorted(body for part in bridge.parts for body in part.every)
        assert joints == [*range(bridge.n_joint)]
        assert bodies == [*range(bridge.n_voussoir)]
        places = [*map(bridge.place, range(bridge.n_joint))]
        assert len(set(places)) == bridge.n_joint
        assert places[0] == "pier 1, base"
        for name, (joint, _) in bridge.bases.items():
            base = f"{name}, base" if "pier" in name else f"{name} pier, base"
            assert bridge.place(joint) == base or name in ("left", "right")
        assert [name for name in bridge.bases if "pier" in name] == [
            part.name for part in bridge.parts if part.top is not None
        ]

    def test_parameters_as_json_and_an_entry_give_the_same(self, bridge):
        given = json.loads(json.dumps(bridge.filled(**FILL).parameters))
        entry = {key: value for key, value in given.items() if value is not None}
        again = ArchEntry.model_validate({"id": "a", **entry}).build()
        for ours, theirs in zip(bridge.filled(**FILL).chain, again.chain):
            assert ours is theirs is None or np.array_equal(ours, theirs)

    def test_its_drawing_is_the_same_bridge(self, bridge, tmp_path):
        bases = [joint for joint, _ in bridge.bases.values()]
        ground = np.stack([bridge.intrados, bridge.extrados], axis=1)[bases].tolist()
        outlines = [outline.tolist() for outline in bridge.outlines]
        draw(tmp_path / "a.dxf", outlines[::-1], ground[::-1])
        again = af.Arch.from_dxf(tmp_path / "a.dxf", bridge.chain.friction)
        assert again.bases == bridge.bases
        for ours, theirs in zip(bridge.chain, again.chain):
            if ours is not None:
                np.testing.assert_allclose(theirs, ours, atol=1e-8)
        wide = af.Arch.from_dxf(
            tmp_path / "a.dxf", 0.6, thickness_factor=0.9, tolerance=1e-4
        )
        assert wide.dimensions[2] == pytest.approx(0.9 * again.dimensions[2], rel=1e-6)

    def test_fill_weighs_what_lies_between_the_stones_and_its_surface(self, bridge):
        full = bridge.filled(**FILL)
        weight = (full.chain.mass - bridge.chain.mass).sum() * bridge.chain.gravity
        back = bridge.extrados[list(bridge.springings), 0]
        left, right = back[0], np.concatenate(bridge.outlines)[:, 0].max()
        stones = shapely.union_all([*map(shapely.Polygon, bridge.outlines)])
        crown = np.concatenate(bridge.outlines)[:, 1].max() + 0.5
        above = shapely.box(left, 0.0, right, crown).difference(stones)
        # What lies under the rings is no fill.
        pieces = shapely.get_parts(above)
        highest = max(pieces, key=lambda piece: piece.bounds[3])
        assert weight == pytest.approx(18e3 * highest.area, rel=1e-9)
        facts = facts_of(full)
        assert facts["weights"]["fill"] == pytest.approx(weight, rel=1e-12)
        total = full.chain.mass.sum() * full.chain.gravity
        assert sum(facts["weights"].values()) == pytest.approx(total, rel=1e-12)
        assert "the rings weigh" in facts_text(full)
        earth = next(mark.points for mark in full.marks if mark.role == "earth")
        assert (np.diff(earth[:-2, 0]) >= -1e-12).all()

    def test_a_tie_is_in_each_span_or_in_its_own(self, bridge):
        tied = bridge.tied(level=0.6, area=8e-4)
        assert [tie["span"] for tie in tied.parameters["ties"]] == [
            *range(1, len(bridge.spans) + 1)
        ]
        one = bridge.tied(level=0.6, area=8e-4, span=2)
        np.testing.assert_array_equal(one.chain.tie[0], tied.chain.tie[1])
        bodies = one.tie_bodies[0]
        assert set(bodies) <= {body for part in bridge.parts for body in part.every}
        x = one.tie_lines[0][:, 0]
        joints = [*bridge.spans[1].joints]
        assert x[0] < bridge.intrados[joints[0], 0] < bridge.intrados[joints[-1], 0]
        assert x[1] > bridge.intrados[joints[-1], 0]


def test_a_tie_goes_through_the_piers_of_its_span():
    bridge = BRIDGES["battered"]
    (bodies,) = bridge.tied(level=0.6, area=8e-4, span=2).tie_bodies
    tops = [part.top for part in bridge.parts if part.top is not None]
    assert bodies.tolist() == tops


def test_one_ring_alone_is_a_chain_of_one_part():
    alone = af.Bridge([ring()])
    assert alone.chain.body is None
    assert [part.name for part in alone.parts] == ["arch"]
    assert alone.place(3) == "joint 3"
    assert alone.bases == {"left": (0, 0), "right": (9, 1)}
    on = af.Bridge([ring()], ends=PIER)
    assert on.chain.body is None
    assert [*map(on.place, (0, 2, 11, 13))] == [
        "left pier, base",
        "span 1, joint 0",
        "span 1, joint 9",
        "right pier, base",
    ]


def test_values_of_piers_are_their_own_or_those_of_the_rings_on_them():
    rings = [ring(density=2000.0, friction=0.6), ring(density=1800.0, friction=0.5)]
    with pytest.raises(GeometryError, match="pier 1 needs its own friction"):
        af.Bridge(rings, PIER)
    pier = {**PIER, "friction": 0.7, "density": 2200.0, "depth": 2.0}
    bridge = af.Bridge(rings, pier)
    assert bridge.chain.friction.tolist() == [0.7] * 2 + [0.6] * 10 + [0.5] * 10
    area = [shapely.Polygon(outline).area for outline in bridge.outlines]
    density = bridge.chain.mass / area
    np.testing.assert_allclose(
        density, [4400.0, *[2000.0] * 9, 4400.0, *[1800.0] * 9], rtol=1e-12
    )
    assert bridge.joint_depths.tolist() == [2.0, 2.0, *[1.0] * 20]
    assert bridge.corner_name(0, 1) == "right"
    assert bridge.corner_name(0, 5) == bridge.corner_name(0) == "intrados"


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: af.Bridge([]), "rings must be one Arch or more"),
        (lambda: af.Bridge([ring()] * 2), "piers must be one mapping"),
        (lambda: af.Bridge([ring()] * 3, [PIER]), "or a list of 2"),
        (lambda: af.Bridge([ring()] * 2, {**PIER, "width": 0.9}), "reach 0.5 and 0.5"),
        (lambda: af.Bridge([ring()] * 2, {**PIER, "height": -1}), "piers[0].height"),
        (
            lambda: af.Bridge([ring().tied(0.5, area=1e-3), ring()], PIER),
            "ring 1 has ties already",
        ),
        (
            lambda: af.Bridge([ring(), af.Block(1.0, 2.0, 0.6)], PIER),
            "an arch between two springings",
        ),
        (
            lambda: af.Bridge([af.Arch.circular(2.5, 0.5, 220.0, 9, 0.6)] * 2, PIER),
            "rings overlap above it",
        ),
        (lambda: BRIDGES["equal"].tied(0.5, area=1e-3, span=4), "must be 1 to 3"),
        (lambda: af.Bridge([BRIDGES["equal"], ring()], PIER), "ring 1 has spans"),
        (lambda: af.Bridge([ring()] * 2, {**PIER, "courses": 1990}), "2008 bodies"),
    ],
)
def test_bridges_that_cannot_be(make, part):
    with pytest.raises(GeometryError) as error:
        make()
    assert part in str(error.value)


def test_drawings_that_make_no_bridge_are_refused_by_place():
    bridge = BRIDGES["equal"]
    blocks = [outline.tolist() for outline in bridge.outlines]
    bases = [joint for joint, _ in bridge.bases.values()]
    ground = np.stack([bridge.intrados, bridge.extrados], axis=1)[bases].tolist()
    over = np.add(blocks[0], [0.3, 0.0])
    lone = np.add(blocks[0], [20.0, 0.0])
    for outlines, lines, part in (
        (blocks, ground[:-1], "outlines[30] hangs at one joint"),
        ([*blocks, over.tolist()], ground, "overlaps"),
        (
            [*blocks, lone.tolist()],
            ground,
            "has no edge in common with outlines[31], 8.34 m",
        ),
        (blocks, ground[:1] + ground[2:], "outlines[0] hangs at one joint"),
        (blocks, [*ground, ground[0]], "stands on two lines"),
    ):
        with pytest.raises(GeometryError) as error:
            af.Arch.from_polygons(outlines, 0.6, ground=lines)
        assert part in str(error.value)
