"""Simulate arches under ground motions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.mechanics.collapse import NOTED_GAP
from archfrag.mechanics.ground import Grounds, grounds_of, one_of
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import Frames, MechanismLog, Options, Results
from archfrag.methods.registry import AUTO, OWN_STEP, MethodInfo
from archfrag.motions.motion import Motion
from archfrag.simulation import checks
from archfrag.simulation.response import (
    FIRST_LOG,
    LARGEST_LOG,
    MechanismChange,
    Response,
    empty_output,
    history_of,
    mechanism_of,
    response_of,
)
from archfrag.simulation.rest import (
    Hinge,
    Onset,
    at_rest,
    check_initial,
    check_stands,
    onset,
    own_time,
)

if TYPE_CHECKING:
    import xarray

__all__ = [
    "Hinge", "MechanismChange", "Onset", "Response", "onset", "simulate", "simulate_many",
]  # fmt: skip

LOSS_LIMIT = 0.5
CHECK_INTERVAL = 64
# Frames of a history are as fine as the record, or this where the record is coarser [s].
COARSEST_FRAMES = 0.01
# Fields of a response that a data set of many runs does not have.
_LEFT_OUT = {
    "events", "model_time", "energy", "work", "wall_time", "method", "mechanism", "history",
}  # fmt: skip
_UNITS = {
    "collapse_time": "s", "lost_contact_time": "s", "peak_rotation": "rad",
    "peak_displacement": "m", "residual_rotation": "rad",
    "residual_displacement": "m", "end_time": "s",
}  # fmt: skip


class MoreOptions(TypedDict, total=False):
    """What runs take that is seldom given; `simulate` documents it."""

    follow: float
    settings: Mapping[str, float] | None
    loss_limit: float


def simulate(
    arch: Arch,
    motion: Motion,
    scale: float = 1.0,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    history: bool = False,
    initial: tuple[ArrayLike, ArrayLike] | None = None,
    **more: Unpack[MoreOptions],
) -> Response:
    """Simulate one arch under one ground motion, until it rests or collapses.

    Parameters
    ----------
    arch : Arch
    motion : Motion
        Ground acceleration [m/s2].
    scale : float
        Factor on the motion, vertical component included.
    method : str
        "auto" or a name in `archfrag.methods.registry.METHODS`.
    rtol : float, optional
        Relative error allowed by methods with step control: auto, time_stepping, event_driven.
        The method's default if not given.
    dt : float, optional
        Fixed time step [s]. If not given, the steps of auto and time_stepping follow from rtol and
        the arch's own time, the root of its shortest joint over gravity: 0.4 ms at impacts and
        up to 4 ms between them for joints of 1.5 m at the default rtol, 1.6 and 8 ms for more
        than 20 voussoirs. event_driven uses it
        when it switches to time stepping; other methods have their own default.
    history : bool
        Whether to keep positions, velocities, reactions and contact modes over time, and the
        log of the mechanism. auto takes the history of a short chain under a pulse by events.
    initial : (position, velocity), optional
        Each (n_voussoir, 3): displacement from rest [m, m, rad] and velocity relative to the
        ground [m/s, m/s, rad/s] at time 0. At rest if not given. Joints may be open, but bodies
        must not overlap by more than rounding.

    Returns
    -------
    Response

    Other Parameters
    ----------------
    follow : float
        Longest time to simulate after the motion while the arch still moves [s].
    settings : mapping of str to float, optional
        Parameters of the method, if they differ from their defaults in the registry, for
        example a joint stiffness.
    loss_limit : float
        Gap at both corners of a joint, over its length, beyond which its contact cannot be
        regained: the run ends as a collapse. It also does if a joint has slid past its end or
        rotated by 90 degrees, or has no contact when `follow` ends.

    Raises
    ------
    InputError
        If an argument cannot be used; the message names it.
    StabilityError
        If the arch does not stand under its own weight and no initial state is given.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> pulse = np.where(np.arange(0.0, 1.0, 0.001) < 0.3, 1.0, 0.0)
    >>> response = af.simulate(arch, af.Motion(pulse, dt=0.001), scale=5.0)
    >>> response.collapsed, response.collapse_mode
    (False, 'none')
    """
    info, own, options = _checked_call(arch, [motion], [scale], method, rtol, dt, **more)
    position, velocity = at_rest(arch)
    if initial is None:
        check_stands(arch)
    else:
        shift, velocity = check_initial(initial, arch)
        position += shift
    ground = grounds_of([(motion.acceleration, motion.vertical, motion.dt)])
    span = motion.duration + options.follow
    n_frame = int(span / options.frame_interval) + 64 if history else 0
    run, start = partial(info.load(), **own), (position, velocity, initial is None)
    started = time.perf_counter()
    results, frames, log = _run(arch, run, (ground, float(scale)), start, options, n_frame)
    wall_time = time.perf_counter() - started
    if not history:
        return response_of(results, 0, info.name, wall_time)
    count, end_time = results.count[0], float(results.end_time[0])
    changes = mechanism_of(arch, log, int(count[Count.LOG_ENTRIES]), end_time, initial is None)
    frames_written = history_of(arch, frames, int(count[Count.FRAMES]))
    return response_of(results, 0, info.name, wall_time, changes, frames_written)


def _run(
    arch: Arch,
    run: Callable[..., Results],
    moved_by: tuple[Grounds, float],
    start: tuple[np.ndarray, np.ndarray, bool],
    options: Options,
    n_frame: int = 0,
) -> tuple[Results, Frames, MechanismLog]:
    """Run a method, again with more space while history or log do not fit; none if `n_frame` 0."""
    n_entry = FIRST_LOG if n_frame else 0
    position, velocity, from_rest = start
    while True:
        output = empty_output(n_frame, n_entry, arch.n_voussoir, arch.n_joint)
        moving = position.copy(), velocity.copy(), from_rest
        results = run(arch.chain, *moved_by, *moving, options, *output)
        n_written, n_changed = results.count[0, [Count.FRAMES, Count.LOG_ENTRIES]].astype(int)
        frames_fit = n_frame == 0 or n_written < n_frame
        log_fits = n_changed <= n_entry or n_entry in (0, LARGEST_LOG)
        if frames_fit and log_fits:
            return results, *output
        if not frames_fit:
            n_frame *= 2
        if not log_fits:
            n_entry = min(n_changed, LARGEST_LOG)


def _checked_call(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], method: str = AUTO,
    rtol: float | None = None, dt: float | None = None, follow: float = 20.0,
    settings: Mapping[str, float] | None = None, loss_limit: float = LOSS_LIMIT,
) -> tuple[MethodInfo, dict[str, float], Options]:  # fmt: skip
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
    own, unit = checks.check_settings(info, settings), own_time(arch)
    if dt is not None or info.step_rule is None:
        step = largest_step = checks.default_of(info, "dt") if dt is None else float(dt)
    else:
        rule = info.step_rule(float(tolerance), arch.n_voussoir)
        step, largest_step = unit * rule[0], unit * rule[1]
    span = max(motion.duration for motion in motions) + follow
    samples = max(len(motion.acceleration) for motion in motions)
    sampling = min(float(motion.dt) for motion in motions)
    options = Options(
        time_step=float(step),
        tolerance=float(tolerance),
        accuracy=float(tolerance),
        follow=float(follow),
        max_steps=int(span / min(step, OWN_STEP * unit)) + samples + 1000,
        loss_limit=float(loss_limit),
        check_interval=CHECK_INTERVAL,
        frame_interval=max(float(step), min(sampling, COARSEST_FRAMES)),
        crowding=0.0,
        largest_step=float(largest_step),
    )
    return info, own, options


def results_of_runs(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], **given: Any
) -> tuple[Results, np.ndarray]:
    """As `simulate_many`: what the kernels leave, a row for each run, and wall times [s]."""
    info, own, options = _checked_call(arch, motions, factors, **given)
    check_stands(arch)
    unique = list({id(motion): motion for motion in motions}.values())
    number = {id(motion): k for k, motion in enumerate(unique)}
    motion = np.array([number[id(each)] for each in motions], int)
    grounds = grounds_of([(each.acceleration, each.vertical, each.dt) for each in unique])
    factor = np.array(factors, float)
    started = time.perf_counter()
    if info.load_many is not None:
        results = info.load_many()(arch.chain, grounds, motion, factor, options, **own)
    else:
        run, start = partial(info.load(), **own), (*at_rest(arch), True)
        moved_by = [(one_of(grounds, k, 1.0), by) for k, by in zip(motion, factor)]
        rows = [_run(arch, run, each, start, options)[0] for each in moved_by]
        results = Results(*map(np.concatenate, zip(*rows)))
    spent = time.perf_counter() - started
    # The calls of several runs are timed together.
    work = 1.0 + results.count[:, Count.STEPS]
    return results, spent * work / work.sum()


def simulate_runs(
    arch: Arch, motions: Sequence[Motion], factors: Sequence[float], method: str, **given: Any
) -> list[Response]:
    """As `simulate_many`, a response for each run."""
    results, wall_time = results_of_runs(arch, motions, factors, method=method, **given)
    return [response_of(results, row, method, each) for row, each in enumerate(wall_time.tolist())]


def simulate_many(
    arch: Arch,
    motions: Motion | Sequence[Motion],
    factors: ArrayLike,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    **more: Unpack[MoreOptions],
) -> xarray.Dataset:
    """Simulate one arch under many scaled ground motions, four runs at a time.

    Each run has the same results, to the last bit, as `simulate` without a history.

    Parameters
    ----------
    arch : Arch
    motions : Motion or sequence of Motion
        One for each run, or one for all.
    factors : array_like, (n_run,)
        On the motions, vertical components included.
    method, rtol, dt, **more
        As for `archfrag.simulate.simulate`.

    Returns
    -------
    xarray.Dataset
        Dimension run; the numbers of a `Response` for each, and the factors.

    Raises
    ------
    InputError
        If an argument cannot be used; the message names it.
    StabilityError
        If the arch does not stand under its own weight.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> pulse = np.where(np.arange(0.0, 1.0, 0.001) < 0.3, 1.0, 0.0)
    >>> runs = af.simulate_many(arch, af.Motion(pulse, dt=0.001), [3.0, 5.0, 20.0])
    >>> runs.collapsed.values.tolist()
    [False, False, True]
    """
    import xarray

    scales = np.atleast_1d(np.asarray(factors, float))
    each = [motions] * scales.size if isinstance(motions, Motion) else list(motions)
    if scales.ndim != 1 or len(each) != scales.size:
        raise InputError(
            f"motions are {len(each)} and factors have shape {scales.shape}; there must be one "
            "motion for each factor, or one for all"
        )
    responses = simulate_runs(arch, each, scales.tolist(), method, rtol=rtol, dt=dt, **more)
    names = [each.name for each in fields(Response) if each.name not in _LEFT_OUT]
    columns = {name: [getattr(each, name) for each in responses] for name in (*names, "steps")}
    columns["status"] = [response.status.name.lower() for response in responses]
    variables = {
        name: ("run", np.array(values), {"units": _UNITS.get(name, "1")})
        for name, values in columns.items()
    }
    return xarray.Dataset(variables, coords={"factor": ("run", scales)}, attrs={"method": method})
