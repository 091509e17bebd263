"""The arch with its hinges and thrust lines at onset, in both directions."""

from typing import TYPE_CHECKING

import numpy as np

from archfrag.arch import Arch
from archfrag.report import picture as look
from archfrag.report.picture import FloatArray, Picture, symbol, trace
from archfrag.report.plot import Entry, Sheet, picture

if TYPE_CHECKING:
    from archfrag.simulate import Onset

STONE = "#e9e4da"
EDGE = "#8d8473"


class _View:
    """An arch in a box of a sheet, in one scale for both directions."""

    def __init__(self, sheet: Sheet, arch: Arch, left: float, top: float, width: float) -> None:
        points = np.concatenate(arch.outlines)
        low, high = points.min(axis=0), points.max(axis=0)
        span, height = np.maximum(high - low, 1e-9)
        self.sheet, self.span = sheet, float(span)
        widest = min(width - 46.0, 330.0)  # numbers of joints stand beside the springings
        self.scale = float(min(widest / span, 260.0 / height))
        self.middle, self.ground = left + 0.5 * width, top + 16.0 + self.scale * float(height)
        self.centre, self.low = float(0.5 * (low[0] + high[0])), float(low[1])
        self.end = self.ground + 24.0

    def at(self, points: FloatArray) -> FloatArray:
        """Pixels of points (n, 2) [m]."""
        points = np.atleast_2d(points)
        x = self.middle + self.scale * (points[:, 0] - self.centre)
        return np.column_stack([x, self.ground - self.scale * (points[:, 1] - self.low)])

    def path(self, points: FloatArray, closed: bool = False, **attributes: object) -> None:
        """Join points [m]."""
        self.sheet.path(trace(*self.at(points).T) + ("z" if closed else ""), **attributes)


def arch_at_onset(arch: Arch, onset: "Onset", identifier: str) -> Picture:
    """Draw the chain twice: ground accelerating towards +x, and towards -x."""
    directions = (("+x", 1.0), ("−x", -1.0)) if onset.stands else (("", 0.0),)

    def draw(sheet: Sheet) -> None:
        top = sheet.legend(8.0, 0.0, _key(onset), sheet.width - 16.0) if onset.stands else 0.0
        each = sheet.width if sheet.narrow else sheet.width / len(directions)
        for i, (direction, sign) in enumerate(directions):
            left = 0.0 if sheet.narrow else i * each
            title = 20.0 if onset.stands else 0.0
            view = _View(sheet, arch, left, top + title, each)
            if onset.stands:
                limit = onset_text(onset.plus if sign > 0 else onset.minus)
                words = f"ground accelerating towards {direction}: {limit}"
                sheet.text(left + 8.0, top + 14.0, words, "b")
            for outline in arch.outlines:
                view.path(outline, True, fill=STONE, stroke=EDGE, stroke_width=0.8)
            if onset.stands:
                _thrust_and_hinges(view, arch, onset, sign)
                _ground(view, sign)
            _joint_numbers(view, arch)
            sheet.height = max(sheet.height, view.end)
            if sheet.narrow:
                top = view.end + 4.0

    if onset.stands:
        text = (
            f"{identifier} with hinges and thrust line at onset: {onset_text(onset.plus)} towards "
            f"+x, {onset_text(onset.minus)} towards −x"
        )
        caption = (
            "Mechanism with which the motion begins at the onset acceleration. Filled circles: "
            "hinges. Lines join the contact centres of the joints: solid at onset, dashed under "
            "self-weight alone, where an arch with all joints closed is hyperstatic and the line "
            "is one admissible choice. Numbers: joints."
        )
    else:
        text = f"{identifier}, which does not stand under its own weight"
        caption = "The arch does not stand under its own weight; there is no onset to show."
    return picture(draw, alternative=text, caption=caption)


def onset_text(value: float) -> str:
    """Onset acceleration in g, or that there is none."""
    return f"{value:.4f} g" if np.isfinite(value) else "no limit"


def _thrust_and_hinges(view: _View, arch: Arch, onset: "Onset", sign: float) -> None:
    view.path(
        np.asarray(onset.thrust), fill="none", stroke=look.SOFT, stroke_width=1.1,
        stroke_dasharray="4 2.5",
    )  # fmt: skip
    moving = onset.thrust_plus if sign > 0 else onset.thrust_minus
    if moving is not None:
        view.path(np.asarray(moving), fill="none", stroke=look.VERMILION, stroke_width=1.5)
    for joint in onset.sliding if sign > 0 else onset.sliding_minus:
        ends = np.stack([arch.intrados[joint], arch.extrados[joint]])
        view.path(ends, stroke=look.ORANGE, stroke_width=4)
    for joint, side in onset.hinges if sign > 0 else onset.hinges_minus:
        corner = (arch.intrados if side == "intrados" else arch.extrados)[joint]
        x, y = view.at(corner)[0]
        view.sheet.path(symbol(x, y, 4.0), fill=look.BLUE, stroke="#fff")


def _ground(view: _View, sign: float) -> None:
    y, half = view.ground + 13.0, sign * 0.16 * view.scale * view.span
    reach, tip = 0.5 * view.scale * view.span, view.middle + half
    view.sheet.path(f"M{view.middle - reach:.1f} {view.ground:.1f}h{2 * reach:.1f}", kind="ax")
    line = f"M{view.middle - half:.1f} {y:.1f}H{tip:.1f}"
    view.sheet.path(line, stroke=look.INK, stroke_width=1.3)
    view.sheet.path(f"M{tip + sign * 7:.1f} {y:.1f}l{-sign * 9:.1f} -4v8z", fill=look.INK)


def _joint_numbers(view: _View, arch: Arch) -> None:
    """Numbers beyond the extrados, thinned where joints stand close."""
    outward = arch.extrados[: arch.n_joint] - arch.intrados[: arch.n_joint]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    corners = view.at(arch.extrados[: arch.n_joint])
    step = max(1, int(np.ceil(arch.n_joint / 15)))
    for joint in range(0, arch.n_joint, step):
        x, y = corners[joint] + 11.0 * outward[joint] * (1.0, -1.0)
        view.sheet.text(x, y + 3.5, str(joint), "s m q")


def _key(onset: "Onset") -> list[Entry]:
    key = [
        Entry("thrust at onset", look.VERMILION, "line"),
        Entry("thrust, self-weight", look.SOFT, "dash"),
        Entry("hinge", look.BLUE, "dot"),
    ]
    if len(onset.sliding) or len(onset.sliding_minus):
        key.append(Entry("sliding joint", look.ORANGE))
    return key
