"""A second method beside every reference: time stepping, extrapolated from its finest steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from archfrag.evidence.run import Verdict, Way, run_scene, verdict
from archfrag.evidence.scene import Scene
from archfrag.evidence.speed.first_change import nearest_change
from archfrag.evidence.speed.quantities import Observed, largest_distance, observe
from archfrag.evidence.ways import clocked

if TYPE_CHECKING:
    from archfrag.evidence.speed.reference import Reference

Array = NDArray[np.float64]

STEPS = tuple(1e-3 / 2**k for k in range(7))


def compare_with_steps(reference: Reference, quick: bool) -> None:
    """Distance of time stepping's limit from the reference, for what both give.

    Where it is beyond the limit's own uncertainty, it becomes the reference's error.

    Parameters
    ----------
    reference : Reference
        Its `second` is filled and its `error` raised where need be.
    quick : bool
        Steps are halved until a run takes 0.5 s, or else 2 s; a third as long for amplitudes.
    """
    scene, limit = reference.scene, 0.5 if quick else 2.0
    seen: list[Observed] = []
    times: list[float] = []
    for step in STEPS:
        way = Way("time_stepping", "dt", step)
        response, seconds = clocked(scene, way, history=True)
        if verdict(response) is None:
            return
        seen.append(observe(scene, response, reference.marks))
        times.append(seconds)
        if times[-1] > limit:
            break
    if len(seen) >= 4:
        _of_a_run(reference, seen)
    used = [step for step, seconds in zip(STEPS, times, strict=False) if seconds <= limit / 3.0]
    if len(used) >= 4 and not math.isnan(reference.error["amplitude"]):
        _of_amplitudes(reference, used[-4:])


def _of_a_run(reference: Reference, seen: list[Observed]) -> None:
    true, thickness = reference.seen, reference.scene.thickness
    limit, doubt = settled([each.position for each in seen])
    settle(reference, "position", largest_distance(limit, true.position) / thickness,
           doubt / thickness)  # fmt: skip
    if true.peak > 0.0 and not any(each.collapsed for each in [*seen, true]):
        limit, doubt = settled([np.array(each.peak) for each in seen])
        settle(reference, "peak", abs(float(limit) - true.peak) / true.peak, doubt / true.peak)
    if true.reactions.size:
        limit, doubt = settled([each.reactions for each in seen])
        settle(reference, "reactions", float(np.max(np.abs(limit - true.reactions))), doubt)


def _of_amplitudes(reference: Reference, steps: Sequence[float]) -> None:
    offsets = []
    for step in steps:
        found = nearest_change(
            partial(_falls, reference.scene, Way("time_stepping", "dt", step)),
            reference.amplitude, reference.error["amplitude"], 0.5, 0.05,
        )  # fmt: skip
        if math.isnan(found.offset):
            return
        offsets.append(np.array(found.offset))
    limit, doubt = settled(offsets)
    settle(reference, "amplitude", abs(float(limit)), doubt)


def _falls(scene: Scene, way: Way, amplitude: float) -> Verdict:
    return verdict(run_scene(scene.at(amplitude), way))


def settle(reference: Reference, quantity: str, away: float, doubt: float) -> None:
    """Note the second method's distance; beyond its own uncertainty it counts as our error."""
    reference.second[quantity] = (away, doubt)
    own = reference.error.get(quantity, math.nan)
    if away > doubt + own:
        reference.error[quantity] = away


def settled(values: Sequence[Array]) -> tuple[Array, float]:
    """Limit of four values at steps halved each time, and how far it is from settled.

    Parameters
    ----------
    values : sequence of ndarray
        At least four of the same shape, the last one at the finest step.

    Returns
    -------
    limit : ndarray
    doubt : float
        The largest of the last correction, the last difference, and what the last step changed
        of the limit: the first alone would be too small before errors fall regularly.
    """
    limit, correction, _ = richardson(values[-3:])
    before, _, _ = richardson(values[-4:-1])
    last = np.max(np.abs(np.asarray(values[-1]) - np.asarray(values[-2])))
    return limit, max(correction, float(last), float(np.max(np.abs(limit - before))))


def richardson(values: Sequence[Array]) -> tuple[Array, float, float]:
    """Limit of values at steps halved twice, its uncertainty, and the order they show.

    Parameters
    ----------
    values : sequence of ndarray
        At least three of the same shape, the last one at the finest step.

    Returns
    -------
    limit : ndarray
    uncertainty : float
        Largest difference between the limit and the finest value: the size of the correction.
    order : float
        Of the last three; between 0.5 and 4, and 0.5 where differences do not shrink.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.evidence.speed.second_method import richardson
    >>> limit, uncertainty, order = richardson([np.array(1.0 + h**2) for h in (0.4, 0.2, 0.1)])
    >>> round(float(limit), 12), round(uncertainty, 12), round(order, 6)
    (1.0, 0.01, 2.0)
    """
    coarse, middle, fine = (np.asarray(each, float) for each in values[-3:])
    before, after = float(np.max(np.abs(coarse - middle))), float(np.max(np.abs(middle - fine)))
    order = 4.0 if after == 0.0 else 0.5
    if before > 0.0 and after > 0.0:
        order = min(max(math.log2(before / after), 0.5), 4.0)
    limit = fine + (fine - middle) / (2.0**order - 1.0)
    return limit, float(np.max(np.abs(limit - fine))), order
