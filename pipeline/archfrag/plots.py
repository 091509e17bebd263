"""Figures of arches, motions and responses by matplotlib, in one style.

Backgrounds are transparent and texts are of a middle grey, so that a figure can be read on white
and in a dark notebook. Each function takes axes or makes new ones, and returns them. The object
that it draws has the attributes that its class in archfrag documents.
"""

import re
from collections.abc import Iterable, Sequence
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot
from matplotlib.animation import FuncAnimation, PillowWriter, writers
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import LogLocator, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.files import Named, check_targets, register

# Okabe and Ito's palette: distinct with any kind of colour vision.
BLUE = "#0072b2"
ORANGE = "#e69f00"
GREEN = "#009e73"
VERMILION = "#d55e00"
INK = "#737b85"  # texts, seen on white and on black; thin lines
GREY = "#9aa2ab"
SIZE = 9.0  # of texts [points]
GRAVITY = 9.80665  # [m/s2]
MOST_NUMBERS = 15  # of joints in a figure
FRAMES = 25  # frames of a film in a second; seconds that its last frame stays
HOLD = 1.2
_EDGE = "#8d8473"
_AREAS: dict[str, Named] = {  # how marks of an arch look, by role
    "earth": {"fc": "#f6f3ec", "ec": _EDGE, "lw": 0.8, "ls": "--", "zorder": 0.5},
    "stone": {"fc": "#e9e4da", "ec": _EDGE, "lw": 0.8},
    "trace": {"fc": "none", "ec": GREY, "lw": 0.6, "zorder": 1.5},  # of a stone at rest
}
_AREAS["backing"] = _AREAS["earth"]
_LINES: dict[str, Named] = {
    "tie": {"color": BLUE, "lw": 1.6},
    "ground": {"color": INK, "lw": 1.6},
    "rest": {"color": _EDGE, "lw": 1.4, "ls": "--", "label": "thrust of its weight"},
    "thrust": {"color": VERMILION, "lw": 1.4, "label": "thrust at onset"},
    "sliding": {"color": ORANGE, "lw": 4.0, "label": "sliding joint"},
    "hinge": {
        "color": BLUE,
        "ls": "",
        "marker": "o",
        "mec": "white",
        "mew": 0.8,
        "ms": 7.0,
        "label": "hinge",
    },
}
_TITLE: Named = {"loc": "center", "color": INK, "fontsize": SIZE + 1.0}
_SVG = {"svg.fonttype": "none", "svg.hashsalt": "archfrag", "font.family": "sans-serif"}
FloatArray = NDArray[np.float64]
_ROOT = "stroke-linejoin:round;stroke-linecap:butt;max-width:100%;height:auto"


def axes_of(ax: Axes | None, size: tuple[float, float] = (6.4, 3.2)) -> Axes:
    """Return the axes that are given, or new ones in a figure of this size [inch]."""
    if ax is not None:
        return ax
    return dressed(pyplot.figure(figsize=size, layout="constrained").add_subplot())


def dressed(ax: Axes) -> Axes:
    """Give axes and their figure the style of all figures; return the axes."""
    ax.figure.patch.set_alpha(0.0)
    ax.patch.set_alpha(0.0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["bottom", "left"]].set_color(GREY)
    ax.tick_params(colors=INK, labelsize=SIZE)
    for text in (ax.xaxis.label, ax.yaxis.label):
        text.set(color=INK, fontsize=SIZE)
    return ax


def legend(ax: Axes, **options) -> None:
    """Add a legend without a frame; each label stands once."""
    entries = dict(zip(*reversed(ax.get_legend_handles_labels())))
    options |= {"frameon": False, "labelcolor": INK, "fontsize": SIZE}
    ax.legend(entries.values(), entries.keys(), **options)


def _annotate(ax: Axes, words: str, at, away, **options) -> None:
    """Write words at a distance `away` [points] from a place."""
    options |= {"textcoords": "offset points", "color": INK, "va": "center"}
    ax.annotate(words, at, away, **{"fontsize": SIZE, **options})


def svg_of(figure) -> str:
    """Return a figure as the text of an SVG element; equal figures give equal texts."""
    text = StringIO()
    with matplotlib.rc_context(_SVG):
        metadata = dict.fromkeys(("Date", "Creator"))
        figure.savefig(text, format="svg", bbox_inches="tight", metadata=metadata)
    svg = text.getvalue().partition("<svg ")[2].strip()
    # A style sheet inside would hold for the whole page that the element is put into.
    svg = re.sub("<style.*?</style>", "", svg, flags=re.DOTALL)
    return f'<svg style="{_ROOT}" {svg}'


def html_of(thing, size: tuple[float, float] = (6.4, 3.2)) -> str:
    """Return HTML for a notebook: the figure of an object above its repr.

    The object has a method `plot`. Texts have the colour of the notebook's text.
    """
    figure = Figure(figsize=size, layout="constrained")
    thing.plot(dressed(figure.add_subplot()))
    svg = svg_of(figure).replace(INK, "currentColor")
    words = escape(repr(thing).strip("<>"))
    caption = f'<figcaption style="white-space:pre-line">{words}</figcaption>'
    return f"<figure>{svg}{caption}</figure>"


def paint(ax: Axes, marks: Iterable[Any]) -> list[Any]:
    """Draw marks of an arch in the style of their roles; return their artists."""
    return [
        ax.add_patch(Polygon(mark.points, **_AREAS[mark.role]))
        if mark.role in _AREAS
        else ax.plot(*mark.points.T, **_LINES[mark.role])[0]
        for mark in marks
    ]


def plot_arch(arch, ax: Axes | None = None) -> Axes:
    """Draw an arch to scale, with its fill, ties, ground and the numbers of its joints."""
    marks = arch.marks
    points = np.concatenate([mark.points for mark in marks])
    width, height = np.maximum(np.ptp(points, axis=0), 1e-9)
    scale = min(6.0 / width, 3.6 / height)
    ax = axes_of(ax, (max(4.8, scale * width + 0.6), scale * height + 0.6))
    paint(ax, marks)
    ax.set_aspect("equal")
    ax.set_axis_off()
    inner = arch.intrados[: arch.n_joint]
    outer = arch.extrados[: arch.n_joint].copy()
    along = (outer - inner) / np.linalg.norm(outer - inner, axis=1, keepdims=True)
    grounds = [mark.points[1] for mark in marks if mark.role == "ground"]
    for (joint, _), place in zip(arch.bases.values(), grounds):
        outer[joint] = place
    small: Named = {"fontsize": SIZE - 1.0, "ha": "center"}
    for part in arch.parts[: len(arch.places)]:  # none of one ring alone
        joint = part.joints[len(part.joints) // 2]
        _annotate(ax, part.name, inner[joint], -24.0 * along[joint], **small)
        if (
            "pier" not in part.name
        ):  # number joints within the span: no other ring is near
            rows = list(part.joints)
            outer[rows], along[rows] = inner[rows], -along[rows]
    for joint, number in arch.joint_numbers(MOST_NUMBERS * min(3, len(arch.spans))):
        _annotate(ax, number, outer[joint], 9.0 * along[joint], **small)
    ax.autoscale_view()
    ax.margins(0.06)
    return ax


def plot_onset(onset, ax: Axes | None = None, towards: str | None = None) -> Axes:
    """Draw hinges, sliding joints and thrust lines of an arch at onset.

    The ground accelerates `towards` +x or -x; if not given, in the weaker of both directions.
    """
    towards = towards or ("-x" if onset.minus < 0.999 * onset.plus else "+x")
    limit, *_ = onset.mechanism(towards)
    ax = plot_arch(onset.arch, ax)
    paint(ax, onset.marks(towards))
    words = f"moves from {limit:.3g} g" if np.isfinite(limit) else "never moves"
    if not onset.stands:
        words = "does not stand under its own weight"
    ax.set_title(f"ground accelerating towards {towards}: {words}", **_TITLE)
    legend(ax, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return ax


def plot_motion(motion, ax: Axes | None = None) -> Axes:
    """Draw the acceleration of the ground over time [g], and mark its peak."""
    ax = axes_of(ax, (6.4, 2.2))
    time = motion.time
    values = motion.acceleration / GRAVITY
    place = int(np.abs(values).argmax())
    peak = time[place], values[place]
    if motion.vertical is not None:
        ax.plot(time, motion.vertical / GRAVITY, color=GREY, lw=0.6, label="vertical")
    ax.plot(time, values, color=BLUE, lw=0.8, label="horizontal")
    ax.plot(*peak, "o", color=VERMILION, ms=4.0)
    _annotate(ax, f"{abs(peak[1]):.3g} g", peak, (6.0, 0.0))
    ax.set(xlabel="time [s]", ylabel="acceleration [g]", xlim=(0.0, time[-1]))
    ax.set_title(motion.id, **_TITLE)
    if motion.vertical is not None:
        legend(ax, loc="upper right")
    return ax


def plot_response(response, ax: Axes | None = None) -> Axes:
    """Draw the rotation of each voussoir over time; the one that rotates most is in colour."""
    time, _, rotation = response._arrays()
    ax = axes_of(ax)
    ax.plot(time, rotation, color=GREY, lw=0.6)
    most = int(np.abs(rotation).max(axis=0).argmax())
    of = next(part.name for part in response.arch.parts if most in part.every)
    label = f"voussoir {most}" + f" of {of}" * bool(response.arch.places)
    ax.plot(time, rotation[:, most], color=BLUE, lw=1.4, label=label)
    if response.collapsed:
        label = f"{response.collapse_place} loses contact for good"
        ax.axvline(
            response.collapse_time, color=VERMILION, lw=1.2, ls="--", label=label
        )
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
        self, filename, writer=None, **options
    ) -> None:
        """Save the film as .gif, or in a format of ffmpeg such as .mp4.

        `writer` and options are those of matplotlib. InputError if ffmpeg is missing.
        """
        if writer is None and Path(filename).suffix.lower() == ".gif":
            writer = PillowWriter(fps=FRAMES)
        elif writer is None and not writers.is_available("ffmpeg"):
            raise InputError(
                f"{filename}: needs ffmpeg, which is not installed; save a .gif"
            )
        check_targets([filename])
        self._fig.patch.set(
            alpha=1.0, facecolor="white"
        )  # films have no transparent background
        super().save(filename, writer=writer, **options)
        register(Path(filename), Path(filename))
        self._fig.patch.set_alpha(0.0)


def animate(response, seconds: float = 8.0, speed: float = 1.0) -> Film:
    """Make a film of a run: the arch with its hinges above, the ground's acceleration below.

    It shows at most `seconds` of the run, `speed` times as fast as in reality.
    """
    if not (0.0 < seconds < np.inf and 0.0 < speed < np.inf):
        raise InputError(
            f"seconds = {seconds} and speed = {speed} must be positive numbers"
        )
    time, shift, rotation = response._arrays()
    arch = response.arch
    start, end = response._window(seconds)
    if start == end:  # nothing moves
        end = float(min(time[-1], start + seconds))
    clock = np.linspace(start, end, max(2, round(FRAMES * (end - start) / speed)))
    state = np.dstack([shift + arch.centroids, rotation])
    state = np.apply_along_axis(lambda column: np.interp(clock, time, column), 0, state)
    place = state[..., :2]
    angle = state[..., 2]
    near = np.searchsorted(time, clock).clip(max=time.size - 1)
    modes = response.history["contact_mode"].values[near]
    figure, upper, lower = stage(*arch._frame(place, angle, 0.08))
    ground = response.motion.acceleration * (response.scale / GRAVITY)
    lower.plot(response.motion.time, ground, color=BLUE, lw=0.7)
    lower.set_xlim(start, end)
    now = lower.axvline(start, color=VERMILION, lw=1.4)
    still = [mark for mark in arch.marks if mark.role in ("stone", "ground")]
    moving = [mark for mark in arch.marks if mark.role in ("stone", "tie")]
    joints = range(arch.n_joint)
    for corner in (0, 1):  # of each joint
        points = getattr(arch, arch.corner_name(corner))[: arch.n_joint]
        moving.append(still[0]._replace(role="hinge", points=points, bodies=joints))
    paint(upper, [s._replace(role=s.role.replace("stone", "trace")) for s in still])
    artists = paint(upper, moving)
    paths = [mark.moved(arch.centroids, place, angle) for mark in moving]
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # as it is from now on: layouts take time

    def show(number: int) -> Sequence[Any]:
        frame = min(number, clock.size - 1)
        for mark, artist, at in zip(moving, artists, paths):
            if mark.role == "stone":
                artist.set_xy(at[frame])
            else:
                artist.set_data(*at[frame].T)
        # Modes 1 to 3 are of hinges at corner 0, and 4 to 6 of those at corner 1.
        for first, dots, at in zip((1, 4), artists[-2:], paths[-2:]):
            turning = (modes[frame] >= first) & (modes[frame] < first + 3)
            dots.set_data(*at[frame, turning].T)
        now.set_xdata([clock[frame]] * 2)
        return [*artists, now]

    count = clock.size + round(HOLD * FRAMES)
    return Film(figure, show, frames=count, interval=1000.0 / FRAMES, blit=False)


def stage(low: FloatArray, high: FloatArray) -> tuple[Figure, Axes, Axes]:
    """Return a figure with axes for an arch above, and axes over time below.

    `low` and `high` are the lower left and the upper right corner of the upper axes [m].
    """
    tall = float(np.clip(6.4 * (high - low)[1] / (high - low)[0], 2.0, 6.0))
    figure = pyplot.figure(figsize=(6.4, tall + 1.2), layout="constrained")
    upper, lower = map(dressed, figure.subplots(2, height_ratios=[tall, 1.2]))
    upper.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    upper.set_axis_off()
    lower.set(xlabel="time [s]", ylabel="ground [g]")
    lower.yaxis.set_major_locator(MaxNLocator(3))
    return figure, upper, lower


def plot_spectra(
    periods: ArrayLike,
    spectra: ArrayLike,
    bands: Sequence[tuple[ArrayLike, str, str]],
    ax: Axes | None = None,
) -> Axes:
    """Draw response spectra (n_record, n_period) [g], and bands over them.

    A band has rows low, median and high, its colour and its label.
    """
    ax = axes_of(ax, (9.0, 4.5))
    ax.plot(periods, np.transpose(spectra), color=GREY, lw=0.5)
    for rows, colour, label in bands:
        low, median, high = np.asarray(rows)
        ax.fill_between(periods, low, high, color=colour, alpha=0.2, lw=0.0)
        ax.plot(periods, median, color=colour, lw=2.0, label=label)
    ax.set(
        xscale="log", yscale="log", xlabel="period [s]", ylabel="Sa, 5 % damping [g]"
    )
    legend(ax)
    return ax


def plot_plane(table, runs: FloatArray, ax: Axes | None = None) -> Axes:
    """Draw contours of a table of probabilities, and the runs.

    A run is a row of both intensities, and 1 if it collapsed, else 0.
    """
    ax = axes_of(ax, (5.6, 4.2))
    one, two = table.columns[:2]
    verdicts = (1, "collapsed", "x", VERMILION), (0, "survived", ".", GREY)
    for code, label, mark, colour in verdicts:
        x, y, _ = runs[runs[:, 2] == code].T
        ax.plot(x, y, mark, color=colour, ms=4.0, label=label)
    grid = table.pivot(index=two, columns=one, values="probability")
    levels = 0.05, 0.25, 0.5, 0.75, 0.95
    ax.set(xscale="log", yscale="log", xlabel=one, ylabel=two)
    lines = ax.contour(grid.columns, grid.index, grid, levels, colors=BLUE)
    ax.clabel(lines, fontsize=SIZE)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter("{x:g}")
    ax.tick_params(which="minor", colors=INK, labelsize=SIZE - 1.0)
    legend(ax, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return ax
