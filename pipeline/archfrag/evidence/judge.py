"""Measures outside every method: of a motion, whoever computed it, by the laws alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.mechanics.compile import allocating
from archfrag.mechanics.kinematics import clearance, joint_lengths, move_faces
from archfrag.motions.motion import Motion

Array = NDArray[np.float64]

# Intervals between frames that a gain of energy lasts, if it is one.
LASTING = 4


@allocating
def _overlaps(chain, positions):
    n_frame, n_joint = positions.shape[0], chain.friction.size
    before = np.zeros((n_joint, 2, 2))
    after = np.zeros((n_joint, 2, 2))
    length = joint_lengths(chain)
    worst = np.zeros(n_frame)
    for k in range(n_frame):
        move_faces(chain, positions[k], before, after)
        for j in range(n_joint):
            for c in range(2):
                gap = clearance(j, c, before, after)
                worst[k] = max(worst[k], -gap / length[j])
    return worst


def overlap(arch: Arch, displacement: Array, rotation: Array) -> float:
    """Deepest overlap of neighbours at any corner and instant, over the joint's length.

    Parameters
    ----------
    arch : Arch
    displacement : ndarray, (n_time, n_voussoir, 2) [m]
    rotation : ndarray, (n_time, n_voussoir) [rad]

    Returns
    -------
    float
        Signorini's gap (Eqs 23a, 23b) where it is negative [1].

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> from archfrag.evidence.judge import overlap
    >>> block = af.Block(0.2, 1.0, friction=0.8)
    >>> sunk = np.array([[[0.0, -0.001]]])
    >>> round(overlap(block, sunk, np.zeros((1, 1))), 6)
    0.005
    """
    positions = np.zeros((*rotation.shape, 3))
    positions[:, :, :2] = arch.chain.centroid + displacement
    positions[:, :, 2] = rotation
    return float(np.max(_overlaps(arch.chain, positions), initial=0.0))


def energy_gain(
    arch: Arch,
    motion: Motion,
    time: Array,
    displacement: Array,
    velocity: Array,
    angular_velocity: Array,
) -> float:
    """Largest rise of mechanical energy that the ground's work does not explain.

    The work of the ground is taken from the motion itself: the sum over voussoirs of minus mass
    times ground acceleration, integrated over the displacement between frames. Contacts can only
    take energy, so that what rises was made by the method.

    Parameters
    ----------
    arch : Arch
    motion : Motion
        The ground's, at the scale that was run.
    time : ndarray, (n_time,) [s]
    displacement, velocity : ndarray, (n_time, n_voussoir, 2) [m], [m/s]
    angular_velocity : ndarray, (n_time, n_voussoir) [rad/s]

    Returns
    -------
    float
        Over the largest kinetic energy [1]; 0 if nothing moved.
    """
    chain = arch.chain
    kinetic = _kinetic(chain, velocity, angular_velocity)
    surplus = kinetic + _surplus_of_place(chain, motion, time, displacement)
    return _largest_rise(surplus, kinetic)


def path_energy_gain(
    arch: Arch, motion: Motion, time: Array, displacement: Array, rotation: Array
) -> float:
    """The same as `energy_gain` from positions alone.

    Velocities are differences over the intervals between frames, so that it does not matter at
    which instant a method says its velocities are (those of leapfrog schemes lag by half a
    step). An interval with an impact in it has too little kinetic energy, one with a jump of the
    ground's acceleration a little too much: dips and peaks of less than `LASTING` intervals do
    not count.

    Parameters
    ----------
    arch : Arch
    motion : Motion
    time : ndarray, (n_time,) [s]
    displacement : ndarray, (n_time, n_voussoir, 2) [m]
    rotation : ndarray, (n_time, n_voussoir) [rad]

    Returns
    -------
    float
        Over the largest kinetic energy [1].
    """
    distinct = np.append(True, np.diff(time) > 1e-9)
    time, displacement, rotation = time[distinct], displacement[distinct], rotation[distinct]
    if time.size <= 5 * LASTING:
        return 0.0
    span = np.diff(time)
    velocity = np.diff(displacement, axis=0) / span[:, None, None]
    kinetic = _kinetic(arch.chain, velocity, np.diff(rotation, axis=0) / span[:, None])
    place = _surplus_of_place(arch.chain, motion, time, displacement)
    surplus = kinetic + 0.5 * (place[1:] + place[:-1])
    bridged = _over(np.min, _over(np.max, surplus))
    return _largest_rise(_over(np.max, _over(np.min, bridged)), _over(np.min, kinetic))


def _over(extreme: Callable[..., Array], values: Array) -> Array:
    return extreme(sliding_window_view(values, LASTING), axis=1)


def _kinetic(chain, velocity: Array, angular_velocity: Array) -> Array:
    kinetic = 0.5 * np.sum(chain.mass[:, None] * velocity**2, axis=(1, 2))
    return kinetic + 0.5 * angular_velocity**2 @ chain.inertia


def _surplus_of_place(chain, motion: Motion, time: Array, displacement: Array) -> Array:
    """Potential energy less the work of the ground [J]."""
    potential = chain.gravity * displacement[:, :, 1] @ chain.mass
    work = np.zeros(time.size)
    components = [(0, motion.acceleration)]
    if motion.vertical is not None:
        components.append((1, motion.vertical))
    for axis, acceleration in components:
        path = displacement[:, :, axis] @ chain.mass
        work[1:] -= np.cumsum(_means(time, acceleration, motion.dt) * np.diff(path))
    return potential - work


def _means(time: Array, acceleration: Array, step: float) -> Array:
    """Exact means of samples joined by lines, between instants: jumps fall between frames."""
    velocity = np.append(0.0, np.cumsum(0.5 * step * (acceleration[1:] + acceleration[:-1])))
    place = np.clip(time / step, 0.0, acceleration.size - 1.0)
    index = np.minimum(place.astype(int), acceleration.size - 2)
    part = place - index
    slope = acceleration[index + 1] - acceleration[index]
    reached = velocity[index] + step * (acceleration[index] * part + 0.5 * slope * part**2)
    span = np.diff(time)
    return np.divide(np.diff(reached), span, out=np.zeros_like(span), where=span > 0.0)


def _largest_rise(surplus: Array, kinetic: Array) -> float:
    largest = float(kinetic.max(initial=0.0))
    if largest == 0.0:
        return 0.0
    return float(np.max(surplus - np.minimum.accumulate(surplus))) / largest


def drift(displacement: Array) -> float:
    """Largest displacement of a chain that ought to be at rest [m].

    Parameters
    ----------
    displacement : ndarray, (n_time, n_voussoir, 2) [m]
    """
    return float(np.max(np.hypot(displacement[..., 0], displacement[..., 1]), initial=0.0))
