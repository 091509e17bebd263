"""Faces, gaps and contacts of displaced bodies."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.kinematics import (
    clearance,
    corner_offset,
    empty_contacts,
    joint_lengths,
    measure_slip,
    move_faces,
    place_contacts,
    vertex_on_earlier,
)

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 5, 0.7, sector=False)


def faces(position):
    before, after = np.zeros((2, ARCH.n_joint, 2, 2))
    move_faces(ARCH.chain, position, before, after)
    return before, after


def at_rest():
    position = np.zeros((ARCH.n_voussoir, 3))
    position[:, :2] = ARCH.chain.centroid
    return position


class TestFaces:
    def test_meet_at_rest_where_the_outline_says(self):
        before, after = faces(at_rest())
        assert before == pytest.approx(after, abs=1e-12)
        assert before[:, 0] == pytest.approx(ARCH.intrados, abs=1e-12)
        assert before[:, 1] == pytest.approx(ARCH.extrados, abs=1e-12)

    def test_turn_with_their_body_about_its_centroid(self):
        position = at_rest()
        position[2] += [0.1, -0.2, 0.3]
        _, after = faces(position)
        arm = ARCH.intrados[2] - ARCH.chain.centroid[2]
        c, s = np.cos(0.3), np.sin(0.3)
        expected = position[2, :2] + [c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]]
        assert after[2, 0] == pytest.approx(expected)

    def test_lengths(self):
        assert joint_lengths(ARCH.chain) == pytest.approx(np.full(6, 1.5))


class TestGaps:
    def test_gap_is_measured_along_the_normal_and_slip_along_the_face(self):
        before, after = faces(at_rest())
        face = before[3, 1] - before[3, 0]
        tangent = face / np.linalg.norm(face)
        normal = np.array([tangent[1], -tangent[0]])
        after[3] += 0.02 * normal + 0.05 * tangent
        for corner in (0, 1):
            assert clearance(3, corner, before, after) == pytest.approx(0.02)
            assert measure_slip(3, corner, before, after) == pytest.approx(0.05)

    def test_offset_from_a_slipped_contact_is_none_where_it_holds(self):
        before, after = faces(at_rest())
        face = before[3, 1] - before[3, 0]
        tangent = face / np.linalg.norm(face)
        after[3] -= 0.05 * tangent
        slip = np.zeros(ARCH.n_joint)
        slip[3] = -0.05
        for corner in (0, 1):
            assert corner_offset(3, corner, before, after, slip) == pytest.approx((0.0, 0.0))

    def test_vertex_and_face_change_roles_with_slip_and_corner(self):
        assert vertex_on_earlier(0, 0.1)
        assert not vertex_on_earlier(0, -0.1)
        assert not vertex_on_earlier(1, 0.1)
        assert vertex_on_earlier(1, -0.1)


class TestContacts:
    def test_both_laws_have_one_normal_at_a_closed_joint_and_two_at_an_open_one(self):
        position = at_rest()
        pivot = ARCH.extrados[0]
        turn = -0.1
        arm = ARCH.chain.centroid[0] - pivot
        c, s = np.cos(turn), np.sin(turn)
        position[0] = [
            pivot[0] + c * arm[0] - s * arm[1], pivot[1] + s * arm[0] + c * arm[1], turn
        ]  # fmt: skip
        before, after = faces(position)
        contacts = empty_contacts(ARCH.n_voussoir, ARCH.n_joint)
        place_contacts(
            position, before, after, np.zeros(ARCH.n_joint), joint_lengths(ARCH.chain), contacts
        )
        plus, minus = contacts.normal_plus, contacts.normal_minus
        assert plus[4] == pytest.approx(minus[4])
        angle = np.arccos(plus[0, 1] @ minus[0, 1])
        assert angle == pytest.approx(0.1)
        assert contacts.point[0, 1] == pytest.approx(pivot)
        middle = plus[0, 1] + minus[0, 1]
        assert contacts.normal[0] == pytest.approx(middle / np.linalg.norm(middle))
        # From the ground into the first voussoir: upwards at the left springing.
        assert contacts.normal[0, 1] > 0.0
