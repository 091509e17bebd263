"""The reference of a scene: tight event-driven runs, their own error, and a second method.

Its error is the difference between two tolerances, or its distance from time stepping
extrapolated to steps of no length where that is beyond the extrapolation's own uncertainty.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from archbench import quantities
from archbench.growth import measure_growth
from archbench.scene import Array, Scene
from archbench.settings import Setting
from archbench.solve import (
    Frames,
    Solution,
    arch_of,
    collapses,
    least_collapsing,
    nearest_change,
    solve,
)
from archfrag.errors import ArchfragError

MARGIN = 10.0  # nothing is drawn below so many times the reference's error
LARGEST_FLOOR = 0.1  # a chart that begins above this would show no decade
TOLERANCES = (1e-10, 1e-9, 1e-8, 1e-7)
STEPS = tuple(1e-3 / 2**k for k in range(7))
# What a run may cost is counted, so that no reference depends on the machine's speed: in steps
# times (voussoirs + 7), which take about 0.5 us each by steps and 3 us by events.
EVENTS_WORK = {False: 5e5, True: 3.5e5}
STEPS_WORK = {False: 4e6, True: 1e6}


@dataclass
class Reference:
    """What a scene's runs are compared with: a run at a tolerance `tight`.

    `loose` is ten times as coarse and gives its `error`, by quantity; `amplitude` is where
    outcomes change [g], nan if they do not; `second` is the distance and the uncertainty of the
    second method's limit; `growth` is as of `growth_of`.
    """

    scene: str
    tight: float
    loose: float
    marks: quantities.Marks
    seen: quantities.Observed
    end_time: float
    amplitude: float
    error: dict[str, float]
    second: dict[str, list[float]] = field(default_factory=dict)
    growth: dict[str, float] = field(default_factory=dict)

    def why_not(self, quantity: str) -> str:
        """Why a quantity is not drawn; empty if it is."""
        error = self.error.get(quantity, math.nan)
        if quantity == "peak" and self.marks.peak > self.growth["horizon"]:
            return f"peak at {self.marks.peak:.3g} s, horizon {self.growth['horizon']:.3g} s"
        if math.isnan(error):
            return "the reference has no such value"
        too_large = MARGIN * error > LARGEST_FLOOR
        return f"the reference's own error is {error:.1e}" if too_large else ""

    def floor(self, quantity: str) -> float:
        """Smallest error that is drawn."""
        return MARGIN * self.error.get(quantity, math.nan)


def find_reference(scene: Scene, quick: bool) -> Reference:
    """Reference of a scene with samples, as tight as pays: no run takes more than EVENTS_WORK."""
    for rtol in TOLERANCES[1:] if quick else TOLERANCES:
        tight = Setting("event_driven", "rtol", rtol)
        base = solve(scene, tight, history=True)
        if _work(scene, base) <= EVENTS_WORK[quick]:
            break
    loose = tight.finer(10.0)
    coarser = solve(scene, loose, history=True)
    if base.collapsed is None or base.response is None:
        raise ArchfragError(f"scene {scene.name}: {tight} ends with {base.status}")
    marks = quantities.marks_of(base)
    seen, compared = (quantities.observe(scene, run, marks) for run in (base, coarser))
    # With the peak over frames too: event-driven runs look for it at the ends of steps only.
    highest = (
        float(quantities.lengths(run.frames.displacement).max())
        for run in (base, coarser)
    )
    pairs = zip((seen, compared), highest)
    seen, compared = (replace(each, peak=max(each.peak, top)) for each, top in pairs)
    # Runs whose steps end with every sample agree in all digits: this proves nothing below rtol.
    errors = quantities.errors_of(compared, seen, scene.thickness) | {
        "overlap": seen.overlap
    }
    error = {name: max(value, tight.value) for name, value in errors.items()}
    between = math.nan
    if not math.isnan(
        marks.position
    ):  # what interpolation may cost: as every second frame goes
        at = np.array([marks.position])
        half = Frames(*[each[::2] for each in base.frames])
        apart = quantities.largest_distance(
            *(quantities.positions_at(frames, at) for frames in (half, base.frames))
        )
        between = max(error["position"], apart / 15.0 / scene.thickness)
    error["position"] = between
    amplitude, error["amplitude"] = _amplitude(scene, tight, loose, quick)
    reference = Reference(
        scene.name,
        tight.value,
        loose.value,
        marks,
        seen,
        base.end_time,
        amplitude,
        error,
    )
    last = max(
        (each.time for each in base.response.mechanism or ()), default=base.end_time
    )
    reference.growth = measure_growth(
        scene, loose, coarser, marks.onset, last, 2 if quick else 4
    )
    compare_with_steps(reference, scene, quick)
    return reference


def _amplitude(
    scene: Scene, tight: Setting, loose: Setting, quick: bool
) -> tuple[float, float]:
    """Amplitude of collapse [g] and its relative error: two tolerances, and the bracket."""
    if math.isnan(scene.low):
        return math.nan, math.nan
    rough = partial(collapses, scene, Setting("event_driven", "rtol", 1e-4))
    place = least_collapsing(rough, scene.low, scene.high, 1e-3)
    floor = 1e-7 if quick else 1e-8
    for setting, fraction in ((loose, 0.0), (tight, 0.05)):
        if math.isnan(place):
            return math.nan, math.nan
        found = nearest_change(
            partial(collapses, scene, setting), place, floor, 0.3, fraction
        )
        if math.isnan(found.offset):
            return place, math.nan
        place *= 1.0 + found.offset
    return place, max(abs(found.offset) + 0.5 * found.width, floor)


def compare_with_steps(reference: Reference, scene: Scene, quick: bool) -> None:
    """Distance of time stepping's limit: the error where beyond its own uncertainty."""
    limit = STEPS_WORK[quick]
    runs: list[Solution] = []
    for step in STEPS:
        runs.append(solve(scene, Setting("time_stepping", "dt", step), history=True))
        if runs[-1].collapsed is None:
            return
        if _work(scene, runs[-1]) > limit:
            break
    true = reference.seen
    thickness = scene.thickness
    if len(runs) >= 4:
        seen = [quantities.observe(scene, run, reference.marks) for run in runs]
        found, uncertainty = limit_of([np.array(each.position) for each in seen])
        away = quantities.largest_distance(found, np.array(true.position))
        _compare(reference, "position", away / thickness, uncertainty / thickness)
        if true.peak > 0.0 and not any(each.collapsed for each in [*seen, true]):
            found, uncertainty = limit_of([np.array(each.peak) for each in seen])
            away = abs(float(found) - true.peak)
            _compare(reference, "peak", away / true.peak, uncertainty / true.peak)
    used = [
        step
        for step, run in zip(STEPS, runs, strict=False)
        if 3.0 * _work(scene, run) <= limit
    ]
    error = reference.error["amplitude"]
    if len(used) < 4 or math.isnan(error):
        return
    offsets = []
    for step in used[-4:]:
        asked = partial(collapses, scene, Setting("time_stepping", "dt", step))
        change = nearest_change(asked, reference.amplitude, error, 0.5, 0.05)
        if math.isnan(change.offset):
            return
        offsets.append(np.array(change.offset))
    found, uncertainty = limit_of(offsets)
    _compare(reference, "amplitude", abs(float(found)), uncertainty)


def _work(scene: Scene, run: Solution) -> float:
    """Cost of a run, the same on every machine."""
    return run.steps * (arch_of(scene).n_voussoir + 7.0)


def _compare(
    reference: Reference, quantity: str, away: float, uncertainty: float
) -> None:
    reference.second[quantity] = [away, uncertainty]
    if away > uncertainty + reference.error.get(quantity, math.nan):
        reference.error[quantity] = away


def limit_of(values: Sequence[Array]) -> tuple[Array, float]:
    """Limit of four values at steps halved each time, and its uncertainty."""
    limit, correction, _ = richardson(values[-3:])
    before, _, _ = richardson(values[-4:-1])
    last = float(np.max(np.abs(values[-1] - values[-2])))
    return limit, max(correction, last, float(np.max(np.abs(limit - before))))


def richardson(values: Sequence[Array]) -> tuple[Array, float, float]:
    """Limit of values at steps halved twice, its uncertainty, and the order they show."""
    coarse, middle, fine = (np.asarray(each, float) for each in values[-3:])
    before = float(np.max(np.abs(coarse - middle)))
    after = float(np.max(np.abs(middle - fine)))
    order = 4.0 if after == 0.0 else 0.5
    if before > 0.0 and after > 0.0:
        order = min(max(math.log2(before / after), 0.5), 4.0)
    limit = fine + (fine - middle) / (2.0**order - 1.0)
    return limit, float(np.max(np.abs(limit - fine))), order
