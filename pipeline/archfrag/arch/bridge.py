"""Piers, as further bodies of a chain, and the weight of fill and backing on a ring."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from archfrag.arch import checks
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import (
    cut_sides,
    height_at,
    outline_section,
    polygon_section,
)
from archfrag.arch.ring import Ring
from archfrag.errors import GeometryError
from archfrag.files import Named
from archfrag.properties import MOST_VOUSSOIRS

Piers = Named  # of each key two values, left and right pier, or None
_SIDES = ((-1.0, "left"), (1.0, "right"))


def check_upright(ring: Ring, free_end: bool) -> None:
    """Raise `GeometryError` unless a ring can carry piers or fill.

    It must be an arch between two springings, with joints from the left and the intrados below.
    """
    if free_end or ring.sense < 0 or ring.intrados[0, 0] >= ring.intrados[-1, 0]:
        raise GeometryError(
            "piers and fill need an arch between two springings, its joints listed "
            "from the left one and its intrados below"
        )


def checked_piers(
    height,
    width,
    base_width=None,
    courses=1,
    above=0.0,
    friction=None,
    density=None,
    depth=None,
) -> Piers:
    """Return the values of each key of `piers`: those of the left and the right pier.

    The arguments are those of `Arch.on_piers`; a single number counts for both piers. A key
    without a value stays None: `extended` takes its values from the ring. `GeometryError` if a
    value is impossible.
    """
    given = {
        "height": height,
        "width": width,
        "base_width": width if base_width is None else base_width,
        "above": above,
        "friction": friction,
        "density": density,
        "depth": depth,
        "courses": courses,
    }
    found: Piers = {
        name: value
        if value is None
        else checks.shared_or_each(f"piers.{name}", value, 2, "pier").tolist()
        for name, value in given.items()
    }
    count = np.array(found["courses"])
    if (count % 1.0).any() or count.sum() > MOST_VOUSSOIRS:
        raise GeometryError(
            f"piers.courses = {found['courses']} is impossible; it must be integers, "
            f"together at most {MOST_VOUSSOIRS}"
        )
    return found | {"courses": count.astype(int).tolist()}


def extended(values: FloatArray, piers: Piers, name: str) -> FloatArray:
    """Return the values of all bodies, or joints: left pier, ring, right pier.

    `values` are those of the ring. Each course of a pier has its value in ``piers[name]``; if this
    is None, it has the first or the last value of the ring.
    """
    own = piers[name] or values[[0, -1]]
    left, right = (np.full(n, each) for n, each in zip(piers["courses"], own))
    return np.concatenate([left, values, right])


def on_piers(ring: Ring, piers: Piers) -> Ring:
    """Return the ring with the bodies of two piers, from the left base to the right one."""
    left, right = (_pier(ring, place, piers) for place in (0, 1))
    fields: Any = zip(left[:-1], ring[:-1], right[:-1])
    inner, outer, *rows = ([*one, *two, *three[::-1]] for one, two, three in fields)
    return Ring._make([np.array(inner), np.array(outer), *rows, ring.sense])


def _pier(ring: Ring, place: int, piers: Piers) -> Ring:
    """Return the joints and courses of one pier, from its base up.

    `place` is 0 for the left pier, 1 for the right one. Joints are level; the top course is cut to
    the skewback. `GeometryError` if the pier does not fit it.
    """
    side, name = _SIDES[place]
    end = -place
    keys = ("height", "width", "base_width", "above")
    height, width, base_width, above = (piers[key][place] for key in keys)
    inner = ring.intrados[end]
    outer = ring.extrados[end]
    courses = piers["courses"][place]
    base = inner[1] - height
    top = outer[1] + above
    reach = side * (outer[0] - inner[0])
    level = base + height * np.arange(courses) / courses
    slip = 1e-9 * width
    if level[-1] >= outer[1]:
        raise GeometryError(
            f"piers: the {name} springing joint reaches down to {outer[1]:.6g} m, "
            f"below the last bed at {level[-1]:.6g} m; the pier must have fewer "
            "courses or more height"
        )

    def out(y):
        return base_width + (width - base_width) * (y - base) / (top - base)

    if not -slip <= reach <= min(width, out(outer[1])) + slip:
        raise GeometryError(
            f"piers.width = {width:g} m is impossible; the {name} springing joint "
            f"reaches {reach:.6g} m outwards, which must be from 0 to the width of "
            "the pier there"
        )
    if (
        above > 0.0
        and (side * np.concatenate(ring.outlines)[:, 0]).max() > side * outer[0] + slip
    ):
        raise GeometryError(
            f"piers.above must be 0 on the {name}, where the ring bulges outwards"
        )
    inside = np.column_stack([np.full(courses, inner[0]), level])
    outside = np.column_stack([inner[0] + side * out(level), level])
    upper = np.array([[outer[0], top], [inner[0] + side * width, top]])
    upper = upper[[above > 0.0, width - reach > slip]]
    outlines = [
        np.vstack([inside[i : i + 2], outside[i : i + 2][::-1]]) for i in range(courses)
    ]
    outlines[-1] = np.vstack([inside[-1], inner, outer, upper, outside[-1]])
    sections = [polygon_section(each) for each in outlines]
    backs = [centroid for _, centroid, _ in sections]
    surface = np.array([[*outlines[-1][-2], 0.0], [outer[0], top, 0.0]])[:: -int(side)]
    surfaces = [np.empty((0, 3))] * (courses - 1) + [surface]
    return Ring(inside, outside, sections, outlines, backs, surfaces, ring.sense)


def checked_fill(
    height_over_crown,
    unit_weight,
    backing_height=0.0,
    backing_unit_weight=None,
    inertia=1.0,
) -> dict[str, float]:
    """Check the arguments of `Arch.filled` and return them by key, with defaults."""
    if backing_unit_weight is None:
        if backing_height != 0.0:
            raise GeometryError(
                "fill.backing_unit_weight must be given with a backing_height"
            )
        backing_unit_weight = unit_weight
    if inertia != 1.0:
        raise GeometryError(
            f"fill.inertia = {inertia} is impossible; it must be 1: a voussoir has "
            "one mass, and what weighs on it also moves with it"
        )
    given = {
        "height_over_crown": height_over_crown,
        "unit_weight": unit_weight,
        "backing_height": backing_height,
        "backing_unit_weight": backing_unit_weight,
    }
    numbers = {key: checks.number(f"fill.{key}", value) for key, value in given.items()}
    return numbers | {"inertia": 1.0}


def fill_weighs(fill: Mapping[str, Any]) -> bool:
    """Return whether the fill or its backing has a weight."""
    backing = fill.get("backing_height", 0.0) * (fill.get("backing_unit_weight") or 0.0)
    return bool(fill["unit_weight"] or backing)


def weight_of_fill(
    ring: Ring, springings: tuple[int, int], fill: dict[str, float], depth: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the weight of fill and backing on each body, and where it acts.

    Shapes are ``(n,)`` [N] and ``(n, 2)`` [m]. `springings` are the first and the last joint of
    the ring; `depth` is that of each body [m]. The column above each body reaches from the upward
    sides of its extrados to the level of the fill. With the areas A and first moments S of the
    columns up to the levels of the fill and of the backing,

        W = b (g_f A_f + (g_b - g_f) A_b),   x = b (g_f S_f + (g_b - g_f) S_b) / W.

    The weight acts on the extrados at x, where the fill hands its force to the ring: columns lean
    on each other, so that no voussoir carries the overturning moment of the column above it.
    `GeometryError` if the backing reaches above the fill.
    """
    first, last = springings
    sides = (side for line in ring.surfaces[first:last] for side in cut_sides(line))
    crown = max(point[1] for side in sides for point in side)
    springing = 0.5 * (ring.intrados + ring.extrados)[[first, last], 1].min()
    level = crown + fill["height_over_crown"]
    backed = springing + fill["backing_height"]
    if backed > level and fill["backing_height"] > 0.0:
        raise GeometryError(
            f"fill.backing_height = {fill['backing_height']:g} m reaches above the "
            f"fill; it must be at most {level - springing:.6g} m"
        )
    more = fill["backing_unit_weight"] - fill["unit_weight"]
    weight = np.zeros(len(depth))
    place = np.array(ring.backs)
    for body, line in enumerate(ring.surfaces):
        both = fill["unit_weight"] * _column(line, level) + more * _column(line, backed)
        if both[0] > 0.0:
            x = both[1] / both[0]
            weight[body] = both[0] * depth[body]
            place[body] = x, height_at(line, x)
    return weight, place


def _column(line: FloatArray, level: float) -> FloatArray:
    """Return area and first moment of x between a line and a level above [m2, m3].

    Only those sides of the line ``(m, 3)`` count that run to the right, below the level.
    """
    found = np.zeros(2)
    for start, end in cut_sides(line, (level,)):
        if end[0] > start[0] and 0.5 * (start[1] + end[1]) < level:
            rest = [[end[0], end[1], 0.0], [end[0], level, 0.0], [start[0], level, 0.0]]
            area, centroid, _ = outline_section(np.array([start, *rest]))
            found += area * np.array([1.0, centroid[0]])
    return found
