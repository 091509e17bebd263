"""Joints that give or crush: contact points inside their ends, or faces that are elastic."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike

from archfrag.arch import Arch, checks
from archfrag.arch.building import plain
from archfrag.arch.checks import FloatArray
from archfrag.arch.facts import unit_cautions, warn_of_units
from archfrag.errors import GeometryError, InputError, StabilityError
from archfrag.physics.status import Joint
from archfrag.properties import PROPERTIES, SMALLEST
from archfrag.simulation.arguments import check_number
from archfrag.simulation.elastic import ElasticArch
from archfrag.simulation.rest import onset

# The lost depths are found if they change by less than this part of a joint's length.
AGREE = 1e-9
MOST_ITERATIONS = 200
# STIFFEST: largest stiffness with which faces are computed [Pa/m]; the inset of stiffer joints
# falls with the cube root of their stiffness. CLOSE: relative accuracy of the inset.
STIFFEST = 1e13
CLOSE = 1e-4


def crushed(arch: Arch, strength: float) -> Arch:
    """Return the arch with joints that cannot bear near their ends, where masonry would crush.

    A joint under the normal force N needs a compressed depth of N / (strength b), b being its
    depth across the plane: with a rectangular block of stress its resultant cannot come nearer to
    an end than half of that (Heyman; Gilbert and Melbourne 1994, *Struct. Eng.* 72(3), for limit
    analysis). N is the force at rest under self-weight, dead load and fill, with the contact
    points that follow from it. The depth stays as it is during a ground motion, although a joint
    that bears twice its static force at a peak would lose twice as much.

    Parameters
    ----------
    arch : Arch
        Without ties, and without springings that have moved.
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
        least, _ = PROPERTIES["strength"].usual
        raise StabilityError(
            f"{arch!r}: the arch does not stand with a strength of {strength:g} N/m2"
            f"{f'; masonry has {least:g} or more: is it in N/m2?' if strength < least else ''}"
        )
    weak = weak.changed(parameters={**arch.parameters, "strength": strength})
    warn_of_units(unit_cautions(weak, "strength"))
    return weak


def jointed(
    arch: Arch,
    stiffness: ArrayLike,
    shear: ArrayLike | None = None,
    damping: float = 0.05,
    model: Literal["inset", "face"] = "inset",
    points: int | None = None,
    strength: float = math.inf,
) -> Arch:
    """Return the arch with joints that give.

    The model inset has rigid joints with contact points inside their ends. The length that a joint
    loses grows with the root of its normal force at rest over its stiffness, as the strip does on
    which a rotated elastic face bears. With these lengths the arch bears the same largest steady
    acceleration as on elastic faces, both without sliding. They allow for hinges, for shorter
    joints, and for the flatter arch that follows from these. Masses, inertias and centroids stay.
    If joints lock each other so that no load is the largest, the lengths are those of a block as
    high as the centroid of all bodies above the lower end.

    Parameters
    ----------
    arch : Arch
        It may be `recessed`; it has no ties yet, and no springings that have moved.
    stiffness : float or (n_joint,) array_like
        Normal stiffness of the joints per area [Pa/m], one for all or one for each; inf: rigid.
    shear : float or (n_joint,) array_like, optional
        Shear stiffness [Pa/m], as the normal one if not given.
    damping : float
        Over the critical one, of the first mode with all joints closed; in shear as well.
    model : {"inset", "face"}
        Rigid joints with contact points inside their ends, or elastic faces without tension, for
        time stepping without ties.
    points : int, optional
        2: a face bears at its ends; 3: at its middle too; if not given, along all of its length.
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
    0.1905
    """
    both = {"stiffness": stiffness, "shear": stiffness if shear is None else shear}
    normal, tangential = (
        checks.shared_or_each(f"joints.{name}", value, arch.n_joint, "joint")
        for name, value in both.items()
    )
    _check_model(damping, model, points, strength)
    if np.isinf(normal).all():
        return crushed(arch, strength)
    _check_first(arch, "joints")
    told = {
        "stiffness": plain(stiffness),
        "shear": plain(shear),
        "damping": float(damping),
        "model": model,
        "points": points,
    }
    kept = {key: value for key, value in told.items() if value is not None}
    given = {**arch.parameters, "joints": kept}
    if math.isfinite(strength):
        given["strength"] = strength
    if model == "face":
        joint = np.zeros((arch.n_joint, len(Joint)))
        joint[:, Joint.STIFFNESS] = normal * arch.joint_depths
        joint[:, Joint.SHEAR] = tangential * arch.joint_depths
        joint[:, Joint.DAMPING] = damping
        joint[:, Joint.POINTS] = points or 0
        if not np.isfinite(joint).all():
            raise InputError(
                "joints.model face needs a finite stiffness and shear of all joints"
            )
        soft: Arch | None = arch.changed(chain=arch.chain._replace(joint=joint))
    else:
        soft = _shortened(arch, inset_of(arch, normal, tangential).lengths, strength)
    if soft is None:
        raise StabilityError(_too_soft(arch, normal))
    soft = soft.changed(parameters=given)
    warn_of_units(unit_cautions(soft, "joints", "strength"))
    return soft


def _check_first(arch: Arch, key: str) -> None:
    """Raise InputError if an arch can no longer get joints that give, or crush.

    `key` is joints or strength: what is asked for.
    """
    if arch.chain.start is not None or arch.pulled:
        raise InputError(f"{key} comes before ties and before springings that move")
    if arch.joints:
        raise InputError(f"the arch has joints that give already; {key} cannot follow")
    if key == "joints" and "strength" in arch.parameters:
        raise InputError(
            "the arch has its strength already; give it to jointed, not before"
        )


def _check_model(
    damping: float, model: str, points: int | None, strength: float
) -> None:
    """Raise InputError unless the settings of joints that give fit together."""
    check_number("joints.damping", damping, 0.0, 1.0)
    for wrong, text in (
        (
            model not in ("inset", "face"),
            f"joints.model = {model!r} must be inset or face",
        ),
        (
            points not in (None, 2, 3),
            f"joints.points = {points!r} must be 2 or 3, or not given",
        ),
        (
            points and model != "face",
            f"joints.points = {points} needs joints.model face",
        ),
        (
            math.isfinite(strength) and model != "inset",
            f"strength = {strength:g} needs joints.model inset",
        ),
    ):
        if wrong:
            raise InputError(text)


class Inset(NamedTuple):
    """How far inside the ends of its joints an arch bears, and what that costs."""

    lengths: FloatArray  # (n_joint,) from each end of a joint to its contact point [m]
    loss: float  # part of the largest steady load without sliding that the arch loses by it [1]
    growth: float  # largest normal force under this load over the largest at rest [1]


def inset_of(arch: Arch, stiffness: FloatArray, shear: FloatArray) -> Inset:
    """Find the contact points with which rigid joints bear as much as elastic faces.

    What they bear is the largest steady load without sliding.

    Parameters
    ----------
    arch : Arch
        With rigid joints.
    stiffness, shear : (n_joint,) array
        Stiffness of the joints per area [Pa/m]; inf is rigid.

    Raises
    ------
    StabilityError
        If the arch does not stand on joints that soft.
    """
    normal = np.minimum(stiffness, STIFFEST)
    tangential = np.minimum(shear, STIFFEST)
    elastic = ElasticArch(arch, normal, tangential)
    rest = elastic.rest()
    if rest is None:
        raise StabilityError(_too_soft(arch, stiffness))
    position, force = rest
    # The strip of a joint that has rotated by 1 rad; what is stiffer than STIFFEST loses less.
    strip = np.sqrt(2.0 * np.maximum(force, 0.0) / (normal * arch.joint_depths))
    stiffer = (normal / stiffness) ** (1.0 / 3.0)
    rough = arch.changed(
        chain=arch.chain._replace(friction=np.full(arch.n_joint, math.inf))
    )
    rigid = onset(rough)
    length = elastic.length
    senses = [(1.0, rigid.plus), (-1.0, rigid.minus)]
    mirrored = math.isclose(rigid.plus, rigid.minus, rel_tol=AGREE)
    if mirrored and np.allclose(force, force[::-1], rtol=1e-6):
        del senses[1]
    most = []
    for sense, start in senses:
        load, under = np.inf, force
        if math.isfinite(start):
            load, under = elastic.largest_load(position, sense)
        if math.isfinite(load):
            most.append((sense, start, load, under.max()))
    if not most:  # joints that lock each other, or a chain without height
        return Inset(
            strip * stiffer / (2.0 * math.sqrt(_turn(arch, strip, length))), 0.0, 1.0
        )

    def excess(part: float) -> float:
        try:
            now = onset(rough.recessed(part * strip, part * strip))
        except GeometryError:
            return -1.0
        held = {1.0: now.plus, -1.0: now.minus}
        least = min(held[sense] / load for sense, _, load, _ in most)
        return least - 1.0 if now.stands else -1.0

    part = 0.0
    if excess(part) > 0.0:
        widest = 0.5 * (length / np.maximum(strip, SMALLEST)).min()
        part = scipy.optimize.brentq(excess, 0.0, widest, rtol=CLOSE)
    return Inset(
        part * strip * stiffer,
        max(1.0 - load / start for _, start, load, _ in most),
        max(under / force.max() for *_, under in most),
    )


def _too_soft(arch: Arch, stiffness: FloatArray) -> str:
    return (
        f"{arch!r}: the arch does not stand with joints of {stiffness.min():g} Pa/m, which "
        "bear inside their ends; make it thicker or them stiffer, or try joints.model face"
    )


def _turn(arch: Arch, strip: FloatArray, length: FloatArray) -> float:
    """Return the rotation at which a rocking block on elastic joints bears its largest load [rad].

    The block stands for an arch that has no largest load of its own. `strip` is the length on
    which each joint bears at a rotation of 1 rad, `length` that of each joint; both (n_joint,)
    [m].
    """
    # The height is at least the mean length of the joints: a level chain has none by itself.
    ends = 0.5 * (arch.intrados + arch.extrados)[[0] if arch.free_end else [0, -1], 1]
    mass = arch.chain.mass
    height = max(mass @ arch.centroids[:, 1] / mass.sum() - ends.min(), length.mean())
    middle = max(np.sqrt(np.mean(strip**2)), SMALLEST)
    return (middle / (6.0 * height)) ** (2.0 / 3.0)


def _shortened(arch: Arch, inset: FloatArray, strength: float) -> Arch | None:
    """Return the arch with joints that are shorter at both ends; None if it does not stand.

    At each end a joint loses the larger of two lengths: `inset` [m], and half of the depth that it
    needs at this `strength` [N/m2]. The depth follows from the normal force at rest in the arch
    with shorter joints.
    """
    if math.isfinite(strength):
        check_number("strength", strength, 1.0, 1e12, "N/m2")
    wide = arch.joint_depths
    length = np.hypot(*(arch.extrados - arch.intrados)[: arch.n_joint].T)
    lost = np.zeros(arch.n_joint)
    now = arch
    for _ in range(MOST_ITERATIONS):
        normal = onset(now).normal
        if normal is None:
            break
        before = lost
        lost = np.maximum(inset, 0.5 * np.maximum(normal, 0.0) / (strength * wide))
        if (length - 2.0 * lost <= SMALLEST).any():
            break
        now = arch.recessed(lost, lost)
        if (np.abs(lost - before) < AGREE * length).all():
            return now if onset(now).stands else None
    return None
