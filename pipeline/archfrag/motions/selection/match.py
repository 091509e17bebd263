"""The algorithm: simulate spectra of the target, match records to them, improve the set."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from archfrag.motions.selection.target import Target

TRIALS = 20  # simulated sets
STARTS = 5  # the nearest of them to the target: each is matched and improved, the best kept
MOST_PASSES = 50  # over the set; the improvement ends by itself sooner
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Which records may be together: for each rule the groups, and how many may be of one."""

    ln_scale: float  # largest ln factor
    groups: tuple[tuple[NDArray[np.int64], int], ...]

    def allowed(self, chosen: NDArray[np.int64], n_record: int) -> NDArray[np.bool_]:
        """Records that may join those chosen, shape (n_record,)."""
        free = np.ones(n_record, dtype=bool)
        for group, most in self.groups:
            taken = np.bincount(group[chosen], minlength=group.max() + 1)
            free &= taken[group] < most
        return free


def deviation(target: Target, mean: Array, sd: Array) -> Array:
    """Weighted squared errors of mean and sd of ln Sa, (..., n_period), summed over periods."""
    weight = 2.0 if target.sd.any() else 0.1  # the scatter about a mean only is kept small
    errors = (mean - target.ln_mean) ** 2, (sd - target.sd) ** 2
    return errors[0].sum(-1) + weight * errors[1].sum(-1)


def simulate(target: Target, count: int, rng: np.random.Generator) -> Array:
    """Sets of ln Sa drawn from the target, the nearest to it, (``STARTS``, count, n_period)."""
    values, vectors = np.linalg.eigh(target.covariance)
    # Published correlations are not quite positive definite. The symmetric root does not hang on
    # the signs of eigenvectors, which differ between machines.
    root = (vectors * np.sqrt(np.clip(values, 0.0, None))) @ vectors.T
    drawn = target.ln_mean + rng.standard_normal((TRIALS, count, values.size)) @ root
    sd = drawn.std(axis=1, ddof=1) if count > 1 else np.zeros_like(drawn[:, 0])
    return drawn[np.argsort(deviation(target, drawn.mean(axis=1), sd))[:STARTS]]


def factors(ln_sa: Array, target: Target, wanted: Array, limit: float) -> Array:
    """ln of the factor to Sa given, or by least squares to `wanted` (n_period,), (n_record,)."""
    if target.given is not None:
        return target.ln_mean[target.given] - ln_sa[:, target.given]
    return np.clip((wanted - ln_sa).mean(axis=1), -limit, limit)


def _match(ln_sa: Array, target: Target, simulated: Array, limits: Limits) -> NDArray[np.int64]:
    """Record nearest to each simulated spectrum among those still allowed, shape (count,)."""
    chosen = np.empty(0, dtype=np.int64)
    for wanted in simulated:
        scaled = ln_sa + factors(ln_sa, target, wanted, limits.ln_scale)[:, None]
        apart = ((scaled - wanted) ** 2).sum(axis=1)
        apart[~limits.allowed(chosen, len(ln_sa))] = np.inf
        chosen = np.append(chosen, int(apart.argmin()))
    return chosen


def best_set(
    ln_sa: Array, target: Target, simulated: Array, limits: Limits
) -> tuple[NDArray[np.int64], Array]:
    """Rows of `ln_sa` (n_record, n_period) of the best start, and ln of their factors."""
    found = []
    for start in simulated:
        chosen = _match(ln_sa, target, start, limits)
        chosen = _improve(ln_sa, target, start, chosen, limits)
        ln_factor = np.array([
            factors(ln_sa[[record]], target, start[place], limits.ln_scale)[0]
            for place, record in enumerate(chosen)
        ])  # fmt: skip
        scaled = ln_sa[chosen] + ln_factor[:, None]
        sd = scaled.std(axis=0, ddof=1) if len(chosen) > 1 else target.sd
        worth = float(deviation(target, scaled.mean(axis=0), sd))
        found.append((worth, chosen, ln_factor))
    return min(found, key=lambda each: each[0])[1:]


def _improve(
    ln_sa: Array, target: Target, simulated: Array, chosen: NDArray[np.int64], limits: Limits,
) -> NDArray[np.int64]:  # fmt: skip
    """The greedy optimisation of Jayaram, Lin and Baker (2011), until a pass changes nothing."""
    chosen, count = chosen.copy(), len(chosen)
    if count == 1:
        return chosen

    def scaled(place: int) -> Array:
        ln_factor = factors(ln_sa, target, simulated[place], limits.ln_scale)
        return ln_sa + ln_factor[:, None] - target.ln_mean

    held = np.array([scaled(place)[record] for place, record in enumerate(chosen)])
    for _ in range(MOST_PASSES):
        before = chosen.copy()
        for place in range(count):
            others = np.delete(held, place, axis=0)
            candidates = scaled(place)
            mean = (others.sum(axis=0) + candidates) / count
            squares = (others**2).sum(axis=0) + candidates**2
            sd = np.sqrt(np.clip(squares - count * mean**2, 0.0, None) / (count - 1))
            worth = deviation(target, mean + target.ln_mean, sd)
            worth[~limits.allowed(np.delete(chosen, place), len(ln_sa))] = np.inf
            best = int(worth.argmin())
            if worth[best] < worth[chosen[place]]:
                chosen[place], held[place] = best, candidates[best]
        if (chosen == before).all():
            break
    return chosen
