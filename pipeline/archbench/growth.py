"""How the cost of a simulated second of motion grows with the number of voussoirs.

The pulse of the scene `arch7_pulse` on the same arch cut into more and more equal voussoirs, from
the start to a fixed instant; every method at its defaults.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from archbench.horizon import slope_interval
from archbench.runner import Bench, Row
from archbench.scene import load_scene
from archbench.settings import COLUMNS, Setting, default_setting
from archbench.solve import solve
from archfrag.errors import ArchfragError
from archfrag.simulation.checks import available_methods

NUMBERS = {True: (7, 10, 14, 20, 27, 38, 54), False: (7, 10, 14, 20, 27, 38, 54, 81, 108)}
REPEATS, SECONDS = 5, 1.5
STEP = 1e-3  # of other solvers
# A run that by the last two would take longer is not begun [s of CPU].
LONGEST = {True: 2.0, False: 10.0}
RUNS = [*COLUMNS, "voussoirs", "repeat", "seconds", "moving_seconds", "steps", "status"]


def costs_of(setting: Setting, quick: bool) -> list[Row]:
    """Timed runs of one method; numbers that would take too long are left out with the reason."""
    rows: list[Row] = []
    seen: list[tuple[int, float]] = []
    pulse = replace(load_scene("arch7_pulse"), duration=SECONDS)
    for number in NUMBERS[quick]:
        expected = expected_seconds(seen, number)
        base = {**setting.columns, "voussoirs": number}
        if expected > LONGEST[quick]:
            rows.append({**base, "status": f"not run: about {expected:.0f} s of CPU"})
            continue
        scene = replace(pulse, chain={**pulse.chain, "voussoirs": number})
        for repeat in range(-1, REPEATS):
            try:
                run = solve(scene, setting)
            except ArchfragError as reason:
                return [*rows, {**base, "status": str(reason)}]
            if not math.isfinite(run.seconds):
                return [*rows, {**base, "status": run.status}]
            if repeat < 0:
                seen.append((number, run.seconds))
                continue
            at_rest = run.response.model_time["rest"] if run.response else 0.0
            own = (repeat, run.seconds, run.end_time - at_rest, run.steps, run.status)
            rows.append(base | dict(zip(RUNS[-5:], own, strict=True)))
    return rows


def expected_seconds(seen: list[tuple[int, float]], number: int) -> float:
    """CPU time by the last two numbers of voussoirs and their times [s]; 0 if there are none."""
    if not seen:
        return 0.0
    power, (last, seconds) = 2.0, seen[-1]
    if len(seen) > 1 and min(seconds, seen[-2][1]) > 0.0:
        power = max(1.0, math.log(seconds / seen[-2][1]) / math.log(last / seen[-2][0]))
    return seconds * (number / last) ** power


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Every timed run, and the exponents of a power law through the medians of each method."""
    settings = [default_setting(name) for name in available_methods()]
    settings += [Setting(name, "dt", STEP) for name in bench.solvers]
    tasks = {(each.method, bench.quick): (each, bench.quick) for each in settings}
    rows: list[Row] = []
    for (method, _), found in bench.run("growth", costs_of, tasks, 900.0).items():
        rows += [{"method": method, "status": found}] if isinstance(found, str) else found
    runs = pd.DataFrame(rows, columns=RUNS)
    return {"runs": runs, "exponents": exponents_table(runs)}


def medians(runs: pd.DataFrame) -> pd.Series:
    """Median cost of a second of motion by number of voussoirs [CPU s/s]."""
    runs = runs[runs["moving_seconds"] > 0.0]
    return (runs["seconds"] / runs["moving_seconds"]).groupby(runs["voussoirs"]).median()


def exponents_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Exponent of the cost in the number of voussoirs, with its 90 % interval, by method."""
    rows = []
    for method, group in runs.groupby("method", sort=False):
        cost = medians(group)
        if cost.empty:
            continue
        numbers = np.log(cost.index.to_numpy(float))
        exponent, low, high = slope_interval(numbers, np.log(cost.to_numpy()))
        rows.append({
            "method": method, "voussoirs_from": cost.index[0], "voussoirs_to": cost.index[-1],
            "exponent": exponent, "low": low, "high": high, "seconds_at_first": cost.iloc[0],
            "seconds_at_last": cost.iloc[-1],
        })  # fmt: skip
    return pd.DataFrame(rows)
