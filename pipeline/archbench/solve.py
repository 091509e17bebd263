"""One scene by one solver at one setting: what came out, what it cost, and where it collapses."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import archfrag as af
from archbench.adapters.client import OtherSolver, SolverFailed
from archbench.scene import Array, Scene
from archbench.settings import Setting
from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.motions.motion import Motion
from archfrag.motions.read import read_motion
from archfrag.physics.status import Status
from archfrag.simulation.response import Response
from archfrag.simulation.simulate import simulate_runs

RUN_LIMIT = 120.0  # longest that a run of another solver may take [s]
CHECKOUT = Path(__file__).resolve().parents[2]
RECORDS = CHECKOUT / "records"
PRIVATE = CHECKOUT.parent / "shared"  # what may not be given away
NONE = np.zeros(0)
Outcome = Callable[[float], bool | None]


class Frames(NamedTuple):
    """A motion at instants `time` [s], by the shapes of `archbench.measures`.

    resultant (n_time, n_joint, 3) [N], [N], [N m]; what a solver does not give is empty.
    """

    time: Array = NONE
    displacement: Array = NONE
    rotation: Array = NONE
    velocity: Array = NONE
    angular_velocity: Array = NONE
    resultant: Array = NONE


NO_FRAMES = Frames()


@dataclass(frozen=True)
class Solution:
    """What a run gave, by the same names for every solver.

    `collapsed` is None if the solver failed; a run that ends moving has not collapsed. `seconds`
    is the CPU time of the integration alone, `peak` the largest displacement of a centroid [m];
    `unconverged`: a contact problem was given up; `response` is that of ours.
    """

    collapsed: bool | None
    status: str
    seconds: float = math.nan
    peak: float = math.nan
    end_time: float = math.nan
    steps: int = 0
    unconverged: bool = False
    frames: Frames = NO_FRAMES
    response: Response | None = None


def arch_of(scene: Scene) -> Arch:
    """The scene's chain."""
    names = ("density", "depth", "dead_load")
    own = {key: scene.chain[key] for key in names if key in scene.chain}
    return Arch.from_joints(
        *scene.joint_lines(), scene.friction, free_end=scene.free_end, **own
    )


def motion_of(scene: Scene) -> Motion:
    """The scene's ground motion at its own amplitude; of a record, see `with_samples`."""
    return Motion(*scene.ground_acceleration())


def with_samples(scene: Scene) -> Scene:
    """The same scene with a record's samples in it, in units of its peak."""
    if scene.motion["kind"] != "record":
        return scene
    places = [
        folder / scene.motion["file"] for folder in (RECORDS, PRIVATE / "records")
    ]
    for place in places:
        if place.is_file():
            return with_motion(scene, read_motion(place), scene.motion["amplitude"])
    raise InputError(
        f"scene {scene.name} needs the record {scene.motion['file']}; not found "
        f"in {', '.join(str(place.parent) for place in places)}"
    )


def with_motion(scene: Scene, motion: Motion, amplitude: float) -> Scene:
    """A scene under a record with this peak [g]."""
    values = (motion.acceleration / np.max(np.abs(motion.acceleration))).tolist()
    samples = {"kind": "samples", "values": values, "sample_step": motion.dt}
    return replace(scene, motion={**samples, "amplitude": amplitude})


def solve(
    scene: Scene, setting: Setting, *, history: bool = False, scale: float = 1.0
) -> Solution:
    """Run a scene, its motion scaled if it is ours."""
    if not setting.ours:
        return _other(scene, setting, history)
    arch = arch_of(scene)
    motion = motion_of(scene)
    given = setting.options
    if scene.initial is not None or scene.motion["kind"] == "none":
        # An initial state lets an arch that cannot stand fall instead of being refused.
        given["initial"] = scene.initial_state()
    given |= {"history": history, "follow": _follow(scene, motion)}
    wall = time.perf_counter()
    cpu = time.process_time()
    response = af.simulate(arch, motion, scale, **given)
    wall = time.perf_counter() - wall
    cpu = time.process_time() - cpu
    return _solution(response, cpu * response.wall_time / wall)


def collapses(scene: Scene, setting: Setting, amplitude: float) -> bool | None:
    """What searches ask: whether the scene collapses at an amplitude [g]."""
    return solve(scene.at(amplitude), setting).collapsed


def solve_many(
    scene: Scene, setting: Setting, factors: Sequence[float]
) -> list[Solution]:
    """Run a scene with its motion scaled by several factors, in one call where a study does so."""
    if setting.ours and scene.initial is None and scene.motion["kind"] != "none":
        arch = arch_of(scene)
        motion = motion_of(scene)
        given = {"follow": _follow(scene, motion), **setting.options}
        wall = time.perf_counter()
        cpu = time.process_time()
        runs = simulate_runs(arch, [motion] * len(factors), list(factors), **given)
        wall = time.perf_counter() - wall
        cpu = time.process_time() - cpu
        seconds = cpu * sum(run.wall_time for run in runs) / wall / len(runs)
        return [_solution(run, seconds) for run in runs]
    own = scene.motion.get("amplitude", 1.0)
    return [solve(scene.at(factor * own), setting) for factor in factors]


def _follow(scene: Scene, motion: Motion) -> float:
    return max(0.0, scene.duration - motion.dt * (motion.acceleration.size - 1))


def _solution(response: Response, seconds: float) -> Solution:
    frames = NO_FRAMES
    history = response.history
    if history is not None:
        moment = history["moment"].to_numpy()[..., None]
        resultant = np.concatenate([history["reaction"].to_numpy(), moment], axis=2)
        own = {name: history[name].to_numpy() for name in Frames._fields[:-1]}
        frames = Frames(**own, resultant=resultant)
    return Solution(
        False if response.status is Status.UNFINISHED else response.collapsed,
        response.status.name.lower(),
        seconds,
        response.peak_displacement,
        response.end_time,
        response.steps,
        response.status is Status.NO_CONTACT_SOLUTION
        or bool(response.work.get("unconverged", 0)),
        frames,
        response,
    )


# Another solver in a process of its own, started once for each process of ours.
_other_solver = lru_cache(OtherSolver)


def _other(scene: Scene, setting: Setting, history: bool) -> Solution:
    try:
        run = _other_solver(setting.method, RUN_LIMIT).run(
            scene, setting.value, history
        )
    except SolverFailed as failure:
        return Solution(None, str(failure))
    frames = NO_FRAMES
    if run.history is not None:
        centroids = np.array(run.history["centroids"])
        frames = Frames(np.array(run.history["time"]), centroids - centroids[0])
    return Solution(
        run.collapsed,
        "collapsed" if run.collapsed else "ended",
        run.cpu_seconds,
        run.peak_displacement,
        run.simulated_seconds,
        run.steps,
        bool(run.unconverged),
        frames,
    )


class Change(NamedTuple):
    """Where outcomes change, relative to where they were expected to: `offset`, plus or minus.

    nan if there is no change within reach or a run `failed`; `width` is that of the last bracket.
    """

    offset: float = math.nan
    width: float = math.nan
    failed: bool = False


def nearest_change(
    outcome: Outcome,
    centre: float,
    floor: float,
    reach: float = 0.5,
    fraction: float = 0.1,
) -> Change:
    """Distance of the change from standing to collapse that is nearest to `centre`.

    Probes go away from the centre by factors of ten, towards smaller values if it collapses and
    larger ones if it stands, until outcomes differ; what is between is bisected on the log scale.
    """
    at_centre = outcome(centre)
    if at_centre is None:
        return Change(failed=True)
    side = -1.0 if at_centre else 1.0
    inner = 0.0
    outer = floor
    changed = False
    while not changed or outer - inner > max(floor, fraction * inner):
        middle = math.sqrt(inner * outer) if inner > 0.0 else 0.5 * outer
        seen = outcome(centre * (1.0 + side * (middle if changed else outer)))
        if seen is None:
            return Change(failed=True)
        if changed:
            inner, outer = (middle, outer) if seen is at_centre else (inner, middle)
        elif seen is not at_centre:
            changed = True
        elif outer >= reach:
            return Change()
        else:
            inner = outer
            outer = min(10.0 * outer, reach)
    return Change(side * 0.5 * (inner + outer), outer - inner)


def least_collapsing(
    outcome: Outcome, low: float, high: float, width: float = 1e-4, grid: int = 12
) -> float:
    """First collapse on a grid, because outcomes are not monotone, then bisected."""
    amplitudes = np.geomspace(low, high, grid).tolist()
    first = next((k for k, each in enumerate(amplitudes) if outcome(each)), None)
    if first is None:
        return math.nan
    stands = amplitudes[max(first - 1, 0)]
    least = amplitudes[first]
    while least - stands > width * least:
        middle = 0.5 * (least + stands)
        stands, least = (stands, middle) if outcome(middle) else (middle, least)
    return least
