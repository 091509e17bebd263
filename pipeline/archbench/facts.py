"""Physical facts that any correct method must satisfy, and how far a run is from each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from archbench.closed_forms import Rocking, rest_limits, slip_under_rectangle
from archbench.measures import energy_gain, overlap, path_energy_gain
from archbench.scene import Scene
from archbench.solve import arch_of, motion_of
from archbench.statics import largest_load
from archfrag.mechanics.status import Status
from archfrag.simulate import onset
from archfrag.simulation.response import Response

# What contacts may not do in any case; both in parts, see `archbench.measures`.
MOST_ENERGY_GAIN = 1e-3
DEEPEST_OVERLAP = 1e-3
# Frames further apart are silent about energy [s]; below this nothing has moved [m].
COARSEST_FRAMES = 0.01
NOTHING = 1e-9
ANSWERS = (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)


class Finding(NamedTuple):
    """One fact about one run: whether it held, and what was measured."""

    held: bool
    figure: str


@dataclass(frozen=True)
class Run:
    """A run with what it is to be judged by.

    Attributes
    ----------
    scene : Scene
    response : Response
    others : mapping of str to Run
        The case's other runs by their names.
    parameter : str
        "dt" or "rtol": by which the method is set.
    """

    scene: Scene
    response: Response
    others: Mapping[str, Run]
    parameter: str = "rtol"


def energy_made(scene: Scene, response: Response) -> float:
    """Energy that a run made, over its largest kinetic energy.

    The smaller of two measures, by velocities and by positions alone: each may err upwards only,
    the first where velocities lag behind positions, the second over impacts.
    """
    arch, motion, history = arch_of(scene), motion_of(scene), response.history
    assert history is not None
    time, place = history.time.values, history.displacement.values
    return min(
        energy_gain(
            arch, motion, time, place, history.velocity.values, history.angular_velocity.values
        ),
        path_energy_gain(arch, motion, time, place, history.rotation.values),
    )


def answers(run: Run) -> Finding:
    """The run ended with an answer, not with a failure of its solver."""
    return Finding(run.response.status in ANSWERS, run.response.status.name.lower())


def energy(run: Run, most: float = MOST_ENERGY_GAIN) -> Finding:
    """No energy but the ground's comes in."""
    if run.response.peak_displacement < NOTHING:
        return Finding(True, "nothing moved")
    if motion_of(run.scene).dt > COARSEST_FRAMES:
        return Finding(True, "frames too far apart for energy")
    gain = energy_made(run.scene, run.response)
    return Finding(gain <= most, f"energy gained {gain:.1g}")


def signorini(run: Run, most: float = DEEPEST_OVERLAP) -> Finding:
    """Nothing overlaps."""
    history = _history(run)
    deepest = overlap(arch_of(run.scene), history.displacement.values, history.rotation.values)
    return Finding(deepest <= most, f"overlap {deepest:.1g}")


def rests(run: Run, most: float) -> Finding:
    """Nothing moves by more than `most` [m]."""
    moved = run.response.peak_displacement
    return Finding(moved <= most, f"moved {moved:.3g} m")


def moves(run: Run, least: float) -> Finding:
    """Something moves by more than `least` [m]."""
    moved = run.response.peak_displacement
    return Finding(moved > least, f"moved {moved:.3g} m")


def ends(run: Run, how: str) -> Finding:
    """It "falls" or "stands"; one that moves when the run ends has not fallen."""
    text = "no answer"
    if run.response.status in ANSWERS:
        text = "falls" if run.response.collapsed else "stands"
    return Finding(text == how, text)


def comes_to_rest(run: Run, within: float) -> Finding:
    """It rests at the end, everything nearer to its place than `within` [m]."""
    last = _history(run).displacement.values[-1]
    away = float(np.hypot(last[:, 0], last[:, 1]).max())
    still = run.response.status is Status.STANDING
    held = still and away <= within
    return Finding(held, f"{'rests' if still else 'moves'} {away:.1g} m from its place")


def rest_limit(run: Run, tolerance: float) -> Finding:
    """`archfrag.onset` agrees with the linear programme of the static theorem, to both sides."""
    start = onset(arch_of(run.scene))
    pairs = ((start.plus, largest_load(run.scene)), (start.minus, largest_load(run.scene, -1.0)))
    worst = max(0.0 if a == b else abs(a - b) / b for a, b in pairs)
    return Finding(worst <= tolerance, f"onset {start.plus:.6g} g, off by {worst:.1g}")


def loaded_block(run: Run, tolerance: float) -> Finding:
    """Rest limits of a block with a load on its back in closed form."""
    start = onset(arch_of(run.scene))
    plus, minus = rest_limits(run.scene)
    worst = max(abs(start.plus - plus) / plus, abs(start.minus - minus) / minus)
    return Finding(worst <= tolerance, f"onset {start.plus:.6g} g, off by {worst:.1g}")


def housner(run: Run, tolerance: float, impacts: int = 3) -> Finding:
    """Amplitudes after impacts, from the conserved energy and Housner's ratio."""
    start = abs(run.scene.initial["angle"])  # type: ignore[index]
    exact = Rocking.of(run.scene).amplitudes(start, impacts)
    found = _peaks(_history(run).rotation.values[:, 0])[1 : impacts + 1]
    if len(found) < impacts:
        return Finding(False, f"{len(found)} impacts of {impacts}")
    worst = max(abs(a - b) / b for a, b in zip(found, exact))
    return Finding(worst <= tolerance, f"amplitudes off by {worst:.1g}")


def first_impact(run: Run, tolerance: float) -> Finding:
    """Time from the release to the first impact: a quarter of a period."""
    start = abs(run.scene.initial["angle"])  # type: ignore[index]
    exact = Rocking.of(run.scene).quarter(start)
    history = _history(run)
    rotated = history.rotation.values[:, 0] * math.copysign(1.0, history.rotation.values[0, 0])
    after = int(np.argmax(rotated < 0.0))
    part = rotated[after - 1] / (rotated[after - 1] - rotated[after])
    time = history.time.values
    found = float(time[after - 1] + part * (time[after] - time[after - 1]))
    off = abs(found - exact) / exact
    return Finding(off <= tolerance, f"first impact off by {off:.1g}")


def zeno(run: Run, tolerance: float) -> Finding:
    """Rest after infinitely many impacts in a finite time."""
    start = abs(run.scene.initial["angle"])  # type: ignore[index]
    exact = Rocking.of(run.scene).time_to_rest(start)
    off = abs(run.response.end_time - exact) / exact
    held = off <= tolerance and run.response.status is Status.STANDING
    return Finding(held, f"at rest after {run.response.end_time:.3f} s, off by {off:.1g}")


def newmark(run: Run, tolerance: float) -> Finding:
    """Slip of a block that only slides under a rectangular pulse."""
    exact = slip_under_rectangle(run.scene)
    off = abs(run.response.peak_displacement - exact) / exact
    return Finding(off <= tolerance, f"slip off by {off:.1g}")


def upright(run: Run, most: float) -> Finding:
    """Nothing rotates by more than `most` [rad]."""
    rotated = run.response.peak_rotation
    return Finding(rotated <= most, f"rotated {rotated:.1g} rad")


def grazes(run: Run, tolerance: float) -> Finding:
    """What touches without speed comes back to where it started after twice the time."""
    start = run.scene.initial["angle"]  # type: ignore[index]
    _, time = Rocking.of(run.scene).grazing(start, run.scene.motion["amplitude"])
    history = _history(run)
    back = float(np.interp(2.0 * time, history.time.values, history.rotation.values[:, 0]))
    off = abs(back - start) / start
    return Finding(off <= tolerance, f"back at its start, off by {off:.1g}")


def same_peak(run: Run, variant: str, tolerance: float) -> Finding:
    """The same peak displacement as another run of the case."""
    if variant not in run.others:
        return Finding(False, f"no run to compare with: {variant}")
    other = run.others[variant].response.peak_displacement
    off = abs(run.response.peak_displacement - other) / other
    return Finding(off <= tolerance, f"peak off by {off:.1g}")


def mirrors(run: Run, variant: str, tolerance: float, until: float) -> Finding:
    """The mirror image of another run of the case until a time [s], over its peak."""
    if variant not in run.others:
        return Finding(False, f"no run to compare with: {variant}")
    one, other = _history(run), _history(run.others[variant])
    times = np.linspace(0.0, until, 200)
    angle = np.array([np.interp(times, one.time, row) for row in one.rotation.values.T])
    image = np.array([np.interp(times, other.time, row) for row in other.rotation.values.T])
    off = float(np.abs(angle + image[::-1]).max() / np.abs(angle).max())
    return Finding(off <= tolerance, f"mirror image off by {off:.1g}")


def never_higher(run: Run, most: float) -> Finding:
    """Without ground motion no body moves further than it stood at its release, in parts."""
    length = np.hypot(*np.moveaxis(_history(run).displacement.values, 2, 0)).max(axis=1)
    over = float(length.max() / length[0]) - 1.0
    return Finding(over <= most, f"{100.0 * over:.1g} % beyond its release")


def rest_is_skipped(run: Run, least: float) -> Finding:
    """Part of the time that nothing was integrated."""
    part = run.response.model_time["rest"] / run.response.end_time
    return Finding(part >= least, f"{100.0 * part:.2f} % of the time skipped")


def bounded_work(run: Run, steps: int) -> Finding:
    """Integration steps."""
    return Finding(run.response.steps <= steps, f"{run.response.steps} steps")


FACTS: dict[str, Callable[..., Finding]] = {
    fact.__name__: fact
    for fact in (
        rests, moves, ends, comes_to_rest, rest_limit, loaded_block, housner, first_impact, zeno,
        newmark, upright, grazes, same_peak, mirrors, never_higher, rest_is_skipped, bounded_work,
    )
}  # fmt: skip
LAWS: dict[str, Callable[..., Finding]] = {
    "answers": answers, "energy": energy, "signorini": signorini
}  # fmt: skip


def judge_run(run: Run, expect: Mapping[str, Any]) -> dict[str, Finding]:
    """Findings of the laws, which hold in every case, and of the facts that a case expects."""
    laws = LAWS if run.response.history is not None else {"answers": answers}
    findings = {name: law(run) for name, law in laws.items()}
    for name, given in expect.items():
        chosen = _chosen(given, run.parameter)
        if isinstance(chosen, Mapping):
            own = {key: _chosen(value, run.parameter) for key, value in chosen.items()}
            findings[name] = FACTS[name](run, **own)
        else:
            findings[name] = FACTS[name](run, chosen)
    return findings


def _chosen(given: Any, parameter: str) -> Any:
    return (
        given[parameter] if isinstance(given, Mapping) and set(given) == {"dt", "rtol"} else given
    )


def _history(run: Run):
    if run.response.history is None:
        raise ValueError(f"scene {run.scene.name} was run without a history")
    return run.response.history


def _peaks(rotation: np.ndarray) -> list[float]:
    """Largest magnitudes between changes of sign."""
    change = np.flatnonzero(np.diff(np.signbit(rotation)))
    return [float(np.abs(part).max()) for part in np.split(rotation, change + 1)]
