"""Make joint lines from a profile, voussoirs from these, and the chain of rigid bodies.

Ready-made centre lines have their springings at height 0 and their crown at x = 0. Their joints
are placed by the fraction of the centre line's length, counted from the crown: −1/2 at the left
springing, +1/2 at the right one. Joint lines are the ends at the intrados and at the extrados,
``(n_line, 2)`` each [m], from left to right.
"""

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy  # whose parts are loaded when they are used
import shapely
from numpy.typing import NDArray
from scipy.special import ellipeinc

from archfrag.arch import STANDARD_GRAVITY, geometry
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import Section, arc, cross
from archfrag.errors import GeometryError
from archfrag.physics.interface import Chain, pairs_of

# Points of a centre line (n_joint, 2) [m], and its unit normals there, away from the intrados.
CentreLine = tuple[FloatArray, FloatArray]
# Corners closer than this part of the ring's size, or sides that differ by a smaller
# angle [rad], are taken for a slip of the user's.
_TOLERANCE = 1e-9


class Part(NamedTuple):
    """Joints and bodies of a span or a pier.

    Those of a pier count from its base upwards, those of a span from its left springing.
    """

    name: str  # "span 1", "pier 1", "left pier", "right pier"; of one ring alone "arch"
    joints: range
    bodies: range  # of an inner pier without its top course
    top: int | None = None  # the top course of an inner pier

    @property
    def every(self) -> list[int]:
        """All bodies, the top course included."""
        return [*self.bodies, *([] if self.top is None else [self.top])]


class Ring(NamedTuple):
    """Voussoirs between joint lines."""

    intrados: FloatArray  # (n_voussoir + 1, 2) [m]
    extrados: FloatArray  # (n_voussoir + 1, 2) [m]
    sections: list[Section]
    outlines: list[
        FloatArray
    ]  # (m, 2) each: intrados, then extrados backwards; not closed [m]
    backs: list[
        FloatArray
    ]  # (2,) each: middle of the back, where its dead load sits [m]
    surfaces: list[
        FloatArray
    ]  # (m, 3) each: the back from joint to joint with bulges, for fill
    sense: int  # +1: intrados to the right from joint 0 to the last, -1: to the left
    body: NDArray | None = None  # as `Chain.body`
    parts: tuple[Part, ...] = ()  # from left to right; none of a ring by itself


def ellipse(span: float, rise: float, fraction: FloatArray) -> CentreLine:
    """Return the upper half of an ellipse.

    With a = span/2, b = rise and the point (a sin u, b cos u), the length from the crown is
    a E(u | 1 − b²/a²), the incomplete elliptic integral of the second kind.
    """
    a = 0.5 * span
    b = rise
    right = 0.5 * math.pi
    parameter = 1.0 - (b / a) ** 2
    length = 2.0 * np.abs(fraction) * float(ellipeinc(right, parameter))
    roots = [
        scipy.optimize.brentq(
            lambda u, s: float(ellipeinc(u, parameter)) - s,
            0.0,
            right,
            (s,),
            1e-15,
            1e-15,
        )
        for s in length.tolist()
    ]
    u = np.copysign(roots, fraction)
    sine = np.sin(u)
    cosine = np.cos(u)
    # The springings are exact, where cos(pi/2) is not quite zero.
    sine[[0, -1]] = -1.0, 1.0
    cosine[[0, -1]] = 0.0
    outward = np.column_stack([b * sine, a * cosine])
    outward /= np.hypot(outward[:, :1], outward[:, 1:])
    return np.column_stack([a * sine, b * cosine]), outward


def catenary(span: float, rise: float, fraction: FloatArray) -> CentreLine:
    """Return a hanging chain upside down.

    y = rise − c (cosh(x/c) − 1) with c = span/(2 w) from (cosh w − 1)/w = 2 rise/span; the
    length from the crown is c sinh(x/c).
    """
    slenderness = 2.0 * rise / span
    # (cosh w − 1)/w exceeds w/2 everywhere, and exp(w/2)/4 beyond w = 4.
    above = min(2.0 * slenderness, max(4.0, 2.0 * math.log(4.0 * slenderness + 1.0)))
    above *= 1.0 + 1e-12
    w = scipy.optimize.brentq(
        lambda w: 2.0 * math.sinh(0.5 * w) ** 2 / w - slenderness,
        0.5 * min(above, 1e-9),
        above,
        xtol=1e-300,
        rtol=1e-15,
    )
    c = 0.5 * span / w
    slope = 2.0 * fraction * math.sinh(w)
    x = c * np.arcsinh(slope)
    secant = np.hypot(1.0, slope)
    # cosh − 1 without cancellation: slope²/(1 + secant).
    y = rise - c * slope**2 / (1.0 + secant)
    x[[0, -1]] = -0.5 * span, 0.5 * span
    y[[0, -1]] = 0.0
    return np.column_stack([x, y]), np.column_stack([slope / secant, 1.0 / secant])


def normal_ring(
    curve: Callable[[float, float, FloatArray], CentreLine],
    span: float,
    rise: float,
    thickness: float,
    fraction: FloatArray,
) -> Ring:
    """Return straight-sided voussoirs between joints perpendicular to a curve."""
    point, outward = curve(span, rise, fraction)
    offset = 0.5 * thickness * outward
    return straight_ring(point - offset, point + offset)


def pointed_ring(
    span: float, rise: float, thickness: float, fraction: FloatArray
) -> Ring:
    """Return straight-sided voussoirs between joints radial to two arcs that meet at the crown.

    The left arc has its centre on the springing line at x = d = (rise² − span²/4)/span and the
    radius d + span/2. The extrados and intrados arcs are cut by the vertical x = 0.
    """
    reach = (rise**2 - 0.25 * span**2) / span
    radius = reach + 0.5 * span
    sweep = math.atan2(rise, reach)
    nearest = int(np.argmin(np.abs(fraction)))
    at_crown = abs(fraction[nearest]) <= 1e-12
    side = np.delete(fraction, nearest) if at_crown else fraction
    # From the horizontal at the springing up to `sweep` at the crown.
    angle = sweep * (1.0 - 2.0 * np.abs(side))
    sign = np.sign(side)
    outward = np.column_stack([sign * np.cos(angle), np.sin(angle)])
    centre = np.column_stack([-sign * reach, np.zeros_like(side)])
    right = int(np.flatnonzero(sign < 0.0)[-1]) + 1
    lines = []
    for r in (radius - 0.5 * thickness, radius + 0.5 * thickness):
        crown = [0.0, math.sqrt(max(r**2 - reach**2, 0.0))]
        lines.append(np.insert(centre + r * outward, right, crown, axis=0))
    return straight_ring(lines[0], lines[1], None if at_crown else right)


def straight_ring(
    intrados: FloatArray, extrados: FloatArray, apex: int | None = None
) -> Ring:
    """Return the ring of straight-sided voussoirs between lines.

    The line with the number `apex`, if given, is no joint: it lies inside the keystone.
    """
    sense = _travel_sense(intrados, extrados)
    ends = np.delete(np.arange(len(intrados)), [] if apex is None else apex)
    spans = [slice(first, last + 1) for first, last in pairwise(ends)]
    outlines = [np.concatenate([intrados[s], extrados[s][::-1]]) for s in spans]
    backs = [geometry.middle_of(extrados[s]) for s in spans]
    surfaces = [np.pad(extrados[s], ((0, 0), (0, 1))) for s in spans]
    sections = [geometry.polygon_section(each) for each in outlines]
    return Ring(
        intrados[ends], extrados[ends], sections, outlines, backs, surfaces, sense
    )


def circular_ring(
    centre: FloatArray, radius: float, thickness: float, angle: FloatArray, sector: bool
) -> Ring:
    """Return the ring of voussoirs between radial joints.

    They are annular sectors if `sector`, else straight-sided. `angle` of the joints is clockwise
    from the upward vertical [rad].
    """
    inner = radius - 0.5 * thickness
    outer = radius + 0.5 * thickness
    direction = np.column_stack([np.sin(angle), np.cos(angle)])
    intrados = centre + inner * direction
    extrados = centre + outer * direction
    if thickness >= 2.0 * radius:
        raise GeometryError(
            f"thickness = {thickness} is impossible; it must be less than "
            f"{2.0 * radius:.9g} m, twice the radius of the centre line"
        )
    if not sector:
        return straight_ring(intrados, extrados)
    ring = Ring(intrados, extrados, [], [], [], [], 1)
    for i, (start, end) in enumerate(pairwise(angle)):
        middle = 0.5 * (start + end)
        back = arc(centre, outer, start, end)
        ring.sections.append(
            geometry.sector_section(centre, radius, thickness, start, end)
        )
        ring.outlines.append(
            np.concatenate([arc(centre, inner, start, end), back[::-1]])
        )
        ring.backs.append(centre + outer * np.array([np.sin(middle), np.cos(middle)]))
        bulge = -math.tan(0.25 * (end - start))  # clockwise
        ring.surfaces.append(np.column_stack([extrados[i : i + 2], [bulge, 0.0]]))
    return ring


def segmental_ring(
    span: float, rise: float, thickness: float, fraction: FloatArray, sector: bool
) -> Ring:
    """Return the ring of a circular arch by its span and rise, which is at most half the span.

    `sector` is as for `circular_ring`.
    """
    radius = (0.25 * span**2 + rise**2) / (2.0 * rise)
    angle = 4.0 * math.atan2(2.0 * rise, span) * fraction
    return circular_ring(
        np.array([0.0, rise - radius]), radius, thickness, angle, sector
    )


def _travel_sense(intrados: FloatArray, extrados: FloatArray) -> int:
    """Check a ring, and return the side of its intrados as in `Ring.sense`.

    `GeometryError` if a voussoir is no convex quadrilateral, or if two overlap.
    """
    quads = np.stack([intrados[:-1], intrados[1:], extrados[1:], extrados[:-1]], axis=1)
    side = np.roll(quads, -1, axis=1) - quads
    with np.errstate(invalid="ignore"):  # corners that coincide are refused below
        side /= np.hypot(side[..., 0], side[..., 1])[..., None]
    bend = cross(side, np.roll(side, -1, axis=1))
    left = (bend > _TOLERANCE).all(axis=1)
    sense = left.astype(int) - (bend < -_TOLERANCE).all(axis=1)
    if not sense.all():
        body = int(np.argmin(np.abs(sense)))
        raise GeometryError(
            f"voussoir {body} is no convex quadrilateral: its corners "
            f"{', '.join(map(geometry.place_text, quads[body]))} must be one in "
            f"this order; joints {body} and {body + 1} must neither cross nor touch inside the "
            "ring (make it thinner, or its joints more even)"
        )
    if np.any(sense != sense[0]):
        body = int(np.argmax(sense != sense[0]))
        raise GeometryError(
            f"voussoir {body} lies on the same side of joint {body} as voussoir "
            f"{body - 1}: intrados and extrados must run on along the ring from joint "
            "to joint"
        )
    shapes = shapely.polygons(quads)
    rim = _TOLERANCE * np.hypot(*np.ptp(quads, (0, 1)))
    found = geometry.overlap_of(
        shapes, shapely.buffer(shapes, -rim, join_style="mitre")
    )
    if found:
        raise GeometryError(
            f"voussoirs {found[0]} and {found[1]} overlap by {found[2]:.3g} m2; the ring must "
            "not cross itself"
        )
    return int(sense[0])


def chain_of(
    ring: Ring,
    friction: FloatArray,
    surface_density: FloatArray,
    loads: Iterable[tuple[FloatArray, FloatArray]],
) -> Chain:
    """Return the voussoirs of a ring as a chain of rigid bodies.

    It has as many joints as `friction` has entries; `surface_density` is that of each body
    [kg/m2]. Each load is a point mass on each body: its weights ``(n,)`` [N] and places ``(n, 2)``
    [m]. A point mass p at the distance d from the centroid of a body of mass m and inertia J moves
    the centroid by p/(m + p) of d and gives J + m p/(m + p) d² about the new one.
    """
    area, centroid, polar = (np.array(each) for each in zip(*ring.sections))
    # Whatever overflows here is refused below.
    with np.errstate(all="ignore"):
        mass = surface_density * area
        inertia = surface_density * polar
        for weight, place in loads:
            added = weight / STANDARD_GRAVITY
            own = mass
            mass = own + added
            lever = place - centroid
            inertia = inertia + own * (added / mass) * (lever**2).sum(axis=1)
            centroid = centroid + (added / mass)[:, None] * lever
        good = (
            (mass > 0.0)
            & (inertia > 0.0)
            & np.isfinite(mass + inertia + centroid.sum(axis=1))
        )
    if not good.all():
        body = int(np.argmin(good))
        raise GeometryError(
            f"voussoir {body} has a mass of {mass[body]:.6g} kg and an inertia of "
            f"{inertia[body]:.6g} kg m2; both must be finite and greater than 0. "
            "Check its size, density, depth and loads"
        )
    pairs = pairs_of(friction.size, ring.body)
    grounds = np.zeros((pairs.max() + 2 - mass.size, 2))  # whose frame is at the origin
    frame = np.concatenate([centroid, grounds])[pairs]
    corners = np.stack([ring.intrados, ring.extrados][:: ring.sense], axis=1)
    before, after = (corners[: friction.size] - frame[:, side, None] for side in (0, 1))
    centroid = np.ascontiguousarray(centroid)
    given = mass, inertia, centroid, before, after, friction, STANDARD_GRAVITY
    return Chain(*given, body=ring.body)
