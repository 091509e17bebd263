"""Designs in which each motion is used once: levels placed where they tell most, and the cloud."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from archfrag.fragility.counts import Verdict
from archfrag.study.design import Scattered
from archfrag.study.precision import more_needed, probit_estimate
from archfrag.study.rounds import Strand, cases_of

BEYOND = 3.0  # times the highest, or below the lowest, of the study's levels that a run may go

FloatArray = NDArray[np.float64]


def scattered(
    arch: int, records: NDArray[np.int64], levels: Sequence[float], design: Scattered
) -> Strand:
    """A pilot over the range of the levels, then runs near the wanted probabilities.

    Levels of the pilot are a scrambled Sobol sequence in their logarithm. After it each round is
    placed by the curve estimated so far. Records are taken in their order, each once.

    Parameters
    ----------
    arch : int
    records : ndarray of int, (n_record,)
    levels : sequence of float
        Whose ends are those of the pilot [SI].
    design : Scattered
    """
    ends = np.log([levels[0], levels[-1]])
    most = design.runs if design.precision is None else design.precision.runs
    most = min(most, len(records))
    pilot = min(design.pilot, most)
    level = _pilot_levels(pilot, ends, [design.seed, arch])
    verdict = np.empty(0, np.int8)
    tried = np.empty(0)
    note: dict[str, Any] = {}
    while level.size:
        place = np.arange(tried.size, tried.size + level.size)
        found = yield cases_of(arch, records[place], np.zeros(place.size, int), level)
        tried, verdict = np.concatenate([tried, level]), np.concatenate([verdict, found])
        decided = (verdict == Verdict.COLLAPSED) | (verdict == Verdict.STANDING)
        # Where no run decides yet, as after nothing but failures, the whole range is as likely.
        centre, deviation, width = float(ends.mean()), float(np.ptp(ends)) / 2, float("inf")
        if decided.any():
            centre, deviation, width = probit_estimate(
                tried[decided], verdict[decided] == Verdict.COLLAPSED, design.precision
            )
        more = min(design.round, most - tried.size)
        if design.precision is not None:
            note = {"half_width": width, "reached": bool(width <= design.precision.theta)}
            more = 0 if note["reached"] else more
            if more and design.round < more_needed(width, design.precision.theta, tried.size):
                more = min(2 * design.round, most - tried.size)
            if not more and not note["reached"]:
                note["why"] = (
                    f"there are no more than {len(records)} records"
                    if tried.size >= len(records)
                    else f"{most} runs do not suffice"
                )
        aims = ndtri(np.resize(design.targets, more)) * deviation + centre
        level = np.exp(np.clip(aims, ends[0] - np.log(BEYOND), ends[1] + np.log(BEYOND)))
    return {"runs": int(tried.size), "records": int(tried.size), **note}


def _pilot_levels(count: int, ends: FloatArray, seed: list[int]) -> FloatArray:
    """Levels that fill the range evenly in their logarithm, in random order, (count,)."""
    points = qmc.Sobol(1, seed=np.random.default_rng(seed)).random_base2(
        int(np.ceil(np.log2(max(count, 2))))
    )
    rank = points[:count, 0].argsort().argsort()
    return np.exp(ends[0] + (rank + 0.5) / count * (ends[1] - ends[0]))


def cloud(arch: int, records: NDArray[np.int64], own_levels: FloatArray) -> Strand:
    """Every record once, at the level that it has by the factor of the design, in one round."""
    verdicts = yield cases_of(arch, records, np.zeros(len(records), int), own_levels)
    return {"runs": len(verdicts), "records": len(verdicts)}
