"""What users ask for: theta and beta of a fragility curve, against what the study costs.

One study is the shipped records and levels on the shipped arch with straight-sided voussoirs.
Every setting repeats it with the motions scaled by 1 plus multiples of 1e-5: beyond the
predictability horizon a single study is one draw of its theta. The reference is the curve of many
studies together, by two methods that have nothing but the contact problem in common.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from archbench.runner import Bench, Row
from archbench.scene import Array, Scene, load_scene
from archbench.settings import Setting, ladders
from archbench.solve import RECORDS, solve_many, with_motion
from archfrag.errors import FitError
from archfrag.fragility.fit import fit_stripes
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion

# What differs in each arch from the shipped one.
SHIPPED = "ring of 7 voussoirs"
ARCHES: dict[str, Row] = {
    SHIPPED: {},
    "21 voussoirs that slide": {"voussoirs": 21, "friction": 0.36, "thickness": 2.0},
    "27 voussoirs": {"voussoirs": 27},
}
REPEATS = 8
OTHER_REPEATS = 3  # of what is not ours, which takes five sixths of the time
OURS = ("time_stepping", "event_driven", "auto")
DISTURBANCE = 1e-5
# Of the reference: settings, and the relative distance between those of its repetitions.
REFERENCES = (
    Setting("time_stepping", "dt", 2e-4),
    Setting("event_driven", "rtol", 1e-5),
)
APART = 0.04
LIMIT = 9000.0  # of one study [s]
FALL = 4.0  # after a record, for what has lost contact to move two thicknesses [s]
RESAMPLES = 200
SEED = 20250101


class Study(NamedTuple):
    """A study of role "reference" or "setting": outcomes by record and level, 1, 0 or None."""

    role: str
    setting: Setting
    repeat: int
    outcomes: list
    seconds: float

    @property
    def counts(self) -> Array:
        """Which of its runs collapsed, and which stood, (2, n_record, n_level)."""
        known = np.array(self.outcomes, float)
        return np.array([known == 1.0, known == 0.0], float)


@lru_cache(maxsize=2)
def scenes_of(arch: str, quick: bool) -> tuple[list[Scene], list[float]]:
    """A scene for each record, at a peak of 1 g, and the levels [g]; if quick fewer of both."""
    entries = [
        each for k, each in enumerate(load_index(RECORDS)) if not quick or k % 3 != 2
    ]
    pulse = load_scene("arch7_pulse")
    scenes = []
    chain = pulse.chain | ARCHES[arch]
    for motion in map(load_motion, entries):
        duration = float(math.ceil(motion.dt * motion.acceleration.size + FALL))
        scene = replace(pulse, name=motion.id, chain=chain, duration=duration)
        scenes.append(with_motion(scene, motion, 1.0))
    return scenes, np.linspace(0.2, 3.0, 15)[:: 2 if quick else 1].round(12).tolist()


def run_study(
    setting: Setting,
    repeat: int,
    arch: str,
    quick: bool,
    levels: Sequence[float] = (),
) -> Row:
    """Outcomes and CPU seconds of one study, as of `Study`; levels [g] if not the shipped ones."""
    scenes, shipped = scenes_of(arch, quick)
    factors = [level * (1.0 + DISTURBANCE * repeat) for level in levels or shipped]
    outcomes = []
    seconds = 0.0
    for scene in scenes:
        runs = solve_many(scene, setting, factors)
        outcomes.append(
            [None if run.collapsed is None else int(run.collapsed) for run in runs]
        )
        seconds += sum(run.seconds for run in runs if math.isfinite(run.seconds))
    return {"outcomes": outcomes, "seconds": seconds}


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Make the studies; all settings take turns."""
    column = "fragility_quick" if bench.quick else "fragility"
    chosen = [each for row in ladders(column, bench.solvers).values() for each in row]
    roles = []
    for k in range(REPEATS):
        roles += [("reference", each.finer(1.0 - APART * k), k) for each in REFERENCES]
        roles += [
            ("setting", each, k)
            for each in chosen
            if each.method in OURS or k < OTHER_REPEATS
        ]
    tasks = {
        (*each.columns.values(), k): (each, k, SHIPPED, bench.quick)
        for _, each, k in roles
    }
    found = bench.run("fragility", run_study, tasks, LIMIT)
    studies = [
        Study(*role, **found[key])
        for key, role in zip(tasks, roles, strict=True)
        if isinstance(found.get(key), dict)
    ]
    if not any(each.role == "reference" for each in studies):
        return {}
    tables = tables_of(studies, np.array(scenes_of(SHIPPED, bench.quick)[1]))
    return {part: table.assign(study="shipped") for part, table in tables.items()}


def tables_of(studies: Sequence[Study], levels: Array) -> dict[str, pd.DataFrame]:
    """The table `curves`."""
    groups: dict[tuple[str, str, float], list[Study]] = {}
    for each in studies:
        value = each.setting.value if each.role == "setting" else 0.0
        groups.setdefault((each.role, each.setting.method, value), []).append(each)
    fits = {
        key: np.array([curve_of(levels, each.counts) for each in group])
        for key, group in groups.items()
    }
    totals = {
        key: np.sum([each.counts for each in group], axis=0)
        for key, group in groups.items()
    }
    references = [key for key in groups if key[0] == "reference"]
    pooled = np.sum([totals[key] for key in references], axis=0)
    centre = np.array(curve_of(levels, pooled))
    known = known_to(
        [curve_of(levels, totals[key]) for key in references],
        [fits[key] for key in references],
    )
    records = pooled.shape[1]
    drawn = np.random.default_rng(SEED).integers(0, records, (RESAMPLES, records))
    # Standard errors of ln theta and beta from these records being a sample.
    sampling = np.nanstd(
        [curve_of(levels, pooled[:, each]) for each in drawn], axis=0, ddof=1
    )
    curves = []
    for key, group in groups.items():
        found = fits[key]
        seconds = [each.seconds for each in group]
        if key[0] == "reference":
            continue
        row: Row = {
            **group[0].setting.columns,
            "runs": totals[key][0].size,
            "repeats": len(group),
            "theta": float(np.exp(found[:, 0].mean())),
            "beta": float(found[:, 1].mean()),
        }
        for j, (name, scale) in enumerate((("theta", 1.0), ("beta", centre[1]))):
            own = (found[:, j] - centre[j]) / scale
            row |= {
                f"{name}_difference": own.mean(),
                f"{name}_low": own.min(),
                f"{name}_high": own.max(),
                f"{name}_scatter": own.std(ddof=1),
                f"{name}_known_to": known[j] / scale,
                f"{name}_sampling": sampling[j] / scale,
            }
        failures = len(group) * totals[key][0].size - int(np.sum(totals[key]))
        curves.append(
            {**row, "failures": failures, "seconds": float(np.median(seconds))}
        )
    return {"curves": pd.DataFrame(curves)}


def curve_of(levels: Array, counts: Array) -> tuple[float, float]:
    """ln theta and beta of what collapsed and stood by record and level; nan without a curve."""
    collapsed, held = counts.sum(axis=1)
    try:
        fit = fit_stripes(levels, collapsed, collapsed + held)
    except FitError:
        return math.nan, math.nan
    return float(np.log(fit.theta)), fit.beta


def known_to(together: Sequence[Sequence[float]], alone: Sequence[Any]) -> Array:
    """Error of the reference's ln theta and beta: half of the distance between its two methods.

    If that is larger, the standard error of its mean: methods that agree by chance prove no more.
    """
    half = 0.5 * np.abs(np.subtract(together[0], together[1]))
    variance = [np.var(each, axis=0, ddof=1) for each in alone if len(each) > 1]
    if not variance:
        return half
    return np.fmax(
        half, np.sqrt(np.mean(variance, axis=0) / sum(len(each) for each in alone))
    )
