"""Sections and the static limit against references with no formula in common."""

import math

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.optimize import fsolve, minimize_scalar

import archfrag as af
from archfrag.arch.geometry import outline_section, polygon_section, sector_section
from archfrag.simulation.rest import static_limit

SECTORS = [
    (10.0, 1.5, -1.3744, -0.9817),
    (10.0, 1.5, -1.3744, 1.3744),
    (1.0, 1.9, 0.2, 1.5),
    (2.0, 0.5, -2.9, 2.9),
    (50.0, 0.3, 0.001, 0.0015),
]


def quadrature(centre, radius, thickness, start, end):
    """Area, centroid and polar moment by Gauss-Legendre points over radius and angle."""
    node, weight = leggauss(40)
    r = radius + 0.5 * thickness * node
    angle = 0.5 * (start + end) + 0.5 * (end - start) * node
    part = np.outer(weight * r, weight) * 0.25 * thickness * (end - start)
    x = centre[0] + np.outer(r, np.sin(angle))
    y = centre[1] + np.outer(r, np.cos(angle))
    area = part.sum()
    centroid = np.array([(part * x).sum(), (part * y).sum()]) / area
    polar = (part * ((x - centroid[0]) ** 2 + (y - centroid[1]) ** 2)).sum()
    return area, centroid, polar


@pytest.mark.parametrize("sector", SECTORS)
def test_annular_sector_equals_quadrature(sector):
    centre = np.array([3.0, -2.0])
    area, centroid, polar = quadrature(centre, *sector)
    found = sector_section(centre, *sector)
    assert found[0] == pytest.approx(area, rel=1e-12)
    np.testing.assert_allclose(found[1], centroid, rtol=0, atol=1e-12 * sector[0])
    assert found[2] == pytest.approx(polar, rel=1e-9)


@pytest.mark.parametrize("sweep", [1e-3, 1e-5, 1e-7])
def test_thin_sector_is_a_rectangle_without_cancellation(sweep):
    *_, polar = sector_section(np.zeros(2), 1.0, sweep, 0.4, 0.4 + sweep)
    assert polar == pytest.approx(sweep**4 / 6.0, rel=2 * sweep**2 + 1e-7)


@pytest.mark.parametrize("away", [[0.0, 0.0], [500.0, -300.0]])
@pytest.mark.parametrize("order", [1, -1])
def test_rectangle_anywhere_in_either_order(away, order):
    width = 0.3
    height = 1.7
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    tilt = np.array([[math.cos(0.7), math.sin(0.7)], [-math.sin(0.7), math.cos(0.7)]])
    found = polygon_section((corners @ tilt + away)[::order])
    assert found[0] == pytest.approx(width * height, rel=1e-11)
    np.testing.assert_allclose(found[1], corners.mean(axis=0) @ tilt + away, atol=1e-11)
    polar = width * height * (width**2 + height**2) / 12.0
    assert found[2] == pytest.approx(polar, rel=1e-11)


def test_half_a_disk():
    """Its centroid is 4 r/(3 pi) above its base; pi r^4/4 about the middle of the base."""
    section = outline_section(np.array([[-2.0, 0, 0], [2.0, 0, 1.0]]))
    away = 8.0 / (3 * math.pi)
    assert section[0] == pytest.approx(2.0 * math.pi, rel=1e-14)
    np.testing.assert_allclose(section[1], [0, away], atol=1e-14)
    assert section[2] == pytest.approx(math.pi * (4.0 - 2.0 * away**2), rel=1e-13)


def test_the_static_limit_is_where_the_potential_energy_of_the_linkage_is_largest():
    arch = af.Arch.circular(10.0, 1.5, 157.5, 12, friction=0.7)
    start = af.onset(arch)
    corner = {"intrados": arch.intrados, "extrados": arch.extrados}
    a, b, c, d = (corner[side][joint] @ [1, 1j] for joint, side in start.hinges)
    joints = [joint for joint, _ in start.hinges]
    centroid = arch.chain.centroid @ [1, 1j]

    def angles(first):
        def closing(two):
            bars = np.exp(1j * np.array([first, *two])) @ [b - a, c - b, d - c]
            return [(bars - d + a).real, (bars - d + a).imag]

        # The hinges of this arch rotate its middle bar in the opposite sense.
        return np.array([first, *fsolve(closing, [-first, first])])

    def energy(first):
        turn = np.exp(1j * angles(first))
        knees = [a, a + turn[0] * (b - a), d - turn[2] * (d - c)]
        return sum(
            arch.chain.mass[i] * (knee + factor * (centroid[i] - pivot)).imag
            for knee, pivot, factor, low, high in zip(
                knees, (a, b, c), turn, joints, joints[1:]
            )
            for i in range(low, high)
        )

    sense = 1.0 if energy(1e-4) > energy(-1e-4) else -1.0
    top = minimize_scalar(
        lambda x: -energy(sense * x),
        bounds=(0.0, 0.3),
        method="bounded",
        options={"xatol": 1e-9},
    )
    expected = np.abs(angles(sense * top.x)).max()
    assert static_limit(arch, start) == pytest.approx(expected, rel=1e-4)


def test_a_mechanism_that_slides_has_no_static_limit():
    block = af.Block(width=1.0, height=1.0, friction=0.2)
    assert np.isnan(static_limit(block, af.onset(block)))
