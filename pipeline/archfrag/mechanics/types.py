"""Arrays that kernels take and return: constant Chain and Motion, changing State arrays."""

from typing import NamedTuple

import numpy as np


class Chain(NamedTuple):
    """Rigid bodies in a row, each touching its neighbours and the ground along straight joints.

    Joint ``j`` lies between body ``j - 1`` and body ``j``; body ``-1`` and body ``n_body`` are
    the ground. A chain with a free end has ``n_body`` joints, any other ``n_body + 1``.
    Face corners are given in the frame of the body they belong to (origin at its centroid, axes
    as at rest); those of the ground in the ground's frame. Corner 0 is the intrados, 1 the
    extrados; the tangent of a joint runs from corner 0 to corner 1 and its normal from body
    ``j - 1`` to body ``j``: the tangent is the normal turned by +90 degrees.
    """

    mass: np.ndarray  # (n_body,) [kg]
    inertia: np.ndarray  # (n_body,) about the centroid [kg m2]
    centroid: np.ndarray  # (n_body, 2) at rest, ground frame [m]
    face_before: np.ndarray  # (n_joint, 2, 2) corner, xy: face on body j - 1 [m]
    face_after: np.ndarray  # (n_joint, 2, 2) corner, xy: face on body j [m]
    friction: np.ndarray  # (n_joint,) Coulomb coefficient; inf: no sliding [1]
    gravity: float  # [m/s2]


class GroundMotion(NamedTuple):
    """Ground acceleration, linear between samples and zero outside them."""

    horizontal: np.ndarray  # (n_sample,) [m/s2]
    vertical: np.ndarray  # (n_sample,) upwards [m/s2]; all zero if there is none
    time_step: float  # [s]
