"""Build the chain of bodies of an arch: ring, piers, fill and ties, with their checks."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import bridge, checks
from archfrag.arch import ring as rings
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import following, length_of
from archfrag.errors import GeometryError
from archfrag.files import Named
from archfrag.properties import SMALLEST, VARIABLE

if TYPE_CHECKING:
    from archfrag.arch.shape import Shape

End = tuple[int, float, float]  # end of a tie: voussoir, x and y [m]


class Given(NamedTuple):
    """Inputs that an arch, or the first span of a bridge, is built of.

    `piers` and `ends` are those of `Bridge`, `fill` holds the arguments of `Arch.filled`. On piers
    `friction` may be that of each joint of the whole arch.
    """

    profile: str
    shape: Named
    ring: rings.Ring
    friction: ArrayLike
    free_end: bool = False
    density: ArrayLike = 2000.0
    depth: ArrayLike = 1.0
    dead_load: ArrayLike | None = None
    spans: tuple[Given, ...] = ()  # the others
    piers: Any = ()
    ends: Any = None
    fill: Named | None = None


def fields_of(given: Given) -> Named:
    """Check the inputs of an arch and return the attributes of `Arch` by name.

    `GeometryError` names the parameter that is impossible.
    """
    spans = (given, *given.spans)
    if given.spans or given.ends or given.fill:
        for each in spans:
            bridge.check_upright(each.ring, each.free_end)
    piers = bridge.listed("piers", given.piers, len(given.spans))
    ends = bridge.listed("ends", given.ends, 2)
    ring = bridge.joined([each.ring for each in spans], piers, ends)
    parts = ring.parts
    if given.free_end:
        parts = (parts[0]._replace(joints=range(len(ring.intrados) - 1)),)
    legs = [each for each in (ends[0], *piers, ends[1]) if each]
    friction = _over("friction", parts, spans, legs)
    depth = _over("depth", parts, spans, legs)
    loads = [(_over("dead_load", parts, spans, legs), np.array(ring.backs))]
    more: Named = {}
    if given.fill is not None:
        more["fill"] = bridge.checked_fill(**given.fill)
        loads.append(bridge.weight_of_fill(ring, more["fill"], depth))
    for name, rows in (("piers", piers), ("ends", ends)):
        if any(rows):
            same = all(pier == rows[0] for pier in rows)
            more[name] = rows[0] if same else [pier or None for pier in rows]
    surface_density = _over("density", parts, spans, legs) * depth
    return {
        "chain": rings.chain_of(ring, friction, surface_density, loads),
        "intrados": ring.intrados,
        "extrados": ring.extrados,
        "outlines": tuple(ring.outlines),
        "free_end": given.free_end,
        "flipped": ring.sense < 0,
        "given": given,
        "parameters": _parameters(spans) | more,
        "parts": parts,
        "whole": ring,
        "depths": depth,
    }


def _over(
    key: str,
    parts: Sequence[rings.Part],
    spans: Sequence[Given],
    legs: Sequence[Named],
) -> FloatArray:
    """Return the values of a key of all bodies, or of all joints if it is friction.

    `legs` are the keys of the piers, from left to right.
    """
    noun = "joint" if key == "friction" else "voussoir"
    joints = sum(len(part.joints) for part in parts)
    whole = legs and noun == "joint" and np.shape(spans[0].friction) == (joints,)
    if whole and any(leg["friction"] is not None for leg in legs):
        raise GeometryError("a pier has friction, and so has each joint; leave one out")
    if whole or not legs:  # a drawing may have parts without keys of their own
        value = getattr(spans[0], key)
        size = joints if noun == "joint" else sum(len(part.every) for part in parts)
        return checks.shared_or_each(key, 0.0 if value is None else value, size, noun)
    left = iter(spans), iter(legs)
    values: list[Any] = []
    for part in parts:
        if "pier" in part.name:
            values.append({"dead_load": 0.0, **next(left[1])})
            continue
        value = getattr(next(left[0]), key)
        size = len(part.joints if noun == "joint" else part.bodies)
        values.append(
            checks.shared_or_each(key, 0.0 if value is None else value, size, noun)
        )
    return bridge.over_parts(parts, values, key)


def _parameters(spans: Sequence[Given]) -> Named:
    """Return what was given of rings, for strict JSON; keys that differ are in `spans`."""
    of_each: list[Named] = []
    for given in spans:
        load = 0.0 if given.dead_load is None and spans[0].fill else given.dead_load
        keys = [key for key in given._fields if key in VARIABLE]
        told = {key: plain(getattr(given, key)) for key in keys if key != "dead_load"}
        # With fill, none would say that nothing lies on the ring.
        told |= {} if given.profile == "block" else {"dead_load": plain(load)}
        of_each.append({"profile": given.profile, **given.shape, **told})
    first, *others = of_each
    if not others:
        return first
    if all(each == first for each in others):
        return first | {"spans": len(of_each)}
    missing = object()
    shared = {
        key: value
        for key, value in first.items()
        if all(each.get(key, missing) == value for each in others)
    }
    own = [
        {
            key: value
            for key, value in each.items()
            if key not in shared and value is not None
        }
        for each in of_each
    ]
    return shared | {"spans": own}


def plain(value: ArrayLike | None):
    """Return numbers for strict JSON: nested lists of floats, infinity as "inf", None as it is."""
    if value is None:
        return None
    numbers = np.asarray(value, dtype=float).astype(object)
    numbers[numbers == np.inf] = "inf"
    return numbers.tolist()


def tie_row(
    arch: Shape,
    level: float | None,
    area: float,
    modulus: float,
    prestress: float,
    strength: float,
    rupture: float,
    ends: Sequence[End] | None,
    span: int,
) -> list[float]:
    """Return the row of ``Chain.tie`` of a tie; arguments are those of `Arch.tied`."""
    if (level is None) == (ends is None):
        raise GeometryError("a tie needs either its level or its ends")
    stiff = checks.number("ties.area", area, closed=False)
    stiff *= checks.number("ties.modulus", modulus, closed=False)
    for name, value, unit in (("strength", strength, "N"), ("rupture", rupture, "m")):
        if not value > 0.0:
            raise GeometryError(
                f"{name} = {value} is impossible; it must exceed 0 {unit}"
            )
    checks.number("ties.prestress", prestress, most=strength)
    both = (
        _checked_ends(arch, ends)
        if level is None
        else _at_level(arch, float(level), span)
    )
    points = np.array([end[1:] for end in both], dtype=float)
    length = length_of(points)
    if not length > SMALLEST:
        raise GeometryError(f"the ends of the tie are {length:g} m apart")
    # In the frame of a body, or of the ground.
    for (body, *_), point in zip(both, points):
        if 0 <= body < arch.n_voussoir:
            point[:] = arch.turn(body) @ (point - arch.centroids[body])
    rate = stiff / length
    stretched = prestress / rate
    if not rupture > stretched:
        raise GeometryError(
            f"rupture = {rupture:g} m is impossible; the tie is {stretched:.4g} m longer at rest, "
            f"by its prestress of {prestress:g} N, and rupture must exceed that (it is an "
            "elongation in m, not a strain)"
        )
    bodies = [body + 1 for body, *_ in both]
    return [*bodies, *points.ravel(), rate, length - stretched, strength, rupture]


def _at_level(arch: Shape, level: float, span: int) -> list[End]:
    """Return the leftmost and the rightmost point of a span at a height, as ends of a tie.

    The piers beside the span belong to it. `GeometryError` unless the points lie on two voussoirs.
    """
    found: list[End] = []
    place = arch.parts.index(arch.spans[span - 1])
    near = arch.parts[max(place - 1, 0) : place + 2]
    bodies = [body for part in near for body in part.every]
    outlines = [arch.outlines[body] for body in bodies]
    for body, outline in zip(bodies, outlines):
        for (x, y), (u, v) in zip(outline.tolist(), following(outline).tolist()):
            if (y - level) * (v - level) <= 0.0 and y != v:
                found.append((body, x + (level - y) / (v - y) * (u - x), level))
    outermost = [end(found, key=itemgetter(1)) for end in (min, max) if found]
    if len({body for body, *_ in outermost}) < 2:
        height = np.concatenate(outlines)[:, 1]
        raise GeometryError(
            f"level = {level:g} m is impossible for a tie; there must be a voussoir "
            f"at either end, and the arch lies between {height.min():.4g} and "
            f"{height.max():.4g} m"
        )
    return outermost


def _checked_ends(arch: Shape, ends: Sequence[End] | None) -> list[End]:
    """Check the two ends of a tie and return them; `GeometryError` if they are impossible."""
    both = [(int(body), float(x), float(y)) for body, x, y in ends or ()]
    bodies = {body for body, *_ in both}
    last = arch.n_voussoir + len(arch.bases) - 2
    on_arch = bodies & {*range(arch.n_voussoir)}
    if (
        len(both) != 2
        or len(bodies) != 2
        or not on_arch
        or bodies - {*range(-1, last + 1)}
    ):
        raise GeometryError(
            f"ends = {ends} is impossible for a tie; it must be two of (voussoir, x, y) with "
            f"different voussoirs from -1 (the left springing) to {last}, not both springings"
        )
    if not np.isfinite([end[1:] for end in both]).all():
        raise GeometryError(
            f"ends = {ends} is impossible for a tie; places must be finite"
        )
    return both
