"""Measures outside every method: of a motion, whoever computed it, by the laws alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.mechanics.compile import allocating
from archfrag.mechanics.kinematics import clearance, joint_lengths, move_faces
from archfrag.motions.motion import Motion

Array = NDArray[np.float64]


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
    kinetic = 0.5 * np.sum(chain.mass[:, None] * velocity**2, axis=(1, 2))
    kinetic += 0.5 * angular_velocity**2 @ chain.inertia
    largest = float(kinetic.max(initial=0.0))
    if largest == 0.0:
        return 0.0
    potential = chain.gravity * displacement[:, :, 1] @ chain.mass
    sample = motion.dt * np.arange(motion.acceleration.size)
    work = np.zeros(time.size)
    components = [(0, motion.acceleration)]
    if motion.vertical is not None:
        components.append((1, motion.vertical))
    for axis, acceleration in components:
        ground = np.interp(time, sample, acceleration, right=0.0)
        path = displacement[:, :, axis] @ chain.mass
        work[1:] -= np.cumsum(0.5 * (ground[1:] + ground[:-1]) * np.diff(path))
    surplus = kinetic + potential - work
    return float(np.max(surplus - np.minimum.accumulate(surplus))) / largest


def drift(displacement: Array) -> float:
    """Largest displacement of a chain that ought to be at rest [m].

    Parameters
    ----------
    displacement : ndarray, (n_time, n_voussoir, 2) [m]
    """
    return float(np.max(np.hypot(displacement[..., 0], displacement[..., 1]), initial=0.0))
