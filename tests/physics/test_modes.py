"""Modes that a joint asks for, transition by transition, each derived by hand from the laws.

A rotation w of the later body opens corner 0 by h w and closes corner 1 by as much; normal forces
N0 and N1 have the moment h (N0 - N1) about the middle of the joint.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest

from archfrag.physics.contact.modes import ask_modes
from tests.physics.adapters import CLOSED, MINUS, OPEN, PLUS, Mode, modes_of, pose

HALF = 0.5  # half the length of a joint [m]
AXES = 0.3  # angle of the joints' axes to the frame's [rad]
CONE = math.atan(0.5)
STILL = NO_FORCE = (0.0, 0.0, 0.0)
ROUGH = {"friction": math.inf}
# Rotation of the later face of an open joint that touches at corner 0: clockwise, as it has
# opened corner 1. There slip PLUS, of the later body against the tangent, holds the earlier
# body's vertex along the later face, whose normal counts (Eq 23b); slip MINUS the later body's
# vertex along the earlier face (Eq 23a).
OPENED = 0.1
AT_VERTEX = {"lean": (-OPENED, 0.0), "touching": (True, False)}


class Joint(NamedTuple):
    """A joint in its own axes, normal and tangent, and what it does and bears in a mode."""

    mode: Mode
    motion: tuple  # at its middle, of the later body: normal, tangential [m/s], rotation [rad/s]
    force: tuple  # on the later body: normal, tangential [N], moment about the middle [N m]
    friction: float = 0.5
    sliding: int = 0  # sense of a slip in progress
    touching: tuple = (True, True)
    lean: tuple = (0.0, 0.0)  # angles of the normals for slip PLUS and MINUS [rad]


def in_frame(normal, tangential):
    c = np.cos(AXES)
    s = np.sin(AXES)
    return np.array([-s * tangential + c * normal, c * tangential + s * normal])


def proposed(joints, scale=1.0, force_scale=1.0, tolerance=1e-9):
    """Modes that joints ask for, and whether any asks for another."""
    m = len(joints)
    modes, motions, forces, friction, sliding, touching, leans = zip(*joints)
    model, _, work = pose(
        np.ones(m),
        np.ones(m),
        np.zeros((m, 2)),
        friction,
        modes,
        candidate=touching,
        known=sliding,
        normal=in_frame(1.0, 0.0),
    )
    for j, (motion, force, lean) in enumerate(zip(motions, forces, leans)):
        work.pivot[j] = 3.0, 2.0 + j
        for c in range(2):
            arm = in_frame(0.0, (2 * c - 1) * HALF)
            work.point[j, c] = work.pivot[j] + arm
            turn = motion[2] * np.array([-arm[1], arm[0]])
            work.corner_rate[j, c] = in_frame(*motion[:2]) + turn
        work.side_normal[j, :] = [
            in_frame(np.cos(angle), np.sin(angle)) for angle in lean
        ]
        work.reaction[j] = *in_frame(*force[:2]), force[2]
    changed = ask_modes(model, work, tolerance * scale, tolerance * force_scale)
    return modes_of(
        work._replace(contact=work.asked_contact, slide=work.asked_slide)
    ), changed


def asked(*arguments, **others):
    """Mode that one joint asks for; also that it counts as changed where it differs."""
    joint = Joint(*arguments, **others)
    (mode,), changed = proposed([joint])
    assert changed == (mode != joint.mode)
    return mode


def opening(first, second, sliding=0.0):
    """Motion of a joint whose corners open by `first` and `second` and which slides."""
    return 0.5 * (first + second), sliding, (first - second) / (2.0 * HALF)


def pressing(first, second, shear=0.0):
    """Reaction of a joint compressed by `first` and `second` at its corners."""
    return first + second, shear, HALF * (first - second)


def directed(angle, size=1.0):
    """Reaction at corner 0, at an angle to the normal of the earlier face."""
    return pressing(size * math.cos(angle), 0.0, size * math.sin(angle))


class TestOpenJoint:
    """Signorini (Eq 5): no reaction, so no corner may close; one that does not touch may."""

    @pytest.mark.parametrize(
        ("rates", "others", "mode"),
        [
            ((-1.0, 2.0), {}, Mode((0,))),
            ((2.0, -1.0), {}, Mode((1,))),
            ((-1.0, -2.0), {}, CLOSED),
            ((0.5, 2.0), {}, OPEN),
            ((-1.0, 2.0), {"touching": (False, True)}, OPEN),
            ((-1.0, -2.0), {"touching": (False, True)}, Mode((1,))),
            # A slip in progress goes on, but for a joint without a friction limit.
            ((-1.0, 2.0), {"sliding": PLUS}, Mode((0,), PLUS)),
            ((-1.0, 2.0), {"sliding": MINUS}, Mode((0,), MINUS)),
            ((-1.0, -2.0), {"sliding": MINUS}, Mode((0, 1), MINUS)),
            ((-1.0, -2.0), {"sliding": PLUS} | ROUGH, CLOSED),
        ],
    )
    def test_corners_that_approach_touch(self, rates, others, mode):
        assert asked(OPEN, opening(*rates), NO_FORCE, **others) == mode


@pytest.mark.parametrize(
    ("slip", "force", "others", "mode"),
    [
        *(
            (slip, pressing(1.2, -0.2, 0.5 * slip), {}, Mode((0,), slip))
            for slip in (0, PLUS)
        ),
        *(
            (slip, pressing(-0.2, 1.2, 0.5 * slip), {}, Mode((1,), slip))
            for slip in (0, MINUS)
        ),
        (0, pressing(-0.2, -0.1), {}, OPEN),
        (0, pressing(1.2, -0.2, 0.6), {}, Mode((0,), PLUS)),  # tips and slides
        (0, pressing(0.7, 0.3, 80.0), ROUGH, CLOSED),
    ],
)
def test_a_closed_joint_leaves_the_corner_that_needs_tension(slip, force, others, mode):
    assert asked(Mode((0, 1), slip), STILL, force, **others) == mode


# Corners that bear, motion of the joint that they allow, and shares of a unit normal force.
BEARING = {
    "face": ((0, 1), (0.0, 0.0), (0.7, 0.3)),
    "corner 0": ((0,), (0.0, 1.0), (1.0, 0.0)),
    "corner 1": ((1,), (1.0, 0.0), (0.0, 1.0)),
}


@pytest.mark.parametrize(("corners", "rates", "force"), BEARING.values(), ids=BEARING)
class TestCoulomb:
    @pytest.mark.parametrize(
        ("shear", "slip"), [(0.49, 0), (-0.49, 0), (0.51, PLUS), (-0.51, MINUS)]
    )
    def test_sticks_inside_its_cone_and_slides_beyond_it(
        self, corners, rates, force, shear, slip
    ):
        """Coulomb (Eq 6): the shear force tends to the bound of its own sign."""
        found = asked(Mode(corners), opening(*rates), pressing(*force, shear))
        assert found == Mode(corners, slip)

    @pytest.mark.parametrize("sense", [PLUS, MINUS])
    def test_slides_on_against_its_friction_and_sticks_where_it_would_slide_with_it(
        self, corners, rates, force, sense
    ):
        """Eq 6: friction takes power; T times slip rate may not be positive."""
        sliding = Mode(corners, sense)
        bound = pressing(*force, 0.5 * sense)
        against, along = (opening(*rates, rate * sense) for rate in (-0.2, 0.2))
        assert asked(sliding, against, bound) == sliding
        assert asked(sliding, along, bound) == Mode(corners)
        assert asked(sliding, along, bound, sliding=sense) == sliding


class TestCorner:
    """A hinge at a corner whose other corner parts, or does not touch."""

    @pytest.mark.parametrize("slip", [0, PLUS, MINUS])
    def test_is_lost_in_tension_and_closes_where_the_other_corner_approaches(
        self, slip
    ):
        hinge = Mode((0,), slip)
        force = pressing(1.0, 0.0, 0.5 * slip)
        pulling = pressing(-1.0, 0.0, -0.5 * slip)
        assert asked(hinge, opening(0.0, 1.0), pulling) == OPEN
        assert asked(hinge, opening(0.0, -1.0), force) == Mode((0, 1), slip)
        assert asked(hinge, opening(0.0, -1.0), force, touching=(True, False)) == hinge

    def test_without_a_friction_limit_only_tension_ends_it(self):
        for normal, expected in ((0.01, Mode((0,))), (-0.01, OPEN)):
            force = pressing(normal, 0.0, 9.0)
            assert asked(Mode((0,)), opening(0.0, 1.0), force, **ROUGH) == expected
        force = pressing(0.0, 0.0, 1.0)
        assert asked(Mode((0,), PLUS), opening(0.0, -1.0), force, **ROUGH) == CLOSED


class TestVertexOnVertex:
    """Two laws at an open joint (Eqs 23a and 23b): of the earlier face and of the later one."""

    @pytest.mark.parametrize(
        ("angle", "slip"),
        [
            (CONE - 1.1 * OPENED, 0),
            (0.0, 0),
            (-CONE + 0.1 * OPENED, 0),  # in both cones
            (CONE - 0.5 * OPENED, PLUS),  # only that of the later face is left
            (-CONE - 0.5 * OPENED, MINUS),  # only that of the earlier face
        ],
    )
    def test_reaction_in_the_cones(self, angle, slip):
        assert asked(Mode((0,)), STILL, directed(angle), **AT_VERTEX) == Mode(
            (0,), slip
        )

    @pytest.mark.parametrize(("sense", "lean"), [(PLUS, -OPENED), (MINUS, 0.0)])
    def test_friction_lies_on_the_cone_of_the_face_that_is_slid_on(self, sense, lean):
        sliding = Mode((0,), sense)
        force = lean + sense * CONE
        # Along the face of that sense: the rate is opposite to its friction.
        along, back = (
            (way * math.sin(lean), -way * math.cos(lean), 0.0)
            for way in (sense, -sense)
        )
        assert asked(sliding, along, directed(force), **AT_VERTEX) == sliding
        assert asked(sliding, back, directed(force), **AT_VERTEX) == Mode((0,))
        assert asked(sliding, along, directed(force, -1.0), **AT_VERTEX) == OPEN


class TestManyJoints:
    fine = Joint(CLOSED, STILL, pressing(1.0, 1.0))
    sliding = Joint(CLOSED, STILL, pressing(1.0, 1.0, 1.2))
    tipping = Joint(CLOSED, STILL, pressing(1.0, -0.7))
    landing = Joint(OPEN, opening(-0.3, 1.0), NO_FORCE)

    def test_every_joint_asks_for_its_own(self):
        modes, changed = proposed([self.sliding, self.fine, self.tipping, self.landing])
        assert modes == [Mode((0, 1), PLUS), CLOSED, Mode((0,)), Mode((0,))]
        assert changed
        assert proposed([self.fine, self.fine]) == ([CLOSED, CLOSED], False)

    def test_rounding_breaks_no_law_of_motion_or_force(self):
        joints = [self.sliding, self.landing]
        assert proposed(joints, tolerance=0.25) == ([CLOSED, Mode((0,))], True)
        assert proposed(joints, tolerance=0.4) == ([CLOSED, OPEN], False)
        assert proposed(joints, scale=10.0, tolerance=0.1) == (
            [Mode((0, 1), PLUS), OPEN],
            True,
        )
        assert proposed(joints, force_scale=10.0, tolerance=0.1) == (
            [CLOSED, Mode((0,))],
            True,
        )
