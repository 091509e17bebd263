"""Our own solver, behind the same signature as the peers."""

import math
import time
from typing import Any

import numpy as np

import archfrag
from archfrag import Motion
from archfrag.evidence.peers.drive import Outcome
from archfrag.evidence.run import arch_of
from archfrag.evidence.scene import Scene
from archfrag.simulate import warmup

VERSION = f"archfrag {archfrag.__version__}"
SETTINGS: dict[str, Any] = {"method": "time_stepping"}
_COMPILED: list[float] = []


def run(
    scene: Scene, dt: float, settings: dict[str, Any], *, history: bool = False, **_: Any
) -> Outcome:
    """Run a scene; it ends at rest, at collapse (loss of contact) or with the scene's duration.

    The first call of a process compiles the kernels, and says so in `setup_seconds`; wall
    seconds are those of the integration alone, as for the peers.
    """
    if not _COMPILED:
        _COMPILED.append(warmup(settings.get("method")))
    began = time.perf_counter()
    arch = arch_of(scene)
    samples, step = scene.ground_acceleration()
    motion = Motion(samples, step)
    length = step * (len(samples) - 1)
    at_rest = np.zeros((arch.n_voussoir, 3))
    # An initial state lets an arch that cannot stand fall instead of being refused.
    initial = (at_rest, at_rest.copy()) if scene.motion["kind"] == "none" else None
    cpu_began = time.process_time()
    response = archfrag.simulate(
        arch,
        motion,
        dt=dt,
        history=history,
        initial=initial,
        follow=max(0.0, scene.duration - length),
        **settings,
    )
    cpu = time.process_time() - cpu_began
    whole = time.perf_counter() - began
    moving = sum(response.model_time.values()) - response.model_time["rest"]
    kept = None
    if history and response.history is not None:
        moved = response.history["displacement"].to_numpy()
        kept = {
            "time": response.history["time"].to_numpy().tolist(),
            "centroids": (arch.chain.centroid + moved).tolist(),
        }
    return Outcome(
        peer="archfrag",
        version=VERSION,
        settings=settings,
        scene=scene.name,
        amplitude=float(scene.motion.get("amplitude", 0.0)),
        dt=dt,
        collapsed=bool(response.collapsed),
        collapse_time=response.collapse_time if response.collapsed else math.nan,
        peak_displacement=response.peak_displacement,
        simulated_seconds=moving,
        steps=response.steps,
        wall_seconds=response.wall_time,
        cpu_seconds=cpu,
        setup_seconds=whole - response.wall_time,
        unconverged=int(response.collapsed is None),
        contacts=None,
        history=kept,
    )
