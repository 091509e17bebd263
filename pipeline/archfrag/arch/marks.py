"""What a drawing of an arch shows: marks, each with its role and the bodies that carry it.

`archfrag.plots` paints them by matplotlib, `archfrag.report.arch_figure` as SVG.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from archfrag.arch.bridge import fill_weighs
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import rotated
from archfrag.arch.shape import Shape

GROUND = -1
AREAS = ("earth", "backing", "stone")  # roles of closed outlines
_OVERHANG = 0.04  # of the ground beyond a springing, over the size of the arch


class Mark(NamedTuple):
    """An outline, a line or a point of a drawing."""

    #: earth (fill), backing, stone, tie, ground; of an onset: rest and thrust (thrust lines of the
    #: weight and at onset), sliding, hinge.
    role: str
    points: FloatArray  #: (n_point, 2) [m]
    #: voussoir that carries each point, or one that carries all
    bodies: Sequence[int] = (GROUND,)

    def moved(
        self, centroids: FloatArray, place: FloatArray, rotation: FloatArray
    ) -> FloatArray:
        """Return the points in motion, (n_time, n_point, 2) [m].

        `centroids` (n_voussoir, 2) are those of the voussoirs at rest, `place` (n_time,
        n_voussoir, 2) those in motion [m]; `rotation` (n_time, n_voussoir) is how far they turn
        [rad]. Points that no voussoir carries stay where they are.
        """
        bodies = np.broadcast_to(self.bodies, len(self.points))
        points = np.tile(self.points, (len(place), 1, 1))
        carried = (bodies >= 0) & (bodies < len(centroids))
        body = bodies[carried]
        own = self.points[carried] - centroids[body]
        points[:, carried] = rotated(own, rotation[:, body]) + place[:, body]
        return points


def arch_marks(arch: Shape) -> list[Mark]:
    """Return the fill, the voussoirs, the ties and the ground of an arch at rest."""
    marks = list(map(Mark, AREAS, _fill_outlines(arch)))
    marks += [Mark("stone", o, [body]) for body, o in enumerate(arch.outlines)]
    marks += [Mark(*rod) for rod in arch.rods]
    size = np.ptp(np.concatenate([mark.points for mark in marks]), axis=0).max()
    for joint in (0,) if arch.free_end else (0, arch.n_joint - 1):
        inner = arch.intrados[joint]
        outer = arch.extrados[joint]
        reach = _OVERHANG * size * (outer - inner) / np.linalg.norm(outer - inner)
        marks.append(Mark("ground", np.array([inner - reach, outer + reach])))
    return marks


def mechanism_marks(
    arch: Shape, hinges: Sequence[tuple[int, str]], sliding: Sequence[int]
) -> list[Mark]:
    """Return a mark for the face of each sliding joint and for the point of each hinge.

    `hinges` are pairs of joint and side, "intrados" or "extrados".
    """
    faces = np.stack([arch.intrados, arch.extrados], axis=1)
    marks = [Mark("sliding", faces[joint]) for joint in sliding]
    return marks + [Mark("hinge", getattr(arch, side)[[j]]) for j, side in hinges]


def frame(
    arch: Shape, place: FloatArray, rotation: FloatArray, margin: float
) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner of a frame about all voussoirs [m].

    The frame holds them at rest and in motion (`place` and `rotation` as in `Mark.moved`), but
    reaches no further beyond the arch than its size. `margin` is a fraction of this size.
    """
    stones = [mark for mark in arch_marks(arch) if mark.role == "stone"]
    points = [stone.moved(arch.centroids, place, rotation) for stone in stones]
    seen = np.concatenate([each.reshape(-1, 2) for each in points])
    rest = np.concatenate(arch.outlines)
    low = rest.min(axis=0)
    high = rest.max(axis=0)
    size = (high - low).max()
    first = np.maximum(np.minimum(low, seen.min(axis=0)), low - size)
    last = np.minimum(np.maximum(high, seen.max(axis=0)), high + size)
    return first - margin * size, last + margin * size


def _fill_outlines(arch: Shape) -> list[FloatArray]:
    """Return the outlines of fill and of backing, (m, 2) each [m]; empty without fill.

    They follow the extrados by its chords between joints.
    """
    first, last = arch.springings
    fill = arch.parameters.get("fill")
    if not fill or not fill_weighs(fill):
        return []
    back = arch.extrados[first : last + 1]
    below = back[back[:, 0].argmin() : back[:, 0].argmax() + 1]
    if first:  # on piers, whose tops carry fill too, from left to right
        tops = []
        for outline in (arch.outlines[first - 1], arch.outlines[last]):
            high = outline[outline[:, 1] > outline[:, 1].max() - 1e-9 * np.ptp(outline)]
            tops.append(high[high[:, 0].argsort()])
        left, right = tops
        left = left[left[:, 0] < below[0, 0]]
        right = right[right[:, 0] > below[-1, 0]]
        below = np.concatenate([left, below, right])
    top = np.concatenate(arch.outlines[first:last])[:, 1].max()
    level = top + fill["height_over_crown"]
    middle = 0.5 * (arch.intrados + arch.extrados)[[first, last], 1].min()
    levels = [level, min(level, middle + fill["backing_height"])]
    outlines = []
    for top in levels[: 1 + (fill["backing_height"] > 0.0)]:
        line = np.column_stack([below[:, 0], np.minimum(below[:, 1], top)])
        outlines.append(np.concatenate([line, [[line[-1, 0], top], [line[0, 0], top]]]))
    return outlines
