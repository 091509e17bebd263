"""Our own solver, by the same contract as the others."""

import math
import time
from functools import cache
from typing import Any

import archfrag
from archbench.adapters.drive import Outcome
from archbench.scene import Scene
from archfrag.mechanics.status import Status
from archfrag.simulate import warmup

VERSION = f"archfrag {archfrag.__version__}"
SETTINGS: dict[str, Any] = {"method": "time_stepping", "rtol": None, "settings": {}}
_compile = cache(warmup)


def run(
    scene: Scene, dt: float, settings: dict[str, Any], *, history: bool = False, **_: Any
) -> Outcome:
    """Run a scene; it ends at rest, at collapse (loss of contact) or with the scene's duration."""
    _compile(settings["method"])
    own = {
        key: scene.chain[key] for key in ("density", "depth", "dead_load") if key in scene.chain
    }
    arch = archfrag.Arch.from_joints(
        *scene.joint_lines(), scene.friction, free_end=scene.free_end, **own
    )
    samples, step = scene.ground_acceleration()
    samples = samples[: round(scene.duration / step) + 1]
    options: dict[str, Any] = {"follow": max(0.0, scene.duration - step * (len(samples) - 1))}
    if scene.initial is not None or scene.motion["kind"] == "none":
        # An initial state lets an arch that cannot stand fall instead of being refused.
        options["initial"] = scene.initial_state()
    options |= {"dt": dt} if settings["rtol"] is None else {"rtol": settings["rtol"]}
    cpu = time.process_time()
    response = archfrag.simulate(
        arch,
        archfrag.Motion(samples, step),
        history=history,
        method=settings["method"],
        settings=settings["settings"],
        **options,
    )
    cpu = time.process_time() - cpu
    if response.collapsed is None and response.status is not Status.UNFINISHED:
        raise RuntimeError(f"status {response.status.name.lower()} at {response.end_time:g} s")
    kept = None
    if history and response.history is not None:
        moved = response.history["displacement"].to_numpy()
        kept = {
            "time": response.history["time"].to_numpy().tolist(),
            "centroids": (arch.chain.centroid + moved).tolist(),
        }
    return Outcome(
        collapsed=bool(response.collapsed),
        collapse_time=response.collapse_time if response.collapsed else math.nan,
        peak_displacement=response.peak_displacement,
        simulated_seconds=sum(response.model_time.values()) - response.model_time["rest"],
        steps=response.steps,
        wall_seconds=response.wall_time,
        cpu_seconds=cpu,
        unconverged=int(response.work.get("unconverged", 0)),
        history=kept,
    )
