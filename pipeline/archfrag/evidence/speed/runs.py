"""Every way of every line on one scene: cost, interleaved, and errors against the reference.

The cost of a run is its share of a study of `STUDY` runs where a method makes many at once, as
all studies do, and that of a single run where it does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import ArchfragError
from archfrag.evidence.run import Way, motion_of, run_study, verdict
from archfrag.evidence.scene import Scene
from archfrag.evidence.speed.first_change import nearest_change
from archfrag.evidence.speed.quantities import OF_A_RUN, Observed, errors_of, observe
from archfrag.evidence.speed.reference import MARGIN, Reference
from archfrag.evidence.ways import Line, clocked, step_of
from archfrag.simulation.many import COARSEST_FRAMES
from archfrag.simulation.response import Response

Array = NDArray[np.float64]

NEAR = 0.9  # of the reference's collapse amplitude: where the cost of that row is taken
REACH = 0.5
# Runs of a study, all but equal: two full lanes of four.
STUDY = tuple(1.0 + 1e-5 * k for k in range(8))
# Short runs are repeated until they add up to so much [s], up to so many times.
SHORT, MOST = 0.1, 15
# Finer settings of a line are left out where one takes longer [s of CPU].
LONGEST = 0.3
POINT = (
    "scene", "quantity", "who", "line", "method", "way", "place", "cost", "least_cost", "error",
    "floor", "charted", "at_floor", "status",
)  # fmt: skip


@dataclass
class Tried:
    """A way on a scene, with its times [s] and what it gave."""

    line: Line
    way: Way
    place: int
    own: list[float] = field(default_factory=list)
    near: list[float] = field(default_factory=list)
    seen: Observed | None = None
    status: str = ""

    def run(self, scene: Scene, **options: Any) -> Response:
        """Run a scene."""
        return clocked(scene, self.way, **options)[0]

    def seconds(self, scene: Scene) -> float:
        """What a run costs [s]."""
        runs = run_study(scene, self.way, STUDY)
        if runs is None:
            return self.run(scene).wall_time
        return sum(run.wall_time for run in runs) / len(runs)

    def runs_at(self, scene: Scene, amplitudes: Array) -> list[Response]:
        """Runs of a scene at several amplitudes."""
        own = scene.motion.get("amplitude", 1.0)
        runs = run_study(scene, self.way, (amplitudes / own).tolist())
        return runs or [self.run(scene.at(amplitude)) for amplitude in amplitudes.tolist()]

    def interval(self, scene: Scene) -> float:
        """Between frames of its history [s], as `archfrag.simulate` sets it."""
        return max(step_of(self.way, scene), min(motion_of(scene).dt, COARSEST_FRAMES))


def try_lines(
    reference: Reference, lines: Iterable[Line], quick: bool
) -> tuple[list[dict[str, Any]], list[str]]:
    """Points of all lines on a scene.

    Parameters
    ----------
    reference : Reference
    lines : iterable of Line
    quick : bool
        At least 3 instead of 5 runs for each time.

    Returns
    -------
    points : list of dict
        With the keys of `POINT`.
    left_out : list of str
        Sentences about settings that were not run.
    """
    scene = reference.scene
    repeats = 3 if quick else 5
    near = _near(reference)
    tried, left_out = _first_round(reference, lines)
    for repeat in range(1, MOST):
        for each in tried:
            enough = repeats if each.own[0] + each.near[0] < LONGEST else 3
            if repeat >= enough and len(STUDY) * sum(each.own) > SHORT:
                continue
            each.own.append(each.seconds(scene))
            each.near.append(each.seconds(near))
    points = []
    for each in tried:
        response = each.run(scene, history=True)
        each.status = response.status.name.lower()
        each.seen = observe(scene, response, reference.marks)
        points += _points(reference, each)
    return points, left_out


def _near(reference: Reference) -> Scene:
    """The scene close to its collapse; as it is where nothing collapses."""
    if math.isnan(reference.amplitude):
        return reference.scene
    return reference.scene.at(NEAR * reference.amplitude)


def _first_round(reference: Reference, lines: Iterable[Line]) -> tuple[list[Tried], list[str]]:
    scene, near = reference.scene, _near(reference)
    tried, left_out = [], []
    for line in lines:
        for place, way in enumerate(line.ways):
            each = Tried(line, way, place)
            try:
                dearest = max(clocked(scene, way)[1], clocked(near, way)[1])
            except ArchfragError as reason:
                left_out.append(f"{scene.name}: {line.label} is not run: {reason}")
                break
            tried.append(each)
            each.own.append(each.seconds(scene))
            each.near.append(each.seconds(near))
            if dearest > LONGEST and place + 1 < len(line.ways):
                left_out.append(
                    f"{scene.name}: {line.label} finer than {way} is not run: "
                    f"that took {dearest:.2g} s of the processor"
                )
                break
    return tried, left_out


def _points(reference: Reference, each: Tried) -> list[dict[str, Any]]:
    assert each.seen is not None
    scene, rows = reference.scene, []
    errors = errors_of(each.seen, reference.seen, scene.thickness)
    for name in OF_A_RUN:
        rows.append(_row(reference, each, name, each.own, errors[name]))
    if not math.isnan(reference.amplitude):
        floor = MARGIN * reference.error["amplitude"]
        found = nearest_change(
            lambda amplitude: verdict(each.run(scene.at(amplitude))),
            reference.amplitude, floor, REACH,
        )  # fmt: skip
        status = (
            "no verdict" if found.failed else "no change found" if math.isnan(found.offset) else ""
        )
        rows.append(_row(reference, each, "amplitude", each.near, abs(found.offset), status))
        runs = each.runs_at(scene, reference.grid)
        wrong = [
            verdict(run) is not bool(true) for run, true in zip(runs, reference.truth, strict=True)
        ]
        if runs:
            cost = [sum(run.wall_time for run in runs)]
            rows.append(_row(reference, each, "verdicts", cost, float(np.mean(wrong))))
    return rows


def _row(
    reference: Reference, each: Tried, quantity: str, times: list[float], error: float,
    status: str = "",
) -> dict[str, Any]:  # fmt: skip
    floor = reference.floor(quantity, each.interval(reference.scene))
    if quantity == "verdicts":
        # One wrong verdict is the smallest error that the set can show.
        floor = 0.5 / max(reference.grid.size, 1)
    charted = not reference.why_not(quantity) and math.isfinite(error)
    return {
        "scene": reference.scene.name, "quantity": quantity, "who": each.line.who,
        "line": each.line.label, "method": each.way.method, "way": str(each.way),
        "place": each.place, "cost": float(np.median(times)), "least_cost": min(times),
        "error": error, "floor": floor, "charted": charted,
        "at_floor": bool(charted and error <= floor), "status": status or each.status,
    }  # fmt: skip
