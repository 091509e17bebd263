"""Types that methods take and return: chain, options, histories, results."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from archfrag.physics.kernels.structs import struct


@struct()
class Chain(NamedTuple):
    """Rigid bodies that touch their neighbours and the ground along straight joints.

    Joint ``j`` lies between the bodies ``body[j]``: without a table in a row between body
    ``j - 1`` and body ``j``, where body ``-1`` and body ``n_body`` are the ground. A row with a
    free end has ``n_body`` joints, any other ``n_body + 1``. A bridge of several spans is a row
    from the left to the right base, the spine, and a row below each top course of an inner pier.
    Joints and bodies of piers come first, from left to right and each from its base upwards;
    top courses belong to the spine.
    Face corners are given in the frame of the body they belong to (origin at its centroid, axes
    as at rest); those of the ground in the ground's frame. Corner 0 is the intrados, 1 the
    extrados; the tangent of a joint runs from corner 0 to corner 1 and its normal from the
    body before to the body after: the tangent is the normal rotated by +90 degrees.
    """

    mass: ndarray  # (n_body,) [kg]
    inertia: ndarray  # (n_body,) about the centroid [kg m2]
    centroid: ndarray  # (n_body, 2) at rest, ground frame [m]
    face_before: ndarray  # (n_joint, 2, 2) corner, xy: face on the body before [m]
    face_after: ndarray  # (n_joint, 2, 2) corner, xy: face on the body after [m]
    friction: (
        ndarray  # (n_joint,) Coulomb coefficient; inf: the limit of large friction [1]
    )
    gravity: float  # [m/s2]
    # (n_body, 3) where a run begins: centroids [m] and rotations; None: as built
    start: ndarray | None = None
    # (n_tie, len(Tie)) with the columns of archfrag.physics.status.Tie; None: no ties
    tie: ndarray | None = None
    # (n_joint, len(Joint)) with the columns of archfrag.physics.status.Joint, if joints give; None
    # if they are rigid
    joint: ndarray | None = None
    # (n_joint, 2) bodies before and after each joint, None: a row. -1 is the ground of the left
    # base, n_body and the next are those of the inner bases and last the right one
    body: ndarray | None = None


def pairs_of(n_joint: int, body: ndarray | None) -> ndarray:
    """Return the bodies before and after each joint, (n_joint, 2), of a `Chain.body`."""
    return np.add.outer(np.arange(n_joint), [-1, 0]) if body is None else body


@struct()
class Options(NamedTuple):
    """Options of all methods; a method ignores those that do not concern it."""

    time_step: float  # the shortest step, at impacts [s]
    tolerance: float  # relative error allowed by methods with step control [1]
    # relative error beyond which a run is refused, see archfrag.physics.shared.is_accurate [1]
    accuracy: float
    follow: float  # how long to go on past the end of the ground motion [s]
    max_steps: int  # bound on the work of one run
    loss_limit: (
        float  # gap at both corners, over joint length, that cannot be undone [1]
    )
    check_interval: int  # steps between measurements of the contact residual
    frame_interval: float  # least time between frames of the history [s]
    crowding: (
        float  # mean time between events below which all voussoirs are stepped [s]
    )
    # the largest step, between impacts [s]; if it is not above `time_step`, all steps are equal
    largest_step: float = 0.0
    # What follows from these and the arch; see `archfrag.physics.shared.ready`.
    still: float = 0.0  # speed below which the chain may be at rest [m/s]
    # speed below which contacts may hold a chain that is not to rest [m/s]; -1 if `rests`
    held: float = -1.0
    rest_plus: float = (
        np.nan
    )  # range of rest of the chain in its own geometry [g]; nan: not known
    rest_minus: float = np.nan
    rests: bool = True  # whether a chain rests wherever admissible reactions exist
    # steps that a run may take besides those in proportion to its duration
    first_steps: float = 1000.0


@struct()
class Frames(NamedTuple):
    """Buffers for a history; empty arrays where none is wanted."""

    time: ndarray  # (n_frame,) [s]
    position: (
        ndarray  # (n_frame, n_body, 3) displacement from rest: x, y [m], rotation [rad]
    )
    velocity: ndarray  # (n_frame, n_body, 3) relative to the ground [m/s], [rad/s]
    reaction: ndarray  # (n_frame, n_joint, 3) force [N]; moment about the pivot [N m]
    mode: ndarray  # (n_frame, n_joint) contact mode from then on


@struct()
class MechanismLog(NamedTuple):
    """Buffers for the history of the mechanism, one entry for each change; empty for no history.

    Entry i holds from ``time[i]`` until the next entry. Entries beyond the buffer are counted in
    ``Count.LOG_ENTRIES`` but not kept.
    """

    time: ndarray  # (n_entry,) [s]
    cause: ndarray  # (n_entry,) int8: archfrag.physics.status.Cause of the change
    joint: ndarray  # (n_entry,) int32: the joint that caused it; -1 where none did
    model: ndarray  # (n_entry,) int8: archfrag.physics.status.Level from then on
    mode: ndarray  # (n_entry, n_joint) int8: contact modes from then on


@struct()
class Outcomes(NamedTuple):
    """Outcomes of runs, a row for each; every method returns them."""

    status: ndarray  # (n_run,) archfrag.physics.status.Status
    end_time: ndarray  # (n_run,) [s]
    collapse_time: ndarray  # (n_run,) [s]; nan if none
    collapse_joint: ndarray  # (n_run,); -1 if none
    collapse_mode: ndarray  # (n_run,) archfrag.physics.status.CollapseMode
    loss: ndarray  # (n_run, len(Loss)) with the columns of archfrag.physics.status.Loss
    # (n_run, len(Count)) with the columns of archfrag.physics.status.Count
    count: ndarray  # type: ignore[assignment]
    energy: ndarray  # (n_run, len(Energy)) [J]
    model_time: ndarray  # (n_run, len(Level)) time simulated at each level [s]
    peak: ndarray  # (n_run, len(Peak))
