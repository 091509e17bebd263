"""What runs side by side share: the jobs, and a run that is taken out for a while."""

from typing import NamedTuple

import numpy as np

from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.primitives import LANES
from archfrag.physics.kernels.structs import struct


@kernel
def fetch_run(four, number, one):
    """Copy the state of one of four runs; tuples of arrays, (n, 4) and (n,).

    Reads: four.
    Writes: one.
    """
    for k in range(len(four)):
        for i in range(four[k].shape[0]):
            one[k][i] = four[k][i, number]


@kernel
def return_run(one, number, four):
    """Copy the state of a run back among four.

    Reads: one.
    Writes: four.
    """
    for k in range(len(one)):
        for i in range(four[k].shape[0]):
            four[k][i, number] = one[k][i]


@struct()
class Jobs(NamedTuple):
    """Many runs, and the numbers of those in progress."""

    motion: np.ndarray  # (n_run,) int64: which ground motion moves each
    factor: np.ndarray  # (n_run,) on it
    upcoming: np.ndarray  # (1,) int64: the next to start
    runs: np.ndarray  # (4,) int64: those in progress side by side; -1: none


def jobs_of(motion: np.ndarray, factor: np.ndarray) -> Jobs:
    """Return the jobs of many runs, none of them in progress."""
    of = np.ascontiguousarray(motion, np.int64), np.ascontiguousarray(factor, float)
    return Jobs(*of, np.zeros(1, np.int64), np.full(LANES, -1))
