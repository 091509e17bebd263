"""Other people's solvers on the same scenes, judged where they give what can be judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from archfrag.evidence.peers.client import Peer, PeerFailed, PeerMissing
from archfrag.evidence.peers.drive import Outcome
from archfrag.evidence.run import run_scene
from archfrag.evidence.scene import Scene
from archfrag.evidence.speed.first_change import nearest_change
from archfrag.evidence.speed.quantities import largest_distance
from archfrag.evidence.speed.reference import MARGIN, Reference
from archfrag.evidence.speed.runs import NEAR, REACH

STEPS = (5e-3, 2e-3, 1e-3, 5e-4)
QUICK_STEPS = (5e-3, 2e-3, 1e-3)
# Finer steps are left out where a run takes longer, and the search for the amplitude, which takes
# a dozen of them, where one takes so many times as long [s].
LONGEST = 2.0
TOO_LONG = 4.0
# After our collapse, a chain needs this long to have moved two thicknesses [s].
FALL = 4.0


def try_peers(
    names: Sequence[str], references: Sequence[Reference], quick: bool, say: Callable[[str], None]
) -> tuple[list[dict[str, Any]], list[str]]:
    """Points of all peers on all scenes.

    Parameters
    ----------
    names : sequence of str
        As `archfrag.evidence.peers.client` knows them.
    references : sequence of Reference
    quick : bool
        Fewer steps.
    say : callable

    Returns
    -------
    points : list of dict
    left_out : list of str
    """
    points: list[dict[str, Any]] = []
    left_out: list[str] = []
    for name in names:
        try:
            peer = Peer(name, 60.0 if quick else 120.0)
        except PeerMissing as reason:
            left_out.append(f"{name} is not installed: {reason}")
            continue
        for reference in references:
            say(f"speed: {reference.scene.name}, {name}")
            for place, step in enumerate(QUICK_STEPS if quick else STEPS):
                try:
                    rows, seconds = _points(peer, reference, step, place, quick)
                except PeerFailed as reason:
                    left_out.append(str(reason))
                    break
                points += rows
                if seconds > TOO_LONG * LONGEST:
                    left_out.append(
                        f"{reference.scene.name}: amplitude by {name} is not sought: a run took "
                        f"{seconds:.2g} s"
                    )
                if seconds > LONGEST:
                    left_out.append(
                        f"{reference.scene.name}: {name} below {1e3 * step:g} ms is not run: that "
                        f"took {seconds:.2g} s"
                    )
                    break
        peer.close()
    return points, left_out


def _points(
    peer: Peer, reference: Reference, step: float, place: int, quick: bool
) -> tuple[list[dict[str, Any]], float]:
    scene, marks = reference.scene, reference.marks
    base = {
        "scene": scene.name, "who": "peer", "line": peer.name, "method": peer.name,
        "way": f"{peer.name} {1e3 * step:g} ms", "place": place,
    }  # fmt: skip
    # A peer goes on at rest, where ours stops: it is clocked until the reference rests.
    own = _until(scene, reference.response.end_time)
    outcome = peer.run(own, step, history=True)
    times = [outcome.wall_seconds]
    repeats = 1 if times[0] > 1.0 else 2 if quick else 4
    repeats = 0 if times[0] > TOO_LONG * LONGEST else repeats
    times += [peer.run(own, step).wall_seconds for _ in range(repeats)]
    rows = []

    def add(quantity: str, times: list[float], error: float, status: str = "") -> None:
        floor = MARGIN * reference.error.get(quantity, math.nan)
        charted = not reference.why_not(quantity) and math.isfinite(error)
        rows.append({
            **base, "quantity": quantity, "cost": float(np.median(times)), "error": error,
            "least_cost": min(times), "floor": floor, "charted": charted,
            "at_floor": bool(charted and error <= floor), "status": status,
        })  # fmt: skip

    if not math.isnan(marks.position):
        add("position", times, _position_error(reference, outcome))
    true = reference.seen.peak
    peak = math.nan if outcome.collapsed else abs(outcome.peak_displacement - true) / true
    add("peak", times, peak)
    if not math.isnan(reference.amplitude) and times[0] <= TOO_LONG * LONGEST:
        near = scene.at(NEAR * reference.amplitude)
        end = run_scene(near, reference.loose).end_time
        near = _until(near, end)
        costs = [peer.run(near, step).wall_seconds for _ in range(1 + repeats)]
        fallen = run_scene(scene.at(1.001 * reference.amplitude), reference.loose)
        last = fallen.collapse_time if fallen.collapsed else fallen.end_time
        falling = _until(scene, last + FALL)
        found = nearest_change(
            lambda amplitude: peer.run(falling.at(amplitude), step).collapsed,
            reference.amplitude, max(MARGIN * reference.error["amplitude"], 1e-4), REACH,
        )  # fmt: skip
        status = "no change found" if math.isnan(found.offset) else ""
        add("amplitude", costs, abs(found.offset), status)
    return rows, max(times)


def _until(scene: Scene, end: float) -> Scene:
    """The scene cut to whole steps of 10 ms just after `end` [s]."""
    duration = min(scene.duration, 0.01 * math.ceil(end / 0.01))
    return Scene(**{**vars(scene), "duration": duration})


def _position_error(reference: Reference, outcome: Outcome) -> float:
    """Distance of centroids at the mark, a sample of the peer's, over the thickness."""
    assert outcome.history is not None
    time = np.array(outcome.history["time"])
    index = int(np.argmin(np.abs(time - reference.marks.position)))
    if abs(time[index] - reference.marks.position) > 1e-6:
        return math.nan
    moved = np.array(outcome.history["centroids"][index]) - np.array(
        outcome.history["centroids"][0]
    )
    return largest_distance(moved, reference.seen.position) / reference.scene.thickness
