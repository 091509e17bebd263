"""One run of the study, simulated again with its history, and the log of its mechanism."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import Model
from archfrag.methods.registry import AUTO
from archfrag.motions.motion import Motion
from archfrag.report import drawing as look
from archfrag.report.axes import Panel, even_ticks
from archfrag.report.drawing import BELOW, BESIDE, LINE, Entry, FloatArray, Sheet, figure
from archfrag.report.motions import envelope
from archfrag.report.results import ArchResults, IntArray, digits, study_config
from archfrag.simulation.response import MODEL_WORDS, MechanismChange, Response
from archfrag.study.runs.outcome import simulate_case

Chosen = tuple[int, int, str]  # record, level, and why this run
# What a joint may be seen doing; a sliding hinge is drawn as a hinge, hatched.
JOINT_LOOK = (
    Entry("hinge at intrados", look.BLUE),
    Entry("hinge at extrados", look.VERMILION),
    Entry("sliding hinge at intrados", look.BLUE, "slash"),
    Entry("sliding hinge at extrados", look.VERMILION, "slash"),
    Entry("slides", look.ORANGE, "cross"),
    Entry("open", look.INK),
)
_STATES = ("closed", *(entry.label for entry in JOINT_LOOK))
MODEL_LOOK = {
    Model.REST: Entry(MODEL_WORDS[Model.REST], look.PALE),
    Model.FOUR_HINGES: Entry(MODEL_WORDS[Model.FOUR_HINGES], look.SKY),
    Model.MEGA_VOUSSOIRS: Entry(MODEL_WORDS[Model.MEGA_VOUSSOIRS], look.GREEN, "dots"),
    Model.ALL_VOUSSOIRS: Entry(MODEL_WORDS[Model.ALL_VOUSSOIRS], look.PURPLE, "slash"),
}
_BINS, _TRACE = 600, 300


@dataclass(frozen=True)
class Example:
    """A run that was simulated again."""

    arch: Arch
    motion: Motion  #: unscaled
    factor: float  #: on the motion
    level: str  #: intensity, with its measure and unit
    response: Response
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
        return farthest(results, "peak_displacement", "displacement", -0.5)
    first = fell[records].argmax(axis=1)
    logs = np.log(results.levels[first])
    centre = np.median(logs) if median is None else np.log(median)
    place = int(np.abs(logs - centre).argmin())
    what = "median capacity" if median is not None else "middle one of the capacities"
    reason = f"the record whose capacity is nearest the {what}, at its lowest collapsing level"
    return int(records[place]), int(first[place]), reason


def farthest(
    results: ArchResults, name: str = "peak_rotation", words: str = "rotation of a voussoir",
    above: float = 0.0,
) -> Chosen | None:  # fmt: skip
    """The standing run with the largest value of a table; None if none is above some value."""
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
    """Simulate a run of a study again, with the study's method and its history."""
    method = study_config(cube).get("method")
    if method is None or chosen is None:
        return None
    record, level, reason = chosen
    motion = next(m for m in motions if m.id == results.records[record])
    factor = float(results["scale_factor"][record, level])
    then = [results[name][record, level] for name in ("status", "steps", "collapse_time")]
    # `auto` may take a history by events; the study's verdict came by steps.
    for name in (method["name"], "time_stepping"):
        response = simulate_case({**method, "name": name}, arch, motion, factor, history=True)
        same = then[:2] == [response.status, response.steps] and bool(
            np.isclose(then[2], response.collapse_time, equal_nan=True)
        )
        if same or method["name"] != AUTO:
            break
    about = "about " if results.own_levels is not None else ""
    scale, shown = results.scale, digits(results.levels[level])
    shown = f"{about}{scale.measure} = {shown} {scale.unit}"
    return Example(arch, motion, factor, shown, response, reason, same)


@figure
def timeline(sheet: Sheet, example: Example) -> tuple[str, str] | None:
    """Ground motion, joints and model of the ladder over time; None if nothing moved."""
    changes, response = example.response.mechanism or (), example.response
    # Entries that last, or last for a time not known, in another model than rest.
    moving = [c for c in changes if c.model != "rest" and not c.until <= c.time]
    if not moving:
        return None
    first, last = moving[0].time, moving[-1].until
    last = last if np.isfinite(last) else response.end_time
    margin = 0.03 * max(last - first, 1e-3)
    start, end = max(0.0, first - margin), min(response.end_time, last + margin)
    edges = np.linspace(start, end, _BINS + 1)
    n_joint = example.arch.n_joint
    joints, models = sampled(changes, n_joint, edges)
    used = [(k, entry) for k, entry in enumerate(JOINT_LOOK, start=1) if np.any(joints == k)]
    seen = [MODEL_LOOK[Model(code)] for code in np.unique(models)]
    entries = [entry for _, entry in used]
    entries += [model._replace(label=f"model: {model.label}") for model in seen]
    top = sheet.legend(BESIDE, 0.0, entries) + LINE + 4.0
    right, height = sheet.width - 10.0, float(np.clip(15.0 * n_joint, 70.0, 400.0))
    _ground(Panel(sheet, (BESIDE, top, right, top + 62.0), (start, end), (-1.0, 1.0)), example)
    ended = response.status.name.lower().replace("_", " ")
    if response.collapsed:
        ended = f"contact lost at {response.collapse_time:.2f} s, joint {response.collapse_joint}"
    sheet.text(BESIDE, top - 6.0, f"{example.level}: {ended}", "b")
    box = BESIDE, top + 72.0, right, top + 72.0 + height
    middle = Panel(sheet, box, (start, end), (-0.6, n_joint - 0.4))
    step = max(1, -(-n_joint // int(height / 13.0)))
    middle.axis_y(np.arange(0, n_joint, step), "joint")
    for k, (_, colour, mark) in used:
        middle.cells((joints == k).T, colour, mark, edges, 0.4)
    bottom = middle.box[3] + 8.0
    lowest = Panel(sheet, (BESIDE, bottom, right, bottom + 14.0), (start, end), (-0.5, 0.5))
    for code, (_, colour, mark) in zip(np.unique(models), seen):
        lowest.cells(models[None] == code, colour, mark, edges)
    sheet.text(BESIDE - 5.0, bottom + 11.0, "model", "s e")
    lowest.axis_x(even_ticks(start, end, 5 if sheet.narrow else 9), "time [s]")
    if response.collapsed:
        line = f"M{float(lowest.at_x(response.collapse_time)):.1f} {top:.1f}V{bottom:.1f}"
        sheet.path(line, stroke=look.INK, stroke_dasharray="4 2")
    sheet.height = bottom + 14.0 + BELOW
    differs = "" if example.same else (
        " This repetition did not end as the run in the cube did: versions or machine differ from "
        "those that made the cube."
    )  # fmt: skip
    return (
        f"Mechanism over time under {example.motion.id}: hinges, sliding and open joints, and the "
        "model of the ladder",
        f"Log of the mechanism under {example.motion.id} at {example.level}, {example.reason}. "
        "Joint 0 is the left springing, or the base of a free-standing chain; joints without a "
        f"bar are closed and stick. Dashed: contact lost for good.{differs}",
    )


def sampled(
    changes: Sequence[MechanismChange], n_joint: int, edges: FloatArray
) -> tuple[IntArray, IntArray]:
    """States of the joints and the model at the middle of each bin of time."""
    states = np.zeros((len(changes), n_joint), dtype=np.int64)
    for i, change in enumerate(changes):
        for joint, text in change.joints.items():
            if text.startswith("hinge"):
                sliding = "sliding " if "sliding" in text else ""
                state = f"{sliding}hinge at {text.split()[1]}"
            else:
                state = "slides" if text.startswith("slides") else "open"
            states[i, joint] = _STATES.index(state)
    models = np.array([Model[change.model.upper()] for change in changes], dtype=np.int64)
    middle = 0.5 * (edges[:-1] + edges[1:])
    since = np.searchsorted([change.time for change in changes], middle, side="right") - 1
    return states[np.maximum(since, 0)], models[np.maximum(since, 0)]


def _ground(panel: Panel, example: Example) -> None:
    times, acceleration = example.ground
    start, end = panel.x
    shown = np.concatenate([[start], times[(times > start) & (times < end)], [end]])
    place, low, high = envelope(np.interp(shown, times, acceleration, right=0.0), _TRACE)
    reach = 1.05 * max(float(np.abs([low, high]).max()), 1e-9)
    panel.y = (-reach, reach)
    panel.axis_y(even_ticks(-reach, reach, 4), "ground [g]")
    panel.band(np.interp(place, np.arange(shown.size), shown), low, high, look.GREY, 1.0)
