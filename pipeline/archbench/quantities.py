"""What errors are measured in: one run against the reference's, by the same rules for all."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator

from archbench.measures import energy_gain, overlap
from archbench.scene import STANDARD_GRAVITY, Array, Scene
from archbench.solve import Frames, Solution, arch_of, motion_of

# Label of a chart's axis, by quantity.
QUANTITIES = {
    "amplitude": "collapse amplitude, relative error",
    "verdicts": "wrong outcomes about the threshold, fraction",
    "position": "position before first impact, error / thickness",
    "peak": "peak displacement, relative error",
    "reactions": "reactions before first impact, error / weight",
    "energy_gain": "energy made, judged from the motion / largest kinetic energy",
    "energy_error": "energy balance error of the method's own / largest kinetic energy",
    "overlap": "overlap of neighbours / joint length",
}
OF_A_RUN = ("position", "peak", "reactions", "energy_gain", "energy_error", "overlap")
TRUE_ZERO = ("energy_gain", "energy_error", "overlap")
_QUIET = 0.016  # [s] on both sides of a jump
_INSTANTS = 8


@dataclass(frozen=True)
class Marks:
    """Instants at which a scene's runs are compared, from the reference's run [s].

    `position` is a multiple of 10 ms before the first impact, nan if there is none after the
    onset; `reactions` are frames at which resultants are unique and smooth.
    """

    onset: float
    position: float
    reactions: list[float]
    peak: float


@dataclass(frozen=True)
class Observed:
    """What one run gave: position (n_voussoir, 2) [m], reactions (n_instant, n_joint, 3) over the
    weight (moments over the thickness besides), and the measures; nan for what it cannot give."""

    position: list
    peak: float
    reactions: list
    energy_gain: float
    energy_error: float
    overlap: float
    collapsed: bool | None


def marks_of(scene: Scene, reference: Solution) -> Marks:
    """Instants for the comparison with a reference run with history."""
    assert reference.response is not None
    changes = reference.response.mechanism or ()
    onset = min((each.time for each in changes if each.joints), default=math.nan)
    impacts = [each.time for each in changes if each.cause == "impact" and each.time > onset]
    last = min(impacts, default=reference.end_time)
    position = math.floor((last - 2e-3) / 0.01 + 1e-9) * 0.01
    time, moved = reference.frames.time, lengths(reference.frames.displacement).max(axis=1)
    found = time[_smooth(scene, changes, time, last) & (time < last - _QUIET)]
    if found.size > _INSTANTS:
        found = found[np.linspace(0, found.size - 1, _INSTANTS).astype(int)]
    position = position if position > onset else math.nan
    return Marks(onset, position, found.tolist(), float(time[np.argmax(moved)]))


def _smooth(scene: Scene, changes, time: Array, last: float) -> NDArray[np.bool_]:
    """Frames with a moving mechanism of unique resultants, away from changes and ground jumps."""
    needed = 1 if scene.free_end else 4
    samples, step = scene.ground_acceleration()
    jumps = np.flatnonzero(np.abs(np.diff(samples)) > 0.2 * np.max(np.abs(samples), initial=0.0))
    breaks = [*(step * jumps), *(step * (jumps + 1))]
    breaks += [each.time for each in changes if each.time <= last]
    fit = np.zeros(time.size, bool)
    for each in changes:
        if len(each.joints) >= needed and "open" not in each.joints.values():
            until = last if math.isnan(each.until) else min(each.until, last)
            fit |= (time > each.time) & (time < until)
    for instant in breaks:
        fit &= np.abs(time - instant) > _QUIET
    return fit


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
    time, place = frames.time, frames.displacement
    if time.size < 2:
        return np.repeat(place[-1:], np.size(instants), axis=0)
    index = np.clip(np.searchsorted(time, instants, side="right") - 1, 0, time.size - 2)
    span = np.maximum(time[index + 1] - time[index], np.finfo(float).tiny)
    part = np.clip((instants - time[index]) / span, 0.0, 1.0)
    s, h = part[:, None, None], span[:, None, None]
    left, change = place[index], place[index + 1] - place[index]
    if not frames.velocity.size:
        return left + s * change
    first, last = h * frames.velocity[index], h * frames.velocity[index + 1]
    curved = first * s * (1.0 - s) ** 2 - last * s**2 * (1.0 - s)
    return left + change * s**2 * (3.0 - 2.0 * s) + curved


def resultants_at(frames: Frames, instants: Array) -> Array:
    """Resultants between frames: cubic through four, linear where they are fewer or coincide."""
    time = frames.time
    found = np.empty((instants.size, *frames.resultant.shape[1:]))
    for k, instant in enumerate(np.clip(instants, time[0], time[-1])):
        last = int(np.clip(np.searchsorted(time, instant, side="right"), 1, time.size - 1))
        used = np.arange(max(last - 2, 0), min(last + 2, time.size))
        if used.size < 4 or np.min(np.diff(time[used])) <= 0.0:
            used = np.array([last - 1, last] if time[last] > time[last - 1] else [last])
        found[k] = BarycentricInterpolator(time[used], frames.resultant[used])(instant)
    return found


def observe(scene: Scene, run: Solution, marks: Marks) -> Observed:
    """Read the quantities off a run with frames."""
    frames = run.frames
    at = np.array([np.nan_to_num(marks.onset if math.isnan(marks.position) else marks.position)])
    position = positions_at(frames, at)[0].tolist()
    if run.response is None:
        return Observed(position, run.peak, [], math.nan, math.nan, math.nan, run.collapsed)
    resultants = resultants_at(frames, np.array(marks.reactions))
    resultants /= float(np.sum(scene.bodies().mass)) * STANDARD_GRAVITY
    resultants[..., 2] /= scene.thickness
    arch, moving = arch_of(scene), (frames.velocity, frames.angular_velocity)
    gain = energy_gain(arch, motion_of(scene), frames.time, frames.displacement, *moving)
    deepest = overlap(arch, frames.displacement, frames.rotation)
    own = run.response.energy_error
    return Observed(position, run.peak, resultants.tolist(), gain, own, deepest, run.collapsed)


def errors_of(seen: Observed, true: Observed, thickness: float) -> dict[str, float]:
    """Errors of one run against another by `OF_A_RUN`; nan where there is nothing to compare.

    Where one of them collapses there is no peak displacement to be compared.
    """
    if seen.collapsed is None:
        return dict.fromkeys(OF_A_RUN, math.nan)
    peak = reactions = math.nan
    if not (seen.collapsed or true.collapsed) and true.peak > 0.0:
        peak = abs(seen.peak - true.peak) / true.peak
    if seen.reactions and true.reactions:
        apart = np.subtract(seen.reactions, true.reactions)
        reactions = float(np.maximum(lengths(apart[..., :2]), np.abs(apart[..., 2])).max())
    position = largest_distance(np.array(seen.position), np.array(true.position)) / thickness
    measures = (getattr(seen, name) for name in TRUE_ZERO)
    return dict(zip(OF_A_RUN, (position, peak, reactions, *measures), strict=True))
