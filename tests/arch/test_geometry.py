"""Area, centroid and polar second moment against references with no formula in common."""

import math

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from archfrag.arch.geometry import arc, middle_of, polygon_section, sector_section

ORIGIN = np.zeros(2)
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


class TestAnnularSector:
    @pytest.mark.parametrize("sector", SECTORS)
    def test_equals_quadrature(self, sector):
        centre = np.array([3.0, -2.0])
        area, centroid, polar = quadrature(centre, *sector)
        ours = sector_section(centre, *sector)
        assert ours.area == pytest.approx(area, rel=1e-12)
        np.testing.assert_allclose(ours.centroid, centroid, rtol=0, atol=1e-12 * sector[0])
        assert ours.polar == pytest.approx(polar, rel=1e-9)

    @pytest.mark.parametrize("sector", SECTORS[:3])
    def test_is_the_limit_of_fine_polygons(self, sector):
        radius, thickness, start, end = sector
        angle = np.linspace(start, end, 4001)
        across = np.column_stack([np.sin(angle), np.cos(angle)])
        outline = np.concatenate(
            [(radius - 0.5 * thickness) * across, (radius + 0.5 * thickness) * across[::-1]]
        )
        ours, fine = sector_section(ORIGIN, *sector), polygon_section(outline)
        assert ours.area == pytest.approx(fine.area, rel=2e-7)
        np.testing.assert_allclose(ours.centroid, fine.centroid, atol=1e-6 * radius)
        assert ours.polar == pytest.approx(fine.polar, rel=1e-6)

    def test_half_ring_by_hand(self):
        """Pappus: area pi R t, centroid (4/3 pi) (a³ - b³)/(a² - b²) above the centre."""
        outer, inner = 11.0, 9.0
        ours = sector_section(ORIGIN, 10.0, 2.0, -0.5 * math.pi, 0.5 * math.pi)
        height = 4.0 / (3.0 * math.pi) * (outer**3 - inner**3) / (outer**2 - inner**2)
        about_centre = 0.25 * math.pi * (outer**4 - inner**4)
        assert ours.area == pytest.approx(20.0 * math.pi, rel=1e-14)
        assert ours.centroid[1] == pytest.approx(height, rel=1e-14)
        assert ours.polar == pytest.approx(about_centre - ours.area * height**2, rel=1e-12)

    @pytest.mark.parametrize("sweep", [1e-3, 1e-5, 1e-7])
    def test_thin_sector_is_a_rectangle_without_cancellation(self, sweep):
        radius = 1.0
        length = radius * sweep
        ours = sector_section(ORIGIN, radius, length, 0.4, 0.4 + sweep)
        assert ours.polar == pytest.approx(length**4 / 6.0, rel=2 * sweep**2 + 1e-7)


class TestPolygon:
    def test_rectangle_anywhere_in_either_order(self):
        width, height = 0.3, 1.7
        corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
        tilt = np.array([[math.cos(0.7), math.sin(0.7)], [-math.sin(0.7), math.cos(0.7)]])
        middle = np.array([0.5 * width, 0.5 * height])
        for away in ([0.0, 0.0], [500.0, -300.0]):
            for order in (1, -1):
                ours = polygon_section((corners @ tilt + away)[::order])
                assert ours.area == pytest.approx(width * height, rel=1e-11)
                np.testing.assert_allclose(ours.centroid, middle @ tilt + away, atol=1e-11)
                polar = width * height * (width**2 + height**2) / 12.0
                assert ours.polar == pytest.approx(polar, rel=1e-11)

    def test_triangle_by_its_medians(self):
        """Polar second moment of a triangle: area (a² + b² + c²)/36, a formula of its sides."""
        corners = np.array([[0.2, 0.1], [2.3, 0.4], [0.9, 1.8]])
        squares = ((np.roll(corners, -1, axis=0) - corners) ** 2).sum()
        ours = polygon_section(corners)
        np.testing.assert_allclose(ours.centroid, corners.mean(axis=0), rtol=1e-14)
        assert ours.polar == pytest.approx(ours.area * squares / 36.0, rel=1e-13)

    def test_a_polygon_is_the_sum_of_its_parts(self):
        """Steiner's theorem over a concave L-shape put together from two rectangles."""
        ell = polygon_section(np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 4], [0, 4]], float))
        foot = polygon_section(np.array([[0, 0], [3, 0], [3, 1], [0, 1]], float))
        stem = polygon_section(np.array([[0, 1], [1, 1], [1, 4], [0, 4]], float))
        area = foot.area + stem.area
        centroid = (foot.area * foot.centroid + stem.area * stem.centroid) / area
        polar = sum(
            part.polar + part.area * ((part.centroid - centroid) ** 2).sum()
            for part in (foot, stem)
        )
        assert ell.area == pytest.approx(area, rel=1e-14)
        np.testing.assert_allclose(ell.centroid, centroid, rtol=1e-14)
        assert ell.polar == pytest.approx(polar, rel=1e-14)


class TestLines:
    def test_arc_keeps_its_radius_ends_and_spacing(self):
        centre = np.array([1.0, 2.0])
        points = arc(centre, 3.0, -0.4, 1.1)
        np.testing.assert_allclose(np.hypot(*(points - centre).T), 3.0, rtol=1e-14)
        np.testing.assert_allclose(
            points[0], centre + 3 * np.array([math.sin(-0.4), math.cos(0.4)])
        )
        np.testing.assert_allclose(
            points[-1], centre + 3 * np.array([math.sin(1.1), math.cos(1.1)])
        )
        assert np.hypot(*np.diff(points, axis=0).T).max() <= 3.0 * math.radians(1.0)

    def test_middle_of_a_line_is_half_its_length_along(self):
        np.testing.assert_allclose(middle_of(np.array([[0.0, 0.0], [4.0, 2.0]])), [2.0, 1.0])
        np.testing.assert_allclose(
            middle_of(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]])), [1, 1]
        )
