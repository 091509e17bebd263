"""What a drawing of an arch shows: marks, each with its role and the bodies that carry it.

`archfrag.plots` paints them by matplotlib, `archfrag.report.arch_figure` as SVG.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from archfrag.arch.bridge import fill_weighs
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import rotated
from archfrag.arch.ring import Part
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
    for joint, _ in arch.bases.values():
        inner = arch.intrados[joint]
        outer = arch.extrados[joint]
        reach = _OVERHANG * size * (outer - inner) / np.linalg.norm(outer - inner)
        marks.append(Mark("ground", np.array([inner - reach, outer + reach])))
    return marks


def mechanism_marks(
    arch: Shape, hinges: Sequence[tuple[int, str]], sliding: Sequence[int]
) -> list[Mark]:
    """Return a mark for the face of each sliding joint and for the point of each hinge.

    `hinges` are pairs of joint and side, as of `Arch.corner_name`.
    """
    faces = np.stack([arch.intrados, arch.extrados], axis=1)
    marks = [Mark("sliding", faces[joint]) for joint in sliding]
    return marks + [Mark("hinge", point[None]) for point in hinge_points(arch, hinges)]


def hinge_points(
    arch: Shape, hinges: Sequence[tuple[int, str]]
) -> Iterator[FloatArray]:
    """Return where hinges are (2,) [m]; `hinges` are pairs of joint and side."""
    sides = {"intrados": arch.intrados, "extrados": arch.extrados}
    sides |= {"right": arch.intrados, "left": arch.extrados}
    return (sides[side][joint] for joint, side in hinges)


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
    fill = arch.parameters.get("fill")
    if not fill or not fill_weighs(fill):
        return []
    lines = [_upper_line(arch, part) for part in arch.parts]
    for i, part in enumerate(arch.parts):
        if "pier" in part.name:  # a ring that bulges over its top hides a part of it
            x = lines[i][:, 0]
            least = max((line[-1, 0] for line in lines[:i][-1:]), default=-np.inf)
            most = min((line[0, 0] for line in lines[i + 1 : i + 2]), default=np.inf)
            lines[i] = lines[i][(x >= least) & (x <= most)]
    below = np.concatenate(lines)
    below = below[[True, *(np.diff(below, axis=0) != 0.0).any(axis=1)]]
    rings = [body for span in arch.spans for body in span.bodies]
    top = np.concatenate([arch.outlines[body] for body in rings])[:, 1].max()
    level = top + fill["height_over_crown"]
    ends = [span.joints[end] for span in arch.spans for end in (0, -1)]
    middle = 0.5 * (arch.intrados + arch.extrados)[ends, 1].min()
    levels = [level, min(level, middle + fill["backing_height"])]
    outlines = []
    for top in levels[: 1 + (fill["backing_height"] > 0.0)]:
        line = np.column_stack([below[:, 0], np.minimum(below[:, 1], top)])
        outlines.append(np.concatenate([line, [[line[-1, 0], top], [line[0, 0], top]]]))
    return outlines


def _upper_line(arch: Shape, part: Part) -> FloatArray:
    """Return the points of a part under fill, from left to right, (m, 2) [m]."""
    if "pier" not in part.name:
        back = arch.extrados[part.joints[0] : part.joints[-1] + 1]
        return back[back[:, 0].argmin() : back[:, 0].argmax() + 1]
    body = part.every[-1]
    surface = arch.whole.surfaces[body][:, :2]
    high = (arch.whole.outlines[body][:, None] == surface).all(axis=2).any(axis=1)
    line = arch.outlines[body][high]
    return line[line[:, 0].argsort()]
