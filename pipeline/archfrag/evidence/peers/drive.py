"""One driver for all peers: steps, clocks and judges them alike."""

import time
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from archfrag.evidence.scene import Scene

Array = NDArray[np.float64]


class Stepper(Protocol):
    """What an adapter builds of a scene: one peer, ready to step."""

    version: str

    @property
    def unconverged(self) -> int | None:
        """Steps that the peer's solver left unconverged; None if it does not tell."""

    @property
    def contacts(self) -> int | None:
        """Contact points at the last step; None if the peer does not tell."""

    def advance(self, ground_acceleration: Array) -> None:
        """Take as many steps as there are values [m/s2], each with its value held."""

    def centroids(self) -> Array:
        """Centroids of the voussoirs in the ground's frame, (n, 2) [m]."""


@dataclass
class Outcome:
    """What a run gave, by measures that are the same for every peer.

    Attributes
    ----------
    collapsed : bool
        Whether a centroid has moved more than two thicknesses; `collapse_time` [s] is when this
        was first seen, to the sampling interval, or nan.
    peak_displacement : float
        Largest displacement of a centroid from its place in the scene [m].
    wall_seconds, cpu_seconds : float
        Of stepping alone.
    setup_seconds : float
        Of building the model and, for compiled kernels, compiling it.
    unconverged : int or None
        Steps whose contact problem was left unconverged; None if the peer does not tell.
    history : dict or None
        `time` [s] and `centroids` (time, voussoir, xy) [m], as lists.
    """

    peer: str
    version: str
    settings: dict[str, Any]
    scene: str
    amplitude: float
    dt: float
    collapsed: bool
    collapse_time: float
    peak_displacement: float
    simulated_seconds: float
    steps: int
    wall_seconds: float
    cpu_seconds: float
    setup_seconds: float
    unconverged: int | None
    contacts: int | None
    history: dict[str, Any] | None = field(default=None, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """As plain types for JSON."""
        return asdict(self)


def drive(
    peer: str,
    stepper: Stepper,
    scene: Scene,
    dt: float,
    settings: dict[str, Any],
    setup_seconds: float,
    *,
    sampling: float = 0.01,
    history: bool = False,
    stop_at_collapse: bool = True,
) -> Outcome:
    """Run a built scene to its end, or to its collapse.

    Parameters
    ----------
    peer : str
        Name to be shown.
    stepper : Stepper
    scene : Scene
    dt : float
        Step [s].
    settings : dict
        Of the adapter, for the record.
    setup_seconds : float
        What building took.
    sampling : float
        Interval at which the centroids are looked at [s].
    history : bool
        Keep what was seen.
    stop_at_collapse : bool
        Stop when collapse is seen.

    Returns
    -------
    Outcome
    """
    start = scene.bodies().centroid
    limit = 2.0 * scene.thickness
    acceleration = scene.step_means(dt)
    stride = max(1, round(sampling / dt))
    peak, collapse_time, wall, cpu, done = 0.0, float("nan"), 0.0, 0.0, 0
    times, seen = [0.0], [start]
    while done < len(acceleration):
        chunk = acceleration[done : done + stride]
        wall_before, cpu_before = time.perf_counter(), time.process_time()
        stepper.advance(chunk)
        cpu += time.process_time() - cpu_before
        wall += time.perf_counter() - wall_before
        done += len(chunk)
        centroids = stepper.centroids()
        moved = float(np.hypot(*(centroids - start).T).max())
        if history:
            times.append(done * dt)
            seen.append(centroids)
        if not moved <= limit:
            collapse_time = done * dt
        peak = max(peak, moved)
        if stop_at_collapse and collapse_time == collapse_time:
            break
    return Outcome(
        peer=peer,
        version=stepper.version,
        settings=settings,
        scene=scene.name,
        amplitude=float(scene.motion.get("amplitude", 0.0)),
        dt=dt,
        collapsed=collapse_time == collapse_time,
        collapse_time=collapse_time,
        peak_displacement=peak,
        simulated_seconds=done * dt,
        steps=done,
        wall_seconds=wall,
        cpu_seconds=cpu,
        setup_seconds=setup_seconds,
        unconverged=stepper.unconverged,
        contacts=stepper.contacts,
        history={"time": times, "centroids": np.array(seen).tolist()} if history else None,
    )
