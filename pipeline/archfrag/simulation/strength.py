"""Masonry of finite compressive strength, as thickness that joints lose."""

from __future__ import annotations

import math

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.facts import USUAL, warn_of_units
from archfrag.errors import InputError, StabilityError
from archfrag.simulation.arguments import check_number
from archfrag.simulation.rest import onset

# Depths of two rounds that differ by less than this part of a joint's length are equal.
AGREE, MOST_ITERATIONS = 1e-9, 200


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
    check_number("strength", strength, 1.0, 1e12, "N/m2")
    if arch.chain.start is not None or arch.chain.tie is not None:
        raise InputError("strength comes before ties and before springings that move")
    given, depth = arch.parameters, arch.depths
    # A joint is as deep as the shallower of its two bodies.
    padded = np.concatenate([depth[:1], depth, depth[-1:]])
    wide = np.minimum(padded[:-1], padded[1:])[: arch.n_joint]
    length = np.hypot(*(arch.extrados - arch.intrados)[: arch.n_joint].T)
    lost, now = np.zeros(arch.n_joint), arch
    for _ in range(MOST_ITERATIONS):
        normal = onset(now).normal
        if normal is None:
            break
        before, lost = lost, 0.5 * np.maximum(normal, 0.0) / (strength * wide)
        if (2.0 * lost >= length).any():
            break
        now = arch.recessed(lost, lost)
        if (np.abs(lost - before) < AGREE * length).all():
            if not onset(now).stands:
                break
            weak = now.changed(parameters={**given, "strength": strength})
            warn_of_units(weak, "strength")
            return weak
    message = f"{arch!r}: the arch does not stand with a strength of {strength:g} N/m2"
    if strength < USUAL["strength"][1]:
        message += f"; masonry has {USUAL['strength'][1]:g} or more: is it in N/m2?"
    raise StabilityError(message)
