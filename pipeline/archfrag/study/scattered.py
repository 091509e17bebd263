"""Designs in which each motion is used once: levels where they are informative, and the cloud."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from archfrag.study.design import Scattered
from archfrag.study.precision import Known, Stop, known_so_far, more_needed
from archfrag.study.rounds import Strand, cases_of

BEYOND = 3.0  # times the highest, or below the lowest, of the study's levels that a run may go

FloatArray = NDArray[np.float64]


def scattered(
    arch: int, records: NDArray[np.int64], levels: FloatArray, design: Scattered
) -> Strand:
    """A pilot over the range of the levels, then runs near the wanted probabilities.

    Levels of the pilot are a scrambled Sobol sequence in their logarithm. After it each round is
    placed by the curve estimated so far. Records are taken in their order, each once.
    """
    ends = np.log([levels[0], levels[-1]])
    most = design.runs if design.precision is None else design.precision.runs
    most = min(most, len(records))
    pilot = min(design.pilot, most)
    level = _pilot_levels(pilot, ends, [design.seed, arch])
    verdict = np.empty(0, np.int8)
    tried = np.empty(0)
    stop = None if design.precision is None else Stop(design.precision)
    while level.size:
        place = np.arange(tried.size, tried.size + level.size)
        found = yield cases_of(arch, records[place], np.zeros(place.size, int), level)
        tried, verdict = np.concatenate([tried, level]), np.concatenate([verdict, found])
        confidence = 0.9 if stop is None else stop.wanted.confidence
        known = known_so_far("scattered", verdict, tried, confidence)
        more = min(design.round, most - tried.size)
        if stop is not None:
            more = _more_runs(stop, known.half_width, tried.size, design.round, most)
            if not more and not stop.note["reached"]:
                none_left = tried.size >= len(records)
                stop.end(f"there are no more than {len(records)} records" if none_left else "")
        level = _levels_at(design.targets, more, known, ends)
    note = {"runs": int(tried.size), "records": int(tried.size)}
    return note | ({} if stop is None else stop.note)


def _more_runs(stop: Stop, width: float, done: int, at_once: int, most: int) -> int:
    """Runs to make next: one round, or two where many are needed."""
    if stop.look(width, done, 0):
        return 0
    far = more_needed(width, stop.wanted.theta, done) > at_once
    return min(2 * at_once if far else at_once, most - done)


def _levels_at(targets: Sequence[float], count: int, known: Known, ends: FloatArray) -> FloatArray:
    """Levels where the curve has the wanted probabilities, (count,)."""
    centre, beta = known.log_median, known.beta
    if not np.isfinite(centre):
        centre, beta = ends.mean(), 0.25 * (ends[1] - ends[0])
    aims = ndtri(np.resize(targets, count)) * beta + centre
    # Last digits, which differ between machines, would make other runs of the same study.
    return np.exp(np.round(np.clip(aims, ends[0] - np.log(BEYOND), ends[1] + np.log(BEYOND)), 6))


def _pilot_levels(count: int, ends: FloatArray, seed: list[int]) -> FloatArray:
    """Levels that fill the range evenly in their logarithm, in random order, (count,)."""
    from scipy.stats import qmc

    points = qmc.Sobol(1, seed=np.random.default_rng(seed)).random_base2(
        int(np.ceil(np.log2(max(count, 2))))
    )
    rank = points[:count, 0].argsort().argsort()
    return np.exp(ends[0] + (rank + 0.5) / count * (ends[1] - ends[0]))


def cloud(arch: int, records: NDArray[np.int64], own_levels: FloatArray) -> Strand:
    """Every record once, at the level that it has by the factor of the design, in one round."""
    verdicts = yield cases_of(arch, records, np.zeros(len(records), int), own_levels)
    return {"runs": len(verdicts), "records": len(verdicts)}
