"""A pier with its share of rings and fill as a column across the bridge: masses, onset, words."""

import math

import numpy as np
import pytest
import shapely

import archfrag as af
from archfrag.errors import GeometryError

PIER = {"height": 4.0, "width": 1.2, "courses": 3}
FILL = {
    "height_over_crown": 0.5,
    "unit_weight": 18e3,
    "backing_height": 1.0,
    "backing_unit_weight": 22e3,
}


def ring(radius=2.5, thickness=0.5, voussoirs=9, **more):
    more = {"sector": False, "friction": 0.6} | more
    return af.Arch.circular(radius, thickness, 180.0, voussoirs, **more)


def columns_of(bridge):
    names = [part.name for part in bridge.parts if "pier" in part.name]
    return [bridge.transverse(name) for name in names]


def test_a_monolithic_pier_rocks_about_its_base():
    """Half the width over the height of the centroid of a pier and two quarter rings."""
    radius, thickness, height, width, depth = 2.5, 0.5, 4.0, 1.0, 2.4
    rings = [ring(radius, thickness, sector=True, friction=10.0, depth=depth)] * 2
    bridge = af.Bridge(rings, {"height": height, "width": width})
    share = math.pi * radius * thickness  # of two halves [m2]
    outer, inner = radius + 0.5 * thickness, radius - 0.5 * thickness
    above = 4.0 / (3.0 * math.pi) * (outer**3 - inner**3) / (outer**2 - inner**2)
    stone = width * height
    centroid = (stone * 0.5 * height + share * (height + above)) / (stone + share)
    start = af.onset(bridge.transverse("pier 1"))
    assert start.plus == pytest.approx(0.5 * depth / centroid, rel=1e-9)
    assert start.minus == pytest.approx(start.plus, rel=1e-12)
    assert start.hinges == [(0, "extrados")]
    assert start.hinges_minus == [(0, "intrados")]


@pytest.mark.parametrize(
    "change",
    [
        lambda bridge: bridge,
        lambda bridge: bridge.filled(**FILL),
        lambda bridge: bridge.rebuilt(dead_load=2e4),
    ],
    ids=["bare", "fill", "load"],
)
@pytest.mark.parametrize("ends", [None, {**PIER, "courses": 2, "above": 0.6}])
def test_columns_share_the_mass_of_the_bridge(change, ends):
    rings = [ring(2.0), ring(3.0, 0.6, 8), ring()]
    bridge = change(af.Bridge(rings, {**PIER, "width": 1.6, "base_width": 2.0}, ends))
    whole = bridge.chain.mass
    outer = [body for span in bridge.spans[:: len(rings) - 1] for body in span.bodies]
    without = 0.0 if ends else 0.5 * whole[outer].sum()
    columns = columns_of(bridge)
    total = sum(column.chain.mass.sum() for column in columns)
    assert total == pytest.approx(whole.sum() - without, rel=1e-12)
    for part, column in zip((p for p in bridge.parts if "pier" in p.name), columns):
        courses = column.chain.mass[:-1]
        bare = bridge.rebuilt(fill=None).chain.mass[part.every]
        np.testing.assert_allclose(courses, bare, rtol=1e-12)


def sliced(shape, weight, centre, depth):
    """Return mass times 1, y and the square of the distance to `centre` across, by thin slices."""
    left, low, right, high = shape.bounds
    edges = np.linspace(low, high, 2001)
    strips = shapely.box(left, edges[:-1], right, edges[1:])
    areas = shapely.area(shapely.intersection(strips, shape))
    y = 0.5 * (edges[1:] + edges[:-1])
    mass = weight * areas * depth
    turn = mass * ((y - centre) ** 2 + depth**2 / 12.0)
    return np.array([mass.sum(), mass @ y, turn.sum()])


def test_the_share_has_the_moments_of_rings_fill_and_backing():
    """Rings are wider than the pier and the load is on one of them only."""
    depth = 3.0
    rings = [ring(depth=depth), ring(2.5, 0.5, 8, depth=depth, dead_load=5e3)]
    bridge = af.Bridge(rings, {**PIER, "depth": 2.0, "density": 2300.0}).filled(**FILL)
    column = bridge.transverse("pier 1")
    surface = bridge.intrados[bridge.spans[0].joints[0], 1] + 2.75 + 0.5
    levels = (surface, 18e3), (1.0, 4e3)  # backing in place of fill
    top = bridge.parts[1].top
    shapes = []
    for body in [*bridge.spans[0].bodies, top, *bridge.spans[1].bodies]:
        wide, part = (2.0, 1.0) if body == top else (depth, 0.5)
        line = bridge.whole.surfaces[body][:, :2]
        above = shapely.Polygon([*line, *((x, 99.0) for x in line[[-1, 0], 0])])
        for level, weight in levels:
            earth = above.intersection(shapely.box(-99.0, -99.0, 99.0, level))
            shapes.append((earth, part * weight / 9.80665, wide))
        if body != top:
            shapes.append((shapely.Polygon(bridge.outlines[body]), 1000.0, wide))
    centre = column.centroids[-1, 1]
    found = sum(
        sliced(shape, weight, centre, wide)
        for shape, weight, wide in shapes
        if shape.area > 0.0
    )
    backs = np.array(bridge.whole.backs)[list(bridge.spans[1].bodies), 1]
    load = 0.5 * 5e3 / 9.80665
    found += load * np.array(
        [
            backs.size,
            backs.sum(),
            ((backs - centre) ** 2 + depth**2 / 12.0).sum(),
        ]
    )
    mass, first, turn = found
    assert column.chain.mass[-1] == pytest.approx(mass, rel=1e-6)
    assert centre == pytest.approx(first / mass, rel=1e-6)
    assert column.chain.inertia[-1] == pytest.approx(turn, rel=1e-5)
    # The joint under the share is as wide as the pier, the share as the rings.
    width = np.ptp(column.extrados - column.intrados, axis=0)[0]
    assert width == pytest.approx(1.0)
    assert np.ptp(column.outlines[-1][:, 0]) == depth


def test_courses_are_prisms_with_the_width_of_the_pier_across():
    bridge = af.Bridge(
        [ring(depth=2.5, friction=0.5)] * 2,
        {**PIER, "base_width": 2.0, "friction": 0.8},
    )
    column = bridge.transverse("pier 1")
    np.testing.assert_allclose(column.chain.friction, [0.8, 0.8, 0.8, 0.5])
    ends = np.array([2.0, 2.0 - 0.8 / 3.0, 2.0 - 1.6 / 3.0, 1.2])
    np.testing.assert_allclose(column.depths[:3], 0.5 * (ends[1:] + ends[:-1]))
    np.testing.assert_allclose(np.diff(column.intrados[:4, 1]), 4.0 / 3.0)
    np.testing.assert_allclose(column.intrados[:, 0], 1.25)
    np.testing.assert_allclose(column.extrados[:, 0], -1.25)
    # Of a trapezoid of height h with the sides a, b: h²(a² + 4ab + b²) / (18 (a + b)²).
    a, b = ends[:2]
    tall = (4.0 / 3.0) ** 2 * (a * a + 4 * a * b + b * b) / (18.0 * (a + b) ** 2)
    inertia = column.chain.mass[0] * (tall + 2.5**2 / 12.0)
    assert column.chain.inertia[0] == pytest.approx(inertia, rel=1e-12)


def test_a_drawn_bridge_has_the_same_columns():
    bridge = af.Bridge([ring(depth=2.0)] * 3, PIER)
    faces = [
        [bridge.intrados[joint].tolist(), bridge.extrados[joint].tolist()]
        for joint, _ in bridge.bases.values()
    ]
    drawn = af.Arch.from_polygons(
        [*map(np.ndarray.tolist, bridge.outlines)], 0.6, ground=faces, depth=2.0
    )
    for one, other in zip(columns_of(bridge), columns_of(drawn)):
        np.testing.assert_allclose(one.chain.mass, other.chain.mass, rtol=1e-9)
        np.testing.assert_allclose(one.centroids, other.centroids, atol=1e-9)
        np.testing.assert_allclose(one.chain.inertia, other.chain.inertia, rtol=1e-9)


def test_the_least_of_the_piers_is_named_and_what_governs():
    tall = {**PIER, "height": 6.0}
    narrow = af.Bridge([ring()] * 3, [PIER, tall])
    start = af.onset(narrow)
    name, column = start.transverse
    assert name == "pier 2"
    assert column.plus == af.onset(narrow.transverse("pier 2")).plus < start.plus
    assert f"across {column.plus:.4g} g: pier 2>" in repr(start)
    told = start.transverse_text
    assert "across the bridge pier 2, 1 m deep, with its share" in told
    assert f"moves from {column.plus:.4f} g, along it the bridge moves from" in told
    assert "across governs" in told
    assert "skewed" in told
    assert "spandrel" in told
    assert "three dimensions" in told
    wide = af.onset(af.Bridge([ring(depth=8.0)] * 3, [PIER, tall]))
    assert wide.transverse[1].plus > wide.plus
    assert "along governs" in wide.transverse_text
    alone = af.onset(ring())
    assert alone.transverse is None
    assert alone.transverse_text == ""
    assert "across" not in repr(alone)
    told = af.onset(narrow.transverse("pier 2")).transverse_text
    assert (
        told
        == "the column is pier 2 across the bridge with its share of rings and fill"
    )


def test_the_onset_across_is_that_of_the_bridge_as_built():
    bridge = af.Bridge([ring()] * 2, PIER)
    tied = bridge.recessed(0.01, 0.01).tied(1.0, area=1e-3, prestress=1e4)
    start = af.onset(tied)
    assert start.transverse[1].plus == af.onset(bridge).transverse[1].plus
    assert "across the bridge as it was built pier 1, 1 m deep" in start.transverse_text


@pytest.mark.parametrize("method", ["auto", "time_stepping", "event_driven"])
def test_a_column_runs_by_each_method(method):
    column = af.Bridge([ring(depth=1.5)] * 2, PIER).transverse("pier 1").recessed(0.02)
    pulse = np.where(np.arange(0.0, 0.5, 0.002) < 0.3, 1.0, -0.6)
    motion = af.Motion(pulse, 0.002)
    for scale, falls in ((2.5, False), (20.0, True)):
        run = af.simulate(column, motion, scale=scale, method=method)
        assert run.collapsed is falls


@pytest.mark.parametrize(
    ("arch", "pier", "text"),
    [
        (ring(), "pier 1", "transverse = 'pier 1' is impossible; the arch has no pier"),
        (
            af.Bridge([ring()] * 3, PIER),
            "left pier",
            "transverse = 'left pier' is impossible; it must be pier 1 or pier 2",
        ),
        (
            af.Bridge([ring()], ends=[PIER, None]),
            "right pier",
            "transverse = 'right pier' is impossible; it must be left pier",
        ),
        (
            af.Bridge([ring()] * 2, PIER).tied(1.0, area=1e-3),
            "pier 1",
            "the arch has ties already; transverse comes before",
        ),
    ],
)
def test_what_has_no_column_is_refused(arch, pier, text):
    with pytest.raises(GeometryError) as error:
        arch.transverse(pier)
    assert str(error.value) == text
