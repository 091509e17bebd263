"""What a user can check an arch by: weights, forces, places; and values in an unlikely unit."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np

from archfrag.arch.building import fields_of
from archfrag.arch.shape import Shape
from archfrag.arch.tie_rods import tie_lines
from archfrag.errors import UnitWarning
from archfrag.usual import unusual

# What is usual of forces and elongations of ties, by their stress [N/m2] and strain.
STRESSES = {"prestress": (5e5, 3e9), "strength": (5e6, 5e9)}
LARGEST_STRAIN = 0.3  # at which a tie breaks
LOADS = 1e-3, 100.0  # dead load over the weight of the ring
_quiet: ContextVar[bool] = ContextVar("quiet", default=False)


def facts_of(arch: Shape) -> dict[str, Any]:
    """Return what can be checked by hand: dimensions, places [m], weights and forces [N].

    Keys are span, rise and thickness; springings, the ends of their joints at intrados and
    extrados (only one with a free end); weights of ring, piers, fill (with backing) and dead_load;
    and ties, with ends, prestress and strength of each.
    """
    span, rise, thickness = arch.dimensions
    first, last = arch.springings
    lines = arch.ring_lines
    if arch.chain.start is not None:  # where they have moved to
        lines = arch.intrados[first : last + 1], arch.extrados[first : last + 1]
    joints = np.stack(lines, axis=1)
    gravity = arch.chain.gravity
    given = arch.parameters
    fill = 0.0
    masonry = arch.chain.mass * gravity
    if "fill" in given:
        without = fields_of(arch.given._replace(fill=None))["chain"].mass * gravity
        fill = float((masonry - without).sum())
        masonry = without
    load = given.get("dead_load") or 0.0
    dead = float(np.broadcast_to(load, last - first).sum())
    ring = float(masonry[first:last].sum()) - dead
    piers = float(masonry[:first].sum() + masonry[last:].sum())
    weights = {"ring": ring, "piers": piers, "fill": fill, "dead_load": dead}
    ties = [
        {
            "ends": ends.tolist(),
            "strength": tie.get("strength"),
            "prestress": tie.get("prestress", 0.0),
        }
        for tie, ends in zip(given.get("ties", ()), tie_lines(arch))
    ]
    return {
        "span": span,
        "rise": rise,
        "thickness": thickness,
        "springings": joints[[0] if arch.free_end else [0, -1]].tolist(),
        "weights": weights,
        "ties": ties,
    }


def facts_text(arch: Shape) -> str:
    """Write weights, forces of ties and places of springings in one line."""
    facts = facts_of(arch)
    free = arch.free_end
    names = {
        "ring": "the blocks weigh" if free else "the ring weighs",
        "dead_load": "dead load",
    }
    texts = [
        ", ".join(
            f"{names.get(name, name)} {force_text(weight)}"
            for name, weight in facts["weights"].items()
            if weight > 0.0
        )
    ]
    for number, tie in enumerate(facts["ties"], 1):
        name = f"tie {number}" if len(facts["ties"]) > 1 else "the tie"
        limit = (
            ""
            if (most := tie["strength"]) is None
            else f" and yields at {force_text(most)}"
        )
        pull = tie["prestress"]
        force = f"pulls with {force_text(pull)}" if pull else "is not tight"
        texts.append(f"{name} {force}{limit}")
    ends = [f"({x:.4g}, {y:.4g})" for joint in facts["springings"] for x, y in joint]
    if free:
        return "; ".join([*texts, f"it stands from {ends[1]} to {ends[0]} m"])
    return "; ".join([*texts, f"springings at {ends[0]} and {ends[2]} m (intrados)"])


def force_text(force: float) -> str:
    """Write a force in N below 1 kN, in kN up to 10 MN, else in MN."""
    scale, unit = (
        (1.0, "N") if force < 1e3 else (1e3, "kN") if force < 1e7 else (1e6, "MN")
    )
    return f"{force / scale:.3g} {unit}"


def unit_cautions(arch: Shape, *keys: str) -> list[str]:
    """Name values that are probably in another unit; of some keys, or of all."""
    return [text for key, text in _doubtful(arch) if not keys or key.startswith(keys)]


def _doubtful(arch: Shape) -> Iterator[tuple[str, str]]:
    """Yield the keys with values beyond what is usual, and what is to be said of them."""
    given = arch.parameters
    span, _, thickness = arch.dimensions
    first, last = arch.springings
    # Springings of a horseshoe are nearer to each other than its haunches.
    span = max(span, float(np.ptp(arch.intrados[first : last + 1, 0])))
    values: dict[str, Any] = {"thickness": thickness, "span": span}
    if arch.free_end:
        values = {"height": float(np.ptp(np.concatenate(arch.outlines)[:, 1]))}
    values |= {
        key: given[key] for key in ("density", "depth", "strength") if key in given
    }
    if stiffness := arch.joint_keys.get("stiffness"):
        known = np.array(stiffness, dtype=float)
        values["joints.stiffness"] = known[np.isfinite(known)]
    for part in ("piers", "fill"):
        values |= {f"{part}.{key}": value for key, value in given.get(part, {}).items()}
    if not values.get("fill.backing_height"):
        values.pop("fill.backing_unit_weight", None)
    friction = arch.chain.friction
    values["friction"] = friction[
        np.isfinite(friction)
    ]  # infinite: the limit of large friction
    for key, value in values.items():
        yield from ((key, text) for text in unusual(key, value))
    if load := np.sum(given.get("dead_load") or 0.0):
        load *= 1 if np.ndim(given["dead_load"]) else last - first
        weight = facts_of(arch)["weights"]["ring"]
        if not LOADS[0] <= load / weight <= LOADS[1]:
            on = f"on a ring of {force_text(weight)}"
            yield "dead_load", f"dead_load is {force_text(load)} {on}; is it in N?"
    for number, (tie, ends) in enumerate(zip(given.get("ties", ()), tie_lines(arch))):
        place = f"ties[{number}]"
        for key in ("area", "modulus"):
            name = f"{place}.{key}"
            yield from (
                (name, text) for text in unusual(f"ties.{key}", tie.get(key), name)
            )
        for key, (least, most) in STRESSES.items():
            if (force := tie.get(key)) and not least <= (
                stress := force / tie["area"]
            ) <= most:
                text = (
                    f"{place}.{key} = {force:g} N on an area of "
                    f"{tie['area']:g} m2 is a stress of"
                )
                usual = f"usual are {least:g} to {most:g}: are they in N and m2?"
                yield f"{place}.{key}", f"{text} {stress:.3g} N/m2; {usual}"
        length = float(np.hypot(*(ends[1] - ends[0])))
        if tie.get("rupture", 0.0) > LARGEST_STRAIN * length:
            text = f"{place}.rupture = {tie['rupture']:g} m is that of a tie of {length:.3g} m"
            yield f"{place}.rupture", f"{text}; is it in m?"


@contextmanager
def no_unit_warnings() -> Iterator[None]:
    """Keep arches that are built inside from warning: a study has cautions of its own."""
    token = _quiet.set(True)
    try:
        yield
    finally:
        _quiet.reset(token)


def warn_of_units(arch: Shape, *keys: str, texts: Iterable[str] = ()) -> None:
    """Warn of values that are probably in another unit, of some keys or of all, and by `texts`."""
    if _quiet.get():
        return
    level = 1  # the line to blame is the first one outside archfrag
    frame = sys._getframe()
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("archfrag."):
        level = level + 1
        frame = frame.f_back
    for text in [*unit_cautions(arch, *keys), *texts]:
        warnings.warn(text, UnitWarning, stacklevel=level)
