"""The account of a run: energies, counts, peaks, frames and the log of the mechanism."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.energy import kinetic_energy, potential_energy
from archfrag.mechanics.status import Count, Energy, Peak
from archfrag.mechanics.types import Ledger

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
def close_account(chain, position, velocity, start_potential, ledger):
    """Energies now, and what of them no law explains.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    position, velocity : ndarray, (n_body, 3)
    start_potential : float
        Potential energy at the beginning [J].
    ledger : Ledger
        Kinetic, potential and stray energy are overwritten.
    """
    energy = ledger.energy
    kinetic = kinetic_energy(chain.mass, chain.inertia, velocity)
    energy[Energy.KINETIC] = kinetic
    energy[Energy.POTENTIAL] = potential_energy(chain.mass, chain.gravity, position)
    energy[Energy.POTENTIAL] -= start_potential
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    explained = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
    energy[Energy.STRAY] = kinetic + energy[Energy.POTENTIAL] - explained
    energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(energy[Energy.STRAY]))


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
