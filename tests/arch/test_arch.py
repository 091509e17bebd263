"""Arches, columns and blocks: masses, frames, symmetry, centre lines."""

import json
import math
import pickle
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from archfrag.arch import STANDARD_GRAVITY, Arch, Block
from tests.validation.scenes import column

MAKERS = {
    "sector": lambda n, **more: Arch.circular(10.0, 1.5, 157.5, n, 0.7, **more),
    "straight": lambda n, **more: Arch.circular(
        10.0, 1.5, 157.5, n, 0.7, sector=False, **more
    ),
    "horseshoe": lambda n, **more: Arch.circular(5.0, 1.0, 250.0, n, 0.7, **more),
    "segmental": lambda n, **more: Arch.segmental(12.0, 2.5, 0.6, n, 0.5, **more),
    "pointed": lambda n, **more: Arch.pointed(8.0, 7.0, 0.5, n, 0.6, **more),
    "elliptic": lambda n, **more: Arch.elliptic(10.0, 3.0, 0.4, n, 0.6, **more),
    "tall ellipse": lambda n, **more: Arch.elliptic(6.0, 5.0, 0.4, n, 0.6, **more),
    "catenary": lambda n, **more: Arch.catenary(10.0, 7.0, 0.5, n, 0.6, **more),
}
RINGS = [(name, n) for name in MAKERS for n in (2, 3, 7, 12)]


def reversed_order(arch):
    """The same straight-sided ring, travelled from the other end."""
    return Arch.from_joints(arch.intrados[::-1], arch.extrados[::-1], 0.7)


def swapped_names(arch):
    """The same straight-sided ring with intrados and extrados exchanged."""
    return Arch.from_joints(arch.extrados, arch.intrados, 0.7)


STRAIGHT = MAKERS["straight"](7)
CHAINS = {
    **{f"{name} {n}": MAKERS[name](n) for name, n in RINGS},
    "column": column(),
    "block": Block(0.2, 1.0, 0.8),
    "reversed": reversed_order(STRAIGHT),
    "swapped": swapped_names(STRAIGHT),
}


@pytest.mark.parametrize("arch", CHAINS.values(), ids=CHAINS.keys())
def test_faces_of_a_joint_coincide_at_rest_in_arrays_that_kernels_take(arch):
    chain = arch.chain
    n = arch.n_voussoir
    joints = arch.n_joint
    assert joints == n + (0 if arch.free_end else 1)
    shapes = ((n,), (n,), (n, 2), (joints, 2, 2), (joints, 2, 2), (joints,))
    for array, shape in zip(chain[:6], shapes, strict=True):
        assert (array.shape, array.dtype) == (shape, np.float64)
        assert array.flags.c_contiguous
    for joint in range(joints):
        before = chain.face_before[joint] + (
            chain.centroid[joint - 1] if joint else 0.0
        )
        after = chain.face_after[joint] + (chain.centroid[joint] if joint < n else 0.0)
        ends = [getattr(arch, arch.corner_name(corner))[joint] for corner in (0, 1)]
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-12)
        np.testing.assert_allclose(after, ends, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "n"), RINGS)
def test_mirror_image_is_the_same_arch(name, n):
    arch = MAKERS[name](n)
    chain = arch.chain
    mirror = np.array([-1.0, 1.0])
    np.testing.assert_allclose(chain.mass, chain.mass[::-1], rtol=1e-14)
    np.testing.assert_allclose(chain.inertia, chain.inertia[::-1], rtol=1e-12)
    np.testing.assert_allclose(
        chain.centroid, chain.centroid[::-1] * mirror, atol=1e-13
    )
    np.testing.assert_allclose(
        chain.face_before, chain.face_after[::-1] * mirror, atol=1e-13
    )
    middle = 0.5 * (arch.intrados + arch.extrados)
    assert middle[0, 0] < 0.0 < middle[-1, 0]
    crown = int(np.argmax(middle[:, 1]))
    assert arch.extrados[crown, 1] > arch.intrados[crown, 1]
    assert arch.corner_name(0) == "intrados"


def test_joints_and_friction_of_each():
    joints = [0.0, 30.0, 67.5, 100.0, 157.5]
    friction = [0.5, math.inf, 0.7, 0.8, 0.9]
    arch = Arch.circular(10.0, 1.5, 157.5, 4, friction, joint_positions=joints)
    np.testing.assert_array_equal(arch.chain.friction, friction)
    assert arch.parameters["friction"] == [0.5, "inf", 0.7, 0.8, 0.9]
    from_left = np.degrees(np.arctan2(*arch.intrados.T)) + 78.75
    np.testing.assert_allclose(from_left, joints, atol=1e-12)


@pytest.mark.parametrize("sector", [True, False])
def test_segmental_is_the_circular_arch_of_the_same_circle(sector):
    span = 12.0
    rise = 2.5
    radius = (span**2 / 4.0 + rise**2) / (2.0 * rise)
    embrace = 2.0 * math.degrees(math.asin(0.5 * span / radius))
    ours = Arch.segmental(span, rise, 0.6, 9, 0.5, sector=sector)
    circle = Arch.circular(radius, 0.6, embrace, 9, 0.5, sector=sector)
    down = [0.0, radius - rise]
    np.testing.assert_allclose(
        ours.chain.centroid + down, circle.chain.centroid, atol=1e-12
    )
    np.testing.assert_allclose(ours.chain.inertia, circle.chain.inertia, rtol=1e-10)


def test_equilateral_pointed_arch():
    """Rise sqrt(3)/2 of the span: each arc has its centre at the other springing."""
    arch = Arch.pointed(8.0, 8.0 * math.sqrt(0.75), 0.6, 8, 0.7)
    for points, radius in ((arch.intrados, 7.7), (arch.extrados, 8.3)):
        np.testing.assert_allclose(
            np.hypot(*(points[:5] - [4.0, 0.0]).T), radius, rtol=1e-13
        )
        np.testing.assert_allclose(
            np.hypot(*(points[4:] - [-4.0, 0.0]).T), radius, rtol=1e-13
        )


def curve_of(name):
    """Height and slope of the centre lines, written down apart from the code under test."""
    if name == "catenary":
        c = brentq(lambda c: c * (math.cosh(5.0 / c) - 1) - 7, 0.1, 1e3)
        return lambda x: 7 - c * (math.cosh(x / c) - 1), lambda x: -math.sinh(x / c)
    a, b = (5.0, 3.0) if name == "elliptic" else (3.0, 5.0)

    def height(x):
        return b * math.sqrt(max(0.0, 1 - (x / a) ** 2))

    return height, lambda x: -((b / a) ** 2) * x / height(x)


@pytest.mark.parametrize("name", ["elliptic", "tall ellipse", "catenary"])
@pytest.mark.parametrize("n", [7, 12])
class TestCurvedCentreLines:
    def test_joints_stand_on_the_curve_and_across_it(self, name, n):
        arch = MAKERS[name](n)
        height, slope = curve_of(name)
        across = arch.extrados - arch.intrados
        middle = 0.5 * (arch.extrados + arch.intrados)
        np.testing.assert_allclose(
            np.hypot(*across.T), arch.parameters["thickness"], rtol=1e-13
        )
        for joint in range(1, n):
            assert middle[joint, 1] == pytest.approx(
                height(middle[joint, 0]), abs=1e-10
            )
            along = np.array([1.0, slope(middle[joint, 0])])
            assert abs(across[joint] @ along) < 1e-9 * np.hypot(*along)
        span = arch.parameters["span"]
        np.testing.assert_allclose(
            middle[[0, -1]], [[-span / 2, 0], [span / 2, 0]], atol=1e-12
        )
        length = [  # equally long voussoirs
            quad(lambda x: math.hypot(1.0, slope(x)), left, right, epsabs=1e-12)[0]
            for left, right in pairwise(middle[1:-1, 0])
        ]
        np.testing.assert_allclose(length, length[0], rtol=1e-9)


@pytest.mark.parametrize("other", [reversed_order, swapped_names])
def test_a_straight_arch_from_its_joints_is_the_same_flipping_swaps_the_corners(other):
    again = Arch.from_joints(
        STRAIGHT.intrados.tolist(), STRAIGHT.extrados.tolist(), 0.7
    )
    for ours, theirs in zip(again.chain, STRAIGHT.chain):
        np.testing.assert_array_equal(ours, theirs)
    flipped = other(STRAIGHT)
    order = -1 if other is reversed_order else 1
    assert flipped.flipped
    assert (flipped.corner_name(0), flipped.corner_name(1)) == ("extrados", "intrados")
    np.testing.assert_allclose(
        flipped.chain.inertia, STRAIGHT.chain.inertia[::order], rtol=1e-13
    )


def test_mass_and_inertia_of_a_block():
    block = Block(0.2, 1.0, 0.8, density=2500.0, depth=0.5)
    mass = 2500.0 * 0.5 * 0.2
    assert (block.n_voussoir, block.n_joint, block.free_end) == (1, 1, True)
    assert block.chain.mass[0] == pytest.approx(mass, rel=1e-15)
    assert block.chain.inertia[0] == pytest.approx(
        mass * (0.04 + 1.0) / 12.0, rel=1e-14
    )
    np.testing.assert_allclose(block.chain.face_after, [[[0.1, -0.5], [-0.1, -0.5]]])


def test_dead_load_is_a_point_mass_on_the_middle_of_the_back():
    """Against the body put together from two parts by Steiner's theorem."""
    weight = 5e3 * np.arange(7)
    bare = MAKERS["sector"](7).chain
    loaded = MAKERS["sector"](7, dead_load=weight).chain
    angle = np.radians(22.5 * (np.arange(7) - 3))
    back = 10.75 * np.column_stack([np.sin(angle), np.cos(angle)])
    point = weight / STANDARD_GRAVITY
    mass = bare.mass + point
    centroid = (bare.mass[:, None] * bare.centroid + point[:, None] * back) / mass[
        :, None
    ]
    to_body = ((bare.centroid - centroid) ** 2).sum(axis=1)
    to_point = ((back - centroid) ** 2).sum(axis=1)
    inertia = bare.inertia + bare.mass * to_body + point * to_point
    np.testing.assert_allclose(loaded.mass, mass, rtol=1e-14)
    np.testing.assert_allclose(loaded.centroid, centroid, atol=1e-12)
    np.testing.assert_allclose(loaded.inertia, inertia, rtol=1e-12)


@pytest.mark.parametrize(
    "profile", ["circular", "segmental", "pointed", "elliptic", "catenary"]
)
def test_parameters_as_strict_json_and_a_pickle_give_the_same_arch(profile):
    name = "sector" if profile == "circular" else profile
    arch = MAKERS[name](5, density=2100.0, depth=0.9, dead_load=[0, 1e3, 2e3, 1e3, 0])
    given = json.loads(json.dumps(arch.parameters, allow_nan=False))
    assert given.pop("profile") == profile
    for again in (getattr(Arch, profile)(**given), pickle.loads(pickle.dumps(arch))):
        for ours, theirs in zip(arch.chain, again.chain):
            np.testing.assert_array_equal(ours, theirs)
