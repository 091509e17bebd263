"""One driver for all solvers: steps, clocks and judges them alike."""

import math
import time
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from archbench.scene import Scene

Array = NDArray[np.float64]
# Nothing that falls for ten seconds is faster [m/s].
MOST_SPEED = 100.0


class Stepper(Protocol):
    """What an adapter builds of a scene: one solver, ready to step."""

    @property
    def unconverged(self) -> int | None:
        """Steps that the solver left unconverged; None if it does not report them."""

    def advance(self, ground_acceleration: Array) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""

    def centroids(self) -> Array:
        """Centroids of the voussoirs in the ground's frame, (n, 2) [m]."""


@dataclass
class Outcome:
    """What a run gave, by measures that are the same for every solver.

    Attributes
    ----------
    collapsed : bool
        Whether a centroid has moved more than two thicknesses; `collapse_time` [s] is when this
        was first seen, to the sampling interval, or nan.
    peak_displacement : float
        Largest displacement of a centroid from its place in the scene [m].
    wall_seconds, cpu_seconds : float
        Of stepping alone.
    unconverged : int or None
        Steps whose contact problem was left unconverged; None if the solver does not report them.
    history : dict or None
        `time` [s] and `centroids` (time, voussoir, xy) [m], as lists.
    """

    collapsed: bool
    collapse_time: float
    peak_displacement: float
    simulated_seconds: float
    steps: int
    wall_seconds: float
    cpu_seconds: float
    unconverged: int | None
    history: dict[str, Any] | None = field(default=None, repr=False)


def drive(
    stepper: Stepper,
    scene: Scene,
    dt: float,
    *,
    sampling: float = 0.01,
    history: bool = False,
    stop_at_collapse: bool = True,
) -> Outcome:
    """Run a built scene to its end, or to its collapse.

    Parameters
    ----------
    stepper : Stepper
    scene : Scene
    dt : float
        Step [s].
    sampling : float
        Interval at which the centroids are looked at [s].
    history : bool
        Keep what was seen.
    stop_at_collapse : bool
        Stop when collapse is seen.

    Returns
    -------
    Outcome

    Raises
    ------
    ArithmeticError
        If the positions are not finite, or change faster than `MOST_SPEED`.
    """
    start = scene.bodies().centroid
    limit = 2.0 * scene.thickness
    acceleration = scene.step_means(dt)
    stride = max(1, round(sampling / dt))
    peak, collapse_time, wall, cpu, done = 0.0, math.nan, 0.0, 0.0, 0
    times, seen = [0.0], [start + scene.initial_state()[0][:, :2]]
    while done < len(acceleration):
        chunk = acceleration[done : done + stride]
        wall_before, cpu_before = time.perf_counter(), time.process_time()
        stepper.advance(chunk)
        cpu += time.process_time() - cpu_before
        wall += time.perf_counter() - wall_before
        done += len(chunk)
        centroids = stepper.centroids()
        speed = float(np.hypot(*(centroids - seen[-1]).T).max()) / (len(chunk) * dt)
        if not speed <= MOST_SPEED:
            raise ArithmeticError(f"a centroid moves at {speed:.3g} m/s at {done * dt:g} s")
        times.append(done * dt)
        seen.append(centroids)
        moved = float(np.hypot(*(centroids - start).T).max())
        peak = max(peak, moved)
        if moved > limit and math.isnan(collapse_time):
            collapse_time = done * dt
        if stop_at_collapse and not math.isnan(collapse_time):
            break
    return Outcome(
        collapsed=not math.isnan(collapse_time),
        collapse_time=collapse_time,
        peak_displacement=peak,
        simulated_seconds=done * dt,
        steps=done,
        wall_seconds=wall,
        cpu_seconds=cpu,
        unconverged=stepper.unconverged,
        history={"time": times, "centroids": np.array(seen).tolist()} if history else None,
    )
