"""Limit states short of collapse: their answers, and curves that do not cross."""

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from archfrag.fragility.curve import Fragility
from archfrag.fragility.quoted import Answer

MOST_CROSSING = 0.01  # probability by which curves of two limit states may cross
_FIELDS = {field.name for field in fields(Answer)}


def answers_of_states(answer: Answer) -> dict[str, Answer]:
    """Answers of the limit states of an arch or a class, by name, from light to severe."""
    found = {}
    for state in answer.more.get("limit_states", {}).get("states", ()):
        known = {"likelihood": {"none": ""}, "theta": (None, None), "beta": (None, None)} | state
        of_answer = {name: value for name, value in known.items() if name in _FIELDS}
        found[str(state["name"])] = Answer.from_dict(of_answer)
    return found


def state_to_dict(answer: Answer) -> dict[str, Any]:
    """Plain values of the answer of a limit state, as `answers_of_states` reads them."""
    plain = answer.to_dict()
    if isinstance(answer.curve, str):
        return {"curve": plain["curve"]}
    del plain["more"]
    return plain | {name: list(getattr(answer, name)) for name in ("theta", "beta")}


def told_order(curves: Sequence[tuple[str, Fragility]]) -> str:
    """Write whether neighbouring curves cross, from light to severe."""
    found = [
        f"those of {name} and {other} by up to {most:.2g}"
        for (name, mild), (other, severe) in pairwise(curves)
        if (most := crossing(mild, severe)) > MOST_CROSSING
    ]
    if not found:
        return "The curves of the limit states do not cross."
    how = "Each is fitted by itself; exports move the lighter one as far as needed."
    return f"Curves cross in probability: {'; '.join(found)}. {how}"


def above(mild: Fragility, severe: Fragility) -> Fragility:
    """The curve of a milder state, nowhere more than `MOST_CROSSING` below that of a severer one.

    Fits of two states can cross, by chance and because that of collapse is another estimate. If
    they do, the median is at most that of the severer state, and the dispersion is the nearest, on
    the way to that of the severer state, at which they do not.
    """
    if crossing(mild, severe) <= MOST_CROSSING:
        return mild
    theta = min(mild.theta, severe.theta)
    for beta in np.linspace(mild.beta, severe.beta, 101):
        found = replace(mild, theta=theta, beta=float(beta), kind="adjusted")
        if crossing(found, severe) <= MOST_CROSSING:
            return found
    return severe  # a mean of curves, which no lognormal one of this dispersion comes close to


def crossing(mild: Fragility, severe: Fragility) -> float:
    """Largest probability by which the curve of the severer state lies above that of the milder:
    other programs would take a negative one from between them.
    """
    ends = [fit.theta * np.exp(s * 4.0 * fit.beta) for fit in (mild, severe) for s in (-1, 1)]
    im = np.geomspace(min(ends), max(ends), 400)
    return float((severe.probability(im) - mild.probability(im)).max())
