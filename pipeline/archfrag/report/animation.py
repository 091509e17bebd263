"""A run as moving SVG: CSS moves each voussoir from key frame to key frame, no script needed.

Who asks for reduced motion, and paper, get four of the frames beside each other instead.
"""

from dataclasses import dataclass
from html import escape

import numpy as np

from archfrag.report import picture as look
from archfrag.report.arch_figure import EDGE, STONE
from archfrag.report.example import Example
from archfrag.report.picture import NARROW, FloatArray, Picture, number, trace
from archfrag.report.plot import Panel, Sheet

LONGEST = 8.0  # [s] of a run, shown in real time
_MOST_FRAMES = 40
_MOST_TRANSFORMS = 2400  # voussoirs by frames: about 50 bytes each
_CANDIDATES = 600
_HOLD = 1.5  # [s] that the last frame stays
_STRIP = 46.0  # [px] of the ground's acceleration
_TRACE = 240


@dataclass(frozen=True)
class Frames:
    """Key frames of a run."""

    time: FloatArray  #: (n_frame,) [s]
    place: FloatArray  #: (n_frame, n_voussoir, 2), centroids [m]
    rotation: FloatArray  #: (n_frame, n_voussoir), counter-clockwise [rad]


def key_frames(example: Example) -> Frames | None:
    """Frames between which linear motion comes closest to the run's; None if nothing moves.

    Of a collapse the last seconds are taken, of another run those about its largest rotation.
    Frames are added one by one where the motion between two neighbours is farthest from linear.
    """
    history = example.response.history
    if history is None:
        return None
    time = np.asarray(history["time"].values, dtype=float)
    shift = np.asarray(history["displacement"].values, dtype=float)
    rotation = np.asarray(history["rotation"].values, dtype=float)
    size = float(np.ptp(np.concatenate(example.arch.outlines), axis=0).max())
    state = np.concatenate([shift, 0.1 * size * rotation[..., None]], axis=2)
    state = state.reshape(time.size, -1)
    moving = np.flatnonzero(np.abs(state).max(axis=1) > 1e-5 * size)
    if moving.size < 2:
        return None
    first, last = _window(
        time, np.abs(rotation).max(axis=1), moving, bool(example.response.collapsed)
    )
    stay = np.unique(np.linspace(first, last, min(_CANDIDATES, last - first + 1)).astype(int))
    most = int(np.clip(_MOST_TRANSFORMS // rotation.shape[1], 12, _MOST_FRAMES))
    kept = stay[_most_telling(time[stay], state[stay], most)]
    centroid = np.asarray(example.arch.chain.centroid, dtype=float)
    return Frames(time[kept], centroid + shift[kept], rotation[kept])


def _window(
    time: FloatArray, reach: FloatArray, moving: np.ndarray, collapsed: bool
) -> tuple[int, int]:
    """First and last row of a history that are shown."""
    start, end = float(time[max(moving[0] - 1, 0)]), float(time[moving[-1]])
    if collapsed:
        end = float(time[-1])
        start = max(start, end - LONGEST)
    else:
        peak = float(time[int(reach.argmax())])
        start = max(start, min(peak - 0.5 * LONGEST, end - LONGEST))
        end = min(end, start + LONGEST)
    return int(np.searchsorted(time, start)), int(np.searchsorted(time, end, side="right")) - 1


def _most_telling(time: FloatArray, state: FloatArray, most: int) -> np.ndarray:
    """Rows between which linear interpolation is closest to all rows, first and last included."""
    kept = np.array([0, len(time) - 1])
    while kept.size < min(most, len(time)):
        right = np.clip(np.searchsorted(kept, np.arange(len(time)), side="left"), 1, None)
        a, b = kept[right - 1], kept[right]
        part = ((time - time[a]) / np.maximum(time[b] - time[a], 1e-12))[:, None]
        error = np.abs(state - (1.0 - part) * state[a] - part * state[b]).max(axis=1)
        error[kept] = -1.0
        kept = np.sort(np.append(kept, int(error.argmax())))
    return kept


class _Film:
    """Key frames of a run on a drawing."""

    def __init__(self, example: Example, frames: Frames, name: str) -> None:
        self.example, self.frames, self.name = example, frames, name
        self.centroid = np.asarray(example.arch.chain.centroid, dtype=float)
        points = np.concatenate(example.arch.outlines)
        low, high = points.min(axis=0), points.max(axis=0)
        size = float((high - low).max())
        seen = frames.place.reshape(-1, 2)
        margin = 0.06 * size
        low = np.maximum(np.minimum(low, seen.min(axis=0)), low - 0.3 * size) - margin
        high = np.minimum(np.maximum(high, seen.max(axis=0)), high + 0.3 * size) + margin
        width, height = (high - low).tolist()
        self.scale = min(NARROW / width, 300.0 / height)
        self.height = self.scale * height
        self.left = float(low[0]) - 0.5 * (NARROW / self.scale - width)
        self.top = float(high[1])
        self.places = self.at(frames.place)

    def at(self, points: FloatArray) -> FloatArray:
        """Pixels of points (..., 2)."""
        return self.scale * (points - (self.left, self.top)) * (1.0, -1.0)

    def shapes(self) -> str:
        """Definitions of the voussoirs about their centroids [px]."""
        shapes = []
        for i, outline in enumerate(self.example.arch.outlines):
            x, y = (self.scale * (np.asarray(outline) - self.centroid[i]) * (1.0, -1.0)).T
            shapes.append(f'<path id="{self.name}-{i}" d="{trace(x, y)}z"/>')
        return f"<defs>{''.join(shapes)}</defs>"

    def moving(self) -> str:
        """Voussoirs with their key frames, the ground's acceleration and a line at the time."""
        name, frames = self.name, self.frames
        span = float(frames.time[-1] - frames.time[0])
        percent = 100.0 * (frames.time - frames.time[0]) / (span + _HOLD)
        when = [f"{number(p)}%" for p in percent[:-1]] + [f"{number(percent[-1])}%,to"]
        rules, bodies, ghosts = [], [], []
        for i, (x, y) in enumerate(self.at(self.centroid)):
            steps = "".join(
                f"{p}{{transform:{_transform(self.places[k, i], frames.rotation[k, i], 'css')}}}"
                for k, p in enumerate(when)
            )
            rules.append(f"@keyframes {name}-k{i}{{{steps}}}")
            rules.append(f"#{name}-b{i}{{animation-name:{name}-k{i}}}")
            bodies.append(f'<use href="#{name}-{i}" id="{name}-b{i}"/>')
            there = f"translate({number(x)} {number(y)})"
            ghosts.append(f'<use href="#{name}-{i}" transform="{there}"/>')
        strip, travel = self.strip()
        rules.append(
            f"@keyframes {name}-t{{{when[-1]}{{transform:translate({travel:.1f}px)}}}}"
            f"#{name}-line{{animation-name:{name}-t}}"
            f"#{name}-run *{{animation-duration:{span + _HOLD:.2f}s;animation-timing-function:"
            "linear;animation-iteration-count:infinite}"
        )
        return (
            f"<style>{''.join(rules)}</style>"
            f'<g id="{name}-rest" fill="none" stroke="{look.GREY}" stroke-width=".7">'
            f"{''.join(ghosts)}</g>{strip}"
            f'<g id="{name}-run"><g fill="{STONE}" stroke="{EDGE}">{"".join(bodies)}</g>'
            f'<path id="{name}-line" d="M12 {number(self.height + 2)}v{number(_STRIP)}" '
            f'stroke="{look.VERMILION}" stroke-width="1.6"/></g>'
        )

    def strip(self) -> tuple[str, float]:
        """The ground's acceleration over the time shown, and the width of its panel [px]."""
        start, end = float(self.frames.time[0]), float(self.frames.time[-1])
        time = np.linspace(start, end, _TRACE)
        values = np.interp(time, *self.example.ground, right=0.0)
        reach = max(float(np.abs(values).max()), 1e-9)
        sheet = Sheet(NARROW)
        box = (12.0, self.height + 2.0, NARROW - 12.0, self.height + 2.0 + _STRIP)
        panel = Panel(sheet, box, (start, end), (-reach, reach))
        panel.line(time, values, look.GREY, 0.8)
        panel.axis_x(look.even_ticks(start, end, 6), "time [s], with the ground acceleration")
        return "".join(sheet.parts), box[2] - box[0]

    def still(self) -> str:
        """Four frames up to the largest rotation, two in a row."""
        sheet, name, rotation = Sheet(NARROW), self.name, self.frames.rotation
        reach = np.abs(rotation).max(axis=1)
        for place, part in enumerate((0.0, 0.33, 0.67, 1.0)):
            k = int(np.argmax(reach >= part * reach.max()))
            left, top = 0.5 * NARROW * (place % 2), (0.5 * self.height + 20.0) * (place // 2)
            bodies = "".join(
                f'<use href="#{name}-{i}" transform="{_transform(at, rotation[k, i], "svg")}"/>'
                for i, at in enumerate(self.places[k])
            )
            sheet.parts.append(
                f'<g transform="translate({number(left)} {number(top + 14.0)}) scale(.5)" '
                f'fill="{STONE}" stroke="{EDGE}" stroke-width="1.6"><use href="#{name}-rest"/>'
                f"{bodies}</g>"
            )
            sheet.text(left + 6.0, top + 12.0, f"{self.frames.time[k]:.2f} s", "b")
        return "".join(sheet.parts)


def animation(example: Example, name: str, title: str) -> Picture | None:
    """A run in motion, with its still frames and a box to stop it; None if nothing moves."""
    frames = key_frames(example)
    if frames is None:
        return None
    film = _Film(example, frames, name)
    what = (
        f"{title}: {example.arch.n_voussoir} voussoirs under {example.motion.id}, {example.level}"
    )
    label, window = escape(what, quote=True), f"{frames.time[0]:.2f} to {frames.time[-1]:.2f} s"
    return Picture(
        f'<div class="motion"><label><input type="checkbox"> pause</label>'
        f'<svg class="moving" viewBox="0 0 {number(NARROW)} {number(film.height + _STRIP + 40.0)}"'
        f' role="img" aria-label="{label}, moving">{film.shapes()}{film.moving()}</svg>'
        f'<svg class="still" viewBox="0 0 {number(NARROW)} {number(film.height + 40.0)}" '
        f'role="img" aria-label="{label}, four frames from {window}">{film.still()}</svg></div>',
        f"{what}, {example.reason}. Motion relative to the ground, true to scale and in real "
        f"time, {window}; {frames.time.size} key frames, linear between them. Outlined: at rest. "
        "Still frames: before the largest rotation.",
    )


def _transform(place: FloatArray, rotation: float, kind: str) -> str:
    x, y, angle = number(place[0]), number(place[1]), number(-float(np.rad2deg(rotation)))
    if kind == "css":
        return f"translate({x}px,{y}px)rotate({angle}deg)"
    return f"translate({x} {y})rotate({angle})"
