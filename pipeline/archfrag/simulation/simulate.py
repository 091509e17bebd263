"""Simulate arches under ground motions."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.errors import ArchfragError, InputError, UnitWarning
from archfrag.files import Named
from archfrag.motions.motion import Motion
from archfrag.physics.collapse import NOTED_GAP
from archfrag.physics.ground import Grounds, grounds_of
from archfrag.physics.interface import Options, Outcomes
from archfrag.physics.methods.registry import AUTO, FACE_STEP, OWN_STEP, MethodInfo
from archfrag.physics.state import model_of
from archfrag.physics.status import Count
from archfrag.physics.steps.face_rest import damping_of_steps, longest_step
from archfrag.physics.steps.run import PLACES, lanes_for
from archfrag.simulation import arguments
from archfrag.simulation.arguments import LOSS_LIMIT
from archfrag.simulation.response import (
    STATUS_MESSAGE,
    UNITS,
    Response,
    empty_output,
    history_of,
    mechanism_of,
    response_of,
)
from archfrag.simulation.rest import (
    Onset,
    at_rest,
    check_initial,
    onset,
    own_time,
    warn_if_in_g,
)
from archfrag.simulation.springings import Bases, ground_of
from archfrag.simulation.standing import check_stands

if TYPE_CHECKING:
    import xarray

__all__ = ["Onset", "Response", "limit_load", "onset", "simulate", "simulate_many"]

# The ramp of a limit load. RAMP: its duration over the root of (shortest joint over gravity).
# BEYOND_BOUND: the load at its end over the bound of the static theorem. MOVED: the displacement,
# over the shortest joint, from which on the arch moves.
RAMP = 200.0
BEYOND_BOUND = 1.02
MOVED = 1e-6
# Used as the bound of chains that no load moves by the static theorem [g].
LARGEST_LOAD = 2.0
CHECK_INTERVAL = 64
LARGEST_LOG = 50_000  # changes of the mechanism that are kept with a history
# Frames of a history are as fine as the record, or this where the record is coarser [s].
COARSEST_FRAMES = 0.01
# Fields of a response that a data set of many runs does not have.
_LEFT_OUT = {
    "events",
    "model_time",
    "energy",
    "work",
    "wall_time",
    "method",
    "mechanism",
    "history",
    "arch",
    "motion",
    "scale",
}


def simulate(
    arch: Arch,
    motion: Motion,
    scale: float = 1.0,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    history: bool = False,
    initial: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    wave_speed: float | None = None,
    bases: Bases | None = None,
    follow: float = 20.0,
    loss_limit: float = LOSS_LIMIT,
    rests: bool = True,
) -> Response:
    """Simulate one arch under one ground motion, until it rests or collapses.

    Parameters
    ----------
    arch, motion : Arch, Motion
    scale : float
        Factor on all motions, vertical components included.
    method : str
        "auto" or a name in `archfrag.physics.methods.registry.METHODS`.
    rtol : float, optional
        Relative error allowed by methods with step control; their default if not given.
    dt : float, optional
        Fixed time step [s]; if not given, steps follow from rtol and the shortest joint.
    history : bool
        Whether to keep motion, reactions, contact modes and the log of the mechanism.
    initial : (position, velocity), optional
        Each (n_voussoir, 3): displacement from rest [m, m, rad] and velocity relative to the
        ground [m/s, m/s, rad/s] at time 0, without overlaps; at rest if not given.
    wave_speed : float, optional
        Of a wave along the arch [m/s], to the left if negative: bases move as the left one, later.
    bases : mapping, optional
        From "pier 1" etc. or "right" to a motion of the same dt, or a delay behind "left" [s].
    follow : float
        Longest time to simulate after the motion while the arch still moves [s].
    loss_limit : float
        Gap at both corners of a joint, over its length, that ends the run as a collapse. So does
        a joint that slid past its end, rotated by 90 degrees, or has no contact after `follow`.
    rests : bool
        Whether an arch rests wherever admissible reactions exist. If not, it is integrated all the
        time, by "auto" from event to event, and stands if its contacts hold it until the end.

    Raises
    ------
    InputError, StabilityError
        If an argument cannot be used, or the arch does not stand and no initial state is given.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> pulse = np.where(np.arange(0.0, 1.0, 0.001) < 0.3, 1.0, 0.0)
    >>> response = af.simulate(arch, af.Motion(pulse, dt=0.001), scale=5.0)
    >>> response.collapsed, response.collapse_mode
    (False, 'none')
    """
    info, options = _checked_call(
        arch, [motion], [scale], wave_speed, bases, method, rtol, dt, follow, loss_limit
    )
    arguments.check_compiled(plain=info.name == "time_stepping")
    options = options._replace(rests=rests)
    position, velocity = at_rest(arch)
    if initial is None:
        warn_if_in_g(motion, scale, check_stands(arch))
    else:
        arguments.check_rigid(arch, "initial")
        shift, velocity = check_initial(initial, arch)
        position += shift
    ground, (motion,) = _grounds([motion], arch, wave_speed, bases)
    n_frame = (
        int((motion.duration + follow) / options.frame_interval) + 64 if history else 0
    )
    n_entry = LARGEST_LOG if history else 0
    start = (position, velocity)
    run: Any = info.load()
    started = time.perf_counter()
    while True:
        frames, log = output = empty_output(
            n_frame, n_entry, arch.n_voussoir, arch.n_joint
        )
        moving = (*(part.copy() for part in start), initial is None)
        results = run(arch.chain, ground, float(scale), *moving, options, *output)
        count = results.count[0]
        if not history or count[Count.FRAMES] < n_frame:
            break
        n_frame *= 2
    response = response_of(results, 0, info.name, time.perf_counter() - started)
    response = replace(response, arch=arch, motion=motion, scale=float(scale))
    if not history:
        return response
    n_change = int(count[Count.LOG_ENTRIES])
    end_time = float(results.end_time[0])
    changes = mechanism_of(arch, log, n_change, end_time, from_rest=initial is None)
    kept = history_of(arch, frames, int(count[Count.FRAMES]))
    return replace(response, mechanism=changes, history=kept)


def limit_load(arch: Arch, towards: str = "+x", method: str = "time_stepping") -> float:
    """Find the slowly growing ground acceleration at which an arch starts to move [g].

    Where joints slide, Coulomb's law is not associated: the load at which reactions that follow
    the ramp leave Coulomb's cones can lie below the limit of the static theorem (`onset`), which
    is only an upper bound. The load grows from zero to beyond that bound. The arch starts to move
    when a voussoir is displaced by a millionth of the shortest joint. A chain whose joints lock
    each other has no such bound; its load grows to 2 g.

    Parameters
    ----------
    arch : Arch
    towards : str
        The ground accelerates towards "+x" or "-x".
    method : str
        As for `simulate`.

    Raises
    ------
    InputError, StabilityError
        If no load moves the arch, or it does not stand under its own weight.
    ArchfragError
        If the method does not move it at a load beyond the bound.

    Examples
    --------
    >>> import archfrag as af
    >>> block = af.Block(width=0.4, height=1.0, friction=0.3)
    >>> round(af.limit_load(block), 3)
    0.3
    """
    arguments.check_rigid(arch, "limit_load")
    bound, _, _ = check_stands(arch).mechanism(towards)
    locks = math.isinf(bound)
    bound = LARGEST_LOAD if locks else bound
    length = model_of(arch.chain).length.min()
    unit = math.sqrt(length / arch.chain.gravity)
    time = np.linspace(0.0, RAMP * unit, 2001)
    most = BEYOND_BOUND * bound * STANDARD_GRAVITY
    sense = 1.0 if towards == "+x" else -1.0
    ramp = Motion(sense * most * time / time[-1], time[1])
    run = simulate(arch, ramp, method=method, history=True, follow=0.0, rests=False)
    history: Any = run.history
    shifts = np.abs(history.displacement.values).max(axis=(1, 2))
    moved = shifts > MOVED * length
    if not moved.any():
        load = BEYOND_BOUND * bound * run.end_time / ramp.duration
        up_to = f"{arch!r}: method {method} does not move it towards {towards} up to {load:.4g} g"
        if run.end_time < 0.999 * ramp.duration:
            raise ArchfragError(f"{up_to}; there {STATUS_MESSAGE[run.status]}")
        if locks:
            raise InputError(f"{up_to}; its joints lock each other")
        raise ArchfragError(f"{up_to}, beyond the static bound")
    first = history.time.values[np.argmax(moved)]
    return float(BEYOND_BOUND * bound * first / time[-1])


def _checked_call(
    arch: Arch,
    motions: Sequence[Motion],
    factors: Sequence[float],
    wave_speed: float | None = None,
    bases: Bases | None = None,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    follow: float = 20.0,
    loss_limit: float = LOSS_LIMIT,
) -> tuple[MethodInfo, Options]:
    """Check the arguments of a run, as of `simulate`; return the method and its options."""
    for kind, allowed, values in (
        (Arch, "arch is {}; it must be an archfrag Arch or Block", [arch]),
        (Motion, "motion is {}; it must be an archfrag Motion", motions),
    ):
        for value in values:
            if not isinstance(value, kind):
                raise InputError(allowed.format(type(value).__name__))
    info = arguments.check_method(method)
    arguments.check_taken(info, rtol=rtol, dt=dt)
    tolerance = arguments.default_of(info, "rtol") if rtol is None else rtol
    for factor in factors:
        arguments.check_number("scale", factor, -math.inf, math.inf)
    arguments.check_number("loss_limit", loss_limit, NOTED_GAP, 10.0)
    arguments.check_number("rtol", tolerance, 1e-12, 1.0)
    arguments.check_number("follow", follow, 0.0, math.inf, "s")
    if dt is not None:
        arguments.check_number("dt", dt, 1e-9, 10.0, "s")
    arguments.check_can_run(arch, info, wave_speed, bases)
    unit = own_time(arch)
    faces = arch.chain.joint is not None
    longest = longest_step(arch.chain) if faces else math.inf
    if dt is not None or info.step_rule is None:
        step = largest = arguments.default_of(info, "dt") if dt is None else float(dt)
    else:
        parts = info.step_rule(tolerance, arch.n_voussoir)
        step, largest = (unit * part for part in parts)
        if faces:
            step = largest = min(FACE_STEP * largest, longest)
    if dt is not None and dt > longest:
        warnings.warn(
            f"dt is {dt:g} s: steps so long damp the first mode of the arch by at least "
            f"{damping_of_steps(arch.chain, dt):.2g} of critical damping, or do not find the "
            f"motion of stiff joints; leave dt out, or give at most {longest:.2g} s",
            stacklevel=3,
        )
    span = max(motion.duration for motion in motions) + follow
    samples = max(len(motion.acceleration) for motion in motions)
    sampling = min(motion.dt for motion in motions)
    options = Options(
        time_step=step,
        tolerance=float(tolerance),
        accuracy=float(tolerance),
        follow=float(follow),
        loss_limit=float(loss_limit),
        check_interval=CHECK_INTERVAL,
        max_steps=int(span / min(step, OWN_STEP * unit)) + samples + 1000,
        frame_interval=max(step, min(sampling, COARSEST_FRAMES)),
        crowding=0.0,
        largest_step=largest,
    )
    return info, options


def _grounds(motions: Sequence[Motion], *given) -> tuple[Grounds, list[Motion]]:
    """Return ground motions for kernels, and the motions of the left base; see `ground_of`."""
    grounds = [ground_of(motion, *given) for motion in motions]
    left = [ground.motion for ground in grounds]
    return grounds_of(grounds, [motion.record_start for motion in left]), left


def results_of_runs(
    arch: Arch,
    motions: Sequence[Motion],
    factors: Sequence[float],
    *,
    wave_speed: float | None = None,
    bases: Bases | None = None,
    **given,
) -> tuple[Outcomes, np.ndarray, np.ndarray]:
    """Simulate many runs; return the results of the kernels, wall times and starts of records [s].

    They have a row for each run. `given` are other arguments of `simulate`. The wall time of all
    runs is shared among them by their numbers of steps. A record starts later than its motion
    states if a base moves before the left one.
    """
    info, options = _checked_call(arch, motions, factors, wave_speed, bases, **given)
    arguments.check_compiled(plain=False)
    check_stands(arch)
    unique = list(dict.fromkeys(motions))
    motion = np.array([unique.index(each) for each in motions], int)
    grounds, _ = _grounds(unique, arch, wave_speed, bases)
    factor = np.array(factors, float)
    started = time.perf_counter()
    run: Any = info.load("run_many")
    results = run(arch.chain, grounds, motion, factor, options)
    spent = time.perf_counter() - started
    # The calls of several runs are timed together.
    work = 1.0 + results.count[:, Count.STEPS]
    return results, spent * work / work.sum(), grounds.noted[motion]


class Stream:
    """Runs of one arch that go on side by side, to which others are added meanwhile.

    Each has the results of `simulate_many` to the last bit, whatever goes beside it. `given` are
    other arguments of `simulate`. At most `PLACES` may be held at once.
    """

    def __init__(self, arch: Arch, **given) -> None:
        arguments.check_compiled(plain=False)
        check_stands(arch)
        self._arch = arch
        self._given = given
        self.lanes = lanes_for(arch.chain)  # runs that go side by side
        self._lanes: Any = None
        self._keys: dict[int, Any] = {}  # of the runs in lanes, by their numbers
        # Runs that do not go side by side: key, motion, factor.
        self._others: list[tuple[Any, Motion, float]] = []
        self._paid = np.zeros((2, PLACES))  # steps paid for so far, and their time [s]
        self._ground = lru_cache(PLACES)(self._ground_of)

    @property
    def held(self) -> int:
        """Number of runs that have not ended."""
        return len(self._keys) + len(self._others)

    def _ground_of(self, motion: Motion) -> Grounds:
        moved = (self._given.get(name) for name in ("wave_speed", "bases"))
        return _grounds([motion], self._arch, *moved)[0]

    def add(self, key: Any, motion: Motion, factor: float) -> None:
        """Add a run; `key` comes back with its results."""
        info, options = _checked_call(self._arch, [motion], [factor], **self._given)
        if self._lanes is None and not self._others:
            make: Any = info.load("lanes")
            self._lanes = make and make(self._arch.chain, options)
        if self._lanes is None:
            self._others.append((key, motion, factor))
            return
        number = self._lanes.add(self._ground(motion), factor, options)
        self._keys[number] = key, motion
        self._paid[:, number] = 0.0

    def go_on(self) -> tuple[list[Any], Outcomes, np.ndarray, np.ndarray]:
        """Go on until a run has ended and leaves room, or for a while if there is room.

        Return the keys of the runs that have ended, and what `results_of_runs` returns of them.
        """
        if self._lanes is None:
            keys, motions, factors = zip(*self._others)
            self._others.clear()
            made = results_of_runs(self._arch, motions, factors, **self._given)
            return list(keys), *made
        started = time.perf_counter()
        ended, results = self._lanes.go_on()
        spent = time.perf_counter() - started
        held = list(self._keys)
        steps = self._lanes.steps[held]
        new = 1.0 + steps - self._paid[0, held]
        self._paid[0, held] = steps
        self._paid[1, held] += spent * new / new.sum()
        given = [self._keys.pop(number) for number in ended]
        starts = [self._ground(motion).noted[0] for _, motion in given]
        return (
            [key for key, _ in given],
            results,
            self._paid[1, ended],
            np.array(starts),
        )


def simulate_runs(
    arch: Arch,
    motions: Sequence[Motion],
    factors: Sequence[float],
    method: str,
    **given,
) -> list[Response]:
    """Simulate many runs, one for each pair of motion and factor; return their responses."""
    if arguments.check_method(method).load("run_many") is None:
        pairs = zip(motions, factors, strict=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnitWarning)
            return [simulate(arch, *each, method=method, **given) for each in pairs]
    results, wall_time, _ = results_of_runs(
        arch, motions, factors, method=method, **given
    )
    return [
        response_of(results, row, method, each)
        for row, each in enumerate(wall_time.tolist())
    ]


def simulate_many(
    arch: Arch,
    motions: Motion | Sequence[Motion],
    factors: ArrayLike,
    method: str = AUTO,
    rtol: float | None = None,
    dt: float | None = None,
    **more,
) -> xarray.Dataset:
    """Simulate one arch under many scaled ground motions, several runs at a time.

    Each run has the same results, to the last bit, as `simulate` without a history. Of a bridge
    there is also `collapse_place`, the name of the joint.

    Parameters
    ----------
    arch : Arch
    motions : Motion or sequence of Motion
        One for each run, or one for all.
    factors : array_like, (n_run,)
        On the motions, vertical components included.
    method, rtol, dt, **more
        As for `archfrag.simulate`, with wave_speed, bases, follow and loss_limit.

    Returns
    -------
    xarray.Dataset
        Dimension run; the numbers of a `Response` for each, and the factors.

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
    each = [motions] if isinstance(motions, Motion) else list(motions)
    if len(each) == 1:
        each *= scales.size
    if scales.ndim != 1 or len(each) != scales.size:
        raise InputError(
            f"motions are {len(each)} and factors have shape {scales.shape}; there must be one "
            "motion for each factor, or one for all"
        )
    responses = simulate_runs(
        arch, each, scales.tolist(), method, rtol=rtol, dt=dt, **more
    )
    strongest = max(
        range(len(each)), key=lambda i: abs(scales[i]) * each[i].pga, default=None
    )
    if strongest is not None:
        warn_if_in_g(each[strongest], scales[strongest], onset(arch))
    names = [each.name for each in fields(Response) if each.name not in _LEFT_OUT]
    variables: Named = {}
    for name in (*names, "steps"):
        values = [getattr(each, name) for each in responses]
        if name == "status":
            values = [status.name.lower() for status in values]
        unit = UNITS.get(name.split("_")[-1], "1")
        variables[name] = "run", np.array(values), {"units": unit}
    if arch.places:
        joints = variables["collapse_joint"][1]
        variables["collapse_place"] = "run", np.array([*arch.places, ""])[joints]
    return xarray.Dataset(
        variables, coords={"factor": ("run", scales)}, attrs={"method": method}
    )
