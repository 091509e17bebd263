"""Chains from simple polygons: edges that two blocks share become joints. It needs shapely."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import checks
from archfrag.arch.geometry import (
    anticlockwise,
    common_part,
    cross,
    middle_of,
    one_line,
    outline_section,
    place_text,
    places_along,
    sampled,
)
from archfrag.arch.ring import JointLines, Ring
from archfrag.errors import GeometryError, from_extra

FloatArray = NDArray[np.float64]
TOLERANCE = 1e-5  # of the size of all, within which corners and edges are the same
_SMOOTH = math.radians(30.0)  # corners of a smaller angle are inside a side, as of a drawn arc
_Segment = FloatArray  # (2, 2): end, xy


@dataclass
class Blocks:
    """Blocks and the lines on which they stand [m], with their names for messages."""

    outlines: list[FloatArray]  # (m, 3) each: corners x, y and bulge
    ground: list[_Segment]  # none where ends stand opposite to their joints
    names: list[str]  # of the blocks
    ground_names: list[str]
    tolerance: float = 0.0  # within which corners and edges are the same [m]
    # On the way to a chain, of each block: the other blocks with the joint, along its own edges.
    joints: list[dict[int, _Segment]] = field(default_factory=list)
    standing: dict[int, _Segment] = field(default_factory=dict)

    @classmethod
    def from_points(cls, outlines: Sequence[Any], ground: Sequence[Any]) -> Self:
        """Blocks and lines that a user gives as lists of points, checked."""
        names = [f"outlines[{i}]" for i in range(len(outlines))]
        lines = [f"ground[{i}]" for i in range(len(ground))]
        return cls(
            [_checked_corners(rows, name, 3) for rows, name in zip(outlines, names)],
            [_checked_corners(rows, name, 2)[:, :2] for rows, name in zip(ground, lines)],
            names,
            lines,
        )

    def refuse(self, block: int, text: str) -> NoReturn:
        raise GeometryError(f"{self.names[block]} {text}")


def _checked_corners(rows: Any, name: str, widest: int) -> FloatArray:
    """Corners ``(m, 3)`` from x, y or x, y, bulge, without repeated ones."""
    why = "points (x, y), or (x, y, bulge) for a side that is an arc"
    corners = checks.points(name, rows, 2, why, widest)
    full = np.zeros((len(corners), 3))
    full[:, : corners.shape[1]] = corners
    apart = np.hypot(*(np.roll(full[:, :2], -1, axis=0) - full[:, :2]).T) > 0.0
    if apart.sum() < 2:
        raise GeometryError(f"{name} has no length: all its points coincide")
    return full[apart]


def polygon_shape(
    drawn: Blocks, tolerance: float | None, thickness_factor: float
) -> tuple[dict[str, Any], Ring, bool]:
    """Outlines and ground for `Arch.parameters`, ring, and whether an end is free."""
    factor = checks.number("thickness_factor", thickness_factor, "")
    if tolerance is not None:
        tolerance = checks.number("tolerance", tolerance)
    ring, placed, free = polygon_ring(drawn, tolerance)
    if factor != 1.0:
        lines = [line.mean(axis=0) + factor * (line - line.mean(axis=0))
                 for line in _ends(ring, free)]  # fmt: skip
        thicker = Blocks.from_points(_stretched(placed, ring, factor), lines)
        ring, placed, free = polygon_ring(thicker, tolerance)
    ground = [line.tolist() for line in _ends(ring, free)]
    return {"outlines": [outline.tolist() for outline in placed], "ground": ground}, ring, free


def _ends(ring: Ring, free: bool) -> list[_Segment]:
    """Lines on which the ends of a ring stand."""
    ends = (0,) if free else (0, len(ring.outlines))
    return [np.array([side[k] for side in ring.lines[:2]]) for k in ends]


def _stretched(outlines: Sequence[FloatArray], ring: Ring, factor: float) -> list[FloatArray]:
    """Outlines whose joints are longer by a factor about their middles; sides follow evenly.

    Arcs keep their angle: a circular ring stays one, with the thickness times the factor.
    """
    middle = 0.5 * (ring.lines.intrados + ring.lines.extrados)
    tolerance = 2.0 * TOLERANCE * float(np.hypot(*np.ptp(np.concatenate(ring.lines[:2]), axis=0)))
    result = []
    for i, outline in enumerate(outlines):
        ends = np.array([side[k] for k in (i, i + 1) for side in ring.lines[:2]])
        moves = (factor - 1.0) * (ends - np.repeat(middle[i : i + 2], 2, axis=0))
        apart = np.hypot(*(ends[:, None] - outline[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
        if apart.max() > tolerance:
            raise GeometryError(
                f"thickness_factor = {factor:g} is impossible: voussoir {i} is wider than one of "
                "its joints; every joint must reach across both of its voussoirs"
            )
        along, places, total = places_along(outline, ends)
        moved = outline.copy()
        for axis in (0, 1):
            moved[:, axis] += np.interp(along, places, moves[:, axis], period=total)
        result.append(moved)
    return result


def polygon_ring(
    drawn: Blocks, tolerance: float | None = None
) -> tuple[Ring, list[FloatArray], bool]:
    """Ring of blocks in any order, their outlines in its order, and whether an end is free.

    Joints are the edges that two blocks have in common. The ring runs from the end that stands
    further left, or up from the ground if one end is free; outlines are anticlockwise.
    `tolerance` [m] is `TOLERANCE` of the size if not given. `GeometryError` names the block that
    is no simple polygon, overlaps, or does not fit into one chain.
    """
    outlines = drawn.outlines
    if not 0 < len(outlines) <= checks.MOST_VOUSSOIRS:
        raise GeometryError(
            f"{len(outlines)} outlines make no chain; there must be 1 to {checks.MOST_VOUSSOIRS}"
        )
    every = np.concatenate([outline[:, :2] for outline in outlines])
    size = float(np.hypot(*np.ptp(every, axis=0)))
    given = replace(
        drawn,
        outlines=[anticlockwise(outline) for outline in outlines],
        tolerance=TOLERANCE * size if tolerance is None else tolerance,
        standing={},
    )
    _check_simple(given)
    _find_joints(given)
    order = _walk(given)
    free = len(given.standing) == 1
    segments = [given.standing[order[0]]]
    segments += [given.joints[after][before] for before, after in pairwise(order)]
    # Along the first edge of an anticlockwise block one comes from its extrados to its intrados.
    ends = [segment[::-1] for segment in segments]
    last = order[-1]
    ends.append(_far_side(given, last, ends[-1]) if free else given.standing[last])
    intrados, extrados = (np.array([end[k] for end in ends]) for k in (0, 1))
    for place, block in enumerate(order[: len(order) - free]):
        for side in (intrados, extrados):
            if np.hypot(*(side[place + 1] - side[place])) <= given.tolerance:
                given.refuse(block, f"has two joints that meet at {place_text(side[place])}")
    placed = [given.outlines[block] for block in order]
    ring = Ring(
        JointLines(intrados, extrados), 1, [outline_section(outline) for outline in placed],
        [sampled(outline) for outline in placed],
        [_back_middle(outline, *extrados[i : i + 2]) for i, outline in enumerate(placed)],
    )  # fmt: skip
    return ring, placed, free


def _back_middle(outline: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Middle of the side between the extrados ends of a voussoir's two joints ``(2,)``."""
    points = sampled(outline)
    closed = np.column_stack([points, np.zeros(len(points))])
    # Anticlockwise the back runs from the second joint to the first.
    along, (start, end), total = places_along(closed, np.array([second, first]))
    inside = (along - start) % total < (end - start) % total
    inner = points[inside][np.argsort((along[inside] - start) % total)]
    return middle_of(np.vstack([second, inner, first]))


def _check_simple(given: Blocks) -> None:
    """Refuse outlines that cross themselves, have no area, or overlap."""
    shapely = from_extra("shapely", "drawing")
    points = [sampled(outline) for outline in given.outlines]
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
            given.refuse(one, f"{what} {given.names[other]}")


def _find_joints(given: Blocks) -> None:
    """Joints of blocks with each other and with the ground."""
    shapely = from_extra("shapely", "drawing")
    count = len(given.outlines)
    edges, owner = _straight_edges(given)
    tree = shapely.STRtree(shapely.linestrings(edges))
    shared: dict[tuple[int, int], list[_Segment]] = {}
    near = tree.query(tree.geometries, predicate="dwithin", distance=given.tolerance)
    for one, other in near.T:
        if owner[one] < min(owner[other], count):
            common = common_part(edges[one], edges[other][::-1], given.tolerance)
            if common is not None:
                shared.setdefault((owner[one], owner[other]), []).append(common)
    given.joints = [{} for _ in given.outlines]
    for (one, other), parts in shared.items():
        if other < count:
            segment = one_line(parts, given.tolerance)
            if segment is None:
                given.refuse(
                    one,
                    f"and {given.names[other]} meet along {len(parts)} edges not on one line; a "
                    "joint must be straight",
                )
            given.joints[one][other], given.joints[other][one] = segment, segment[::-1]
    for line, name in enumerate(given.ground_names, count):
        blocks = [one for one, other in shared if other == line]
        if len(blocks) != 1:
            listed = ", ".join(given.names[block] for block in blocks) or "none"
            raise GeometryError(
                f"{name} must be on a straight edge of one block, on which it stands on the "
                f"ground; it is on edges of: {listed}"
            )
        block = blocks[0]
        before = [given.standing[block]] if block in given.standing else []
        straight = one_line(shared[block, line] + before, given.tolerance)
        if straight is None:
            given.refuse(block, f"stands on two lines, {name} the second; it must be one")
        given.standing[block] = straight


def _straight_edges(drawn: Blocks) -> tuple[FloatArray, list[int]]:
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


def _walk(given: Blocks) -> list[int]:
    """Blocks from one end to the other; adds the lines on which ends stand if none is given."""
    count, names = len(given.outlines), given.names
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


def _refuse_gap(given: Blocks, order: list[int]) -> NoReturn:
    """Refuse blocks that do not hang together, by the two at the narrowest gap."""
    shapely = from_extra("shapely", "drawing")
    shapes = [shapely.Polygon(sampled(outline)) for outline in given.outlines]
    apart = set(range(len(shapes))) - set(order)
    gap, one, other = min(
        (shapes[one].distance(shapes[other]), one, other) for one in order for other in apart
    )
    name, text = given.names[other], "has no edge in common with {}, {:.3g} m away"
    if gap <= given.tolerance:
        text = "touches {} but has no edge in common with it"
    given.refuse(
        one,
        f"{text.format(name, gap)}; all must form one chain, and edges of neighbours agree to "
        f"{given.tolerance:.3g} m",
    )


def _opposite(given: Blocks, block: int, joint: _Segment) -> _Segment:
    """Side of an end block opposite to its joint, which must be one of four and straight."""
    outline = given.outlines[block]
    along, middle, _ = places_along(outline, joint.mean(axis=0)[None])
    here = int(np.searchsorted(along, middle[0], "right")) - 1
    chord = np.roll(outline[:, :2], -1, axis=0) - outline[:, :2]
    heading, half = np.arctan2(chord[:, 1], chord[:, 0]), 2.0 * np.arctan(outline[:, 2])
    # Between the end of the edge before and the start of this one.
    angle = (heading - half) - np.roll(heading + half, 1)
    turns = np.abs((angle + math.pi) % (2.0 * math.pi) - math.pi) > _SMOOTH
    side = np.cumsum(turns) % max(turns.sum(), 1)  # of each edge: from one corner to the next
    if turns.sum() == 4:
        edges = np.flatnonzero(side == (side[here] + 2) % 4)
        pairs = [outline[[edge, (edge + 1) % len(outline)], :2] for edge in edges]
        straight = None if outline[edges, 2].any() else one_line(pairs, given.tolerance)
        if straight is not None:
            return straight
    given.refuse(
        block,
        f"is an end of the chain and has {turns.sum()} sides, of which none is straight and "
        "opposite to its joint; a LINE must show the edge it stands on",
    )


def _far_side(given: Blocks, block: int, joint: _Segment) -> _Segment:
    """Edge of a free end that is farthest from the line of its joint, intrados first."""
    corners = given.outlines[block][:, :2]
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    away = np.abs(cross(edges.mean(axis=1) - joint[0], joint[1] - joint[0]))
    return edges[int(np.argmax(away))]
