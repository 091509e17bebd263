"""Joints that give or crush: contact points inside their ends, or faces that are elastic."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike, NDArray

from archfrag.arch import Arch, checks
from archfrag.arch.building import plain
from archfrag.arch.facts import warn_of_units
from archfrag.errors import InputError, StabilityError
from archfrag.physics.status import Joint
from archfrag.simulation.arguments import check_number
from archfrag.simulation.rest import Onset, onset, static_limit
from archfrag.usual import USUAL

# Depths of two rounds that differ by less than this part of a joint's length are equal.
AGREE, MOST_ITERATIONS = 1e-9, 200
SOFTEST = 1e6  # stiffness that is allowed [Pa/m]
# Rotations among which the largest load is searched, over that of unstable equilibrium; how many
# are tried before the best is refined, and to what part of itself.
LEAST_ROTATION, TRIED, REFINED = 1e-5, 20, 1e-3


def crushed(arch: Arch, strength: float) -> Arch:
    """Return the arch with joints that cannot bear near their ends, where masonry would crush.

    A joint under the normal force N needs a compressed depth of N / (strength b), b being its
    depth across the plane: with a rectangular block of stress its resultant cannot come nearer to
    an end than half of that (Heyman; Gilbert and Melbourne 1994, *Struct. Eng.* 72(3), for limit
    analysis). N is that of self-weight, dead load and fill in the arch at rest, which is also the
    one that a change of the contact points leads to. It is not changed during a ground motion: a
    joint that bears twice its static force at a peak would lose twice as much.

    Parameters
    ----------
    arch : Arch
        Not yet with ties or with springings that have moved.
    strength : float
        Compressive strength of the masonry [N/m2]; inf: nothing crushes.

    Raises
    ------
    StabilityError
        If the arch does not stand with this strength.

    Examples
    --------
    >>> import archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> af.onset(af.crushed(arch, 2e6)).plus < af.onset(arch).plus
    True
    """
    if math.isinf(strength):
        return arch
    _check_first(arch, "strength")
    weak = _shortened(arch, np.zeros(arch.n_joint), strength)
    if weak is None:
        message = f"{arch!r}: the arch does not stand with a strength of {strength:g} N/m2"
        if strength < USUAL["strength"][1]:
            message += f"; masonry has {USUAL['strength'][1]:g} or more: is it in N/m2?"
        raise StabilityError(message)
    weak = weak.changed(parameters={**arch.parameters, "strength": strength})
    warn_of_units(weak, "strength")
    return weak


def jointed(
    arch: Arch, stiffness: ArrayLike, shear: ArrayLike | None = None, damping: float = 0.05,
    model: Literal["inset", "face"] = "inset", points: int | None = None,
    strength: float = math.inf,
) -> Arch:  # fmt: skip
    """Return the arch with joints that give.

    A face without tension that has rotated by theta bears on a strip x = sqrt(2 N / (k b theta))
    with its resultant x/3 inside the edge; N is the normal force at rest, k b stiffness times
    depth. A mechanism then bears the steady load (onset with contact points x/3 inside) - (onset
    of rigid joints) theta/theta_s, with the rotation theta_s of unstable equilibrium. At theta*,
    where this is largest, the rotation has cost as much as another x/6: the model inset has rigid
    joints with contact points x(theta*)/2 inside. Masses, inertias and centroids stay. If the
    mechanism slides, theta* is that without sliding; if there is no theta_s either, it is x/6 over
    the height of the centroid of all bodies above the lower end, as of a block.

    Parameters
    ----------
    arch : Arch
        After `recessed` and before ties and springings that move.
    stiffness : float or (n_joint,) array_like
        Normal stiffness of an area of the joints [Pa/m], one for all or one for each; inf: rigid.
    shear : float or (n_joint,) array_like, optional
        Shear stiffness [Pa/m], as the normal one if not given; only the model face uses it.
    damping : float
        Over the critical one, of the first mode with all joints closed; as shear.
    model : {"inset", "face"}
        Rigid joints with contact points inside their ends, or elastic faces without tension, for
        time stepping without ties.
    points : int, optional
        2 or 3: a face bears at its ends, or at these and its middle; all along it if not given.
    strength : float
        Compressive strength [N/m2] as of `crushed`; a joint loses the larger of both depths.

    Raises
    ------
    StabilityError
        If the arch does not stand with these contact points.

    Examples
    --------
    >>> import archfrag as af
    >>> block = af.Block(width=0.2, height=1.0, friction=0.8)
    >>> round(af.onset(af.jointed(block, 3e10)).plus, 4)
    0.1907
    """
    both = {"stiffness": stiffness, "shear": stiffness if shear is None else shear}
    normal, tangential = (
        checks.shared_or_each(
            f"joints.{name}", value, arch.n_joint, "joint", "Pa/m", least=SOFTEST, infinite="rigid"
        )
        for name, value in both.items()
    )
    _check_model(damping, model, points, strength)
    if np.isinf(normal).all():
        return crushed(arch, strength)
    _check_first(arch, "joints")
    told = {
        "positions": arch.parameters.get("joints"), "stiffness": plain(stiffness),
        "shear": plain(shear), "damping": float(damping), "model": model, "points": points,
    }  # fmt: skip
    given = {
        **arch.parameters,
        "joints": {k: each for k, each in told.items() if each is not None},
    }
    if math.isfinite(strength):
        given["strength"] = strength
    if model == "face":
        joint = np.zeros((arch.n_joint, len(Joint)))
        joint[:, Joint.STIFFNESS] = normal * arch.joint_depths
        joint[:, Joint.SHEAR] = tangential * arch.joint_depths
        joint[:, Joint.DAMPING], joint[:, Joint.POINTS] = damping, points or 0
        if not np.isfinite(joint).all():
            raise InputError("joints.model face needs a finite stiffness and shear of all joints")
        soft = arch.changed(chain=arch.chain._replace(joint=joint))
    else:
        soft = _inset(arch, normal, strength)
    soft = soft.changed(parameters=given)
    warn_of_units(soft, "joints", "strength")
    return soft


def _check_first(arch: Arch, key: str) -> None:
    """See that an arch may still get joints that give, or crush."""
    if arch.chain.start is not None or arch.chain.tie is not None:
        raise InputError(f"{key} comes before ties and before springings that move")
    if arch.joint_keys:
        raise InputError(f"the arch has joints that give already; {key} cannot follow")
    if key == "joints" and "strength" in arch.parameters:
        raise InputError("the arch has its strength already; give it to jointed, not before")


def _check_model(damping: float, model: str, points: int | None, strength: float) -> None:
    """See that the settings of joints that give fit together."""
    check_number("joints.damping", damping, 0.0, 1.0)
    for wrong, text in (
        (model not in ("inset", "face"), f"joints.model = {model!r} must be inset or face"),
        (points not in (None, 2, 3), f"joints.points = {points!r} must be 2 or 3, or not given"),
        (points and model != "face", f"joints.points = {points} needs joints.model face"),
        (math.isfinite(strength) and model != "inset",
         f"strength = {strength:g} needs joints.model inset"),
    ):  # fmt: skip
        if wrong:
            raise InputError(text)


def _inset(arch: Arch, stiffness: NDArray[np.float64], strength: float) -> Arch:
    """Return the arch with contact points where elastic faces bear most."""
    start = onset(arch)
    # The strip of a joint under 1 N that has rotated by 1 rad.
    unit = np.sqrt(2.0 / (stiffness * arch.joint_depths))
    soft = None
    if start.normal is not None:
        strip = unit * np.sqrt(np.maximum(start.normal, 0.0))
        soft = _shortened(arch, 0.5 * unit / math.sqrt(_rotation(arch, start, strip)), strength)
    if soft is None:
        raise StabilityError(
            f"{arch!r}: the arch does not stand with joints of {stiffness.min():g} Pa/m, which "
            "bear inside their ends; make it thicker or them stiffer, or try joints.model face"
        )
    return soft


def _rotation(arch: Arch, start: Onset, strip: NDArray[np.float64]) -> float:
    """Return the rotation at which a mechanism on elastic faces bears most [rad].

    `strip` is the length on which each joint bears at a rotation of 1 rad.
    """
    length = np.hypot(*(arch.extrados - arch.intrados)[: arch.n_joint].T)
    rough = arch.changed(chain=arch.chain._replace(friction=np.full(arch.n_joint, math.inf)))
    for body in (arch, rough):
        rigid = start if body is arch else onset(rough)
        most, falls = min(rigid.plus, rigid.minus), static_limit(body, rigid)
        if math.isfinite(most) and math.isfinite(falls):
            break
    else:
        # A chain of one length has no height: its joints are the least that it rises.
        ends = 0.5 * (arch.intrados + arch.extrados)[[0] if arch.free_end else [0, -1], 1]
        mass = arch.chain.mass
        height = max(mass @ arch.centroids[:, 1] / mass.sum() - ends.min(), length.mean())
        middle = max(float(np.sqrt(np.mean(strip**2))), checks.SMALLEST)
        return (middle / (6.0 * height)) ** (2.0 / 3.0)

    def lost(log_rotation: float) -> float:
        rotation = math.exp(log_rotation)
        inside = strip / (3.0 * math.sqrt(rotation))
        if (length - 2.0 * inside <= checks.SMALLEST).any():
            return rotation / falls * most
        now = onset(body.recessed(inside, inside))
        return rotation / falls * most - (min(now.plus, now.minus) if now.stands else 0.0)

    tried = np.log(falls) + np.linspace(math.log(LEAST_ROTATION), 0.0, TRIED)
    best = int(np.argmin([lost(each) for each in tried]))
    bounds = tried[max(best - 1, 0)], tried[min(best + 1, TRIED - 1)]
    options = {"xatol": REFINED}
    found = scipy.optimize.minimize_scalar(lost, bounds=bounds, method="bounded", options=options)
    return math.exp(found.x)


def _shortened(arch: Arch, unit: NDArray[np.float64], strength: float) -> Arch | None:
    """Return the arch whose joints have lost what gives or crushes under the forces that they then
    bear; None if it does not stand.

    A joint under the force N loses `unit` times its root, or half of the depth that crushes.
    """
    if math.isfinite(strength):
        check_number("strength", strength, 1.0, 1e12, "N/m2")
    wide, length = arch.joint_depths, np.hypot(*(arch.extrados - arch.intrados)[: arch.n_joint].T)
    lost, now = np.zeros(arch.n_joint), arch
    for _ in range(MOST_ITERATIONS):
        normal = onset(now).normal
        if normal is None:
            break
        force, before = np.maximum(normal, 0.0), lost
        lost = np.maximum(unit * np.sqrt(force), 0.5 * force / (strength * wide))
        if (length - 2.0 * lost <= checks.SMALLEST).any():
            break
        now = arch.recessed(lost, lost)
        if (np.abs(lost - before) < AGREE * length).all():
            return now if onset(now).stands else None
    return None
