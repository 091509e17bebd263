"""The arch with its hinges and thrust lines at onset, both ways."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from archfrag.arch import Arch
from archfrag.report import canvas
from archfrag.report.canvas import Picture, picture

if TYPE_CHECKING:
    from archfrag.simulate import Onset

_STONE = "#e9e4da"
_EDGE = "#8d8473"


def arch_at_onset(arch: Arch, onset: "Onset", identifier: str, name: str) -> Picture:
    """Draw the chain twice: ground accelerating towards +x, and towards -x.

    Parameters
    ----------
    arch : Arch
    onset : Onset
    identifier : str
        The arch's name in the study.
    name : str
        Unique on the page.
    """
    points = np.concatenate(arch.outlines)
    low, high = points.min(axis=0), points.max(axis=0)
    span, height = np.maximum(high - low, 1e-9)
    middle = 0.5 * (low[0] + high[0])
    # A slender chain gets room beside it, so that the title fits.
    reach = max(0.56 * span, 0.7 * height)
    ways = (("+x", 1.0), ("−x", -1.0)) if onset.stands else (("", 0.0),)

    def draw(figure: Figure) -> None:
        all_axes = figure.subplots(1, len(ways), squeeze=False)[0]
        for axes, (way, sign) in zip(all_axes, ways, strict=True):
            for outline in arch.outlines:
                axes.add_patch(Polygon(outline, facecolor=_STONE, edgecolor=_EDGE, linewidth=0.7))
            axes.set_aspect("equal")
            axes.set_xlim(middle - reach, middle + reach)
            axes.set_ylim(low[1] - 0.17 * max(height, 0.4 * span), high[1] + 0.07 * span)
            axes.set_axis_off()
            if onset.stands:
                _thrust_and_hinges(axes, arch, onset, sign)
                _ground(axes, low, span, height, sign)
                limit = onset_text(onset.plus if sign > 0 else onset.minus)
                axes.set_title(f"ground accelerating towards {way}: {limit}")
            _joint_numbers(axes, arch, span)
        if onset.stands:
            figure.legend(
                handles=_key(onset), loc="outside lower center", ncols=4, handlelength=2.0
            )

    if onset.stands:
        text = (
            f"{identifier} with hinges and thrust line at onset: {onset_text(onset.plus)} towards "
            f"+x, {onset_text(onset.minus)} towards −x"
        )
        caption = (
            "Mechanism with which the motion begins at the onset acceleration. Filled circles: "
            "hinges. Lines join the contact centres of the joints: solid at onset, dotted under "
            "self-weight alone, where an arch with all joints closed is hyperstatic and the line "
            "is one admissible choice."
        )
    else:
        text = f"{identifier}, which does not stand under its own weight"
        caption = "The arch does not stand under its own weight; there is no onset to show."
    panel = canvas.WIDTH / len(ways)
    ratio = float((height + 0.07 * span + 0.17 * max(height, 0.4 * span)) / (2.0 * reach))
    size = (canvas.WIDTH, min(0.75 + panel * ratio, 4.6))
    return picture(name, size, draw, alternative=text, caption=caption)


def onset_text(value: float) -> str:
    """Onset acceleration in g, or that there is none."""
    return f"{value:.4f} g" if np.isfinite(value) else "no limit"


def _thrust_and_hinges(axes: Axes, arch: Arch, onset: "Onset", sign: float) -> None:
    axes.plot(*np.asarray(onset.thrust).T, color=canvas.GREY, lw=1.0, ls=(0, (1, 1.6)))
    moving = onset.thrust_plus if sign > 0 else onset.thrust_minus
    if moving is not None:
        axes.plot(*np.asarray(moving).T, color=canvas.VERMILION, lw=1.3)
    for joint, side in onset.hinges if sign > 0 else onset.hinges_minus:
        corner = (arch.intrados if side == "intrados" else arch.extrados)[joint]
        axes.plot(*corner, "o", color=canvas.BLUE, ms=6.0, mec="white", mew=0.8, zorder=5)
    for joint in onset.sliding if sign > 0 else onset.sliding_minus:
        ends = np.stack([arch.intrados[joint], arch.extrados[joint]])
        axes.plot(*ends.T, color=canvas.ORANGE, lw=3.0, solid_capstyle="butt", zorder=4)


def _ground(axes: Axes, low: np.ndarray, span: float, height: float, sign: float) -> None:
    y = low[1] - 0.11 * max(height, 0.4 * span)
    centre = low[0] + 0.5 * span
    axes.annotate(
        "", xy=(centre + 0.16 * sign * span, y), xytext=(centre - 0.16 * sign * span, y),
        arrowprops={"arrowstyle": "-|>", "color": canvas.INK, "lw": 1.2},
    )  # fmt: skip
    axes.plot([low[0], low[0] + span], [low[1]] * 2, color=canvas.GREY, lw=0.6, zorder=0)


def _joint_numbers(axes: Axes, arch: Arch, span: float) -> None:
    """Numbers beyond the extrados, thinned where joints stand close."""
    outward = arch.extrados[: arch.n_joint] - arch.intrados[: arch.n_joint]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    place = arch.extrados[: arch.n_joint] + 0.035 * span * outward
    step = max(1, int(np.ceil(arch.n_joint / 15)))
    for joint in range(0, arch.n_joint, step):
        x, y = place[joint]
        axes.text(x, y, str(joint), ha="center", va="center", fontsize=6.5, color=canvas.GREY)


def _key(onset: "Onset") -> list[Line2D]:
    key = [
        Line2D([], [], color=canvas.VERMILION, lw=1.3, label="thrust at onset"),
        Line2D([], [], color=canvas.GREY, lw=1.0, ls=(0, (1, 1.6)), label="thrust, self-weight"),
        Line2D([], [], marker="o", ls="", ms=6.0, color=canvas.BLUE, mec="white", label="hinge"),
    ]
    if len(onset.sliding) or len(onset.sliding_minus):
        key.append(Line2D([], [], color=canvas.ORANGE, lw=3.0, label="sliding joint"))
    return key
