"""Rest by the static theorem: a linear programme on the scene alone, beside `archfrag.onset`."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import OptimizeResult, bisect, linprog

from archbench.adapters.corners import Corners
from archbench.scene import Scene


def largest_load(scene: Scene, sense: float = 1.0) -> float:
    """Largest steady ground acceleration for which admissible reactions exist.

    A normal and a shear force at both ends of each joint, in balance with the weights and the
    inertia forces, within Coulomb's cone (Livesley 1978, *Int. J. Numer. Meth. Eng.* 12; with
    friction the bound is that of the static theorem).

    Examples
    --------
    >>> from archbench.scene import load_scene
    >>> from archbench.statics import largest_load
    >>> round(largest_load(load_scene("block_sine")), 9)
    0.2
    """
    found = _programme(scene, sense)
    if found.status == 3:
        return math.inf
    return float(found.x[-1]) if found.status == 0 else math.nan


def least_friction(scene: Scene, width: float = 1e-9) -> float:
    """Least Coulomb coefficient at which the scene's chain bears its own weight."""

    def missing(friction: float) -> float:
        chain = {**scene.chain, "friction": friction}
        return 0.5 - (_programme(replace(scene, chain=chain), 0.0).status == 0)

    return float(bisect(missing, 0.0, 10.0, xtol=width)) + width


def _programme(scene: Scene, sense: float) -> OptimizeResult:
    """Balance of each body; unknowns are normal and shear of each contact, and the load."""
    corners = Corners(scene)
    count = 2 * len(corners.joint)
    _, matrix = corners.linearise(np.zeros((corners.count, 3)))
    wrench = np.zeros((len(corners.joint), 2, 3 * corners.count + 3))
    np.put_along_axis(wrench, np.repeat(corners.columns[:, None], 2, axis=1), matrix, axis=2)
    weight = scene.bodies().mass / scene.bodies().mass.sum()
    inertia, balance = np.zeros((2, 3 * corners.count))
    inertia[::3], balance[1::3] = -sense * weight, weight
    cone = np.zeros((count, count + 1))
    normal = np.arange(0, count, 2)
    for row, sign in ((normal, 1.0), (normal + 1, -1.0)):
        cone[row, normal], cone[row, normal + 1] = -scene.friction, sign
    free = math.isinf(scene.friction)
    return linprog(
        np.append(np.zeros(count), -1.0 if sense else 0.0),
        None if free else cone,
        None if free else np.zeros(count),
        np.column_stack([wrench.reshape(count, -1).T[:-3], inertia]),
        balance,
        bounds=[*[(0, None), (None, None)] * (count // 2), (None, None)],
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
