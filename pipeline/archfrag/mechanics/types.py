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


class Options(NamedTuple):
    """What every method is told; each uses what concerns it."""

    time_step: float  # [s]
    tolerance: float  # relative error allowed by methods with step control [1]
    follow: float  # how long to go on past the end of the ground motion [s]
    max_steps: int  # bound on the work of one run
    loss_limit: float  # gap at both corners, over joint length, that counts as lost contact [1]
    check_interval: int  # steps between measurements of the contact residual
    frame_interval: float  # least time between frames of the history [s]


class Frames(NamedTuple):
    """Room for a history; empty arrays where none is wanted."""

    time: np.ndarray  # (n_frame,) [s]
    position: np.ndarray  # (n_frame, n_body, 3) displacement from rest: x, y [m], rotation [rad]
    velocity: np.ndarray  # (n_frame, n_body, 3) relative to the ground [m/s], [rad/s]
    reaction: np.ndarray  # (n_frame, n_joint, 3) force [N] and moment about the joint [N m]
    mode: np.ndarray  # (n_frame, n_joint) contact mode


class Outcome(NamedTuple):
    """What every method returns."""

    status: int  # archfrag.mechanics.status.Status
    end_time: float  # [s]
    collapse_time: float  # [s]; nan if none
    collapse_joint: int  # -1 if none
    collapse_mode: int  # archfrag.mechanics.status.CollapseMode
    peak_rotation: float  # [rad]
    peak_displacement: float  # of any centroid [m]
    rest_time: float  # [s] of simulated time at rest
    moving_time: float  # [s] of simulated time on all voussoirs
    steps: int
    iterations: int  # linear problems solved
    paths: int  # contact problems that needed the solution path
    compliant: int  # contact problems solved with compliant joints
    shortened: int  # steps halved because their contact problem was not solved
    impacts: int
    openings: int
    slides: int
    contact_losses: int
    rests: int
    residual: float  # largest contact residual measured [1]
    largest_kinetic: float  # [J]
    ground_work: float  # done by the inertia forces of the ground motion [J]
    potential: float  # gained in gravity [J]
    kinetic: float  # at the end [J]
    friction_work: float  # [J]; not positive
    impact_work: float  # [J]; not positive
    stray_work: float  # done by contacts that should do none: the integrator's error [J]
    stray_peak: float  # largest magnitude that stray_work had on the way [J]
    frames: int  # frames written
