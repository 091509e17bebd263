"""Chains of polygons: joints where two of them have an edge in common, sides straight or arcs."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import checks
from archfrag.arch.assemble import fields_of
from archfrag.arch.drawing import Drawing
from archfrag.arch.geometry import cross, place_text
from archfrag.arch.outlines import (
    TOLERANCE,
    anticlockwise,
    back_middle,
    checked_corners,
    outline_section,
    perimeter,
    place_along,
    sampled,
    sides_of,
    stretched,
)
from archfrag.arch.profiles import JointLines
from archfrag.arch.ring import Ring, Voussoir
from archfrag.errors import GeometryError

FloatArray = NDArray[np.float64]
SHORTEST = 10.0  # joint, in tolerances
_Segment = FloatArray  # (2, 2): end, xy


@dataclass
class _Polygons:
    """What is being made a chain."""

    drawn: Drawing  # its outlines anticlockwise
    tolerance: float
    # Of each block: the other blocks with the joint, along its own edges.
    joints: list[dict[int, _Segment]] = field(default_factory=list)
    standing: dict[int, _Segment] = field(default_factory=dict)

    def refuse(self, block: int, text: str) -> NoReturn:
        raise GeometryError(f"{self.drawn.names[block]} {text}")


def polygon_ring(
    drawn: Drawing, tolerance: float | None = None
) -> tuple[Ring, list[FloatArray], bool]:
    """Ring of blocks in any order: joints are the edges that two have in common.

    Parameters
    ----------
    drawn : archfrag.arch.drawing.Drawing
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
    import shapely

    points = [sampled(outline) for outline in given.drawn.outlines]
    shapes = np.array([shapely.Polygon(p) if len(p) > 2 else shapely.Polygon() for p in points])
    least = given.tolerance
    for block, shape in enumerate(shapes):
        if not shape.is_valid:
            where = shapely.is_valid_reason(shape).partition("[")[2].rstrip("]").replace(" ", ", ")
            given.refuse(block, f"crosses or touches itself at ({where}); it must be simple")
    # What is left of a block without its rim: overlaps of a tolerance leave nothing in common.
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
    import shapely

    edges, owner = _straight_edges(given.drawn.outlines)
    tree = shapely.STRtree(shapely.linestrings(edges))
    found: dict[tuple[int, int], list[_Segment]] = {}
    near = tree.query(tree.geometries, predicate="dwithin", distance=given.tolerance)
    for one, other in near.T:
        if owner[one] < owner[other]:
            common = _common(edges[one], edges[other][::-1], given.tolerance)
            if common is not None:
                found.setdefault((owner[one], owner[other]), []).append(common)
    given.joints = [{} for _ in given.drawn.outlines]
    for (one, other), parts in found.items():
        segment = _one_line(parts, given.tolerance)
        if segment is None:
            given.refuse(
                one,
                f"and {given.drawn.names[other]} meet along {len(parts)} edges not on one line; "
                "a joint must be straight",
            )
        given.joints[one][other], given.joints[other][one] = segment, segment[::-1]
    for line, name in zip(given.drawn.ground, given.drawn.ground_names):
        stands: dict[int, list[_Segment]] = {}
        for edge in tree.query(shapely.linestrings(line), "dwithin", distance=given.tolerance):
            for sense in (line, line[::-1]):
                common = _common(edges[edge], sense, given.tolerance)
                if common is not None:
                    stands.setdefault(int(owner[edge]), []).append(common)
        if len(stands) != 1:
            blocks = ", ".join(given.drawn.names[block] for block in stands) or "none"
            raise GeometryError(
                f"{name} must be on a straight edge of one block, on which it stands on the "
                f"ground; it is on edges of: {blocks}"
            )
        block, parts = stands.popitem()
        if block in given.standing:
            parts.append(given.standing[block])
        straight = _one_line(parts, given.tolerance)
        if straight is None:
            given.refuse(block, f"stands on two lines, {name} the second; it must be one")
        given.standing[block] = straight


def _straight_edges(outlines: Sequence[FloatArray]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Straight sides ``(n, 2, 2)`` of all blocks along their outlines, and whose they are."""
    edges, owner = [], []
    for block, outline in enumerate(outlines):
        pairs = np.stack([outline[:, :2], np.roll(outline[:, :2], -1, axis=0)], axis=1)
        edges.append(pairs[outline[:, 2] == 0.0])
        owner += [block] * len(edges[-1])
    return np.concatenate(edges), np.array(owner, dtype=np.int64)


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
    """Blocks from one end to the other, with what the ends stand on; refuses what is no chain."""
    count = len(given.drawn.outlines)
    for block, beside in enumerate(given.joints):
        if len(beside) > 2:
            others = ", ".join(given.drawn.names[other] for other in beside)
            given.refuse(block, f"has {len(beside)} joints, with {others}; it may have two")
    ends = [block for block, beside in enumerate(given.joints) if len(beside) < 2]
    if not ends:
        given.refuse(0, "and all others form a closed ring; a chain must have two ends")
    for block in given.standing:
        if block not in ends:
            given.refuse(block, "stands on the ground between two joints; only ends may")
    order = [ends[0]]
    while True:
        ahead = [other for other in given.joints[order[-1]] if other not in order[-2:]]
        if not ahead:
            break
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
    import shapely

    shapes = [shapely.Polygon(sampled(outline)) for outline in given.drawn.outlines]
    rest = sorted(set(range(len(shapes))) - set(order))
    gaps = {(one, other): shapes[one].distance(shapes[other]) for one in order for other in rest}
    one, other = min(gaps, key=lambda pair: gaps[pair])
    gap, name = gaps[one, other], given.drawn.names[other]
    touching = f"touches {name} but has no edge in common with it"
    apart = f"has no edge in common with {name}, {gap:.3g} m away"
    given.refuse(
        one,
        f"{touching if gap <= given.tolerance else apart}; all must form one chain, and edges of "
        f"neighbours agree to {given.tolerance:.3g} m",
    )


def _opposite(given: _Polygons, block: int, joint: _Segment) -> _Segment:
    """Side of an end block opposite to its joint, which must be one of four and straight."""
    outline = given.drawn.outlines[block]
    sides = sides_of(outline)
    along, _ = perimeter(outline)
    middle = place_along(outline, along, joint.mean(axis=0))
    here = int(np.searchsorted(along, middle, "right")) - 1
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


def given_polygons(outlines: Sequence[Any], ground: Sequence[Any]) -> Drawing:
    """Blocks and lines that a user gives as lists of points."""
    names = [f"outlines[{i}]" for i in range(len(outlines))]
    ground_names = [f"ground[{i}]" for i in range(len(ground))]
    blocks = [checked_corners(rows, name, 2, 3) for rows, name in zip(outlines, names)]
    lines = [checked_corners(rows, name, 2, 2)[:, :2] for rows, name in zip(ground, ground_names)]
    return Drawing(blocks, lines, names, ground_names)


def polygon_fields(
    drawn: Drawing, thickness_factor: float, tolerance: float | None, matter: dict[str, Any]
) -> dict[str, Any]:
    """Attributes of an Arch of polygons; `matter` is friction, density, depth and dead_load."""
    factor = checks.number("thickness_factor", thickness_factor, "")
    if tolerance is not None:
        tolerance = checks.number("tolerance", tolerance)
    ring, placed, free = polygon_ring(drawn, tolerance)
    if factor != 1.0:
        placed, lines = stretched(placed, ring, factor), _standing(ring, free)
        lines = [line.mean(axis=0) + factor * (line - line.mean(axis=0)) for line in lines]
        ring, placed, free = polygon_ring(given_polygons(placed, lines), tolerance)
    shape = {
        "outlines": [outline.tolist() for outline in placed],
        "ground": [line.tolist() for line in _standing(ring, free)],
    }
    return fields_of("polygons", shape, ring, free_end=free, **matter)


def _standing(ring: Ring, free: bool) -> list[FloatArray]:
    """Lines on which the ends stand."""
    ends = (0,) if free else (0, len(ring.voussoirs))
    return [np.array([side[k] for side in ring.lines[:2]]) for k in ends]
