"""How often the band that a report quotes holds the truth, over simulated studies.

``python -m archbench.bands FOLDER FILE`` measures the posterior of few runs on the public data
sets of Van Biesbroeck, Gauchy, Feau and Garnier, and writes its table of the evidence page.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import norm, skewnorm, weibull_min

from archbench.runner import Bench
from archfrag.errors import FitError
from archfrag.fragility.counts import find_brackets
from archfrag.fragility.posterior import fit_posterior
from archfrag.fragility.quoted import quoted_band, quoted_runs

Array = NDArray[np.float64]

BETA = 0.35
LEVELS = np.exp(BETA * np.linspace(-2.2, 2.2, 15))
P = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
COLUMNS = [*(f"p_{p:g}" for p in P), "theta", "beta"]
STUDIES = {True: 200, False: 2000}
SEED = 20261122
CORRELATION, RECORDS_PER_EVENT = 0.5, 3
TWO_PEAKS = ((0.7, 0.0), (0.3, 2.5))  # weight and place of each, deviation 0.6
LIMIT = 1800.0
TRUTH = 3.37611, 0.30621  # theta and beta of the public data sets, whose ln im are standard normal
# Their rms error of the median curve by Jeffreys' prior, and by a constrained one (2503.07343).
PUBLISHED = {10: (0.132, 0.109), 20: (0.101, 0.097), 30: (0.090, 0.087), 50: (0.081, 0.080),
             100: (0.053, 0.053), 200: (0.033, 0.033)}  # fmt: skip
FIRST = 10  # sets that the published errors are means over


def _two_peaks(u: Array) -> Array:
    x = np.linspace(-6.0, 9.0, 6001)
    below = sum(weight * norm.cdf(x, place, 0.6) for weight, place in TWO_PEAKS)
    (_, _), (weight, apart) = TWO_PEAKS
    deviation = np.sqrt(0.36 + weight * (1.0 - weight) * apart**2)
    return np.interp(u, below, (x - weight * apart) / deviation)


def _weibull(u: Array) -> Array:
    low, middle = np.log(weibull_min.ppf([0.15865525, 0.5], 1.0))
    return (np.log(weibull_min.ppf(u, 1.0)) - middle) / (middle - low)


def _skewed(u: Array) -> Array:
    return (skewnorm.ppf(u, 4.0) - skewnorm.median(4.0)) / skewnorm.std(4.0)


# Standardised quantiles of the logarithm of capacities.
FAMILIES: dict[str, Callable[[Array], Array]] = {
    "lognormal": norm.ppf, "Weibull": _weibull, "skewed": _skewed, "two peaks": _two_peaks,
}  # fmt: skip
RECORDS, EVENTS, SINGLE = "same records", "3 records an event", "single runs"
SIZES = {RECORDS: (12, 24, 44), EVENTS: (12, 24, 45), SINGLE: (12, 24, 44, 150)}


def coverage_of(sampling: str, family: str, size: int, studies: int) -> dict[str, float]:
    """Fraction of studies whose 90 % band holds the truth at each of `P`, theta and beta.

    A study without a band has not held. Beta of a family that is not lognormal is not asked for.
    """
    quantile = FAMILIES[family]
    im = np.exp(BETA * quantile(P))
    generator = np.random.default_rng([SEED, size])
    held = np.zeros(P.size + 2)
    for _ in range(studies):
        verdict, intensity, groups = _study(sampling, quantile, size, generator)
        try:
            if sampling == SINGLE:
                known = quoted_runs(intensity, verdict, im)
            else:
                known = quoted_band(find_brackets(verdict, intensity), im, groups=groups)
        except FitError:
            continue
        held[:-2] += (known.lower <= P) & (known.upper >= P)
        held[-2] += known.theta[0] <= im[2] <= known.theta[1]
        held[-1] += known.beta[0] <= BETA <= known.beta[1]
    if family != "lognormal":
        held[-1] = np.nan
    return dict(zip(COLUMNS, (held / studies).tolist(), strict=True))


def _study(
    sampling: str, quantile: Callable[[Array], Array], size: int, generator: np.random.Generator
) -> tuple[NDArray[np.int64], Array, NDArray[np.int64] | None]:
    """Verdicts, intensities and events of one simulated study."""
    at, groups = LEVELS, None
    if sampling == EVENTS:
        groups = np.arange(size) // RECORDS_PER_EVENT
        shared = generator.standard_normal(size // RECORDS_PER_EVENT)[groups]
        own = generator.standard_normal(size)
        u = norm.cdf(np.sqrt(CORRELATION) * shared + np.sqrt(1.0 - CORRELATION) * own)
    else:
        u = generator.random(size)
    capacity = np.exp(BETA * quantile(u))
    if sampling == SINGLE:
        at = LEVELS[np.linspace(0, LEVELS.size - 1, size).round().astype(int)]
    else:
        capacity = capacity[:, None]
    return (capacity <= at).astype(int), at, groups


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """A row for each kind of sampling, family and size."""
    cases = [(sampling, "lognormal", n) for sampling in SIZES for n in SIZES[sampling]]
    cases += [(RECORDS, family, n) for family in list(FAMILIES)[1:] for n in SIZES[RECORDS]]
    if bench.quick:
        cases = [case for case in cases if case[1] == "lognormal"][:3]
    studies = STUDIES[bench.quick]
    tasks: dict[tuple, tuple] = {(*case, studies): (*case, studies) for case in cases}
    rows: list[dict[str, Any]] = []
    for key, found in bench.run("bands", coverage_of, tasks, LIMIT).items():
        head = dict(zip(("sampling", "capacities", "size", "studies"), key, strict=True))
        rows.append(head | ({"failed": found} if isinstance(found, str) else found))
    return {"coverage": pd.DataFrame(rows)}


def few_runs(folder: Path, sizes: Sequence[int], sets: int) -> pd.DataFrame:
    """Posterior of the first runs of public data sets: rms error of the curve, and coverage.

    The curve is that of the medians of theta and beta; its error is weighted by the law of the
    intensities. The 90 % intervals of theta and beta are those of all `sets`.
    """
    data = np.load(folder / "pairs.npz")
    x = norm.ppf((np.arange(400) + 0.5) / 400.0)
    theta, beta = TRUTH
    true = norm.cdf((x - np.log(theta)) / beta)
    rows = []
    for size in sizes:
        found = []
        for im, failed in zip(data["intensity"][:size].T[:sets], data["failed"][:size].T):
            known = fit_posterior(im, failed.astype(int), 1, one_sided=True)
            curve = norm.cdf((x - np.log(known.fragility.theta)) / known.fragility.beta)
            (low, high), (least, most) = known.theta_interval(), known.beta_interval()
            rms = np.sqrt(np.mean((curve - true) ** 2))
            found.append((rms, low <= theta <= high, least <= beta <= most))
        jeffreys, constrained = PUBLISHED[size]
        rows.append({
            "runs": size, "Jeffreys": jeffreys, "constrained": constrained,
            "archfrag": np.mean(found[:FIRST], axis=0)[0],
            **dict(zip(("archfrag, all sets", "theta", "beta"), np.mean(found, axis=0))),
        })  # fmt: skip
    return pd.DataFrame(rows)


if __name__ == "__main__":
    few_runs(Path(sys.argv[1]), list(PUBLISHED), 100).to_csv(
        sys.argv[2], index=False, float_format="%.4f"
    )
