"""A column that rotates as one about an edge on shaken ground, apart from the package."""

import numpy as np
from scipy.integrate import solve_ivp

from tests.mechanics.linkages import rotate
from tests.mechanics.oracles import cross, rotated


class Rocking:
    """Rigid column on an edge; ground acceleration ``(x, its rate, y, its rate)``."""

    def __init__(self, chain, pivot, ground):
        self.mass, self.inertia = chain.mass, chain.inertia
        self.pivot, self.arm = np.asarray(pivot), chain.centroid - pivot
        self.ground, self.gravity = ground, chain.gravity

    def force(self, time):
        """Body force per mass."""
        ground_x, rate_x, ground_y, rate_y = self.ground
        return np.array([-ground_x - rate_x * time, -self.gravity - ground_y - rate_y * time])

    def spin_up(self, time, tilt):
        """Angular acceleration: moments about the edge."""
        arm = rotate(self.arm, tilt)
        about = (self.mass * (arm**2).sum(1) + self.inertia).sum()
        return (self.mass * cross(arm, self.force(time))).sum() / about

    def above(self, time, state, first, point):
        """Force, and moment about a point given at rest, that hold the bodies from `first` on."""
        tilt, rate = state
        arm = rotate(self.arm, tilt)[first:]
        up = self.spin_up(time, tilt)
        needed = up * rotated(arm) - rate**2 * arm - self.force(time)
        needed *= self.mass[first:, None]
        at = rotate(np.asarray(point) - self.pivot, tilt)
        moment = cross(arm - at, needed).sum() + (self.inertia[first:] * up).sum()
        return needed.sum(0), moment

    def move(self, span, tilt, rate, event=None):
        """Rotation and rate at the end of a time, or when ``event(time, state)`` first
        vanishes."""
        if event is not None:
            event.terminal = True
        done = solve_ivp(
            lambda t, y: [y[1], self.spin_up(t, y[0])], (0.0, span), [tilt, rate],
            method="DOP853", rtol=1e-13, atol=1e-15, events=event,
        )  # fmt: skip
        return done.t[-1], done.y[:, -1]

    def state(self, tilt, rate):
        """Position and velocity of the bodies, (n, 3) each."""
        arm = rotate(self.arm, tilt)
        tilting = np.full(self.mass.size, tilt), np.full(self.mass.size, rate)
        position = np.column_stack([self.pivot + arm, tilting[0]])
        return position, np.column_stack([rate * rotated(arm), tilting[1]])
