"""How well the median is known, and how many more runs would make it known well enough."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, stdtrit

if TYPE_CHECKING:
    from archfrag.study.design import Precision

MOST_AT_ONCE = 2.0  # factor by which runs are added at most
MARGIN = 1.1  # on the runs that the present width suggests


def half_width(brackets: NDArray[np.float64], confidence: float) -> float:
    """Half the width of the interval of ln(median) from brackets of capacities, (n, 2)."""
    inside = brackets[(brackets[:, 0] > 0.0) & np.isfinite(brackets[:, 1])]
    if len(inside) < 3:
        return float("inf")
    logs = np.log(inside).mean(axis=1)
    quantile = stdtrit(len(logs) - 1, 0.5 + 0.5 * confidence)
    return float(quantile * logs.std(ddof=1) / np.sqrt(len(logs)))


def more_needed(width: float, wanted: float, done: int) -> int:
    """Runs or records to add to `done`, for a width that falls with the root of their number."""
    if not np.isfinite(width):
        return done
    needed = MARGIN * done * (width / wanted) ** 2
    return max(1, int(np.ceil(min(needed, MOST_AT_ONCE * done))) - done)


def probit_estimate(
    levels: NDArray[np.float64], fell: NDArray[np.bool_], precision: "Precision | None"
) -> tuple[float, float, float]:
    """ln(median), dispersion and half the width of the interval of ln(median) from single runs."""
    mean = np.linspace(np.log(levels.min()) - 1.0, np.log(levels.max()) + 1.0, 121)
    beta = np.geomspace(0.05, 3.0, 61)
    z = (np.log(levels) - mean[:, None, None]) / beta[:, None]
    loss = np.where(fell, log_ndtr(z), log_ndtr(-z)).sum(axis=2)
    weight = np.exp(loss - loss.max()) / beta
    weight /= weight.sum()
    along = weight.sum(axis=1)
    confidence = 0.9 if precision is None else precision.confidence
    tails = np.interp([0.5 - confidence / 2, 0.5, 0.5 + confidence / 2], np.cumsum(along), mean)
    return float(tails[1]), float(weight.sum(axis=0) @ beta), float(tails[2] - tails[0]) / 2
