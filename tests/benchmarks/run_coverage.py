"""How often 90 % bands hold the true curve, over simulated studies: tables in Markdown.

python tests/benchmarks/run_coverage.py                       # 11 minutes of one core
python tests/benchmarks/run_coverage.py --studies 200         # one
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import norm, skewnorm, weibull_min
from tables import markdown

from archfrag.errors import FitError
from archfrag.fragility.bands import (
    beta_interval,
    bootstrap_band,
    capacity_band,
    confidence_band,
    record_bootstrap_band,
    theta_interval,
)
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.curve import Band
from archfrag.fragility.fit import fit_brackets, fit_stripes
from archfrag.fragility.quoted import quoted_band
from archfrag.fragility.runs import Resampling

Found = tuple[Band, tuple[float, float], tuple[float, float]]
BETA = 0.35
LEVELS = np.exp(BETA * np.linspace(-2.2, 2.2, 15))
P = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
RESAMPLES = 300
UNKNOWN = np.nan, np.nan
NONE = Band(np.full(P.size, np.nan), np.full(P.size, np.nan), 0.9), UNKNOWN, UNKNOWN
NOT_LOGNORMAL, ISLANDS = "Not lognormal", "3 % of verdicts turned over near the border"
STRANGE = NOT_LOGNORMAL, ISLANDS
WEIGHTS = 0.7, 0.3
APART = 2.5


@dataclass(frozen=True)
class Study:
    """One simulated study, and where its true curve has the probabilities `P`."""

    verdict: np.ndarray
    intensity: np.ndarray
    im: np.ndarray
    groups: np.ndarray | None = None
    seed: int = 0


def normal(u):
    """Quantiles of a normal distribution."""
    return norm.ppf(u)


def weibull(u):
    """Of the logarithm of a Weibull variable, standardised: skewed to the left."""
    logs = weibull_min.ppf([0.5, 0.15865525], 1.0)
    return np.log(weibull_min.ppf(u, 1.0) / logs[0]) / np.log(logs[0] / logs[1])


def skewed(u):
    """Of a skew normal variable, shape 4: skewed to the right."""
    return (skewnorm.ppf(u, 4.0) - skewnorm.median(4.0)) / skewnorm.std(4.0)


def _mixed_table():
    x = np.linspace(-6.0, 9.0, 6001)
    below = WEIGHTS[0] * norm.cdf(x, 0.0, 0.6) + WEIGHTS[1] * norm.cdf(x, APART, 0.6)
    mean = WEIGHTS[1] * APART
    deviation = np.sqrt(0.36 + WEIGHTS[0] * WEIGHTS[1] * APART**2)
    return below, (x - mean) / deviation


def mixture(u, table=_mixed_table()):  # noqa: B008
    """Of two normals, 70 and 30 %, 2.5 apart with deviation 0.6: two peaks."""
    return np.interp(u, *table)


def records(
    n: int, quantile: Callable, levels: np.ndarray = LEVELS
) -> Callable[[np.random.Generator, int], Study]:
    """Studies of n records at all levels."""
    im = np.exp(BETA * quantile(P))

    def study(generator, seed):
        capacity = np.exp(BETA * quantile(generator.random(n)))
        return Study((capacity[:, None] <= levels).astype(int), levels, im, seed=seed)

    return study


def events(n: int, rho: float = 0.5) -> Callable[[np.random.Generator, int], Study]:
    """The same, three records an event, correlated by rho."""

    def study(generator, seed):
        own = generator.standard_normal((n // 3, 3))
        shared = generator.standard_normal((n // 3, 1))
        z = (np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * own).ravel()
        verdict = (np.exp(BETA * z)[:, None] <= LEVELS).astype(int)
        return Study(verdict, LEVELS, np.exp(BETA * ndtri(P)), np.arange(n) // 3, seed)

    return study


def islands(n: int, fraction: float = 0.03) -> Callable[[np.random.Generator, int], Study]:
    """3 % of verdicts turned over, all within three levels of the capacity.

    The true curve is the probability of collapse of a run at that intensity.
    """
    z = np.log(LEVELS) / BETA
    step = z[1] - z[0]
    rate = fraction * LEVELS.size / 6.0
    grid = np.linspace(-4.0, 4.0, 2001)
    turned = (
        norm.cdf(grid + 3.0 * step) - norm.cdf(grid),
        norm.cdf(grid) - norm.cdf(grid - 3.0 * step),
    )
    curve = norm.cdf(grid) + rate * (turned[0] - turned[1])
    im = np.exp(BETA * np.interp(P, curve, grid))

    def study(generator, seed):
        capacity = generator.standard_normal((n, 1))
        near = np.abs(z - capacity) < 3.0 * step
        turn = near & (generator.random(near.shape) < rate)
        return Study(((capacity <= z) ^ turn).astype(int), LEVELS, im, seed=seed)

    return study


def scattered(n: int) -> Callable[[np.random.Generator, int], Study]:
    """N runs with a motion each, levels spread evenly over the 15."""

    def study(generator, seed):
        at = LEVELS[np.linspace(0, LEVELS.size - 1, n).round().astype(int)]
        verdict = (np.exp(BETA * generator.standard_normal(n)) <= at).astype(int)
        return Study(verdict, at, np.exp(BETA * ndtri(P)), seed=seed)

    return study


def _stripes(study: Study):
    if study.verdict.ndim == 1:
        return fit_stripes(study.intensity, study.verdict, 1)
    return fit_stripes(study.intensity, study.verdict.sum(axis=0), len(study.verdict))


def delta(study: Study) -> Found:
    """Delta method on binomial counts."""
    fit = _stripes(study)
    return confidence_band(fit, study.im), theta_interval(fit), beta_interval(fit)


def students_t(study: Study) -> Found:
    """Student's t on brackets of capacities."""
    found = find_brackets(study.verdict, study.intensity, "count").known()
    fit = fit_brackets(found.lower, found.upper)
    return capacity_band(fit, study.im), theta_interval(fit), beta_interval(fit)


def resampled_records(study: Study) -> Found:
    """Percentile bootstrap of records, or of runs where they are independent."""
    if study.verdict.ndim == 1:
        band = bootstrap_band(
            _stripes(study), study.im, study.intensity, 1, Resampling(study.seed, RESAMPLES)
        )
        return band, UNKNOWN, UNKNOWN
    return _resampled(study, None)


def resampled_events(study: Study) -> Found:
    """Percentile bootstrap of events."""
    return _resampled(study, study.groups)


def _resampled(study: Study, groups) -> Found:
    band = record_bootstrap_band(
        study.verdict, study.intensity, study.im, Resampling(study.seed, RESAMPLES),
        groups=groups,
    )  # fmt: skip
    return band, band.theta, band.beta


def quoted(study: Study) -> Found:
    """The band that the report quotes."""
    design = "scattered" if study.verdict.ndim == 1 else "stripes"
    known = quoted_band(design, study.verdict, study.intensity, study.im, groups=study.groups)
    return known.band, known.theta, known.beta


METHODS = {
    "percentile bootstrap": resampled_records, "bootstrap of events": resampled_events,
    "delta": delta, "Student's t": students_t, "quoted": quoted,
}  # fmt: skip


def coverage(draw, methods, studies: int, seed: int) -> dict[str, np.ndarray]:
    """Fraction of studies whose band holds the truth at each of `P`, theta, and beta.

    No band is a miss. The beta of a family that is not lognormal is not asked for.
    """
    generator = np.random.default_rng(seed)
    held = {name: np.zeros(P.size + 2) for name in methods}
    for number in range(studies):
        study = draw(generator, number)
        for name in methods:
            try:
                band, theta, beta = METHODS[name](study)
            except FitError:
                band, theta, beta = NONE
            held[name][:-2] += (band.lower <= P) & (band.upper >= P)
            held[name][-2] += theta[0] <= study.im[2] <= theta[1]
            held[name][-1] += beta[0] <= BETA <= beta[1]
    return {name: count / studies for name, count in held.items()}


def scenes(studies: int):
    """Title, case, studies, draw and methods of each row of the tables."""
    same = ["percentile bootstrap", "delta", "Student's t", "quoted"]
    half = studies // 2
    for n in (12, 24, 44):
        yield (
            "Lognormal, the same records at 15 levels",
            f"{n} records",
            studies,
            (records(n, normal)),
            same,
        )
    for n in (12, 24, 45):
        yield (
            "Lognormal, 3 records an event, correlation 0.5",
            f"{n} records",
            half,
            (events(n)),
            ["percentile bootstrap", "bootstrap of events", "quoted"],
        )
    for n in (12, 24, 44, 150):
        yield (
            "Lognormal, independent runs spread over 15 levels",
            f"{n} runs",
            half,
            (scattered(n)),
            ["percentile bootstrap", "delta", "quoted"],
        )
    for name, quantile in (("Weibull", weibull), ("skewed", skewed), ("two peaks", mixture)):
        for n in (12, 24, 44):
            yield NOT_LOGNORMAL, f"{name}, {n} records", half // 2, records(n, quantile), same
    for n in (12, 24, 44):
        yield (
            "3 % of verdicts turned over near the border",
            f"{n} records",
            half,
            (islands(n)),
            same,
        )
    few = {"8 levels to ln theta": (-2.2, 0.0, 8), "5 levels": (-2.2, 2.2, 5)}
    for name, (low, high, number) in few.items():
        for n in (12, 24):
            yield (
                "Lognormal, the same records, other levels",
                f"{name}, {n} records",
                half,
                (records(n, normal, np.exp(BETA * np.linspace(low, high, number)))),
                same,
            )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=2000)
    parser.add_argument("--only", default="", help="titles that contain this")
    parser.add_argument("--seed", type=int, default=20261122)
    chosen = parser.parse_args()
    tables: dict[str, list[list[str]]] = {}
    began = time.process_time()
    for number, (title, case, studies, draw, methods) in enumerate(scenes(chosen.studies)):
        if chosen.only not in title:
            continue
        found = coverage(draw, methods, studies, chosen.seed + number)
        for name, values in found.items():
            row = [case, name, *(f"{100.0 * value:.1f}" for value in values), str(studies)]
            if title in STRANGE:
                row[-2] = ""
            if name == "percentile bootstrap" and "runs" in case:
                row[-3:-1] = "", ""
            tables.setdefault(title, []).append(row)
        print(f"{title}, {case}: {time.process_time() - began:.0f} s", file=sys.stderr, flush=True)
    for title, rows in tables.items():
        print(
            markdown(
                title, ["", "band", *(f"p = {p:g}" for p in P), "theta", "beta", "studies"], rows
            )
        )


if __name__ == "__main__":
    main()
