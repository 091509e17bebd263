"""The account of a run: energies, counts, peaks, frames and the log of the mechanism."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.energy import kinetic_energy, potential_energy
from archfrag.mechanics.laws import OPEN, STICK, is_closed, slip_of, touches
from archfrag.mechanics.status import Cause, Count, Energy, Peak
from archfrag.mechanics.types import Ledger

BY_HINGE, BY_SLIDE, BY_STICK = int(Cause.HINGE), int(Cause.SLIDE), int(Cause.STICK)
BY_IMPACT, BY_LOSS = int(Cause.IMPACT), int(Cause.LOSS)
# Steps of a run need one or a few linear problems each; so many on average are no progress.
ITERATIONS_PER_STEP = 16
N_COUNT = len(Count)
N_ENERGY = len(Energy)
N_MODEL = 4
N_PEAK = len(Peak)


@allocating
def new_ledger():
    """An account with nothing in it yet.

    Returns
    -------
    Ledger
    """
    return Ledger(
        np.zeros(N_COUNT, np.int64), np.zeros(N_ENERGY), np.zeros(N_MODEL), np.zeros(N_PEAK)
    )


@kernel
def book_state(chain, position, velocity, start_potential, ledger):
    """Energies of a state.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    position, velocity : ndarray, (n_body, 3)
        At one instant.
    start_potential : float
        Potential energy at the beginning [J].
    ledger : Ledger
        Kinetic and potential energy are overwritten.
    """
    energy = ledger.energy
    energy[Energy.KINETIC] = kinetic_energy(chain.mass, chain.inertia, velocity)
    energy[Energy.POTENTIAL] = potential_energy(chain.mass, chain.gravity, position)
    energy[Energy.POTENTIAL] -= start_potential
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], energy[Energy.KINETIC])


@kernel
def close_account(chain, position, velocity, start_potential, ledger):
    """Energies of a state, and as stray work what of them no law explains.

    For methods that do not follow stray work from step to step; arguments as `book_state`.
    """
    book_state(chain, position, velocity, start_potential, ledger)
    energy = ledger.energy
    explained = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
    change = energy[Energy.KINETIC] - energy[Energy.START_KINETIC] + energy[Energy.POTENTIAL]
    energy[Energy.STRAY] = change - explained
    energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(energy[Energy.STRAY]))


@kernel
def book_work(friction, impact, stray, ledger):
    """Works of all joints over one step [J].

    An impact at one joint and the friction that it causes at others belong together: only what
    both give in sum is the integrator's error, and booked as stray work.
    """
    energy = ledger.energy
    if friction + impact > 0.0:
        stray += friction + impact
    else:
        energy[Energy.FRICTION] += friction
        energy[Energy.IMPACT] += impact
    energy[Energy.STRAY] += stray
    energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(energy[Energy.STRAY]))


@kernel
def book_motion(chain, position, velocity, length, ledger):
    """Peaks of displacement, rotation and kinetic energy.

    Parameters
    ----------
    length : float
        By which rotations are multiplied to compare them with velocities [m].

    Returns
    -------
    float
        Largest speed of any body [m/s]; nan where a position is not finite.
    """
    fastest = 0.0
    energy, peak = ledger.energy, ledger.peak
    farthest = 0.0
    for i in range(position.shape[0]):
        dx = position[i, 0] - chain.centroid[i, 0]
        dy = position[i, 1] - chain.centroid[i, 1]
        shift = dx * dx + dy * dy
        if not np.isfinite(shift + position[i, 2]):
            return np.nan
        farthest = max(farthest, shift)
        peak[Peak.ROTATION] = max(peak[Peak.ROTATION], abs(position[i, 2]))
        speed = abs(velocity[i, 0]) + abs(velocity[i, 1])
        fastest = max(fastest, speed, length * abs(velocity[i, 2]))
    peak[Peak.DISPLACEMENT] = max(peak[Peak.DISPLACEMENT], np.sqrt(farthest))
    kinetic = kinetic_energy(chain.mass, chain.inertia, velocity)
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    return fastest


@kernel
def exhausted(ledger, options):
    """Whether a run has used up its work: steps, or linear contact problems on all voussoirs."""
    if ledger.count[Count.STEPS] >= options.max_steps:
        return True
    return ledger.count[Count.ITERATIONS] >= ITERATIONS_PER_STEP * options.max_steps


@kernel
def makes_contact(old, new):
    """Whether a joint touches in the mode `new` at a corner where it did not in `old`."""
    at_0 = touches(new, 0) and not touches(old, 0)
    return at_0 or (touches(new, 1) and not touches(old, 1))


@kernel
def book_changes(old, new, ledger):
    """Count what joints did in a step, and name the gravest.

    Parameters
    ----------
    old, new : ndarray, (n_joint,) int8
        Contact modes before and after.
    ledger : Ledger

    Returns
    -------
    cause : int
        archfrag.mechanics.status.Cause; -1 if no mode changed.
    joint : int
        Where; -1 if nowhere.
    """
    count = ledger.count
    cause, joint, gravest = -1, -1, -1
    for j in range(old.size):
        if new[j] == old[j]:
            continue
        made = makes_contact(old[j], new[j])
        count[Count.IMPACTS] += made
        count[Count.OPENINGS] += makes_contact(new[j], old[j])
        slides = slip_of(new[j]) != STICK
        count[Count.SLIDES] += slides and slip_of(old[j]) == STICK
        count[Count.LOSSES] += new[j] == OPEN
        if new[j] == OPEN:
            this, grave = BY_LOSS, 5
        elif made:
            this, grave = BY_IMPACT, 4
        elif is_closed(old[j]) and not is_closed(new[j]):
            this, grave = BY_HINGE, 3
        elif slides:
            this, grave = BY_SLIDE, 2
        else:
            this, grave = BY_STICK, 1
        if grave > gravest:
            cause, joint, gravest = this, j, grave
    return cause, joint


@kernel
def log_change(log, ledger, time, cause, joint, model, mode):
    """Note a change of the mechanism or of its model, if there is room for it."""
    entry = ledger.count[Count.LOG_ENTRIES]
    ledger.count[Count.LOG_ENTRIES] += 1
    if entry >= log.time.size:
        return
    log.time[entry] = time
    log.cause[entry] = cause
    log.joint[entry] = joint
    log.model[entry] = model
    for j in range(mode.size):
        log.mode[entry, j] = mode[j]


@kernel
def write_frame(frames, ledger, time, chain, position, velocity, reaction, mode, span):
    """Write a frame of the history if there is room, and count it.

    Parameters
    ----------
    frames : archfrag.mechanics.types.Frames
    ledger : Ledger
    time : float [s]
    chain : archfrag.mechanics.types.Chain
    position, velocity : ndarray, (n_body, 3)
    reaction : ndarray, (n_joint, 3)
    mode : ndarray, (n_joint,) int8
    span : float
        What reactions are divided by: one, or the span of a step whose impulses they are [s].
    """
    n = ledger.count[Count.FRAMES]
    if n >= frames.time.size:
        return
    ledger.count[Count.FRAMES] += 1
    frames.time[n] = time
    for i in range(position.shape[0]):
        frames.position[n, i, 0] = position[i, 0] - chain.centroid[i, 0]
        frames.position[n, i, 1] = position[i, 1] - chain.centroid[i, 1]
        frames.position[n, i, 2] = position[i, 2]
        for c in range(3):
            frames.velocity[n, i, c] = velocity[i, c]
    for j in range(mode.size):
        for c in range(3):
            frames.reaction[n, j, c] = reaction[j, c] / span
        frames.mode[n, j] = mode[j]
