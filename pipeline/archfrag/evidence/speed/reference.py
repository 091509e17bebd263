"""References: event-driven runs at tight tolerances, their own errors, and a second method's."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import ArchfragError
from archfrag.evidence.run import Verdict, Way, least_amplitude, run_scene, verdict
from archfrag.evidence.scene import Scene
from archfrag.evidence.speed.first_change import nearest_change
from archfrag.evidence.speed.horizon import Growth, measure_growth
from archfrag.evidence.speed.quantities import (
    TRUE_ZERO,
    Marks,
    Observed,
    errors_of,
    largest_distance,
    marks_of,
    observe,
    positions_at,
)
from archfrag.evidence.speed.second_method import compare_with_steps
from archfrag.evidence.ways import clocked
from archfrag.simulation.response import Response

Array = NDArray[np.float64]

# Nothing is plotted below so many times the reference's error.
MARGIN = 10.0
# A chart that begins above this would show no decade.
LARGEST_FLOOR = 0.1
_LADDER = (1e-10, 1e-9, 1e-8, 1e-7)


@dataclass
class Reference:
    """What a scene's runs are compared with.

    Attributes
    ----------
    scene : Scene
    tight, loose : Way
        The reference's, and the one ten times as coarse from which its error is taken.
    response : Response
        The reference's run at the scene's own amplitude, with history.
    marks : Marks
    seen : Observed
    growth : Growth
    amplitude : float
        At which verdicts change [g]; nan if there is none.
    error : dict of str to float
        Its own error for each quantity, raised to the distance from the second method's value
        where that is beyond the second method's own uncertainty.
    grid : ndarray
        Amplitudes of the set of verdicts [g], only those at which two tolerances agree.
    truth : ndarray of bool
    asked : int
        Amplitudes of the set before those were left out.
    second : dict of str to (float, float)
        Distance of a second method's limit from the reference, and that limit's uncertainty.
    thinned : dict of int to dict
        Its own errors where only every so-manieth frame is looked at.
    """

    scene: Scene
    tight: Way
    loose: Way
    response: Response
    marks: Marks
    seen: Observed
    growth: Growth
    amplitude: float
    error: dict[str, float]
    grid: Array
    truth: NDArray[np.bool_]
    asked: int
    second: dict[str, tuple[float, float]] = field(default_factory=dict)
    thinned: dict[int, dict[str, float]] = field(default_factory=dict)

    def why_not(self, quantity: str) -> str:
        """Why a quantity is not charted; empty if it is."""
        error = self.error.get(quantity, math.nan)
        if quantity == "peak" and self.marks.peak > self.growth.horizon:
            return (
                f"the peak comes at {self.marks.peak:.3g} s, beyond the predictability horizon of "
                f"{self.growth.horizon:.3g} s"
            )
        if math.isnan(error):
            return "the reference has no such value"
        if MARGIN * error > LARGEST_FLOOR:
            return f"the reference's own error is {error:.1e}"
        return ""

    def floor(self, quantity: str, interval: float) -> float:
        """Smallest error that is plotted.

        Parameters
        ----------
        quantity : str
        interval : float
            Between a run's frames [s]: what is judged from frames is not judged better than the
            reference is from frames as far apart.
        """
        error = self.error.get(quantity, math.nan)
        history = self.response.history
        if history is None or quantity not in ("energy_gain", "position", "reactions"):
            return MARGIN * error
        time = history["time"].to_numpy()
        own = float(np.median(np.diff(time))) if time.size > 1 else interval
        stride = max(1, round(interval / own))
        if stride not in self.thinned:
            thin = replace(self.response, history=history.isel(time=slice(None, None, stride)))
            seen = observe(self.scene, thin, self.marks)
            self.thinned[stride] = errors_of(seen, self.seen, self.scene.thickness)
        blur = self.thinned[stride][quantity]
        if quantity == "energy_gain":
            return MARGIN * max(error, blur)
        # Interpolation blurs by so much at most; ten times would hide true errors.
        return max(MARGIN * error, blur)


def find_reference(scene: Scene, quick: bool) -> Reference:
    """Reference of a scene, as tight as pays.

    Parameters
    ----------
    scene : Scene
        With samples.
    quick : bool

    Returns
    -------
    Reference

    Raises
    ------
    ArchfragError
        If no reference run comes to an end.
    """
    base, tight, loose = _tightest(scene, 1.0 if quick else 1.5, quick)
    coarser = run_scene(scene, loose, history=True)
    if verdict(base) is None:
        raise ArchfragError(f"scene {scene.name}: {tight} ends with {base.status.name}")
    marks = marks_of(scene, base)
    seen = _highest(observe(scene, base, marks), base)
    beside = _highest(observe(scene, coarser, marks), coarser)
    error = errors_of(beside, seen, scene.thickness)
    # Runs whose steps end with every sample agree in all digits at several tolerances, which
    # says nothing about an error below the tolerance itself.
    error = {name: max(value, tight.value) for name, value in error.items()}
    error["position"] = max(error["position"], _between_frames(base, marks) / scene.thickness)
    for name in TRUE_ZERO:
        error[name] = max(abs(float(getattr(seen, name))), tight.value)
    if math.isnan(marks.position):
        error["position"] = math.nan
    end = max((each.time for each in base.mechanism or ()), default=base.end_time)
    growth = measure_growth(scene, loose, coarser, marks.onset, end, 2 if quick else 4)
    amplitude, error["amplitude"] = _amplitude(scene, tight, loose, quick)
    grid, truth, asked = _set_of_verdicts(scene, loose, amplitude, quick)
    # Those amplitudes are left out about which the reference is in doubt; none is wrong.
    error["verdicts"] = 0.0 if grid.size else math.nan
    reference = Reference(
        scene, tight, loose, base, marks, seen, growth, amplitude, error, grid, truth, asked
    )
    compare_with_steps(reference, quick)
    return reference


def _tightest(scene: Scene, limit: float, quick: bool) -> tuple[Response, Way, Way]:
    """Run with the tightest tolerance that takes no longer than `limit` [s], or the last one."""
    for rtol in _LADDER[1:] if quick else _LADDER:
        tight = Way("event_driven", "rtol", rtol)
        base, seconds = clocked(scene, tight, history=True)
        if seconds <= limit:
            break
    return base, tight, Way("event_driven", "rtol", 10.0 * rtol)


def _highest(seen: Observed, response: Response) -> Observed:
    """With the peak over frames too: event-driven runs look for it at the ends of steps only."""
    assert response.history is not None
    moved = response.history["displacement"].to_numpy()
    return replace(seen, peak=max(seen.peak, largest_distance(moved, np.zeros_like(moved))))


def _between_frames(response: Response, marks: Marks) -> float:
    """What interpolation between frames may cost: its change as every second one goes [m]."""
    history = response.history
    assert history is not None
    at = np.array([np.nan_to_num(marks.position)])
    half = positions_at(history.isel(time=slice(None, None, 2)), at)
    return largest_distance(half, positions_at(history, at)) / 15.0


def _amplitude(scene: Scene, tight: Way, loose: Way, quick: bool) -> tuple[float, float]:
    """Least collapsing amplitude [g] and its relative error: two tolerances, and the bracket."""
    if math.isnan(scene.low):
        return math.nan, math.nan
    rough = least_amplitude(scene, Way("event_driven", "rtol", 1e-4), 1e-3)
    if math.isnan(rough.least):
        return math.nan, math.nan
    floor = 1e-7 if quick else 1e-8
    place = rough.least
    for way, share in ((loose, 0.0), (tight, 0.05)):
        found = nearest_change(partial(_falls, scene, way), place, floor, 0.3, share)
        if math.isnan(found.offset):
            return place, math.nan
        place *= 1.0 + found.offset
    return place, max(abs(found.offset) + 0.5 * found.width, floor)


def _falls(scene: Scene, way: Way, amplitude: float) -> Verdict:
    return verdict(run_scene(scene.at(amplitude), way))


def _set_of_verdicts(
    scene: Scene, way: Way, amplitude: float, quick: bool
) -> tuple[Array, NDArray[np.bool_], int]:
    if math.isnan(amplitude):
        return np.zeros(0), np.zeros(0, bool), 0
    distances = (1e-3, 1e-2, 3e-2, 0.1) if quick else (3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)
    factors = sorted(1.0 + side * each for each in distances for side in (-1.0, 1.0))
    other = Way(way.method, way.knob, 10.0 * way.value)
    kept, truth = [], []
    for factor in factors:
        raised = scene.at(factor * amplitude)
        first, second = (verdict(run_scene(raised, each)) for each in (way, other))
        if first is not None and first is second:
            kept.append(factor * amplitude)
            truth.append(first)
    return np.array(kept), np.array(truth, bool), len(factors)
