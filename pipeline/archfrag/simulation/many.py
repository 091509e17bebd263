"""Many runs of one arch in one call, and what single runs have in common with them."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.mechanics.collapse import NOTED_GAP
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import GroundMotion, Options
from archfrag.methods.registry import AUTO, OWN_STEP, MethodInfo
from archfrag.motions.motion import Motion
from archfrag.simulation import checks
from archfrag.simulation.history import empty_frames
from archfrag.simulation.mechanism import empty_log
from archfrag.simulation.response import Response, response_of
from archfrag.simulation.rest import check_stands

if TYPE_CHECKING:
    from archfrag.methods.time_stepping.service import Results

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
    """What runs of one arch have in common, checked: method, its own settings, options."""
    checks.check_arch(arch)
    info = checks.check_method(method)
    for motion in motions:
        if not isinstance(motion, Motion):
            raise InputError(f"motion is {type(motion).__name__}; it must be an archfrag Motion")
    checks.check_taken(info, rtol=rtol, dt=dt)
    tolerance = checks.default_of(info, "rtol") if rtol is None else rtol
    check = checks.check_number
    lengths = f"from {NOTED_GAP:g} to 10 times the joint's length"
    check("loss_limit", loss_limit, lengths, lambda x: NOTED_GAP <= x <= 10.0)
    for factor in factors:
        check("scale", factor, "finite", math.isfinite)
    check("rtol", tolerance, "between 0 and 1", lambda x: 0.0 < x < 1.0)
    check("follow", follow, "finite and not negative [s]", lambda x: 0.0 <= x < math.inf)
    if dt is not None:
        check("dt", dt, "finite and positive [s]", lambda x: 0.0 < x < math.inf)
    own = checks.check_settings(info, settings)
    steps = checks.default_steps(info, tolerance, arch) if dt is None else (dt, dt)
    sampling = min(float(motion.dt) for motion in motions)
    span = max(motion.duration for motion in motions) + follow
    samples = max(len(motion.acceleration) for motion in motions)
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


def ground_of(motion: Motion, scale: float, info: MethodInfo) -> GroundMotion:
    """A ground motion, scaled already for methods that do not scale it themselves."""
    factor = 1.0 if info.load_many is None else float(scale)
    given = float(scale) if info.load_many is None else 1.0
    horizontal = np.ascontiguousarray(motion.acceleration, float)
    # Pages of zeros that are only read take no memory.
    vertical = np.zeros(horizontal.shape)
    if motion.vertical is not None:
        vertical = np.ascontiguousarray(motion.vertical, float)
    if given != 1.0:
        horizontal = given * horizontal
        vertical = vertical if motion.vertical is None else given * vertical
    return GroundMotion(horizontal, vertical, float(motion.dt), factor)


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
    if info.load_many is None:
        return _one_by_one(arch, motions, factors, **given)
    unique = list({id(motion): motion for motion in motions}.values())
    number = {id(motion): k for k, motion in enumerate(unique)}
    grounds = [ground_of(motion, 1.0, info) for motion in unique]
    started = time.perf_counter()
    results = info.load_many()(
        arch.chain,
        grounds,
        np.array([number[id(motion)] for motion in motions]),
        np.array(factors, float),
        options,
        **own,
    )
    spent = time.perf_counter() - started
    # The calls of several runs are timed together.
    work = 1.0 + results.count[:, Count.STEPS]
    return Runs(results, spent * work / work.sum(), info.name)


def _one_by_one(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], **given: Any
) -> Runs:
    from archfrag.methods.time_stepping.service import new_results

    results, wall_time = new_results(len(factors)), np.empty(len(factors))
    for row, (motion, factor) in enumerate(zip(motions, factors)):
        info, own, options = checked_call(arch, [motion], [factor], **given)
        ground, run = ground_of(motion, factor, info), info.load()
        output = empty_frames(0, arch.n_voussoir, arch.n_joint), empty_log(0, arch.n_joint)
        started = time.perf_counter()
        outcome = run(arch.chain, ground, *at_rest(arch), True, options, *output, **own)
        wall_time[row] = time.perf_counter() - started
        known = outcome._asdict() | outcome.diagnostics._asdict()
        for name in results._fields:
            getattr(results, name)[row] = known[name]
    return Runs(results, wall_time, info.name)


def at_rest(arch: Arch) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity in which an arch was built, each (n_voussoir, 3)."""
    position = np.zeros((arch.n_voussoir, 3))
    position[:, :2] = arch.chain.centroid
    return position, np.zeros_like(position)


def simulate_runs(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], **options: Any
) -> list[Response]:
    """As `simulate_many`, a response for each run."""
    from archfrag.methods.time_stepping.front import outcome_of

    results, wall_time, method = results_of_runs(arch, motions, factors, **options)
    return [
        response_of(outcome_of(results, row), method, seconds, None, None)
        for row, seconds in enumerate(wall_time.tolist())
    ]
