"""Knee: CPU of a study against the error of theta that its steps make, for three arches.

All settings run the same motions at the same levels, so that the motions themselves make no
difference. Every fourth level is one of four sets, each with all motions: what is left between
two settings is their error of ln theta and the chaos of single runs.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from archbench.fragility import ARCHES, LIMIT, Study, curve_of, run_study
from archbench.runner import Bench, Row
from archbench.scene import Array
from archbench.settings import Setting

SETS = 4
# More runs than a study has, since differences of a per cent are asked for.
LEVELS, QUICK_LEVELS = (
    tuple(np.geomspace(0.8, 3.4, n).round(6).tolist()) for n in (108, 20)
)
RUNS = 450  # of a study, for which its cost is given
REFERENCE = Setting("time_stepping", "dt", 1e-4)
SETTINGS = [Setting("auto", "rtol", value) for value in (1e-2, 3e-3, 1e-3, 3e-4)]
SETTINGS += [Setting("time_stepping", "dt", value) for value in (2e-3, 1e-3, 5e-4)]


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Each arch by the reference and all settings, which take turns at one set of levels."""
    levels = QUICK_LEVELS if bench.quick else LEVELS
    chosen = (REFERENCE, *SETTINGS)
    tasks = {
        (arch, k, *each.columns.values()): (each, 0, arch, bench.quick, levels[k::SETS])
        for arch in ARCHES
        for k in range(SETS)
        for each in chosen
    }
    found = bench.run("knee", run_study, tasks, LIMIT)
    rows: list[Row] = []
    for arch in ARCHES:
        studies: dict[Setting, list[Study]] = {}
        for each in chosen:
            own = [found.get((arch, k, *each.columns.values())) for k in range(SETS)]
            parts = [
                Study("", each, 0, **part) for part in own if isinstance(part, dict)
            ]
            if len(parts) == SETS:
                studies[each] = parts
        if REFERENCE in studies:
            known = errors_of_theta(studies, np.array(levels))
            rows += [{"arch": arch, **row} for row in known]
    return {"settings": pd.DataFrame(rows)}


def errors_of_theta(
    studies: Mapping[Setting, Sequence[Study]], levels: Array
) -> list[Row]:
    """Cost [s] and error of ln theta over sets: mean, its standard error, and root mean square."""
    theta = {
        setting: np.array(
            [curve_of(levels[k::SETS], own.counts)[0] for k, own in enumerate(sets)]
        )
        for setting, sets in studies.items()
    }
    rows = []
    for setting, own in theta.items():
        off = own - theta[REFERENCE]
        rows.append(
            {
                **setting.columns,
                "seconds": RUNS
                * sum(each.seconds for each in studies[setting])
                / sum(each.counts[0].size for each in studies[setting]),
                "theta": np.exp(np.nanmean(own)),
                "error": np.nanmean(off),
                "standard_error": np.nanstd(off, ddof=1)
                / np.isfinite(off).sum() ** 0.5,
                "rms": np.sqrt(np.nanmean(off**2)),
                "sets": int(np.isfinite(off).sum()),
            }
        )
    return rows
