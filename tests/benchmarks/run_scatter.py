"""Median, scatter and correlation of synthetic motions beside published models.

``python -m tests.benchmarks.run_scatter`` prints the tables; it needs pygmm. Two to three minutes
on two cores.
"""

import sys
from multiprocessing import Pool

import numpy as np
from tests.benchmarks.tables import markdown

from archfrag.motions.measures import pga, pgv, spectral_acceleration
from archfrag.motions.selection import Rupture, predict
from archfrag.motions.synthetic import VS30, Options, make_motion
from archfrag.motions.units import STANDARD_GRAVITY

PERIODS = np.array([0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0])
SCENARIOS = [(m, r) for m in (5.5, 6.0, 6.5, 7.0, 7.5) for r in (10.0, 30.0, 100.0)]
SCATTERED = [(5.5, 30.0), (6.5, 20.0), (7.5, 50.0)]
SIGMA_MODELS = ("CY14", "ASK14", "BSSA14", "CB14")


def measured(task):
    """ln of Sa at all periods, PGA and PGV of one motion."""
    magnitude, distance, seed, options = task
    motion = make_motion(magnitude, distance, seed, options)
    return np.log([*spectral_acceleration(motion, PERIODS), pga(motion), pgv(motion)])


def suite(pool, magnitude, distance, seeds, options):
    tasks = [(magnitude, distance, seed, options) for seed in seeds]
    return np.array(pool.map(measured, tasks, chunksize=20))


def published_deviation(magnitude, distance):
    """Total standard deviation of ln Sa: mean over the four models."""
    return np.mean([published(m, magnitude, distance).sd for m in SIGMA_MODELS], axis=0)


def published(model, magnitude, distance):
    """What a model predicts for a vertical strike-slip fault in California."""
    rupture = Rupture(magnitude, distance, VS30, region="california")
    return predict(rupture, model, PERIODS)


def published_correlation(periods):
    from pygmm.baker_jayaram_2008 import calc_correls

    return np.array([calc_correls(periods, period) for period in periods])


def medians(pool, count):
    """Ratio of median Sa to each model, by scenario, shape (n_scenario, n_model, n_period)."""
    rows = []
    for magnitude, distance in SCENARIOS:
        # Opposite rows of variation do not exist among seeds: its mean is taken out by many.
        found = suite(pool, magnitude, distance, range(count), Options())[:, :-2].mean(axis=0)
        models = [published(m, magnitude, distance).ln_median for m in SIGMA_MODELS[:3]]
        rows.append(np.exp(found - models) / STANDARD_GRAVITY)
    return np.array(rows)


def main(count=1000):
    head = ["scenario", "what", *(f"{period:g} s" for period in PERIODS), "PGA", "PGV"]
    lines, worst = [], []
    with Pool(2) as pool:
        for magnitude, distance in SCATTERED:
            name = f"M {magnitude:g}, {distance:g} km"
            varied = suite(pool, magnitude, distance, range(count), Options())
            plain = suite(pool, magnitude, distance, range(count), Options(vary=False))
            bias = np.exp((varied - plain).mean(axis=0))
            scatter, published = varied.std(axis=0), published_deviation(magnitude, distance)
            between = (PERIODS >= 0.1) & (PERIODS <= 2.0)
            found = np.corrcoef(varied[:, :-2][:, between].T)
            apart = found - published_correlation(PERIODS[between])
            scaled = (varied[:, -1] - varied[:, -2]).std()
            for what, row in (("median with / without variation", bias), ("sd of ln", scatter),
                              ("published total sd", published)):  # fmt: skip
                lines.append([name, what, *(f"{value:.2f}" for value in row)])
            worst.append(
                [
                    name,
                    f"{np.abs(scatter[:-2] - published).max():.3f}",
                    f"{np.abs(apart).max():.3f}",
                    f"{np.mean(np.abs(apart) <= 0.1):.3f}",
                    f"{scaled:.2f}",
                ]
            )
        ratios = medians(pool, count // 4)
    print(markdown("Scatter", head, lines))
    head_of_worst = ("scenario", "worst sd", "worst correlation", "pairs within 0.1",
                     "sd ln PGV after scaling to PGA")  # fmt: skip
    print(markdown("Largest differences", head_of_worst, worst))
    rows = [
        [f"M {m:g}, {r:g} km", model, *(f"{value:.2f}" for value in ratio)]
        for (m, r), scenario in zip(SCENARIOS, ratios, strict=True)
        for model, ratio in zip(SIGMA_MODELS[:3], scenario, strict=True)
    ]
    print(markdown("Median over models", ["scenario", "model", *head[2:-2]], rows))
    within = np.mean((ratios[:, :2] > 0.7) & (ratios[:, :2] < 1.3))
    print(f"CY14 and ASK14: {ratios[:, :2].min():.2f} to {ratios[:, :2].max():.2f}, "
          f"{100 * within:.0f} % of cells within 30 %")  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
