"""Arches, columns and motions that others have computed, and limit analysis by a programme."""

import math

import numba
import numpy as np
from scipy.optimize import linprog

import archfrag as af
from archfrag.physics.status import Status

g = 9.80665
HEIGHT = np.append(np.arange(8) * 0.82, 5.95)
WIDTH = 1.11 - 0.21 * HEIGHT / 5.95


def oppenheim(**options):
    """Oppenheim's arch of seven voussoirs."""
    return af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7, **options)


def column(friction=math.inf):
    """Seven drums and a top block, tapering: Dimitri, De Lorenzis and Zavarise (2011)."""
    right = np.column_stack([0.5 * WIDTH, HEIGHT])
    return af.Arch.from_joints(
        right, right * [-1.0, 1.0], friction=friction, density=2620.0, free_end=True
    )


def sampled(shape, duration, dt=1e-4):
    """Motion whose acceleration [g] at time t [s] is ``shape(t)``, and zero from `duration` on."""
    time = np.arange(0.0, duration + 0.01, dt)
    return af.Motion(np.where(time < duration - 1e-9, shape(time), 0.0) * g, dt)


def pulse(amplitude, duration, back=0.5):
    """+a for `duration`, then back times -a for twice as long [g, s]."""
    return sampled(
        lambda t: amplitude * np.where(t < duration - 1e-9, 1.0, -back), 3.0 * duration
    )


def tilted(width, height, tilt):
    """State of a block rotated about its right corner by `tilt` [rad], at rest."""
    half = width / 2.0
    up = height / 2.0
    across = half - (half * math.cos(tilt) - up * math.sin(tilt))
    rise = half * math.sin(tilt) + up * math.cos(tilt) - up
    return np.array([[across, rise, -tilt]]), np.zeros((1, 3))


def falls(arch, motion, **options):
    """Whether a run ends in collapse; a failure is no answer."""
    run = af.simulate(arch, motion, **options)
    assert run.status in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)
    return run.status is Status.COLLAPSED


def first_collapse(collapses, low, high, step, precision=1e-4):
    """Least argument that collapses: the first of a sweep, then bisection; not monotone beyond."""
    assert not collapses(low)
    steps = np.arange(low + step, high + step, step)
    above = next(value for value in steps if collapses(value))
    below = above - step
    while above - below > precision * above:
        middle = 0.5 * (below + above)
        below, above = (below, middle) if collapses(middle) else (middle, above)
    return 0.5 * (below + above)


def least(holds, low, high, precision=1e-10):
    """Least argument at which something holds, by bisection."""
    assert [holds(low), holds(high)] == [False, True]
    while high - low > precision:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def limit_analysis(arch, sense):
    """Largest k for which forces at the joints' ends balance the weights and k times them [g].

    A linear programme over all joint forces (static theorem).
    """
    chain = arch.chain
    lines = arch.chain.face_after.copy()
    lines[: arch.n_voussoir] += chain.centroid[:, None]
    centre = chain.centroid
    friction = chain.friction
    weight = chain.mass / chain.mass.sum()
    n_body = arch.n_voussoir
    n_joint = arch.n_joint
    # Unknowns: normal forces at both ends of each joint, its shear, and the load factor.
    balance = np.zeros((3 * n_body, 3 * n_joint + 1))
    load = np.zeros(3 * n_body)
    cone = []
    for j, (inner, outer) in enumerate(lines):
        tangent = (outer - inner) / np.linalg.norm(outer - inner)
        normal = np.array([tangent[1], -tangent[0]])
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if 0 <= body < n_body:
                places = ((inner, normal), (outer, normal), (inner, tangent))
                for k, (point, (x, y)) in enumerate(places):
                    arm = point - centre[body]
                    balance[3 * body : 3 * body + 3, 3 * j + k] = (
                        sign * x,
                        sign * y,
                        sign * (arm[0] * y - arm[1] * x),
                    )
        if np.isfinite(friction[j]):
            for side in (1.0, -1.0):
                row = np.zeros(3 * n_joint + 1)
                row[3 * j : 3 * j + 3] = -friction[j], -friction[j], side
                cone.append(row)
    load[1::3] = weight
    balance[::3, -1] = -weight
    objective = np.zeros(3 * n_joint + 1)
    objective[-1] = -sense
    found = linprog(
        objective,
        A_ub=np.array(cone) if cone else None,
        b_ub=np.zeros(len(cone)) if cone else None,
        A_eq=balance,
        b_eq=load,
        bounds=[(0, None), (0, None), (None, None)] * n_joint + [(None, None)],
        method="highs",
    )
    if found.status == 3:
        return sense * math.inf
    return found.x[-1] if found.success else math.nan


def rocking(motion, twin, ratio):
    """Rotation [rad] of an `archbench.exact.Rocking` at each step of a motion and 20 s after it.

    An impact leaves the `ratio` of a velocity. Beyond a right angle a block stays as it is.
    """
    ground = np.append(motion.acceleration, np.zeros(int(20.0 / motion.dt))) / g
    return _rocking(ground, motion.dt, twin.alpha, twin.frequency**2, ratio)


@numba.njit
def _rocking(ground, dt, alpha, square, ratio):
    """theta'' = -p² (sin(±alpha - theta) + a/g cos(±alpha - theta)) by Runge-Kutta steps."""
    found = np.zeros(ground.size)
    limit = math.tan(alpha)
    angle = speed = side = 0.0
    for i in range(ground.size - 1):
        push = ground[i]
        end = ground[i + 1]
        left = dt
        slope = (end - push) / dt
        while left > 1e-9 * dt and abs(angle) < 0.5 * math.pi:
            if side == 0.0:
                if abs(end) <= limit:
                    break
                side = -math.copysign(1.0, end)
                if abs(push) <= limit:
                    push = -side * limit
                    left = (end - push) / slope
            step = left
            low = 0.0
            high = left
            hits = False
            for _ in range(50):  # bisection, if it hits the ground within the step
                new = angle
                change = speed
                rate = 0.0
                pace = 0.0
                for part, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
                    tilt = side * alpha - angle - part * step * rate
                    rate = speed + part * step * pace
                    pace = math.sin(tilt) + (push + slope * part * step) * math.cos(
                        tilt
                    )
                    pace *= -square
                    new += step / 6.0 * weight * rate
                    change += step / 6.0 * weight * pace
                hits = hits or side * new < 0.0
                if not hits:
                    break
                low, high = (step, high) if side * new > 0.0 else (low, step)
                step = 0.5 * (low + high)
            angle = new
            speed = change
            push = push + slope * step
            left = left - step
            if hits:
                angle = 0.0
                speed = ratio * speed
                side = -side
                if abs(speed) < 1e-7 * math.sqrt(square) and abs(push) <= limit:
                    speed = side = 0.0
        found[i + 1] = angle
    return found
