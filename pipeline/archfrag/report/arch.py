"""An arch drawn with hinges and thrust lines at onset, and in motion.

In motion, CSS moves each voussoir from key frame to key frame without a script. Readers who ask
for reduced motion, and paper, get four of the frames instead.
"""

from html import escape

import numpy as np

from archfrag.arch import Arch
from archfrag.report import drawing as look
from archfrag.report.axes import Panel, even_ticks
from archfrag.report.drawing import NARROW, Entry, FloatArray, Picture, Sheet, figure, number
from archfrag.report.example import Example
from archfrag.report.results import onset_text
from archfrag.simulate import Onset

STONE, EDGE = "#e9e4da", "#8d8473"
LONGEST = 8.0  # [s] of a run, shown in real time
_MOST_FRAMES = 40
_MOST_TRANSFORMS = 2400  # voussoirs by frames: about 50 bytes each
_CANDIDATES = 600
_HOLD = 1.5  # [s] that the last frame stays
_STRIP = 46.0  # [px] of the ground's acceleration
_TRACE = 240
Frames = tuple[FloatArray, FloatArray, FloatArray]  # time [s], centroids [m], rotations [rad]


def pixels(points: FloatArray, scale: float, origin: tuple[float, float]) -> FloatArray:
    """Pixels of points (..., 2) [m], where pixel 0, 0 is at the origin [m]."""
    return scale * (points - np.array(origin)) * (1.0, -1.0)


@figure
def arch_at_onset(sheet: Sheet, arch: Arch, onset: Onset, name: str) -> tuple[str, str]:
    """Draw the arch twice: ground accelerating towards +x, and towards -x."""
    if not onset.stands:
        _at_onset(sheet, (0.0, 0.0, sheet.width), arch, onset, 0)
        return (
            f"{name}, which does not stand under its own weight",
            "The arch does not stand under its own weight; there is no onset to show.",
        )
    key = [
        Entry("thrust at onset", look.VERMILION, "line"),
        Entry("thrust, self-weight", look.SOFT, "dash"),
        Entry("hinge", look.BLUE, "dot"),
    ]
    if len(onset.sliding) or len(onset.sliding_minus):
        key.append(Entry("sliding joint", look.ORANGE))
    top = sheet.legend(8.0, 0.0, key, sheet.width - 16.0)
    each = sheet.width if sheet.narrow else 0.5 * sheet.width
    for i, (direction, limit) in enumerate((("+x", onset.plus), ("−x", onset.minus))):
        left = 0.0 if sheet.narrow else i * each
        words = f"ground accelerating towards {direction}: {onset_text(limit)}"
        sheet.text(left + 8.0, top + 14.0, words, "b")
        _at_onset(sheet, (left, top + 20.0, each), arch, onset, -1 if i else 1)
        top = sheet.height + 4.0 if sheet.narrow else top
    return (
        f"{name} with hinges and thrust line at onset: {onset_text(onset.plus)} towards +x, "
        f"{onset_text(onset.minus)} towards −x",
        "Mechanism with which the motion begins at the onset acceleration. Filled circles: "
        "hinges. Lines join the contact centres of the joints: solid at onset, dashed under "
        "self-weight alone, where an arch with all joints closed is hyperstatic and the line "
        "is one admissible choice. Numbers: joints.",
    )


def _at_onset(
    sheet: Sheet, box: tuple[float, float, float], arch: Arch, onset: Onset, sign: int
) -> None:
    """An arch in a box (left, top, width [px]) with the mechanism of a direction, if it stands."""
    left, top, width = box
    points = np.concatenate(arch.outlines)
    low, (span, height) = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-9)
    # Numbers of joints stand beside the springings.
    scale = float(min(min(width - 46.0, 330.0) / span, 260.0 / height))
    middle, ground = left + 0.5 * width, top + 16.0 + scale * float(height)
    origin = (float(low[0] + 0.5 * span) - middle / scale, float(low[1]) + ground / scale)

    def path(points: FloatArray, end: str = "", **attributes: object) -> None:
        sheet.path(look.trace(*pixels(points, scale, origin).T) + end, **attributes)

    for outline in arch.outlines:
        path(outline, "z", fill=STONE, stroke=EDGE, stroke_width=0.8)
    if sign:
        path(np.asarray(onset.thrust), fill="none", stroke=look.SOFT, stroke_width=1.1,
             stroke_dasharray="4 2.5")  # fmt: skip
        moving, sliding, hinges = (
            (onset.thrust_plus, onset.sliding, onset.hinges) if sign > 0
            else (onset.thrust_minus, onset.sliding_minus, onset.hinges_minus)
        )  # fmt: skip
        if moving is not None:
            path(np.asarray(moving), fill="none", stroke=look.VERMILION, stroke_width=1.5)
        for joint in sliding:
            ends = np.stack([arch.intrados[joint], arch.extrados[joint]])
            path(ends, stroke=look.ORANGE, stroke_width=4)
        for joint, side in hinges:
            x, y = pixels(getattr(arch, side)[joint], scale, origin).tolist()
            sheet.dots([(x, y)], 4.0, look.BLUE, "hinge")
        y, half, reach = ground + 13.0, sign * 0.16 * scale * span, 0.5 * scale * span
        sheet.path(f"M{middle - reach:.1f} {ground:.1f}h{2 * reach:.1f}", kind="ax")
        line = f"M{middle - half:.1f} {y:.1f}H{middle + half:.1f}"
        sheet.path(line, stroke=look.INK, stroke_width=1.3)
        tip = f"M{middle + half + sign * 7:.1f} {y:.1f}l{-sign * 9:.1f} -4v8z"
        sheet.path(tip, fill=look.INK)
    outward = arch.extrados[: arch.n_joint] - arch.intrados[: arch.n_joint]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    for joint in range(0, arch.n_joint, max(1, int(np.ceil(arch.n_joint / 15)))):
        x, y = pixels(arch.extrados[joint], scale, origin) + 11.0 * outward[joint] * (1.0, -1.0)
        sheet.text(x, y + 3.5, str(joint), "s m q")
    sheet.height = max(sheet.height, ground + 24.0)


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
    start, end = float(time[max(moving[0] - 1, 0)]), float(time[moving[-1]])
    if example.response.collapsed:
        end = float(time[-1])
        start = max(start, end - LONGEST)
    else:
        peak = float(time[int(np.abs(rotation).max(axis=1).argmax())])
        start = max(start, min(peak - 0.5 * LONGEST, end - LONGEST))
        end = min(end, start + LONGEST)
    first, last = int(np.searchsorted(time, start)), int(np.searchsorted(time, end, "right")) - 1
    rows = np.unique(np.linspace(first, last, min(_CANDIDATES, last - first + 1)).astype(int))
    most = int(np.clip(_MOST_TRANSFORMS // rotation.shape[1], 12, _MOST_FRAMES))
    kept = rows[_most_telling(time[rows], state[rows], most)]
    centroid = np.asarray(example.arch.chain.centroid, dtype=float)
    return time[kept], centroid + shift[kept], rotation[kept]


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


def film(example: Example, name: str, title: str) -> Picture | None:
    """A run in motion, with its still frames and a box to stop it; None if nothing moves."""
    frames = key_frames(example)
    if frames is None:
        return None
    arch, (time, place, rotation) = example.arch, frames
    points, centroid = np.concatenate(arch.outlines), np.asarray(arch.chain.centroid, dtype=float)
    low, high = points.min(axis=0), points.max(axis=0)
    size, seen = float((high - low).max()), place.reshape(-1, 2)
    low = np.maximum(np.minimum(low, seen.min(axis=0)), low - 0.3 * size) - 0.06 * size
    high = np.minimum(np.maximum(high, seen.max(axis=0)), high + 0.3 * size) + 0.06 * size
    wide, tall = (high - low).tolist()
    scale = min(NARROW / wide, 300.0 / tall)
    origin = (float(low[0]) - 0.5 * (NARROW / scale - wide), float(high[1]))
    height = scale * tall
    shapes = "".join(
        f'<path id="{name}-{i}" d="{look.trace(*pixels(outline, scale, centroid[i]).T)}z"/>'
        for i, outline in enumerate(map(np.asarray, arch.outlines))
    )
    ghosts = "".join(
        f'<use href="#{name}-{i}" transform="translate({number(x)} {number(y)})"/>'
        for i, (x, y) in enumerate(pixels(centroid, scale, origin))
    )
    moves = time, pixels(place, scale, origin), rotation
    moving, still = _moving(example, moves, name, height), _still(moves, name, height)
    what = f"{title}: {arch.n_voussoir} voussoirs under {example.motion.id}, {example.level}"
    label, window = escape(what, quote=True), f"{time[0]:.2f} to {time[-1]:.2f} s"
    return Picture(
        '<div class="motion"><label><input type="checkbox"> pause</label>'
        f'<svg class="moving" viewBox="0 0 {number(NARROW)} {number(height + _STRIP + 40.0)}"'
        f' role="img" aria-label="{label}, moving"><defs>{shapes}</defs>'
        f'<g id="{name}-rest" fill="none" stroke="{look.GREY}" stroke-width=".7">'
        f'{ghosts}</g>{moving}</svg>'
        f'<svg class="still" viewBox="0 0 {number(NARROW)} {number(height + 40.0)}" '
        f'role="img" aria-label="{label}, four frames from {window}">{still}</svg></div>',
        f"{what}, {example.reason}. Motion relative to the ground, true to scale and in real "
        f"time, {window}; {time.size} key frames, linear between them. Outlined: at rest. "
        "Still frames: before the largest rotation.",
    )


def _moving(example: Example, moves: Frames, name: str, height: float) -> str:
    """Voussoirs with their key frames [px], the ground's acceleration and a line at the time."""
    time, place, rotation = moves
    span = float(time[-1] - time[0])
    percent = [f"{number(p)}%" for p in 100.0 * (time - time[0]) / (span + _HOLD)]
    percent[-1] += ",to"
    rules, bodies = [], []
    for i in range(place.shape[1]):
        steps = "".join(
            f"{p}{{transform:{_transform(at, angle, 'px', 'deg')}}}"
            for p, at, angle in zip(percent, place[:, i], rotation[:, i])
        )
        rules.append(f"@keyframes {name}-k{i}{{{steps}}}")
        rules.append(f"#{name}-b{i}{{animation-name:{name}-k{i}}}")
        bodies.append(f'<use href="#{name}-{i}" id="{name}-b{i}"/>')
    sheet, box = Sheet(NARROW), (12.0, height + 2.0, NARROW - 12.0, height + 2.0 + _STRIP)
    times = np.linspace(time[0], time[-1], _TRACE)
    values = np.interp(times, *example.ground, right=0.0)
    reach = max(float(np.abs(values).max()), 1e-9)
    panel = Panel(sheet, box, (float(time[0]), float(time[-1])), (-reach, reach))
    panel.line(times, values, look.GREY, 0.8)
    panel.axis_x(even_ticks(*panel.x, 6), "time [s], with the ground acceleration")
    rules.append(
        f"@keyframes {name}-t{{{percent[-1]}{{transform:translate({box[2] - box[0]:.1f}px)}}}}"
        f"#{name}-line{{animation-name:{name}-t}}"
        f"#{name}-run *{{animation-duration:{span + _HOLD:.2f}s;animation-timing-function:"
        "linear;animation-iteration-count:infinite}"
    )
    return (
        f"<style>{''.join(rules)}</style>{''.join(sheet.parts)}"
        f'<g id="{name}-run"><g fill="{STONE}" stroke="{EDGE}">{"".join(bodies)}</g>'
        f'<path id="{name}-line" d="M12 {number(height + 2)}v{number(_STRIP)}" '
        f'stroke="{look.VERMILION}" stroke-width="1.6"/></g>'
    )


def _still(moves: Frames, name: str, height: float) -> str:
    """Four frames up to the largest rotation, two in a row."""
    time, place, rotation = moves
    sheet, reach = Sheet(NARROW), np.abs(rotation).max(axis=1)
    for i, part in enumerate((0.0, 0.33, 0.67, 1.0)):
        k = int(np.argmax(reach >= part * reach.max()))
        left, top = 0.5 * NARROW * (i % 2), (0.5 * height + 20.0) * (i // 2)
        bodies = "".join(
            f'<use href="#{name}-{body}" transform="{_transform(at, angle, "", "")}"/>'
            for body, (at, angle) in enumerate(zip(place[k], rotation[k]))
        )
        sheet.parts.append(
            f'<g transform="translate({number(left)} {number(top + 14.0)}) scale(.5)" '
            f'fill="{STONE}" stroke="{EDGE}" stroke-width="1.6"><use href="#{name}-rest"/>'
            f"{bodies}</g>"
        )
        sheet.text(left + 6.0, top + 12.0, f"{time[k]:.2f} s", "b")
    return "".join(sheet.parts)


def _transform(at: FloatArray, rotation: float, px: str, deg: str) -> str:
    """Translation [px] and counter-clockwise rotation [rad], as CSS with units or as SVG."""
    x, y, angle = number(at[0]), number(at[1]), number(-float(np.rad2deg(rotation)))
    return f"translate({x}{px},{y}{px})rotate({angle}{deg})"
