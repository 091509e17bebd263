"""One run of the study, done again with its history, to show the log of its mechanism."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from archfrag.arch import Arch
from archfrag.fragility.counts import Verdict
from archfrag.report.summary import ArchResults, study_config
from archfrag.study.outcome import simulate_case

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from archfrag.motions.motion import Motion
    from archfrag.simulation.response import Response


@dataclass(frozen=True)
class Example:
    """A run that was done again.

    Attributes
    ----------
    arch : Arch
    motion : Motion
        Unscaled.
    factor : float
        On the motion.
    level : str
        Intensity, with its measure and unit.
    response : Response
        With its history.
    reason : str
        Why this run was chosen.
    same : bool
        Whether it ended as in the study: status, steps and time of collapse.
    """

    arch: Arch
    motion: "Motion"
    factor: float
    level: str
    response: "Response"
    reason: str
    same: bool


def choose(results: ArchResults, median: float | None) -> tuple[int, int, str] | None:
    """Which run to show: record, level, reason; None if no run collapsed or stood.

    The record whose capacity, the lowest level that brings the arch down, is nearest the median
    in its logarithm, at that level; the middle one of the capacities where there is no curve;
    the standing run that was displaced most where nothing collapsed.
    """
    fell = results.verdict == Verdict.COLLAPSED
    records = np.flatnonzero(fell.any(axis=1))
    if records.size:
        first = fell[records].argmax(axis=1)
        logs = np.log(results.levels[first])
        centre = np.median(logs) if median is None else np.log(median)
        place = int(np.abs(logs - centre).argmin())
        what = "median capacity" if median is not None else "middle one of the capacities"
        reason = f"the record whose capacity is nearest the {what}, at its lowest collapsing level"
        return int(records[place]), int(first[place]), reason
    stood = results.verdict == Verdict.STANDING
    if not stood.any():
        return None
    reach = np.where(stood, results.peak_displacement, -1.0)
    record, level = np.unravel_index(int(reach.argmax()), reach.shape)
    return int(record), int(level), "the standing run with the largest displacement"


def near_miss(results: ArchResults) -> tuple[int, int, str] | None:
    """The run that stood with the largest rotation of a voussoir; None if none moved."""
    reach = results.peak_rotation
    if reach is None:
        return None
    reach = np.where(results.verdict == Verdict.STANDING, np.nan_to_num(reach), -1.0)
    record, level = np.unravel_index(int(reach.argmax()), reach.shape)
    if not reach[record, level] > 0.0:
        return None
    return int(record), int(level), "the standing run with the largest rotation of a voussoir"


def repeat(
    cube: "xr.Dataset",
    results: ArchResults,
    arch: Arch,
    motions: "Sequence[Motion]",
    chosen: tuple[int, int, str] | None,
) -> Example | None:
    """Do a run of a study again, with the study's method and its history."""
    method = study_config(cube).get("method")
    if method is None or chosen is None:
        return None
    record, level, reason = chosen
    motion = next(m for m in motions if m.id == results.records[record])
    factor = float(results.factors[record, level])
    response = simulate_case(method, arch, motion, factor, history=True)
    same = (
        int(results.status[record, level]) == int(response.status)
        and int(results.steps[record, level]) == response.steps
        and np.allclose(
            results.collapse_time[record, level], response.collapse_time, equal_nan=True
        )
    )
    shown = f"{results.scale.measure} = {results.level_texts[level]}"
    if results.grouped:
        shown = f"about {shown}"
    return Example(arch, motion, factor, shown, response, reason, bool(same))
