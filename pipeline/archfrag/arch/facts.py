"""Facts to check an arch by (weights, forces, places), and warnings of unlikely units."""

import math
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from typing import Any

import numpy as np

from archfrag.arch.building import fields_of
from archfrag.arch.geometry import length_of
from archfrag.arch.shape import Shape
from archfrag.errors import UnitWarning
from archfrag.files import Named
from archfrag.properties import PROPERTIES, unusual, value_of

# Usual stresses of ties by their forces [N/m2]: least and largest.
STRESSES = {"prestress": (5e5, 3e9), "strength": (5e6, 5e9)}
LARGEST_STRAIN = 0.3  # usual strain at which a tie breaks
FORCES: Any = (1e3, 1.0, "N"), (1e7, 1e3, "kN"), (math.inf, 1e6, "MN")
LOADS = 1e-3, 100.0  # usual dead load over the weight of the ring: least and largest
# Whether arches are built inside, for a study, which has cautions of its own.
quiet: ContextVar[bool] = ContextVar("quiet", default=False)


def facts_of(arch: Shape) -> Named:
    """Return what can be checked by hand: dimensions, places [m], weights and forces [N].

    Keys are span, rise and thickness, of the widest ring; springings, the ends of their joints at
    intrados and extrados (only one with a free end); weights of ring, piers, fill (with backing)
    and dead_load; and ties, with ends, prestress and strength of each.
    """
    span, rise, thickness = arch.dimensions
    # Where they have moved to, if they have.
    still = arch.whole if arch.joints and arch.chain.start is None else arch
    ends = [each.joints[end] for each in arch.spans for end in (0, -1)]
    ends = ends[:1] if arch.free_end else ends
    gravity = arch.chain.gravity
    given = arch.parameters
    fill = 0.0
    masonry = arch.chain.mass * gravity
    if "fill" in given:
        without = fields_of(arch.given._replace(fill=None))["chain"].mass * gravity
        fill = float((masonry - without).sum())
        masonry = without
    dead = dead_weight(arch)
    rings = [body for each in arch.spans for body in each.bodies]
    ring = float(masonry[rings].sum()) - dead
    piers = float(np.delete(masonry, rings).sum())
    return {
        "span": span,
        "rise": rise,
        "thickness": thickness,
        "springings": np.stack([still.intrados, still.extrados], axis=1)[ends].tolist(),
        "weights": {"ring": ring, "piers": piers, "fill": fill, "dead_load": dead},
        "ties": [
            {
                "ends": ends.tolist(),
                "strength": tie.get("strength"),
                "prestress": tie["prestress"],
            }
            for tie, ends in zip(given.get("ties", ()), arch.tie_lines)
        ],
    }


def dead_weight(arch: Shape) -> float:
    """Return the dead load on all rings [N]."""
    loads = [
        np.broadcast_to(
            np.nan_to_num(np.array(given.dead_load, float)), len(span.bodies)
        )
        for given, span in zip((arch.given, *arch.given.spans), arch.spans)
    ]
    return float(np.sum(np.concatenate(loads)))


def facts_text(arch: Shape) -> str:
    """Return weights, forces of ties and places of springings as one line of text."""
    facts = facts_of(arch)
    names = {
        "ring": "the ring weighs",
        "dead_load": "dead load",
    }
    if arch.free_end or len(arch.spans) > 1:
        names["ring"] = f"the {'blocks' if arch.free_end else 'rings'} weigh"
    weights = [
        f"{names.get(name, name)} {force_text(weight)}"
        for name, weight in facts["weights"].items()
        if weight > 0.0
    ]
    texts = [", ".join(weights)]
    for number, tie in enumerate(facts["ties"], 1):
        pull = tie["prestress"]
        force = f"pulls with {force_text(pull)}" if pull else "is not tight"
        if tie["strength"] is not None:
            force += f" and yields at {force_text(tie['strength'])}"
        texts.append(
            f"{f'tie {number}' if len(facts['ties']) > 1 else 'the tie'} {force}"
        )
    ends = [f"({x:.4g}, {y:.4g})" for joint in facts["springings"] for x, y in joint]
    where = f"it stands from {ends[1]} to {ends[0]} m"
    if not arch.free_end:
        where = f"springings at {ends[0]} and {ends[-2]} m (intrados)"
    return "; ".join([*texts, where])


def force_text(force: float) -> str:
    """Return a force as text: in N below 1 kN, in kN below 10 MN, else in MN."""
    scale, unit = next(row for most, *row in FORCES if force < most)
    return f"{force / scale:.3g} {unit}"


def unit_cautions(arch: Shape, *keys: str) -> list[str]:
    """Return a warning for each value of an arch that looks as if it were given in another unit.

    `keys` limit the check to values whose key begins with one of them; without `keys` all are
    checked.
    """
    return [text for key, text in _doubtful(arch) if not keys or key.startswith(keys)]


def _doubtful(arch: Shape) -> Iterator[tuple[str, str]]:
    """Yield the key and a text for each value of an arch beyond what is usual."""
    given = arch.parameters
    span, _, thickness = arch.dimensions
    values = {**given, "friction": arch.chain.friction}
    if arch.free_end:
        values["height"] = arch.extent[1]
    else:
        # Springings of a horseshoe are nearer to each other than its haunches.
        reach = max(np.ptp(arch.lines_of(each)[0][:, 0]) for each in arch.spans)
        values |= {"thickness": thickness, "span": max(span, reach)}
    if "fill" in given and not given["fill"]["backing_height"]:
        values["fill"] = {**given["fill"], "backing_unit_weight": None}
    values.pop("ties", None)
    for key in PROPERTIES:
        yield from ((key, text) for text in unusual(key, value_of(values, key)))
    load = dead_weight(arch)
    if load:
        weight = facts_of(arch)["weights"]["ring"]
        if not LOADS[0] <= load / weight <= LOADS[1]:
            yield (
                "dead_load",
                f"dead_load is {force_text(load)} on a ring of {force_text(weight)}; is it in N?",
            )
    for number, (tie, ends) in enumerate(zip(given.get("ties", ()), arch.tie_lines)):
        length = length_of(ends)
        for key, text in _doubtful_tie(tie, length, f"ties[{number}]"):
            yield f"ties[{number}].{key}", text


def _doubtful_tie(tie: Named, length: float, place: str) -> Iterator[tuple[str, str]]:
    """Yield the key and a text for each value of a tie beyond what is usual.

    `length` is that of the tie [m]; `place` names it in the text, such as ``ties[0]``.
    """
    for key in ("area", "modulus"):
        texts = unusual(f"ties.{key}", tie[key], f"{place}.{key}")
        yield from ((key, text) for text in texts)
    for key, (least, most) in STRESSES.items():
        force = tie.get(key) or 0.0
        stress = force / tie["area"]
        if force and not least <= stress <= most:
            yield (
                key,
                f"{place}.{key} = {force:g} N on an area of {tie['area']:g} m2 is a stress of "
                f"{stress:.3g} N/m2; usual are {least:g} to {most:g}: are they in N and m2?",
            )
    rupture = tie.get("rupture", 0.0)
    if rupture > LARGEST_STRAIN * length:
        yield (
            "rupture",
            f"{place}.rupture = {rupture:g} m is that of a tie of {length:.3g} m; is it in m?",
        )


def warn_of_units(texts: Iterable[str]) -> None:
    """Give each text as a `UnitWarning` at the first line outside archfrag.

    While `quiet` is True nothing is given.
    """
    if quiet.get():
        return
    level = 1
    frame = sys._getframe()
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("archfrag."):
        level = level + 1
        frame = frame.f_back
    for text in texts:
        warnings.warn(text, UnitWarning, stacklevel=level)
