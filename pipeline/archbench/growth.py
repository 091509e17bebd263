"""Growth: of the cost with the number of voussoirs, and of a difference in the ground's motion.

One arch is cut into more and more equal voussoirs, under one pulse, every method at its defaults.
A difference of 1e-9 of the motion shows how long a run can be predicted.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import stats

from archbench.quantities import lengths, positions_at
from archbench.runner import Bench, Row
from archbench.scene import Array, Scene, load_scene
from archbench.settings import (
    COLUMNS,
    Setting,
    available_methods,
    default_setting,
)
from archbench.solve import Solution, solve
from archfrag.errors import ArchfragError

NUMBERS = {
    True: (7, 14, 27, 54),
    False: (7, 10, 14, 20, 27, 38, 54, 81, 108),
}
REPEATS = {True: 2, False: 5}
SECONDS = 1.5
STEP = 1e-3  # of other solvers
# A run that by the last one and this power would take longer is not begun [s of CPU].
LONGEST = {True: 0.5, False: 10.0}
POWER = 2.5
DIFFERENCE = 1e-9  # relative, of the ground's motion
REACHED = 1e-2  # of the thickness: the end of prediction
CONFIDENCE = 0.9
FITTED = 24
RUNS = [*COLUMNS, "voussoirs", "repeat", "seconds", "moving_seconds", "steps", "status"]


def costs_of(setting: Setting, repeat: int, quick: bool) -> list[Row]:
    """Timed runs of one method; numbers that would take too long are left out with the reason."""
    rows: list[Row] = []
    last = 1
    seconds = 0.0
    pulse = replace(load_scene("arch7_pulse"), duration=SECONDS)
    for number in NUMBERS[quick]:
        expected = seconds * (number / last) ** POWER
        base = {**setting.columns, "voussoirs": number, "repeat": repeat}
        if expected > LONGEST[quick]:
            why = f"not run: about {expected:.0f} s of CPU"
            rows.append({**base, "status": why})
            continue
        scene = replace(pulse, chain={**pulse.chain, "voussoirs": number})
        try:
            solve(replace(scene, duration=0.1), setting)  # what the first run takes
            run = solve(scene, setting)
        except ArchfragError as reason:
            return [*rows, {**base, "status": str(reason)}]
        if not math.isfinite(run.seconds):
            return [*rows, {**base, "status": run.status}]
        last = number
        seconds = run.seconds
        at_rest = run.response.model_time["rest"] if run.response else 0.0
        own = (run.seconds, run.end_time - at_rest, run.steps, run.status)
        rows.append(base | dict(zip(RUNS[-4:], own, strict=True)))
    return rows


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Every timed run, and the exponents of a power law through the medians of each method.

    In each repeat the methods take turns.
    """
    settings = [default_setting(name) for name in available_methods()]
    settings += [Setting(name, "dt", STEP) for name in bench.solvers]
    tasks = {
        (k, each.method): (each, k, bench.quick)
        for k in range(REPEATS[bench.quick])
        for each in settings
    }
    found = bench.run("growth", costs_of, tasks, 300.0)
    rows = [row for own in found.values() if isinstance(own, list) for row in own]
    runs = pd.DataFrame(rows, columns=RUNS)
    for row in rows:
        if "seconds" not in row and row["repeat"] == 0:
            bench.leave_out(f"{row['method']}, {row['voussoirs']}", row["status"])
    return {"runs": runs, "exponents": exponents_table(runs)}


def medians(runs: pd.DataFrame) -> pd.Series:
    """Median cost of a second of motion by number of voussoirs [CPU s/s]."""
    runs = runs[runs["moving_seconds"] > 0.0]
    return (
        (runs["seconds"] / runs["moving_seconds"]).groupby(runs["voussoirs"]).median()
    )


def exponents_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Exponent of the cost in the number of voussoirs, with its 90 % interval, by method."""
    rows = []
    heads = [
        "method",
        "voussoirs_from",
        "voussoirs_to",
        "exponent",
        "low",
        "high",
        "seconds_at_first",
        "seconds_at_last",
    ]
    for method, group in runs.groupby("method", sort=False):
        cost = medians(group)
        if cost.size:
            fit = slope_interval(
                np.log(cost.index.to_numpy(float)), np.log(cost.to_numpy())
            )
            ends = cost.index[0], cost.index[-1]
            rows.append((method, *ends, *fit, cost.iloc[0], cost.iloc[-1]))
    return pd.DataFrame(rows, columns=heads)


def slope_interval(x: Array, y: Array) -> tuple[float, float, float]:
    """Least-squares slope and its interval at 90 % (Student's t); nan if points are missing."""
    if np.unique(x).size < 2:
        return math.nan, math.nan, math.nan
    fit = stats.linregress(x, y)  # the quantile is nan of two points
    half = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, x.size - 2) * fit.stderr
    return float(fit.slope), float(fit.slope - half), float(fit.slope + half)


def growth_of(
    time: Array, distance: Array, thickness: float, onset: float
) -> dict[str, float]:
    """Largest Lyapunov exponent over the motion, and when prediction ends."""
    with np.errstate(divide="ignore"):
        logarithm = np.mean(np.log(distance / thickness), axis=0)
    above = np.flatnonzero(logarithm >= math.log(REACHED))
    horizon = float(time[above[0]]) if above.size else math.inf
    used = np.flatnonzero(np.isfinite(logarithm) & (time > onset) & (time <= horizon))
    # A step of the ground's motion at the onset is no growth: the first tenth is left out.
    used = used[used.size // 10 :]
    fit = (math.nan,) * 3
    if used.size >= 3:
        picked = used[np.unique(np.linspace(0, used.size - 1, FITTED).astype(int))]
        fit = slope_interval(time[picked], logarithm[picked])
    return dict(
        zip(("exponent", "low", "high", "horizon"), (*fit, horizon), strict=True)
    )


def measure_growth(
    scene: Scene, setting: Setting, base: Solution, onset: float, end: float, pairs: int
) -> dict[str, float]:
    """`growth_of` runs beside a run, with the ground's motion scaled by 1 plus or minus 1e-9."""
    time = base.frames.time[base.frames.time <= end]
    middle = positions_at(base.frames, time)
    rows = []
    for k in range(pairs):
        factor = (1.0 if k % 2 == 0 else -1.0) * (1 + k // 2)
        near = solve(scene, setting, history=True, scale=1.0 + factor * DIFFERENCE)
        rows.append(
            lengths(positions_at(near.frames, time) - middle).max(axis=1) / abs(factor)
        )
    return growth_of(time, np.array(rows), scene.thickness, onset)
