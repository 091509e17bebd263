"""Fewer runs for the same curve: designs of the shipped study, repeated, with their cost.

    python tests/benchmarks/run_designs.py --repeats 20 --out designs.csv

Each repeat makes all motions larger by k 1e-5 (stripes, ida, two_stage: the same records) or draws
other motions (scattered, and stripes of other motions for its standard errors). Designs are driven
as a study drives them, in one process; cost is CPU time of the simulations.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd

from archfrag.fragility.counts import Verdict
from archfrag.motions.measures import measure_all
from archfrag.study import curves
from archfrag.study.config import load_study
from archfrag.study.design import Ida, Scattered, TwoStage
from archfrag.study.grids import Grid, ida, stripes
from archfrag.study.outcome import tabulate_cases
from archfrag.study.records import COMPARED, read_sources
from archfrag.study.rounds import Rounds
from archfrag.study.scattered import scattered
from archfrag.study.synthetic import Synthetic, made_motions

ROOT = Path(__file__).resolve().parents[2]
DESIGNS = ("stripes", "ida", "two_stage", "scattered", "other_stripes")


class Bench:
    """The shipped study's arch and levels, with some motions."""

    def __init__(self, study, motions, larger=1.0):
        self.study, self.motions = study, motions
        self.arch = study.arches[0].build()
        self.levels = np.array(study.intensity.si)
        values = [measure_all(motion, COMPARED) for motion in motions]
        own = study.intensity.measure
        self.at_one = np.array([larger / each[own] for each in values])
        names = [name for name in COMPARED if name != own]
        self.measures = np.log([[each[n] / each[own] for n in names] for each in values])
        self.methods = [study.method.model_dump(), TwoStage(kind="two_stage").coarse.model_dump()]

    def strand(self, kind, seed):
        records = np.arange(len(self.motions))
        grid = Grid(0, records, self.levels, self.measures)
        if kind == "stripes":
            return stripes(grid)
        if kind == "scattered":
            return scattered(0, records, self.levels, Scattered(kind=kind, runs=150, seed=seed))
        return ida(grid, {"ida": Ida, "two_stage": TwoStage}[kind](kind=kind, seed=seed))

    def run(self, kind, seed):
        """Verdicts by cell, levels, and the CPU time and runs of each stage."""
        rounds = Rounds({0: self.strand(kind, seed)})
        shape = (len(self.motions), 1 if kind == "scattered" else self.levels.size)
        verdict = np.full(shape, int(Verdict.NOT_SIMULATED))
        level = np.full(shape, np.nan)
        spent, runs = [0.0, 0.0], [0, 0]
        while len(rounds.wanted):
            cases, answers = rounds.wanted, np.empty(len(rounds.wanted), np.int8)
            for stage in (0, 1):
                rows = np.flatnonzero(cases["stage"] == stage)
                if not rows.size:
                    continue
                started = time.process_time()
                factors = self.at_one[cases["record"][rows]] * cases["level"][rows]
                table, _ = tabulate_cases(
                    self.methods[stage], self.arch,
                    [self.motions[r] for r in cases["record"][rows]], factors.tolist(),
                )  # fmt: skip
                spent[stage] += time.process_time() - started
                runs[stage] += rows.size
                answers[rows] = table["verdict"]
            fine = cases["stage"] == 0
            verdict[cases["record"][fine], cases["place"][fine]] = answers[fine]
            level[cases["record"][fine], cases["place"][fine]] = cases["level"][fine]
            rounds.answer(answers)
        return verdict, level, spent, runs, rounds


def row(bench, kind, repeat):
    """One line of the table."""
    verdict, level, spent, runs, rounds = bench.run(kind, repeat)
    grid = kind != "scattered"
    made = curves.Runs(
        kind, kind, verdict, bench.levels if grid else level, np.ones(verdict.shape), None
    )
    found = curves.answer(made, 0.9)
    likeliest = found.likelihood
    se = np.log(np.array(found.theta)[1] / found.theta[0]) / 2 / 1.645
    return {
        "design": kind, "repeat": repeat, "runs": runs[0], "coarse_runs": runs[1],
        "rounds": rounds.count, "cpu": spent[0] + spent[1], "theta": found.curve.theta / 9.80665,
        "beta": found.curve.beta, "se_ln_theta": se,
        "se_beta": (found.beta[1] - found.beta[0]) / 2 / 1.645,
        "theta_likeliest": getattr(likeliest, "theta", np.nan) / 9.80665,
        "beta_likeliest": getattr(likeliest, "beta", np.nan),
        "contradictions": rounds.notes[0].get("contradictions", 0),
        "checked": rounds.notes[0].get("checked", 0),
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--designs", nargs="+", default=DESIGNS)
    parser.add_argument("--out", type=Path, default=Path("designs.csv"))
    given = parser.parse_args()
    study = load_study(ROOT / "configs" / "shipped.yaml")
    motions = list(read_sources(study))
    rows = []
    for repeat in range(given.repeats):
        same = Bench(study, motions, 1.0 + repeat * 1e-5)
        for kind in given.designs:
            bench = same
            if kind in ("scattered", "other_stripes"):
                wanted = Synthetic(
                    events=150 if kind == "scattered" else 30, magnitude=(5.5, 6.0, 6.5, 7.0, 7.5),
                    distance_km=(5.0, 10.0, 20.0, 35.0, 70.0), seed=repeat,
                )  # fmt: skip
                bench = Bench(study, list(made_motions(wanted)))
            rows.append(row(bench, kind.removeprefix("other_"), repeat) | {"design": kind})
        table = pd.DataFrame(rows)
        table.to_csv(given.out, index=False)
        print(f"repeat {repeat}", flush=True)
    mean = table.groupby("design", sort=False).mean(numeric_only=True)
    scatter = table.groupby("design", sort=False)[["theta", "beta", "cpu"]].std()
    print(mean.round(4).to_string())
    print("standard deviation over repeats")
    print(scatter.round(4).to_string())


if __name__ == "__main__":
    main()
