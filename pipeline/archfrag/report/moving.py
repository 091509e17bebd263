"""A run in motion: voussoirs, ties and ground.

CSS moves each voussoir from key frame to key frame without a script. Paper, and readers who ask
for reduced motion, get four still frames.
"""

from collections.abc import Callable

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.files import counted
from archfrag.report import html
from archfrag.report import svg as look
from archfrag.report.arch_figure import Example
from archfrag.report.html import TEXTS, Picture
from archfrag.report.svg import NARROW, FloatArray, Panel, Sheet, even_ticks

LONGEST = 8.0  # [s] of a run, shown in real time
_MOST_FRAMES = 40
_MOST_TRANSFORMS = 2400  # voussoirs by frames: about 50 bytes each
_CANDIDATES = 600
_HOLD = 1.5  # [s] that the last frame stays
_SMALL = 0.1  # largest rotation [rad] of a motion that is drawn three times as large
_STRIP = 46.0  # [px] of the ground's acceleration
Film = tuple[Picture, Picture]  # in motion, and still frames
Frames = tuple[FloatArray, FloatArray, FloatArray]  # time [s], centroids [m], rotations [rad]


def key_frames(example: Example) -> Frames | None:
    """Frames between which linear motion comes closest to the run's; None if nothing moves."""
    time, shift, rotation = example.response._arrays()
    start, end = example.response._window(LONGEST)
    if start == end:
        return None
    size = float(np.ptp(np.concatenate(example.arch.outlines), axis=0).max())
    state = np.dstack([shift, 0.1 * size * rotation]).reshape(time.size, -1)
    first, last = int(np.searchsorted(time, start)), int(np.searchsorted(time, end, "right")) - 1
    rows = np.unique(np.linspace(first, last, min(_CANDIDATES, last - first + 1)).astype(int))
    most = int(np.clip(_MOST_TRANSFORMS // rotation.shape[1], 12, _MOST_FRAMES))
    kept = rows[_most_telling(time[rows], state[rows], most)]
    centroid = np.asarray(example.arch.centroids, dtype=float)
    return time[kept], centroid + shift[kept], rotation[kept]


def _most_telling(time: FloatArray, state: FloatArray, most: int) -> np.ndarray:
    """Rows with first and last, added one by one where the state is farthest from linear."""
    kept = np.array([0, len(time) - 1])
    while kept.size < min(most, len(time)):
        right = np.clip(np.searchsorted(kept, np.arange(len(time)), side="left"), 1, None)
        a, b = kept[right - 1], kept[right]
        part = ((time - time[a]) / np.maximum(time[b] - time[a], 1e-12))[:, None]
        error = np.abs(state - (1.0 - part) * state[a] - part * state[b]).max(axis=1)
        error[kept] = -1.0
        kept = np.sort(np.append(kept, int(error.argmax())))
    return kept


def film(example: Example, name: str, title: str, enlarged: bool = False) -> Film | None:
    """A run in motion, if small maybe `enlarged`, and four frames of it; None if nothing moves."""
    frames = key_frames(example)
    if frames is None:
        return None
    arch, (time, place, rotation) = example.arch, frames
    centroid = np.asarray(arch.centroids, dtype=float)
    larger = 3.0 if enlarged and np.abs(rotation).max() < _SMALL else 1.0
    place, rotation = centroid + larger * (place - centroid), larger * rotation
    low, high = arch._frame(place, rotation, 0.06)
    wide, tall = (high - low).tolist()
    scale = min(NARROW / wide, 300.0 / tall)
    origin, height = (low[0] - 0.5 * (NARROW / scale - wide), high[1]), scale * tall

    def pixels(points: FloatArray, at: ArrayLike) -> FloatArray:  # where pixel 0, 0 is `at` [m]
        return scale * (points - np.asarray(at)) * (1.0, -1.0)

    moves = np.dstack([pixels(place, origin), -np.rad2deg(rotation)])
    duration, reach = float(time[-1] - time[0]) + _HOLD, np.abs(rotation).max(axis=1)
    stills = [int(np.argmax(reach >= part * reach.max())) for part in (0.0, 0.33, 0.67, 1.0)]
    if not example.response.collapsed:
        parts = np.array_split(np.arange(time.size), min(4, time.size))
        stills = [int(part[reach[part].argmax()]) for part in parts]
    first, last = arch.springings
    bodies = counted(last - first, "block" if arch.free_end else "voussoir")
    bodies += " on piers" * (first > 0)
    what = f"{title}: {bodies} under {example.motion.id}, {example.level}"
    # The acceleration of the ground stands below.
    sheet, ends = Sheet(NARROW), (float(time[0]), float(time[-1]))
    box = (12.0, height + 2.0, NARROW - 12.0, height + 2.0 + _STRIP)
    panel = Panel(sheet, box, ends, (-1.0, 1.0))
    peak = example.motion.pga * example.factor / STANDARD_GRAVITY
    seen = draw_ground(panel, example, 240)
    which = "peak" if seen > 0.995 * peak else "peak of the window"
    words = f"time [s], with the ground acceleration ({which} {seen:.2g} g)"
    panel.axis_x(even_ticks(*ends, 6), words)
    outlines = zip(map(np.asarray, arch.outlines), centroid)
    ties = _tie_moves(arch, place, rotation, pixels, origin)
    drawn = {
        "name": name, "label": what, "width": NARROW, "height": height, "strip": _STRIP,
        "shapes": [look.trace(*pixels(outline, at).T) for outline, at in outlines],
        "rest": pixels(centroid, origin).tolist(), "moves": moves.swapaxes(0, 1).tolist(),
        "ties": ties.tolist(),
        "percent": (100.0 * (time - time[0]) / duration).tolist(), "duration": duration,
        "time": time, "stills": stills, "ground": Markup("".join(sheet.parts)),
    }  # fmt: skip
    shown = "true to scale" if larger == 1.0 else "drawn three times as large as it is"
    facts = {"what": what, "reason": example.reason, "frames": time.size, "size": shown,
             "ground": example.ground}  # fmt: skip
    caption = TEXTS["film"]["caption"].format(**facts, start=time[0], end=time[-1])
    strip = html.template("stills.html.j2", **drawn, columns=len(stills), kind="strip")
    return Picture(html.template("film.html.j2", **drawn), caption), Picture(strip, what)


def _tie_moves(
    arch: Arch, place: FloatArray, rotation: FloatArray, pixels: Callable[..., FloatArray],
    origin: tuple[float, float],
) -> FloatArray:  # fmt: skip
    """Left end [px], angle [degrees] and length [px] of ties over time, (n_tie, n_time, 4)."""
    rows = []
    for line, bodies in zip(arch.tie_lines, arch.tie_bodies.tolist()):
        ends = []
        for end, body in zip(line, bodies):
            at = np.tile(end, (len(place), 1))
            if 0 <= body < arch.n_voussoir:
                (x, y), turn = end - arch.centroids[body], rotation[:, body]
                sine, cosine = np.sin(turn), np.cos(turn)
                turned = cosine * x - sine * y, sine * x + cosine * y
                at = place[:, body] + np.column_stack(turned)
            ends.append(pixels(at, origin))
        along = ends[1] - ends[0]
        angle = np.rad2deg(np.unwrap(np.arctan2(along[:, 1], along[:, 0])))
        rows.append(np.column_stack([ends[0], angle, np.hypot(*along.T)]))
    return np.array(rows).reshape(-1, len(place), 4)


def draw_ground(panel: Panel, example: Example, bins: int) -> float:
    """Draw the acceleration of the ground [g] in a panel over time; return its peak."""
    acceleration = example.motion.acceleration * (example.factor / STANDARD_GRAVITY)
    times = np.arange(acceleration.size) * example.motion.dt
    start, end = panel.x
    shown = np.concatenate([[start], times[(times > start) & (times < end)], [end]])
    place, low, high = look.envelope(np.interp(shown, times, acceleration, right=0.0), bins)
    peak = max(float(np.abs([low, high]).max()), 1e-9)
    panel.y = (-1.05 * peak, 1.05 * peak)
    zero = look.number(float(panel.at_y(0.0)))
    panel.sheet.path(f"M{look.number(panel.box[0])} {zero}H{look.number(panel.box[2])}", kind="gr")
    x = panel.at_x(np.interp(place, np.arange(shown.size), shown))
    panel.sheet.path(look.ribbon(x, panel.at_y(low), panel.at_y(high)), kind="ground")
    return peak
