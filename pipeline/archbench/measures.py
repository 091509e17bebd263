"""Measures outside every method: of a motion, whoever computed it, by the laws alone.

Arrays in all of them: time (n_time,) [s]; displacement and velocity (n_time, n_voussoir, 2) [m],
[m/s]; rotation and angular_velocity (n_time, n_voussoir) [rad], [rad/s]. Energies are over the
largest kinetic energy of the run, overlaps and jumps over the joint's length.
"""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from archbench.scene import Array, means_between
from archfrag.arch import Arch
from archfrag.motions.motion import Motion

LASTING = 4  # intervals between frames that a gain of energy lasts, if it is one


def joint_faces(
    arch: Arch, displacement: Array, rotation: Array
) -> tuple[Array, Array]:
    """Corners of the faces before and after every joint."""
    chain = arch.chain
    n_body = arch.n_voussoir
    cos = np.cos(rotation)
    sin = np.sin(rotation)
    matrix = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    place = (chain.centroid + displacement)[:, :, None]
    shape = (len(rotation), arch.n_joint, 2, 2)
    before = np.broadcast_to(chain.face_before, shape).copy()
    after = np.broadcast_to(chain.face_after, shape).copy()
    for faces, first in ((before, 1), (after, 0)):
        own = faces[0, first : n_body + first]
        rotated = np.einsum("tbij,bcj->tbci", matrix[:, : len(own)], own)
        faces[:, first : n_body + first] = place[:, : len(own)] + rotated
    return before, after


def overlap_depth(before: Array, after: Array) -> Array:
    """How deep the bodies on both sides of a joint are inside each other.

    The deepest point of one face behind the other, between the other's ends, or the same with
    faces exchanged where that is less; at most the width in which the faces face each other.
    """
    least = np.full(before.shape[:-2], np.inf)
    for face, other, sense in ((before, after, 1.0), (after, before, -1.0)):
        span = face[..., 1, :] - face[..., 0, :]
        length = np.hypot(span[..., 0], span[..., 1])[..., None]
        arm = other - face[..., :1, :]
        x = span[..., None, 0] / length
        y = span[..., None, 1] / length
        place = arm[..., 0] * x + arm[..., 1] * y
        depth = sense * (arm[..., 1] * x - arm[..., 0] * y)
        within = np.clip(place, 0.0, length)
        width = np.abs(within[..., 1] - within[..., 0])
        run = place[..., 1] - place[..., 0]
        slope = (depth[..., 1] - depth[..., 0]) / np.where(run == 0.0, np.inf, run)
        behind = depth + slope[..., None] * (within - place)
        least = np.minimum(least, np.minimum(behind.max(axis=-1), width))
    return np.maximum(least, 0.0)


def overlaps(arch: Arch, displacement: Array, rotation: Array) -> Array:
    """`overlap_depth` of all joints over the shorter of their faces, (n_time, n_joint) [1]."""
    faces = np.stack([arch.chain.face_before, arch.chain.face_after])
    shorter = np.linalg.norm(faces[:, :, 1] - faces[:, :, 0], axis=2).min(axis=0)
    return overlap_depth(*joint_faces(arch, displacement, rotation)) / shorter


def overlap(arch: Arch, displacement: Array, rotation: Array) -> float:
    """Deepest overlap of neighbours at any joint and instant, over the joint's length [1]."""
    return float(overlaps(arch, displacement, rotation).max(initial=0.0))


def energy_gain(
    arch: Arch,
    motion: Motion,
    time: Array,
    displacement: Array,
    velocity: Array,
    angular_velocity: Array,
) -> float:
    """Largest rise of mechanical energy that the ground's work does not explain.

    That work is minus mass times ground acceleration over the displacement between frames, of all
    voussoirs. Contacts can only take energy, so that what rises was made by the method.
    """
    kinetic = kinetic_energy(arch.chain, velocity, angular_velocity)
    return _largest_rise(
        kinetic + _surplus_of_place(arch, motion, time, displacement), kinetic
    )


def path_energy_gain(
    arch: Arch, motion: Motion, time: Array, displacement: Array, rotation: Array
) -> float:
    """The same as `energy_gain` from positions alone.

    Velocities are differences between frames. An interval with an impact in it has too little
    kinetic energy, one with a jump of the ground's acceleration a little too much: dips and peaks
    of less than `LASTING` intervals do not count.
    """
    distinct = np.append(True, np.diff(time) > 1e-9)
    time = time[distinct]
    displacement = displacement[distinct]
    rotation = rotation[distinct]
    if time.size <= 5 * LASTING:
        return 0.0
    span = np.diff(time)
    velocity = np.diff(displacement, axis=0) / span[:, None, None]
    kinetic = kinetic_energy(
        arch.chain, velocity, np.diff(rotation, axis=0) / span[:, None]
    )
    place = _surplus_of_place(arch, motion, time, displacement)
    surplus = kinetic + 0.5 * (place[1:] + place[:-1])
    bridged = _over(np.min, _over(np.max, surplus))
    return _largest_rise(_over(np.max, _over(np.min, bridged)), _over(np.min, kinetic))


def _over(extreme: Callable[..., Array], values: Array) -> Array:
    return extreme(sliding_window_view(values, LASTING), axis=1)


def kinetic_energy(chain, velocity: Array, angular_velocity: Array) -> Array:
    """Of all voussoirs at each instant [J]."""
    kinetic = 0.5 * np.sum(chain.mass[:, None] * velocity**2, axis=(1, 2))
    return kinetic + 0.5 * angular_velocity**2 @ chain.inertia


def _surplus_of_place(
    arch: Arch, motion: Motion, time: Array, displacement: Array
) -> Array:
    """Potential energy less the work of the ground [J]."""
    path = np.einsum("tbi,b->ti", displacement, arch.chain.mass)
    surplus = arch.chain.gravity * path[:, 1]
    for axis, acceleration in enumerate((motion.acceleration, motion.vertical)):
        if acceleration is not None:
            means = means_between(time, acceleration, motion.dt)
            surplus[1:] += np.cumsum(means * np.diff(path[:, axis]))
    return np.asarray(surplus)


def _largest_rise(surplus: Array, kinetic: Array) -> float:
    largest = float(kinetic.max(initial=0.0))
    if largest == 0.0:
        return 0.0
    rise = surplus - np.minimum.accumulate(surplus)
    return float(rise.max(initial=0.0)) / largest
