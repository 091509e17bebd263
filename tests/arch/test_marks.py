"""Shapes of drawings: what they are of, and that they move with their voussoirs."""

import numpy as np
import pytest
from matplotlib import pyplot

import archfrag as af
from tests.piers import on_piers

RING = af.Arch.segmental(8.0, 3.0, 0.6, 9, 0.6)
FILLED = on_piers(RING, 3.0, 1.5).filled(
    0.4, 18e3, backing_height=0.8, backing_unit_weight=2e4
)
BRIDGE = FILLED.tied(level=0.8, area=8e-4, prestress=2e4)


def test_fill_lies_between_the_extrados_and_its_surface():
    earth, backing = (s.points for s in BRIDGE.marks if s.role in ("earth", "backing"))
    stones = np.concatenate(BRIDGE.outlines)
    assert earth[:, 1].max() == pytest.approx(stones[:, 1].max() + 0.4)
    assert np.ptp(earth[:, 0]) == pytest.approx(np.ptp(stones[:, 0]))
    middle = 0.5 * (BRIDGE.intrados + BRIDGE.extrados)[list(BRIDGE.springings), 1].min()
    assert backing[:, 1].max() == pytest.approx(middle + 0.8)
    assert {mark.role for mark in RING.marks} == {"stone", "ground"}


def test_all_of_them_are_painted():
    ax = BRIDGE.plot()
    roles = [mark.role for mark in BRIDGE.marks]
    assert len(ax.lines) == roles.count("tie") + roles.count("ground") == 3
    assert len(ax.patches) == len(roles) - 3 == BRIDGE.n_voussoir + 2
    pyplot.close(ax.figure)


def test_points_turn_with_their_voussoirs_and_stay_in_the_frame():
    """In complex numbers, where a rotation is a product."""
    random = np.random.default_rng(1)
    place = BRIDGE.centroids + random.uniform(-0.5, 0.5, (4, BRIDGE.n_voussoir, 2))
    angle = random.uniform(-1.0, 1.0, place.shape[:2])
    place[-1, 0] += 1e3  # what flies off is out of the frame
    low, high = BRIDGE._frame(place, angle, 0.1)
    assert (
        high - low < 4.0 * np.ptp(np.concatenate(BRIDGE.outlines), axis=0).max()
    ).all()
    rest = place @ [1, 1j]
    centre = BRIDGE.centroids @ [1, 1j]
    for mark in BRIDGE.marks:
        moved = mark.moved(BRIDGE.centroids, place, angle)
        bodies = np.broadcast_to(mark.bodies, len(mark.points)).tolist()
        for k, (point, body) in enumerate(zip(mark.points @ [1, 1j], bodies)):
            expected = np.full(len(place), point)
            if 0 <= body < BRIDGE.n_voussoir:
                expected = rest[:, body] + (point - centre[body]) * np.exp(
                    1j * angle[:, body]
                )
                assert ((moved[:3, k] > low) & (moved[:3, k] < high)).all()
            np.testing.assert_allclose(moved[:, k] @ [1, 1j], expected, atol=1e-9)
