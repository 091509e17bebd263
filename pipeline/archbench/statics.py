"""Rest by the static theorem: a linear programme on the scene alone, beside `archfrag.onset`."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array

from archbench.scene import STANDARD_GRAVITY, Scene

_LARGEST_FRICTION = 10.0


def largest_load(scene: Scene, sense: float = 1.0) -> float:
    """Largest steady ground acceleration for which admissible reactions exist.

    Two normal forces at the ends of each joint and one shear force, in balance with the weights
    and the inertia forces, within Coulomb's cone (Livesley 1978, *Int. J. Numer. Meth. Eng.* 12;
    with friction the bound is that of the static theorem).

    Examples
    --------
    >>> from archbench.scene import load_scene
    >>> from archbench.statics import largest_load
    >>> round(largest_load(load_scene("block_sine")), 9)
    0.2
    """
    found = _programme(scene, scene.friction, sense)
    if found.status == 3:
        return math.inf
    return float(found.x[-1]) if found.status == 0 else math.nan


def least_friction(scene: Scene, width: float = 1e-9) -> float:
    """Least Coulomb coefficient at which the scene's chain bears its own weight."""
    low, high = 0.0, _LARGEST_FRICTION
    if not _bears(scene, high):
        return math.nan
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _bears(scene, middle) else (middle, high)
    return high


def _bears(scene: Scene, friction: float) -> bool:
    return bool(_programme(scene, friction, 0.0).status == 0)


def _programme(scene: Scene, friction: float, sense: float):
    """Balance of each body; unknowns two pressures and a shear of each joint, and the load."""
    inner, outer = scene.joint_lines()
    bodies = scene.bodies()
    n_body = len(bodies.mass)
    n_joint = n_body if scene.free_end else n_body + 1
    weight = bodies.mass * STANDARD_GRAVITY / (bodies.mass.sum() * STANDARD_GRAVITY)
    rows, columns, entries = [], [], []

    def add(row, column, entry):
        rows.append(row)
        columns.append(column)
        entries.append(entry)

    for j in range(n_joint):
        along = (outer[j] - inner[j]) / np.hypot(*(outer[j] - inner[j]))
        normal = np.array([-along[1], along[0]])
        toward = bodies.centroid[j] - inner[j] if j < n_body else inner[j] - bodies.centroid[-1]
        if normal @ toward < 0.0:
            normal = -normal
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if not 0 <= body < n_body:
                continue
            for k, (place, force) in enumerate(
                ((inner[j], normal), (outer[j], normal), (inner[j], along))
            ):
                arm = place - bodies.centroid[body]
                add(3 * body, 3 * j + k, sign * force[0])
                add(3 * body + 1, 3 * j + k, sign * force[1])
                add(3 * body + 2, 3 * j + k, sign * (arm[0] * force[1] - arm[1] * force[0]))
    load = 3 * n_joint
    for body in range(n_body):
        add(3 * body, load, -sense * weight[body])
    balance = np.zeros(3 * n_body)
    balance[1::3] = weight
    equal = coo_array((entries, (rows, columns)), shape=(3 * n_body, load + 1)).tocsr()
    cone = np.zeros((2 * n_joint, load + 1))
    for j in range(n_joint):
        cone[2 * j : 2 * j + 2, 3 * j : 3 * j + 2] = -friction
        cone[2 * j : 2 * j + 2, 3 * j + 2] = [1.0, -1.0]
    free = math.isinf(friction)
    return linprog(
        np.append(np.zeros(load), -1.0 if sense else 0.0),
        None if free else cone,
        None if free else np.zeros(2 * n_joint),
        equal,
        balance,
        bounds=[*[(0, None), (0, None), (None, None)] * n_joint, (None, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
