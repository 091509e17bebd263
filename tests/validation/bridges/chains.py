"""Bridges of several spans as chains of bodies, and their onset by a linear programme.

Nothing here is of archfrag but the type `Chain`, and nothing of it is taken from `af.Bridge`.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import lil_array

from archfrag.physics.interface import Chain
from tests.validation.scenes import g

TIGHT = dict.fromkeys(
    ("primal_feasibility_tolerance", "dual_feasibility_tolerance"), 1e-10
)


class Pier(NamedTuple):
    """An inner pier, which tapers evenly from its base to the springings."""

    width: float  # at the springings, intrados to intrados [m]
    height: float  # of the springings above the base [m]
    courses: int = 4
    base_width: float | None = None  # [m]; None: as above
    density: float = 2000.0  # [kg/m3]


def arc(radius, thickness, voussoirs, embrace=180.0):
    """Return the joints of a ring, (n + 1, 2, 2): from left to right, intrados and extrados."""
    angle = math.radians(embrace) * np.linspace(-0.5, 0.5, voussoirs + 1)
    way = np.column_stack([np.sin(angle), np.cos(angle)])
    return np.stack([(radius + s * thickness / 2.0) * way for s in (-1.0, 1.0)], axis=1)


def place(rings, piers):
    """Move rings so that all spring at level 0, each flush with the faces of its piers."""
    widths = np.append([pier.width for pier in piers], 0.0)
    left = np.zeros(2)
    placed = []
    for ring, width in zip(rings, widths, strict=True):
        placed.append(ring - ring[0, 0] + left)
        left = placed[-1][-1, 0] + [width, 0.0]
    return placed


def beds_of(pier, left):
    """Return the level joints of a pier from its base up, (courses, 2, 2): right, then left end.

    `left` is where its left face springs [m].
    """
    part = np.arange(pier.courses)[:, None] / pier.courses
    base = pier.width if pier.base_width is None else pier.base_width
    half = 0.5 * (base + part * (pier.width - base))
    level = np.broadcast_to(left[1] - pier.height * (1.0 - part), part.shape)
    middle = left[0] + 0.5 * pier.width
    ends = [np.hstack([middle + sign * half, level]) for sign in (1.0, -1.0)]
    return np.stack(ends, axis=1)


def moments(outline):
    """Return area, centroid and polar second moment about it of a polygon, by its triangles."""
    one = outline - outline[0]
    two = np.roll(one, -1, axis=0)
    double = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    area = 0.5 * double.sum()
    centre = double @ (one + two) / (6.0 * area)
    square = (one**2 + one * two + two**2).sum(axis=1)
    polar = double @ square / 12.0 - area * centre @ centre
    return abs(area), outline[0] + centre, abs(polar)


def chain_of(rings, piers, friction=0.6, density=2000.0, depth=1.0):
    """Build the chain of a bridge, in the order of `Chain.body`.

    `rings` are joints as of `arc`, `piers` one fewer; `density` is that of the rings, a number or
    one of each, and `friction` a number or one of each joint.
    """
    rings = place(rings, piers)
    beds = [beds_of(pier, ring[-1, 0]) for pier, ring in zip(piers, rings)]
    sizes = [len(ring) - 1 for ring in rings]
    first = sum(pier.courses - 1 for pier in piers)
    n_body = first + sum(sizes) + len(piers)
    outlines = []
    matter = []
    body = []
    below = 0
    for k, (pier, lines) in enumerate(zip(piers, beds)):
        outlines += [np.array([*a, *b[::-1]]) for a, b in pairwise(lines)]
        matter += [pier.density] * (pier.courses - 1)
        top = first + sum(sizes[: k + 1]) + k
        own = range(below, below + pier.courses - 1)
        body += pairwise([n_body + k, *own, top])
        below += pier.courses - 1
    for k, (ring, heavy) in enumerate(
        zip(rings, np.broadcast_to(density, len(rings)), strict=True)
    ):
        outlines += [np.array([*a, *b[::-1]]) for a, b in pairwise(ring)]
        matter += [heavy] * sizes[k]
        if k < len(piers):
            after = rings[k + 1][0]
            outlines.append(np.array([*beds[k][-1][::-1], *after, *ring[-1, ::-1]]))
            matter.append(piers[k].density)
    body += pairwise([-1, *range(first, n_body), n_body + len(piers)])
    area, centroid, polar = map(np.array, zip(*map(moments, outlines)))
    scale = np.array(matter) * depth
    body = np.array(body)
    lines = np.concatenate([*beds, *rings])
    faces = [lines - origins(centroid, each)[:, None] for each in body.T]
    return Chain(
        mass=scale * area,
        inertia=scale * polar,
        centroid=centroid,
        face_before=faces[0],
        face_after=faces[1],
        friction=np.broadcast_to(float(friction), len(body)).copy()
        if np.ndim(friction) == 0
        else np.array(friction, float),
        gravity=g,
        body=body if piers else None,
    )


def bodies_of(chain):
    """Return the bodies before and after each joint, (n_joint, 2)."""
    j = np.arange(chain.friction.size)
    return np.column_stack([j - 1, j]) if chain.body is None else chain.body


def origins(centroid, body):
    """Return the centroids of numbered bodies, and the origin for every ground."""
    moves = (body >= 0) & (body < len(centroid))
    return np.where(moves[:, None], centroid[np.where(moves, body, 0)], 0.0)


def onset_by_programme(chain, sense=1.0):
    """Return the largest k for which joints can bear weights and `sense` k of them [1].

    Static theorem. The ground accelerates towards +x if `sense` is 1. Unknown are the normal
    forces at both ends of each joint, its shear, and k, over the weight of all.
    """
    n_body = chain.mass.size
    n_joint = chain.friction.size
    body = bodies_of(chain)
    faces = chain.face_before, chain.face_after
    part = chain.mass / chain.mass.sum()
    rows = lil_array((3 * n_body, 3 * n_joint + 1))
    cone = lil_array((2 * n_joint, 3 * n_joint + 1))
    for j in range(n_joint):
        for sign, face, i in zip((-1.0, 1.0), faces, body[j]):
            if not 0 <= i < n_body:
                continue
            along = face[j, 1] - face[j, 0]
            x, y = along / np.hypot(*along)
            forces = [(face[j, 0], y, -x), (face[j, 1], y, -x), (face[j, 0], x, y)]
            for k, (arm, fx, fy) in enumerate(forces):
                turn = arm[0] * fy - arm[1] * fx
                for c, value in enumerate((fx, fy, turn)):
                    rows[3 * i + c, 3 * j + k] = sign * value
        if np.isfinite(chain.friction[j]):
            for k, sign in enumerate((1.0, -1.0)):
                cone[2 * j + k, 3 * j : 3 * j + 2] = -chain.friction[j]
                cone[2 * j + k, 3 * j + 2] = sign
    load = np.zeros(3 * n_body)
    load[1::3] = part
    rows[::3, -1] = -sense * part[:, None]
    found = linprog(
        np.append(np.zeros(3 * n_joint), -1.0),
        A_ub=cone.tocsr(),
        b_ub=np.zeros(2 * n_joint),
        A_eq=rows.tocsr(),
        b_eq=load,
        bounds=[(0, None), (0, None), (None, None)] * n_joint + [(None, None)],
        method="highs-ds",
        options=TIGHT,
    )
    if found.status == 3:
        return math.inf
    return found.x[-1] if found.success else math.nan


def random_bridge(generator, spans=None):
    """Return rings, piers and densities of unequal spans, by default two to five."""
    spans = spans or generator.integers(2, 6)
    radius = generator.uniform(2.0, 6.0, spans)
    thickness = radius * generator.uniform(0.15, 0.25, spans)
    rings = [
        arc(*size, int(generator.integers(5, 13)), generator.uniform(120.0, 180.0))
        for size in zip(radius, thickness)
    ]
    piers = []
    for k in range(spans - 1):
        width = thickness[k : k + 2].sum() * generator.uniform(1.0, 1.4)
        height = radius[k] * generator.uniform(0.5, 2.5)
        base = width * generator.uniform(1.0, 1.3)
        density = generator.uniform(1500.0, 2500.0)
        piers.append(Pier(width, height, int(generator.integers(1, 6)), base, density))
    return {
        "rings": rings,
        "piers": piers,
        "density": generator.uniform(1500.0, 2500.0, spans),
    }
