"""One case: an arch, a ground motion, an answer. Checks and user units live here."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.mechanics.collapse import NOTED_GAP
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import Frames, GroundMotion, MechanismLog, Options, Outcome
from archfrag.methods.registry import AUTO, OWN_STEP
from archfrag.motions.motion import Motion
from archfrag.simulation import checks, warm
from archfrag.simulation.history import empty_frames, history_of
from archfrag.simulation.mechanism import (
    LARGEST_ROOM,
    ROOM,
    MechanismChange,
    empty_log,
    mechanism_of,
)
from archfrag.simulation.response import Response, response_of
from archfrag.simulation.rest import Hinge, Onset, check_stands, onset

__all__ = [
    "Hinge", "MechanismChange", "Onset", "Response", "expected_compile_time",
    "kernels_are_compiled", "onset", "simulate", "warmup",
]  # fmt: skip

LOSS_LIMIT = 0.5
CHECK_INTERVAL = 64
# Frames of a history are as fine as the record, or this where the record is coarser [s].
COARSEST_FRAMES = 0.01
# Methods that also step over all voussoirs.
STEPS_TOO = ("auto", "event_driven")


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
    """Move one arch by one ground motion, until it rests or collapses.

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
        Relative error allowed by methods with step control: event_driven, and auto, which is
        the ladder of models built on it; the method's default if not given.
    dt : float, optional
        Time step [s]. The event-driven methods take it where they hand over to time stepping.
        If not given, auto, event_driven and time_stepping take a part of the arch's own time, the
        root of its shortest joint over gravity, that of auto by its tolerance: 0.5 ms for joints
        of 1.5 m; other methods take their own default.
    history : bool
        Whether to keep positions, velocities, reactions and contact modes over time, and the
        log of the mechanism.
    initial : (position, velocity), optional
        Each (n_voussoir, 3): displacement from rest [m, m, rad] and velocity relative to the
        ground [m/s, m/s, rad/s] at time 0. At rest if not given. Joints may be open; bodies that
        overlap by more than rounding are refused.
    follow : float
        How long to go on past the end of the motion while the arch still moves [s].
    settings : mapping of str to float, optional
        The method's own parameters that differ from their defaults in the registry, for example
        a joint stiffness; none for the methods that need none.
    loss_limit : float
        Gap at both corners of a joint, over its length, beyond which its contact cannot be
        regained, which ends the run as a collapse. So does a joint that has slid past its end or
        turned by 90 degrees, or one without contact where `follow` ends.

    Returns
    -------
    Response

    Raises
    ------
    InputError
        If an argument cannot be used; the sentence names it.
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
    checks.check_arch(arch)
    info = checks.check_method(method)
    if not isinstance(motion, Motion):
        raise InputError(f"motion is {type(motion).__name__}; it must be an archfrag Motion")
    checks.check_taken(info, rtol=rtol, dt=dt)
    tolerance = checks.default_of(info, "rtol") if rtol is None else rtol
    own_time = checks.own_time(arch)
    step = checks.default_step(info, tolerance, own_time) if dt is None else dt
    _check_numbers(scale, tolerance, follow, step, loss_limit)
    own = checks.check_settings(info, settings)
    position = np.zeros((arch.n_voussoir, 3))
    position[:, :2] = arch.chain.centroid
    velocity = np.zeros_like(position)
    if initial is None:
        check_stands(arch)
    else:
        shift, velocity = checks.check_initial(initial, arch)
        position += shift
    ground = _ground(motion, scale)
    span = (ground.horizontal.size - 1) * motion.dt + follow
    options = Options(
        time_step=float(step),
        tolerance=float(tolerance),
        accuracy=float(tolerance),
        follow=float(follow),
        max_steps=int(span / min(step, OWN_STEP * own_time)) + ground.horizontal.size + 1000,
        loss_limit=float(loss_limit),
        check_interval=CHECK_INTERVAL,
        frame_interval=max(float(step), min(float(motion.dt), COARSEST_FRAMES)),
        crowding=0.0,
    )
    n_frame = int(span / options.frame_interval) + 64 if history else 0
    started = time.perf_counter()
    outcome, frames, log = _run(
        arch, partial(info.load(), **own), ground, position, velocity, initial is None, options,
        n_frame,
    )  # fmt: skip
    wall_time = time.perf_counter() - started
    if not history:
        return response_of(outcome, info.name, wall_time, None, None)
    count = outcome.ledger.count
    return response_of(
        outcome,
        info.name,
        wall_time,
        mechanism_of(
            arch, log, int(count[Count.LOG_ENTRIES]), float(outcome.end_time), initial is None
        ),
        history_of(arch, frames, int(count[Count.FRAMES])),
    )


def warmup(method: str | None = None, progress: Callable[[str], object] | None = None) -> float:
    """Compile the kernels, or load them from the cache, once for this machine.

    Two processes share the work where there are two cores.

    Parameters
    ----------
    method : str, optional
        The one whose kernels are wanted; all methods that are installed if not given.
    progress : callable, optional
        Called with a message such as "loading kernels" or "compiling kernels, once: 12 s of
        about 150 s", at once and while it compiles about every second, from another thread.

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


def expected_compile_time(method: str | None = None) -> float:
    """How long `warmup` takes if it has to compile.

    Parameters
    ----------
    method : str, optional
        As for `warmup`.

    Returns
    -------
    float
        As long as the last time on this machine, or a usual time if there was none [s].

    Examples
    --------
    >>> from archfrag.simulate import expected_compile_time
    >>> expected_compile_time("auto") > 0.0
    True
    """
    return warm.expected_time(_methods_of(method))


def compile_beside(methods: Sequence[str]) -> None:
    """What the second process of a warm-up compiles: what the first needs late.

    Parameters
    ----------
    methods : sequence of str
        Those that the first process compiles, in its order.
    """
    warm.end_with_parent()
    check_stands(_smallest_arch())
    if len(methods) == 1:
        methods = ["time_stepping"] if methods[0] in STEPS_TOO else []
    for name in reversed(methods):
        _move_once(name)
    onset(_smallest_arch())


def _methods_of(method: str | None) -> tuple[str, ...]:
    return checks.available_methods() if method is None else (checks.check_method(method).name,)


def _smallest_arch() -> Arch:
    return Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)


def _move_once(method: str) -> None:
    arch = _smallest_arch()
    # With an initial state the kernels that see whether an arch stands are not needed first.
    at_rest = np.zeros((arch.n_voussoir, 3))
    simulate(arch, Motion(np.zeros(3), dt=0.01), method=method, initial=(at_rest, at_rest))


def _check_numbers(scale: float, rtol: float, follow: float, dt: float, loss_limit: float) -> None:
    check = checks.check_number
    check(
        "loss_limit",
        loss_limit,
        f"from {NOTED_GAP:g} to 10 times the joint's length",
        lambda x: NOTED_GAP <= x <= 10.0,
    )
    check("scale", scale, "finite", math.isfinite)
    check("rtol", rtol, "between 0 and 1", lambda x: 0.0 < x < 1.0)
    check("follow", follow, "finite and not negative [s]", lambda x: 0.0 <= x < math.inf)
    check("dt", dt, "finite and positive [s]", lambda x: 0.0 < x < math.inf)


def _ground(motion: Motion, scale: float) -> GroundMotion:
    horizontal = np.ascontiguousarray(motion.acceleration, float) * scale
    vertical = np.zeros_like(horizontal)
    if motion.vertical is not None:
        vertical = np.ascontiguousarray(motion.vertical, float) * scale
    return GroundMotion(horizontal, vertical, float(motion.dt))


def _run(
    arch: Arch,
    run: Callable[..., Outcome],
    ground: GroundMotion,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    n_frame: int,
) -> tuple[Outcome, Frames, MechanismLog]:
    """Run a method, again with more room while history or log do not fit; none for `n_frame` 0."""
    n_entry = ROOM if n_frame else 0
    while True:
        frames = empty_frames(n_frame, arch.n_voussoir, arch.n_joint)
        log = empty_log(n_entry, arch.n_joint)
        outcome = run(
            arch.chain, ground, position.copy(), velocity.copy(), from_rest, options, frames, log
        )
        count = outcome.ledger.count
        frames_fit = n_frame == 0 or count[Count.FRAMES] < n_frame
        log_fits = count[Count.LOG_ENTRIES] <= n_entry or n_entry in (0, LARGEST_ROOM)
        if frames_fit and log_fits:
            return outcome, frames, log
        if not frames_fit:
            n_frame *= 2
        if not log_fits:
            n_entry = min(int(count[Count.LOG_ENTRIES]), LARGEST_ROOM)
