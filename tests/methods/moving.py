"""Motion of mega-voussoirs between two events as these tests call it: a step, and its events.

Names and layouts of the package stand here only.
"""

import numpy as np

from archfrag.mechanics.contact.path import new_path
from archfrag.mechanics.ground import Segment, grounds_of
from archfrag.mechanics.mega_voussoirs.assemble import (
    assemble,
    gather_state,
    new_mega_voussoirs,
)
from archfrag.mechanics.mega_voussoirs.first_level import solve_first_level
from archfrag.mechanics.mega_voussoirs.second_level import GAP_0, GAP_1, SLIP_END
from archfrag.mechanics.model import model_of
from archfrag.mechanics.status import Count, Energy
from archfrag.mechanics.types import Options
from archfrag.methods.event_driven.events import (
    THRESHOLD,
    find_margins,
    keep_margins,
    new_motion,
)
from archfrag.methods.event_driven.front import new_run
from archfrag.methods.event_driven.integrate import check_laws
from archfrag.methods.event_driven.runge_kutta import (
    FIFTH_ORDER,
    dense_state,
    keep_stage,
    make_dense,
    take_step,
)
from archfrag.methods.event_driven.transitions import (
    pose_impact,
    solve_posed,
    take_impact,
)
from tests.mechanics.adapters import Problem, framed, modes_of, set_modes, solution_of, views_of


class Moving:
    """A chain that moves in given modes; ground acceleration ``(x, its rate, y, its rate)``."""

    def __init__(self, chain, position, velocity, modes, ground, scheme=FIFTH_ORDER):
        model = model_of(chain)
        n_joint = model.friction.size
        contact, slide = np.zeros((n_joint, 2)), np.zeros(n_joint)
        set_modes(modes, contact, slide)
        self.ground, mega = Segment(np.inf, *ground), new_mega_voussoirs(model)
        assemble(model, contact, slide, np.zeros(n_joint), mega)
        gather_state(model, framed(position), framed(velocity), mega)
        self.mega = views_of(mega)
        self.resolved = 1e-3 * model.gravity
        self.motion = new_motion(model, scheme, 1.0)._replace(acceleration=self.resolved)
        self._begin()

    def _begin(self):
        mega, x, y = self.mega, self.ground.x, self.ground.y
        assert solve_first_level(mega, mega.position, mega.velocity, x, y, self.resolved)
        keep_stage(mega, self.motion.stages, 0, mega.position, mega.velocity, x, y)
        find_margins(self.motion, mega, mega.position, mega.velocity, x, y)
        keep_margins(mega, self.motion)

    @property
    def state(self):
        """Position and velocity of the mega-voussoirs, (2, n, 3)."""
        return np.stack([self.mega.position[1:-1], self.mega.velocity[1:-1]])

    def step(self, size):
        """Position, velocity of the mega-voussoirs after a step, and its error by itself [m]."""
        error = take_step(
            self.mega, self.motion.stages, self.motion.scheme, size, self.ground, self.resolved,
            (1.0, 1.0),
        )  # fmt: skip
        assert np.isfinite(error)
        make_dense(self.mega, self.motion.stages, self.motion.scheme, size)
        return self.mega.next_position[1:-1].copy(), self.mega.next_velocity[1:-1].copy(), error

    def inside(self, part):
        """Position and velocity at a part of the last step."""
        position, velocity = np.zeros((2, *self.mega.position.shape))
        dense_state(self.motion.stages, part, position, velocity)
        return position[1:-1], velocity[1:-1]

    def go_on(self, size):
        """Take the end of the last step as the beginning of the next one."""
        end, x, slope_x, y, slope_y = self.ground
        self.ground = Segment(end, x + slope_x * size, slope_x, y + slope_y * size, slope_y)
        self.mega.position[:] = self.mega.next_position
        self.mega.velocity[:] = self.mega.next_velocity
        self._begin()

    def first_event(self, size):
        """Time of the first event in a step, and what is used up then, (kind, joint).

        The time is inf where there is none. Kinds are "law", "gap", "slip" (its end) and "inside"
        (a law inside a mega-voussoir).
        """
        self.step(size)
        part, event = check_laws(self.motion, self.mega, size, self.ground)
        return (part * size, self._used()) if event else (np.inf, set())

    def _used(self):
        between = set(self.mega.joint[: self.mega.count[1]].tolist())
        kinds = {GAP_0: "gap", GAP_1: "gap", SLIP_END: "slip"}
        gone = np.argwhere(np.abs(self.motion.value) < 10 * THRESHOLD)
        return {
            (kinds.get(int(law), "law") if int(j) in between else "inside", int(j))
            for j, law in gone
        }


OPTIONS = Options(1e-3, 1e-9, 1e-3, 0.0, 1000, 0.5, 10, 1.0, 0.0)


class Impact:
    """What an impact of a chain does: the problem that it is, its solution and its record."""

    def __init__(self, chain, position, velocity, modes, closes=(-1, -1)):
        still = grounds_of([(np.zeros(2), None, 1.0)])
        run = new_run(model_of(chain), still, OPTIONS, (np.nan, np.nan))
        state, work = run.state, run.work
        state.position[1:-1], state.velocity[1:-1] = position, velocity
        set_modes(modes, state.contact, state.slide)
        moves = pose_impact(run, *closes)
        self.problem = Problem(run.model, state.position, work).copy()
        self.free = work.free[1:-1].copy()
        self.solved = not moves or bool(solve_posed(run.model, state, work, new_path(run.model)))
        self.solution = solution_of(self.problem._replace(work=work), self.solved)
        if self.solved:
            take_impact(run)
        self.velocity, self.modes = state.velocity[1:-1].copy(), modes_of(state)
        self.energy = state.energy[Energy.IMPACT]
        self.joints_closed = int(state.count[Count.IMPACTS])
