"""A pier with its share of rings and fill, as a column that rocks across the bridge."""

from collections.abc import Iterator

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.arch.bridge import moments_of_fill
from archfrag.arch.building import Given, fields_of
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import square_height
from archfrag.arch.ring import straight_ring
from archfrag.arch.shape import Shape
from archfrag.errors import GeometryError
from archfrag.properties import LATER


def column_of(arch: Shape, name: str) -> Given:
    """Return what the column of a pier is built of, seen along the bridge; see `Arch.transverse`.

    Parts of the column have the moments of their masses m about height y, across depths d,

        M = sum m,   S = sum m y,   J = sum m (y² + k² + d²/12) - S²/M,

    where k is the radius of gyration of a part about the level axis through its centroid. Each
    body is as deep, along the bridge, as its mass asks for: a course by its mean width.
    `GeometryError` if the arch has no such pier, or has changed since it was built.
    """
    place = _place_of(arch, name)
    pier = arch.parts[place]
    near = [(part, -1) for part in arch.parts[:place][-1:]]
    near += [(part, 0) for part in arch.parts[place + 1 :][:1]]
    springings = [part.joints[end] for part, end in near]
    rings = [body for part, _ in near for body in part.bodies]
    density, mass, height, square = _bodies(arch, pier.every, rings)
    joints = [*pier.joints]
    lines = np.stack([arch.intrados, arch.extrados])
    top = np.concatenate([arch.outlines[body] for body in rings])[:, 1].max()
    top += arch.parameters.get("fill", {}).get("height_over_crown", 0.0)
    level = [*lines[:, joints, 1].mean(axis=0), lines[:, springings, 1].min(), top]
    depths = arch.joint_depths
    wide = arch.depths[rings].max()
    faces = np.array([*depths[joints], depths[springings].min(), wide])
    right = np.column_stack([0.5 * faces, level])
    ring = straight_ring(right, right * [-1.0, 1.0])
    sides = 0.5 * np.append(arch.depths[pier.every], wide)
    area = 2.0 * sides * np.diff(level)
    sections = [
        (own, np.array([0.0, y]), own * turned)
        for own, y, turned in zip(area, height, square)
    ]
    friction = arch.chain.friction
    return Given(
        "transverse",
        {"transverse": name},
        ring._replace(sections=sections, outlines=[*_boxes(sides, level)]),
        [*friction[joints], friction[springings].min()],
        True,
        density,
        mass / (density * area),
    )


def _place_of(arch: Shape, name: str) -> int:
    """Return the place of a pier in the parts; `GeometryError` if it cannot be a column."""
    later = sorted(set(LATER) & set(arch.parameters))
    if later:
        raise GeometryError(
            f"the arch has {', '.join(later)} already; transverse comes before"
        )
    names = [part.name for part in arch.parts]
    piers = [each for each in names if "pier" in each]
    if name not in piers:
        allowed = (
            f"it must be {' or '.join(piers)}" if piers else "the arch has no pier"
        )
        raise GeometryError(f"transverse = {name!r} is impossible; {allowed}")
    return names.index(name)


def _boxes(sides: FloatArray, level: list[float]) -> Iterator[FloatArray]:
    """Yield the outlines of bodies from their half widths and the levels between them [m]."""
    box = np.array([[1, 0], [1, 1], [-1, 1], [-1, 0]])
    for i, side in enumerate(sides):
        yield np.column_stack([box[:, 0] * side, np.take(level, i + box[:, 1])])


def _bodies(arch: Shape, pier: list[int], rings: list[int]) -> tuple[FloatArray, ...]:
    """Return density [kg/m3], mass [kg], height [m] and J/M [m2] of courses and share.

    `pier` and `rings` are the bodies of the pier and of the rings beside it.
    """
    given = arch.given._replace(fill=None)
    bare = fields_of(given)["chain"]
    spans = tuple(each._replace(dead_load=None) for each in given.spans)
    stone = fields_of(given._replace(dead_load=None, spans=spans))["chain"]
    turned = arch.depths**2 / 12.0

    def moments(mass: FloatArray, y: FloatArray, square: FloatArray) -> FloatArray:
        return np.column_stack([mass, mass * y, mass * (y**2 + square)])

    own = np.array([*map(square_height, arch.outlines)])
    masonry = moments(stone.mass, stone.centroid[:, 1], own + turned)
    masonry += moments(bare.mass - stone.mass, np.array(arch.whole.backs)[:, 1], turned)
    earth = np.zeros_like(masonry)
    if "fill" in arch.parameters:
        fill = moments_of_fill(arch.whole, arch.parameters["fill"])
        earth = fill[:, [0, 2, 3]] * (arch.depths / STANDARD_GRAVITY)[:, None]
        earth[:, 2] += earth[:, 0] * turned
    share = 0.5 * (masonry + earth)[rings].sum(axis=0) + earth[pier].sum(axis=0)
    mass, first, second = np.vstack([masonry[pier], share]).T
    density = _densities(arch, stone.mass, pier, rings)
    return density, mass, first / mass, second / mass - (first / mass) ** 2


def _densities(arch: Shape, mass: FloatArray, pier, rings) -> FloatArray:
    """Return the densities of the courses of a pier and, last, of its rings together [kg/m3]."""
    volume = arch.depths * [area for area, *_ in arch.whole.sections]
    return np.append(mass[pier] / volume[pier], mass[rings].sum() / volume[rings].sum())
