"""Mean loss from curves of limit states and what each costs, a fraction of the value of an arch.

loss(im) = sum of ratio_i (P(state i or worse) - P(state i + 1 or worse)) is the sum of steps of
the ratios times P(state i or worse). So the average annual loss, the integral of loss |d lambda|,
is the sum of the steps times the rates of the states. Ends of bands add up alike, as if theta and
beta of all states erred together.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.files import number
from archfrag.fragility.curve import Curve, FloatArray
from archfrag.fragility.risk import HazardCurve, collapse_rate
from archfrag.fragility.several import above

Steps = list[tuple[Curve, float]]


def loss_steps(curve: Curve, ratios: Mapping[str, float]) -> Steps:
    """Return curves of the states that cost something and by how much more than the milder one.

    States are ordered by their medians, collapse last, and moved where they cross, as in exports.
    InputError for a state that is not known or ratios that fall; FitError if one has no curve.
    """
    states = {each.state.replace(" ", "_"): each for each in curve.states} | {
        "collapse": curve
    }
    if wrong := [name for name in ratios if name not in states]:
        known = f"it has {', '.join(states)}"
        raise InputError(
            f"consequence names {wrong[0]!r}, which is no limit state here; {known}"
        )
    if lacking := [name for name in ratios if not states[name].fitted]:
        why = states[lacking[0]].reason
        raise FitError(
            f"limit state {lacking[0]!r} of the consequences has no curve: {why}"
        )
    mild = sorted(set(ratios) - {"collapse"}, key=lambda name: states[name].theta)
    found = Steps()
    severe = curve
    last = "collapse"
    for name in reversed(mild):
        if ratios[name] > ratios[last]:
            given = f"{name}={ratios[name]:g} and {last}={ratios[last]:g}"
            raise InputError(
                f"consequence has {given}; {last} is severer and costs no less"
            )
        found.insert(0, (severe, ratios[last] - ratios[name]))
        severe = above(states[name], severe)
        last = name
    return [(severe, ratios[last]), *found]


def checked_ratios(ratios: Mapping[str, float]) -> dict[str, float]:
    """Return ratios by limit state; InputError unless from 0 to 1, and one is of collapse."""
    given = dict[str, float]()
    for name, ratio in ratios.items():
        state = name.strip().casefold().replace(" ", "_")
        if state in given:
            raise InputError(f"consequence has {state} twice; give it one ratio")
        try:
            given[state] = number(ratio) if isinstance(ratio, str) else float(ratio)
        except ValueError as error:
            raise InputError(f"consequence of {state}: {error}") from None
    for name, ratio in given.items():
        if not 0.0 <= ratio <= 1.0:
            raise InputError(
                f"consequence has {name}={ratio:g}; a ratio lies from 0 to 1"
            )
    if "collapse" not in given:
        raise InputError(
            "consequence has no ratio of collapse; add one, such as collapse=1"
        )
    return given


def vulnerability(steps: Steps, im: ArrayLike) -> FloatArray:
    """Return the mean loss ratio at intensities (n,) and the ends of its band, (3, n)."""
    return np.sum(
        [step * np.stack([fit(im), *fit.band(im)]) for fit, step in steps], axis=0
    )


def average_annual_loss(
    hazard: HazardCurve,
    steps: Steps,
    seed: int,
    confidence: float,
    onset: Callable[[Curve], ArrayLike],
) -> dict[str, float | bool]:
    """Return the average annual loss, its mean over theta and beta, and its band [1/year].

    `onset` gives that of a curve, as for `collapse_rate`. It is a lower bound, without a band, if
    the rate of a state is one.
    """
    rates = [
        collapse_rate(hazard, c, c.draws(seed), confidence, onset(c)) for c, _ in steps
    ]
    parts = [(each.quoted, each.mean, each.lower, each.upper) for each in rates]
    losses: list[float] = np.dot([step for _, step in steps], parts).tolist()
    names = ("aal", "aal_mean", "aal_lower", "aal_upper")
    return dict(zip(names, losses)) | {
        "aal_is_lower_bound": any(rate.is_bound for rate in rates)
    }
