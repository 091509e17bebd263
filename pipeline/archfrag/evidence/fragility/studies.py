"""Whole fragility studies, run by one way after another on the same records and levels."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.evidence.part import Setup, in_processes
from archfrag.evidence.run import Way
from archfrag.motions.index import load_index
from archfrag.motions.motion import Motion
from archfrag.motions.read import load_motion, read_motion
from archfrag.motions.scale import scale_factor
from archfrag.simulate import warmup
from archfrag.study.outcome import row_of

# Of the motion, so that nothing but the integration is disturbed: an initial state displaced by
# as much would open or press contacts by itself, and start a method that begins at rest in
# another branch of its code. From the first motion on the two are the same.
DISTURBANCE = 1e-9


@dataclass(frozen=True)
class Records:
    """The motions and the levels of a study of the main job's arch.

    Attributes
    ----------
    study : str
        "shipped" or "real".
    motions : sequence of Motion
    levels : sequence of float
        PGA [g].
    """

    study: str
    motions: Sequence[Motion]
    levels: Sequence[float]

    @property
    def runs(self) -> int:
        """Of one way, once."""
        return len(self.motions) * len(self.levels)


def shipped_records(setup: Setup) -> Records:
    """The main job's records and levels: every second level and two of three records if quick."""
    entries = load_index(setup.places.shipped)
    levels = np.linspace(0.2, 3.0, 15).round(12)
    if setup.quick:
        entries = [entry for number, entry in enumerate(entries) if number % 3 != 2]
        levels = levels[::2]
    return Records("shipped", [load_motion(entry) for entry in entries], levels.tolist())


def real_records(setup: Setup) -> Records | None:
    """Real components of the folder `at2`; None if there are not two of them."""
    folder = setup.places.real
    paths = [] if folder is None else sorted(folder.glob("at2/*"))
    paths = [path for path in paths if path.suffix.lower() == ".at2"]
    if len(paths) < 2:
        return None
    levels = np.linspace(0.4, 5.3, 15).round(12)
    return Records(
        "real", [read_motion(path) for path in paths], levels[:: 2 if setup.quick else 1].tolist()
    )


@lru_cache(maxsize=1)
def main_arch() -> Arch:
    """The arch of the main job (configs/shipped.yaml)."""
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)


@lru_cache
def _ready(method: str) -> None:
    warmup(method)


def run_record(
    way: Way, motion: Motion, levels: Sequence[float], repetition: int
) -> list[tuple[int, int, float]]:
    """One record at all levels.

    Parameters
    ----------
    way : Way
    motion : Motion
    levels : sequence of float
        PGA [g].
    repetition : int
        0 as it is; k with the motion larger by k times `DISTURBANCE`.

    Returns
    -------
    list of (int, int, float)
        Verdict (`archfrag.fragility.counts.Verdict`), steps, and the CPU time of the process [s],
        kernels loaded before.
    """
    _ready(way.method)
    unit = scale_factor(motion, "PGA", STANDARD_GRAVITY) * (1.0 + DISTURBANCE * repetition)
    rows = []
    for level in levels:
        began = time.process_time()
        response = af.simulate(main_arch(), motion, scale=unit * level, **way.options)
        spent = time.process_time() - began
        rows.append((int(row_of(response)["verdict"]), response.steps, spent))
    return rows


def run_studies(wanted: Sequence[tuple[Records, Way, int]], workers: int) -> pd.DataFrame:
    """Every study, way and repetition asked for: one row for each run.

    Returns
    -------
    DataFrame
        Columns study, way, repetition, record, level [g], verdict, steps, cpu_seconds; in the
        order asked for, whatever the number of workers.
    """
    for method in dict.fromkeys(way.method for _, way, _ in wanted):
        _ready(method)
    tasks = [
        (way, motion, records.levels, repetition)
        for records, way, repetition in wanted
        for motion in records.motions
    ]
    return pd.DataFrame(
        _rows(wanted, iter(in_processes(run_record, tasks, workers))),
        columns=["study", "way", "repetition", "record", "level", "verdict", "steps",
                 "cpu_seconds"],
    )  # fmt: skip


def _rows(
    wanted: Sequence[tuple[Records, Way, int]], found: Iterator[list[tuple[int, int, float]]]
) -> Iterator[tuple]:
    for records, way, repetition in wanted:
        for motion in records.motions:
            for level, row in zip(records.levels, next(found), strict=True):
                yield (records.study, str(way), repetition, motion.id, level, *row)


def predicted_seconds(records: Records, way: Way) -> float:
    """CPU time of a study by a way [s], from one run near the curve's median."""
    motion = sorted(records.motions, key=lambda each: each.duration)[len(records.motions) // 2]
    level = records.levels[int(0.6 * len(records.levels))]
    return records.runs * run_record(way, motion, [level], 0)[0][2]
