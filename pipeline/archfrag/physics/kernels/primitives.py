"""Arithmetic of kernels on numbers of one run, or of several side by side.

A kernel written for a float runs for several runs at once where its arrays hold as many numbers in
each element (`LaneArray`): every lane gets the bits that a float would get. Nothing may branch on
such a number: `select` takes the place of ``if``, and what a lane must not do is masked.
``some(mask)`` is whether any lane asks for a piece of work, so that it can be left out where none
does. `archfrag.physics.kernels.lower` has the code for both; these functions are what Python does.
"""

import math

import numpy as np

LANES = (4, 8)  # numbers of runs that go side by side
_ALIGNMENT = 64


class LaneArray(np.ndarray):
    """Array of numbers of several runs, for kernels; see `lane_array` and `runs_of`."""


def lane_array(shape: tuple[int, ...], count: int = LANES[0]) -> LaneArray:
    """Return an array of zeros for `count` runs; `shape` is that of one run."""
    size = 8 * count * math.prod(shape)
    memory = np.zeros(size + _ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % _ALIGNMENT
    items = memory[start : start + size].view(np.dtype((np.void, 8 * count)))
    return items.reshape(shape).view(LaneArray)


def runs_of(array: np.ndarray) -> np.ndarray:
    """View a `LaneArray` as floats, with the lane as last dimension."""
    plain = array.view(np.ndarray).reshape(-1).view(np.float64)
    return plain.reshape((*array.shape, array.itemsize // 8))


def fused(x, y, z):
    """Return `x` times `y` plus `z`, rounded once if the processor can."""
    return x * y + z


def select(mask, x, y):
    """Return `x` where `mask` holds, else `y`; both are evaluated."""
    return x if mask else y


def some(mask):
    """Return whether `mask` holds in any run."""
    return mask


def opposite(mask):
    """Return the mask that holds where `mask` does not."""
    return not mask


def width(x):
    """Return for how many runs a number or mask stands."""
    return 1


def lane(x, number):
    """Return the number or truth value of run `number` in `x`."""
    return x


def with_lane(x, number, value):
    """Return `x` with `value` in run `number`."""
    return value
