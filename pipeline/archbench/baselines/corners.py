"""A step of contact dynamics with two contacts at each joint, as general codes for bodies have it.

Shared by `gauss_seidel` and `quadratic_programme`, which are `archfrag.physics.steps` with
equal steps but for the contact problem: a closed joint has a contact at each of its corners, each
with a normal and a tangential impulse, four unknowns where three suffice; and how it is solved.

The scheme is Moreau's (1988, CISM 302; Jean 1999, *Comput. Methods Appl. Mech. Engrg.* 177):
contacts are looked for half a step after the velocities, and Signorini's law holds on velocities.
A corner that touches may not approach, one that is open by a gap g may close by no more than g in
a step (the inelastic quasi-shock law of Dubois and Jean). Impacts are inelastic, Jean's theta is
1/2. Where two vertices meet, the contact has one normal, halfway between those of the two faces.
"""

from typing import NamedTuple

import numpy as np

from archbench.baselines.common import Case, case_of, end_at_rest, stands, write_rows
from archfrag.physics.contact.laws import MINUS, PLUS
from archfrag.physics.contact.placing import (
    AFTER,
    BEFORE,
    COINCIDENT,
    relative_velocity,
)
from archfrag.physics.ground import Grounds, end_of_motion, impulse_between
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.state import Clock, Model
from archfrag.physics.status import Count
from archfrag.physics.steps.service import accept_recorded, go_on, measure_state
from archfrag.physics.steps.step import free_fall, go_to_middle

# Speed over that of a fall through the longest joint below which the chain may be at rest, and
# for how long after the record it is [s]: impulses are only as good as the tolerance of their
# solver, and corners that have landed open by as much as a step's rotation.
STILL = 1e-5
REST_SPAN = 0.25


@struct()
class Corners(NamedTuple):
    """Two contacts at each joint; coordinates are those of the bodies before and after it."""

    inverse: np.ndarray  # (n_joint, 6) inverse masses and inertias
    row: (
        np.ndarray
    )  # (n_joint, 2, 2, 6) corner; parting, tangential velocity, by coordinate
    gap: np.ndarray  # (n_joint, 2) negative: overlap [m]
    bias: np.ndarray  # (n_joint, 2) gap that may close, over the step [m/s]
    impulse: (
        np.ndarray
    )  # (n_joint, 2, 2) corner; normal, tangential on the body after [N s]
    slide: (
        np.ndarray
    )  # (n_joint, 2) sense of the friction along the tangent, zero: sticks
    moved: np.ndarray  # (1,) when a body was too fast for rest last [s]


def new_corners(model: Model) -> Corners:
    """Contacts without impulses."""
    n_joint = model.friction.size
    inverse = np.stack(
        [model.inverse_mass, model.inverse_mass, model.inverse_inertia], axis=1
    )
    gap, bias, slide = np.zeros((3, n_joint, 2))
    return Corners(
        inverse=np.hstack([inverse[:n_joint], inverse[1 : n_joint + 1]]),
        row=np.zeros((n_joint, 2, 2, 6)),
        gap=gap,
        bias=bias,
        impulse=np.zeros((n_joint, 2, 2)),
        slide=slide,
        moved=np.zeros(1),
    )


def corner_case(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Case:
    """A case whose chain may rest as soon as solvers let it."""
    case = case_of(chain, grounds, factor, from_rest, options, frames, log)
    still = STILL * float(np.sqrt(case.model.gravity * case.model.length.max()))
    return case._replace(options=case.options._replace(still=still))


@kernel
def pose_corners(case, corners):
    """Contacts in the middle of the next step, and the velocities of bodies without them."""
    model = case.model
    state = case.state
    work = case.work
    time = state.clock[Clock.TIME]
    step = state.clock[Clock.STEP]
    impulse = impulse_between(case.grounds, state.clock, time, time + step)
    free_fall(model, state, work, impulse, step)
    go_to_middle(model, state, work, step)
    for j in range(state.slip.size):
        unslipped = abs(work.slip[j]) <= COINCIDENT * model.length[j]
        for k in range(2):
            if unslipped:
                for c in range(2):
                    work.side_normal[j, k, PLUS, c] = work.normal[j, c]
                    work.side_normal[j, k, MINUS, c] = work.normal[j, c]
            nx = work.side_normal[j, k, PLUS, 0]
            ny = work.side_normal[j, k, PLUS, 1]
            dx = work.face[j, AFTER, k, 0] - work.face[j, BEFORE, k, 0]
            dy = work.face[j, AFTER, k, 1] - work.face[j, BEFORE, k, 1]
            corners.gap[j, k] = nx * dx + ny * dy
            corners.bias[j, k] = max(corners.gap[j, k], 0.0) / step
            px = work.point[j, k, 0]
            py = work.point[j, k, 1]
            write_rows(j, nx, ny, px, py, work.position, corners.row[j, k])
    return impulse


@kernel
def gather_joints(case, corners):
    """Reactions about the pivots and contact modes from the impulses of a solved step."""
    work = case.work
    for j in range(work.slide.size):
        for c in range(3):
            work.reaction[j, c] = 0.0
        for k in range(2):
            nx = work.side_normal[j, k, PLUS, 0]
            ny = work.side_normal[j, k, PLUS, 1]
            normal = corners.impulse[j, k, 0]
            tangential = corners.impulse[j, k, 1]
            fx = normal * nx - tangential * ny
            fy = normal * ny + tangential * nx
            px = work.point[j, k, 0] - work.pivot[j, 0]
            py = work.point[j, k, 1] - work.pivot[j, 1]
            work.reaction[j, 0] += fx
            work.reaction[j, 1] += fy
            work.reaction[j, 2] += px * fy - py * fx
        at_0 = work.contact[j, 0] > 0.5
        at_1 = work.contact[j, 1] > 0.5
        first = corners.slide[j, 0] if at_0 else corners.slide[j, 1]
        second = corners.slide[j, 1] if at_1 else first
        work.slide[j] = first if (at_0 or at_1) and first == second else 0.0
    relative_velocity(case.model, work.position, work.solved, work.pivot, work.relative)


@kernel
def accept_corners(case, corners, impulse, converged):
    """Make a step whose contact problem is solved, and leave in the clock how it goes on."""
    model = case.model
    state = case.state
    options = case.options
    gather_joints(case, corners)
    collapsed, broken = accept_recorded(case, impulse, case.output)
    if not converged:
        state.count[Count.UNCONVERGED] += 1.0
        measure_state(model, state, case.work)
    until = end_of_motion(case.grounds, state.clock, options.follow)
    go_on(case, until, (True, False, collapsed, broken))
    if stands(state, options, until, corners.moved, REST_SPAN) and not (
        collapsed or broken
    ):
        end_at_rest(state, case.output)
