"""A chain on penalty springs: what its steps share, its settlement and its critical step."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.collapse import JointState
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.delassus import Contacts
from archfrag.mechanics.kinematics import move_faces
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import (
    Chain,
    Frames,
    GroundMotion,
    Ledger,
    MechanismLog,
    Options,
)
from archfrag.methods.springs import (
    BAND,
    Springs,
    factorise,
    highest_frequency,
    press_joints,
    solve_factored,
    stiffness_matrix,
)

# Settlement: unbalanced force over the mean weight of a body; Newton's iterations; coefficient
# and steps of dynamic relaxation, where these do not settle it.
BALANCED = 1e-11
SETTLED = 1e-7
NEWTON_ROUNDS = 40
RELAXATION = 0.8
RELAXATION_STEPS = 400_000


class Clock(IntEnum):
    """Entries of ``Run.clock``."""

    TIME = 0  # of the positions [s]
    STEP = 1  # size of the next step [s]
    PREVIOUS = 2  # of the last one [s]
    NEXT_FRAME = 3  # when a frame of the history is due [s]
    START_ENERGY = 4  # potential and elastic energy at the beginning [J]
    SHAKE_X = 5  # mean ground acceleration about the last positions [m/s2]
    SHAKE_Y = 6
    RESTLESS = 7  # when a body was too fast for rest last, or the record's end [s]
    SHIFT = 8  # largest slip over length when the critical step was asked for last
    DAMPING = 9  # dashpots over springs [s]
    DISSIPATED = 10  # work of mass-proportional and local damping, not booked yet [J]
    MOST_STEPS = 11
    SCALE = 12  # weight of the chain times the length of its first joint [J]
    STILL = 13  # speed below which a body may be at rest [m/s]
    START_KINETIC = 14  # [J]


N_CLOCK = len(Clock)


class Settings(NamedTuple):
    """The method's own parameters; see the registry."""

    damping_stiffness: float
    mass_rate: float  # damping force over momentum [1/s]
    local_damping: float
    step_fraction: float


class Run(NamedTuple):
    """What all steps of a run share."""

    chain: Chain
    ground: GroundMotion
    options: Options
    settings: Settings
    springs: Springs
    joints: JointState
    ledger: Ledger
    frames: Frames
    log: MechanismLog
    impulse_x: np.ndarray  # (n_sample,) of the ground up to each sample [m/s]
    impulse_y: np.ndarray
    before: np.ndarray  # (n_joint, 2, 2) faces, where they were looked at last
    after: np.ndarray
    old: np.ndarray  # (n_body, 3) velocities half a step before the positions
    mean: np.ndarray  # (n_body, 3) and at their instant
    reaction: np.ndarray  # (n_joint, 3) about the pivots, as gathered last [N], [N m]
    pivot: np.ndarray  # (n_joint, 2) middles of the faces there [m]
    contacts: Contacts  # workspace
    relative: np.ndarray  # (n_joint, 3) workspace
    clock: np.ndarray  # (len(Clock),)


@inlined
def _damped(force, speed, coefficient):
    """Force less Cundall's local damping, which opposes motion by a part of the force."""
    if speed > 0.0:
        return force - coefficient * abs(force)
    if speed < 0.0:
        return force + coefficient * abs(force)
    return force


@kernel
def kick(run, velocity, shake_x, shake_y, span, local_damping):
    """Take velocities over the instant of the positions by all forces there.

    Parameters
    ----------
    run : Run
        Its springs hold the forces; `old` and `mean` are overwritten.
    velocity : ndarray, (n_body, 3)
        Before and after, half a step either way.
    shake_x, shake_y : float
        Ground acceleration [m/s2].
    span : float [s]
    local_damping : float

    Returns
    -------
    float
        Work of mass-proportional and local damping [J].
    """
    chain, total, old, mean = run.chain, run.springs.total, run.old, run.mean
    half = 0.5 * span * run.settings.mass_rate
    work = 0.0
    for i in range(velocity.shape[0]):
        fx = total[i, 0] - chain.mass[i] * shake_x
        fy = total[i, 1] - chain.mass[i] * (shake_y + chain.gravity)
        for k in range(3):
            force = fx if k == 0 else (fy if k == 1 else total[i, 2])
            mass = chain.inertia[i] if k == 2 else chain.mass[i]
            speed = velocity[i, k]
            damped = _damped(force, speed, local_damping)
            velocity[i, k] = ((1.0 - half) * speed + span * damped / mass) / (1.0 + half)
            old[i, k] = speed
            mean[i, k] = 0.5 * (speed + velocity[i, k])
            loss = damped - force - run.settings.mass_rate * mass * mean[i, k]
            work += loss * mean[i, k] * span
    return work


@inlined
def drift(position, velocity, step):
    """Move bodies, (n_body, 3) each, by their velocities for a step [s]; positions change."""
    for i in range(position.shape[0]):
        for k in range(3):
            position[i, k] += step * velocity[i, k]


@kernel
def _unbalanced(run):
    """Largest force on a body of a chain at rest, moments over joint length, per mean weight."""
    chain, total = run.chain, run.springs.total
    largest = weight = 0.0
    for i in range(chain.mass.size):
        weight += chain.mass[i] * chain.gravity
        vertical = total[i, 1] - chain.mass[i] * chain.gravity
        moment = total[i, 2] / run.springs.length[0]
        largest = max(largest, abs(total[i, 0]), abs(vertical), abs(moment))
    return largest * chain.mass.size / weight


@allocating
def _settle_by_newton(run, position):
    """Newton's iteration on the elastic equilibrium; True if it is found."""
    chain, springs = run.chain, run.springs
    n_body = chain.mass.size
    band, shift = np.empty((3 * n_body, BAND)), np.zeros((n_body, 3))
    for turn in range(NEWTON_ROUNDS):
        move_faces(chain, position, run.before, run.after)
        stiffness_matrix(chain, springs, position, run.before, run.after, turn == 0, band)
        if not factorise(band):
            return False
        for i in range(n_body):
            shift[i, 0], shift[i, 2] = springs.total[i, 0], springs.total[i, 2]
            shift[i, 1] = springs.total[i, 1] - chain.mass[i] * chain.gravity
        solve_factored(band, shift.reshape(3 * n_body))
        drift(position, shift, 1.0)
        press_joints(chain, springs, position, shift, 1.0, 0.0)
        if _unbalanced(run) < BALANCED:
            return True
    return False


@allocating
def settle(run, position, velocity):
    """Bring a chain at rest on unloaded springs to its equilibrium under its weight.

    Parameters
    ----------
    run : Run
    position, velocity : ndarray, (n_body, 3)
        Overwritten; velocities are left zero.

    Returns
    -------
    int
        Steps of dynamic relaxation that it took.
    """
    velocity[:] = 0.0
    steps = 0
    if not _settle_by_newton(run, position):
        step = run.clock[Clock.STEP]
        while steps < RELAXATION_STEPS and not _unbalanced(run) < SETTLED:
            kick(run, velocity, 0.0, 0.0, step, RELAXATION)
            drift(position, velocity, step)
            press_joints(
                run.chain, run.springs, position, velocity, step, run.clock[Clock.DAMPING]
            )
            steps += 1
    velocity[:] = 0.0
    press_joints(run.chain, run.springs, position, velocity, 0.0, 0.0)
    return steps


@allocating
def find_step(run, position):
    """Ask for the critical step of the present contacts; sets step and damping.

    Central differences with lagging dashpots are stable up to
    ``2 / omega (sqrt(1 + xi^2) - xi)`` at the highest frequency omega and its damping ratio xi
    (Belytschko, Liu and Moran 2000, *Nonlinear Finite Elements*, section 6.6).
    """
    clock, settings = run.clock, run.settings
    move_faces(run.chain, position, run.before, run.after)
    fastest = highest_frequency(run.chain, run.springs, position, run.before, run.after)
    if clock[Clock.DAMPING] == 0.0:
        clock[Clock.DAMPING] = 2.0 * settings.damping_stiffness / fastest
    ratio = 0.5 * clock[Clock.DAMPING] * fastest
    critical = 2.0 / fastest * (np.sqrt(1.0 + ratio * ratio) - ratio)
    nominal = run.options.time_step
    parts = np.ceil(nominal / (settings.step_fraction * critical))
    clock[Clock.STEP] = nominal / max(parts, 1.0)
    left = run.options.max_steps - clock[Clock.TIME] / nominal
    clock[Clock.MOST_STEPS] = run.ledger.count[Count.STEPS] + left * max(parts, 1.0)
    clock[Clock.SHIFT] = largest_slip(run.springs)


@kernel
def largest_slip(springs):
    """Largest slip of any joint up to now, over its length [1]."""
    largest = 0.0
    for j in range(springs.slip.size):
        largest = max(largest, abs(springs.slip[j]) / springs.length[j])
    return largest
