"""One scene by one method at one setting: what came out, and what it cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.errors import InputError
from archfrag.evidence.scene import Scene
from archfrag.mechanics.status import Status
from archfrag.methods.registry import METHODS
from archfrag.motions.motion import Motion
from archfrag.motions.read import read_motion
from archfrag.simulation.many import simulate_runs
from archfrag.simulation.response import Response

Verdict = bool | None


@dataclass(frozen=True)
class Way:
    """A method with its step or its tolerance, and its own settings.

    Attributes
    ----------
    method : str
    knob : str
        "dt" [s] or "rtol".
    value : float
    settings : mapping of str to float
        The method's own parameters that differ from their defaults.
    """

    method: str
    knob: str
    value: float
    settings: Mapping[str, float] = field(default_factory=dict)

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of `archfrag.simulate`."""
        return {"method": self.method, self.knob: self.value, "settings": dict(self.settings)}

    def __str__(self) -> str:
        setting = f"{1e3 * self.value:g} ms" if self.knob == "dt" else f"{self.value:g}"
        own = "".join(f", {name} {value:g}" for name, value in self.settings.items())
        return f"{self.method} {setting}{own}"


@dataclass(frozen=True)
class Places:
    """Where records are: the shipped ones, and a folder of real ones if there is any."""

    shipped: Path
    real: Path | None = None

    def find(self, file: str) -> Path | None:
        """Path of a record that a scene names; None if it is not at hand."""
        for folder in (self.shipped, self.real):
            if folder is not None and (folder / file).is_file():
                return folder / file
        return None


def arch_of(scene: Scene) -> Arch:
    """The scene's chain.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Arch

    Examples
    --------
    >>> from archfrag.evidence.run import arch_of
    >>> from archfrag.evidence.scene import load_scene
    >>> arch_of(load_scene("arch7_pulse")).n_voussoir
    7
    """
    inner, outer = scene.joint_lines()
    own = {
        key: scene.chain[key] for key in ("density", "depth", "dead_load") if key in scene.chain
    }
    return Arch.from_joints(inner, outer, scene.friction, free_end=scene.free_end, **own)


def motion_of(scene: Scene) -> Motion:
    """The scene's ground motion at its own amplitude; of a record, see `with_samples`."""
    samples, step = scene.ground_acceleration()
    return Motion(samples, step)


def with_samples(scene: Scene, places: Places) -> Scene:
    """The same scene with a record's samples in it, in units of its peak.

    Parameters
    ----------
    scene : Scene
    places : Places

    Returns
    -------
    Scene
        As it was if its motion is no record.

    Raises
    ------
    InputError
        If the record is not at hand; the sentence names the file.
    """
    if scene.motion["kind"] != "record":
        return scene
    path = places.find(scene.motion["file"])
    if path is None:
        raise InputError(
            f"scene {scene.name} needs the record {scene.motion['file']}, which is neither under "
            f"{places.shipped} nor under {places.real or 'a folder given by --real'}"
        )
    motion = read_motion(path)
    values = motion.acceleration / np.max(np.abs(motion.acceleration))
    samples = {
        "kind": "samples",
        "amplitude": scene.motion["amplitude"],
        "sample_step": motion.dt,
        "values": values.tolist(),
    }
    return Scene(**{**vars(scene), "motion": samples})


def at_hand(scenes: Sequence[Scene], places: Places) -> tuple[list[Scene], list[str]]:
    """Those scenes whose record is there, with samples; and a sentence for each other one."""
    found, missing = [], []
    for scene in scenes:
        try:
            found.append(with_samples(scene, places))
        except InputError as reason:
            missing.append(str(reason))
    return found, missing


def run_scene(scene: Scene, way: Way, *, history: bool = False, **options: Any) -> Response:
    """Run a scene by one of our methods.

    Parameters
    ----------
    scene : Scene
        Without a record that is still to be read.
    way : Way
    history : bool
    **options
        Of `archfrag.simulate`, in the place of the way's.

    Returns
    -------
    archfrag.simulate.Response
        Its `wall_time` is that of the integration alone.

    Examples
    --------
    >>> from archfrag.evidence.run import Way, run_scene
    >>> from archfrag.evidence.scene import load_scene
    >>> way = Way("time_stepping", "dt", 1e-3)
    >>> run_scene(load_scene("arch7_pulse"), way).collapsed
    False
    """
    arch, motion = arch_of(scene), motion_of(scene)
    length = motion.dt * (motion.acceleration.size - 1)
    given = {"follow": max(0.0, scene.duration - length), **way.options, **options}
    if scene.initial is not None or scene.motion["kind"] == "none":
        # An initial state lets an arch that cannot stand fall instead of being refused.
        given.setdefault("initial", scene.initial_state())
    return af.simulate(arch, motion, history=history, **given)


def run_study(scene: Scene, way: Way, factors: Sequence[float]) -> list[Response] | None:
    """Run a scene with its motion scaled by several factors in one call, as a study does.

    Parameters
    ----------
    scene : Scene
        Without a record that is still to be read.
    way : Way
    factors : sequence of float

    Returns
    -------
    list of archfrag.simulate.Response or None
        The wall time of them all is shared out. None for methods that make one run at a time, and
        for scenes that do not begin at rest.

    Examples
    --------
    >>> from archfrag.evidence.run import Way, run_study
    >>> from archfrag.evidence.scene import load_scene
    >>> runs = run_study(load_scene("arch7_pulse"), Way("time_stepping", "dt", 1e-3), [0.5, 1.0])
    >>> [run.collapsed for run in runs]
    [False, False]
    """
    if scene.initial is not None or scene.motion["kind"] == "none":
        return None
    motion = motion_of(scene)
    follow = max(0.0, scene.duration - motion.dt * (motion.acceleration.size - 1))
    given = {"follow": follow, **way.options}
    return simulate_runs(arch_of(scene), [motion] * len(factors), factors, **given)


def verdict(response: Response) -> Verdict:
    """Whether the chain collapsed before the run ended; None if the solver failed."""
    if response.status is Status.UNFINISHED:
        return False
    return response.collapsed


@dataclass(frozen=True)
class Search:
    """A least collapsing amplitude, and what it cost.

    Attributes
    ----------
    least : float
        In standard gravity; nan if nothing up to the scene's `high` collapses.
    runs, failures : int
    seconds : float
        Wall time of all runs [s].
    """

    least: float
    runs: int
    failures: int
    seconds: float


def least_amplitude(scene: Scene, way: Way, width: float = 1e-4, grid: int = 12) -> Search:
    """First collapse on a grid from the scene's `low` to its `high`, then bisected.

    Parameters
    ----------
    scene : Scene
    way : Way
    width : float
        Relative width at which the bisection ends.
    grid : int
        Amplitudes tried before, because verdicts are not monotone.

    Returns
    -------
    Search
    """
    runs: list[Response] = []

    def falls(amplitude: float) -> Verdict:
        runs.append(run_scene(scene.at(amplitude), way))
        return verdict(runs[-1])

    stands, least = scene.low, math.nan
    for amplitude in np.geomspace(scene.low, scene.high, grid).tolist():
        if falls(amplitude):
            least = amplitude
            break
        stands = amplitude
    while least - stands > width * least:
        middle = 0.5 * (least + stands)
        if falls(middle):
            least = middle
        else:
            stands = middle
    return Search(
        least,
        len(runs),
        sum(verdict(response) is None for response in runs),
        sum(response.wall_time for response in runs),
    )


def compile_seconds(methods: Sequence[str]) -> dict[str, float]:
    """Seconds that each method's kernels take to compile, or to load if they were before [s]."""
    from archfrag.simulate import warmup

    return {name: warmup(name) for name in methods if name in METHODS}


def peak_acceleration(scene: Scene) -> float:
    """Largest ground acceleration of a scene, in standard gravity."""
    return float(np.max(np.abs(motion_of(scene).acceleration))) / STANDARD_GRAVITY
