"""Outlines of blocks, whose sides are straight or arcs: sections, points on them, changes.

An outline is an array ``(m, 3)`` of corners x, y [m] and bulge: the tangent of a quarter of the
angle of the arc to the next corner, positive anticlockwise, 0 for a straight side (as in DXF).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import checks
from archfrag.arch.geometry import Section, cross, middle_of, polygon_section
from archfrag.arch.profiles import JointLines
from archfrag.arch.ring import Ring
from archfrag.errors import GeometryError

FloatArray = NDArray[np.float64]
TOLERANCE = 1e-5  # of the size of all, within which corners and edges are the same
_SMOOTH = math.radians(30.0)  # corners of a smaller angle are inside a side, as of a drawn arc
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class Drawing:
    """Blocks and the lines on which they stand [m], with their names for messages."""

    outlines: list[FloatArray]  # (m, 3) each: corners x, y and bulge
    ground: list[FloatArray]  # (2, 2) each; none where ends stand opposite to their joints
    names: list[str]  # of the blocks
    ground_names: list[str]

    @classmethod
    def from_points(cls, outlines: Sequence[Any], ground: Sequence[Any]) -> Self:
        """Blocks and lines that a user gives as lists of points, checked."""
        names = [f"outlines[{i}]" for i in range(len(outlines))]
        lines = [f"ground[{i}]" for i in range(len(ground))]
        return cls(
            [_checked_corners(rows, name, 2, 3) for rows, name in zip(outlines, names)],
            [_checked_corners(rows, name, 2, 2)[:, :2] for rows, name in zip(ground, lines)],
            names,
            lines,
        )


def _checked_corners(rows: Any, name: str, least: int, widest: int) -> FloatArray:
    """Corners ``(m, 3)`` from x, y or x, y, bulge, without repeated ones."""
    why = "points (x, y), or (x, y, bulge) for a side that is an arc"
    corners = checks.points(name, rows, least, why, widest)
    full = np.zeros((len(corners), 3))
    full[:, : corners.shape[1]] = corners
    apart = np.hypot(*(np.roll(full[:, :2], -1, axis=0) - full[:, :2]).T) > 0.0
    if apart.sum() < least:
        raise GeometryError(f"{name} has no length: all its points coincide")
    return full[apart]


def outline_section(outline: FloatArray) -> Section:
    """Section of an outline, arcs exactly: Green's theorem, Gauss-Legendre along each arc.

    With c = x dy - y dx about a point near the figure, A = ∮ c/2, G = ∮ r c/(3A), J = ∮ r² c/4.
    """
    if not outline[:, 2].any():
        return polygon_section(outline[:, :2])
    origin = outline[:, :2].mean(axis=0)
    corners = outline[:, :2] - origin
    chord = np.roll(corners, -1, axis=0) - corners
    half = 2.0 * np.arctan(outline[:, 2:])  # of an arc's angle
    # The point at the part s of an arc is the corner + chord * sin(h s)/sin(h), rotated by h(s-1).
    part = 0.5 * (_NODE + 1.0)
    flat = half == 0.0
    safe = np.where(flat, 1.0, half)
    length = np.where(flat, part, np.sin(safe * part) / np.sin(safe))
    rate = np.where(flat, 1.0, safe / np.sin(safe))
    point = corners[:, None] + length[..., None] * rotated(chord, half * (part - 1.0))
    slope = rate[..., None] * rotated(chord, half * (2.0 * part - 1.0))
    weight = 0.5 * _WEIGHT * cross(point, slope)
    area = 0.5 * weight.sum()
    shift = (weight[..., None] * point).sum(axis=(0, 1)) / (3.0 * area)
    point -= shift
    weight = 0.5 * _WEIGHT * cross(point, slope)
    polar = 0.25 * (weight * (point**2).sum(axis=2)).sum()
    return Section(abs(area), origin + shift, abs(polar))


def rotated(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors ``(m, 2)`` rotated by angles ``(m, k)``, ``(m, k, 2)``."""
    x, y = vector[:, :1], vector[:, 1:]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2)


def sampled(outline: FloatArray) -> FloatArray:
    """Points ``(k, 2)`` of an outline, on its arcs at most one degree apart."""
    points = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0)):
        half = 2.0 * math.atan(start[2])
        steps = 1 if half == 0.0 else 2 * max(1, math.ceil(abs(math.degrees(half))))
        part = np.arange(steps) / steps
        length = part if half == 0.0 else np.sin(half * part) / math.sin(half)
        chord = (end - start)[None, :2]
        points.append(start[:2] + length[:, None] * rotated(chord, half * (part - 1.0)[None])[0])
    return np.concatenate(points)


def anticlockwise(outline: FloatArray) -> FloatArray:
    """The outline in anticlockwise order."""
    points = sampled(outline)
    if cross(points, np.roll(points, -1, axis=0)).sum() > 0.0:
        return outline
    reverse = outline[::-1].copy()
    reverse[:, 2] = -np.roll(reverse[:, 2], -1)
    return reverse


def stretched(outlines: Sequence[FloatArray], ring: Ring, factor: float) -> list[FloatArray]:
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


def places_along(
    outline: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Where corners ``(m,)`` and points ``(k,)`` of straight sides are along the chords.

    Third, the length of all chords.
    """
    start = outline[:, :2]
    chord = np.roll(start, -1, axis=0) - start
    length = np.hypot(*chord.T)
    along = np.concatenate([[0.0], np.cumsum(length)])
    places = []
    for point in points:
        part = np.clip(((point - start) * chord).sum(1) / (chord**2).sum(1), 0.0, 1.0)
        off = np.hypot(*(start + part[:, None] * chord - point).T)
        off[outline[:, 2] != 0.0] += off.max() + 1.0
        side = int(np.argmin(off))
        places.append(along[side] + part[side] * np.hypot(*chord[side]))
    return along[:-1], np.array(places), float(along[-1])


def back_middle(outline: FloatArray, lines: JointLines, body: int) -> FloatArray:
    """Middle of the side between the extrados ends of a voussoir's joints ``(2,)``."""
    points = sampled(outline)
    closed = np.column_stack([points, np.zeros(len(points))])
    # Anticlockwise the back runs from the second joint to the first.
    along, (start, end), total = places_along(closed, lines.extrados[[body + 1, body]])
    inside = (along - start) % total < (end - start) % total
    inner = points[inside][np.argsort((along[inside] - start) % total)]
    return middle_of(np.vstack([lines.extrados[body + 1], inner, lines.extrados[body]]))


def sides_of(outline: FloatArray) -> list[list[int]]:
    """Edges of an outline in sides, between corners of more than `_SMOOTH`."""
    chord = np.roll(outline[:, :2], -1, axis=0) - outline[:, :2]
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    half = 2.0 * np.arctan(outline[:, 2])
    # From the end of the edge before to the start of this one.
    angle = (heading - half) - np.roll(heading + half, 1)
    corners = np.flatnonzero(np.abs((angle + math.pi) % (2.0 * math.pi) - math.pi) > _SMOOTH)
    count = len(outline)
    return [
        [edge % count for edge in range(start, end if end > start else end + count)]
        for start, end in zip(corners, np.roll(corners, -1))
    ]


def with_arcs(points: FloatArray) -> FloatArray:
    """Outline ``(4, 3)`` of an annular sector, from points on its intrados, then its extrados."""
    half = len(points) // 2
    corners = points[[0, half - 1, half, -1]]
    sides = corners[[3, 2]] - corners[[0, 1]]
    angle = np.arctan2(
        sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0], (sides[0] * sides[1]).sum()
    )
    bulge = np.tan(-0.25 * (-angle % (2.0 * np.pi)))  # clockwise over the crown
    return np.column_stack([corners, [bulge, 0.0, -bulge, 0.0]])
