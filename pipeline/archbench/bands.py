"""How often the band that a report quotes holds the truth, over simulated studies.

Other tables are of limit states, designs and records that stand again (`COVERED`), of ratios, of
planes in two measures, and of curves updated by damage.

The posterior of few runs is measured on the public data sets of Van Biesbroeck, Gauchy, Feau and
Garnier.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import norm, skewnorm, weibull_min

from archbench.runner import Bench
from archbench.solve import PRIVATE
from archfrag.errors import FitError
from archfrag.fragility.plane import fit_plane
from archfrag.fragility.posterior import fit_capacity_posterior, fit_posterior
from archfrag.fragility.quoted import capacity_posterior, quoted_band
from archfrag.fragility.risk import HazardCurve, lognormal_rates
from archfrag.fragility.several import left_out, parts_of, ratios
from archfrag.fragility.verdicts import Brackets, Verdict, find_brackets
from archfrag.study.designs import Grid, Ida, ask

Array = NDArray[np.float64]

BETA = 0.35
LEVELS = np.exp(BETA * np.linspace(-2.2, 2.2, 15))
P = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
COLUMNS = [*(f"p_{p:g}" for p in P), "theta", "beta"]
STUDIES = {True: 200, False: 1500}
FEWER = {True: (5, 10), False: (200, 1000)}  # studies of `COMPARED` and of `COVERED`
SEED = 20261122
CORRELATION = 0.5
RECORDS_PER_EVENT = 3
TWO_PEAKS = ((0.7, 0.0), (0.3, 2.5))  # weight and place of each, deviation 0.6
LIMITS = {True: 100.0, False: 1200.0}
PUBLIC = PRIVATE / "validation" / "small_samples"
TRUTH = (
    3.37611,
    0.30621,
)  # theta and beta of the public data sets, whose ln im are standard normal
# Their rms error of the median curve by Jeffreys' prior, and by a constrained one (2503.07343).
PUBLISHED = {
    10: (0.132, 0.109),
    20: (0.101, 0.097),
    30: (0.090, 0.087),
    50: (0.081, 0.080),
    100: (0.053, 0.053),
    200: (0.033, 0.033),
}
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
    "lognormal": norm.ppf,
    "Weibull": _weibull,
    "skewed": _skewed,
    "two peaks": _two_peaks,
}
RECORDS = "same records"
EVENTS = "3 records an event"
SINGLE = "single runs"
SIZES = {RECORDS: (12, 24, 44), EVENTS: (12, 24, 45), SINGLE: (12, 24, 44, 150)}


class World(NamedTuple):
    """Simulated records: how they are grouped and run, and how far single runs scatter."""

    size: int
    scatter: float = 0.0  # standard deviation of ln capacity of single runs of a record
    per_event: int = 1
    design: str = "stripes"
    state: float = np.inf  # median of a lighter limit state over that of collapse


# Of a limit state, correlated with collapse by `TOGETHER`; of `ida`; of records that stand again.
COVERED = {
    **{f"limit state of {n} records": World(n, state=0.6) for n in (12, 24, 44)},
    "limit state, 2 records an event": World(30, per_event=2, state=0.6),
    **{
        f"ida, single runs scatter by {s:g}": World(30, s, design="ida")
        for s in (0.0, 0.2, 0.3)
    },
    **{f"single runs scatter by {s:g}": World(30, s) for s in (0.2, 0.3)},
    **{
        f"levels of their own, {m} an event": World(45, per_event=m, design="levels")
        for m in (1, 3)
    },
}
TOGETHER = 0.8  # correlation of ln capacities of two states, or of two arches
# Two arches, the second with 1.3 times the median capacity, under the same motions.
COMPARED = {
    "3 events of 2": World(6, per_event=2),
    "8 records": World(8),
    "12 records": World(12),
    "24 records": World(24),
    "15 events of 2": World(30, per_event=2),
    "24 records, single runs scatter by 0.2": World(24, 0.2),
}
# Planes, with the part of the variance of ln capacity that the second measure explains.
PLANES = {
    f"{design}, {n} records{', 3 an event' * (m == 3)}": World(
        n, per_event=m, design=design
    )
    for design in ("stripes", "cloud")
    for n in (24, 60)
    for m in (1, 3)
}
PLANES["stripes, 30 records, single runs scatter by 0.2"] = World(30, 0.2)
EXPLAINED = 0.0, 0.15, 0.3
# Earthquakes, places of each, and arches at each place.
TOWNS = ((1, 1, 10), (1, 12, 3), (4, 8, 3))
WIDTH = 0.7  # deviation of ln x1 and ln x2 of unscaled records, and correlation
ALIKE = 0.7
RATIO = 1.3
DISPERSION = 0.4
FINE = np.geomspace(0.25, 4.0, 15)
HAZARD = HazardCurve(
    np.geomspace(0.02, 20.0, 2), 1e-3 * np.geomspace(0.02, 20.0, 2) ** -2.5
)


def _logs(world: World, generator: np.random.Generator, count: int) -> Array:
    """Standardised ln capacities of states or arches, (count, n_record), alike within events."""
    event = np.arange(world.size) // world.per_event
    shared = CORRELATION if world.per_event > 1 else 0.0
    drawn = generator.standard_normal((2, count, world.size))
    z = np.sqrt(shared) * drawn[0][:, event] + np.sqrt(1.0 - shared) * drawn[1]
    z[1:] = TOGETHER * z[0] + np.sqrt(1.0 - TOGETHER**2) * z[1:]
    return z


def _collapsed(
    world: World, capacity: Array, generator: np.random.Generator
) -> NDArray[np.int64]:
    """Whether runs at all levels collapse, (n_record, n_level), by capacities (n_record,)."""
    error = world.scatter * generator.standard_normal((world.size, FINE.size))
    return (capacity[:, None] * np.exp(error) <= FINE).astype(np.int64)


def _requested(verdict: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Verdicts of the runs that `ida` asks for."""
    grid = Grid(0, np.arange(len(verdict)), FINE, np.ones(len(verdict)), 1.0)
    design = {0: Ida(kind="ida", seed=seed).requests(grid)}
    ask(design, lambda cases: verdict[cases["record"], cases["place"]].astype(np.int8))
    return grid.seen.astype(np.int64)


def coverage_in(name: str, studies: int) -> dict[str, float]:
    """As `coverage_of`, in one of the worlds `COVERED`; true values of a state by many records."""
    world = COVERED[name]
    generator = np.random.default_rng([SEED, len(name), world.size])
    many = _logs(World(200_000), np.random.default_rng(SEED), 2)
    logs = DISPERSION * np.minimum(many[0], many[1] + np.log(world.state) / DISPERSION)
    logs += world.scatter * np.random.default_rng(SEED + 1).standard_normal(logs.size)
    im = np.exp(np.quantile(logs, P))
    beta = float(logs.std())
    groups = np.arange(world.size) // world.per_event if world.per_event > 1 else None
    held = np.zeros(P.size + 2)
    for seed in range(studies):
        collapse, own = np.exp(DISPERSION * _logs(world, generator, 2))
        verdict = _collapsed(world, np.minimum(collapse, world.state * own), generator)
        if world.design == "ida":
            verdict = _requested(verdict, seed)
        if world.design == "levels":
            place = np.arange(world.size)[:, None] % FINE.size
            verdict = np.where(place == np.arange(FINE.size), verdict, Verdict.NOT_RUN)
        known = quoted_band(find_brackets(verdict, FINE).packed, im, groups=groups)
        held[:-2] += (known.lower <= P) & (known.upper >= P)
        held[-2] += known.theta_interval[0] <= im[2] <= known.theta_interval[1]
        held[-1] += known.beta_interval[0] <= beta <= known.beta_interval[1]
    return dict(zip(COLUMNS, (held / studies).tolist(), strict=True))


def coverage_of_ratios(name: str, studies: int) -> dict[str, float]:
    """Fraction of studies whose 90 % interval holds the ratio of medians, and of rates."""
    world = COMPARED[name]
    generator = np.random.default_rng([SEED, len(name), world.size])
    true = lognormal_rates(
        HAZARD, [1.0, RATIO], [np.hypot(DISPERSION, world.scatter)] * 2
    )
    truth = {"theta": RATIO, "rate": true[1] / true[0]}
    groups = np.arange(world.size) // world.per_event
    held = dict.fromkeys(truth, 0.0)
    for _ in range(studies):
        capacity = np.exp(DISPERSION * _logs(world, generator, 2)) * np.array(
            [[1.0], [RATIO]]
        )
        found = [
            find_brackets(_collapsed(world, own, generator), FINE) for own in capacity
        ]
        shared = groups if world.per_event > 1 else None
        first, second = (capacity_posterior(own, shared)[0].curve for own in found)
        parts = parts_of(groups)
        one, two = (left_out(own, parts, _plain) for own in found)
        rows = ratios((first, second), [(one, two)], HAZARD)
        for key, value in truth.items():
            held[key] += rows[key]["lower"] <= value <= rows[key]["upper"]
    return {key: value / studies for key, value in held.items()}


def coverage_of_planes(name: str, explained: float, studies: int) -> dict[str, float]:
    """Coverage of the plane's 90 % band, and the fractions of studies with a gain and a plane.

    The band is asked for at each of `P`, at three ratios of the measures.
    """
    world = PLANES[name]
    generator = np.random.default_rng(
        [SEED, len(name), world.size, round(100 * explained)]
    )
    groups = np.arange(world.size) // world.per_event if world.per_event > 1 else None
    spread = WIDTH * np.sqrt(2.0 - 2.0 * ALIKE)
    gamma = DISPERSION * np.sqrt(explained) / spread
    own = DISPERSION * np.sqrt(1.0 - explained)
    at = np.repeat([-spread, 0.0, spread], P.size)
    x1 = np.exp(gamma * at + np.hypot(own, world.scatter) * np.tile(norm.ppf(P), 3))
    held = 0.0
    gains = 0
    planes = 0
    for _ in range(studies):
        one, two, rest = (_logs(world, generator, 1)[0] for _ in range(3))
        s = WIDTH * (ALIKE * one + np.sqrt(1.0 - ALIKE**2) * two - one)
        capacity = np.exp(gamma * s + own * rest)
        if world.design == "cloud":
            level = np.exp(WIDTH * one)[:, None]
            found = find_brackets((capacity[:, None] <= level).astype(int), level)
        else:
            found = find_brackets(_collapsed(world, capacity, generator), FINE)
        try:
            plane = fit_plane(found, np.exp(s), 1.0, groups)
        except FitError:
            continue
        _, low, high = plane.at(x1, x1 * np.exp(at))
        held += ((low <= np.tile(P, 3)) & (np.tile(P, 3) <= high)).mean()
        gains = gains + plane.gains
        planes = planes + 1
    return {"band": held / planes, "gain": gains / planes, "plane": planes / studies}


def coverage_of_updates(
    earthquakes: int, places: int, arches: int, studies: int
) -> dict[str, float]:
    """Fraction of towns in which 90 % intervals hold theta and beta after damage was seen.

    The truth of each town is drawn from the curve of a study of 8 records. Half of beta^2 is an
    arch's own; tau is 0.2 and phi 0.3.
    """
    generator = np.random.default_rng([SEED, earthquakes, places, arches])
    capacity = np.exp(DISPERSION * norm.ppf((np.arange(8) + 0.5) / 8))
    found = find_brackets((capacity[:, None] <= FINE).astype(int), FINE)
    study = replace(quoted_band(found, FINE), measure="PGA", unit="g")
    width = np.ptp(np.log(study.theta_interval))
    held = dict.fromkeys(("theta", "beta", "width"), 0.0)
    for theta, beta in generator.permutation(np.transpose(study.draws(SEED, studies))):
        towns = []
        half = beta / np.sqrt(2.0)
        for event in range(earthquakes):
            lon, lat = 0.2 * generator.random((2, places))
            x, y = 111.195 * np.array([lon, lat])
            away = np.hypot(x[:, None] - x, y[:, None] - y)
            root = np.linalg.cholesky(np.exp(-3.0 * away / 11.5))
            median = np.exp(generator.normal(0.0, 0.5) + np.zeros(places))
            logs = np.log(median) + 0.2 * generator.standard_normal()
            logs += np.hypot(0.3, half) * root @ generator.standard_normal(places)
            own = half * generator.standard_normal((arches, places))
            states = np.where(logs + own > np.log(theta), "collapsed", "survived")
            town = {"lon": lon, "lat": lat, "median": median, "event": event}
            towns += [pd.DataFrame(town | {"state": row}) for row in states]
        seen = pd.concat(towns).assign(tau=0.2, phi=0.3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            curve = study.update(seen, beta_model=study.beta / np.sqrt(2.0))
        held["theta"] += curve.theta_interval[0] <= theta <= curve.theta_interval[1]
        held["beta"] += curve.beta_interval[0] <= beta <= curve.beta_interval[1]
        held["width"] += float(np.ptp(np.log(curve.theta_interval)) / width)
    return {key: value / studies for key, value in held.items()}


def _plain(found: Brackets) -> Any:
    return fit_capacity_posterior(found.without_scatter()).curve


def coverage_of(
    sampling: str, family: str, size: int, studies: int
) -> dict[str, float]:
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
            brackets = find_brackets(verdict, intensity)
            known = quoted_band(brackets, im, groups=groups)
        except FitError:
            continue
        held[:-2] += (known.lower <= P) & (known.upper >= P)
        held[-2] += known.theta_interval[0] <= im[2] <= known.theta_interval[1]
        held[-1] += known.beta_interval[0] <= BETA <= known.beta_interval[1]
    if family != "lognormal":
        held[-1] = np.nan
    return dict(zip(COLUMNS, (held / studies).tolist(), strict=True))


def _study(
    sampling: str,
    quantile: Callable[[Array], Array],
    size: int,
    generator: np.random.Generator,
) -> tuple[NDArray[np.int64], Array, NDArray[np.int64] | None]:
    """Verdicts, intensities and events of one simulated study."""
    at = LEVELS
    groups = None
    if sampling == EVENTS:
        groups = np.arange(size) // RECORDS_PER_EVENT
        shared = generator.standard_normal(size // RECORDS_PER_EVENT)[groups]
        own = generator.standard_normal(size)
        u = norm.cdf(np.sqrt(CORRELATION) * shared + np.sqrt(1.0 - CORRELATION) * own)
    else:
        u = generator.random(size)
    capacity = np.exp(BETA * quantile(u))[:, None]
    if sampling == SINGLE:
        place = np.linspace(0, LEVELS.size - 1, size).round().astype(int)
        at = LEVELS[place, None]
    return (capacity <= at).astype(int), at, groups


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """A row for each kind of sampling, family and size; and few runs, where their data are."""
    cases = [(sampling, "lognormal", n) for sampling in SIZES for n in SIZES[sampling]]
    cases += [
        (RECORDS, family, n) for family in list(FAMILIES)[1:] for n in SIZES[RECORDS]
    ]
    if bench.quick:
        cases = [case for case in cases if case[1] == "lognormal"][:3]
    few, many = FEWER[bench.quick]

    def table(
        name: str, names: Sequence[str], function: Callable[..., Any], number: int, keys
    ) -> pd.DataFrame:
        tasks = {(*key, number): (*key, number) for key in keys}
        limit = LIMITS[bench.quick]
        found = bench.run(name, function, tasks, limit, shares.pop(0))
        return pd.DataFrame(
            [
                dict(zip(names, key)) | {"studies": number} | own
                for key, own in found.items()
                if isinstance(own, dict)
            ]
        )

    shares = [0.4, 0.6, 0.65, 0.85, 0.95]
    heads: tuple[str, ...] = ("sampling", "capacities", "size")
    coverage = table("bands", heads, coverage_of, STUDIES[bench.quick], cases)
    own = [(name,) for name in COVERED]
    more = table("bands_designs", heads[:1], coverage_in, many, own)
    if len(more):
        more["size"] = [COVERED[name].size for name in more["sampling"]]
    both = pd.concat([coverage, more.assign(capacities="lognormal")])
    tables = {"coverage": both[list(coverage)] if len(coverage) else both}
    own = [(name,) for name in COMPARED]
    tables["ratio"] = table("bands_ratio", ["records"], coverage_of_ratios, few, own)
    keys = [(name, part) for name in PLANES for part in EXPLAINED]
    heads = ("runs", "explained")
    tables["planes"] = table("bands_planes", heads, coverage_of_planes, few, keys)
    heads = ("earthquakes", "places", "arches")
    number = 5 if bench.quick else 200
    tables["updates"] = table(
        "bands_updates", heads, coverage_of_updates, number, TOWNS
    )
    if PUBLIC.is_dir():
        sets = FIRST if bench.quick else 100
        tables["few_runs"] = few_runs(PUBLIC, list(PUBLISHED), sets)
    else:
        bench.leave_out("few runs", f"the public data sets are not in {PUBLIC.name}")
    return tables


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
        for im, failed in zip(
            data["intensity"][:size].T[:sets], data["failed"][:size].T
        ):
            known = fit_posterior(im, failed.astype(int), 1, one_sided=True).with_band(
                []
            )
            curve = norm.cdf((x - np.log(known.theta)) / known.beta)
            (low, high), (least, most) = known.theta_interval, known.beta_interval
            rms = np.sqrt(np.mean((curve - true) ** 2))
            found.append((rms, low <= theta <= high, least <= beta <= most))
        jeffreys, constrained = PUBLISHED[size]
        rows.append(
            {
                "runs": size,
                "Jeffreys": jeffreys,
                "constrained": constrained,
                "archfrag": np.mean(found[:FIRST], axis=0)[0],
                **dict(
                    zip(("archfrag, all sets", "theta", "beta"), np.mean(found, axis=0))
                ),
            }
        )
    return pd.DataFrame(rows)
