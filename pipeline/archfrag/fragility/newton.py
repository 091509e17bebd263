"""Newton's method for many convex losses at once."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.curve import FloatArray

Terms = tuple[FloatArray, FloatArray, FloatArray]
_ROUNDS, _HALVINGS = 200, 60
_CLOSE = 1e-11


def least(
    terms: Callable[[FloatArray, NDArray[np.intp]], Terms], start: FloatArray
) -> tuple[FloatArray, Terms]:
    """Where each loss is least, by steps that are halved until the loss does not grow.

    Parameters
    ----------
    terms : callable
        Of parameters (m, q) and the numbers of their fits (m,): loss (m,), inf where it is not
        defined, its gradient (m, q) and second derivatives (m, q, q).
    start : ndarray, (n_fit, q)

    Returns
    -------
    (ndarray, (ndarray, ndarray, ndarray))
        Parameters (n_fit, q), and the terms there.
    """
    p = np.array(start, dtype=float)
    active = np.arange(len(p))
    here = terms(p, active)
    for _ in range(_ROUNDS):
        now = tuple(term[active] for term in here)
        step = _solve(now[2], now[1])
        trial = p[active] - step
        there = terms(trial, active)
        allowed = now[0] + 1e-12 * (1.0 + np.abs(now[0]))
        for _ in range(_HALVINGS):
            worse = np.flatnonzero(~(there[0] <= allowed))
            if not worse.size:
                break
            step[worse] *= 0.5
            trial[worse] = p[active[worse]] - step[worse]
            for old, new in zip(there, terms(trial[worse], active[worse]), strict=True):
                old[worse] = new
        p[active] = trial
        for old, new in zip(here, there, strict=True):
            old[active] = new
        active = active[(np.abs(step) > _CLOSE * (1.0 + np.abs(trial))).any(axis=1)]
        if not active.size:
            break
    return p, here


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of symmetric systems, (n, q); of two unknowns a flat direction is not followed."""
    if right.shape[1] != 2:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], dtype=np.float64)
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    determinant = np.maximum(a * c - b * b, 1e-300)
    u, v = right.T
    return np.stack([c * u - b * v, a * v - b * u], axis=1) / determinant[:, None]
