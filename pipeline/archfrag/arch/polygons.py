"""Chains from simple polygons: edges that two blocks share become joints."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NoReturn, Self

import numpy as np
import shapely

from archfrag.arch import checks
from archfrag.arch.bridge import assembled, cut
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import (
    cross,
    following,
    length_of,
    middle_of,
    outline_section,
    overlap_of,
    place_text,
    sampled,
)
from archfrag.arch.ring import Ring
from archfrag.errors import GeometryError
from archfrag.files import Named
from archfrag.physics.interface import pairs_of
from archfrag.properties import MOST_VOUSSOIRS

TOLERANCE = (
    1e-5  # part of the size of all blocks within which corners and edges are the same
)
_SHORTEST = 10.0  # length of a joint, in tolerances
_Segment = FloatArray  # (2, 2): end, xy


@dataclass
class Blocks:
    """Blocks and the lines on which they stand [m], with their names for messages."""

    outlines: list[FloatArray]  # (m, 3) each: corners x, y and bulge
    ground: list[_Segment]  # none where ends stand opposite to their joints
    names: list[str]  # of the blocks
    ground_names: list[str]
    layer: str = ""  # of a drawing: layers, unit, and warnings of what else it shows
    unit: str = ""
    caution: str = ""
    tolerance: float = 0.0  # within which corners and edges are the same [m]
    # Found on the way to a chain: of each block its neighbours, each with their joint along the
    # block's own edges; and of each block on the ground the edge on which it stands.
    joints: list[dict[int, _Segment]] = field(default_factory=list)
    standing: dict[int, _Segment] = field(default_factory=dict)

    @classmethod
    def from_points(cls, outlines: Sequence[Any], ground: Sequence[Any]) -> Self:
        """Check outlines and ground lines that a user gives, and return them as blocks."""
        why = "points (x, y), or (x, y, bulge) for a side that is an arc"
        names = [f"outlines[{i}]" for i in range(len(outlines))]
        lines = [f"ground[{i}]" for i in range(len(ground))]
        corners = [
            checks.points(name, rows, 2, why, 3) for name, rows in zip(names, outlines)
        ]
        ends = [
            checks.points(name, rows, 2, "its ends")[:2]
            for name, rows in zip(lines, ground)
        ]
        straight = [
            np.column_stack([rows, np.zeros(len(rows))])[:, :3] for rows in corners
        ]
        return cls([without_repeated(rows) for rows in straight], ends, names, lines)

    def refuse(self, block: int, text: str) -> NoReturn:
        raise GeometryError(f"{self.names[block]} {text}")


def without_repeated(corners: FloatArray, tolerance: float = 0.0) -> FloatArray:
    """Return the corners ``(m, 3)`` of an outline without repeated ones.

    A corner is left out if the next one is within `tolerance` [m]. If fewer than two would remain,
    all stay.
    """
    kept = corners[np.hypot(*(following(corners) - corners)[:, :2].T) > tolerance]
    return kept if len(kept) > 1 else corners


def polygon_shape(
    drawn: Blocks, tolerance: float | None, thickness_factor: float
) -> tuple[Named, Ring, bool]:
    """Return parameters and ring of a chain of polygons, and whether one end is free.

    The parameters are outlines and ground, as they were drawn or, if the factor is not 1, with
    joints times the factor; and `tolerance` if it is given.
    """
    factor = checks.number("thickness_factor", thickness_factor, closed=False)
    ring, placed = polygon_ring(drawn, tolerance)
    if factor != 1.0:
        lines = [
            line.mean(axis=0) + factor * (line - line.mean(axis=0))
            for line in placed.ground
        ]
        drawn = Blocks.from_points(_stretched(placed.outlines, ring, factor), lines)
        ring, placed = polygon_ring(drawn, tolerance)
    # As drawn: what is placed already would give other last bits.
    shape: Named = {
        name: [rows.tolist() for rows in getattr(drawn, name)]
        for name in ("outlines", "ground")
    }
    own = {} if tolerance is None else {"tolerance": tolerance}
    return shape | own, ring, len(placed.ground) == 1


def _stretched(
    outlines: Sequence[FloatArray], ring: Ring, factor: float
) -> list[FloatArray]:
    """Return the outlines with each joint longer by a factor, about its middle.

    The sides between joints follow evenly. Arcs keep their angle: a circular ring stays one, with
    the thickness times the factor. `GeometryError` if a joint is narrower than its voussoir.
    """
    lines = np.stack([ring.intrados, ring.extrados], axis=1)
    tolerance = 2.0 * TOLERANCE * np.hypot(*np.ptp(lines, axis=(0, 1)))
    moves = (factor - 1.0) * (lines - 0.5 * (ring.intrados + ring.extrados)[:, None])
    result = []
    pairs = pairs_of(len(lines), ring.body)
    for i, outline in enumerate(outlines):
        around = (pairs == i).any(axis=1)
        ends = np.concatenate(lines[around])
        moved = outline.copy()
        apart = np.hypot(
            *(ends[:, None] - outline[None, :, :2]).transpose(2, 0, 1)
        ).min(axis=1)
        if apart.max() > tolerance:
            raise GeometryError(
                f"thickness_factor = {factor:g} is impossible: voussoir {i} is wider "
                "than one of its joints; every joint must reach across both of its "
                "voussoirs"
            )
        along, places, total = _places_along(outline, ends)
        for axis, move in enumerate(np.concatenate(moves[around]).T):
            moved[:, axis] += np.interp(along, places, move, period=total)
        result.append(moved)
    return result


def polygon_ring(drawn: Blocks, tolerance: float | None = None) -> tuple[Ring, Blocks]:
    """Return the ring of blocks that are given in any order, and the blocks in its order.

    Joints are the edges that two blocks have in common. The ring runs from the end that stands
    further left, or up from the ground if one end is free; the blocks then stand on one line. A
    block with three joints, or between two joints on the ground, is the top course of an inner
    pier. Outlines are anticlockwise. `tolerance` [m] is `TOLERANCE` of the size if not given.
    `GeometryError` names the block that is no simple polygon, overlaps, or does not fit.
    """
    if not 0 < len(drawn.outlines) <= MOST_VOUSSOIRS:
        raise GeometryError(
            f"outlines are {len(drawn.outlines)}; there must be 1 to {MOST_VOUSSOIRS}"
        )
    size = np.hypot(*np.ptp(np.concatenate(drawn.outlines)[:, :2], axis=0))
    tolerance = (
        TOLERANCE * size if tolerance is None else checks.number("tolerance", tolerance)
    )
    outlines = []
    for outline in drawn.outlines:
        points = sampled(outline)
        if cross(points, following(points)).sum() <= 0.0:
            outline = outline[::-1].copy()
            outline[:, 2] = -following(outline[:, 2])
        outlines.append(outline)
    given = replace(drawn, outlines=outlines, tolerance=tolerance, standing={})
    _check_simple(given)
    _find_joints(given)
    *legs, spine = _walk(given)
    free = spine[-1] >= 0
    blocks = spine[1 : len(spine) if free else -1]
    order = [block for leg in legs for block in leg[1:-1]] + blocks
    paths = [spine[:2], *(leg[:2] for leg in legs), *([] if free else [spine[-2:]])]
    bases = [joint for path in paths for joint in _joints(given, path)]
    placed = [outlines[block] for block in order]
    ring = assembled(_pieces(given, legs, blocks, _joints(given, spine)))
    return ring, replace(given, outlines=placed, ground=bases)


def _pieces(
    given: Blocks, legs: list[list[int]], blocks: list[int], joints: list[_Segment]
) -> Iterator[tuple[str, Ring]]:
    """Yield the pieces of a ring as `assembled` takes them.

    `legs` are the paths up to each top course, `blocks` those of the spine, with their `joints`.
    """
    if len(joints) == len(blocks):
        joints = [*joints, _free_edge(given.outlines[blocks[-1]], joints[-1])]
    for number, leg in enumerate(legs, 1):
        row = _row(given, leg[1:-1], _joints(given, leg))
        backs = [centroid for _, centroid, _ in row.sections]
        bare = [np.empty((0, 3))] * len(backs)
        yield f"pier {number}", row._replace(backs=backs, surfaces=bare)
    tops = [leg[-1] for leg in legs]
    whole = _row(given, blocks, joints, tops)
    start = 0
    for number, end in enumerate([*map(blocks.index, tops), len(blocks)], 1):
        span = cut(whole, slice(start, end), slice(start, end + 1))
        yield f"span {number}" if legs else "arch", span
        if end < len(blocks):
            yield f"pier {number}", cut(whole, slice(end, end + 1), slice(0))
        start = end + 1


def _free_edge(outline: FloatArray, line: _Segment) -> _Segment:
    """Return the edge of a block farthest from its only joint `line`, intrados first."""
    first = outline[:, :2]
    edges = np.stack([first, following(first)], axis=1)
    away = np.abs(cross(edges.mean(axis=1) - line[0], line[1] - line[0]))
    return edges[int(np.argmax(away))]


def _joints(given: Blocks, path: Sequence[int]) -> list[_Segment]:
    """Return the joints between blocks that follow each other, at intrados and extrados.

    The ground is -1, at the ends of a path.
    """
    # Along the first edge of an anticlockwise block one comes from its extrados to its intrados.
    found = []
    for before, after in pairwise(path):
        if after < 0:
            found.append(given.standing[before])
        else:
            edges = given.standing if before < 0 else given.joints[after]
            found.append(edges[after if before < 0 else before][::-1])
    return found


def _row(
    given: Blocks,
    blocks: Sequence[int],
    joints: list[_Segment],
    tops: Sequence[int] = (),
) -> Ring:
    """Return blocks between joints as a ring; `GeometryError` if two joints of a block meet.

    Those of `tops` of piers may.
    """
    for block, sides in zip(blocks, pairwise(joints)):
        for start, end in zip(*sides) if block not in tops else ():
            if length_of(np.array([start, end])) <= given.tolerance:
                given.refuse(block, f"has two joints that meet at {place_text(start)}")
    intrados, extrados = np.stack(joints, axis=1)
    placed = [given.outlines[block] for block in blocks]
    surfaces = [
        _back(outline, *ends, given.tolerance)
        for outline, ends in zip(placed, pairwise(extrados))
    ]
    backs = [middle_of(sampled(line)) for line in surfaces]
    sections = [outline_section(outline) for outline in placed]
    return Ring(
        intrados, extrados, sections, [*map(sampled, placed)], backs, surfaces, 1
    )


def _back(
    outline: FloatArray, first: FloatArray, second: FloatArray, tolerance: float
) -> FloatArray:
    """Return the back ``(m, 3)`` of a voussoir: its side from joint to joint, with bulges.

    `first` and `second` are the extrados ends of its two joints.
    """
    if length_of(np.array([first, second])) <= tolerance:  # two rings meet on a pier
        return np.array([[*first, 0.0], [*second, 0.0]])
    # Anticlockwise the back runs from the second joint to the first.
    along, (start, end), total = _places_along(outline, [second, first])
    # a joint may end at a corner, whose arc then belongs to the back
    slip = 2.0 * tolerance
    offset = (along - start + slip) % total
    inside = offset < (end - start) % total - slip
    inner = outline[inside][np.argsort(offset[inside])]
    back = np.vstack([[*second, 0.0], inner, [*first, 0.0]])[::-1]
    return without_repeated(np.column_stack([back[:, :2], -following(back[:, 2])]))


def _places_along(
    outline: FloatArray, points: Iterable[FloatArray]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the places of corners and of points along the chords of an outline [m].

    They are ``(m,)`` for its corners and ``(k,)`` for `points`, which lie on straight sides. The
    third value is the length of all chords.
    """
    start = outline[:, :2]
    chord = following(start) - start
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*chord.T))])
    places = []
    for point in points:
        part = np.clip(((point - start) * chord).sum(1) / (chord**2).sum(1), 0.0, 1.0)
        off = np.hypot(*(start + part[:, None] * chord - point).T)
        off[outline[:, 2] != 0.0] += off.max() + 1.0
        side = int(np.argmin(off))
        places.append(along[side] + part[side] * np.hypot(*chord[side]))
    return along[:-1], np.array(places), along[-1]


def _check_simple(given: Blocks) -> None:
    """Refuse outlines that cross themselves, have no area, or overlap."""
    points = [sampled(outline) for outline in given.outlines]
    shapes = np.array(
        [shapely.Polygon(p) if len(p) > 2 else shapely.Polygon() for p in points]
    )
    least = given.tolerance
    for block, shape in enumerate(shapes):
        if not shape.is_valid:
            given.refuse(
                block, f"must not cross itself: {shapely.is_valid_reason(shape)}"
            )
    # A block without its rim: overlaps of a tolerance leave nothing in common.
    cores = shapely.buffer(shapes, -least, join_style="mitre")
    for block, core in enumerate(cores):
        if core.is_empty:
            given.refuse(
                block, f"has no area: nowhere is it wider than {2.0 * least:.3g} m"
            )
    found = overlap_of(shapes, cores)
    if found:
        one, other, common = found
        given.refuse(one, f"overlaps by {common:.3g} m2 with {given.names[other]}")


def _find_joints(given: Blocks) -> None:
    """Find the joints of blocks with each other and with the ground.

    Sets `joints` and `standing` of `given`. `GeometryError` if a joint is not straight, or if a
    ground line is not on one block.
    """
    count = len(given.outlines)
    names = given.names + given.ground_names
    edges: list[_Segment] = []
    owner: list[int] = []
    for block, outline in enumerate(given.outlines):
        pairs = np.stack([outline[:, :2], following(outline[:, :2])], axis=1)
        edges += list(pairs[outline[:, 2] == 0.0])
        owner += [block] * (len(edges) - len(owner))
    for number, line in enumerate(given.ground, count):
        edges += [line[::-1], line]
        owner += [number, number]
    tree = shapely.STRtree(shapely.linestrings(np.reshape(edges, (-1, 2, 2))))
    shared: dict[tuple[int, int], list[_Segment]] = {}
    near = tree.query(tree.geometries, predicate="dwithin", distance=given.tolerance)
    for one, other in near.T:
        if owner[one] < min(owner[other], count):
            common = _common_part(edges[one], edges[other][::-1], given.tolerance)
            if common is not None:
                shared.setdefault((owner[one], owner[other]), []).append(common)
    given.joints = [{} for _ in names]
    for (block, neighbour), parts in shared.items():
        segment = _one_line(parts, given.tolerance)
        if segment is None:
            given.refuse(
                block,
                f"and {names[neighbour]} meet along {len(parts)} edges not on one line; a joint "
                "must be straight",
            )
        given.joints[neighbour][block] = segment[::-1]
        if neighbour < count:
            given.joints[block][neighbour] = segment
    for name, joints in zip(given.ground_names, given.joints[count:]):
        if len(joints) != 1:
            raise GeometryError(
                f"{name} must be on a straight edge of one block, on which it stands on the "
                f"ground; it is on edges of: {', '.join(names[b] for b in joints) or 'none'}"
            )
        ((block, segment),) = joints.items()
        if block in given.standing:
            given.refuse(
                block, f"stands on two lines, {name} the second; it must be one"
            )
        given.standing[block] = segment[::-1]
    del given.joints[count:]


def _common_part(edge: _Segment, other: _Segment, tolerance: float) -> _Segment | None:
    """Return the part that two edges of the same direction share; None if there is none."""
    length = length_of(edge)
    place = (other - edge[0]) @ ((edge[1] - edge[0]) / length)
    if min(length, place[1]) - max(0.0, place[0]) < _SHORTEST * tolerance:
        return None
    ours = edge.copy()
    theirs = other.copy()
    # How far each end of the other lies inside the edge; the one inside has its foot on the other.
    for k, inside in enumerate((place[0], length - place[1])):
        if abs(inside) > tolerance:
            line, ends, point = (
                (edge, ours, other) if inside > 0.0 else (other, theirs, edge)
            )
            step = line[1] - line[0]
            ends[k] = line[0] + ((point[k] - line[0]) @ step) / (step @ step) * step
    apart = np.hypot(*(ours - theirs).T).max()
    return 0.5 * (ours + theirs) if apart <= tolerance else None


def _one_line(parts: list[_Segment], tolerance: float) -> _Segment | None:
    """Return both ends of several segments together; None if they are not on one line.

    The segments have the same direction.
    """
    points = np.concatenate(parts)
    unit = (parts[0][1] - parts[0][0]) / length_of(parts[0])
    place = (points - points[0]) @ unit
    ends = points[[int(np.argmin(place)), int(np.argmax(place))]]
    off = np.abs(cross(points - ends[0], (ends[1] - ends[0]) / length_of(ends)))
    return ends if off.max() <= 2.0 * tolerance else None


def _walk(given: Blocks) -> list[list[int]]:
    """Return the blocks in order: each inner pier up to its top course, and last the spine.

    The spine runs from the left base over all top courses to the right base, or to a free end.
    The ground is -1 at an end of a path. If no ground is given, sets the edges on which the ends
    stand. `GeometryError` if the blocks form neither a chain nor such a tree.
    """
    names = given.names
    for block, joints in enumerate(given.joints):
        if len(joints) > 3:
            listed = ", ".join(names[other] for other in joints)
            given.refuse(
                block, f"has {len(joints)} joints, with {listed}; it may have three"
            )
    ends = [block for block, joints in enumerate(given.joints) if len(joints) < 2]
    if not ends:
        given.refuse(0, "and all others form a closed ring; a chain must have two ends")
    order = list(_parents(given, ends[0]))
    apart = set(range(len(names))) - set(order)
    if apart:
        shapes = [shapely.Polygon(sampled(outline)) for outline in given.outlines]
        gap, one, near = min(
            (shapes[a].distance(shapes[b]), a, b) for a in order for b in apart
        )
        given.refuse(
            one,
            f"has no edge in common with {names[near]}, {gap:.3g} m away; all must form one "
            f"chain, and edges of neighbours agree to {given.tolerance:.3g} m",
        )
    if not given.standing:
        if len(order) == 1:
            given.refuse(0, "is the only block; a LINE must show the edge it stands on")
        for end in ends:
            (joint,) = given.joints[end].values()
            given.standing[end] = _opposite(given, end, joint)
    stands = [end for end in ends if end in given.standing]
    stands.sort(key=lambda end: (*given.standing[end].mean(axis=0),))
    hanging = [end for end in ends if end not in stands]
    free = len(ends) == 1 or len(stands) == len(hanging) == 1
    parents = _parents(given, (stands or ends)[0])
    spine = [hanging[0] if free and hanging else (stands or ends)[-1]]
    while parents[spine[-1]] >= 0:
        spine.append(parents[spine[-1]])
    spine.reverse()
    every = (_leg(given, top, spine) for top in spine if free or not hanging)
    legs = [leg for leg in every if leg]
    if hanging and (legs or not free):
        given.refuse(hanging[0], "hangs at one joint; a line must show where it stands")
    return [*legs, [-1, *spine, *([] if free else [-1])]]


def _parents(given: Blocks, root: int) -> dict[int, int]:
    """Return the blocks that hang together with `root`, each with the one before it, or -1.

    `GeometryError` if they close a ring.
    """
    parents = {root: -1}
    order = [root]
    for block in order:
        for other in given.joints[block].keys() - {parents[block]}:
            if other in parents:
                text = (
                    f"and {given.names[other]} close a ring of joints; leave fill out"
                )
                given.refuse(block, text)
            parents[other] = block
            order.append(other)
    return parents


def _leg(given: Blocks, top: int, spine: Sequence[int]) -> list[int]:
    """Return the path from the ground to a block of the spine; empty if it is no top course."""
    leg = [top]
    while ahead := [*(given.joints[leg[-1]].keys() - {*spine, *leg})]:
        if len(ahead) > 1:
            given.refuse(
                leg[-1], "has three joints, and is no top course: a pier may not branch"
            )
        leg += ahead
    for block in leg[:-1]:
        if block in given.standing:
            given.refuse(
                block, "stands on the ground between joints; only ends of piers may"
            )
    inside = top not in (spine[0], spine[-1])
    return [-1, *leg[::-1]] if leg[1:] or (inside and top in given.standing) else []


def _opposite(given: Blocks, block: int, joint: _Segment) -> _Segment:
    """Return the side of an end block that is opposite to its joint.

    `GeometryError` unless the block has four sides and this one is straight.
    """
    outline = given.outlines[block]
    along, (middle,), _ = _places_along(outline, [joint.mean(axis=0)])
    first = int(np.searchsorted(along, middle, "right")) + 1
    side = outline[[first % len(outline), (first + 1) % len(outline)]]
    if len(outline) != 4 or side[0, 2] != 0.0:
        given.refuse(
            block,
            f"is an end of the chain and has {len(outline)} sides; without a LINE that shows the "
            "edge it stands on they must be four, that opposite to its joint straight",
        )
    return side[:, :2]
