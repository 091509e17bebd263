"""One case: an arch, a ground motion, an answer. Checks and user units live here."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.errors import STATUS_SENTENCE, InputError, StabilityError
from archfrag.mechanics.contact import contact_work, solve_contact
from archfrag.mechanics.kinematics import (
    empty_contacts,
    joint_lengths,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import CLOSED_STICK
from archfrag.mechanics.onset import (
    HINGE_EXTRADOS,
    HINGE_INTRADOS,
    SLIDING,
    RestLimit,
    rest_limit,
)
from archfrag.mechanics.status import CollapseMode, Status
from archfrag.mechanics.types import Frames, GroundMotion, Options, Outcome
from archfrag.methods.registry import AUTO, METHODS, MethodInfo, resolve
from archfrag.motions.motion import Motion

if TYPE_CHECKING:
    import xarray

__all__ = ["Onset", "Response", "onset", "simulate", "warmup"]

LOSS_LIMIT = 0.02
CHECK_INTERVAL = 64
STANDS_TOLERANCE = 1e-12

Hinge = tuple[int, str]


@dataclass(frozen=True)
class Onset:
    """Rest range of an arch and the mechanisms at its ends.

    Attributes
    ----------
    stands : bool
        Whether the arch is at rest under its own weight.
    plus, minus : float
        Largest steady ground acceleration towards +x and towards -x that it bears [g]; nan if
        no load of any size leaves it at rest, inf if none moves it. With a vertical ground
        acceleration k_v they hold for k_h / (1 + k_v).
    hinges, hinges_minus : list of (int, str)
        Joint and side ("intrados" or "extrados") of the hinges at `plus` and at `minus`.
    sliding, sliding_minus : list of int
        Joints that slide there.
    thrust : ndarray, (n_joint, 2) or None
        Contact centres under self-weight [m]; nan where a joint bears nothing; None if the arch
        does not stand. An arch at rest is hyperstatic: of its admissible thrust lines this is
        the one of joints that are equal springs in the limit of infinite stiffness.
    thrust_plus, thrust_minus : ndarray, (n_joint, 2) or None
        Contact centres at the two ends of the range, where they are unique [m].
    """

    stands: bool
    plus: float
    minus: float
    hinges: list[Hinge]
    sliding: list[int]
    hinges_minus: list[Hinge]
    sliding_minus: list[int]
    thrust: NDArray[np.float64] | None = field(repr=False)
    thrust_plus: NDArray[np.float64] | None = field(repr=False)
    thrust_minus: NDArray[np.float64] | None = field(repr=False)


@dataclass(frozen=True)
class Response:
    """What one arch did under one ground motion.

    Attributes
    ----------
    status : Status
        How the run ended; `archfrag.errors.STATUS_SENTENCE` says it in words.
    collapsed : bool or None
        None if the run was unfinished or the solver failed: neither collapse nor survival.
    collapse_time : float
        Instant from which the joint's contact was lost for good [s]; nan if none.
    collapse_joint : int
        -1 if none.
    collapse_mode : str
        "none", "hinging", "sliding", "lift_off" or "overturning": by what that joint had done
        when it lost contact, the larger of its rotation [rad] and its slip over its length, or
        neither. A joint turned by 90 degrees with contact kept counts as overturning.
    peak_rotation : float
        Of any voussoir [rad].
    peak_displacement : float
        Of any voussoir's centroid, relative to the ground [m].
    events : dict of str to int
        Numbers of impacts, openings, slides, contact losses and rests.
    model_time : dict of str to float
        Simulated time in each model of the ladder [s].
    energy_error : float
        Largest energy that the integrator made or lost on the way and no contact law explains,
        over the largest kinetic energy [1].
    energy : dict of str to float
        Kinetic and potential energy at the end, work of the ground, friction, impacts, and what
        is left over ("stray") [J].
    wall_time : float
        Time it took, compilation included if there was any [s].
    end_time : float
        Simulated time at which the run ended [s].
    steps, iterations, paths, shortened : int
        Steps, linear contact problems solved, contact problems that needed the path following
        behind the Newton iteration, and steps halved because that failed too.
    fallbacks : int
        Contact problems of which only the solution with slightly compliant joints was found
        (`archfrag.mechanics.contact`). No relaxation sweep is ever used.
    residual : float
        Largest residual of the contact laws that was measured on the way [1].
    method : str
        What ran.
    history : xarray.Dataset or None
    """

    status: Status
    collapsed: bool | None
    collapse_time: float
    collapse_joint: int
    collapse_mode: str
    peak_rotation: float
    peak_displacement: float
    events: dict[str, int]
    model_time: dict[str, float]
    energy_error: float
    energy: dict[str, float]
    wall_time: float
    end_time: float
    steps: int
    iterations: int
    paths: int
    shortened: int
    fallbacks: int
    residual: float
    method: str
    history: xarray.Dataset | None = field(default=None, repr=False)


def onset(arch: Arch) -> Onset:
    """How much steady ground acceleration an arch bears, and how it would start to move.

    Parameters
    ----------
    arch : Arch

    Returns
    -------
    Onset
        Also for an arch that does not stand (``stands`` is then False).

    Raises
    ------
    InputError
        If `arch` is not an arch.

    Notes
    -----
    Static theorem: rest is the contact problem of the chain with no acceleration,
    solved for the largest load factor (`archfrag.mechanics.onset`). With friction it is the
    largest load for which admissible reactions exist.

    Examples
    --------
    >>> import archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> start = af.onset(arch)
    >>> round(start.plus, 4), start.hinges
    (0.37, [(0, 'extrados'), (2, 'intrados'), (4, 'extrados'), (7, 'intrados')])
    """
    _check_arch(arch)
    chain = arch.chain
    contacts = _contacts_at_rest(arch)
    limits = []
    for sense in (1.0, -1.0):
        limits.append(
            rest_limit(
                chain.mass,
                chain.centroid,
                contacts.point,
                contacts.normal,
                contacts.candidate,
                chain.friction,
                chain.gravity,
                sense,
            )
        )
    plus, minus = limits
    found = plus.found and minus.found
    stands = bool(
        found and plus.load_factor >= -STANDS_TOLERANCE and minus.load_factor <= STANDS_TOLERANCE
    )
    thrust = None
    if stands:
        thrust = _thrust(contacts.point, contacts.normal, _reactions_at_rest(chain, contacts))
    return Onset(
        stands=stands,
        plus=float(plus.load_factor) if found else math.nan,
        minus=float(-minus.load_factor) if found else math.nan,
        hinges=_hinges(arch, plus),
        sliding=[int(j) for j in np.flatnonzero(plus.mechanism & SLIDING)],
        hinges_minus=_hinges(arch, minus),
        sliding_minus=[int(j) for j in np.flatnonzero(minus.mechanism & SLIDING)],
        thrust=thrust,
        thrust_plus=_thrust_at_limit(contacts, plus),
        thrust_minus=_thrust_at_limit(contacts, minus),
    )


def simulate(
    arch: Arch,
    motion: Motion,
    scale: float = 1.0,
    method: str = AUTO,
    rtol: float = 1e-6,
    dt: float | None = None,
    history: bool = False,
    initial: tuple[ArrayLike, ArrayLike] | None = None,
    follow: float = 20.0,
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
    rtol : float
        Relative error allowed by methods with step control.
    dt : float, optional
        Time step [s]; the method's default if not given.
    history : bool
        Whether to keep positions, velocities, reactions and contact modes over time.
    initial : (position, velocity), optional
        Each (n_voussoir, 3): displacement from rest [m, m, rad] and velocity relative to the
        ground [m/s, m/s, rad/s] at time 0. At rest if not given.
    follow : float
        How long to go on past the end of the motion while the arch still moves [s].

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
    _check_arch(arch)
    info = _check_method(method)
    if not isinstance(motion, Motion):
        raise InputError(f"motion is {type(motion).__name__}; it must be an archfrag Motion")
    _check_number("scale", scale, "finite", math.isfinite)
    _check_number("rtol", rtol, "between 0 and 1", lambda x: 0.0 < x < 1.0)
    _check_number("follow", follow, "finite and not negative [s]", lambda x: 0.0 <= x < math.inf)
    if dt is None:
        dt = next(p.default for p in info.parameters if p.name == "dt")
    _check_number("dt", dt, "finite and positive [s]", lambda x: 0.0 < x < math.inf)
    chain = arch.chain
    position = np.zeros((arch.n_voussoir, 3))
    position[:, :2] = chain.centroid
    velocity = np.zeros_like(position)
    if initial is None:
        _check_stands(arch)
    else:
        shift, velocity = _check_initial(initial, arch.n_voussoir)
        position += shift
    horizontal = np.ascontiguousarray(motion.acceleration, float) * scale
    vertical = np.zeros_like(horizontal)
    if motion.vertical is not None:
        vertical = np.ascontiguousarray(motion.vertical, float) * scale
    ground = GroundMotion(horizontal, vertical, float(motion.dt))
    span = (horizontal.size - 1) * motion.dt + follow
    options = Options(
        time_step=float(dt),
        tolerance=float(rtol),
        follow=float(follow),
        max_steps=int(span / dt) + 1000,
        loss_limit=LOSS_LIMIT,
        check_interval=CHECK_INTERVAL,
        frame_interval=max(float(dt), float(motion.dt)),
    )
    run = info.load()
    capacity = int(span / options.frame_interval) + 64 if history else 0
    started = time.perf_counter()
    while True:
        frames = _empty_frames(capacity, arch.n_voussoir, arch.n_joint)
        outcome = run(
            chain, ground, position.copy(), velocity.copy(), initial is None, options, frames
        )
        if outcome.frames < capacity or not history:
            break
        capacity *= 2
    wall_time = time.perf_counter() - started
    kept = _history(arch, frames, outcome) if history else None
    return _response(outcome, info, wall_time, kept)


def warmup() -> float:
    """Compile every kernel, or load it from the cache, once for this machine.

    Returns
    -------
    float
        Seconds it took.

    Examples
    --------
    >>> from archfrag.simulate import warmup
    >>> warmup() > 0.0
    True
    """
    started = time.perf_counter()
    arch = Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)
    onset(arch)
    motion = Motion(np.zeros(3), dt=0.01)
    for name in METHODS:
        simulate(arch, motion, method=name)
    return time.perf_counter() - started


def _check_arch(arch: Any) -> None:
    if not isinstance(arch, Arch):
        raise InputError(f"arch is {type(arch).__name__}; it must be an archfrag Arch or Block")


def _check_method(name: Any) -> MethodInfo:
    info = resolve(name) if isinstance(name, str) else None
    if info is None:
        allowed = ", ".join([AUTO, *METHODS])
        raise InputError(f"method is {name!r}; allowed are {allowed}")
    return info


def _check_number(name: str, value: Any, allowed: str, fits) -> None:
    try:
        good = not isinstance(value, bool) and fits(float(value))
    except (TypeError, ValueError):
        good = False
    if not good:
        raise InputError(f"{name} is {value!r}; it must be a number, {allowed}")


def _check_initial(initial: Any, n_voussoir: int) -> tuple[NDArray, NDArray]:
    try:
        shift, velocity = (np.array(part, float) for part in initial)
    except (TypeError, ValueError) as error:
        raise InputError("initial must be a pair of arrays: position and velocity") from error
    for name, part in (("position", shift), ("velocity", velocity)):
        if part.shape != (n_voussoir, 3) or not np.isfinite(part).all():
            raise InputError(
                f"initial {name} has shape {part.shape}; it must be ({n_voussoir}, 3) and finite"
            )
    return shift, velocity


def _check_stands(arch: Arch) -> None:
    start = onset(arch)
    if not start.stands:
        raise StabilityError(
            f"{arch!r}: {STATUS_SENTENCE[Status.DOES_NOT_STAND]} "
            f"(rest would need a steady horizontal acceleration between {-start.minus:.4g} and "
            f"{start.plus:.4g} g)"
            if math.isfinite(start.plus)
            else f"{arch!r}: {STATUS_SENTENCE[Status.DOES_NOT_STAND]}"
        )


def _contacts_at_rest(arch: Arch):
    chain = arch.chain
    position = np.zeros((arch.n_voussoir, 3))
    position[:, :2] = chain.centroid
    before = np.zeros((arch.n_joint, 2, 2))
    after = np.zeros((arch.n_joint, 2, 2))
    contacts = empty_contacts(arch.n_voussoir, arch.n_joint)
    move_faces(chain, position, before, after)
    place_contacts(position, before, after, np.zeros(arch.n_joint), joint_lengths(chain), contacts)
    return contacts


def _reactions_at_rest(chain, contacts) -> NDArray[np.float64]:
    """Admissible reactions under self-weight, moments about the origin, (n_joint, 3)."""
    n_body, n_joint = chain.mass.size, chain.friction.size
    work = contact_work(n_body, n_joint)
    work.mode[:] = CLOSED_STICK
    free = np.zeros((n_body, 3))
    free[:, 1] = -chain.gravity
    solve_contact(chain.mass, chain.inertia, contacts, chain.friction, free, work)
    reaction = work.reaction.copy()
    reaction[:, 2] += work.pivot[:, 0] * reaction[:, 1] - work.pivot[:, 1] * reaction[:, 0]
    return reaction


def _thrust(point, normal, reaction) -> NDArray[np.float64]:
    """Contact centres (Eq 34): where on each joint the reaction has no moment [m]."""
    force = reaction[:, :2]
    press = np.einsum("jk,jk->j", force, normal)

    def moment_about(corner):
        arm = point[:, corner]
        return reaction[:, 2] - (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])

    length = np.linalg.norm(point[:, 1] - point[:, 0], axis=1)
    bears = press > 1e-12 * np.abs(reaction[:, :2]).max()
    share = np.full(press.size, np.nan)
    share[bears] = -moment_about(0)[bears] / (press * length)[bears]
    return point[:, 0] + share[:, None] * (point[:, 1] - point[:, 0])


def _thrust_at_limit(contacts, limit: RestLimit) -> NDArray[np.float64] | None:
    if not limit.found or math.isinf(limit.load_factor):
        return None
    return _thrust(contacts.point, contacts.normal, limit.reaction)


def _hinges(arch: Arch, limit: RestLimit) -> list[Hinge]:
    hinges = []
    for j, bits in enumerate(limit.mechanism):
        for corner, bit in ((0, HINGE_INTRADOS), (1, HINGE_EXTRADOS)):
            if bits & bit:
                hinges.append((j, arch.corner_name(corner)))
    return hinges


def _empty_frames(capacity: int, n_body: int, n_joint: int) -> Frames:
    return Frames(
        time=np.zeros(capacity),
        position=np.zeros((capacity, n_body, 3)),
        velocity=np.zeros((capacity, n_body, 3)),
        reaction=np.zeros((capacity, n_joint, 3)),
        mode=np.zeros((capacity, n_joint), np.int8),
    )


def _response(
    outcome: Outcome, info: MethodInfo, wall_time: float, history: xarray.Dataset | None
) -> Response:
    status = Status(outcome.status)
    collapsed = {Status.STANDING: False, Status.COLLAPSED: True}.get(status)
    largest = outcome.largest_kinetic
    return Response(
        status=status,
        collapsed=collapsed,
        collapse_time=float(outcome.collapse_time),
        collapse_joint=int(outcome.collapse_joint),
        collapse_mode=CollapseMode(outcome.collapse_mode).name.lower(),
        peak_rotation=float(outcome.peak_rotation),
        peak_displacement=float(outcome.peak_displacement),
        events={
            "impacts": int(outcome.impacts),
            "openings": int(outcome.openings),
            "slides": int(outcome.slides),
            "contact_losses": int(outcome.contact_losses),
            "rests": int(outcome.rests),
        },
        model_time={
            "rest": float(outcome.rest_time),
            "all_voussoirs": float(outcome.moving_time),
        },
        energy_error=float(outcome.stray_peak / largest) if largest > 0.0 else 0.0,
        energy={
            "kinetic": float(outcome.kinetic),
            "potential": float(outcome.potential),
            "ground": float(outcome.ground_work),
            "friction": float(outcome.friction_work),
            "impacts": float(outcome.impact_work),
            "stray": float(outcome.stray_work),
            "largest_kinetic": float(largest),
        },
        wall_time=wall_time,
        end_time=float(outcome.end_time),
        steps=int(outcome.steps),
        iterations=int(outcome.iterations),
        paths=int(outcome.paths),
        shortened=int(outcome.shortened),
        fallbacks=int(outcome.compliant),
        residual=float(outcome.residual),
        method=info.name,
        history=history,
    )


def _history(arch: Arch, frames: Frames, outcome: Outcome) -> xarray.Dataset:
    import xarray

    n = outcome.frames
    body, joint = ("time", "voussoir", "component"), ("time", "joint", "component")
    dataset = xarray.Dataset(
        {
            "displacement": (
                body,
                frames.position[:n, :, :2],
                {"units": "m", "long_name": "displacement of the centroid from rest"},
            ),
            "rotation": (
                body[:2],
                frames.position[:n, :, 2],
                {"units": "rad", "long_name": "rotation of the voussoir"},
            ),
            "velocity": (
                body,
                frames.velocity[:n, :, :2],
                {"units": "m s-1", "long_name": "velocity of the centroid relative to the ground"},
            ),
            "angular_velocity": (
                body[:2],
                frames.velocity[:n, :, 2],
                {"units": "rad s-1", "long_name": "angular velocity of the voussoir"},
            ),
            "reaction": (
                joint,
                frames.reaction[:n, :, :2],
                {"units": "N", "long_name": "reaction on the voussoir after the joint"},
            ),
            "moment": (
                joint[:2],
                frames.reaction[:n, :, 2],
                {"units": "N m", "long_name": "moment of the reaction about the joint's middle"},
            ),
            "contact_mode": (
                joint[:2],
                frames.mode[:n],
                {
                    "long_name": "contact mode of the joint",
                    "flag_values": np.arange(10, dtype=np.int8),
                    "flag_meanings": _mode_meanings(arch),
                },
            ),
        },
        coords={
            "time": ("time", frames.time[:n], {"units": "s", "long_name": "time"}),
            "voussoir": np.arange(arch.n_voussoir),
            "joint": np.arange(arch.n_joint),
            "component": ["x", "y"],
        },
    )
    dataset.attrs["gravity"] = STANDARD_GRAVITY
    return dataset


def _mode_meanings(arch: Arch) -> str:
    names = ["open"]
    for corner in range(2):
        side = arch.corner_name(corner)
        names += [f"{side}_sticks", f"{side}_slides_plus", f"{side}_slides_minus"]
    names += ["closed_sticks", "closed_slides_plus", "closed_slides_minus"]
    return " ".join(names)
