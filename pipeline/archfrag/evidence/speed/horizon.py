"""How long a run can be foretold: growth of a difference of 1e-9, and spreads beyond it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from archfrag.evidence.run import Way, run_scene
from archfrag.evidence.scene import Scene
from archfrag.evidence.speed.quantities import positions_at
from archfrag.evidence.ways import clocked
from archfrag.simulation.response import Response

Array = NDArray[np.float64]

DIFFERENCE = 1e-9
REACHED = 1e-2  # of the thickness
CONFIDENCE = 0.9
_FITTED = 24


class Growth(NamedTuple):
    """Growth of a small difference.

    Attributes
    ----------
    exponent, low, high : float
        Largest Lyapunov exponent over the motion and its 90 % interval [1/s].
    horizon : float
        When a difference of 1e-9 reaches 1e-2 of the thickness [s]; infinite if not in the run.
    largest : float
        Largest distance in the run, over the thickness.
    """

    exponent: float
    low: float
    high: float
    horizon: float
    largest: float


def slope_interval(x: Array, y: Array, lost: int = 2) -> tuple[float, float, float]:
    """Least-squares slope and its interval at 90 % by Student's t.

    Parameters
    ----------
    x, y : ndarray, (n,)
    lost : int
        Degrees of freedom that the fit takes.

    Returns
    -------
    (slope, low, high)
        nan where there are too few points; the interval's ends are nan if it has no width.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.evidence.speed.horizon import slope_interval
    >>> slope, low, high = slope_interval(np.arange(4.0), np.array([0.0, 1.1, 1.9, 3.0]))
    >>> round(slope, 2), low < 1.0 < high
    (0.98, True)
    """
    spread = float(np.sum((x - x.mean()) ** 2)) if x.size else 0.0
    if x.size < 2 or spread == 0.0:
        return math.nan, math.nan, math.nan
    slope = float((x - x.mean()) @ (y - y.mean())) / spread
    free = x.size - lost
    if free < 1:
        return slope, math.nan, math.nan
    left = y - y.mean() - slope * (x - x.mean())
    error = math.sqrt(float(left @ left) / free / spread)
    half = error * float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, free))
    return slope, slope - half, slope + half


def growth_of(time: Array, distance: Array, thickness: float, onset: float) -> Growth:
    """Exponent and horizon from distances of neighbouring runs.

    Parameters
    ----------
    time : ndarray, (n_time,) [s]
    distance : ndarray, (n_pair, n_time) [m]
        Scaled to an initial difference of 1e-9.
    thickness : float [m]
    onset : float
        When motion begins [s].

    Returns
    -------
    Growth
        The fit is of the mean logarithm over the pairs on time, between the onset and the end of
        the run or the horizon, at 24 instants so that neighbours are little correlated.
    """
    relative = distance / thickness
    with np.errstate(divide="ignore"):
        logarithm = np.mean(np.log(relative), axis=0)
    above = np.flatnonzero(logarithm >= math.log(REACHED))
    horizon = float(time[above[0]]) if above.size else math.inf
    used = np.flatnonzero(np.isfinite(logarithm) & (time > onset) & (time <= horizon))
    largest = float(np.max(relative, initial=0.0))
    if used.size < 3:
        return Growth(math.nan, math.nan, math.nan, horizon, largest)
    # A step of the ground's motion at the onset is no growth: the first tenth is left out.
    used = used[used.size // 10 :]
    picked = used[np.unique(np.linspace(0, used.size - 1, _FITTED).astype(int))]
    return Growth(*slope_interval(time[picked], logarithm[picked]), horizon, largest)


def measure_growth(
    scene: Scene, way: Way, base: Response, onset: float, end: float, pairs: int
) -> Growth:
    """Runs beside a run, with the ground's motion scaled by 1 plus or minus 1e-9.

    Parameters
    ----------
    scene : Scene
    way : Way
        That of the base run.
    base : Response
        With history.
    onset, end : float
        Of the motion [s].
    pairs : int
        Neighbours: 1e-9 to either side, then at multiples of it; distances are scaled back.

    Returns
    -------
    Growth
    """
    assert base.history is not None
    time = base.history["time"].to_numpy()
    time = time[time <= end]
    middle = positions_at(base.history, time)
    rows = []
    for k in range(pairs):
        factor = (1.0 if k % 2 == 0 else -1.0) * (1 + k // 2)
        response = run_scene(scene, way, history=True, scale=1.0 + factor * DIFFERENCE)
        assert response.history is not None
        moved = positions_at(response.history, time) - middle
        rows.append(np.hypot(moved[..., 0], moved[..., 1]).max(axis=1) / abs(factor))
    return growth_of(time, np.array(rows), scene.thickness, onset)


def spread_of_peaks(scene: Scene, way: Way, runs: int = 16) -> list[tuple[float, float, bool]]:
    """Peak displacements of runs whose motion is scaled by 1 plus or minus 1e-9 to 1e-6.

    Parameters
    ----------
    scene : Scene
    way : Way
    runs : int

    Returns
    -------
    list of (difference, peak displacement [m], collapsed)
    """
    rows = []
    for k, size in enumerate(np.geomspace(1e-9, 1e-6, runs)):
        difference = float(size) * (1.0 if k % 2 == 0 else -1.0)
        response, _ = clocked(scene, way, scale=1.0 + difference)
        rows.append((difference, response.peak_displacement, bool(response.collapsed)))
    return rows
