"""What drawings need of an arch: where its fill lies, and a frame in which it moves."""

from __future__ import annotations

import numpy as np

from archfrag.arch.checks import FloatArray
from archfrag.arch.shape import Shape


def fill_outlines(arch: Shape) -> list[FloatArray]:
    """Return the outlines of fill and of backing, (m, 2) each [m]; empty without fill.

    They run along chords of the extrados, on which the voussoirs are drawn.
    """
    fill, (first, last) = arch.parameters.get("fill"), arch.springings
    if not fill:
        return []
    back = arch.extrados[first : last + 1]
    below = back[back[:, 0].argmin() : back[:, 0].argmax() + 1]
    if first:  # on piers, whose tops carry fill too
        tops = []
        for outline in (arch.outlines[first - 1], arch.outlines[last]):
            high = outline[outline[:, 1] > outline[:, 1].max() - 1e-9 * np.ptp(outline)]
            tops.append(high[high[:, 0].argsort()])  # from left to right
        left, right = tops[0][:, 0] < below[0, 0], tops[1][:, 0] > below[-1, 0]
        below = np.concatenate([tops[0][left], below, tops[1][right]])
    level = np.concatenate(arch.outlines[first:last])[:, 1].max() + fill["height_over_crown"]
    middle = 0.5 * (arch.intrados + arch.extrados)[[first, last], 1].min()
    levels = [level] + [middle + fill["backing_height"]] * (fill.get("backing_height", 0.0) > 0.0)
    outlines = []
    for top in np.minimum(levels, level):
        line = np.column_stack([below[:, 0], np.minimum(below[:, 1], top)])
        outlines.append(np.concatenate([line, [[line[-1, 0], top], [line[0, 0], top]]]))
    return outlines


def frame(
    arch: Shape, place: FloatArray, rotation: FloatArray, margin: float
) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner of a frame about all bodies [m].

    They are seen at rest and in motion, their centroids at `place` (n_time, n_voussoir, 2), turned
    by `rotation`. What flies off by more than the size of the arch is out of the frame; `margin`
    is a part of this size.
    """
    rest, seen = np.concatenate(arch.outlines), list[FloatArray]()
    for body, outline in enumerate(arch.outlines):
        x, y = np.transpose(outline - arch.centroids[body])[:, :, None]
        sine, cosine = np.sin(rotation[:, body]), np.cos(rotation[:, body])
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        seen.append((turned + place[:, body]).reshape(-1, 2))
    moved, low, high = np.concatenate(seen), rest.min(axis=0), rest.max(axis=0)
    size = float((high - low).max())
    first = np.maximum(np.minimum(low, moved.min(axis=0)), low - size) - margin * size
    return first, np.minimum(np.maximum(high, moved.max(axis=0)), high + size) + margin * size
