"""From what an arch is given to its chain of bodies: ring, piers, fill, and checks of all."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.arch import bridge, checks
from archfrag.arch import ring as rings
from archfrag.errors import GeometryError


class Given(NamedTuple):
    """What an arch is built of; `piers` and `fill` are arguments of `on_piers` and `filled`."""

    profile: str
    shape: dict[str, Any]
    ring: rings.Ring
    friction: ArrayLike
    free_end: bool = False
    density: ArrayLike = 2000.0
    depth: ArrayLike = 1.0
    dead_load: ArrayLike | None = None
    piers: dict[str, Any] | None = None
    fill: dict[str, Any] | None = None


def fields_of(given: Given) -> dict[str, Any]:
    """Return the attributes of an `Arch`, from what it is built of, which is checked here."""
    count = len(given.ring.outlines)
    if given.piers is not None or given.fill is not None:
        bridge.check_upright(given.ring, given.free_end)
    load = 0.0 if given.dead_load is None else given.dead_load
    weight = checks.shared_or_each("dead_load", load, count, "voussoir", "N")
    density, depth = (
        checks.shared_or_each(
            name, value, count, "voussoir", unit, least=checks.SMALLEST
        )
        for name, value, unit in (
            ("density", given.density, "kg/m3"),
            ("depth", given.depth, "m"),
        )
    )
    more: dict[str, Any] = {}
    ring = given.ring
    springings = (0, count)
    joints = count + (not given.free_end)
    if given.piers is None:
        friction = checks.shared_or_each(
            "friction", given.friction, joints, "joint", infinite=checks.ROUGH
        )
    else:
        piers = bridge.checked_piers(**given.piers)
        left, right = piers["courses"]
        ring = bridge.on_piers(ring, piers)
        springings = (left, left + count)
        friction = _friction_on_piers(given.friction, joints, piers)
        weight = np.pad(weight, (left, right))
        density = bridge.extended(density, piers, "density")
        depth = bridge.extended(depth, piers, "depth")
        more["piers"] = {name: each and plain(each) for name, each in piers.items()}
        more["piers"]["courses"] = piers["courses"]
    loads = [(weight, np.array(ring.backs))]
    if given.fill is not None:
        more["fill"] = bridge.checked_fill(**given.fill)
        loads.append(bridge.weight_of_fill(ring, springings, more["fill"], depth))
    if given.profile != "block":
        # With fill, none would say that nothing lies on the ring.
        more["dead_load"] = plain(given.dead_load if given.fill is None else load)
    matter = {
        name: plain(getattr(given, name)) for name in ("friction", "density", "depth")
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


def _friction_on_piers(
    friction: ArrayLike, joints: int, piers: dict[str, Any]
) -> NDArray[np.float64]:
    """Return the friction of all joints: given for each, or for those of the ring."""
    every = joints + sum(piers["courses"])
    if np.shape(friction) != (every,):
        return bridge.extended(_coefficients(friction, joints), piers, "friction")
    if piers["friction"] is not None:
        raise GeometryError(
            "piers.friction is given, and friction for each of their joints"
        )
    return _coefficients(friction, every)


def _coefficients(friction: ArrayLike, count: int) -> NDArray[np.float64]:
    return checks.shared_or_each(
        "friction", friction, count, "joint", infinite=checks.ROUGH
    )


def plain(value: ArrayLike | None) -> Any:
    """Return the numbers as strict JSON takes them: nested lists of floats, infinity as "inf"."""
    if value is None:
        return None
    numbers = np.asarray(value, dtype=float).astype(object)
    numbers[numbers == math.inf] = "inf"
    return numbers.tolist()
