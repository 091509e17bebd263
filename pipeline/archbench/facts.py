"""Physical facts that any correct method must satisfy, and how far a run is from each."""

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from archbench.exact import Rocking, largest_load
from archbench.measures import energy_gain, overlap, path_energy_gain
from archbench.scene import STANDARD_GRAVITY, Array, Scene
from archbench.solve import arch_of, motion_of
from archfrag.physics.status import Status
from archfrag.simulation.response import Response
from archfrag.simulation.simulate import onset

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


Fact = Callable[..., Finding]


@dataclass(frozen=True)
class Run:
    """A run with what it is judged by; `others` are those of the case, by their variants."""

    scene: Scene
    response: Response
    others: Mapping[str, "Run"]
    parameter: str = "rtol"

    @property
    def history(self) -> Any:
        """Frames of the run; ValueError if it has none."""
        if self.response.history is None:
            raise ValueError(f"scene {self.scene.name} was run without a history")
        return self.response.history

    @property
    def rotation(self) -> Array:
        """Of a block, over time [rad]."""
        return np.asarray(self.history.rotation.values[:, 0])

    @property
    def start(self) -> float:
        """Rotation of a block at its release [rad]."""
        return float((self.scene.initial or {})["angle"])


def energy_made(scene: Scene, response: Response) -> float:
    """Energy that a run made, over its largest kinetic energy.

    The smaller of two measures, which err upwards only: by velocities, where these lag behind
    positions, and by positions alone, over impacts.
    """
    arch = arch_of(scene)
    motion = motion_of(scene)
    history = response.history
    assert history is not None
    time = history.time.values
    place = history.displacement.values
    moving = history.velocity.values, history.angular_velocity.values
    return min(
        energy_gain(arch, motion, time, place, *moving),
        path_energy_gain(arch, motion, time, place, history.rotation.values),
    )


def _close(off: float, tolerance: float, what: str) -> Finding:
    return Finding(off <= tolerance, f"{what} off by {off:.1g}")


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
    frames = run.history
    deepest = overlap(
        arch_of(run.scene), frames.displacement.values, frames.rotation.values
    )
    return Finding(deepest <= most, f"overlap {deepest:.1g}")


def _of_response(name: str, compare: Callable[[Any, float], bool], figure: str) -> Fact:
    """A fact about one number of the response and its bound."""

    def fact(run: Run, bound: float) -> Finding:
        value = getattr(run.response, name)
        return Finding(bool(compare(value, bound)), figure.format(value))

    return fact


def ends(run: Run, how: str) -> Finding:
    """It "falls" or "stands"; one that moves when the run ends has not fallen."""
    text = "no answer"
    if run.response.status in ANSWERS:
        text = "falls" if run.response.collapsed else "stands"
    return Finding(text == how, text)


def comes_to_rest(run: Run, within: float) -> Finding:
    """It rests at the end, everything nearer to its place than `within` [m]."""
    last = run.history.displacement.values[-1]
    away = float(np.hypot(last[:, 0], last[:, 1]).max())
    still = run.response.status is Status.STANDING
    figure = f"{'rests' if still else 'moves'} {away:.1g} m from its place"
    return Finding(still and away <= within, figure)


def _onset(run: Run, plus: float, minus: float, tolerance: float) -> Finding:
    start = onset(arch_of(run.scene))
    pairs = ((start.plus, plus), (start.minus, minus))
    worst = max(0.0 if a == b else abs(a - b) / b for a, b in pairs)
    return _close(worst, tolerance, f"onset {start.plus:.6g} g,")


def rest_limit(run: Run, tolerance: float) -> Finding:
    """`archfrag.onset` agrees with the linear programme of the static theorem, to both sides."""
    return _onset(
        run, largest_load(run.scene), largest_load(run.scene, -1.0), tolerance
    )


def loaded_block(run: Run, tolerance: float) -> Finding:
    """Rest limits of a block with a load on its back: friction, or the corner's direction."""
    offset, up = run.scene.bodies().centroid[0].tolist()
    half = 0.5 * run.scene.chain["width"]
    friction = run.scene.friction
    plus, minus = (min(friction, (half + side * offset) / up) for side in (1.0, -1.0))
    return _onset(run, plus, minus, tolerance)


def housner(run: Run, tolerance: float, impacts: int = 3) -> Finding:
    """Amplitudes after impacts, from the conserved energy and Housner's ratio."""
    exact = Rocking.of(run.scene).amplitudes(abs(run.start), impacts)
    change = np.flatnonzero(np.diff(np.signbit(run.rotation)))
    parts = np.split(run.rotation, change + 1)[1 : impacts + 1]
    found = [float(np.abs(part).max()) for part in parts]
    if len(found) < impacts:
        return Finding(False, f"{len(found)} impacts of {impacts}")
    return _close(
        max(abs(a - b) / b for a, b in zip(found, exact)), tolerance, "amplitudes"
    )


def first_impact(run: Run, tolerance: float) -> Finding:
    """Time from the release to the first impact: a quarter of a period."""
    exact = Rocking.of(run.scene).quarter(abs(run.start))
    rotated = run.rotation * math.copysign(1.0, run.rotation[0])
    time = run.history.time.values
    after = int(np.argmax(rotated < 0.0))
    found = np.interp(0.0, rotated[[after, after - 1]], time[[after, after - 1]])
    return _close(float(abs(found - exact)) / exact, tolerance, "first impact")


def zeno(run: Run, tolerance: float) -> Finding:
    """Rest after infinitely many impacts in a finite time."""
    exact = Rocking.of(run.scene).time_to_rest(abs(run.start))
    end = run.response.end_time
    found = _close(abs(end - exact) / exact, tolerance, f"at rest after {end:.3f} s,")
    return found._replace(held=found.held and run.response.status is Status.STANDING)


def newmark(run: Run, tolerance: float) -> Finding:
    """Slip of a block that only slides under a rectangular pulse: (A − mu) g t_p² / 2 · A / mu.

    Newmark 1965, Géotechnique 15, 139-160.
    """
    pulse = run.scene.motion
    friction = run.scene.friction
    push = pulse["amplitude"]
    time = pulse["duration"]
    exact = 0.5 * (push - friction) * STANDARD_GRAVITY * time**2 * push / friction
    return _close(
        abs(run.response.peak_displacement - exact) / exact, tolerance, "slip"
    )


def grazes(run: Run, tolerance: float) -> Finding:
    """What touches without speed comes back to where it started after twice the time."""
    _, time = Rocking.of(run.scene).grazing(run.start, run.scene.motion["amplitude"])
    back = float(np.interp(2.0 * time, run.history.time.values, run.rotation))
    return _close(abs(back - run.start) / run.start, tolerance, "back at its start,")


def known_peak(run: Run, value: float, tolerance: float) -> Finding:
    """A peak displacement that others computed [m]."""
    off = abs(run.response.peak_displacement - value) / value
    return _close(off, tolerance, "peak")


def same_peak(run: Run, variant: str, tolerance: float) -> Finding:
    """The same peak displacement as another run of the case."""
    other = run.others[variant].response.peak_displacement
    return _close(
        abs(run.response.peak_displacement - other) / other, tolerance, "peak"
    )


def mirrors(run: Run, variant: str, tolerance: float, until: float) -> Finding:
    """The mirror image of another run of the case until a time [s], over its peak."""
    times = np.linspace(0.0, until, 200)
    angle, image = (
        np.array([np.interp(times, each.time, row) for row in each.rotation.values.T])
        for each in (run.history, run.others[variant].history)
    )
    off = float(np.abs(angle + image[::-1]).max() / np.abs(angle).max())
    return _close(off, tolerance, "mirror image")


def never_higher(run: Run, most: float) -> Finding:
    """Without ground motion no body moves further than it stood at its release, in parts."""
    length = np.hypot(*np.moveaxis(run.history.displacement.values, 2, 0)).max(axis=1)
    over = float(length.max() / length[0]) - 1.0
    return Finding(over <= most, f"{100.0 * over:.1g} % beyond its release")


def rest_is_skipped(run: Run, least: float) -> Finding:
    """Part of the time that nothing was integrated."""
    part = run.response.model_time["rest"] / run.response.end_time
    return Finding(part >= least, f"{100.0 * part:.2f} % of the time skipped")


FACTS: dict[str, Fact] = {
    "rests": _of_response("peak_displacement", operator.le, "moved {:.3g} m"),
    "moves": _of_response("peak_displacement", operator.gt, "moved {:.3g} m"),
    "upright": _of_response("peak_rotation", operator.le, "rotated {:.1g} rad"),
    "bounded_work": _of_response("steps", operator.le, "{} steps"),
}
FACTS |= {
    fact.__name__: fact
    for fact in (
        ends,
        comes_to_rest,
        rest_limit,
        loaded_block,
        housner,
        first_impact,
        zeno,
        newmark,
        grazes,
        known_peak,
        same_peak,
        mirrors,
        never_higher,
        rest_is_skipped,
    )
}


def judge_run(run: Run, expect: Mapping[str, Any]) -> dict[str, Finding]:
    """Findings of the laws, which hold in every case, and of the facts that a case expects."""
    findings = {"answers": answers(run)}
    if run.response.history is not None:
        findings |= {"energy": energy(run), "signorini": signorini(run)}

    def chosen(given: Any) -> Any:
        by_parameter = isinstance(given, Mapping) and set(given) == {"dt", "rtol"}
        return given[run.parameter] if by_parameter else given

    for name, given in expect.items():
        own = chosen(given)
        if not isinstance(own, Mapping):
            findings[name] = FACTS[name](run, own)
        elif own.get("variant", "") not in {"", *run.others}:
            findings[name] = Finding(False, f"no run to compare with: {own['variant']}")
        else:
            named = {key: chosen(value) for key, value in own.items()}
            findings[name] = FACTS[name](run, **named)
    return findings
