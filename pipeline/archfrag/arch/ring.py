"""From joint lines to voussoirs, and the refusal of rings that cannot be built."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.arch.geometry import (
    Section,
    arc,
    cross,
    middle_of,
    place_text,
    polygon_section,
    sector_section,
)
from archfrag.arch.profiles import JointLines
from archfrag.errors import GeometryError

# Corners closer than this part of the ring's size, or sides that differ by a smaller
# angle [rad], are taken for a slip of the user's.
_TOLERANCE = 1e-9


class Voussoir(NamedTuple):
    """Plane figure of one body."""

    section: Section
    outline: NDArray[np.float64]  # (m, 2) intrados, then extrados backwards; not closed [m]
    back: NDArray[np.float64]  # (2,) middle of the back, where its dead load sits [m]


class Ring(NamedTuple):
    """Voussoirs between joint lines."""

    voussoirs: list[Voussoir]
    lines: JointLines
    sense: int  # +1: intrados to the right from joint 0 to the last, -1: to the left


def straight_ring(lines: JointLines) -> Ring:
    """Straight-sided voussoirs between joint lines; a keystone over an apex keeps its point."""
    sense = travel_sense(lines)
    ends = np.delete(np.arange(len(lines.intrados)), lines.apex if lines.apex >= 0 else [])
    figures = []
    for first, last in pairwise(ends):
        intrados = lines.intrados[first : last + 1]
        extrados = lines.extrados[first : last + 1]
        outline = np.concatenate([intrados, extrados[::-1]])
        figures.append(Voussoir(polygon_section(outline), outline, middle_of(extrados)))
    return Ring(figures, JointLines(lines.intrados[ends], lines.extrados[ends]), sense)


def circular_ring(
    centre: NDArray[np.float64],
    radius: float,
    thickness: float,
    angle: NDArray[np.float64],
    sector: bool,
) -> Ring:
    """Annular sectors, or straight-sided voussoirs, between radial joints.

    `angle` of the joints is clockwise from the upward vertical [rad].
    """
    inner, outer = radius - 0.5 * thickness, radius + 0.5 * thickness
    direction = np.column_stack([np.sin(angle), np.cos(angle)])
    lines = JointLines(centre + inner * direction, centre + outer * direction)
    if not sector:
        return straight_ring(lines)
    check_corners_apart(lines)
    figures = []
    for start, end in pairwise(angle):
        back = arc(centre, outer, start, end)
        outline = np.concatenate([arc(centre, inner, start, end), back[::-1]])
        middle = 0.5 * (start + end)
        top = centre + outer * np.array([np.sin(middle), np.cos(middle)])
        section = sector_section(centre, radius, thickness, start, end)
        figures.append(Voussoir(section, outline, top))
    return Ring(figures, lines, 1)


def check_corners_apart(lines: JointLines) -> None:
    """Refuse joints of no length, and neighbouring joints that have a corner in common."""
    every = np.concatenate([lines.intrados, lines.extrados])
    least = _TOLERANCE * float(np.hypot(*np.ptp(every, axis=0)))
    pairs = [("intrados and extrados", lines.intrados, lines.extrados)]
    pairs += [(name, side[:-1], side[1:]) for name, side in zip(lines._fields, lines[:2])]
    for name, one, other in pairs:
        length = np.hypot(*(other - one).T)
        if np.any(length <= least):
            joint = int(np.argmin(length))
            joints = f"joint {joint}" if "and" in name else f"joints {joint} and {joint + 1}"
            raise GeometryError(
                f"the {name} corners of {joints} coincide at {place_text(one[joint])}; they must "
                f"be more than {least:.3g} m apart"
            )


def travel_sense(lines: JointLines) -> int:
    """Refuse rings that cannot be, and return the side on which the intrados lies."""
    check_corners_apart(lines)
    inner, outer = lines.intrados, lines.extrados
    quads = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1]], axis=1)
    side = np.roll(quads, -1, axis=1) - quads
    side /= np.hypot(side[..., 0], side[..., 1])[..., None]
    bend = cross(side, np.roll(side, -1, axis=1))
    sense = np.where((bend > _TOLERANCE).all(1), 1, np.where((bend < -_TOLERANCE).all(1), -1, 0))
    if not sense.all():
        body = int(np.argmin(np.abs(sense)))
        corners = ", ".join(map(place_text, quads[body]))
        raise GeometryError(
            f"voussoir {body} is no convex quadrilateral: its corners {corners} must be one in "
            f"this order, and joints {body} and {body + 1} must neither cross nor touch"
        )
    if np.any(sense != sense[0]):
        body = int(np.argmax(sense != sense[0]))
        raise GeometryError(
            f"voussoir {body} lies on the same side of joint {body} as voussoir {body - 1}: the "
            "ring doubles back there; intrados and extrados must run on along the ring from "
            "joint to joint"
        )
    _refuse_overlap(quads)
    return int(sense[0])


def _refuse_overlap(quads: NDArray[np.float64]) -> None:
    """Refuse convex quadrilaterals ``(n, 4, 2)`` of which any two overlap.

    Neighbours lie on either side of the line of their joint and cannot. Two others overlap if no
    side of theirs separates them.
    """
    low, high = quads.min(axis=1), quads.max(axis=1)
    near = (low[:, None] < high[None]).all(axis=2)
    first, second = np.nonzero(np.triu(near & near.T, 2))
    pairs = quads[np.stack([first, second])]  # (2, n_pair, 4, 2)
    side = np.roll(pairs, -1, axis=2) - pairs
    side /= np.hypot(side[..., 0], side[..., 1])[..., None]
    normal = np.concatenate([side[0], side[1]], axis=1)[..., ::-1] * [1.0, -1.0]
    along = np.einsum("pnci,nki->pnkc", pairs, normal)
    depth = along.max(axis=3).min(axis=0) - along.min(axis=3).max(axis=0)
    overlaps = np.flatnonzero(depth.min(axis=1) > _TOLERANCE * np.hypot(*np.ptp(quads, (0, 1))))
    if overlaps.size:
        pair = overlaps[0]
        raise GeometryError(
            f"voussoirs {first[pair]} and {second[pair]} overlap by {depth[pair].min():.3g} m; "
            "the ring must not cross itself"
        )
