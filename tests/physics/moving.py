"""Motion of mega-voussoirs between two events as these tests call it: a step, and its events.

Names and layouts of the package stand here only.
"""

import numpy as np

from archfrag.physics.contact import laws
from archfrag.physics.events import locate, runge_kutta, transitions
from archfrag.physics.events.integrate import check_laws
from archfrag.physics.events.phases import new_run
from archfrag.physics.ground import Segment, ground_after, grounds_of
from archfrag.physics.interface import Options
from archfrag.physics.mega_voussoirs import assemble
from archfrag.physics.mega_voussoirs.first_level import solve_first_level
from archfrag.physics.state import model_of
from archfrag.physics.status import Count, Energy
from tests.physics.adapters import (
    Problem,
    framed,
    modes_of,
    set_modes,
    solution_of,
    views_of,
)

STANDS = (0.0, 0.0, 0.0, 0.0)  # the far springing


class Moving:
    """A chain that moves in given modes; ground acceleration ``(x, its rate, y, its rate)``."""

    def __init__(self, chain, position, velocity, modes, ground):
        model = model_of(chain)
        n_joint = model.friction.size
        contact = np.zeros((n_joint, 2))
        slide = np.zeros(n_joint)
        set_modes(modes, contact, slide)
        self.ground = Segment(np.inf, *ground, STANDS, STANDS)
        mega = assemble.new_mega_voussoirs(model)
        assemble.assemble(model, contact, slide, np.zeros(n_joint), mega)
        assemble.gather_state(model, framed(position), framed(velocity), mega)
        self.mega = views_of(mega)
        self.resolved = 1e-3 * model.gravity
        self.motion = locate.new_motion(model, runge_kutta.FIFTH_ORDER, 1.0)
        self.motion = self.motion._replace(acceleration=self.resolved)
        self._begin()

    def _begin(self):
        mega = self.mega
        now = ground_after(self.ground, 0.0)
        assert solve_first_level(mega, mega.position, mega.velocity, now, self.resolved)
        runge_kutta.keep_stage(
            mega, self.motion.stages, 0, mega.position, mega.velocity, now
        )
        locate.find_margins(self.motion, mega, mega.position, mega.velocity, now)
        locate.keep_margins(mega, self.motion)

    @property
    def state(self):
        """Position and velocity of the mega-voussoirs, (2, n, 3)."""
        return np.stack([self.mega.position[1:-1], self.mega.velocity[1:-1]])

    def step(self, size):
        """Position, velocity of the mega-voussoirs after a step, and its error by itself [m]."""
        error = runge_kutta.take_step(
            self.mega, self.motion, size, self.ground, (1.0, 1.0)
        )
        assert np.isfinite(error)
        runge_kutta.make_dense(self.mega, self.motion, size)
        return (
            self.mega.next_position[1:-1].copy(),
            self.mega.next_velocity[1:-1].copy(),
            error,
        )

    def inside(self, part):
        """Position and velocity at a part of the last step."""
        position, velocity = np.zeros((2, *self.mega.position.shape))
        runge_kutta.dense_state(self.motion.stages, part, position, velocity)
        return position[1:-1], velocity[1:-1]

    def go_on(self, size):
        """Take the end of the last step as the beginning of the next one."""
        end, x, slope_x, y, slope_y, *far = self.ground
        x = x + slope_x * size
        y = y + slope_y * size
        self.ground = Segment(end, x, slope_x, y, slope_y, *far)
        self.mega.position[:] = self.mega.next_position
        self.mega.velocity[:] = self.mega.next_velocity
        self._begin()

    def first_event(self, size):
        """Time of the first event in a step, else inf, and what is used up then, (kind, joint).

        Kinds are "law", "gap", "slip" (its end) and "inside" (a law inside a mega-voussoir).
        """
        self.step(size)
        part, event = check_laws(self.motion, self.mega, size, self.ground)
        return (part * size, self._used()) if event else (np.inf, set())

    def _used(self):
        between = set(self.mega.joint[: self.mega.count[1]].tolist())
        kinds = {
            laws.GAP_0: "gap",
            laws.GAP_1: "gap",
            laws.SLIP_END: "slip",
        }
        gone = np.argwhere(np.abs(self.motion.value) < 10 * locate.THRESHOLD)
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
        state = run.state
        work = run.work
        state.position[1:-1] = position
        state.velocity[1:-1] = velocity
        set_modes(modes, state.contact, state.slide)
        moves = transitions.pose_impact(run, *closes)
        self.problem = Problem(run.model, state.position, work).copy()
        self.free = work.free[1:-1].copy()
        self.solved = not moves or bool(transitions.solve_posed(run))
        self.solution = solution_of(self.problem._replace(work=work), self.solved)
        if self.solved:
            transitions.take_impact(run)
        self.velocity = state.velocity[1:-1].copy()
        self.modes = modes_of(state)
        self.energy = state.energy[Energy.IMPACT]
        self.joints_closed = int(state.count[Count.IMPACTS])
