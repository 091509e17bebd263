"""What errors are measured in: one run against the reference's, by the same rules for all."""

import math
from dataclasses import dataclass

import numpy as np

from archbench.measures import overlap
from archbench.scene import Array, Scene
from archbench.solve import Frames, Solution, arch_of

# Label of a chart's axis, by quantity.
QUANTITIES = {
    "amplitude": "collapse amplitude, relative error",
    "position": "position before first impact, error / thickness",
    "peak": "peak displacement, relative error",
    "overlap": "overlap of neighbours / joint length",
}
OF_A_RUN = ("position", "peak", "overlap")


@dataclass(frozen=True)
class Marks:
    """Instants at which a scene's runs are compared, from the reference's run [s].

    `position` is a multiple of 10 ms before the first impact, nan if there is none after the
    onset.
    """

    onset: float
    position: float
    peak: float


@dataclass(frozen=True)
class Observed:
    """What one run gave: position (n_voussoir, 2) [m] and the measures; nan for what it cannot."""

    position: list
    peak: float
    overlap: float
    collapsed: bool | None


def marks_of(reference: Solution) -> Marks:
    """Instants for the comparison with a reference run with history."""
    assert reference.response is not None
    changes = reference.response.mechanism or ()
    onset = min((each.time for each in changes if each.joints), default=math.nan)
    impacts = [
        each.time for each in changes if each.cause == "impact" and each.time > onset
    ]
    last = min(impacts, default=reference.end_time)
    position = math.floor((last - 2e-3) / 0.01 + 1e-9) * 0.01
    time = reference.frames.time
    moved = lengths(reference.frames.displacement).max(axis=1)
    position = position if position > onset else math.nan
    return Marks(onset, position, float(time[np.argmax(moved)]))


def lengths(displacement: Array) -> Array:
    """Euclidean norm over the last axis."""
    return np.hypot(displacement[..., 0], displacement[..., 1])


def largest_distance(one: Array, other: Array) -> float:
    """Largest distance between two sets of centroids [m]."""
    return float(np.max(lengths(np.asarray(one) - np.asarray(other)), initial=0.0))


def positions_at(frames: Frames, instants: Array) -> Array:
    """Displacements between frames, (n, n_voussoir, 2) [m]; the last frame's beyond the end.

    Cubic Hermite interpolation, linear where there are no velocities.
    """
    time = frames.time
    place = frames.displacement
    if time.size < 2:
        return np.repeat(place[-1:], np.size(instants), axis=0)
    index = np.clip(np.searchsorted(time, instants, side="right") - 1, 0, time.size - 2)
    span = np.maximum(time[index + 1] - time[index], np.finfo(float).tiny)
    part = np.clip((instants - time[index]) / span, 0.0, 1.0)
    s = part[:, None, None]
    h = span[:, None, None]
    left = place[index]
    change = place[index + 1] - place[index]
    if not frames.velocity.size:
        return left + s * change
    first = h * frames.velocity[index]
    last = h * frames.velocity[index + 1]
    curved = first * s * (1.0 - s) ** 2 - last * s**2 * (1.0 - s)
    return left + change * s**2 * (3.0 - 2.0 * s) + curved


def observe(scene: Scene, run: Solution, marks: Marks) -> Observed:
    """Read the quantities off a run with frames."""
    frames = run.frames
    at = np.array(
        [np.nan_to_num(marks.onset if math.isnan(marks.position) else marks.position)]
    )
    position = positions_at(frames, at)[0].tolist()
    deepest = math.nan
    if run.response is not None:
        deepest = overlap(arch_of(scene), frames.displacement, frames.rotation)
    return Observed(position, run.peak, deepest, run.collapsed)


def errors_of(seen: Observed, true: Observed, thickness: float) -> dict[str, float]:
    """Errors of one run against another by `OF_A_RUN`; nan where there is nothing to compare.

    If one of them collapses there is no peak displacement to be compared. The true overlap is 0.
    """
    if seen.collapsed is None:
        return dict.fromkeys(OF_A_RUN, math.nan)
    peak = math.nan
    if not (seen.collapsed or true.collapsed) and true.peak > 0.0:
        peak = abs(seen.peak - true.peak) / true.peak
    position = (
        largest_distance(np.array(seen.position), np.array(true.position)) / thickness
    )
    return dict(zip(OF_A_RUN, (position, peak, seen.overlap), strict=True))
