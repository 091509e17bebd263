"""What single runs write as they go: frames of the history and the log of the mechanism."""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.laws import closed_mode, corner_mode
from archfrag.mechanics.model import Clock
from archfrag.mechanics.status import Cause
from archfrag.mechanics.types import Frames, MechanismLog

# Changes of a joint's mode, the dominant one last.
BY_STICK, BY_SLIDE, BY_HINGE = int(Cause.STICK), int(Cause.SLIDE), int(Cause.HINGE)
BY_IMPACT, BY_LOSS = int(Cause.IMPACT), int(Cause.LOSS)


class Output(NamedTuple):
    """Where frames and log entries go; arrays of length zero for none."""

    frames: Frames
    log: MechanismLog
    written: np.ndarray  # (2,) int64: frames, and log entries, also those without place
    due: np.ndarray  # (1,) from when on the next frame is wanted [s]
    interval: float  # between frames [s]
    forces: np.ndarray  # (n_joint, 3) mean reactions over the last step, for frames
    span: np.ndarray  # (1,) of that step; zero where a motion begins [s]


def output_to(frames: Frames, log: MechanismLog, interval: float) -> Output:
    """An output that has nothing in it yet."""
    forces = np.zeros(frames.reaction.shape[1:])
    return Output(
        frames, log, np.zeros(2, np.int64), np.zeros(1), float(interval), forces, np.zeros(1)
    )


def no_output(n_body: int, n_joint: int) -> Output:
    """An output for runs without history."""
    frames = Frames(
        np.zeros(0), np.zeros((0, n_body, 3)), np.zeros((0, n_body, 3)),
        np.zeros((0, n_joint, 3)), np.zeros((0, n_joint), np.int8),
    )  # fmt: skip
    entries = np.zeros(0, np.int8), np.zeros(0, np.int32), np.zeros(0, np.int8)
    log = MechanismLog(np.zeros(0), *entries, np.zeros((0, n_joint), np.int8))
    return output_to(frames, log, np.inf)


@kernel
def mode_of(touch, slide, j):
    """Mode of a joint as archfrag.mechanics.laws counts them."""
    sense = int(slide[j])
    if touch[j, 0] > 0.5 and touch[j, 1] > 0.5:
        return closed_mode(sense)
    if touch[j, 0] > 0.5:
        return corner_mode(0, sense)
    return corner_mode(1, sense) if touch[j, 1] > 0.5 else 0


@kernel
def write_frame(model, state, work, output):
    """Write a frame of the present state with the forces in ``work.reaction``, and count it."""
    frames, n = output.frames, output.written[0]
    if frames.time.size == 0 or n >= frames.time.size:
        return
    output.written[0] += 1
    frames.time[n] = state.clock[Clock.TIME]
    for i in range(frames.position.shape[1]):
        frames.position[n, i, 0] = state.position[i + 1, 0] - model.centroid[i + 1, 0]
        frames.position[n, i, 1] = state.position[i + 1, 1] - model.centroid[i + 1, 1]
        frames.position[n, i, 2] = state.position[i + 1, 2]
        for c in range(3):
            frames.velocity[n, i, c] = state.velocity[i + 1, c]
    for j in range(state.slip.size):
        for c in range(3):
            frames.reaction[n, j, c] = work.reaction[j, c]
        frames.mode[n, j] = mode_of(work.touch, work.slide, j)


@kernel
def write_if_due(model, state, work, output):
    """Frame of the instant from which a solved step sets out, before it is made.

    Reactions act at the middles of steps; those of the instant lie between them.
    """
    clock, frames, n = state.clock, output.frames, output.written[0]
    if frames.time.size == 0 or clock[Clock.TIME] < output.due[0]:
        return
    write_frame(model, state, work, output)
    output.due[0] = clock[Clock.TIME] + output.interval
    if n >= frames.time.size:
        return
    step, before = clock[Clock.STEP], output.span[0]
    part = before / (before + step)
    for j in range(state.slip.size):
        for c in range(3):
            force = work.reaction[j, c] / step
            frames.reaction[n, j, c] = output.forces[j, c] + part * (force - output.forces[j, c])
            if before == 0.0:
                frames.reaction[n, j, c] = force


@kernel
def keep_forces(work, step, output):
    """Keep the mean reactions of a step that has been made, for the frame after it."""
    if output.frames.time.size == 0:
        return
    output.span[0] = step
    for j in range(output.forces.shape[0]):
        for c in range(3):
            output.forces[j, c] = work.reaction[j, c]


@kernel
def log_change(state, time, cause, joint, rung, output):
    """Note a change of the mechanism, or of its model, if there is place for it."""
    log, entry = output.log, output.written[1]
    output.written[1] += 1
    if entry >= log.time.size:
        return
    log.time[entry] = time
    log.cause[entry] = cause
    log.joint[entry] = joint
    log.model[entry] = rung
    for j in range(state.slip.size):
        log.mode[entry, j] = mode_of(state.touch, state.slide, j)


@kernel
def dominant_change(state, work):
    """What joints do in a solved step, before it is made; cause, joint."""
    cause, joint, rank = -1, -1, 0
    for j in range(state.slip.size):
        was = state.touch[j, 0] + state.touch[j, 1]
        now = work.touch[j, 0] + work.touch[j, 1]
        made = work.touch[j, 0] > state.touch[j, 0] or work.touch[j, 1] > state.touch[j, 1]
        changed = made or now != was or work.slide[j] != state.slide[j]
        if not changed:
            continue
        if now == 0.0:
            this, own = BY_LOSS, 5
        elif made:
            this, own = BY_IMPACT, 4
        elif was == 2.0 and now < 2.0:
            this, own = BY_HINGE, 3
        elif work.slide[j] != 0.0:
            this, own = BY_SLIDE, 2
        else:
            this, own = BY_STICK, 1
        if own > rank:
            cause, joint, rank = this, j, own
    return cause, joint
