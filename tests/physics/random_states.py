"""Random states of arches for the contact problem: resting, hinged, sliding, at impact."""

import numpy as np

from tests.mechanics.adapters import CLOSED, Mode, Problem

KINDS = ("resting", "hinged", "sliding", "impact")


def rotated(vector, angle):
    """`vector` rotated by `angle` [rad] counter-clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def polygon_properties(points, density):
    """Mass, polar inertia about the centroid, centroid of a polygon of unit depth."""
    x, y = points.T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    c = x * y1 - x1 * y
    area = c.sum() / 2
    centroid = np.array([((x + x1) * c).sum(), ((y + y1) * c).sum()]) / (6 * area)
    polar = ((x * x + x * x1 + x1 * x1 + y * y + y * y1 + y1 * y1) * c).sum() / 12
    inertia = polar - area * (centroid**2).sum()
    return density * abs(area), density * abs(inertia), centroid


def arch_blocks(rng, n):
    """Corner points at rest of n straight-sided voussoirs of a random circular ring."""
    radius = 10.0
    thickness = radius * rng.uniform(0.08, 0.3)
    embrace = np.deg2rad(rng.uniform(60, 180))
    cuts = np.sort(rng.uniform(0.3, 1.0, n).cumsum())
    angles = np.pi / 2 + embrace / 2 - embrace * np.concatenate([[0], cuts / cuts[-1]])
    direction = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return (radius - thickness / 2) * direction, (radius + thickness / 2) * direction


def random_state(rng, n, mu, kind):
    """One contact problem.

    Returns
    -------
    tests.mechanics.adapters.Problem
    """
    inner, outer = arch_blocks(rng, n)
    mass, inertia = np.empty(n), np.empty(n)
    centroid = np.empty((n, 2))
    local_first, local_last = np.empty((n, 2, 2)), np.empty((n, 2, 2))
    for i in range(n):
        corners = np.array([inner[i], outer[i], outer[i + 1], inner[i + 1]])
        mass[i], inertia[i], centroid[i] = polygon_properties(corners, 2000.0)
        local_first[i] = np.array([inner[i], outer[i]]) - centroid[i]
        local_last[i] = np.array([inner[i + 1], outer[i + 1]]) - centroid[i]

    joint = np.zeros(n + 1, int)  # 0 closed, 1 hinge at intrados, 2 hinge at extrados
    slipped = np.zeros(n + 1)
    if kind != "resting":
        joint = rng.choice(3, n + 1, p=[0.5, 0.25, 0.25])
    if kind == "sliding":
        slipped = np.where(rng.random(n + 1) < 0.3, rng.uniform(-0.05, 0.05, n + 1), 0.0)
    opening = np.where(joint > 0, 10 ** rng.uniform(-3, -0.7, n + 1), 0.0)

    angle = 0.0
    before = np.array([inner[0], outer[0]])
    position = np.empty((n, 2))
    point = np.empty((n + 1, 2, 2))
    normal = np.empty((n + 1, 2))
    plus, minus = np.empty((n + 1, 2, 2)), np.empty((n + 1, 2, 2))
    modes = []
    touching = np.ones((n + 1, 2), bool)
    for j in range(n + 1):
        tangent_before = (before[1] - before[0]) / np.linalg.norm(before[1] - before[0])
        step = angle + (0.0 if joint[j] == 0 else opening[j] * (1 if joint[j] == 2 else -1))
        rotate = step - angle
        tangent_after = rotated(tangent_before, rotate)
        normal_before = rotated(tangent_before, -np.pi / 2)
        normal_after = rotated(tangent_after, -np.pi / 2)
        corner = 1 if joint[j] == 2 else 0
        vertex = before[corner] + slipped[j] * tangent_before
        if j < n:
            first = np.array([rotated(p, step) for p in local_first[j]])
            position[j] = vertex - first[corner]
            after = position[j] + first
        else:
            length = np.linalg.norm(before[1] - before[0])
            after = np.array([vertex - corner * length * tangent_after] * 2)
            after[1] += length * tangent_after
        for c in range(2):
            on_before = slipped[j] >= 0 if c == 0 else slipped[j] <= 0
            point[j, c] = after[c] if on_before else before[c]
            if slipped[j] == 0.0:
                plus[j, c] = normal_after if c == 0 else normal_before
                minus[j, c] = normal_before if c == 0 else normal_after
            else:
                plus[j, c] = minus[j, c] = normal_before if on_before else normal_after
        mid = tangent_before + tangent_after
        normal[j] = rotated(mid / np.linalg.norm(mid), -np.pi / 2)
        if joint[j] == 0:
            modes.append(CLOSED)
        else:
            modes.append(Mode((corner,)))
            touching[j, 1 - corner] = False
        angle = step
        if j < n:
            before = position[j] + np.array([rotated(p, step) for p in local_last[j]])

    if kind == "impact":
        free = rng.normal(size=(n, 3)) * np.array([1.0, 1.0, 0.3]) * rng.uniform(0.01, 1)
    else:
        free = np.zeros((n, 3))
        free[:, 0] = rng.uniform(-1, 1) * 9.81
        free[:, 1] = -9.81 * (1 + rng.uniform(-0.3, 0.3))
    return Problem(
        mass, inertia, position, point, normal, plus, minus, touching, np.zeros(n + 1),
        np.zeros((n + 1, 2, 2)), np.full(n + 1, mu), free, modes,
    )  # fmt: skip
