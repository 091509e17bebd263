"""How well the median is known, and how many more runs would make it known well enough."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError
from archfrag.fragility.quoted import quoted_posterior

if TYPE_CHECKING:
    from archfrag.study.design import Precision

MOST_AT_ONCE = 2.0  # factor by which runs are added at most
MARGIN = 1.1  # on the runs that the present width suggests
# A design that looks after each round stops too soon where its runs happen to scatter little.
LEAST_RECORDS = 20
LOOKS_IN_A_ROW = 2
BETWEEN_LOOKS = 0.05  # of the runs so far are added at least, so that a second look is one


@dataclass(frozen=True)
class Known:
    """Curve so far."""

    log_median: float = np.nan  # posterior medians; nan if there is no curve yet
    beta: float = np.nan  # posterior medians; nan if there is no curve yet
    # The farther end of the interval of ln(median) is this far from it; inf if there is none.
    half_width: float = np.inf


def known_so_far(
    design: str,
    verdict: ArrayLike,
    level: ArrayLike,
    confidence: float = 0.9,
    groups: ArrayLike | None = None,
) -> Known:
    """Curve of the runs made, by the posterior from which a report quotes its band.

    Arguments are those of `archfrag.fragility.quoted.quoted_posterior`.
    """
    try:
        known = quoted_posterior(design, verdict, level, groups)[0]
    except FitError:
        return Known()
    middle = float(np.log(known.fragility.theta))
    low, high = np.log(known.theta_interval(confidence))
    return Known(middle, known.fragility.beta, float(max(middle - low, high - middle)))


class Stop:
    """Whether there are runs enough, asked after each round.

    A design stops when the interval is narrow enough in two rounds in a row.
    """

    def __init__(self, wanted: "Precision") -> None:
        self.wanted = wanted
        self.met = 0
        self.note: dict[str, Any] = {}

    def look(self, half_width: float, done: int, least: int) -> bool:
        """Note the width after `done` records or runs, of which `least` are needed."""
        narrow = half_width <= self.wanted.theta and done >= least
        self.met = self.met + 1 if narrow else 0
        reached = self.met >= LOOKS_IN_A_ROW
        self.note = {"half_width": half_width, "reached": reached}
        return reached

    def end(self, why: str) -> None:
        """Note that there are to be no more runs, and why if not for their number."""
        if self.note["half_width"] <= self.wanted.theta:
            self.note["reached"] = True
        else:
            self.note["why"] = why or f"{self.wanted.runs} runs do not suffice"


def more_needed(width: float, wanted: float, done: int) -> int:
    """Runs or records to add to `done`, for a width that falls with the root of their number."""
    if not np.isfinite(width):
        return done
    needed = MARGIN * done * (width / wanted) ** 2
    needed = min(max(needed, (1.0 + BETWEEN_LOOKS) * done), MOST_AT_ONCE * done)
    return int(np.ceil(needed)) - done
