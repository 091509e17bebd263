"""Build the chain of bodies of an arch: ring, piers, fill and ties, with their checks."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple

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
    """Inputs that an arch is built of.

    `piers` and `fill` hold the arguments of `Arch.on_piers` and `Arch.filled`, if it has any.
    """

    profile: str
    shape: Named
    ring: rings.Ring
    friction: ArrayLike
    free_end: bool = False
    density: ArrayLike = 2000.0
    depth: ArrayLike = 1.0
    dead_load: ArrayLike | None = None
    piers: Named | None = None
    fill: Named | None = None


def fields_of(given: Given) -> Named:
    """Check the inputs of an arch and return the attributes of `Arch` by name.

    `GeometryError` names the parameter that is impossible.
    """
    ring = given.ring
    count = len(ring.outlines)
    if given.piers is not None or given.fill is not None:
        bridge.check_upright(ring, given.free_end)
    load = 0.0 if given.dead_load is None else given.dead_load
    weight = checks.shared_or_each("dead_load", load, count, "voussoir")
    density = checks.shared_or_each("density", given.density, count, "voussoir")
    depth = checks.shared_or_each("depth", given.depth, count, "voussoir")
    more: Named = {}
    left = 0
    if given.piers is None:
        friction = _coefficients(given, count)
    else:
        piers = bridge.checked_piers(**given.piers)
        left, right = piers["courses"]
        ring = bridge.on_piers(ring, piers)
        if np.shape(given.friction) != (count + 1 + left + right,):
            friction = bridge.extended(_coefficients(given, count), piers, "friction")
        elif piers["friction"] is None:
            friction = _coefficients(given, count + left + right)
        else:
            raise GeometryError(
                "piers.friction is given, and friction for each of their joints"
            )
        weight = np.pad(weight, (left, right))
        density = bridge.extended(density, piers, "density")
        depth = bridge.extended(depth, piers, "depth")
        more["piers"] = {name: each and plain(each) for name, each in piers.items()}
        more["piers"]["courses"] = piers["courses"]
    loads = [(weight, np.array(ring.backs))]
    if given.fill is not None:
        more["fill"] = bridge.checked_fill(**given.fill)
        springings = (left, left + count)
        loads.append(bridge.weight_of_fill(ring, springings, more["fill"], depth))
    if given.profile != "block":
        # With fill, none would say that nothing lies on the ring.
        more["dead_load"] = plain(given.dead_load if given.fill is None else load)
    matter = {
        name: plain(value)
        for name, value in given._asdict().items()
        if name in VARIABLE and name != "dead_load"
    }
    return {
        "chain": rings.chain_of(ring, friction, density * depth, loads),
        "intrados": ring.intrados,
        "extrados": ring.extrados,
        "outlines": tuple(ring.outlines),
        "free_end": given.free_end,
        "flipped": ring.sense < 0,
        "given": given,
        "parameters": {"profile": given.profile, **given.shape, **matter, **more},
    }


def _coefficients(given: Given, bodies: int) -> FloatArray:
    joints = bodies + (not given.free_end)
    return checks.shared_or_each("friction", given.friction, joints, "joint")


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
    both = _checked_ends(arch, ends) if level is None else _at_level(arch, float(level))
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


def _at_level(arch: Shape, level: float) -> list[End]:
    """Return the leftmost and the rightmost point of the outlines at a height, as ends of a tie.

    `GeometryError` unless they lie on two voussoirs.
    """
    found: list[End] = []
    for body, outline in enumerate(arch.outlines):
        for (x, y), (u, v) in zip(outline.tolist(), following(outline).tolist()):
            if (y - level) * (v - level) <= 0.0 and y != v:
                found.append((body, x + (level - y) / (v - y) * (u - x), level))
    outermost = [end(found, key=itemgetter(1)) for end in (min, max) if found]
    if len({body for body, *_ in outermost}) < 2:
        height = np.concatenate(arch.outlines)[:, 1]
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
    last = arch.n_voussoir - 1 + (not arch.free_end)
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
