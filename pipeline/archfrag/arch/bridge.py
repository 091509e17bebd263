"""Piers, as further bodies of a chain, and the weight of fill and backing on a ring."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import checks
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import (
    cut_sides,
    height_at,
    length_of,
    outline_section,
    polygon_section,
    sampled,
    square_height,
)
from archfrag.arch.ring import Part, Ring
from archfrag.errors import GeometryError
from archfrag.files import Named
from archfrag.properties import MOST_VOUSSOIRS

MOST_SPANS = 30  # up to which the range of rest is found


def check_upright(ring: Ring, free_end: bool) -> None:
    """Raise `GeometryError` unless a ring can carry piers or fill.

    It must be an arch between two springings, with joints from the left and the intrados below.
    """
    back = ring.body is None and ring.intrados[0, 0] >= ring.intrados[-1, 0]
    if free_end or ring.sense < 0 or back:
        raise GeometryError(
            "piers and fill need an arch between two springings, its joints listed "
            "from the left one and its intrados below"
        )


def listed(key: str, given, count: int) -> list[Named]:
    """Return the keys of `count` piers, from one mapping for all or a list; empty where None.

    A key without a value stays None: `over_parts` takes its values from the rings. `GeometryError`
    names the `key` that is impossible.
    """
    if given is None or isinstance(given, Mapping):
        given = [given] * count
    if len(given) != count or (key == "piers" and not all(given)):
        raise GeometryError(
            f"{key} must be one mapping, such as {{height: 5.0, width: 2.0}}, or a list of {count}"
        )
    return [
        _checked(f"{key}[{i}]", **each) if each else {} for i, each in enumerate(given)
    ]


def _checked(
    place: str,
    *,
    height,
    width,
    base_width=None,
    courses=1,
    above=0.0,
    friction=None,
    density=None,
    depth=None,
) -> Named:
    given = {
        "height": height,
        "width": width,
        "base_width": base_width,
        "courses": courses,
        "above": above,
        "friction": friction,
        "density": density,
        "depth": depth,
    }
    found: Named = {
        key: value
        if value is None
        else checks.number(f"piers.{key}", value, name=f"{place}.{key}")
        for key, value in given.items()
    }
    if found["courses"] % 1.0:
        raise GeometryError(
            f"{place}.courses = {courses} is impossible; it must be an integer"
        )
    return found | {"courses": int(courses)}


def over_parts(
    parts: Sequence[Part], values: Sequence[FloatArray | Named], key: str
) -> FloatArray:
    """Return the values of a key of all bodies, or of all joints if it is friction.

    `values` are those of each span, and the keys of each pier. A pier without a value has that of
    the rings beside it, which must agree.
    """
    found: dict[int, float] = {}
    given: Any = values
    for i, (part, own) in enumerate(zip(parts, given)):
        if isinstance(own, Mapping):
            own = _own_or_shared(part, own[key], key, given[:i], given[i + 1 :])
        places = part.joints if key == "friction" else part.every
        found |= zip(places, np.broadcast_to(own, len(places)).tolist())
    return np.array([found[place] for place in range(len(found))])


def _own_or_shared(part: Part, own, key: str, before, after) -> float:
    """Return the value of a pier, or that of the rings beside it; see `over_parts`."""
    if own is not None:
        return float(own)
    near = [ring[-1] for ring in before[-1:]] + [ring[0] for ring in after[:1]]
    if near[0] != near[-1]:
        raise GeometryError(
            f"{part.name} needs its own {key}: the rings beside it have {near[0]:g} and "
            f"{near[1]:g}"
        )
    return float(near[0])


def joined(
    rings: Sequence[Ring], piers: Sequence[Named], ends: Sequence[Named]
) -> Ring:
    """Return the rings with their piers as one ring with its parts.

    Each ring moves so that it springs flush with the face of the pier before it, as high as the
    ring on the other side. `GeometryError` if a pier does not fit.
    """
    if len(rings) == 1 and not any(ends):
        (ring,) = rings
        return ring if ring.parts else assembled([("arch", ring)])
    if any(ring.body is not None for ring in rings):
        raise GeometryError("the blocks are a bridge already; draw its piers too")
    moved = [*rings[:1]]
    for ring, pier in zip(rings[1:], piers):
        face = moved[-1].intrados[-1] + [pier["width"], 0.0]
        moved.append(_moved(ring, face - ring.intrados[0]))
    legs = [_pier([b, a], pier) for pier, a, b in zip(piers, moved, moved[1:])]
    pieces = [(f"pier {k}", cut(leg, slice(-1))) for k, leg in enumerate(legs, 1)]
    if ends[0]:
        pieces.append(("left pier", _pier(moved[:1], ends[0])))
    for k, ring in enumerate(moved, 1):
        pieces.append((f"span {k}", ring))
        for leg in legs[k - 1 : k]:
            pieces.append((f"pier {k}", cut(leg, slice(-1, None), slice(0))))
    if ends[1]:
        down = slice(None, None, -1)
        pieces.append(("right pier", cut(_pier(moved[-1:], ends[1], 1.0), down, down)))
    return assembled(pieces)


def assembled(pieces: Iterable[tuple[str, Ring]]) -> Ring:
    """Return the ring of pieces by their names, in the order of `Chain.body`.

    An inner pier has two pieces: all but its top course, before the spine, and this in the spine.
    """
    parts: dict[str, Part] = {}
    below = 0
    fields: Any = [[], [], [], [], [], []]
    for name, ring in pieces:
        joint, body = len(fields[0]), len(fields[2])
        for whole, own in zip(fields, ring):
            whole.extend(own)
        joints = range(joint, len(fields[0]))
        bodies = range(body, len(fields[2]))
        part = Part(name, joints, bodies)
        if name in parts:
            part = parts.pop(name)._replace(top=bodies[0])
        elif name == "right pier":
            part = Part(name, joints[::-1], bodies[::-1])
        elif name.startswith("pier"):
            below = bodies.stop
        parts[name] = part
    body = len(fields[2])
    if body > MOST_VOUSSOIRS:
        raise GeometryError(
            f"the bridge has {body} bodies; it may have {MOST_VOUSSOIRS}"
        )
    fields[:2] = map(np.array, fields[:2])
    legs = [part.every for name, part in parts.items() if name.startswith("pier")]
    if len(legs) >= MOST_SPANS:
        raise GeometryError(
            f"the bridge has {len(legs) + 1} spans; it may have {MOST_SPANS}: from about five on "
            "more of them change its onset by less than 3 %"
        )
    fields += [ring.sense, _table(legs, below, body) if legs else None]
    return Ring._make([*fields, (*parts.values(),)])


def _table(legs: list[list[int]], below: int, body: int) -> NDArray[np.int64]:
    """Return `Chain.body` of a spine of bodies `below` to ``body - 1`` on legs of given bodies."""
    paths = [[body + k, *leg] for k, leg in enumerate(legs)]
    paths.append([-1, *range(below, body), body + len(legs)])
    return np.array([pair for path in paths for pair in pairwise(path)])


def cut(ring: Ring, bodies: slice, joints: slice = slice(None)) -> Ring:
    """Return some bodies and some joints of a ring."""
    fields: Any = [field[joints] for field in ring[:2]]
    fields += [field[bodies] for field in ring[2:6]]
    return Ring._make([*fields, ring.sense, None, ()])


def _moved(ring: Ring, shift: FloatArray) -> Ring:
    """Return a ring elsewhere, by `shift` (2,) [m]."""
    return Ring(
        ring.intrados + shift,
        ring.extrados + shift,
        [(area, centroid + shift, polar) for area, centroid, polar in ring.sections],
        [outline + shift for outline in ring.outlines],
        [back + shift for back in ring.backs],
        [surface + np.append(shift, 0.0) for surface in ring.surfaces],
        ring.sense,
    )


def _pier(rings: Sequence[Ring], pier: Named, side: float = -1.0) -> Ring:
    """Return the joints and courses of one pier, from its base up.

    `rings` are the ring on it, or those right and left of an inner pier. An outer pier is upright
    below the intrados and reaches from there to its `side`; both faces of an inner pier lean
    alike. Joints are level; the top course is cut to the skewbacks. `GeometryError` if it does not
    fit.
    """
    skewbacks = [
        (ring.intrados[end], ring.extrados[end])
        for ring, end in zip(rings, (0, -1) if side < 0.0 else (-1,))
    ]
    inner = [start for start, _ in skewbacks]
    outer = [end for _, end in skewbacks]
    keys = ("height", "width", "base_width", "above", "courses")
    height, width, base_width, above, courses = (pier[key] for key in keys)
    base_width = width if base_width is None else base_width
    base = inner[0][1] - height
    tops = [end[1] + above for end in outer]
    if above > 0.0:
        tops = [max(tops)] * len(tops)
    level = base + height * np.arange(courses) / courses
    full = tops[0] if len(rings) == 1 else inner[0][1]

    def out(y):
        return base_width + (width - base_width) * (y - base) / (full - base)

    if len(rings) == 1:
        _check_pier(
            rings, skewbacks, pier, side, level[-1], min(width, out(outer[0][1]))
        )
        faces = np.full(courses, inner[0][0]), inner[0][0] + side * out(level)
        upper = [[outer[0][0], tops[0]], [inner[0][0] + side * width, tops[0]]]
    else:
        _check_pier(rings, skewbacks, pier, side, level[-1], width)
        lean = 0.5 * side * (out(level) - width)
        faces = inner[0][0] - lean, inner[1][0] + lean
        upper = [[end[0], top] for end, top in zip(outer, tops)]
    inside, outside = (np.column_stack([face, level]) for face in faces)
    crest = [
        inside[-1],
        inner[0],
        outer[0],
        *upper,
        *outer[1:],
        *inner[1:],
        outside[-1],
    ]
    outlines = _courses(inside, outside, crest, 1e-9 * width)
    sections = [polygon_section(each) for each in outlines]
    backs = [centroid for _, centroid, _ in sections]
    surface = np.pad(upper[:: int(side)], ((0, 0), (0, 1)))
    surfaces = [np.empty((0, 3))] * (courses - 1) + [surface]
    return Ring(inside, outside, sections, outlines, backs, surfaces, 1)


def _courses(
    inside: FloatArray, outside: FloatArray, crest: list[FloatArray], least: float
) -> list[FloatArray]:
    """Return the outlines of courses between two faces; the last one has corners `crest`.

    Corners nearer than `least` [m] are one.
    """
    pairs = zip(pairwise(inside), pairwise(outside))
    apart = [length_of(np.array(line)) > least for line in pairwise(crest)]
    outlines = [np.array([*inner, *outer[::-1]]) for inner, outer in pairs]
    return [*outlines, np.array(crest)[[True, *apart]]]


def _check_pier(
    rings, skewbacks, pier: Named, side: float, bed: float, wide: float
) -> None:
    """Raise `GeometryError` unless a pier fits its skewbacks.

    `bed` is the level of its last bed, `wide` its least width at the skewbacks [m]; the other
    arguments are those of `_pier`.
    """
    name = f"the {'left' if side < 0.0 else 'right'} pier"
    if len(rings) > 1:
        name = "an inner pier"
    slip = 1e-9 * pier["width"]
    reaches, bulges = [], []
    for sense, ring, (inner, outer) in zip((side, -side), rings, skewbacks):
        if bed >= outer[1]:
            raise GeometryError(
                f"the springing joint on {name} reaches down to {outer[1]:.6g} m, below its last "
                f"bed at {bed:.6g} m; the pier must have fewer courses or more height"
            )
        reaches.append(sense * (outer[0] - inner[0]))
        bulges.append(
            (sense * np.concatenate(ring.outlines)[:, 0]).max() - sense * inner[0]
        )
    if min(reaches) < -slip or sum(reaches) > wide + slip:
        texts = " and ".join(f"{reach:.6g}" for reach in reaches)
        raise GeometryError(
            f"width = {pier['width']:g} m of {name} is impossible; the springing joints on it "
            f"reach {texts} m over it, which must be from 0 to its width there"
        )
    if sum(bulges) > pier["width"] + slip and len(rings) > 1:
        raise GeometryError(
            f"width = {pier['width']:g} m of {name} is impossible; the rings overlap above it"
        )
    if pier["above"] > 0.0 and np.any(np.subtract(bulges, reaches) > slip):
        raise GeometryError(f"above of {name} must be 0, where a ring bulges over it")


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
    ring: Ring, fill: dict[str, float], depth: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the weight of fill and backing on each body, and where it acts.

    Shapes are ``(n,)`` [N] and ``(n, 2)`` [m]; `depth` is that of each body [m]. The column above
    each body reaches from the upward sides of its extrados to the level of the fill. With the
    areas A and first moments S of the columns up to the levels of the fill and of the backing,

        W = b (g_f A_f + (g_b - g_f) A_b),   x = b (g_f S_f + (g_b - g_f) S_b) / W.

    The weight acts on the extrados at x, where the fill hands its force to the ring: columns lean
    on each other, so that no voussoir carries the overturning moment of the column above it.
    `GeometryError` if the backing reaches above the fill.
    """
    weight = np.zeros(len(depth))
    place = np.array(ring.backs)
    for body, both in enumerate(moments_of_fill(ring, fill)):
        if both[0] > 0.0:
            x = both[1] / both[0]
            weight[body] = both[0] * depth[body]
            place[body] = x, height_at(ring.surfaces[body], x)
    return weight, place


def moments_of_fill(ring: Ring, fill: dict[str, float]) -> FloatArray:
    """Return the integrals of unit weight times 1, x, y and y² over the fill above each body.

    The shape is ``(n, 4)`` [N/m, N, N, N m]. `GeometryError` if the backing reaches above the
    fill.
    """
    spans = [part for part in ring.parts if "pier" not in part.name]
    backs = [ring.surfaces[body] for span in spans for body in span.bodies]
    crown = max(
        point[1] for line in backs for side in cut_sides(line) for point in side
    )
    ends = [span.joints[end] for span in spans for end in (0, -1)]
    springing = 0.5 * (ring.intrados + ring.extrados)[ends, 1].min()
    level = crown + fill["height_over_crown"]
    backed = springing + fill["backing_height"]
    if backed > level and fill["backing_height"] > 0.0:
        raise GeometryError(
            f"fill.backing_height = {fill['backing_height']:g} m reaches above the "
            f"fill; it must be at most {level - springing:.6g} m"
        )
    more = fill["backing_unit_weight"] - fill["unit_weight"]
    unit = fill["unit_weight"]
    return np.array(
        [
            unit * _column(line, level) + more * _column(line, backed)
            for line in ring.surfaces
        ]
    )


def _column(line: FloatArray, level: float) -> FloatArray:
    """Return the integrals of 1, x, y and y² between a line and a level above [m2, m3, m3, m4].

    Only those sides of the line ``(m, 3)`` count that run to the right, below the level.
    """
    found = np.zeros(4)
    for start, end in cut_sides(line, (level,)):
        if end[0] > start[0] and 0.5 * (start[1] + end[1]) < level:
            rest = [[end[0], end[1], 0.0], [end[0], level, 0.0], [start[0], level, 0.0]]
            outline = np.array([start, *rest])
            area, (x, y), _ = outline_section(outline)
            found += area * np.array(
                [1.0, x, y, y**2 + square_height(sampled(outline))]
            )
    return found
