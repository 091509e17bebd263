"""What the errors of a run are measured in: one run against the reference's, by the same rules."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.evidence.judge import energy_gain, overlap
from archfrag.evidence.run import arch_of, motion_of
from archfrag.evidence.scene import STANDARD_GRAVITY, Scene
from archfrag.simulation.response import Response

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]


class Quantity(NamedTuple):
    """An error and how it reads on a chart."""

    label: str
    meaning: str


QUANTITIES: dict[str, Quantity] = {
    "amplitude": Quantity(
        "collapse amplitude, relative error",
        "distance between the amplitudes at which verdicts change, over the reference's; the cost "
        "is that of one run at 0.9 times the reference's amplitude",
    ),
    "verdicts": Quantity(
        "wrong verdicts, share",
        "share of amplitudes around the threshold at which the verdict is not the reference's; "
        "the cost is that of all of them",
    ),
    "position": Quantity(
        "position before first impact, error / thickness",
        "largest distance of a centroid from the reference's just before its first impact",
    ),
    "peak": Quantity(
        "peak displacement, relative error",
        "largest displacement of any centroid in the whole run, where the reference reaches it "
        "within the predictability horizon",
    ),
    "reactions": Quantity(
        "reactions before first impact, error / weight",
        "largest error of the force, or of the moment over the thickness, in any joint at "
        "instants before the first impact at which the reference's mechanism moves: cut anywhere, "
        "an arch with four joints turning or sliding and a column on one ground have one set of "
        "resultants that agrees with the motion, while those of an arch at rest are not unique",
    ),
    "energy_gain": Quantity(
        "energy made, judged from the motion / largest kinetic energy",
        "largest rise of the mechanical energy that the ground's work does not explain",
    ),
    "energy_error": Quantity(
        "energy made, by the method's own account / largest kinetic energy",
        "largest energy made or lost on the way that no contact law explains",
    ),
    "overlap": Quantity(
        "overlap of neighbours / joint length",
        "deepest overlap of two voussoirs at any corner and instant",
    ),
}
# Of one run's history; the others need searches.
OF_A_RUN = ("position", "peak", "reactions", "energy_gain", "energy_error", "overlap")
# These have the true value zero.
TRUE_ZERO = ("energy_gain", "energy_error", "overlap")
_QUIET = 0.016


@dataclass(frozen=True)
class Marks:
    """Instants at which a scene's runs are compared, from the reference's run.

    Attributes
    ----------
    onset : float
        When motion begins [s].
    impact : float
        First impact [s]; nan if there is none.
    position : float
        A multiple of 10 ms before the first impact [s]; nan if there is none after the onset.
    reactions : ndarray
        Frames of the reference at which resultants are unique and smooth [s].
    peak : float
        When its largest displacement is reached [s].
    """

    onset: float
    impact: float
    position: float
    reactions: Array
    peak: float


def marks_of(scene: Scene, response: Response) -> Marks:
    """Instants for the comparison with a reference.

    Parameters
    ----------
    scene : Scene
    response : Response
        The reference's, with history.

    Returns
    -------
    Marks
    """
    changes = response.mechanism or ()
    moving = [each.time for each in changes if each.joints]
    onset = min(moving, default=math.nan)
    impact = min(
        (e.time for e in changes if e.cause == "impact" and e.time > onset), default=math.nan
    )
    last = response.end_time if math.isnan(impact) else impact
    position = math.floor((last - 2e-3) / 0.01 + 1e-9) * 0.01
    if not position > onset:
        position = math.nan
    history = response.history
    assert history is not None
    time = history["time"].to_numpy()
    moved = np.hypot(*np.moveaxis(history["displacement"].to_numpy(), -1, 0)).max(axis=1)
    peak = float(time[int(np.argmax(moved))])
    return Marks(onset, impact, position, _smooth_instants(scene, response, time, last), peak)


def _smooth_instants(scene: Scene, response: Response, time: Array, last: float) -> Array:
    """At most eight frames with a moving mechanism, away from its changes and ground jumps."""
    needed = 1 if scene.free_end else 4
    samples, step = scene.ground_acceleration()
    jump = np.abs(np.diff(samples)) > 0.2 * np.max(np.abs(samples), initial=0.0)
    breaks = [*(step * np.flatnonzero(jump)), *(step * (np.flatnonzero(jump) + 1))]
    changes = response.mechanism or ()
    breaks += [each.time for each in changes if each.time <= last]
    fit = np.zeros(time.size, bool)
    for each in changes:
        if len(each.joints) >= needed and "open" not in each.joints.values():
            until = last if math.isnan(each.until) else min(each.until, last)
            fit |= (time > each.time) & (time < until)
    for instant in breaks:
        fit &= np.abs(time - instant) > _QUIET
    found = time[fit & (time < last - _QUIET)]
    if found.size > 8:
        found = found[np.linspace(0, found.size - 1, 8).astype(int)]
    return found


def positions_at(history: xarray.Dataset, instants: Array) -> Array:
    """Displacements of the centroids between frames, by cubic Hermite interpolation.

    Parameters
    ----------
    history : xarray.Dataset
        Of `archfrag.simulate`.
    instants : ndarray, (n,) [s]

    Returns
    -------
    ndarray, (n, n_voussoir, 2) [m]
        The last frame's beyond the end.
    """
    time = history["time"].to_numpy()
    place = history["displacement"].to_numpy()
    velocity = history["velocity"].to_numpy()
    if time.size < 2:
        return np.repeat(place[-1:], instants.size, axis=0)
    index = np.clip(np.searchsorted(time, instants, side="right") - 1, 0, time.size - 2)
    span = np.maximum(time[index + 1] - time[index], np.finfo(float).tiny)
    part = np.clip((instants - time[index]) / span, 0.0, 1.0)
    s, h = part[:, None, None], span[:, None, None]
    left, right = place[index], place[index + 1]
    return (
        left
        + (right - left) * s**2 * (3.0 - 2.0 * s)
        + h * velocity[index] * s * (1.0 - s) ** 2
        - h * velocity[index + 1] * s**2 * (1.0 - s)
    )


def resultants_at(history: xarray.Dataset, instants: Array) -> Array:
    """Force and moment in every joint, cubic through four frames, (n, n_joint, 3) [N], [N m].

    Parameters
    ----------
    history : xarray.Dataset
    instants : ndarray, (n,) [s]
        Away from jumps by two frames at least.

    Notes
    -----
    Lagrange's formula; linear where frames are too few or fall together.
    """
    time = history["time"].to_numpy()
    values = np.concatenate(
        [history["reaction"].to_numpy(), history["moment"].to_numpy()[..., None]], axis=2
    )
    found = np.empty((instants.size, *values.shape[1:]))
    for k, instant in enumerate(instants):
        last = int(np.clip(np.searchsorted(time, instant, side="right"), 1, time.size - 1))
        used = np.arange(max(last - 2, 0), min(last + 2, time.size))
        if used.size < 4 or np.min(np.diff(time[used])) <= 0.0:
            used = np.array([last - 1, last])
        weights = _lagrange(time[used], min(max(instant, time[0]), time[-1]))
        found[k] = np.tensordot(weights, values[used], axes=1)
    return found


def _lagrange(nodes: Array, at: float) -> Array:
    """Weights of the values at the nodes; the last node's alone where nodes fall together."""
    spans = nodes[:, None] - nodes[None, :] + np.eye(nodes.size)
    if np.any(spans == 0.0):
        return np.eye(nodes.size)[-1]
    factors = (at - nodes[None, :]) / spans
    np.fill_diagonal(factors, 1.0)
    return np.asarray(np.prod(factors, axis=1))


def largest_distance(one: Array, other: Array) -> float:
    """Largest distance between two sets of centroids [m]."""
    return float(np.max(np.hypot(*np.moveaxis(one - other, -1, 0)), initial=0.0))


@dataclass(frozen=True)
class Observed:
    """What one run gave of the quantities of a run.

    Attributes
    ----------
    position : ndarray, (n_voussoir, 2) [m]
    peak : float [m]
    reactions : ndarray, (n_instant, n_joint, 3)
        Over the weight, moments also over the thickness.
    energy_gain, energy_error, overlap : float
    failed : bool
        Whether the run ended by a failure of its solver.
    collapsed : bool
    """

    position: Array
    peak: float
    reactions: Array
    energy_gain: float
    energy_error: float
    overlap: float
    failed: bool
    collapsed: bool


def observe(scene: Scene, response: Response, marks: Marks) -> Observed:
    """Read the quantities off a run with history.

    Parameters
    ----------
    scene : Scene
    response : Response
    marks : Marks

    Returns
    -------
    Observed
    """
    history = response.history
    assert history is not None
    arch = arch_of(scene)
    scale = float(np.sum(scene.bodies().mass)) * STANDARD_GRAVITY
    resultants = resultants_at(history, marks.reactions) / scale
    resultants[..., 2] /= scene.thickness
    at = np.array([marks.onset if math.isnan(marks.position) else marks.position])
    return Observed(
        positions_at(history, np.nan_to_num(at))[0],
        response.peak_displacement,
        resultants,
        gain_of(scene, arch, history),
        response.energy_error,
        overlap(arch, history["displacement"].to_numpy(), history["rotation"].to_numpy()),
        bool(response.status not in (0, 1, 2)),
        bool(response.collapsed),
    )


def gain_of(scene: Scene, arch: Arch, history: xarray.Dataset) -> float:
    """`archfrag.evidence.judge.energy_gain` of a history."""
    return energy_gain(
        arch,
        motion_of(scene),
        history["time"].to_numpy(),
        history["displacement"].to_numpy(),
        history["velocity"].to_numpy(),
        history["angular_velocity"].to_numpy(),
    )


def errors_of(seen: Observed, true: Observed, thickness: float) -> dict[str, float]:
    """Errors of one run against another; nan for all if it failed.

    Parameters
    ----------
    seen, true : Observed
        Of the same scene and marks.
    thickness : float [m]

    Returns
    -------
    dict of str to float
        For each of `OF_A_RUN`.

    Notes
    -----
    A run that collapses, or whose reference does, has no peak displacement that could be
    compared; its error is nan. A wrong verdict counts under "verdicts".
    """
    if seen.failed:
        return dict.fromkeys(OF_A_RUN, math.nan)
    peak = math.nan
    if not (seen.collapsed or true.collapsed) and true.peak > 0.0:
        peak = abs(seen.peak - true.peak) / true.peak
    difference = seen.reactions - true.reactions
    reactions = np.maximum(
        np.hypot(difference[..., 0], difference[..., 1]), np.abs(difference[..., 2])
    )
    return {
        "position": largest_distance(seen.position, true.position) / thickness,
        "peak": peak,
        "reactions": float(np.max(reactions)) if reactions.size else math.nan,
        "energy_gain": seen.energy_gain,
        "energy_error": seen.energy_error,
        "overlap": seen.overlap,
    }
