"""Frames of the history from the dense output of a step on few bodies."""

from archfrag.mechanics.acceleration import uniform_force
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.ledger import write_frame
from archfrag.mechanics.levels import FewBodies, spread
from archfrag.mechanics.mechanism import split_state
from archfrag.methods.few_bodies import dense_state, evaluate
from archfrag.methods.resolve import place_whole


@kernel
def record_state(chain, whole, joints, few, gx, gy, frames, ledger, time):
    """Write the frame of the state in ``few.new_position``; spoils the last evaluation."""
    if not evaluate(few, few.new_position, few.new_velocity, gx, gy):
        return
    for k in range(few.joint.size):
        joints.slip[few.joint[k]] = few.slip[k]
    split_state(
        whole.mechanism, few.new_position, few.new_velocity, whole.position, whole.velocity
    )
    place_whole(chain, whole, joints.slip, joints.mode)
    uniform_force(chain.mass.size, gx, gy, chain.gravity, whole.free)
    bodies = FewBodies(few.new_position, few.new_velocity, few.free, few.contacts, few.work)
    spread(chain, whole.mechanism, whole.contacts, whole.velocity, whole.free, bodies, whole.work)
    write_frame(
        frames, ledger, time, chain, whole.position, whole.velocity, whole.work.reaction,
        joints.mode, 1.0,
    )  # fmt: skip


@kernel
def record_step(
    chain, whole, joints, few, start, step, part, gx, sx, gy, sy, frames, interval, clock, ledger
):
    """Write the frames that are due in the first `part` of a step, from its dense output.

    Parameters
    ----------
    chain, whole, joints, few
        The whole chain, with room for it, and the few bodies after the step.
    start, step : float [s]
    part : float
    gx, sx, gy, sy : float
        Ground acceleration at the beginning of the step and its rate [m/s2], [m/s3].
    frames : Frames
    interval : float [s]
    clock : ndarray
        ``clock[3]`` is when the next frame is due.
    ledger : Ledger
    """
    # A frame due at the end is not left out by rounding.
    end = start + part * step + 1e-9 * interval
    while clock[3] <= end:
        theta = min((clock[3] - start) / step, part)
        dense_state(few, theta, few.new_position, few.new_velocity)
        later = theta * step
        record_state(
            chain, whole, joints, few, gx + sx * later, gy + sy * later, frames, ledger, clock[3]
        )
        clock[3] += interval
