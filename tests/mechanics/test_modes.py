"""Modes that a joint asks for, transition by transition, each derived by hand from the laws.

Axes of a joint: the normal points from the earlier body to the later one, the tangent is the
normal rotated by +90 degrees and runs from corner 0 to corner 1. A rotation w of the later body
opens corner 0 by h w and closes corner 1 by as much; normal forces N0 and N1 have the moment
h (N0 - N1) about the middle of the joint.
"""

import math

import numpy as np
import pytest

from archfrag.mechanics.contact.blocks import EXACT
from archfrag.mechanics.contact.modes import solve_contact, velocity_scale
from tests.mechanics.adapters import CLOSED, MINUS, OPEN, PLUS, Joint, Mode, posed, proposed
from tests.mechanics.random_states import KINDS, random_state

HALF = 0.5
STILL = (0.0, 0.0, 0.0)
NO_FORCE = (0.0, 0.0, 0.0)
FRICTION = 0.5
CONE = math.atan(FRICTION)
# Rotation of the later face of an open joint that touches at corner 0: clockwise, as it has
# opened corner 1. There slip PLUS, of the later body against the tangent, holds the earlier
# body's vertex along the later face, whose normal counts (Eq 23b); slip MINUS the later body's
# vertex along the earlier face (Eq 23a).
OPENED = 0.1
AT_VERTEX = {"lean": (-OPENED, 0.0), "touching": (True, False)}


def opening(first, second, sliding=0.0):
    """Motion of a joint whose corners open by `first` and `second` and which slides."""
    return 0.5 * (first + second), sliding, (first - second) / (2.0 * HALF)


def pressing(first, second, shear=0.0):
    """Reaction of a joint compressed by `first` and `second` at its corners."""
    return first + second, shear, HALF * (first - second)


def at_corner(corner, normal, shear):
    """Reaction of a joint that bears at one corner."""
    return pressing(*((normal, 0.0) if corner == 0 else (0.0, normal)), shear)


def directed(angle):
    """Unit reaction at corner 0, at an angle to the normal of the earlier face."""
    return at_corner(0, math.cos(angle), math.sin(angle))


def asked(*arguments, **others):
    """Mode that one joint asks for; also that it counts as changed where it differs."""
    joint = Joint(*arguments, **others)
    (mode,), changed = proposed([joint])
    assert changed == (mode != joint.mode)
    return mode


class TestOpenJoint:
    """Signorini (Eq 5): no reaction, so no corner may close."""

    @pytest.mark.parametrize(
        ("rates", "mode"),
        [((-1.0, 2.0), Mode((0,))), ((2.0, -1.0), Mode((1,))), ((-1.0, -2.0), CLOSED),
         ((0.5, 2.0), OPEN)],
    )  # fmt: skip
    def test_corners_that_approach_touch(self, rates, mode):
        assert asked(OPEN, opening(*rates), NO_FORCE) == mode

    def test_a_corner_that_does_not_touch_may_approach(self):
        here = {"touching": (False, True)}
        assert asked(OPEN, opening(-1.0, 2.0), NO_FORCE, **here) == OPEN
        assert asked(OPEN, opening(-1.0, -2.0), NO_FORCE, **here) == Mode((1,))

    @pytest.mark.parametrize("sense", [PLUS, MINUS])
    def test_a_slip_in_progress_goes_on(self, sense):
        compiling = {"sliding": sense}
        assert asked(OPEN, opening(-1.0, 2.0), NO_FORCE, **compiling) == Mode((0,), sense)
        assert asked(OPEN, opening(-1.0, -2.0), NO_FORCE, **compiling) == Mode((0, 1), sense)

    def test_a_face_without_friction_limit_sticks_where_it_closes(self):
        mode = asked(OPEN, opening(-1.0, -2.0), NO_FORCE, friction=math.inf, sliding=PLUS)
        assert mode == CLOSED


class TestClosedJoint:
    @pytest.mark.parametrize("slip", [0, PLUS, MINUS])
    def test_the_corner_that_needs_tension_is_left(self, slip):
        """Signorini (Eq 5): both normal forces are compressive; a contact that is in tension
        opens."""
        shear = 0.5 * slip
        assert asked(Mode((0, 1), slip), STILL, pressing(1.2, -0.2, shear)) == Mode((0,), slip)
        assert asked(Mode((0, 1), slip), STILL, pressing(-0.2, 1.2, shear)) == Mode((1,), slip)

    def test_opens_tips_or_tips_and_slides(self):
        assert asked(CLOSED, STILL, pressing(-0.2, -0.1)) == OPEN
        assert asked(CLOSED, STILL, pressing(1.2, -0.2, 0.6)) == Mode((0,), PLUS)
        assert asked(CLOSED, STILL, pressing(0.7, 0.3, 80.0), friction=math.inf) == CLOSED


# Corners that bear, motion of the joint that they allow, and a reaction of unit normal force.
BEARING = {
    "face": ((0, 1), (0.0, 0.0), lambda shear: pressing(0.7, 0.3, shear)),
    "corner 0": ((0,), (0.0, 1.0), lambda shear: at_corner(0, 1.0, shear)),
    "corner 1": ((1,), (1.0, 0.0), lambda shear: at_corner(1, 1.0, shear)),
}


@pytest.mark.parametrize(("corners", "rates", "force"), BEARING.values(), ids=BEARING)
class TestCoulomb:
    @pytest.mark.parametrize(
        ("shear", "slip"), [(0.49, 0), (-0.49, 0), (0.51, PLUS), (-0.51, MINUS)]
    )
    def test_sticks_inside_its_cone_and_slides_beyond_it(self, corners, rates, force, shear, slip):
        """Coulomb (Eq 6): the shear force tends to the bound of its own sign."""
        assert asked(Mode(corners), opening(*rates), force(shear)) == Mode(corners, slip)

    @pytest.mark.parametrize("sense", [PLUS, MINUS])
    def test_slides_on_against_its_friction_and_sticks_where_it_would_slide_with_it(
        self, corners, rates, force, sense
    ):
        """Eq 6: friction takes power; T times slip rate may not be positive."""
        sliding, bound = Mode(corners, sense), force(0.5 * sense)
        against, along = (opening(*rates, rate * sense) for rate in (-0.2, 0.2))
        assert asked(sliding, against, bound) == sliding
        assert asked(sliding, along, bound) == Mode(corners)
        assert asked(sliding, along, bound, sliding=sense) == sliding


class TestCorner:
    """A hinge at a corner whose other corner parts, or does not touch."""

    @pytest.mark.parametrize("slip", [0, PLUS, MINUS])
    def test_is_lost_where_it_needs_tension(self, slip):
        pulling = at_corner(0, -1.0, -0.5 * slip)
        assert asked(Mode((0,), slip), opening(0.0, 1.0), pulling) == OPEN

    @pytest.mark.parametrize("slip", [0, PLUS, MINUS])
    def test_closes_where_the_other_corner_approaches(self, slip):
        motion, force = opening(0.0, -1.0), at_corner(0, 1.0, 0.5 * slip)
        assert asked(Mode((0,), slip), motion, force) == Mode((0, 1), slip)
        far = {"touching": (True, False)}
        assert asked(Mode((0,), slip), motion, force, **far) == Mode((0,), slip)

    def test_without_a_friction_limit_only_tension_ends_it(self):
        rough = {"friction": math.inf}
        motion = opening(0.0, 1.0)
        assert asked(Mode((0,)), motion, at_corner(0, 0.01, 9.0), **rough) == Mode((0,))
        assert asked(Mode((0,)), motion, at_corner(0, -0.01, 9.0), **rough) == OPEN
        sliding = Mode((0,), PLUS)
        closing = asked(sliding, opening(0.0, -1.0), at_corner(0, 0.0, 1.0), **rough)
        assert closing == CLOSED


class TestVertexOnVertex:
    """Two laws at an open joint (Eqs 23a and 23b): of the earlier face and of the later one."""

    @pytest.mark.parametrize(
        ("angle", "slip"),
        [
            (CONE - 1.1 * OPENED, 0), (0.0, 0), (-CONE + 0.1 * OPENED, 0),  # in both cones
            (CONE - 0.5 * OPENED, PLUS),  # only that of the later face is left
            (-CONE - 0.5 * OPENED, MINUS),  # only that of the earlier face
        ],
    )  # fmt: skip
    def test_reaction_in_the_cones(self, angle, slip):
        assert asked(Mode((0,)), STILL, directed(angle), **AT_VERTEX) == Mode((0,), slip)

    def test_parts_along_either_face(self):
        """Moving into one face is free where it leaves the other; into both it is not."""
        down = 0.5 * math.tan(OPENED)
        leaving, entering = (-down, -1.0, 0.0), (-down, 1.0, 0.0)
        assert asked(OPEN, leaving, NO_FORCE, **AT_VERTEX) == OPEN
        assert asked(OPEN, entering, NO_FORCE, **AT_VERTEX) == Mode((0,))

    @pytest.mark.parametrize(("sense", "lean"), [(PLUS, -OPENED), (MINUS, 0.0)])
    def test_friction_lies_on_the_cone_of_the_face_that_is_slid_on(self, sense, lean):
        sliding = Mode((0,), sense)
        pressing_on = directed(lean + sense * CONE)
        # Along the face of that sense: the rate is opposite to its friction.
        along = (math.sin(lean) * sense, -math.cos(lean) * sense, 0.0)
        back = (-along[0], -along[1], 0.0)
        assert asked(sliding, along, pressing_on, **AT_VERTEX) == sliding
        assert asked(sliding, back, pressing_on, **AT_VERTEX) == Mode((0,))
        pulling = tuple(-part for part in pressing_on)
        assert asked(sliding, along, pulling, **AT_VERTEX) == OPEN


class TestManyJoints:
    fine = Joint(CLOSED, STILL, pressing(1.0, 1.0))
    sliding = Joint(CLOSED, STILL, pressing(1.0, 1.0, 1.2))
    corner_rate = Joint(CLOSED, STILL, pressing(1.0, -0.7))
    landing = Joint(OPEN, opening(-0.3, 1.0), NO_FORCE)

    def test_every_joint_asks_for_its_own(self):
        joints = [self.sliding, self.fine, self.corner_rate, self.landing]
        modes, changed = proposed(joints)
        assert modes == [Mode((0, 1), PLUS), CLOSED, Mode((0,)), Mode((0,))]
        assert changed
        assert proposed([self.fine, self.fine]) == ([CLOSED, CLOSED], False)

    def test_rounding_breaks_no_law_of_motion_or_force(self):
        joints = [self.sliding, self.landing]
        assert proposed(joints, tolerance=0.25) == ([CLOSED, Mode((0,))], True)
        assert proposed(joints, tolerance=0.4) == ([CLOSED, OPEN], False)
        assert proposed(joints, scale=10.0, tolerance=0.1) == ([Mode((0, 1), PLUS), OPEN], True)
        assert proposed(joints, force_scale=10.0, tolerance=0.1) == ([CLOSED, Mode((0,))], True)


class TestVelocityScale:
    @pytest.mark.parametrize("kind", KINDS)
    def test_is_that_of_free_bodies_whatever_was_solved_before(self, kind):
        model, position, work = posed(random_state(np.random.default_rng(3), 12, 0.6, kind))
        before = velocity_scale(position, work)
        solve_contact(model, position, work, True, 0.0, -1.0, EXACT)
        assert velocity_scale(position, work) == before > 0.0
