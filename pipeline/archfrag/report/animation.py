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


@dataclass(frozen=True)
class _Stage:
    """Where metres are on the drawing."""

    left: float
    top: float
    scale: float

    @classmethod
    def of(cls, example: Example, frames: Frames) -> "tuple[_Stage, float]":
        """The stage that holds the frames, and its height [px]."""
        points = np.concatenate(example.arch.outlines)
        low, high = points.min(axis=0), points.max(axis=0)
        size = float((high - low).max())
        seen = frames.place.reshape(-1, 2)
        margin = 0.06 * size
        low = np.maximum(np.minimum(low, seen.min(axis=0)), low - 0.3 * size) - margin
        high = np.minimum(np.maximum(high, seen.max(axis=0)), high + 0.3 * size) + margin
        width, height = high - low
        scale = min(NARROW / float(width), 300.0 / float(height))
        left = float(low[0]) - 0.5 * (NARROW / scale - float(width))
        return cls(left, float(high[1]), scale), scale * float(height)

    def at(self, points: FloatArray) -> FloatArray:
        """Pixels of points (..., 2)."""
        return np.stack(
            [self.scale * (points[..., 0] - self.left), self.scale * (self.top - points[..., 1])],
            axis=-1,
        )


def animation(example: Example, name: str, title: str) -> Picture | None:
    """A run in motion, with its still frames and a box to stop it; None if nothing moves."""
    frames = key_frames(example)
    if frames is None:
        return None
    stage, height = _Stage.of(example, frames)
    shapes = _shapes(example, stage, name)
    what = (
        f"{title}: {example.arch.n_voussoir} voussoirs under {example.motion.id}, {example.level}"
    )
    moving = _moving(example, frames, stage, (name, height))
    still = _still(frames, stage, name, height)
    label = escape(what, quote=True)
    window = f"{frames.time[0]:.2f} to {frames.time[-1]:.2f} s"
    return Picture(
        f'<div class="motion"><label><input type="checkbox"> pause</label>'
        f'<svg class="moving" viewBox="0 0 {number(NARROW)} {number(height + _STRIP + 40.0)}" '
        f'role="img" aria-label="{label}, moving">{shapes}{moving}</svg>'
        f'<svg class="still" viewBox="0 0 {number(NARROW)} {number(height + 40.0)}" '
        f'role="img" aria-label="{label}, four frames from {window}">{still}</svg></div>',
        f"{what}, {example.reason}. Motion relative to the ground, true to scale and in real "
        f"time, {window}; {frames.time.size} key frames, linear between them. Outlined: at rest. "
        "Still frames: before the largest rotation.",
    )


def _shapes(example: Example, stage: _Stage, name: str) -> str:
    """Definitions of the voussoirs about their centroids [px]."""
    centroid = np.asarray(example.arch.chain.centroid, dtype=float)
    shapes = []
    for i, outline in enumerate(example.arch.outlines):
        x, y = (stage.scale * (np.asarray(outline) - centroid[i]) * (1.0, -1.0)).T
        shapes.append(f'<path id="{name}-{i}" d="{trace(x, y)}z"/>')
    return f"<defs>{''.join(shapes)}</defs>"


def _moving(example: Example, frames: Frames, stage: _Stage, where: tuple[str, float]) -> str:
    """Voussoirs with their key frames, the ground's acceleration and a line at the time."""
    name, height = where
    span = float(frames.time[-1] - frames.time[0])
    percent = 100.0 * (frames.time - frames.time[0]) / (span + _HOLD)
    places = stage.at(frames.place)
    rest = stage.at(np.asarray(example.arch.chain.centroid, dtype=float))
    rules, bodies, ghosts = [], [], []
    for i in range(places.shape[1]):
        steps = [
            f"{number(p)}%{{transform:{_transform(places[k, i], frames.rotation[k, i], 'css')}}}"
            for k, p in enumerate(percent)
        ]
        last = _transform(places[-1, i], frames.rotation[-1, i], "css")
        steps[-1] = f"{number(percent[-1])}%,to{{transform:{last}}}"
        rules.append(f"@keyframes {name}-k{i}{{{''.join(steps)}}}")
        rules.append(f"#{name}-b{i}{{animation-name:{name}-k{i}}}")
        bodies.append(f'<use href="#{name}-{i}" id="{name}-b{i}"/>')
        x, y = number(rest[i, 0]), number(rest[i, 1])
        ghosts.append(f'<use href="#{name}-{i}" transform="translate({x} {y})"/>')
    strip, travel = _strip(example, frames, height)
    rules.append(
        f"@keyframes {name}-t{{{number(percent[-1])}%,to{{transform:translate({travel:.1f}px)}}}}"
        f"#{name}-line{{animation-name:{name}-t}}"
        f"#{name}-run *{{animation-duration:{span + _HOLD:.2f}s;animation-timing-function:linear;"
        "animation-iteration-count:infinite}"
    )
    return (
        f"<style>{''.join(rules)}</style>"
        f'<g id="{name}-rest" fill="none" stroke="{look.GREY}" stroke-width=".7">'
        f"{''.join(ghosts)}</g>{strip}"
        f'<g id="{name}-run"><g fill="{STONE}" stroke="{EDGE}">{"".join(bodies)}</g>'
        f'<path id="{name}-line" d="M12 {number(height + 2)}v{number(_STRIP)}" '
        f'stroke="{look.VERMILION}" stroke-width="1.6"/></g>'
    )


def _strip(example: Example, frames: Frames, height: float) -> tuple[str, float]:
    """The ground's acceleration over the time shown, and the width of its panel [px]."""
    start, end = float(frames.time[0]), float(frames.time[-1])
    time = np.linspace(start, end, _TRACE)
    values = np.interp(time, *example.ground, right=0.0)
    reach = max(float(np.abs(values).max()), 1e-9)
    sheet = Sheet(NARROW)
    box = (12.0, height + 2.0, NARROW - 12.0, height + 2.0 + _STRIP)
    panel = Panel(sheet, box, (start, end), (-reach, reach))
    panel.line(time, values, look.GREY, 0.8)
    panel.axis_x(look.even_ticks(start, end, 6), "time [s], with the ground acceleration")
    return "".join(sheet.parts), box[2] - box[0]


def _still(frames: Frames, stage: _Stage, name: str, height: float) -> str:
    """Four frames up to the largest rotation, two in a row."""
    sheet = Sheet(NARROW)
    reach = np.abs(frames.rotation).max(axis=1)
    chosen = [int(np.argmax(reach >= part * reach.max())) for part in (0.0, 0.33, 0.67, 1.0)]
    places = stage.at(frames.place)
    for number_, k in enumerate(chosen):
        left, top = 0.5 * NARROW * (number_ % 2), (0.5 * height + 20.0) * (number_ // 2)
        bodies = "".join(
            f'<use href="#{name}-{i}" transform="'
            f'{_transform(places[k, i], frames.rotation[k, i], "svg")}"/>'
            for i in range(places.shape[1])
        )
        sheet.parts.append(
            f'<g transform="translate({number(left)} {number(top + 14.0)}) scale(.5)" '
            f'fill="{STONE}" stroke="{EDGE}" stroke-width="1.6"><use href="#{name}-rest"/>'
            f"{bodies}</g>"
        )
        sheet.text(left + 6.0, top + 12.0, f"{frames.time[k]:.2f} s", "b")
    return "".join(sheet.parts)


def _transform(place: FloatArray, rotation: float, kind: str) -> str:
    x, y, angle = number(place[0]), number(place[1]), number(-float(np.rad2deg(rotation)))
    if kind == "css":
        return f"translate({x}px,{y}px)rotate({angle}deg)"
    return f"translate({x} {y})rotate({angle})"
