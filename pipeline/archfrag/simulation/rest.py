"""Rest: how much steady acceleration an arch withstands, and how it would start to move."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.errors import STATUS_MESSAGE, InputError, StabilityError
from archfrag.mechanics.contact.path import new_path, solve_anyhow
from archfrag.mechanics.contact.placing import move_faces, place_contacts
from archfrag.mechanics.model import Model, State, Work, model_of, new_state, new_work
from archfrag.mechanics.onset import HINGE_EXTRADOS, HINGE_INTRADOS, SLIDING, RestLimit, rest_limit
from archfrag.mechanics.status import Status

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
        Largest steady ground acceleration towards +x and towards -x at which it stays at rest
        [g]; nan if no load leaves it at rest, inf if none moves it. With a vertical ground
        acceleration k_v they are limits of k_h / (1 + k_v).
    hinges, hinges_minus : list of (int, str)
        Joint and side ("intrados" or "extrados") of the hinges at `plus` and at `minus`.
    sliding, sliding_minus : list of int
        Joints that slide there.
    thrust : ndarray, (n_joint, 2) or None
        Contact centres under self-weight [m]; nan at joints without a force; None if the arch
        does not stand. An arch at rest is hyperstatic: this is the admissible thrust line of
        joints that are equal springs, in the limit of infinite stiffness.
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


def onset(arch: Arch) -> Onset:
    """Find the steady ground acceleration that starts to move an arch, and the mechanism.

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
    if not isinstance(arch, Arch):
        raise InputError(f"arch is {type(arch).__name__}; it must be an archfrag Arch or Block")
    chain = arch.chain
    model, state, work = _placed_at_rest(arch)
    closed = np.ones(work.candidate.shape, np.int8)
    plus, minus = (
        rest_limit(
            chain.mass, chain.centroid, work.point, work.normal, closed, chain.friction,
            chain.gravity, sense,
        )
        for sense in (1.0, -1.0)
    )  # fmt: skip
    found = plus.found and minus.found
    stands = bool(
        found and plus.load_factor >= -STANDS_TOLERANCE and minus.load_factor <= STANDS_TOLERANCE
    )
    thrust = None
    if stands:
        thrust = _thrust(work, _reactions_at_rest(model, state, work))
    return Onset(
        stands=stands,
        plus=float(plus.load_factor) if found else math.nan,
        minus=float(-minus.load_factor) if found else math.nan,
        hinges=_hinges(arch, plus),
        sliding=[int(j) for j in np.flatnonzero(plus.mechanism & SLIDING)],
        hinges_minus=_hinges(arch, minus),
        sliding_minus=[int(j) for j in np.flatnonzero(minus.mechanism & SLIDING)],
        thrust=thrust,
        thrust_plus=_thrust_at_limit(work, plus),
        thrust_minus=_thrust_at_limit(work, minus),
    )


def check_stands(arch: Arch) -> None:
    """See that an arch is at rest under its own weight, or raise `StabilityError`."""
    start = onset(arch)
    if not start.stands:
        message = f"{arch!r}: {STATUS_MESSAGE[Status.DOES_NOT_STAND]}"
        if math.isfinite(start.plus):
            ends = f"{-start.minus:.4g} and {start.plus:.4g} g"
            message += f" (rest would need a steady horizontal acceleration between {ends})"
        raise StabilityError(message)


def _placed_at_rest(arch: Arch) -> tuple[Model, State, Work]:
    model = model_of(arch.chain)
    state, work = new_state(model), new_work(model)
    state.position[:, :2] = model.centroid
    move_faces(model, state.position, work.rotated, work.face, work.tangent)
    place_contacts(model, state.slip, work.face, work.tangent, work)
    work.candidate[:], state.touch[:] = 1.0, 1.0
    return model, state, work


def _reactions_at_rest(model: Model, state: State, work: Work) -> NDArray[np.float64]:
    """Admissible reactions under self-weight, moments about the origin, (n_joint, 3)."""
    work.free[1:-1, 1], work.position[:] = -model.gravity, state.position
    solve_anyhow(model, state, work, new_path(model))
    reaction = work.reaction.copy()
    reaction[:, 2] += work.pivot[:, 0] * reaction[:, 1] - work.pivot[:, 1] * reaction[:, 0]
    return reaction


def _thrust(work: Work, reaction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Contact centres (Eq 34): where on each joint the reaction has no moment [m]."""
    point, normal = work.point, work.normal
    force, arm = reaction[:, :2], point[:, 0]
    press = np.einsum("jk,jk->j", force, normal)
    moment = reaction[:, 2] - (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])
    length = np.linalg.norm(point[:, 1] - point[:, 0], axis=1)
    loaded = press > 1e-12 * np.abs(reaction[:, :2]).max()
    fraction = np.full(press.size, np.nan)
    fraction[loaded] = -moment[loaded] / (press * length)[loaded]
    return point[:, 0] + fraction[:, None] * (point[:, 1] - point[:, 0])


def _thrust_at_limit(work, limit: RestLimit) -> NDArray[np.float64] | None:
    if not limit.found or math.isinf(limit.load_factor):
        return None
    return _thrust(work, limit.reaction)


def _hinges(arch: Arch, limit: RestLimit) -> list[Hinge]:
    corners = ((0, HINGE_INTRADOS), (1, HINGE_EXTRADOS))
    return [
        (j, arch.corner_name(corner))
        for j, bits in enumerate(limit.mechanism)
        for corner, bit in corners
        if bits & bit
    ]
