"""How long a run can be predicted: growth of a difference of 1e-9 in the ground's motion."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from archbench.quantities import lengths, positions_at
from archbench.scene import Array, Scene
from archbench.settings import Setting
from archbench.solve import Solution, solve

DIFFERENCE = 1e-9
REACHED = 1e-2  # of the thickness: the end of prediction
CONFIDENCE = 0.9
_FITTED = 24


def slope_interval(x: Array, y: Array) -> tuple[float, float, float]:
    """Least-squares slope and its interval at 90 % (Student's t); nan if points are missing."""
    if np.unique(x).size < 2:
        return math.nan, math.nan, math.nan
    fit = stats.linregress(x, y)
    half = math.nan
    if x.size > 2:
        half = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, x.size - 2) * fit.stderr)
    return float(fit.slope), float(fit.slope - half), float(fit.slope + half)


def growth_of(time: Array, distance: Array, thickness: float, onset: float) -> dict[str, float]:
    """Largest Lyapunov exponent over the motion, and when prediction ends."""
    with np.errstate(divide="ignore"):
        logarithm = np.mean(np.log(distance / thickness), axis=0)
    above = np.flatnonzero(logarithm >= math.log(REACHED))
    horizon = float(time[above[0]]) if above.size else math.inf
    used = np.flatnonzero(np.isfinite(logarithm) & (time > onset) & (time <= horizon))
    # A step of the ground's motion at the onset is no growth: the first tenth is left out.
    used = used[used.size // 10 :]
    fit = (math.nan,) * 3
    if used.size >= 3:
        picked = used[np.unique(np.linspace(0, used.size - 1, _FITTED).astype(int))]
        fit = slope_interval(time[picked], logarithm[picked])
    return dict(zip(("exponent", "low", "high", "horizon"), (*fit, horizon), strict=True))


def measure_growth(
    scene: Scene, setting: Setting, base: Solution, onset: float, end: float, pairs: int
) -> dict[str, float]:
    """`growth_of` runs beside a run, with the ground's motion scaled by 1 plus or minus 1e-9."""
    time = base.frames.time[base.frames.time <= end]
    middle, rows = positions_at(base.frames, time), []
    for k in range(pairs):
        factor = (1.0 if k % 2 == 0 else -1.0) * (1 + k // 2)
        beside = solve(scene, setting, history=True, scale=1.0 + factor * DIFFERENCE)
        rows.append(lengths(positions_at(beside.frames, time) - middle).max(axis=1) / abs(factor))
    return growth_of(time, np.array(rows), scene.thickness, onset)
