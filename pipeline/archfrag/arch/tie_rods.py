"""Ties of an arch: where they end, and the row of numbers that kernels know them by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from archfrag.arch import checks
from archfrag.arch.shape import Shape
from archfrag.errors import GeometryError

End = tuple[int, float, float]  # voussoir, x and y [m]


def tie_row(
    arch: Shape,
    level: float | None,
    area: float,
    modulus: float,
    prestress: float,
    strength: float,
    rupture: float,
    ends: Sequence[End] | None,
) -> list[float]:
    """Return the row of ``Chain.tie`` of a tie; arguments are those of `Arch.tied`."""
    if (level is None) == (ends is None):
        raise GeometryError("a tie needs either its level or its ends")
    stiff = checks.number("area", area, "m2", closed=False)
    stiff *= checks.number("modulus", modulus, "N/m2", closed=False)
    for name, value, unit in (("strength", strength, "N"), ("rupture", rupture, "m")):
        if not value > 0.0:
            raise GeometryError(
                f"{name} = {value} is impossible; it must exceed 0 {unit}"
            )
    checks.number("prestress", prestress, "N", most=strength)
    both = _given(arch, ends) if level is None else _at_level(arch, float(level))
    points = np.array([end[1:] for end in both], dtype=float)
    length = float(np.hypot(*(points[1] - points[0])))
    if not length > checks.SMALLEST:
        raise GeometryError(f"the ends of the tie are {length:g} m apart")
    for (body, *_), point in zip(
        both, points
    ):  # in the frame of a body, or of the ground
        if 0 <= body < arch.n_voussoir:
            point[:] = _turn(arch, body) @ (point - arch.centroids[body])
    stiffness = stiff / length
    stretched = prestress / stiffness
    if not rupture > stretched:
        raise GeometryError(
            f"rupture = {rupture:g} m is impossible; the tie is {stretched:.4g} m longer at rest, "
            f"by its prestress of {prestress:g} N, and rupture must exceed that (it is an "
            "elongation in m, not a strain)"
        )
    bodies = [float(body + 1) for body, *_ in both]
    limits = [float(strength), float(rupture)]
    return [*bodies, *points.ravel().tolist(), stiffness, length - stretched, *limits]


def _at_level(arch: Shape, level: float) -> list[End]:
    """Return the outermost points of the voussoirs at a height, left and right."""
    found: list[End] = []
    for body, outline in enumerate(arch.outlines):
        for (x, y), (u, v) in zip(
            outline.tolist(), np.roll(outline, -1, axis=0).tolist()
        ):
            if (y - level) * (v - level) <= 0.0 and y != v:
                found.append((body, x + (level - y) / (v - y) * (u - x), level))
    left, right = (end(found, key=itemgetter(1), default=None) for end in (min, max))
    if left is None or right is None or left[0] == right[0]:
        height = np.concatenate(arch.outlines)[:, 1]
        reach = f"the arch lies between {height.min():.4g} and {height.max():.4g} m"
        rule = f"there must be a voussoir at either end, and {reach}"
        raise GeometryError(f"level = {level:g} m is impossible for a tie; {rule}")
    return [left, right]


def _given(arch: Shape, ends: Sequence[End] | None) -> list[End]:
    """Return the ends of a tie as they are given, checked."""
    both = [(int(body), float(x), float(y)) for body, x, y in ends or ()]
    bodies = [body for body, *_ in both]
    last = arch.n_voussoir - 1 + (not arch.free_end)
    fits = (
        len(both) == 2
        and bodies[0] != bodies[1]
        and -1 <= min(bodies) <= max(bodies) <= last
    )
    if not fits or not any(0 <= body < arch.n_voussoir for body in bodies):
        raise GeometryError(
            f"ends = {ends} is impossible for a tie; it must be two of (voussoir, x, y) with "
            f"different voussoirs from -1 (the left springing) to {last}, not both springings"
        )
    if not np.isfinite([end[1:] for end in both]).all():
        raise GeometryError(
            f"ends = {ends} is impossible for a tie; places must be finite"
        )
    return both


def _turn(arch: Shape, body: int) -> np.ndarray:
    """Return the rotation of a body at rest: its axes as rows, (2, 2)."""
    start = arch.chain.start
    angle = 0.0 if start is None else float(start[body, 2])
    return np.array(
        [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    )


def tie_name(arch: Shape, tie: int) -> str:
    """Name of a tie in messages: its place among the ties, and its level if it has one."""
    level = arch.parameters["ties"][tie].get("level")
    return f"tie {tie + 1}" + ("" if level is None else f" (level {level:g} m)")


def tie_lines(arch: Shape) -> np.ndarray:
    """Return the ends of the ties of an arch at rest, (n_tie, 2, 2) [m]."""
    rows = np.zeros((0, 6)) if arch.chain.tie is None else arch.chain.tie
    lines = rows[:, 2:6].reshape(-1, 2, 2).copy()
    for line, bodies in zip(lines, rows[:, :2].astype(int) - 1):
        for end, body in enumerate(bodies):
            if 0 <= body < arch.n_voussoir:
                line[end] = arch.centroids[body] + line[end] @ _turn(arch, body)
    return lines
