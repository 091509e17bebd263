"""Figures of arches, motions and responses by matplotlib, in one style.

Backgrounds are transparent and texts are of a middle grey, so that a figure can be read on white
and in a dark notebook. Each function takes axes or makes new ones, and returns them. What it
draws is an object with the attributes that its class in archfrag documents.
"""

import re
from collections.abc import Sequence
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot
from matplotlib.animation import FuncAnimation, PillowWriter, writers
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError

# Okabe and Ito's palette: distinct with any kind of colour vision.
BLUE, ORANGE, GREEN, VERMILION = "#0072b2", "#e69f00", "#009e73", "#d55e00"
INK, GREY = "#737b85", "#9aa2ab"  # texts, seen on white and on black; thin lines
STONE, EDGE, EARTH = "#e9e4da", "#8d8473", "#f6f3ec"
SIZE = 9.0  # of texts [points]
GRAVITY = 9.80665  # [m/s2]
MOST_NUMBERS = 15  # of joints in a figure
FRAMES, HOLD = 25, 1.2  # of a film, in a second; seconds that it stays at its end
_TITLE: dict[str, Any] = {"loc": "center", "color": INK, "fontsize": SIZE + 1.0}
_SVG = {"svg.fonttype": "none", "svg.hashsalt": "archfrag", "font.family": "sans-serif"}
_ROOT = "stroke-linejoin:round;stroke-linecap:butt;max-width:100%;height:auto"

FloatArray = NDArray[np.float64]


def axes_of(ax: Axes | None, size: tuple[float, float] = (6.4, 3.2)) -> Axes:
    """Axes as given, or new ones in a figure of this size [inch]."""
    if ax is not None:
        return ax
    return dressed(pyplot.figure(figsize=size, layout="constrained").add_subplot())


def dressed(ax: Axes) -> Axes:
    """Give axes and their figure the style of all figures."""
    ax.figure.patch.set_alpha(0.0)
    ax.patch.set_alpha(0.0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["bottom", "left"]].set_color(GREY)
    ax.tick_params(colors=INK, labelsize=SIZE)
    for text in (ax.xaxis.label, ax.yaxis.label):
        text.set(color=INK, fontsize=SIZE)
    return ax


def legend(ax: Axes, **options: Any) -> None:
    """Add a legend without a frame."""
    ax.legend(frameon=False, labelcolor=INK, fontsize=SIZE, **options)


def svg_of(figure: Any) -> str:
    """The text of a figure as an SVG element; equal figures, equal text."""
    text = StringIO()
    with matplotlib.rc_context(_SVG):
        metadata = dict.fromkeys(("Date", "Creator"))
        figure.savefig(text, format="svg", bbox_inches="tight", metadata=metadata)
    svg = text.getvalue().partition("<!DOCTYPE")[2].partition(">")[2].strip()
    # A style sheet inside would hold for the whole page that the element is put into.
    svg = re.sub("<style.*?</style>", "", svg, flags=re.DOTALL)
    return svg.replace("<svg ", f'<svg style="{_ROOT}" ', 1)


def html_of(thing: Any, size: tuple[float, float] = (6.4, 3.2)) -> str:
    """What a notebook shows of a thing that can plot itself: its figure, and its repr below.

    Texts have the colour of the notebook's text.
    """
    figure = Figure(figsize=size, layout="constrained")
    thing.plot(dressed(figure.add_subplot()))
    svg, words = svg_of(figure).replace(INK, "currentColor"), escape(repr(thing).strip("<>"))
    caption = f'<figcaption style="white-space:pre-line">{words}</figcaption>'
    return f"<figure>{svg}{caption}</figure>"


def plot_arch(arch: Any, ax: Axes | None = None, numbers: bool = True) -> Axes:
    """Draw an arch to scale, with its fill, ground and the numbers of its joints."""
    fill = arch.fill_outlines
    points = np.concatenate([*arch.outlines, *fill])
    width, height = np.maximum(np.ptp(points, axis=0), 1e-9).tolist()
    scale = min(6.0 / width, 3.6 / height)
    ax = axes_of(ax, (max(4.8, scale * width + 0.6), scale * height + 0.6))
    ax.add_collection(PolyCollection(arch.outlines, facecolor=STONE, edgecolor=EDGE, lw=0.8))
    under = PolyCollection(fill, facecolor=EARTH, edgecolor=EDGE, ls="--", lw=0.8, zorder=0.5)
    ax.add_collection(under)
    for tie in arch.tie_lines:
        ax.plot(*tie.T, color=BLUE, lw=1.6)
    ax.set_aspect("equal")
    ax.set_axis_off()
    inner, outer = arch.intrados[: arch.n_joint], arch.extrados[: arch.n_joint]
    along = (outer - inner) / np.linalg.norm(outer - inner, axis=1, keepdims=True)
    place, reach = outer.copy(), 0.04 * max(width, height)
    for joint in (0,) if arch.free_end else (0, -1):
        place[joint] += reach * along[joint]
        line = inner[joint] - reach * along[joint], place[joint]
        ax.plot(*np.transpose(line), color=INK, lw=1.6)
    step = -(-arch.n_joint // MOST_NUMBERS)
    for joint in range(0, arch.n_joint, step) if numbers else ():
        ax.annotate(
            str(joint), place[joint], 9.0 * along[joint], textcoords="offset points", color=INK,
            fontsize=SIZE - 1.0, ha="center", va="center",
        )  # fmt: skip
    ax.autoscale_view()
    ax.margins(0.06)
    return ax


def plot_onset(onset: Any, ax: Axes | None = None, towards: str | None = None) -> Axes:
    """Draw hinges, sliding joints and thrust line at onset, the ground accelerating `towards`."""
    towards = towards or ("-x" if onset.minus < 0.999 * onset.plus else "+x")
    limit, hinges, sliding = onset.mechanism(towards)
    arch, ax = onset.arch, plot_arch(onset.arch, ax)
    weight, moving = onset.thrust_line(), onset.thrust_line(towards)
    if weight is not None:
        ax.plot(*weight.T, "--", color=EDGE, lw=1.4, label="thrust of its weight")
    if moving is not None:
        ax.plot(*moving.T, color=VERMILION, lw=1.4, label="thrust at onset")
    for joint in sliding:
        faces = np.array([arch.intrados[joint], arch.extrados[joint]])
        ax.plot(*faces.T, color=ORANGE, lw=4.0, label=f"joint {joint} slides")
    if hinges:
        places = np.array([getattr(arch, side)[joint] for joint, side in hinges])
        ax.plot(*places.T, "o", color=BLUE, mec="white", mew=0.8, ms=7.0, label="hinges")
    words = f"moves from {limit:.3g} g" if np.isfinite(limit) else "never moves"
    words = words if onset.stands else "does not stand under its own weight"
    ax.set_title(f"ground accelerating towards {towards}: {words}", **_TITLE)
    legend(ax, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return ax


def plot_motion(motion: Any, ax: Axes | None = None) -> Axes:
    """Draw the acceleration of the ground over time [g], its peak marked."""
    ax = axes_of(ax, (6.4, 2.2))
    time, values = motion.time, motion.acceleration / GRAVITY
    if motion.vertical is not None:
        ax.plot(time, motion.vertical / GRAVITY, color=GREY, lw=0.6, label="vertical")
    ax.plot(time, values, color=BLUE, lw=0.8, label="horizontal")
    place = int(np.abs(values).argmax())
    ax.plot(time[place], values[place], "o", color=VERMILION, ms=4.0)
    ax.annotate(
        f"{abs(values[place]):.3g} g", (time[place], values[place]), (6.0, 0.0), color=INK,
        textcoords="offset points", fontsize=SIZE, va="center",
    )  # fmt: skip
    ax.set(xlabel="time [s]", ylabel="acceleration [g]", xlim=(0.0, time[-1]))
    ax.set_title(motion.id, **_TITLE)
    if motion.vertical is not None:
        legend(ax, loc="upper right")
    return ax


def plot_response(response: Any, ax: Axes | None = None) -> Axes:
    """Draw the rotation of each voussoir over time, the one that rotates most in colour."""
    time, _, rotation = response._arrays()
    ax = axes_of(ax)
    ax.plot(time, rotation, color=GREY, lw=0.6)
    most = int(np.abs(rotation).max(axis=0).argmax())
    ax.plot(time, rotation[:, most], color=BLUE, lw=1.4, label=f"voussoir {most}")
    if response.collapsed:
        label = f"joint {response.collapse_joint} loses contact for good"
        ax.axvline(response.collapse_time, color=VERMILION, lw=1.2, ls="--", label=label)
    ax.set(xlabel="time [s]", ylabel="rotation [rad]", xlim=(time[0], time[-1]))
    legend(ax, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return ax


class Film(FuncAnimation):
    """A film of a run, as `matplotlib.animation.FuncAnimation`; a notebook shows it."""

    _fig: Figure

    def _repr_html_(self) -> str:
        pyplot.close(self._fig)  # a notebook would show a still frame too
        with matplotlib.rc_context({"savefig.dpi": 72}):
            return str(self.to_jshtml())

    def save(  # type: ignore[override]
        self, filename: Any, writer: Any = None, **options: Any
    ) -> None:
        """Save the film as .gif, or in a format of ffmpeg such as .mp4 where ffmpeg is installed.

        `writer` and options are those of matplotlib. InputError if ffmpeg is missing.
        """
        if writer is None and Path(filename).suffix.lower() == ".gif":
            writer = PillowWriter(fps=FRAMES)
        elif writer is None and not writers.is_available("ffmpeg"):
            raise InputError(f"{filename}: needs ffmpeg, which is not installed; save a .gif")
        self._fig.patch.set(alpha=1.0, facecolor="white")  # films have no transparent background
        super().save(filename, writer=writer, **options)
        self._fig.patch.set_alpha(0.0)


def animate(response: Any, seconds: float = 8.0, speed: float = 1.0) -> Film:
    """Make a film of a run: the arch with its hinges above, the ground's acceleration below.

    It shows at most so many `seconds` of the run, `speed` times as fast as they were.
    """
    if not (0.0 < seconds < np.inf and 0.0 < speed < np.inf):
        raise InputError(f"seconds = {seconds} and speed = {speed} must be positive numbers")
    time, shift, turn = response._arrays()
    arch, (start, end) = response.arch, response._window(seconds)
    if start == end:  # nothing moves
        end = float(min(time[-1], start + seconds))
    clock = np.linspace(start, end, max(2, round(FRAMES * (end - start) / speed)))
    centre = arch.centroids
    state = np.dstack([shift + centre, turn])
    columns = [np.interp(clock, time, column) for column in state.reshape(time.size, -1).T]
    state = np.transpose(columns).reshape(clock.size, *state.shape[1:])
    place, angle = state[..., :2], state[..., 2]
    near = np.searchsorted(time, clock).clip(max=time.size - 1)
    modes = response.history["contact_mode"].values[near]
    corners = [getattr(arch, arch.corner_name(corner))[: arch.n_joint] for corner in (0, 1)]
    figure, upper, lower = stage(*arch._frame(place, angle, 0.08))
    ground = response.motion.acceleration * (response.scale / GRAVITY)
    lower.plot(response.motion.time, ground, color=BLUE, lw=0.7)
    lower.set_xlim(start, end)
    now = lower.axvline(start, color=VERMILION, lw=1.4)
    limits = upper.axis()
    plot_arch(arch, upper, numbers=False).axis(limits)
    ties = upper.lines[: len(arch.tie_lines)]
    stones: Any = upper.collections[0]
    upper.collections[1].remove()  # what lies on the arch does not move as a body
    upper.add_collection(PolyCollection(arch.outlines, facecolor="none", edgecolor=GREY, lw=0.6))
    (dots,) = upper.plot([], [], "o", color=BLUE, mec="white", mew=0.8, ms=6.0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # as it is from now on: layouts take time

    def moved(points: FloatArray, body: int, frame: int) -> FloatArray:
        if not 0 <= body < arch.n_voussoir:  # the ground
            return points
        cosine, sine = np.cos(angle[frame, body]), np.sin(angle[frame, body])
        turned = (points - centre[body]) @ np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(turned + place[frame, body])

    def show(number: int) -> Sequence[Any]:
        frame = min(number, clock.size - 1)
        stones.set_verts([moved(o, body, frame) for body, o in enumerate(arch.outlines)])
        # Modes 1 to 3 are of hinges at corner 0 and 4 to 6 of those at corner 1.
        turning = np.flatnonzero((modes[frame] > 0) & (modes[frame] < 7))
        hinges = [
            moved(corners[(modes[frame, j] - 1) // 3][j], j, frame) for j in turning.tolist()
        ]
        dots.set_data(*np.reshape(hinges, (-1, 2)).T)
        for tie, rest, bodies in zip(ties, arch.tie_lines, arch.tie_bodies):
            tie.set_data(*np.transpose([moved(p, b, frame) for p, b in zip(rest, bodies)]))
        now.set_xdata([clock[frame]] * 2)
        return stones, dots, now, *ties

    count = clock.size + round(HOLD * FRAMES)
    return Film(figure, show, frames=count, interval=1000.0 / FRAMES, blit=False)


def stage(low: FloatArray, high: FloatArray) -> tuple[Figure, Axes, Axes]:
    """Axes of a film between two corners of its frame [m], and axes below them over time."""
    tall = float(np.clip(6.4 * (high - low)[1] / (high - low)[0], 2.0, 6.0))
    figure = pyplot.figure(figsize=(6.4, tall + 1.2), layout="constrained")
    upper, lower = map(dressed, figure.subplots(2, height_ratios=[tall, 1.2]))
    upper.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    upper.set_axis_off()
    lower.set(xlabel="time [s]", ylabel="ground [g]")
    lower.yaxis.set_major_locator(MaxNLocator(3))
    return figure, upper, lower


def plot_spectra(
    periods: ArrayLike, spectra: ArrayLike, bands: Sequence[tuple[ArrayLike, str, str]],
    ax: Axes | None = None,
) -> Axes:  # fmt: skip
    """Draw response spectra (n_record, n_period) [g], and bands over them.

    Of each band there are rows low, median and high, its colour and its label.
    """
    ax = axes_of(ax, (9.0, 4.5))
    ax.plot(periods, np.transpose(spectra), color=GREY, lw=0.5)
    for rows, colour, label in bands:
        low, median, high = np.asarray(rows)
        ax.fill_between(periods, low, high, color=colour, alpha=0.2, lw=0.0)
        ax.plot(periods, median, color=colour, lw=2.0, label=label)
    ax.set(xscale="log", yscale="log", xlabel="period [s]", ylabel="Sa, 5 % damping [g]")
    legend(ax)
    return ax
