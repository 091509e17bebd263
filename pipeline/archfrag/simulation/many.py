"""Many runs of one arch in one call, and the checks that single runs share with them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.mechanics.collapse import NOTED_GAP
from archfrag.mechanics.ground import Grounds, grounds_of, one_of
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import Chain, Options, Results
from archfrag.methods.registry import AUTO, OWN_STEP, MethodInfo
from archfrag.motions.motion import Motion
from archfrag.simulation import checks
from archfrag.simulation.history import empty_frames
from archfrag.simulation.mechanism import empty_log
from archfrag.simulation.response import Response, response_of
from archfrag.simulation.rest import check_stands

LOSS_LIMIT = 0.5
CHECK_INTERVAL = 64
# Frames of a history are as fine as the record, or this where the record is coarser [s].
COARSEST_FRAMES = 0.01


def checked_call(
    arch: Arch,
    motions: Sequence[Motion],
    factors: Sequence[float],
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    follow: float = 20.0,
    settings: Mapping[str, float] | None = None,
    loss_limit: float = LOSS_LIMIT,
) -> tuple[MethodInfo, dict[str, float], Options]:
    """Check a call and return the method, its own settings and its options."""
    if not isinstance(arch, Arch):
        raise InputError(f"arch is {type(arch).__name__}; it must be an archfrag Arch or Block")
    info = checks.check_method(method)
    for motion in motions:
        if not isinstance(motion, Motion):
            raise InputError(f"motion is {type(motion).__name__}; it must be an archfrag Motion")
    checks.check_taken(info, rtol=rtol, dt=dt)
    tolerance = checks.default_of(info, "rtol") if rtol is None else rtol
    check, lengths = checks.check_number, f"from {NOTED_GAP:g} to 10 times the joint's length"
    check("loss_limit", loss_limit, lengths, lambda x: NOTED_GAP <= x <= 10.0)
    for factor in factors:
        check("scale", factor, "finite", math.isfinite)
    check("rtol", tolerance, "between 0 and 1", lambda x: 0.0 < x < 1.0)
    check("follow", follow, "finite and not negative [s]", lambda x: 0.0 <= x < math.inf)
    if dt is not None:
        check("dt", dt, "finite and positive [s]", lambda x: 0.0 < x < math.inf)
    own = checks.check_settings(info, settings)
    steps = checks.default_steps(info, tolerance, arch) if dt is None else (dt, dt)
    span = max(motion.duration for motion in motions) + follow
    samples = max(len(motion.acceleration) for motion in motions)
    sampling = min(float(motion.dt) for motion in motions)
    options = Options(
        time_step=float(steps[0]),
        tolerance=float(tolerance),
        accuracy=float(tolerance),
        follow=float(follow),
        max_steps=int(span / min(steps[0], OWN_STEP * checks.own_time(arch))) + samples + 1000,
        loss_limit=float(loss_limit),
        check_interval=CHECK_INTERVAL,
        frame_interval=max(float(steps[0]), min(sampling, COARSEST_FRAMES)),
        crowding=0.0,
        largest_step=float(steps[1]),
    )
    return info, own, options


class Runs(NamedTuple):
    """Many runs of one arch as the kernels leave them: a row each."""

    results: Results
    wall_time: np.ndarray  # (n_run,) [s]
    method: str


def results_of_runs(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], **given: Any
) -> Runs:
    """As `simulate_many`, in arrays."""
    info, own, options = checked_call(arch, motions, factors, **given)
    check_stands(arch)
    unique = list({id(motion): motion for motion in motions}.values())
    number = {id(motion): k for k, motion in enumerate(unique)}
    motion = np.array([number[id(each)] for each in motions], int)
    grounds = grounds_of([(each.acceleration, each.vertical, each.dt) for each in unique])
    run_many = _one_by_one(info.load()) if info.load_many is None else info.load_many()
    started = time.perf_counter()
    results = run_many(
        arch.chain, grounds, motion, np.array(factors, float), options, **own
    )
    spent = time.perf_counter() - started
    # The calls of several runs are timed together.
    work = 1.0 + results.count[:, Count.STEPS]
    return Runs(results, spent * work / work.sum(), info.name)


def _one_by_one(run: Callable[..., Results]) -> Callable[..., Results]:
    def run_many(
        chain: Chain, grounds: Grounds, motion: np.ndarray, factor: np.ndarray, options: Options,
        **own: float,
    ) -> Results:  # fmt: skip
        still = np.column_stack([chain.centroid, np.zeros(chain.mass.size)])
        n_joint = chain.friction.size
        output = empty_frames(0, chain.mass.size, n_joint), empty_log(0, n_joint)
        rows = [
            run(
                chain, one_of(grounds, number, 1.0), by, still.copy(), 0.0 * still, True, options,
                *output, **own,
            )
            for number, by in zip(motion, factor)
        ]
        return Results(*map(np.concatenate, zip(*rows)))

    return run_many


def at_rest(arch: Arch) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity in which an arch was built, each (n_voussoir, 3)."""
    position = np.zeros((arch.n_voussoir, 3))
    position[:, :2] = arch.chain.centroid
    return position, np.zeros_like(position)


def simulate_runs(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], **options: Any
) -> list[Response]:
    """As `simulate_many`, a response for each run."""
    results, wall_time, method = results_of_runs(arch, motions, factors, **options)
    return [
        response_of(results, row, method, seconds)
        for row, seconds in enumerate(wall_time.tolist())
    ]
