"""Faces, gaps and contacts of displaced bodies."""

import numpy as np
import pytest

import archfrag as af
from archbench.paper import arch as paper
from archfrag.physics.contact import placing
from archfrag.physics.state import model_of, new_work
from tests.physics.linkages import rotate

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 5, 0.7, sector=False)
MODEL = model_of(ARCH.chain)
AT_REST = np.column_stack([MODEL.centroid, np.zeros(ARCH.n_voussoir + 2)])


def placed(position):
    """Workspace with the faces and contacts of bodies at (n_voussoir + 2, 3)."""
    work = new_work(MODEL)
    placing.move_faces(MODEL, position, work)
    placing.place_contacts(MODEL, np.zeros(ARCH.n_joint), work)
    return work


def test_faces_meet_at_rest_where_the_outline_gives_and_rotate_with_their_body():
    face = placed(AT_REST).face
    assert face[:, 0] == pytest.approx(face[:, 1], abs=1e-12)
    assert face[:, 0, 0] == pytest.approx(ARCH.intrados, abs=1e-12)
    assert face[:, 0, 1] == pytest.approx(ARCH.extrados, abs=1e-12)
    assert MODEL.length == pytest.approx(np.full(6, 1.5))
    position = AT_REST.copy()
    position[3] += [0.1, -0.2, 0.3]
    work = placed(position)
    arm = rotate(ARCH.intrados[2] - ARCH.chain.centroid[2], 0.3)
    assert work.face[2, 1, 0] == pytest.approx(position[3, :2] + arm)
    along = work.face[2, 1, 1] - work.face[2, 1, 0]
    assert work.tangent[2, 1] == pytest.approx(along / np.linalg.norm(along))


@pytest.mark.parametrize("corner", [0, 1])
def test_gap_is_measured_along_the_normal_and_slip_along_the_face(corner):
    work = placed(AT_REST)
    tangent = work.tangent[3, 0]
    away = 0.02 * np.array([tangent[1], -tangent[0]]) + 0.05 * tangent
    work.face[3, 1] += away
    assert placing.clearance(3, corner, work) == pytest.approx(0.02)
    assert placing.corner_slip(3, tuple(away), corner == 0, work) == pytest.approx(0.05)
    # Where a slipped contact holds there is no offset.
    work.face[3, 1] -= away + 0.05 * tangent
    offset = placing.corner_offset(3, corner, work, -0.05)
    assert offset == pytest.approx((0.0, 0.0))


def test_both_laws_have_one_normal_at_a_closed_joint_and_two_at_an_open_one():
    position = AT_REST.copy()
    pivot = ARCH.extrados[0]
    position[1] = *(pivot + rotate(ARCH.chain.centroid[0] - pivot, -0.1)), -0.1
    work = placed(position)
    plus = work.side_normal[:, :, 0]
    minus = work.side_normal[:, :, 1]
    assert plus[4] == pytest.approx(minus[4])
    assert np.arccos(plus[0, 1] @ minus[0, 1]) == pytest.approx(0.1)
    assert work.point[0, 1] == pytest.approx(pivot)
    middle = plus[0, 1] + minus[0, 1]
    assert work.normal[0] == pytest.approx(middle / np.linalg.norm(middle))
    # From the ground into the first voussoir: upwards at the left springing.
    assert work.normal[0, 1] > 0.0


def test_gaps_and_relative_velocities_are_those_of_the_paper():
    """Eqs 22 and 23: at a corner that has not slipped the larger gap counts, else one of them."""
    rng = np.random.default_rng(5)
    shape = (ARCH.n_voussoir, 3)
    for _ in range(20):
        position = AT_REST.copy()
        velocity = 0.0 * AT_REST
        position[1:-1] += 0.03 * rng.normal(size=shape)
        velocity[1:-1] = rng.normal(size=shape)
        work = placed(position)
        placing.relative_velocity(MODEL, position, velocity, work.pivot, work.relative)
        for j in range(ARCH.n_joint):
            bodies = [(position[i, :2], velocity[i]) for i in (j, j + 1)]
            assert work.relative[j, :2] == pytest.approx(
                paper.relative_velocity(work.pivot[j], *bodies)
            )
            for corner in (0, 1):
                found = placing.clearance(j, corner, work)
                assert np.abs(paper.gaps(*work.face[j], corner) - found).min() < 1e-12
