"""Masonry that crushes, and loads at which arches that slide start to move."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

import archfrag as af
from tests.piers import on_piers

GRAVITY = 9.80665


def semicircle(thickness, friction=math.inf, voussoirs=40):
    """Semicircular arch of radius 10 m."""
    return af.Arch.circular(
        10.0, thickness, 180.0, voussoirs=voussoirs, friction=friction
    )


def stands_by_programme(arch, strength):
    """Whether reactions exist whose compressed depths, N / (strength b), fit into the joints.

    Linear programme with tangents of the parabola |M| <= N t/2 - N²/(2 strength b).
    """
    weight = arch.chain.mass * GRAVITY
    centroid = arch.chain.centroid
    n_joint = arch.n_joint
    middle = 0.5 * (arch.intrados + arch.extrados)
    along = arch.extrados - arch.intrados
    thickness = np.hypot(*along.T)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / thickness[:, None]
    # Force on what lies behind each joint: (H, V - weights before it); unknowns H, V, M0.
    before = np.concatenate([[0.0], np.cumsum(weight)])
    moments = np.concatenate([[0.0], np.cumsum(weight * centroid[:, 0])])
    rows_n = np.column_stack([normal[:, 0], normal[:, 1], np.zeros(n_joint)])
    const_n = -normal[:, 1] * before
    # Moment of that force about the middle of the joint.
    rows_m = np.column_stack(
        [
            middle[:, 1] - middle[0, 1],
            middle[0, 0] - middle[:, 0],
            np.ones(n_joint),
        ]
    )
    const_m = -(moments - before * middle[:, 0])
    scale = weight.sum()
    a = [-rows_n]
    b = [const_n]
    for fraction in np.linspace(0.1, 1.0, 150):
        n0 = fraction * scale
        slope = 0.5 * thickness - n0 / strength
        level = 0.5 * n0**2 / strength
        for sense in (1.0, -1.0):
            a.append(sense * rows_m - slope[:, None] * rows_n)
            b.append(level - sense * const_m + slope * const_n)
    found = linprog(
        np.zeros(3),
        np.vstack(a),
        np.concatenate(b),
        bounds=[(None, None)] * 3,
        method="highs",
    )
    return found.status == 0


def least_thickness(stands):
    low = 0.8
    high = 3.0
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stands(middle) else (middle, high)
    return high


def crushes(thickness, strength):
    try:
        af.crushed(semicircle(thickness), strength)
    except af.errors.StabilityError:
        return False
    return True


# Very weak masonry: forces of the arch at rest differ from those that the programme chooses.
@pytest.mark.parametrize(("strength", "error"), [(1e6, 2e-3), (5e6, 1e-3)])
def test_limit_thickness_is_that_of_a_linear_programme(strength, error):
    expected = least_thickness(lambda t: stands_by_programme(semicircle(t), strength))
    found = least_thickness(lambda t: crushes(t, strength))
    assert (
        expected
        > 1.01 * least_thickness(lambda t: af.onset(semicircle(t)).stands) - 1e-3
    )
    assert found == pytest.approx(expected, rel=error)


def test_unlimited_strength_changes_nothing():
    arch = semicircle(2.0)
    assert af.crushed(arch, math.inf) is arch
    assert af.onset(af.crushed(arch, 1e12)).plus == pytest.approx(
        af.onset(arch).plus, rel=1e-4
    )


RING = {"span": 8.0, "rise": 3.0, "thickness": 0.6, "voussoirs": 9, "friction": 0.6}
PIERS = {"height": 5.0, "width": 1.8, "courses": [2, 1]}


@pytest.mark.parametrize(
    ("ring", "piers", "more"),
    [
        (1.0, [0.5, 2.0], {}),
        (4.0, 1.5, {"dead_load": 5e3}),
        ([1.0, 1.0, 1.0, 0.6, 0.6, 0.6, 1.0, 1.0, 0.8], None, {}),
        ([1.0, 1.0, 1.0, 0.6, 0.6, 0.6, 1.0, 1.0, 0.8], [0.7, 0.9], {}),
    ],
    ids=["other depths", "dead load", "depth list", "both"],
)
def test_joints_of_piers_lose_what_their_own_depth_makes_them(ring, piers, more):
    built = on_piers(
        af.Arch.segmental(**RING, depth=ring, **more), **PIERS, depth=piers
    )
    weak = af.crushed(built.recessed(0.01, 0.0), 2e6)
    ring = np.broadcast_to(ring, 9)
    left, right = ring[[0, -1]] if piers is None else np.broadcast_to(piers, 2)
    own = np.array([left, left, *ring, right])
    shallower = np.array([left, *np.minimum(own[1:], own[:-1]), right])
    # Forces on the joints by columns: one thrust, and the weights up to each of them.
    face = weak.extrados - weak.intrados
    normal = np.column_stack([face[:, 1], -face[:, 0]]) / np.hypot(*face.T)[:, None]
    before = normal[:, 1] * np.concatenate(
        [[0.0], np.cumsum(built.chain.mass * GRAVITY)]
    )
    found = af.onset(weak).normal
    forces = normal @ np.linalg.lstsq(normal, found + before, rcond=None)[0] - before
    assert found == pytest.approx(forces, rel=1e-9)
    for side, recess in (("intrados", 0.01), ("extrados", 0.0)):
        lost = np.hypot(*(getattr(weak, side) - getattr(built, side)).T) - recess
        assert lost == pytest.approx(0.5 * forces / (2e6 * shallower), abs=1e-8)


SLIDING = [
    (2.0, 0.42, 9),
    (2.0, 0.40, 13),
    (2.5, 0.42, 9),
    (2.2, 0.45, 11),
    (1.8, 0.41, 9),
    (2.4, 0.40, 15),
]


@pytest.mark.parametrize(("thickness", "friction", "voussoirs"), SLIDING)
def test_ramps_by_steps_and_by_events_start_an_arch_that_slides_alike(
    thickness, friction, voussoirs
):
    arch = semicircle(thickness, friction, voussoirs)
    start = af.onset(arch)
    assert start.sliding
    steps, events = (
        af.limit_load(arch, method=m) for m in ("time_stepping", "event_driven")
    )
    assert steps == pytest.approx(events, rel=3e-3)
    assert max(steps, events) < start.plus * (1.0 + 2e-3)
