"""Plane figures: exact sections of polygons, annular sectors and outlines, and points on them.

An outline is an array ``(m, 3)`` of corners x, y [m] and bulge: the tangent of a quarter of the
angle of the arc to the next corner, positive anticlockwise, 0 for a straight side (as in DXF).
"""

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from archfrag.arch.checks import FloatArray

_SLIP = 1e-12  # part of a side within which a cut is at its end
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(24)
# Of a plane figure: area [m2], centroid (2,) [m], polar second moment about the centroid [m4].
Section = tuple[float, FloatArray, float]
Side = tuple[
    FloatArray, FloatArray
]  # (3,) each: start x, y [m] and bulge; end, its bulge unused


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return z of the cross product of plane vectors ``(..., 2)``."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def following(corners: FloatArray) -> FloatArray:
    """Return for each corner the next one; the first corner follows the last."""
    return np.roll(corners, -1, axis=0)


def length_of(line: FloatArray) -> float:
    """Return the distance between two points ``(2, 2)`` [m]."""
    return np.hypot(*(line[1] - line[0]))


def place_text(point: FloatArray) -> str:
    """Return a point ``(2,)`` as messages write it [m]."""
    return f"({point[0]:.6g}, {point[1]:.6g})"


def polygon_section(corners: FloatArray) -> Section:
    """Return the section of a simple polygon, by Green's theorem.

    With the corners x_i taken from a point near the figure and c_i = x_i × x_{i+1},

        A = sum c_i / 2,   G = sum c_i (x_i + x_{i+1}) / (6 A),
        J = sum c_i (|x_i|² + x_i . x_{i+1} + |x_{i+1}|²) / 12.

    J is summed about the centroid itself, so that no large terms cancel.
    """
    origin = corners.mean(axis=0)
    here = corners - origin
    there = following(here)
    twice = cross(here, there)
    area = 0.5 * math.fsum(twice)
    shift = twice @ (here + there) / (6.0 * area)
    here -= shift
    there -= shift
    twice = cross(here, there)
    squares = (here * here + here * there + there * there).sum(axis=1)
    polar = math.fsum(twice * squares) / 12.0
    return abs(area), origin + shift, abs(polar)


def square_height(corners: FloatArray) -> float:
    """Return the mean square of y, from its mean, over a simple polygon [m2].

    With the corners from a point near the figure and c_i = x_i × x_{i+1},

        A = sum c_i / 2,   S = sum c_i (y_i + y_{i+1}) / 6,
        I = sum c_i (y_i² + y_i y_{i+1} + y_{i+1}²) / 12,   k² = I/A - S²/A².
    """
    here = corners - corners.mean(axis=0)
    there = following(here)
    twice = cross(here, there)
    y, after = here[:, 1], there[:, 1]
    mean = twice @ (y + after) / (3.0 * twice.sum())
    return float(
        twice @ (y * y + y * after + after * after) / (6.0 * twice.sum()) - mean**2
    )


def sector_section(
    centre: FloatArray, radius: float, thickness: float, start: float, end: float
) -> Section:
    """Return the section of an annular sector.

    With h = (end − start)/2 and s = sin h / h,

        A = 2 h R t,   rho = s (R + t²/(12 R)),
        J/A = R² + t²/4 − rho² = R² (1 − s²) + t²/4 − s² (t²/6 + t⁴/(144 R²)).
    """
    half = 0.5 * (end - start)
    middle = 0.5 * (start + end)
    area = 2.0 * half * radius * thickness
    sinc = math.sin(half) / half
    distance = sinc * (radius + thickness**2 / (12.0 * radius))
    gyration = (
        radius**2 * _one_minus_sinc(half) * (1.0 + sinc)
        + 0.25 * thickness**2
        - sinc**2 * (thickness**2 / 6.0 + thickness**4 / (144.0 * radius**2))
    )
    direction = np.array([math.sin(middle), math.cos(middle)])
    return area, centre + distance * direction, area * gyration


def _one_minus_sinc(angle: float) -> float:
    """Return 1 − sin(x)/x without cancellation at small x: x²/3! − x⁴/5! + …"""
    if angle > 1.0:
        return 1.0 - math.sin(angle) / angle
    term = angle**2 / 6.0
    total = 0.0
    order = 3
    while abs(term) > 1e-18 * abs(total):
        total += term
        term *= -(angle**2) / ((order + 1) * (order + 2))
        order += 2
    return total


def arc(centre: FloatArray, radius: float, start: float, end: float) -> FloatArray:
    """Return points ``(m, 2)`` on a circular arc, both ends included [m].

    They are at most one degree apart. Angles are clockwise from the upward vertical [rad].
    """
    steps = max(2, math.ceil(abs(end - start) / math.radians(1.0)))
    angle = np.linspace(start, end, steps + 1)
    return centre + radius * np.column_stack([np.sin(angle), np.cos(angle)])


def overlap_of(shapes: NDArray[Any], cores: NDArray[Any]) -> list[Any]:
    """Return the numbers of two shapes whose cores overlap, and their common area [m2].

    The list is empty if no cores overlap.
    """
    for one, other in shapely.STRtree(cores).query(cores, predicate="intersects").T:
        if one < other:
            return [one, other, shapely.intersection(shapes[one], shapes[other]).area]
    return []


def middle_of(line: FloatArray) -> FloatArray:
    """Return the point ``(2,)`` halfway along a polyline ``(m, 2)`` [m]."""
    length = np.hypot(*np.diff(line, axis=0).T)
    travelled = np.concatenate([[0.0], np.cumsum(length)])
    half = 0.5 * travelled[-1]
    return np.array([np.interp(half, travelled, line[:, axis]) for axis in (0, 1)])


def outline_section(outline: FloatArray) -> Section:
    """Return the section of an outline, with exact arcs.

    It is by Green's theorem, with Gauss-Legendre quadrature along each arc. With c = x dy - y dx
    about a point near the figure, A = ∮ c/2, G = ∮ r c/(3A), J = ∮ r² c/4.
    """
    if not outline[:, 2].any():
        return polygon_section(outline[:, :2])
    origin = outline[:, :2].mean(axis=0)
    corners = outline[:, :2] - origin
    chord = (following(corners) - corners)[:, None]
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
    return abs(area), origin + shift, abs(polar)


def cut_sides(line: FloatArray, levels: Iterable[float] = ()) -> list[Side]:
    """Return the sides of a line ``(m, 3)``, cut at heights and where arcs are level or upright.

    So each piece rises or falls, and goes to the left or to the right, over its whole length.
    """
    sides = []
    for start, end in pairwise(line):
        turn = 4.0 * math.atan(start[2])
        chord = (end - start)[:2]
        if turn == 0.0:
            rises = chord[1] != 0.0
            cuts = [(level - start[1]) / chord[1] for level in levels if rises]
        else:
            away = (1.0 - start[2] ** 2) / (4.0 * start[2])
            middle = 0.5 * (start + end)[:2]
            centre = middle + away * np.array([-chord[1], chord[0]])
            radius = math.hypot(*(start[:2] - centre))
            first = math.atan2(*(start[:2] - centre)[::-1])
            sines = [(level - centre[1]) / radius for level in levels]
            rise = [math.asin(sine) for sine in sines if abs(sine) < 1.0]
            angles = [0.5 * math.pi * k for k in range(4)]
            angles += rise + [math.pi - a for a in rise]
            whole = math.copysign(2.0 * math.pi, turn)
            cuts = [(angle - first) % whole / turn for angle in angles]
        inside = sorted(p for p in cuts if _SLIP < p < 1.0 - _SLIP)
        parts = np.array([0.0, *inside, 1.0])
        points = start[:2] + parts[:, None] * chord
        if turn != 0.0:
            angle = first + parts[1:-1] * turn
            ways = np.column_stack([np.cos(angle), np.sin(angle)])
            points[1:-1] = centre + radius * ways
        bulges = np.append(np.tan(0.25 * turn * np.diff(parts)), 0.0)
        sides += list(pairwise(np.column_stack([points, bulges])))
    return sides


def height_at(line: FloatArray, x: float) -> float:
    """Return the greatest height of a line ``(m, 3)`` at `x`, which it must cross [m]."""
    exchanged = line[:, [1, 0, 2]] * [1, 1, -1]  # a reflection, which turns arcs round
    points = np.concatenate(cut_sides(exchanged, (x,)))
    return points[np.isclose(points[:, 1], x, rtol=0.0, atol=1e-9), 0].max()


def rotated(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """Return plane vectors ``(..., 2)`` rotated by angles that broadcast with them."""
    x, y = np.moveaxis(vector, -1, 0)
    cosine = np.cos(angle)
    sine = np.sin(angle)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def sampled(outline: FloatArray) -> FloatArray:
    """Return the points ``(k, 2)`` of an outline, on its arcs at most one degree apart."""
    points = []
    for start, end in zip(outline, following(outline)):
        half = 2.0 * math.atan(start[2])
        steps = 1 if half == 0.0 else 2 * max(1, math.ceil(abs(math.degrees(half))))
        part = np.arange(steps) / steps
        length = part if half == 0.0 else np.sin(half * part) / math.sin(half)
        chord = rotated((end - start)[:2], half * (part - 1.0))
        points.append(start[:2] + length[:, None] * chord)
    return np.concatenate(points)
