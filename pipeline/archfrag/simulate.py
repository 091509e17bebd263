"""Simulate arches under ground motions, and compile the kernels for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.mechanics.ground import Grounds, grounds_of
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import Frames, MechanismLog, Options, Results
from archfrag.methods.registry import AUTO
from archfrag.motions.motion import Motion
from archfrag.simulation import checks, warm
from archfrag.simulation.history import empty_frames, history_of
from archfrag.simulation.many import LOSS_LIMIT, at_rest, checked_call, simulate_runs
from archfrag.simulation.mechanism import (
    FIRST_LOG,
    LARGEST_LOG,
    MechanismChange,
    empty_log,
    mechanism_of,
)
from archfrag.simulation.response import Response, response_of
from archfrag.simulation.rest import Hinge, Onset, check_stands, onset

if TYPE_CHECKING:
    import xarray

__all__ = [
    "Hinge", "MechanismChange", "Onset", "Response", "kernels_are_compiled", "onset", "simulate",
    "simulate_many", "warmup",
]  # fmt: skip

# Fields of a response that a data set of many runs does not have.
_LEFT_OUT = {
    "events", "model_time", "energy", "work", "wall_time", "method", "mechanism", "history",
}  # fmt: skip
_UNITS = {
    "collapse_time": "s", "lost_contact_time": "s", "peak_rotation": "rad",
    "peak_displacement": "m", "residual_rotation": "rad",
    "residual_displacement": "m", "end_time": "s",
}  # fmt: skip


def simulate(
    arch: Arch,
    motion: Motion,
    scale: float = 1.0,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    history: bool = False,
    initial: tuple[ArrayLike, ArrayLike] | None = None,
    follow: float = 20.0,
    settings: Mapping[str, float] | None = None,
    loss_limit: float = LOSS_LIMIT,
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
        up to 4 ms between them for joints of 1.5 m at the default rtol. event_driven uses it
        when it switches to time stepping; other methods have their own default.
    history : bool
        Whether to keep positions, velocities, reactions and contact modes over time, and the
        log of the mechanism. auto takes the history of a short chain under a pulse by events.
    initial : (position, velocity), optional
        Each (n_voussoir, 3): displacement from rest [m, m, rad] and velocity relative to the
        ground [m/s, m/s, rad/s] at time 0. At rest if not given. Joints may be open, but bodies
        must not overlap by more than rounding.
    follow : float
        Longest time to simulate after the motion while the arch still moves [s].
    settings : mapping of str to float, optional
        Parameters of the method, if they differ from their defaults in the registry, for
        example a joint stiffness.
    loss_limit : float
        Gap at both corners of a joint, over its length, beyond which its contact cannot be
        regained: the run ends as a collapse. It also does if a joint has slid past its end or
        rotated by 90 degrees, or has no contact when `follow` ends.

    Returns
    -------
    Response

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
    info, own, options = checked_call(
        arch, [motion], [scale], method, rtol, dt, follow, settings, loss_limit
    )
    position, velocity = at_rest(arch)
    if initial is None:
        check_stands(arch)
    else:
        shift, velocity = checks.check_initial(initial, arch)
        position += shift
    grounds = grounds_of([(motion.acceleration, motion.vertical, motion.dt)])
    span = motion.duration + follow
    n_frame = int(span / options.frame_interval) + 64 if history else 0
    run, from_rest = partial(info.load(), **own), initial is None
    started = time.perf_counter()
    start = position, velocity, from_rest
    results, frames, log = _run(arch, run, (grounds, float(scale)), start, options, n_frame)
    wall_time = time.perf_counter() - started
    if not history:
        return response_of(results, 0, info.name, wall_time)
    count, end_time = results.count[0], float(results.end_time[0])
    changes = mechanism_of(arch, log, int(count[Count.LOG_ENTRIES]), end_time, from_rest)
    frames_written = history_of(arch, frames, int(count[Count.FRAMES]))
    return response_of(results, 0, info.name, wall_time, changes, frames_written)


def simulate_many(
    arch: Arch,
    motions: Motion | Sequence[Motion],
    factors: ArrayLike,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    follow: float = 20.0,
    settings: Mapping[str, float] | None = None,
    loss_limit: float = LOSS_LIMIT,
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
    method, rtol, dt, follow, settings, loss_limit
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
    responses = simulate_runs(
        arch, each, scales.tolist(), method=method, rtol=rtol, dt=dt, follow=follow,
        settings=settings, loss_limit=loss_limit,
    )  # fmt: skip
    names = [each.name for each in fields(Response) if each.name not in _LEFT_OUT]
    columns = {name: [getattr(each, name) for each in responses] for name in (*names, "steps")}
    columns["status"] = [response.status.name.lower() for response in responses]
    variables = {
        name: ("run", np.array(values), {"units": _UNITS.get(name, "1")})
        for name, values in columns.items()
    }
    return xarray.Dataset(variables, coords={"factor": ("run", scales)}, attrs={"method": method})


def warmup(method: str | None = None, progress: Callable[[str], object] | None = None) -> float:
    """Compile the kernels, or load them from the cache, once for this machine.

    Two processes divide the work where there are two cores.

    Parameters
    ----------
    method : str, optional
        Method to compile for; all installed methods if not given.
    progress : callable, optional
        Called with a message such as "loading kernels" or "compiling kernels, once: 12 s of
        about 80 s", first at once, then about every second from another thread.

    Returns
    -------
    float
        Seconds it took.

    Raises
    ------
    InputError
        If there is no such method.

    Examples
    --------
    >>> from archfrag.simulate import warmup
    >>> warmup("time_stepping") > 0.0
    True
    """
    started = time.perf_counter()
    names = _methods_of(method)
    with warm.compiling(names, progress):
        for name in names:
            _move_once(name)
        check_stands(_smallest_arch())
        onset(_smallest_arch())
    return time.perf_counter() - started


def kernels_are_compiled(method: str | None = None) -> bool:
    """Whether `warmup` has only to load kernels.

    Parameters
    ----------
    method : str, optional
        As for `warmup`.

    Examples
    --------
    >>> from archfrag.simulate import kernels_are_compiled, warmup
    >>> seconds = warmup("time_stepping")
    >>> kernels_are_compiled("time_stepping")
    True
    """
    return warm.are_compiled(_methods_of(method))


def compile_in_second_process(methods: Sequence[str]) -> None:
    """What the second process of a warm-up compiles: what the first, in its order, needs late."""
    warm.end_with_parent()
    check_stands(_smallest_arch())
    if len(methods) == 1:
        # One run alone, while the other process makes the kernels of four.
        simulate(_smallest_arch(), Motion(np.zeros(3), dt=0.01), method="time_stepping")
        methods = []
    for name in reversed(methods):
        _move_once(name)
    onset(_smallest_arch())


def _methods_of(method: str | None) -> tuple[str, ...]:
    return checks.method_names() if method is None else (checks.check_method(method).name,)


def _smallest_arch() -> Arch:
    return Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)


def _move_once(method: str) -> None:
    arch, motion = _smallest_arch(), Motion(np.zeros(3), dt=0.01)
    if checks.check_method(method).load_many is not None:
        # The kernels of events, which auto may need, are those of event_driven.
        simulate_many(arch, motion, [1.0], method=method)
        simulate(arch, motion, method=method)
        return
    # With an initial state the kernels that see whether an arch stands are not needed first.
    at_rest = np.zeros((arch.n_voussoir, 3))
    simulate(arch, motion, method=method, initial=(at_rest, at_rest))


def _run(
    arch: Arch,
    run: Callable[..., Results],
    moved_by: tuple[Grounds, float],
    start: tuple[np.ndarray, np.ndarray, bool],
    options: Options,
    n_frame: int,
) -> tuple[Results, Frames, MechanismLog]:
    """Run a method, again with more space while history or log do not fit; none if `n_frame` 0."""
    n_entry = FIRST_LOG if n_frame else 0
    while True:
        frames = empty_frames(n_frame, arch.n_voussoir, arch.n_joint)
        log = empty_log(n_entry, arch.n_joint)
        position, velocity, from_rest = start[0].copy(), start[1].copy(), start[2]
        results = run(
            arch.chain, *moved_by, position, velocity, from_rest, options, frames, log
        )
        count = results.count[0]
        frames_fit = n_frame == 0 or count[Count.FRAMES] < n_frame
        log_fits = count[Count.LOG_ENTRIES] <= n_entry or n_entry in (0, LARGEST_LOG)
        if frames_fit and log_fits:
            return results, frames, log
        if not frames_fit:
            n_frame *= 2
        if not log_fits:
            n_entry = min(int(count[Count.LOG_ENTRIES]), LARGEST_LOG)
