"""Methods and their ladders of settings: the one table that all evidence draws on."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from archfrag.errors import InputError
from archfrag.evidence.run import Way, arch_of, run_scene
from archfrag.evidence.scene import Scene
from archfrag.methods.registry import AUTO, METHODS
from archfrag.simulate import warmup
from archfrag.simulation.checks import default_steps
from archfrag.simulation.response import Response

STEPS = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
TOLERANCES = tuple(10.0**-k for k in range(1, 9))
TOLERANCES_OF_AUTO = (3e-1, 1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, *TOLERANCES[3:])
STIFFNESSES = (1e8, 1e9, 1e10, 1e11, 1e12)


@dataclass(frozen=True)
class Line:
    """One line of a chart: a method and the settings along it, coarse ones first.

    Attributes
    ----------
    label : str
    ways : tuple of Way
    who : str
        "ours", or "limit" for a limit of auto changed alone, which is on no chart.
    """

    label: str
    ways: tuple[Way, ...]
    who: str = "ours"

    @property
    def method(self) -> str:
        """Name of the method in the registry."""
        return self.ways[0].method


def _steps(method: str, steps: tuple[float, ...] = STEPS) -> tuple[Way, ...]:
    return tuple(Way(method, "dt", step) for step in steps)


def _tolerances(method: str, tolerances: tuple[float, ...]) -> tuple[Way, ...]:
    return tuple(Way(method, "rtol", rtol) for rtol in tolerances)


LADDERS: tuple[Line, ...] = (
    Line("time_stepping", _steps("time_stepping")),
    Line("event_driven", _tolerances("event_driven", TOLERANCES)),
    Line("auto", _tolerances(AUTO, TOLERANCES_OF_AUTO)),
    # Its error is the joints' compliance; the step follows from the stiffness.
    Line(
        "penalty",
        tuple(Way("penalty", "dt", 1e-3, {"stiffness": value}) for value in STIFFNESSES),
    ),
    # Its error is the model's: tolerances finer than these change no digit of it that counts.
    Line("four_link", tuple(Way("four_link", "rtol", 10.0**-k) for k in (2, 4, 6))),
    Line("gauss_seidel", _steps("gauss_seidel")),
    Line("quadratic_programme", _steps("quadratic_programme")),
)
# What auto's own limits are worth: each changed alone.
AUTO_LIMITS = (
    Way(AUTO, "rtol", 1e-1, {"coarse": 1.0}),
    Way(AUTO, "rtol", 1e-2, {"coarse": 0.0}),
    *(Way(AUTO, "rtol", 1e-3, {"hand_over": steps}) for steps in (0.3, 1.0, 10.0, 30.0)),
)
# Every second setting in the quick set, from which those named are taken.
QUICK_STEPS = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)
QUICK_TOLERANCES = (1e-1, 1e-2, 1e-4, 1e-6)
QUICK_OF_AUTO = (*TOLERANCES_OF_AUTO[:8], 1e-6)
QUICK_STIFFNESSES = (1e8, 1e10)


def step_of(way: Way, scene: Scene) -> float:
    """Time step of a way on a scene, given or by its method's rule [s].

    Parameters
    ----------
    way : Way
    scene : Scene
    """
    if way.knob == "dt":
        return way.value
    return default_steps(METHODS[way.method], way.value, arch_of(scene))[0]


def ladders(quick: bool) -> tuple[list[Line], list[str]]:
    """Lines of all methods that can run here, their kernels loaded; why the others cannot.

    Parameters
    ----------
    quick : bool
        Fewer settings on each line.

    Returns
    -------
    lines : list of Line
    missing : list of str
        A sentence for each method of the table that is not registered or does not start.
    """
    lines: list[Line] = []
    reasons: dict[str, str] = {}
    loaded: set[str] = set()
    for line in LADDERS:
        name = line.method
        if name not in METHODS:
            reasons[name] = f"{name} is not a method of this version"
        elif name not in loaded and name not in reasons:
            try:
                warmup(name)
                loaded.add(name)
            except (InputError, ImportError) as reason:
                reasons[name] = f"{name} does not start: {reason}"
        if name in loaded:
            ways = tuple(way for way in line.ways if not quick or _is_quick(way))
            lines.append(Line(line.label, ways))
    if AUTO in loaded:
        lines += [Line(str(way), (way,), "limit") for way in AUTO_LIMITS]
    return lines, list(reasons.values())


def clocked(scene: Scene, way: Way, **options: Any) -> tuple[Response, float]:
    """A run, and the processor time it took with all around it [s].

    What is run next is decided by processor time: wall time would let a busy machine decide.

    Parameters
    ----------
    scene : Scene
    way : Way
    **options
        Of `archfrag.simulate`.
    """
    began = time.process_time()
    response = run_scene(scene, way, **options)
    return response, time.process_time() - began


def _is_quick(way: Way) -> bool:
    if "stiffness" in way.settings:
        return way.settings["stiffness"] in QUICK_STIFFNESSES
    if way.method == AUTO:
        return way.value in QUICK_OF_AUTO
    return way.value in (QUICK_STEPS if way.knob == "dt" else QUICK_TOLERANCES)
