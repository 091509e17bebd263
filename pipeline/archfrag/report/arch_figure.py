"""An arch with hinges and thrust lines at onset, and runs of it that are simulated again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from archfrag.arch import Arch
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.motion import Motion
from archfrag.physics.methods.registry import AUTO
from archfrag.report import svg as look
from archfrag.report.html import digits, onset_text
from archfrag.report.inputs import ArchResults, ReportInputs, study_config
from archfrag.report.svg import Entry, FloatArray, Panel, Sheet, figure
from archfrag.simulation.response import Response
from archfrag.simulation.simulate import Onset, simulate

Chosen = tuple[int, int, str]  # record, level, and why this run


@figure
def arch_at_onset(sheet: Sheet, arch: Arch, onset: Onset, name: str) -> str | tuple[str, str]:
    """Draw the arch twice: ground accelerating towards +x, and towards -x."""
    if not onset.stands:
        _at_onset(sheet, (0.0, 0.0, sheet.width), arch, onset, 0)
        return f"{name}, which does not stand under its own weight", "There is no onset."
    key = [Entry("thrust at onset", look.VERMILION, "line")]
    key += [Entry("thrust at rest", look.SOFT, "dash"), Entry("hinge", look.BLUE, "dot")]
    if len(onset.sliding) or len(onset.sliding_minus):
        key.append(Entry("sliding joint", look.ORANGE))
    top = sheet.legend(8.0, 0.0, key, sheet.width - 16.0)
    each, words = sheet.width if sheet.narrow else 0.5 * sheet.width, []
    for sign, direction, limit in ((1, "+x", onset.plus), (-1, "−x", onset.minus)):
        left = 0.0 if sheet.narrow or sign > 0 else each
        words.append(f"{onset_text(limit)} towards {direction}")
        sheet.text(left + 8.0, top + 14.0, f"ground accelerating: {words[-1]}", "b")
        _at_onset(sheet, (left, top + 20.0, each), arch, onset, sign)
        top = sheet.height + 4.0 if sheet.narrow else top
    return f"{name} with hinges and thrust line at onset: {', '.join(words)}"


def _at_onset(
    sheet: Sheet, box: tuple[float, float, float], arch: Arch, onset: Onset, sign: int
) -> None:
    """An arch in a box (left, top, width [px]) with the mechanism of a direction, if it stands."""
    left, top, width = box
    # Numbers of joints stand beside the springings.
    most = min(width - 46.0, 330.0), 260.0
    panel = arch_panel(sheet, arch, left + 0.5 * width, top + 16.0, most)
    reach, ground = 0.5 * (panel.box[2] - panel.box[0]), panel.box[3]
    middle = panel.box[0] + reach
    if sign:
        _, hinges, sliding = onset.mechanism("+x" if sign > 0 else "-x")
        thrusts = onset.thrust_line(), onset.thrust_line("+x" if sign > 0 else "-x")
        strokes = (look.SOFT, 1.1, "4 2.5"), (look.VERMILION, 1.5)
        for thrust, stroke in zip(thrusts, strokes):
            if thrust is not None:
                panel.line(*thrust.T, *stroke)
        for joint in sliding:
            x, y = np.transpose([arch.intrados[joint], arch.extrados[joint]])
            panel.line(x, y, look.ORANGE, 4.0)
        draw_hinges(panel, arch, hinges)
        y, half = ground + 13.0, sign * 0.32 * reach
        sheet.path(f"M{middle - reach:.1f} {ground:.1f}h{2 * reach:.1f}", kind="ax")
        line = f"M{middle - half:.1f} {y:.1f}H{middle + half:.1f}"
        sheet.path(line, stroke=look.INK, stroke_width=1.3)
        tip = f"M{middle + half + sign * 7:.1f} {y:.1f}l{-sign * 9:.1f} -4v8z"
        sheet.path(tip, fill=look.INK)
    for joint in range(0, arch.n_joint, -(-arch.n_joint // 15)):
        _label_joint(panel, arch, joint, 11.0, str(joint), "s q")
    sheet.height = max(sheet.height, ground + 24.0)


def arch_panel(
    sheet: Sheet, arch: Arch, middle: float, top: float, most: tuple[float, float]
) -> Panel:
    """Draw bodies, fill and ties to scale below `top`, within a width and height [px]."""
    fill = arch.fill_outlines
    points = np.concatenate([*arch.outlines, *fill])
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-9)
    wide, high = (min(np.divide(most, size)) * size).tolist()
    box = (middle - 0.5 * wide, top, middle + 0.5 * wide, top + high)
    panel = Panel(sheet, box, (low[0], low[0] + size[0]), (low[1], low[1] + size[1]))
    kinds = ["earth", "backing"][: len(fill)] + ["stone"] * arch.n_voussoir
    for kind, outline in zip(kinds, [*fill, *arch.outlines]):
        x, y = np.transpose(outline)
        d = look.trace(panel.at_x(x), panel.at_y(y))
        sheet.path(f"{d}z", kind=kind, stroke_width=0.8)
    for line in arch.tie_lines:
        x, y = line.T
        panel.line(x, y, look.BLUE, 1.6)
    return panel


def _label_joint(
    panel: Panel, arch: Arch, joint: int, away: float, words: str, kind: str,
    others: list[FloatArray] | None = None,
) -> bool:  # fmt: skip
    """Write words outward of the extrados of a joint, or inward of its intrados if `away` [px] is
    negative.

    They are not written where they would cover one of the `others`, boxes of words to which theirs
    is added. Returned is whether they were.
    """
    along = arch.extrados[joint] - arch.intrados[joint]
    place = arch.extrados[joint] if away > 0.0 else arch.intrados[joint]
    right, up = away * along / np.linalg.norm(along)
    x, y = float(panel.at_x(place[0])) + right, float(panel.at_y(place[1])) - up + 3.5
    side = "m" if abs(right) < 0.3 * abs(away) else "e" if right < 0.0 else ""
    if others is not None:
        wide = look.text_width(words, look.SMALL)
        left = x - wide * {"m": 0.5, "e": 1.0, "": 0.0}[side]
        box = np.array([left - 3.0, y - 8.5, left + wide + 3.0, y + 3.0])
        if any(((box[:2] < other[2:]) & (box[2:] > other[:2])).all() for other in others):
            return False
        others.append(box)
    panel.sheet.text(x, y, words, f"{kind} {side}".rstrip())
    return True


def draw_hinges(panel: Panel, arch: Arch, hinges: Sequence[tuple[int, str]]) -> None:
    """Draw a dot at each hinge, given by joint and side, "intrados" or "extrados"."""
    for joint, side in hinges:
        x, y = getattr(arch, side)[joint, :, None]
        panel.dots(x, y, look.BLUE, "hinge", 4.0)


@figure
def lost_joints(sheet: Sheet, arch: Arch, results: ArchResults) -> str | None:
    """The arch with a dot at each joint that lost contact, by how often; None without collapse."""
    joint_of = results["collapse_joint"][results.verdict == Verdict.COLLAPSED]
    joints, counts = np.unique(joint_of, return_counts=True)
    if not joints.size:
        return None
    most = min(sheet.width, 480.0) - 110.0, 240.0
    panel = arch_panel(sheet, arch, 0.5 * sheet.width, 28.0, most)
    named = list[FloatArray]()  # boxes of words: left, top, right, bottom
    for i in np.argsort(-counts, kind="stable"):
        joint, part = int(joints[i]), counts[i] / counts.sum()
        x, y = 0.5 * (arch.intrados[joint] + arch.extrados[joint])[:, None]
        radius = float(2.0 + 8.0 * np.sqrt(counts[i] / counts.max()))
        panel.dots(x, y, look.VERMILION, "hinge", radius)
        words = f"{100 * part:.0f} %"
        if not _label_joint(panel, arch, joint, 14.0, words, "s", named):
            _label_joint(panel, arch, joint, -14.0, words, "s", named)
    sheet.height = panel.box[3] + 14.0
    return f"Joints of {results.arch} that lost contact for good, by how often"


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


def choose(results: ArchResults, median: float | None) -> Chosen | None:
    """Run whose lowest collapsing level is nearest the median of the arch, or of these levels if
    it has none; `farthest` if nothing collapsed.
    """
    collapsed = results.verdict == Verdict.COLLAPSED
    records = np.flatnonzero(collapsed.any(axis=1))
    if not records.size:
        return farthest(results)
    first = collapsed[records].argmax(axis=1)
    logs = np.log(results.levels[first])
    place = np.abs(logs - (np.median(logs) if median is None else np.log(median))).argmin()
    reason = "the record with the capacity nearest the median, at its lowest collapsing level"
    return int(records[place]), int(first[place]), reason


def farthest(results: ArchResults) -> Chosen | None:
    """The run that survived with the largest rotation of a voussoir; None if none rotated."""
    standing = results.verdict == Verdict.SURVIVED
    reach = np.where(standing, np.nan_to_num(results["peak_rotation"]), 0.0)
    record, level = np.unravel_index(int(reach.argmax()), reach.shape)
    reason = "the run that survived with the largest rotation of a voussoir"
    return (int(record), int(level), reason) if reach.any() else None


def typical_run(inputs: ReportInputs, results: ArchResults, place: int) -> Example | None:
    """The run with the capacity nearest the median, simulated again; None if nothing moves."""
    name, arch, onset = inputs.arches[place]
    if not onset.stands:
        return None
    fit = inputs.answers[name]
    median = None if isinstance(fit, str) else fit.theta * results.scale.factor
    return repeat(inputs, results, arch, choose(results, median))


def repeat(
    inputs: ReportInputs, results: ArchResults, arch: Arch, chosen: Chosen | None
) -> Example | None:
    """Simulate a run of a study again, with the study's method and its history."""
    method = dict(study_config(inputs.cube).get("method", ()))
    if not method or chosen is None:
        return None
    kind, (record, level, reason) = method.pop("name"), chosen
    method["far"] = method.pop("delay", None)
    motion = next(m for m in inputs.motions if m.id == results.records[record])
    factor = float(results["scale_factor"][record, level])
    status, steps, time = (results[k][record, level] for k in ("status", "steps", "collapse_time"))
    # `auto` may take a history by events; the study's verdict came by steps.
    for name in (kind, "time_stepping"):
        response = simulate(arch, motion, scale=factor, method=name, history=True, **method)
        same = bool(np.isclose(time, response.collapse_time, equal_nan=True))
        same = same and (status, steps) == (response.status, response.steps)
        if same or kind != AUTO:
            break
    about = "" if results.own_levels is None else "about "
    scale = results.scale
    shown = f"{about}{scale.measure} = {digits(results.levels[level])} {scale.unit}"
    ground = "the ground at its left end" if method["far"] else "the ground"
    return Example(arch, motion, factor, shown, response, reason, same, ground)
