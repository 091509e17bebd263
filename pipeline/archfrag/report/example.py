"""One run of the study, done again with its history, to show the log of its mechanism."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.fragility.counts import Verdict
from archfrag.methods.registry import AUTO
from archfrag.motions.motion import Motion
from archfrag.report.picture import FloatArray
from archfrag.report.summary import ArchResults, study_config
from archfrag.simulation.response import Response
from archfrag.study.outcome import simulate_case

Chosen = tuple[int, int, str]  # record, level, and why this run


@dataclass(frozen=True)
class Example:
    """A run that was done again."""

    arch: Arch
    motion: Motion  #: unscaled
    factor: float  #: on the motion
    level: str  #: intensity, with its measure and unit
    response: Response  #: with its history
    reason: str  #: why this run was chosen
    same: bool  #: whether it ended as in the study: status, steps and time of collapse

    @property
    def ground(self) -> tuple[FloatArray, FloatArray]:
        """Times of the samples [s] and the ground's acceleration [g]."""
        ground = np.asarray(self.motion.acceleration, dtype=float) * self.factor
        return np.asarray(np.arange(ground.size) * self.motion.dt), ground / STANDARD_GRAVITY


def choose(results: ArchResults, median: float | None) -> Chosen | None:
    """Which run to show: record, level, reason; None if no run collapsed or stood.

    The record whose capacity, the lowest level that brings the arch down, is nearest the median
    in its logarithm, at that level; the middle one of the capacities where there is no curve;
    the standing run that was displaced most where nothing collapsed.
    """
    fell = results.verdict == Verdict.COLLAPSED
    records = np.flatnonzero(fell.any(axis=1))
    if not records.size:
        return _farthest(results, "peak_displacement", "displacement", -0.5)
    first = fell[records].argmax(axis=1)
    logs = np.log(results.levels[first])
    centre = np.median(logs) if median is None else np.log(median)
    place = int(np.abs(logs - centre).argmin())
    what = "median capacity" if median is not None else "middle one of the capacities"
    reason = f"the record whose capacity is nearest the {what}, at its lowest collapsing level"
    return int(records[place]), int(first[place]), reason


def near_miss(results: ArchResults) -> Chosen | None:
    """The run that stood with the largest rotation of a voussoir; None if none moved."""
    return _farthest(results, "peak_rotation", "rotation of a voussoir", 0.0)


def _farthest(results: ArchResults, name: str, words: str, above: float) -> Chosen | None:
    """The standing run with the largest value of a table, if it is above some value."""
    reach = np.nan_to_num(results[name])
    reach = np.where(results.verdict == Verdict.STANDING, reach, -1.0)
    record, level = np.unravel_index(int(reach.argmax()), reach.shape)
    if not reach[record, level] > above:
        return None
    return int(record), int(level), f"the standing run with the largest {words}"


def repeat(
    cube: xr.Dataset, results: ArchResults, arch: Arch, motions: Sequence[Motion],
    chosen: Chosen | None,
) -> Example | None:  # fmt: skip
    """Do a run of a study again, with the study's method and its history."""
    method = study_config(cube).get("method")
    if method is None or chosen is None:
        return None
    record, level, reason = chosen
    motion = next(m for m in motions if m.id == results.records[record])
    factor = float(results.factors[record, level])
    then = [results[name][record, level] for name in ("status", "steps", "collapse_time")]
    # `auto` may take a history by events; the study's verdict came by steps.
    for name in (method["name"], "time_stepping"):
        response = simulate_case({**method, "name": name}, arch, motion, factor, history=True)
        same = then[:2] == [response.status, response.steps] and bool(
            np.isclose(then[2], response.collapse_time, equal_nan=True)
        )
        if same or method["name"] != AUTO:
            break
    about = "about " if results.grouped else ""
    shown = f"{about}{results.scale.measure} = {results.level_text(level)}"
    return Example(arch, motion, factor, shown, response, reason, same)
