"""Rest: which loads leave a chain at rest, and until when a ground motion does."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.contact.path import solve_anyhow
from archfrag.mechanics.contact.placing import clearance, place_contacts
from archfrag.mechanics.ground import end_rest, kick_between
from archfrag.mechanics.model import Clock
from archfrag.mechanics.onset import rest_limit
from archfrag.mechanics.status import Cause, Count
from archfrag.methods.common import ALL, CLOSED_GAP, GO, IDLE, log_change, write_frame

BY_START = int(Cause.START)


@kernel
def is_as_built(model, state):
    """Whether all joints are closed and none has slipped: the chain is in its own geometry."""
    for j in range(state.slip.size):
        if state.touch[j, 0] < 0.5 or state.touch[j, 1] < 0.5:
            return False
        if abs(state.slip[j]) > CLOSED_GAP * model.length[j]:
            return False
    return True


@allocating
def rest_range(model, state, work):
    """Load factors between which a configuration stays at rest; found, plus, minus."""
    place_contacts(model, state.slip, work.face, work.tangent, work)
    n_joint = state.slip.size
    candidate = np.ones((n_joint, 2), np.int8)
    for j in range(n_joint):
        for k in range(2):
            if clearance(j, k, work.face, work.tangent) > CLOSED_GAP * model.length[j]:
                candidate[j, k] = 0
    centroid = state.position[1:-1, :2].copy()
    found = np.ones(2, np.bool_)
    factor = np.zeros(2)
    for k in range(2):
        sense = 1.0 - 2.0 * k
        limit = rest_limit(
            model.mass[1:-1], centroid, work.point, work.normal, candidate, model.friction,
            model.gravity, sense,
        )  # fmt: skip
        found[k], factor[k] = limit.found, sense * limit.load_factor
    return found[0] and found[1], factor[0], factor[1]


@kernel
def start_moving(state, options, output):
    """Begin to step from the positions and velocities of a state."""
    clock = state.clock
    clock[Clock.STEP], clock[Clock.IMPACT] = options.time_step, -np.inf
    output.span[0] = 0.0
    for j in range(state.impact.size):
        state.impact[j] = 0.0
        for c in range(3):
            state.force[j, c] = 0.0


@kernel
def write_rest(model, grounds, state, work, path, output):
    """Frame of the chain at rest, with the reactions that balance the body force."""
    if output.frames.time.size == 0:
        return
    clock = state.clock
    place_contacts(model, state.slip, work.face, work.tangent, work)
    tiny = 1e-9 * grounds.time_step[int(clock[Clock.MOTION])]
    time = clock[Clock.TIME]
    kick = kick_between(grounds, clock, time - tiny, time + tiny)
    for i in range(1, state.position.shape[0] - 1):
        work.free[i, 0] = -kick.x / (2.0 * tiny)
        work.free[i, 1] = -kick.y / (2.0 * tiny) - model.gravity
        work.free[i, 2] = 0.0
        for c in range(3):
            work.position[i, c] = state.position[i, c]
    for j in range(state.slip.size):
        for k in range(2):
            work.bias[j, k, 0] = work.bias[j, k, 1] = 0.0
            work.candidate[j, k] = state.touch[j, k]
    count = state.count
    taken = count[Count.ITERATIONS], count[Count.PATHS], count[Count.COMPLIANT]
    solved, _ = solve_anyhow(model, state, work, path)
    # A history does not change what a run has taken.
    count[Count.ITERATIONS], count[Count.PATHS], count[Count.COMPLIANT] = taken
    if not solved:
        work.reaction[:] = 0.0
    write_frame(model, state, work, output)


@kernel
def rest_until_onset(model, grounds, state, options, plus, minus, output):
    """Let a chain rest until the ground motion moves it; returns the code."""
    clock = state.clock
    leave, for_good = end_rest(model, grounds, clock, plus, minus)
    clock[Clock.RESTING] += leave - clock[Clock.TIME]
    clock[Clock.TIME] = leave
    if for_good:
        return IDLE
    start_moving(state, options, output)
    output.due[0] = leave
    log_change(state, leave, BY_START, -1, ALL, output)
    return GO
