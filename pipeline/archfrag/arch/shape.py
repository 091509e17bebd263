"""Attributes of an arch: chain of bodies, ends of joints, outlines, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from archfrag.arch.building import Given
from archfrag.arch.checks import FloatArray
from archfrag.arch.ring import Part, Ring
from archfrag.files import Named
from archfrag.physics.interface import Chain, pairs_of


@dataclass(frozen=True, eq=False, repr=False)
class Shape:
    """Attributes of an `Arch`, and what follows from them.

    `chain` has masses, inertias, centroids and joint faces for the kernels; if `flipped`, corner 0
    of its joints is the extrados. With a `free_end` the last voussoir touches no ground.
    `outlines` are those of the voussoirs, (m, 2) each, not closed [m]; `parameters` is what the
    user gave, for strict JSON. A bridge of several spans has its joints and bodies in the order of
    `Chain.body`.
    """

    chain: Chain
    intrados: FloatArray
    extrados: FloatArray
    outlines: tuple[FloatArray, ...]
    free_end: bool
    flipped: bool
    parameters: Named
    given: Given  # inputs it was built of, before recesses, springings and ties
    parts: tuple[Part, ...]  # spans and piers from left to right
    whole: Ring  # its geometry before recesses and springings
    depths: FloatArray  # of each body across the plane, (n_voussoir,) [m]
    built: Any = None  # the arch before a springing moved

    @property
    def n_voussoir(self) -> int:
        """Number of bodies."""
        return len(self.chain.mass)

    @property
    def n_joint(self) -> int:
        """Number of joints, those with the ground included."""
        return len(self.chain.friction)

    @property
    def centroids(self) -> FloatArray:
        """Centroids of the bodies at rest, (n_voussoir, 2) [m]."""
        start = self.chain.start
        return self.chain.centroid if start is None else start[:, :2]

    @property
    def extent(self) -> FloatArray:
        """Width and height of all voussoirs, (2,) [m]."""
        return np.ptp(np.concatenate(self.outlines), axis=0)

    @property
    def spans(self) -> tuple[Part, ...]:
        """Parts that are rings, from left to right."""
        return tuple(part for part in self.parts if "pier" not in part.name)

    @property
    def springings(self) -> tuple[int, int]:
        """First joint of the first ring and last joint of the last ring; skewbacks on piers."""
        return self.spans[0].joints[0], self.spans[-1].joints[-1] + self.free_end

    @property
    def pairs(self) -> NDArray:
        """Bodies before and after each joint, numbered as in `Chain.body`, (n_joint, 2)."""
        return pairs_of(self.n_joint, self.chain.body)

    @property
    def bases(self) -> dict[str, tuple[int, int]]:
        """Bases by name, "left", "pier 1", ..., "right": joint and side (0 before, 1 after)."""
        grounds = np.argwhere(
            (self.pairs < 0) | (self.pairs >= self.n_voussoir)
        ).tolist()
        order = sorted(grounds, key=lambda place: self.pairs[tuple(place)])
        inner = [f"pier {number}" for number in range(1, len(order) - 1)]
        names = ["left", *inner, "right"][: len(order)]
        return {name: (joint, side) for name, (joint, side) in zip(names, order)}

    @property
    def places(self) -> list[str]:
        """Names of all joints by number, as of `place`; empty if the arch is one ring alone."""
        return [*map(self.place, range(self.n_joint))] if self.parts[1:] else []

    def place(self, joint: int) -> str:
        """Return the name of a joint, such as "span 2, joint 5", "pier 1, base" or "joint 5"."""
        part = next(part for part in self.parts if joint in part.joints)
        number = part.joints.index(joint)
        name = "base" if "pier" in part.name and not number else f"joint {number}"
        return name if part.name == "arch" else f"{part.name}, {name}"

    def joint_numbers(self, most: int) -> Iterator[tuple[int, str]]:
        """Yield joints to be numbered in a drawing, about `most`, with numbers in their parts."""
        step = -(-self.n_joint // most)
        for part in self.parts:
            numbers = range(0, len(part.joints), step)
            yield from ((part.joints[i], str(i)) for i in numbers)

    @property
    def joint_depths(self) -> FloatArray:
        """Depth of each joint, that of the shallower of its bodies, (n_joint,) [m]."""
        grounds = np.full(len(self.bases), np.inf)
        return np.append(self.depths, grounds)[self.pairs].min(axis=1)

    @property
    def joints(self) -> Named:
        """Parameters of joints that deform, as given; empty if joints are rigid."""
        return self.parameters.get("joints") or {}

    def lines_of(self, part: Part) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the joints of a ring at intrados and extrados [m].

        If joints deform, their whole lengths count. With a free end the free face is the last.
        """
        lines = self.whole if self.joints else self
        rows = slice(part.joints[0], part.joints[-1] + 1 + self.free_end)
        return lines.intrados[rows], lines.extrados[rows]

    def dimensions_of(self, part: Part) -> tuple[float, float, float]:
        """Return clear span, rise at the joints' intrados and mean thickness of a ring [m]."""
        inner, outer = self.lines_of(part)
        ends = inner[[0, -1]]
        span = abs(ends[1, 0] - ends[0, 0])
        rise = inner[:, 1].max() - ends[:, 1].min()
        thickness = np.linalg.norm(outer - inner, axis=1).mean()
        return float(span), float(rise), float(thickness)

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Dimensions of the widest ring, as of `dimensions_of` [m]."""
        return max(map(self.dimensions_of, self.spans))

    @property
    def tie_bodies(self) -> NDArray[np.int64]:
        """Voussoirs at the ends of the ties, (n_tie, 2).

        The left springing counts as -1, the right one as n_voussoir.
        """
        ties = np.zeros((0, 2)) if self.chain.tie is None else self.chain.tie
        return ties[:, :2].astype(np.int64) - 1

    @property
    def tie_lines(self) -> FloatArray:
        """Ends of the ties at rest, (n_tie, 2, 2) [m]."""
        rows = np.zeros((0, 6)) if self.chain.tie is None else self.chain.tie
        lines = rows[:, 2:6].reshape(-1, 2, 2).copy()
        bodies = self.tie_bodies
        for end in map(tuple, np.argwhere((bodies >= 0) & (bodies < self.n_voussoir))):
            body = bodies[end]
            lines[end] = self.centroids[body] + lines[end] @ self.turn(body)
        return lines

    @property
    def rods(self) -> list[tuple[str, FloatArray, list[int]]]:
        """Ties as lines of a drawing: role, ends (2, 2) [m], bodies at the ends."""
        ends = zip(self.tie_lines, self.tie_bodies.tolist())
        return [("tie", line, bodies) for line, bodies in ends]

    @property
    def pulled(self) -> bool:
        """Whether the arch has ties."""
        return self.chain.tie is not None

    def turn(self, body: int) -> FloatArray:
        """Return the rotation matrix (2, 2) of a body at rest, whose rows are the body's axes."""
        start = self.chain.start
        angle = 0.0 if start is None else float(start[body, 2])
        sine = math.sin(angle)
        return np.array([[math.cos(angle), sine], [-sine, math.cos(angle)]])

    def changed(self, **fields) -> Self:
        """Return a copy of the arch with other attributes."""
        other = copy(self)
        vars(other).update(fields)
        return other
