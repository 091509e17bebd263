"""Motion of mega-voussoirs between two events as these tests call it: a step, and its events.

Names and layouts of the package stand here only.
"""

import numpy as np

from archfrag.mechanics.kinematics import joint_lengths
from archfrag.mechanics.ledger import new_ledger
from archfrag.mechanics.levels import new_few_bodies, view_few
from archfrag.mechanics.mechanism import assemble_mechanism, gather_state, new_mechanism
from archfrag.mechanics.status import Count, Energy
from archfrag.methods.events import (
    GAP,
    LAW,
    PASSING,
    SLIP_END,
    THRESHOLD,
    all_margins,
    closed_inside,
    keep_margins,
    locate,
    margin_at,
    may_have_closed,
    new_margins,
)
from archfrag.methods.few_bodies import (
    BY_FRICTION,
    BY_GROUND,
    dense_state,
    dense_work,
    evaluate,
    keep_stage,
    make_dense,
    new_few_room,
    take_step,
    view_motion,
)
from archfrag.methods.resolve import new_whole, resolve_impact
from tests.mechanics.adapters import decode_all, encode_all, problem_of, solution_of

KINDS = {LAW: "law", LAW + 1: "law", GAP: "gap", GAP + 1: "gap", SLIP_END: "slip", PASSING: "pass"}


class Moving:
    """A chain that moves in given modes; ground acceleration ``(x, its rate, y, its rate)``."""

    def __init__(self, chain, position, velocity, modes, ground):
        n, m = chain.mass.size, chain.friction.size
        self.chain, self.ground = chain, ground
        self.mechanism, self.margins = new_mechanism(n, m), new_margins(m)
        length = joint_lengths(chain)
        self.scales = 1.0 / (chain.gravity * chain.mass.sum()), np.sqrt(chain.gravity * length[0])
        counts = assemble_mechanism(chain, encode_all(modes), np.zeros(m), length, self.mechanism)
        bodies = view_few(new_few_bodies(n, m), *counts)
        gather_state(chain, self.mechanism, position, velocity, bodies.position, bodies.velocity)
        self.few = view_motion(self.mechanism, chain.gravity, bodies, new_few_room(n, m))
        self._begin()

    def _begin(self):
        few, (gx, _, gy, _) = self.few, self.ground
        assert evaluate(few, few.position, few.velocity, gx, gy)
        keep_stage(few, 0, few.velocity, gx, gy)
        self.least_at_start = self._margins(few.position, few.velocity, 0.0)
        keep_margins(few, self.margins)

    def _margins(self, position, velocity, later):
        gx, sx, gy, sy = self.ground
        return all_margins(
            self.chain, self.mechanism, self.few, position, velocity, gx + sx * later,
            gy + sy * later, *self.scales, self.margins,
        )  # fmt: skip

    def step(self, size):
        """Position, velocity of the mega-voussoirs after a step, and its error by itself [m]."""
        possible, error = take_step(self.few, size, *self.ground, 1.0, 1.0)
        assert possible
        make_dense(self.few, size)
        return self.few.new_position.copy(), self.few.new_velocity.copy(), error

    def inside(self, part):
        """Position and velocity at a part of the last step."""
        position, velocity = np.zeros((2, *self.few.position.shape))
        dense_state(self.few, part, position, velocity)
        return position, velocity

    def work(self, part):
        """Work of the ground and of friction up to a part of the last step [J]."""
        return dense_work(self.few, BY_GROUND, part), dense_work(self.few, BY_FRICTION, part)

    def go_on(self, size):
        """Take the end of the last step as the beginning of the next one."""
        gx, sx, gy, sy = self.ground
        self.ground = gx + sx * size, sx, gy + sy * size, sy
        self.few.position[:], self.few.velocity[:] = self.few.new_position, self.few.new_velocity
        self._begin()

    def first_event(self, size, most=1):
        """Time of the first event in so many steps of a given size, and what is used up then.

        Returns
        -------
        time : float
            inf where there is none.
        used : set of (kind, joint)
            Kinds "law", "gap", "slip" (its end), "inside" (a law inside a mega-voussoir).
        """
        for number in range(most):
            time, used = self._event_in_step(size)
            if used:
                return number * size + time, used
            self.go_on(size)
        return np.inf, set()

    def _event_in_step(self, size):
        self.step(size)
        few, margins = self.few, self.margins
        least, last = self._margins(few.new_position, few.new_velocity, size), 1.0
        if may_have_closed(few, margins, size):
            inside = closed_inside(few, True)
            if inside > 0.0:
                last = inside
                least = margin_at(
                    self.chain, self.mechanism, few, last, size, *self.ground, *self.scales,
                    margins,
                )  # fmt: skip
        if least >= -THRESHOLD:
            return np.inf, set()
        part = locate(
            self.chain, self.mechanism, few, size, last, *self.ground, *self.scales, margins
        )
        between, inner = margins.between[: few.joint.size], margins.inner
        used = {
            (KINDS[q], int(few.joint[k])) for k, q in np.argwhere(np.abs(between) < 10 * THRESHOLD)
        }
        used |= {("inside", int(j)) for j, _ in np.argwhere(np.abs(inner) < 10 * THRESHOLD)}
        return part * size, used


class Impact:
    """What an impact of a chain does: the problem that it is, its solution and its record."""

    def __init__(self, chain, position, velocity, modes, closes=(-1, -1)):
        n, m = chain.mass.size, chain.friction.size
        whole, ledger = new_whole(n, m, joint_lengths(chain)), new_ledger()
        whole.position[:], whole.velocity[:] = position, velocity
        mode = encode_all(modes)
        self.solved = resolve_impact(chain, whole, np.zeros(m), mode, *closes, ledger)
        work = whole.work
        self.problem = problem_of(
            (chain.mass, chain.inertia, whole.contacts, chain.friction, velocity, mode)
        )
        self.solution = solution_of(self.solved, work)
        self.velocity, self.modes = whole.velocity.copy(), decode_all(mode)
        self.energy = ledger.energy[Energy.IMPACT]
        self.joints_closed = int(ledger.count[Count.IMPACTS])
