"""Runs of a finished study that are simulated again, and films of them.

CSS moves each voussoir from key frame to key frame without a script. Paper, and readers who ask
for reduced motion, get four still frames.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.errors import InputError
from archfrag.files import counted, make_folder, number
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.motion import Motion
from archfrag.physics.methods.registry import AUTO
from archfrag.report.html import TEXTS, Picture, digits, px, template
from archfrag.report.inputs import ArchResults, ReportInputs, report_inputs
from archfrag.report.svg import (
    NARROW,
    FloatArray,
    Panel,
    Sheet,
    Triple,
    envelope,
    ribbon,
    trace,
)
from archfrag.simulation.response import Response
from archfrag.simulation.simulate import simulate
from archfrag.study.file.schema import StudyKeys
from archfrag.study.keys import meant
from archfrag.study.provenance import write_text

LONGEST = 8.0  # [s] of a run, shown in real time
_SAME_LEVEL = 0.005  # a level is written with three digits
_MOST_FRAMES = 40
_MOST_TRANSFORMS = 2400  # voussoirs by frames: about 50 bytes each
_CANDIDATES = 600
_HOLD = 1.5  # [s] that the last frame stays
_SMALL = 0.1  # largest rotation [rad] of a motion that is drawn three times as large
_STRIP = 46.0  # [px] of the ground's acceleration
Chosen = tuple[int, int, str]  # record, level, and why this run


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
    ground: str = "the ground"  #: what its motion is relative to

    @property
    def acceleration(self) -> FloatArray:
        """Acceleration of the ground in the run [g]."""
        return self.motion.acceleration * (self.factor / STANDARD_GRAVITY)


def choose(results: ArchResults, median: float = np.nan) -> Chosen | None:
    """Choose the record with the capacity nearest the median, at its lowest collapsing level.

    If `median` is nan, it is the median of these levels. If nothing collapsed, choose as
    `farthest` does.
    """
    collapsed = results.verdict == Verdict.COLLAPSED
    records = np.flatnonzero(collapsed.any(axis=1))
    if not records.size:
        return farthest(results)
    first = collapsed[records].argmax(axis=1)
    logs = np.log(results.levels[first])
    near = np.median(logs) if np.isnan(median) else np.log(median)
    place = np.abs(logs - near).argmin()
    reason = "the record with the capacity nearest the median, at its lowest collapsing level"
    return int(records[place]), int(first[place]), reason


def farthest(results: ArchResults) -> Chosen | None:
    """Choose the surviving run with the largest rotation; None if nothing rotated."""
    survived = results.verdict == Verdict.SURVIVED
    reach = np.where(survived, np.nan_to_num(results["peak_rotation"]), 0.0)
    record, level = np.unravel_index(int(reach.argmax()), reach.shape)
    reason = "the run that survived with the largest rotation of a voussoir"
    return (int(record), int(level), reason) if reach.any() else None


def typical_run(inputs: ReportInputs, name: str) -> Example | None:
    """Simulate again the run of an arch that `choose` finds.

    Return None if the arch does not stand, or if nothing moves.
    """
    chosen = choose(inputs.results(name), inputs.curves[name].theta)
    return repeat(inputs, name, chosen) if inputs.arches[name].stands else None


def repeat(inputs: ReportInputs, name: str, chosen: Chosen | None) -> Example | None:
    """Simulate a chosen run of a study again by the study's method, and keep its history.

    Return None if no run is chosen, or if the cube names no method.
    """
    method = dict(inputs.config.get("method", ()))
    if not method or chosen is None:
        return None
    arch = inputs.arches[name].arch
    results = inputs.results(name)
    record, level, reason = chosen
    kind = method.pop("name")
    motion = next(m for m in inputs.motions if m.id == results.records[record])
    factor = results["scale_factor"][record, level]
    if inputs.plan is not None:
        number = [member.id for member in inputs.plan.arches].index(name)
        motion, factor = inputs.plan.ground(number, record, factor)
    of_study = ("status", "steps", "collapse_time")
    status, steps, time = (results[each][record, level] for each in of_study)
    # `auto` may take a history by events; the study's verdict came by steps.
    for tried in (kind, "time_stepping"):
        response = simulate(
            arch, motion, scale=factor, method=tried, history=True, **method
        )
        same = bool(np.isclose(time, response.collapse_time, equal_nan=True))
        same = same and (status, steps) == (response.status, response.steps)
        if same or kind != AUTO:
            break
    about = "about " * (results.own_levels is not None)
    shown = (
        f"{about}{inputs.scale.measure} = {inputs.scale.text(results.levels[level])}"
    )
    apart = method.get("wave_speed") or method.get("bases")
    ground = "the ground at its left end" if apart else "the ground"
    motion = response.motion or motion
    return Example(arch, motion, factor, shown, response, reason, same, ground)


def example_of(
    study: StudyKeys, run: str = "median", arch: str | None = None
) -> Example:
    """Simulate one run of a finished study again.

    `run` and `arch` are as for `Results.response`. InputError if the study is not finished, or has
    no such arch or run.
    """
    inputs = report_inputs(study)
    names = list(inputs.arches)
    name = arch or names[0]
    if name not in names:
        hint = meant(name, names) or f"the report shows {', '.join(names)}"
        raise InputError(f"--arch {name}: is not an arch of the report; {hint}")
    if run == "median":
        example = typical_run(inputs, name)
    else:
        example = repeat(inputs, name, _named_run(inputs.results(name), run))
    if example is None:
        raise InputError(
            f"--run {run}: no run of {name} moved the arch, so there is no film"
        )
    return example


def _named_run(results: ArchResults, run: str) -> Chosen:
    """Return the run that RECORD@LEVEL names; InputError if there is no such run."""
    name, _, text = run.rpartition("@")
    unit = results.scale.unit
    try:
        level = number(re.sub(rf"\s*{re.escape(unit)}$", "", text))
    except ValueError:
        level = np.nan
    if not (name and level > 0.0):
        raise InputError(
            f"--run {run}: must be median or RECORD@LEVEL, such as "
            f"{results.records[0]}@{digits(results.levels[0])}"
        )
    if name not in results.records:
        hint = meant(name, results.records) or f"it has {', '.join(results.records)}"
        raise InputError(f"--run {run}: the study has no record {name}; {hint}")
    record = results.records.index(name)
    made = np.flatnonzero(results.simulated[record])
    levels = results.levels[made]
    if results.own_levels is not None:
        levels = results.own_levels[[record] * made.size]
    near = np.abs(np.log(levels / level))
    if not (near < _SAME_LEVEL).any():
        known = ", ".join(digits(value) for value in levels) or "none"
        raise InputError(
            f"--run {run}: {name} was run at {known} {unit}, not at {text}"
        )
    return record, int(made[near.argmin()]), "the run that was asked for"


def save_film(example: Example, path: Path) -> None:
    """Write a film as .svg, which browsers play.

    InputError if nothing moves, OutputError if the file cannot be written.
    """
    shown = film(
        example, "film", "A collapse" if example.response.collapsed else "A run"
    )
    if shown is None:
        raise InputError(f"{path}: nothing moves in this run, so there is no film")
    make_folder(path.parent)
    picture, _ = shown
    (moving,) = re.findall('<svg class="moving".*?</svg>', picture.svg, re.DOTALL)
    write_text(path, replace(picture, svg=moving).file)


def key_frames(example: Example) -> Triple | None:
    """Choose frames between which linear motion comes closest to that of the run.

    Return their times [s], centroids [m] and rotations [rad]; None if nothing moves.
    """
    time, shift, rotation = example.response._arrays()
    start, end = example.response._window(LONGEST)
    if start == end:
        return None
    size = np.ptp(np.concatenate(example.arch.outlines), axis=0).max()
    state = np.dstack([shift, 0.1 * size * rotation]).reshape(time.size, -1)
    first = int(np.searchsorted(time, start))
    last = int(np.searchsorted(time, end, "right")) - 1
    count = min(_CANDIDATES, last - first + 1)
    rows = np.unique(np.linspace(first, last, count).astype(int))
    most = int(np.clip(_MOST_TRANSFORMS // rotation.shape[1], 12, _MOST_FRAMES))
    kept = rows[_most_telling(time[rows], state[rows], most)]
    return time[kept], example.arch.centroids + shift[kept], rotation[kept]


def _most_telling(time: FloatArray, state: FloatArray, most: int) -> np.ndarray:
    """Choose at most `most` rows, between which the state is closest to linear in time.

    The first and the last row are chosen, then one by one the row farthest from linear.
    """
    kept = np.array([0, len(time) - 1])
    while kept.size < min(most, len(time)):
        right = np.searchsorted(kept, np.arange(len(time))).clip(1)
        a = kept[right - 1]
        b = kept[right]
        part = ((time - time[a]) / np.maximum(time[b] - time[a], 1e-12))[:, None]
        error = np.abs(state - (1.0 - part) * state[a] - part * state[b]).max(axis=1)
        error[kept] = -1.0
        kept = np.sort(np.append(kept, error.argmax()))
    return kept


def film(
    example: Example, name: str, title: str, enlarged: bool = False, columns: int = 4
) -> tuple[Picture, Picture] | None:
    """Return two pictures of a run, moving and as four still frames; None if nothing moves.

    `columns` is the number of still frames in a row. If `enlarged`, a small motion is drawn three
    times as large as it is.
    """
    frames = key_frames(example)
    if frames is None:
        return None
    arch = example.arch
    time, place, rotation = frames
    larger = 3.0 if enlarged and np.abs(rotation).max() < _SMALL else 1.0
    place = arch.centroids + larger * (place - arch.centroids)
    rotation = larger * rotation
    fill = [mark for mark in arch.marks if mark.role in ("earth", "backing")]
    corners = np.vstack(
        [*arch._frame(place, rotation, 0.06), *(mark.points for mark in fill)]
    )
    low = corners.min(axis=0)
    high = corners.max(axis=0)
    wide, tall = (high - low).tolist()
    scale = min(NARROW / wide, 300.0 / tall)
    origin = (low[0] - 0.5 * (NARROW / scale - wide), high[1])
    height = scale * tall

    def pixels(points: FloatArray, at: ArrayLike = origin) -> FloatArray:
        """Return points [m] in pixels; the pixels count from the point `at` [m]."""
        return scale * (points - np.asarray(at)) * (1.0, -1.0)

    rods = []  # left end [px], angle [degrees] and length [px] of each tie over time
    for tie in (mark for mark in arch.marks if mark.role == "tie"):
        left, right = pixels(tie.moved(arch.centroids, place, rotation)).swapaxes(0, 1)
        along = right - left
        angle = np.rad2deg(np.unwrap(np.arctan2(along[:, 1], along[:, 0])))
        rods.append(np.column_stack([left, angle, np.hypot(*along.T)]).tolist())
    count = sum(len(span.bodies) for span in arch.spans)
    bodies = counted(count, "block" if arch.free_end else "voussoir")
    bodies += f" in {len(arch.spans)} spans" * (len(arch.spans) > 1)
    bodies += " on piers" * any("pier" in part.name for part in arch.parts)
    if example.response.collapsed and arch.places:
        title += f" at {example.response.collapse_place}"
    what = f"{title}: {bodies} under {example.motion.id}, {example.level}"
    duration = time[-1] - time[0] + _HOLD
    moves = np.dstack([pixels(place), -np.rad2deg(rotation)])
    reach = np.abs(rotation).max(axis=1)
    drawn = {
        "name": name,
        "label": what,
        "width": NARROW,
        "height": height,
        "strip": _STRIP,
        "shapes": [
            trace(*pixels(o, at).T) for o, at in zip(arch.outlines, arch.centroids)
        ],
        "fill": [(mark.role, trace(*pixels(mark.points).T)) for mark in fill],
        "rest": pixels(arch.centroids).tolist(),
        "moves": moves.swapaxes(0, 1).tolist(),
        "ties": rods,
        "percent": (100.0 * (time - time[0]) / duration).tolist(),
        "duration": duration,
        "time": time,
        "stills": _stills(reach, bool(example.response.collapsed)),
        "ground": _ground_below(example, height, (time[0], time[-1])),
    }
    shown = "true to scale" if larger == 1.0 else "drawn three times as large as it is"
    caption = TEXTS["film"]["caption"].format(
        what=what,
        reason=example.reason,
        frames=time.size,
        size=shown,
        ground=example.ground,
        start=time[0],
        end=time[-1],
    ) + TEXTS["film"]["fill"] * bool(fill)
    strip = template("stills.html.j2", **drawn, columns=columns, kind="strip")
    moving = Picture(template("film.html.j2", **drawn), caption)
    return moving, Picture(strip, what)


def _stills(reach: FloatArray, collapsed: bool) -> list[int]:
    """Choose four frames by `reach` (n_time,), the largest rotation in each frame.

    Those of a collapse show how it grows; those of another run are the largest in each quarter.
    """
    if collapsed:
        grown = reach >= np.outer([0.0, 0.33, 0.67, 1.0], reach.max())
        return grown.argmax(axis=1).tolist()
    parts = np.array_split(np.arange(reach.size), min(4, reach.size))
    return [int(part[reach[part].argmax()]) for part in parts]


def _ground_below(example: Example, height: float, ends: tuple[float, float]) -> Markup:
    """Return the acceleration of the ground between two times, drawn below `height` [px]."""
    sheet = Sheet(NARROW)
    box = 12.0, height + 2.0, NARROW - 12.0, height + 2.0 + _STRIP
    panel = Panel(sheet, box, ends, (-1, 1))
    seen = draw_ground(panel, example, 240)
    part = seen <= 0.995 * np.abs(example.acceleration).max()
    which = "peak" + " of the window" * bool(part)
    words = f"time [s], with the ground acceleration ({which} {seen:.2g} g)"
    panel.axis_x(words)
    return Markup("".join(sheet.parts))


def draw_ground(panel: Panel, example: Example, bins: int) -> float:
    """Draw the acceleration of the ground [g] in a panel over time; return its peak."""
    start, end = panel.x
    acceleration = example.acceleration
    times = np.arange(acceleration.size) * example.motion.dt
    shown = np.concatenate([[start], times[(times > start) & (times < end)], [end]])
    place, low, high = envelope(np.interp(shown, times, acceleration, right=0.0), bins)
    peak = max(np.abs([low, high]).max(), 1e-9)
    panel.y = (-1.05 * peak, 1.05 * peak)
    panel.sheet.path(
        f"M{px(panel.box[0])} {px(float(panel.at_y(0.0)))}H{px(panel.box[2])}",
        kind="gr",
    )
    x = panel.at_x(np.interp(place, np.arange(shown.size), shown))
    panel.sheet.path(ribbon(x, panel.at_y(low), panel.at_y(high)), kind="ground")
    return peak
