"""Figures of an arch: its marks painted as SVG, its mechanism at onset, joints that it lost."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.marks import AREAS, Mark
from archfrag.fragility.verdicts import Verdict
from archfrag.report.html import TEXTS, onset_text
from archfrag.report.inputs import ArchResults
from archfrag.report.svg import (
    BLUE,
    INK,
    ORANGE,
    SMALL,
    SOFT,
    VERMILION,
    Entry,
    FloatArray,
    Panel,
    Range,
    Sheet,
    Words,
    figure,
    text_width,
    trace,
)
from archfrag.simulation.simulate import Onset

_LINES: dict[str, tuple[Any, ...]] = {  # colour, width and dash of lines, by role
    "tie": (BLUE, 1.6),
    "ground": (SOFT, 1.4),
    "rest": (SOFT, 1.1, "4 2.5"),
    "thrust": (VERMILION, 1.5),
    "sliding": (ORANGE, 4.0),
}
_MOST_NUMBERS = 15  # of joints in a figure


def paint(panel: Panel, marks: Iterable[Mark]) -> None:
    """Draw marks of an arch in a panel, in the style of their roles."""
    for role, points, _ in marks:
        x, y = points.T
        if role in AREAS:
            panel.sheet.path(
                f"{trace(panel.at_x(x), panel.at_y(y))}z", kind=role, stroke_width=0.8
            )
        elif role == "hinge":
            panel.dots(x, y, BLUE, "hinge", 4.0)
        else:
            panel.line(x, y, *_LINES[role])


def arch_panel(
    sheet: Sheet,
    arch: Arch,
    middle: float,
    top: float,
    most: Range,
    ground: bool = False,
) -> Panel:
    """Draw an arch to scale, and return its panel.

    `middle` is the x of its middle, `top` the y of its top, `most` its largest width and height
    [px]. With `ground` the ground is drawn too.
    """
    marks = arch.marks
    points = np.concatenate([mark.points for mark in marks if mark.role in AREAS])
    least = points.min(axis=0)
    size = np.maximum(np.ptp(points, axis=0), 1e-9)
    wide, high = (min(np.divide(most, size)) * size).tolist()
    box = (middle - 0.5 * wide, top, middle + 0.5 * wide, top + high)
    x, y = zip(least, least + size)
    panel = Panel(sheet, box, x, y)
    paint(panel, [mark for mark in marks if ground or mark.role != "ground"])
    return panel


@figure
def arch_at_onset(sheet: Sheet, onset: Onset, name: str) -> str | Words:
    """Draw the arch at onset twice: ground accelerating towards +x, and towards -x.

    An arch that does not stand is drawn once, at rest.
    """
    if not onset.stands:
        _at_onset(sheet, 0.5 * sheet.width, 0.0, onset, "")
        return (
            f"{name}, which does not stand under its own weight",
            "There is no onset.",
        )
    key = [Entry("thrust at onset", VERMILION, "line")]
    key += [Entry("thrust at rest", SOFT, "dash"), Entry("hinge", BLUE, "dot")]
    if len(onset.sliding) or len(onset.sliding_minus):
        key.append(Entry("sliding joint", ORANGE))
    top = sheet.legend(8.0, 0.0, key, sheet.width - 16.0)
    words = []
    long = len(onset.arch.spans) > 1  # one drawing below the other
    second = 0.0 if long else 0.5 * sheet.width
    for left, towards in ((0.0, "+x"), (second, "-x")):
        limit, *_ = onset.mechanism(towards)
        words.append(f"{onset_text(limit)} towards {towards.replace('-', '−')}")
        sheet.text(left + 8.0, top + 14.0, f"ground accelerating: {words[-1]}", "b")
        middle = left + (0.5 if long else 0.25) * sheet.width
        _at_onset(sheet, middle, top + 20.0, onset, towards)
        top = sheet.height if long else top
    texts = TEXTS["arch_at_onset"]
    parts = texts["parts"] * bool(onset.arch.places)
    return (
        f"{name} with hinges and thrust line at onset: {', '.join(words)}",
        texts["caption"].format(parts=parts),
    )


def _at_onset(
    sheet: Sheet, middle: float, top: float, onset: Onset, towards: str
) -> None:
    """Draw an arch with its mechanism; `towards` is empty if it does not stand."""
    arch = onset.arch
    most = (0.86 * sheet.width if len(arch.spans) > 1 else 308.0, 260.0)
    panel = arch_panel(sheet, arch, middle, top + 20.0, most, ground=True)
    below = panel.box[3] + 15.0
    if towards:
        paint(panel, onset.marks(towards))
        sign = 1 if towards == "+x" else -1
        half = 0.16 * sign * np.ptp(panel.box[::2])
        line = f"M{middle - half:.1f} {below:.1f}H{middle + half:.1f}"
        sheet.path(line, stroke=INK, stroke_width=1.3)
        tip = f"M{middle + half + sign * 7:.1f} {below:.1f}l{-sign * 9:.1f} -4v8z"
        sheet.path(tip, fill=INK)
    taken = list[FloatArray]()
    inside = set[
        int
    ]()  # joints numbered within their span, where no other ring is near
    for part in arch.parts[: len(arch.places)]:  # none of one ring alone
        half = part.joints[len(part.joints) // 2]
        away = -16.0 if "pier" in part.name else -34.0
        inside |= {*(() if "pier" in part.name else part.joints)}
        _label_joint(panel, arch, half, away, part.name, "s", taken)
    for joint, number in arch.joint_numbers(_MOST_NUMBERS * len(arch.spans)):
        away = -14.0 if joint in inside else 16.0
        _label_joint(panel, arch, joint, away, number, "s q", taken if inside else [])
    sheet.height = max(sheet.height, below + 11.0)


def _label_joint(
    panel: Panel,
    arch: Arch,
    joint: int,
    away: float,
    words: str,
    kind: str,
    taken: list[FloatArray],
) -> bool:
    """Write words at a joint unless they would cover others; return whether they were written.

    They stand outward of its extrados, or inward of its intrados if `away` [px] is negative.
    `taken` holds the boxes of other words; the new box is added to it.
    """
    along = arch.extrados[joint] - arch.intrados[joint]
    place = arch.extrados[joint] if away > 0.0 else arch.intrados[joint]
    right, up = away * along / np.linalg.norm(along)
    x = panel.at_x(place[0]) + right
    y = panel.at_y(place[1]) - up + 3.5
    part = 1.0 if right < 0.0 else 0.0
    if abs(right) < 0.3 * abs(away):
        part = 0.5
    wide = text_width(words, SMALL)
    left = x - part * wide
    box = np.array([left - 3.0, y - 8.5, left + wide + 3.0, y + 3.0])
    if any(((box[:2] < other[2:]) & (box[2:] > other[:2])).all() for other in taken):
        return False
    taken.append(box)
    panel.sheet.text(x, y, words, kind + {0.0: "", 0.5: " m", 1.0: " e"}[part])
    return True


@figure
def lost_joints(sheet: Sheet, arch: Arch, results: ArchResults) -> str | None:
    """Draw the arch with a dot at each joint that lost contact for good in a collapse.

    The area of a dot grows with the number of such runs. Return None if no run collapsed.
    """
    joint_of = results["collapse_joint"][results.verdict == Verdict.COLLAPSED]
    joints, counts = np.unique(joint_of, return_counts=True)
    if not joints.size:
        return None
    most = (0.86 * sheet.width if len(arch.spans) > 1 else 370.0, 240.0)
    panel = arch_panel(sheet, arch, 0.5 * sheet.width, 28.0, most)
    taken = list[FloatArray]()  # boxes of words: left, top, right, bottom
    for i in np.argsort(-counts, kind="stable"):
        joint = int(joints[i])
        words = f"{100 * counts[i] / counts.sum():.0f} %"
        x, y = 0.5 * (arch.intrados[joint] + arch.extrados[joint])[:, None]
        radius = 2.0 + 8.0 * np.sqrt(counts[i] / counts.max())
        panel.dots(x, y, VERMILION, "hinge", radius)
        if not _label_joint(panel, arch, joint, 14.0, words, "s", taken):
            _label_joint(panel, arch, joint, -14.0, words, "s", taken)
    sheet.height = panel.box[3] + 14.0
    return f"Joints of {results.arch} that lost contact for good, by how often"
