"""One scene by one solver at one setting: what came out, and what it cost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import archfrag as af
from archbench.adapters.client import OtherSolver, SolverFailed
from archbench.scene import STANDARD_GRAVITY, Scene
from archbench.settings import Setting
from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.mechanics.status import Status
from archfrag.motions.motion import Motion
from archfrag.motions.read import read_motion
from archfrag.simulation.many import simulate_runs
from archfrag.simulation.response import Response

Array = NDArray[np.float64]


class Frames(NamedTuple):
    """A motion at instants; what a solver does not give is None.

    Attributes
    ----------
    time : ndarray, (n_time,) [s]
    displacement, velocity : ndarray, (n_time, n_voussoir, 2) [m], [m/s]
    rotation, angular_velocity : ndarray, (n_time, n_voussoir) [rad], [rad/s]
    resultant : ndarray, (n_time, n_joint, 3) [N], [N], [N m]
    """

    time: Array
    displacement: Array
    rotation: Array | None = None
    velocity: Array | None = None
    angular_velocity: Array | None = None
    resultant: Array | None = None


@dataclass(frozen=True)
class Solution:
    """What a run gave, by the same names for every solver.

    Attributes
    ----------
    collapsed : bool or None
        None if the solver failed; a run that ends moving has not collapsed.
    status : str
    seconds : float
        CPU time of the integration alone [s].
    peak : float
        Largest displacement of a centroid [m].
    end_time : float [s]
    steps : int
    unconverged : bool
        Whether a contact problem was given up.
    frames : Frames or None
    response : archfrag.simulate.Response or None
        Of ours.
    """

    collapsed: bool | None
    status: str
    seconds: float
    peak: float
    end_time: float
    steps: int = 0
    unconverged: bool = False
    frames: Frames | None = None
    response: Response | None = None


def arch_of(scene: Scene) -> Arch:
    """The scene's chain."""
    inner, outer = scene.joint_lines()
    own = {
        key: scene.chain[key] for key in ("density", "depth", "dead_load") if key in scene.chain
    }
    return Arch.from_joints(inner, outer, scene.friction, free_end=scene.free_end, **own)


def motion_of(scene: Scene) -> Motion:
    """The scene's ground motion at its own amplitude; of a record, see `with_samples`."""
    samples, step = scene.ground_acceleration()
    return Motion(samples, step)


def peak_acceleration(scene: Scene) -> float:
    """Largest ground acceleration of a scene, in standard gravity."""
    return float(np.max(np.abs(motion_of(scene).acceleration))) / STANDARD_GRAVITY


def with_samples(scene: Scene, folders: Sequence[Path | None]) -> Scene:
    """The same scene with a record's samples in it, in units of its peak."""
    if scene.motion["kind"] != "record":
        return scene
    places = [folder / scene.motion["file"] for folder in folders if folder is not None]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise InputError(
            f"scene {scene.name} needs the record {scene.motion['file']}; not found in "
            f"{', '.join(str(folder) for folder in folders if folder is not None)}"
        )
    return with_motion(scene, read_motion(path), scene.motion["amplitude"])


def with_motion(scene: Scene, motion: Motion, amplitude: float) -> Scene:
    """A scene under a record with this peak [g]."""
    samples = {
        "kind": "samples",
        "amplitude": amplitude,
        "sample_step": motion.dt,
        "values": (motion.acceleration / np.max(np.abs(motion.acceleration))).tolist(),
    }
    return replace(scene, motion=samples)


def solve(
    scene: Scene, setting: Setting, *, history: bool = False, limit: float = 120.0, **options: Any
) -> Solution:
    """Run a scene.

    Examples
    --------
    >>> from archbench.scene import load_scene
    >>> from archbench.settings import Setting
    >>> from archbench.solve import solve
    >>> solve(load_scene("arch7_pulse"), Setting("time_stepping", "dt", 1e-3)).collapsed
    False
    """
    if not setting.ours:
        return _other(scene, setting, history, limit)
    arch, motion = arch_of(scene), motion_of(scene)
    given = {"follow": _follow(scene, motion), **setting.options, **options}
    if scene.initial is not None or scene.motion["kind"] == "none":
        # An initial state lets an arch that cannot stand fall instead of being refused.
        given.setdefault("initial", scene.initial_state())
    wall, cpu = time.perf_counter(), time.process_time()
    response = af.simulate(arch, motion, history=history, **given)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return _solution(response, cpu * response.wall_time / wall)


def collapses(scene: Scene, setting: Setting) -> Callable[[float], bool | None]:
    """What searches ask: whether the scene collapses at an amplitude [g]."""

    def asked(amplitude: float) -> bool | None:
        return solve(scene.at(amplitude), setting).collapsed

    return asked


def solve_many(scene: Scene, setting: Setting, factors: Sequence[float]) -> list[Solution]:
    """Run a scene with its motion scaled by several factors, in one call where a study does so."""
    if setting.ours and scene.initial is None and scene.motion["kind"] != "none":
        motion = motion_of(scene)
        given = {"follow": _follow(scene, motion), **setting.options}
        wall, cpu = time.perf_counter(), time.process_time()
        runs = simulate_runs(arch_of(scene), [motion] * len(factors), list(factors), **given)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        if runs:
            seconds = cpu * sum(run.wall_time for run in runs) / wall / len(runs)
            return [_solution(run, seconds) for run in runs]
    own = scene.motion.get("amplitude", 1.0)
    return [solve(scene.at(factor * own), setting) for factor in factors]


def _follow(scene: Scene, motion: Motion) -> float:
    return max(0.0, scene.duration - motion.dt * (motion.acceleration.size - 1))


def _solution(response: Response, seconds: float) -> Solution:
    frames, history = None, response.history
    if history is not None:
        values = {name: history[name].to_numpy() for name in history.variables}
        resultant = np.concatenate([values["reaction"], values["moment"][..., None]], axis=2)
        frames = Frames(
            values["time"], values["displacement"], values["rotation"], values["velocity"],
            values["angular_velocity"], resultant,
        )  # fmt: skip
    return Solution(
        False if response.status is Status.UNFINISHED else response.collapsed,
        response.status.name.lower(),
        seconds,
        response.peak_displacement,
        response.end_time,
        response.steps,
        response.status is Status.NO_CONTACT_SOLUTION or bool(response.work.get("unconverged", 0)),
        frames,
        response,
    )


@lru_cache
def other_solver(name: str, limit: float) -> OtherSolver:
    """Another solver in a process of its own, started once for each process of ours."""
    return OtherSolver(name, limit)


def _other(scene: Scene, setting: Setting, history: bool, limit: float) -> Solution:
    try:
        run = other_solver(setting.method, limit).run(scene, setting.value, history)
    except SolverFailed as failure:
        return Solution(None, str(failure), math.nan, math.nan, math.nan)
    frames = None
    if run.history is not None:
        centroids = np.array(run.history["centroids"])
        frames = Frames(np.array(run.history["time"]), centroids - centroids[0])
    return Solution(
        run.collapsed, "collapsed" if run.collapsed else "ended", run.cpu_seconds,
        run.peak_displacement, run.simulated_seconds, run.steps, bool(run.unconverged), frames,
    )  # fmt: skip
