"""Centre lines of ready-made arches, and the joint lines that stand on them.

All have their springings at height 0 and their crown at x = 0. Their joints are placed by the
fraction of the centre line's length, counted from the crown: −1/2 at the left springing, +1/2 at
the right one.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.arch.geometry import cross
from archfrag.errors import GeometryError

FloatArray = NDArray[np.float64]
# Points of a centre line (n_joint, 2) [m], and its unit normals there, away from the intrados.
CentreLine = tuple[FloatArray, FloatArray]


class JointLines(NamedTuple):
    """Lines across a ring, from left to right; all are joints but one at `apex`, if any."""

    intrados: FloatArray  # (n_line, 2) [m]
    extrados: FloatArray  # (n_line, 2) [m]
    apex: int = -1  # index of the line at a pointed crown that is no joint


def ellipse(span: float, rise: float, fraction: FloatArray) -> CentreLine:
    """Upper half of an ellipse.

    With a = span/2, b = rise and the point (a sin u, b cos u), the length from the crown is
    a E(u | 1 − b²/a²), the incomplete elliptic integral of the second kind.
    """
    from scipy.optimize import brentq
    from scipy.special import ellipeinc

    a, b, right = 0.5 * span, rise, 0.5 * math.pi
    parameter = 1.0 - (b / a) ** 2
    quarter = float(ellipeinc(right, parameter))

    def at(part: float) -> float:
        length = 2.0 * abs(part) * quarter
        root = brentq(
            lambda u: float(ellipeinc(u, parameter)) - length, 0.0, right, xtol=1e-15, rtol=1e-15
        )
        return math.copysign(root, part)

    u = np.array([at(float(part)) for part in fraction])
    sine, cosine = np.sin(u), np.cos(u)
    # The springings are exact, where cos(pi/2) is not quite zero.
    sine[0], cosine[0], sine[-1], cosine[-1] = -1.0, 0.0, 1.0, 0.0
    outward = np.column_stack([b * sine, a * cosine])
    outward /= np.hypot(outward[:, :1], outward[:, 1:])
    return np.column_stack([a * sine, b * cosine]), outward


def catenary(span: float, rise: float, fraction: FloatArray) -> CentreLine:
    """Hanging chain upside down.

    y = rise − c (cosh(x/c) − 1) with c = span/(2 w) from (cosh w − 1)/w = 2 rise/span; the
    length from the crown is c sinh(x/c).
    """
    from scipy.optimize import brentq

    slenderness = 2.0 * rise / span
    # (cosh w − 1)/w exceeds w/2 everywhere, and exp(w/2)/4 beyond w = 4.
    above = min(2.0 * slenderness, max(4.0, 2.0 * math.log(4.0 * slenderness + 1.0)))
    above *= 1.0 + 1e-12
    w = brentq(
        lambda w: 2.0 * math.sinh(0.5 * w) ** 2 / w - slenderness,
        0.5 * min(above, 1e-9), above, xtol=1e-300, rtol=1e-15,
    )  # fmt: skip
    c = 0.5 * span / w
    slope = 2.0 * fraction * math.sinh(w)
    x = c * np.arcsinh(slope)
    secant = np.hypot(1.0, slope)
    # cosh − 1 without cancellation: slope²/(1 + secant).
    y = rise - c * slope**2 / (1.0 + secant)
    x[0], x[-1], y[0], y[-1] = -0.5 * span, 0.5 * span, 0.0, 0.0
    outward = np.column_stack([slope / secant, 1.0 / secant])
    return np.column_stack([x, y]), outward


def normal_lines(
    curve: Callable[[float, float, FloatArray], CentreLine],
    shape: dict[str, float],
    fraction: FloatArray,
) -> JointLines:
    """Joint lines perpendicular to the centre line of a curve's span and rise."""
    span, rise, thickness = shape.values()
    (point, outward), profile = curve(span, rise, fraction), curve.__name__
    step = np.diff(point, axis=0)
    here, there = outward[:-1], outward[1:]
    behind = np.minimum(-cross(here, step), -cross(there, step)) <= 0.0
    if behind.any():
        joint = int(np.argmax(behind))
        raise GeometryError(
            f"joints {joint} and {joint + 1} of this {profile} of span {span} m and rise {rise} m "
            "stand too unevenly round its crown for a straight-sided voussoir between them; place "
            "a joint nearer to the crown, or make all voussoirs equal"
        )
    bend = cross(here, there)
    # Distance along each of two neighbouring joints to where their lines meet.
    with np.errstate(divide="ignore"):
        meeting = np.minimum(np.abs(cross(step, there) / bend), np.abs(cross(step, here) / bend))
    _refuse_crossing(shape, 2.0 * meeting, profile, range(len(meeting)))
    offset = 0.5 * thickness * outward
    return JointLines(point - offset, point + offset)


def pointed_lines(shape: dict[str, float], fraction: FloatArray) -> JointLines:
    """Joint lines of two circular arcs that meet at the crown.

    The left arc has its centre on the springing line at x = d = (rise² − span²/4)/span and the
    radius d + span/2. The extrados and intrados arcs are cut by the vertical x = 0.
    """
    span, rise, thickness = shape.values()
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
    left = int(np.flatnonzero(sign < 0.0)[-1])
    right = left + 1
    # Distance along the joints next to the crown to where they reach the vertical x = 0.
    both = slice(left, right + 1)
    limit = 2.0 * np.abs(centre[both, 0] / outward[both, 0] + radius)
    _refuse_crossing(shape, limit, "pointed arch", (left, right if at_crown else left))
    inner, outer = radius - 0.5 * thickness, radius + 0.5 * thickness
    apex = np.array([[0.0, math.sqrt(r**2 - reach**2)] for r in (inner, outer)])
    return JointLines(
        np.insert(centre + inner * outward, right, apex[0], axis=0),
        np.insert(centre + outer * outward, right, apex[1], axis=0),
        -1 if at_crown else right,
    )


def _refuse_crossing(
    shape: dict[str, float], limit: FloatArray, profile: str, first_of_pair: Sequence[int]
) -> None:
    """Refuse a thickness at or above the smallest limit, each that of one pair of joints."""
    if shape["thickness"] < limit.min():
        return
    joint = first_of_pair[int(np.argmin(limit))]
    raise GeometryError(
        f"thickness = {shape['thickness']} m is impossible for this {profile} of span "
        f"{shape['span']} m and rise {shape['rise']} m: joints {joint} and {joint + 1} would "
        f"cross inside the ring; it must be less than {limit.min():.6g} m"
    )
