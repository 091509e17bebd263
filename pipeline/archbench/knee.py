"""Knee: CPU of a study against the error of theta that its steps make, for three arches.

All settings run the same motions at the same levels, so that the motions themselves make no
difference. Every fourth level is one of four sets, each with all motions: what is left between
two settings is their error of ln theta and the chaos of single runs.
"""

from collections.abc import Mapping

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
    """Each arch by the reference and all settings."""
    rows: list[Row] = []
    levels = QUICK_LEVELS if bench.quick else LEVELS
    for arch in ARCHES:
        place = (bench.records, arch, bench.quick, levels)
        tasks = {
            (arch, bench.quick, *each.columns.values()): (each, 0, *place)
            for each in (REFERENCE, *SETTINGS)
        }
        found = bench.run("knee", run_study, tasks, LIMIT)
        studies = {
            each: Study("setting", each, 0, **result)
            for each, result in zip((REFERENCE, *SETTINGS), found.values(), strict=True)
            if not isinstance(result, str)
        }
        rows += [
            {"arch": arch, **row} for row in errors_of_theta(studies, np.array(levels))
        ]
    return {"settings": pd.DataFrame(rows)}


def errors_of_theta(studies: Mapping[Setting, Study], levels: Array) -> list[Row]:
    """Cost [s] and error of ln theta over sets: mean, its standard error, and root mean square."""
    theta = {
        setting: np.array(
            [
                curve_of(levels[k::SETS], study.counts[:, :, k::SETS])[0]
                for k in range(SETS)
            ]
        )
        for setting, study in studies.items()
    }
    rows = []
    for setting, own in theta.items():
        off = own - theta[REFERENCE]
        rows.append(
            {
                **setting.columns,
                "seconds": studies[setting].seconds
                * RUNS
                / studies[setting].counts[0].size,
                "theta": np.exp(np.nanmean(own)),
                "error": np.nanmean(off),
                "standard_error": np.nanstd(off, ddof=1)
                / np.isfinite(off).sum() ** 0.5,
                "rms": np.sqrt(np.nanmean(off**2)),
                "sets": int(np.isfinite(off).sum()),
            }
        )
    return rows
