"""How often a design with a wanted precision reaches it, over simulated studies: a table.

python tests/benchmarks/run_precision.py                      # 20 minutes of one core
python tests/benchmarks/run_precision.py --repeats 20 --kinds ida

No arch is simulated: a run collapses where its level exceeds a lognormal capacity, and the
generators of the designs are driven as in a study.
"""

import argparse
import time

import numpy as np
from tables import markdown

from archfrag.fragility.quoted import quoted_band
from archfrag.study.design import Ida, Precision, Scattered, TwoStage
from archfrag.study.grids import Grid, ida
from archfrag.study.rounds import COARSE, Rounds
from archfrag.study.scattered import scattered

SETS = ((0.35, 0.2), (0.5, 0.3), (0.8, 0.4), (0.6, 0.5), (0.45, 0.65))
KINDS = {"ida": Ida, "two_stage": TwoStage, "scattered": Scattered}
N_RECORD = 20_000
N_LEVEL = 15
# ln of what the coarse method makes of a capacity: bias and scatter.
COARSE_OFF = 0.03, 0.05
COLUMNS = (
    "design", "theta", "beta", "most runs", "within 5 %", "interval holds theta", "reached",
    "half-width", "runs", "records", "rounds", "coarse runs",
)  # fmt: skip


def play(kind: str, theta: float, beta: float, most: int, seed: int) -> tuple[float, ...]:
    """One study: its error of ln theta, whether the band holds, and what it took."""
    generator = np.random.default_rng([seed, int(1000 * beta)])
    log_capacity = np.log(theta) + beta * generator.standard_normal(N_RECORD)
    coarse = log_capacity + generator.normal(*COARSE_OFF, N_RECORD)
    # A user's levels: about the curve, but neither centred on it nor made for its beta.
    middle = np.log(theta) + 0.3 * beta * generator.standard_normal()
    levels = np.exp(middle + beta * np.linspace(-2.6, 2.6, N_LEVEL))
    precision = Precision(theta=0.05, confidence=0.9, runs=most)
    design = KINDS[kind](kind=kind, seed=seed, precision=precision, **own_keys(kind))
    records = np.arange(N_RECORD)
    verdict = np.full((N_RECORD, N_LEVEL), 4, np.int8)
    tried, fallen = [], []
    if kind == "scattered":
        strand = scattered(0, records, levels, design)
    else:
        # One other measure that explains half of the variance of ln capacity.
        other = log_capacity + beta * generator.standard_normal(N_RECORD)
        strand = ida(Grid(0, records, levels, other[:, None]), design)
    rounds = Rounds({0: strand})
    while len(rounds.wanted):
        cases = rounds.wanted
        by = np.where(
            cases["stage"] == COARSE, coarse[cases["record"]], log_capacity[cases["record"]]
        )
        fell = (np.log(cases["level"]) >= by).astype(np.int8)
        fine = cases["stage"] != COARSE
        verdict[cases["record"][fine], cases["place"][fine]] = fell[fine]
        tried.append(cases["level"])
        fallen.append(fell)
        rounds.answer(fell)
    note = rounds.notes[0]
    if kind == "scattered":
        quoted = quoted_band(kind, np.concatenate(fallen), np.concatenate(tried), theta)
    else:
        quoted = quoted_band(kind, verdict[: note["records"]], levels, theta)
    return (
        abs(np.log(quoted.curve.theta / theta)) <= 0.05,
        quoted.theta[0] <= theta <= quoted.theta[1],
        note["reached"], note["half_width"], note["runs"], note["records"], rounds.count,
        note.get("coarse_runs", np.nan),
    )  # fmt: skip


def own_keys(kind: str) -> dict[str, int]:
    """Cells checked at random move nothing and are left out."""
    return {} if kind == "scattered" else {"checks": 0}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=200)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--most", type=int, nargs="+", default=[100_000, 500])
    asked = parser.parse_args()
    rows = []
    start = time.perf_counter()
    for most in asked.most:
        for kind in asked.kinds:
            for theta, beta in SETS:
                found = np.array(
                    [play(kind, theta, beta, most, seed) for seed in range(asked.repeats)], float
                )
                mean = found.mean(axis=0)
                percent = [f"{100 * part:.1f} %" for part in mean[:3]]
                coarse = "" if np.isnan(mean[7]) else f"{mean[7]:.0f}"
                row: list[object] = [kind, theta, beta, most, *percent, f"{mean[3]:.3f}"]
                rows.append([*row, *(f"{m:.0f}" for m in mean[4:6]), f"{mean[6]:.1f}", coarse])
                print(*rows[-1], f"{time.perf_counter() - start:.0f} s", flush=True)
    print(markdown("Precision of 5 % at 90 %", COLUMNS, rows))


if __name__ == "__main__":
    main()
