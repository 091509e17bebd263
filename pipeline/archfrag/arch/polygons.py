"""Chains from simple polygons: edges that two blocks share become joints. It needs shapely."""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import checks
from archfrag.arch.geometry import cross, place_text
from archfrag.arch.outlines import (
    TOLERANCE,
    Drawing,
    anticlockwise,
    back_middle,
    outline_section,
    places_along,
    sampled,
    sides_of,
    stretched,
)
from archfrag.arch.profiles import JointLines
from archfrag.arch.ring import Ring, Voussoir
from archfrag.errors import GeometryError, from_extra

FloatArray = NDArray[np.float64]
SHORTEST = 10.0  # joint, in tolerances
_Segment = FloatArray  # (2, 2): end, xy


@dataclass
class _Polygons:
    """Blocks on the way to a chain."""

    drawn: Drawing  # its outlines anticlockwise
    tolerance: float
    # Of each block: the other blocks with the joint, along its own edges.
    joints: list[dict[int, _Segment]] = field(default_factory=list)
    standing: dict[int, _Segment] = field(default_factory=dict)

    def refuse(self, block: int, text: str) -> NoReturn:
        raise GeometryError(f"{self.drawn.names[block]} {text}")


def polygon_shape(
    drawn: Drawing, tolerance: float | None, thickness_factor: float
) -> tuple[dict[str, Any], Ring, bool]:
    """Outlines and ground for `Arch.parameters`, ring, and whether an end is free."""
    factor = checks.number("thickness_factor", thickness_factor, "")
    if tolerance is not None:
        tolerance = checks.number("tolerance", tolerance)
    ring, placed, free = polygon_ring(drawn, tolerance)
    if factor != 1.0:
        placed, lines = stretched(placed, ring, factor), _ends(ring, free)
        lines = [line.mean(axis=0) + factor * (line - line.mean(axis=0)) for line in lines]
        ring, placed, free = polygon_ring(Drawing.from_points(placed, lines), tolerance)
    ground = [line.tolist() for line in _ends(ring, free)]
    return {"outlines": [outline.tolist() for outline in placed], "ground": ground}, ring, free


def _ends(ring: Ring, free: bool) -> list[_Segment]:
    """Lines on which the ends of a ring stand."""
    ends = (0,) if free else (0, len(ring.voussoirs))
    return [np.array([side[k] for side in ring.lines[:2]]) for k in ends]


def polygon_ring(
    drawn: Drawing, tolerance: float | None = None
) -> tuple[Ring, list[FloatArray], bool]:
    """Ring of blocks in any order: joints are the edges that two have in common.

    Parameters
    ----------
    drawn : archfrag.arch.outlines.Drawing
    tolerance : float, optional
        Within which corners and edges are the same [m]; `TOLERANCE` of the size if not given.

    Returns
    -------
    ring : Ring
        From the end that stands further left; up from the ground where one end is free.
    outlines : list of (m, 3) ndarray
        In that order, anticlockwise.
    free_end : bool

    Raises
    ------
    GeometryError
        Naming the block that is no simple polygon, overlaps, or does not fit into one chain.
    """
    outlines = drawn.outlines
    if not 0 < len(outlines) <= checks.MOST_VOUSSOIRS:
        raise GeometryError(
            f"{len(outlines)} outlines make no chain; there must be 1 to {checks.MOST_VOUSSOIRS}"
        )
    every = np.concatenate([outline[:, :2] for outline in outlines])
    size = float(np.hypot(*np.ptp(every, axis=0)))
    given = _Polygons(
        replace(drawn, outlines=[anticlockwise(outline) for outline in outlines]),
        TOLERANCE * size if tolerance is None else tolerance,
    )
    _check_simple(given)
    _find_joints(given)
    order = _walk(given)
    free = len(given.standing) == 1
    segments = [given.standing[order[0]]]
    segments += [given.joints[after][before] for before, after in pairwise(order)]
    # Along the first edge of an anticlockwise block one comes from its extrados to its intrados.
    lines = [segment[::-1] for segment in segments]
    last = order[-1]
    lines.append(_far_side(given, last, lines[-1]) if free else given.standing[last])
    ends = np.array(lines)
    chain = JointLines(ends[:, 0].copy(), ends[:, 1].copy())
    placed = [given.drawn.outlines[block] for block in order]
    for place, block in enumerate(order[: len(order) - free]):
        for side in chain[:2]:
            if np.hypot(*(side[place + 1] - side[place])) <= given.tolerance:
                given.refuse(block, f"has two joints that meet at {place_text(side[place])}")
    figures = [
        Voussoir(outline_section(outline), sampled(outline), back_middle(outline, chain, i))
        for i, outline in enumerate(placed)
    ]
    return Ring(figures, chain, 1), placed, free


def _check_simple(given: _Polygons) -> None:
    """Refuse outlines that cross themselves, have no area, or overlap."""
    shapely = from_extra("shapely", "drawing")
    points = [sampled(outline) for outline in given.drawn.outlines]
    shapes = np.array([shapely.Polygon(p) if len(p) > 2 else shapely.Polygon() for p in points])
    least = given.tolerance
    for block, shape in enumerate(shapes):
        if not shape.is_valid:
            where = shapely.is_valid_reason(shape).partition("[")[2].rstrip("]").replace(" ", ", ")
            given.refuse(block, f"crosses or touches itself at ({where}); it must be simple")
    # A block without its rim: overlaps of a tolerance leave nothing in common.
    cores = shapely.buffer(shapes, -least, join_style="mitre")
    for block, core in enumerate(cores):
        if core.is_empty:
            given.refuse(block, f"has no area: nowhere is it wider than {2.0 * least:.3g} m")
    first, second = shapely.STRtree(cores).query(cores, predicate="intersects")
    for one, other in zip(first, second):
        if one < other:
            common = shapely.intersection(shapes[one], shapes[other]).area
            alike = common > 0.999 * max(shapes[one].area, shapes[other].area)
            what = "is the same block as" if alike else f"overlaps by {common:.3g} m2 with"
            given.refuse(one, f"{what} {given.drawn.names[other]}")


def _find_joints(given: _Polygons) -> None:
    """Joints of blocks with each other and with the ground."""
    shapely = from_extra("shapely", "drawing")
    drawn, count = given.drawn, len(given.drawn.outlines)
    edges, owner = _straight_edges(drawn)
    tree = shapely.STRtree(shapely.linestrings(edges))
    shared: dict[tuple[int, int], list[_Segment]] = {}
    near = tree.query(tree.geometries, predicate="dwithin", distance=given.tolerance)
    for one, other in near.T:
        if owner[one] < min(owner[other], count):
            common = _common(edges[one], edges[other][::-1], given.tolerance)
            if common is not None:
                shared.setdefault((owner[one], owner[other]), []).append(common)
    given.joints = [{} for _ in drawn.outlines]
    for (one, other), parts in shared.items():
        if other < count:
            segment = _one_line(parts, given.tolerance)
            if segment is None:
                given.refuse(
                    one,
                    f"and {drawn.names[other]} meet along {len(parts)} edges not on one line; a "
                    "joint must be straight",
                )
            given.joints[one][other], given.joints[other][one] = segment, segment[::-1]
    for line, name in enumerate(drawn.ground_names, count):
        blocks = [one for one, other in shared if other == line]
        if len(blocks) != 1:
            listed = ", ".join(drawn.names[block] for block in blocks) or "none"
            raise GeometryError(
                f"{name} must be on a straight edge of one block, on which it stands on the "
                f"ground; it is on edges of: {listed}"
            )
        block = blocks[0]
        before = [given.standing[block]] if block in given.standing else []
        straight = _one_line(shared[block, line] + before, given.tolerance)
        if straight is None:
            given.refuse(block, f"stands on two lines, {name} the second; it must be one")
        given.standing[block] = straight


def _straight_edges(drawn: Drawing) -> tuple[FloatArray, list[int]]:
    """Straight sides ``(n, 2, 2)`` of blocks along their outlines, then ground lines both ways.

    With the block of each, or the number of blocks plus that of the line.
    """
    edges, owner = [], []
    for block, outline in enumerate(drawn.outlines):
        pairs = np.stack([outline[:, :2], np.roll(outline[:, :2], -1, axis=0)], axis=1)
        edges.append(pairs[outline[:, 2] == 0.0])
        owner += [block] * len(edges[-1])
    for number, line in enumerate(drawn.ground, len(drawn.outlines)):
        edges.append(np.stack([line[::-1], line]))
        owner += [number, number]
    return np.concatenate(edges), owner


def _common(edge: _Segment, other: _Segment, tolerance: float) -> _Segment | None:
    """What two edges of one direction have in common, along the first; None if nothing."""
    length = float(np.hypot(*(edge[1] - edge[0])))
    unit = (edge[1] - edge[0]) / length
    place = (other - edge[0]) @ unit
    if min(length, place[1]) - max(0.0, place[0]) < SHORTEST * tolerance:
        return None
    ends = []
    # How far each end of the other lies inside the edge.
    for k, inside in ((0, place[0]), (1, length - place[1])):
        if abs(inside) <= tolerance:
            ends.append((edge[k], other[k]))
        elif inside > 0.0:
            ends.append((other[k], _foot(edge, other[k])))
        else:
            ends.append((edge[k], _foot(other, edge[k])))
    if any(np.hypot(*(one - two)) > tolerance for one, two in ends):
        return None
    return np.array([0.5 * (one + two) for one, two in ends])


def _foot(line: _Segment, point: FloatArray) -> FloatArray:
    """Point of a line nearest to a point ``(2,)``."""
    step = line[1] - line[0]
    return line[0] + ((point - line[0]) @ step) / (step @ step) * step


def _one_line(parts: list[_Segment], tolerance: float) -> _Segment | None:
    """From end to end of segments of one direction; None if they are not on one line."""
    if len(parts) == 1:
        return parts[0]
    points = np.concatenate(parts)
    unit = parts[0][1] - parts[0][0]
    unit /= np.hypot(*unit)
    place = (points - points[0]) @ unit
    ends = points[[int(np.argmin(place)), int(np.argmax(place))]]
    off = np.abs(cross(points - ends[0], (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))))
    return ends if off.max() <= 2.0 * tolerance else None


def _walk(given: _Polygons) -> list[int]:
    """Blocks from one end to the other; adds the lines on which ends stand if none is given."""
    count, names = len(given.drawn.outlines), given.drawn.names
    for block, joints in enumerate(given.joints):
        if len(joints) > 2:
            others = ", ".join(names[other] for other in joints)
            given.refuse(block, f"has {len(joints)} joints, with {others}; it may have two")
    ends = [block for block, joints in enumerate(given.joints) if len(joints) < 2]
    if not ends:
        given.refuse(0, "and all others form a closed ring; a chain must have two ends")
    for block in given.standing:
        if block not in ends:
            given.refuse(block, "stands on the ground between two joints; only ends may")
    order = [ends[0]]
    while ahead := [other for other in given.joints[order[-1]] if other not in order[-2:]]:
        order.append(ahead[0])
    if len(order) < count:
        _refuse_gap(given, order)
    if not given.standing:
        if count == 1:
            given.refuse(0, "is the only block; a LINE must show the edge it stands on")
        for end, near in ((order[0], order[1]), (order[-1], order[-2])):
            given.standing[end] = _opposite(given, end, given.joints[end][near])
    first, last = (given.standing.get(order[k]) for k in (0, -1))
    if first is None or (
        count > 1 and last is not None
        and tuple(last.mean(axis=0)) < tuple(first.mean(axis=0))
    ):  # fmt: skip
        order.reverse()
    return order


def _refuse_gap(given: _Polygons, order: list[int]) -> NoReturn:
    """Refuse blocks that do not hang together, by the two at the narrowest gap."""
    shapely = from_extra("shapely", "drawing")
    shapes = [shapely.Polygon(sampled(outline)) for outline in given.drawn.outlines]
    apart = set(range(len(shapes))) - set(order)
    gap, one, other = min(
        (shapes[one].distance(shapes[other]), one, other) for one in order for other in apart
    )
    name = given.drawn.names[other]
    touching = f"touches {name} but has no edge in common with it"
    away = f"has no edge in common with {name}, {gap:.3g} m away"
    given.refuse(
        one,
        f"{touching if gap <= given.tolerance else away}; all must form one chain, and edges of "
        f"neighbours agree to {given.tolerance:.3g} m",
    )


def _opposite(given: _Polygons, block: int, joint: _Segment) -> _Segment:
    """Side of an end block opposite to its joint, which must be one of four and straight."""
    outline = given.drawn.outlines[block]
    sides = sides_of(outline)
    along, middle, _ = places_along(outline, joint.mean(axis=0)[None])
    here = int(np.searchsorted(along, middle[0], "right")) - 1
    if len(sides) == 4:
        own = next(i for i, side in enumerate(sides) if here in side)
        edges = sides[(own + 2) % 4]
        pairs = [outline[[edge, (edge + 1) % len(outline)], :2] for edge in edges]
        straight = None if outline[edges, 2].any() else _one_line(pairs, given.tolerance)
        if straight is not None:
            return straight
    given.refuse(
        block,
        f"is an end of the chain and has {len(sides)} sides, of which none is straight and "
        "opposite to its joint; a LINE must show the edge it stands on",
    )


def _far_side(given: _Polygons, block: int, joint: _Segment) -> _Segment:
    """Edge of a free end that is farthest from the line of its joint, intrados first."""
    corners = given.drawn.outlines[block][:, :2]
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    away = np.abs(cross(edges.mean(axis=1) - joint[0], joint[1] - joint[0]))
    return edges[int(np.argmax(away))]
