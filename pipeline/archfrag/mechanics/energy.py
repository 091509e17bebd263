"""Energy balance of a run: works of the joints by the law that explains them, and the error."""

from archfrag.mechanics.compile import inlined
from archfrag.mechanics.contact.placing import MINUS, PLUS, at_point, relative_velocity
from archfrag.mechanics.model import Clock
from archfrag.mechanics.numbers import larger, opposite, select, some
from archfrag.mechanics.status import Energy


@inlined
def _mode_normal(j, work):
    """Normal and contact point, from the pivot, of a joint in its present mode."""
    at_0, at_1 = work.touch[j, 0] > 0.5, work.touch[j, 1] > 0.5
    second, back, side = at_1 & opposite(at_0), work.slide[j] < 0.0, work.side_normal
    nx = select(back, side[j, 0, MINUS, 0], side[j, 0, PLUS, 0])
    ny = select(back, side[j, 0, MINUS, 1], side[j, 0, PLUS, 1])
    nx = select(second, select(back, side[j, 1, MINUS, 0], side[j, 1, PLUS, 0]), nx)
    ny = select(second, select(back, side[j, 1, MINUS, 1], side[j, 1, PLUS, 1]), ny)
    nx = select(at_0 & at_1, work.normal[j, 0], nx)
    ny = select(at_0 & at_1, work.normal[j, 1], ny)
    px = select(second, work.point[j, 1, 0], work.point[j, 0, 0]) - work.pivot[j, 0]
    py = select(second, work.point[j, 1, 1], work.point[j, 0, 1]) - work.pivot[j, 1]
    return nx, ny, px, py


@inlined
def contact_works(state, work, part):
    """Work done at the joints over a step, by the law that explains it.

    Parameters
    ----------
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
        With relative velocities before the step in `earlier`, after it in `relative`.
    part : number
        Of the kick that acts up to the instant of the positions.

    Returns
    -------
    friction, impact, balance_error : number
        `balance_error` is what neither law explains [J].
    before : number
        What of it has been done up to the instant of the positions [J].
    hits : mask
        Where an impact is going on.
    """
    friction = impact = balance_error = before = 0.0
    hits = False
    for j in range(state.slip.shape[0]):
        fx, fy, moment = work.reaction[j, 0], work.reaction[j, 1], work.reaction[j, 2]
        ux, uy, u = work.earlier[j, 0], work.earlier[j, 1], work.earlier[j, 2]
        vx, vy, v = work.relative[j, 0], work.relative[j, 1], work.relative[j, 2]
        start, finish = fx * ux + fy * uy + moment * u, fx * vx + fy * vy + moment * v
        fresh = state.impact[j] > 0.0
        hits = hits | fresh
        impact += select(fresh, 0.5 * (start + finish), 0.0)
        slides = opposite(fresh) & ((work.slide[j] != 0.0) | (state.slide[j] != 0.0))
        if some(slides):
            nx, ny, px, py = _mode_normal(j, work)
            tangential = fy * nx - fx * ny
            ax, ay = at_point(ux, uy, u, px, py)
            bx, by = at_point(vx, vy, v, px, py)
            a = select(slides, tangential * (ay * nx - ax * ny), 0.0)
            b = select(slides, tangential * (by * nx - bx * ny), 0.0)
            friction += 0.5 * (a + b)
            start, finish = start - a, finish - b
        balance_error += select(fresh, 0.0, 0.5 * (start + finish))
        before += select(fresh, 0.0, part * (start + 0.5 * part * (finish - start)))
    return friction, impact, balance_error, before, hits


@inlined
def record_work(friction, impact, balance_error, at_instant, where, energy):
    """Works of all joints over one step [J].

    An impact at one joint and the friction that it causes at others belong together: only what
    both give in sum is the integrator's error. `at_instant` is the error within the step, where
    velocities and positions belong to one instant.
    """
    most = larger(
        energy[Energy.BALANCE_ERROR_PEAK], abs(energy[Energy.BALANCE_ERROR] + at_instant)
    )
    energy[Energy.BALANCE_ERROR_PEAK] = select(where, most, energy[Energy.BALANCE_ERROR_PEAK])
    makes = friction + impact > 0.0
    energy[Energy.FRICTION] += select(where & opposite(makes), friction, 0.0)
    energy[Energy.IMPACT] += select(where & opposite(makes), impact, 0.0)
    balance_error += select(makes, friction + impact, 0.0)
    energy[Energy.BALANCE_ERROR] += select(where, balance_error, 0.0)


@inlined
def _lift(model, state, work):
    """Mass times the change of vertical velocity in a step, of all bodies [N s]."""
    total = 0.0
    for i in range(1, state.position.shape[0] - 1):
        total += model.mass[i] * (work.solved[i, 1] - state.velocity[i, 1])
    return total


@inlined
def change_of_step(model, state, work, step, previous):
    """Work that weight and height, weighed apart, leave where the step changes [J].

    To be asked before the solved velocities are taken over.
    """
    return 0.25 * model.gravity * (step - previous) * _lift(model, state, work)


@inlined
def record_step(model, state, work, step, previous, where):
    """Works of a solved step, before its velocities are taken over.

    Where velocities have run ahead to an impact, what weight and height leave belongs to it.
    """
    relative_velocity(state.position, state.velocity, work.pivot, work.earlier)
    part = previous / (previous + step)
    friction, impact, balance_error, before, hits = contact_works(state, work, part)
    lift = 0.25 * model.gravity * _lift(model, state, work)
    change, ahead = (step - previous) * lift, hits & (previous < step)
    impact += select(ahead, change, 0.0)
    balance_error += select(ahead, 0.0, change)
    before = select(hits, -state.energy[Energy.BALANCE_ERROR], before - part * previous * lift)
    record_work(friction, impact, balance_error, before, where, state.energy)


@inlined
def energies_of(model, state):
    """Kinetic energy, and potential energy at the instant of the velocities [J]."""
    kinetic = potential = 0.0
    for i in range(1, state.position.shape[0] - 1):
        ux, uy, w = state.velocity[i, 0], state.velocity[i, 1], state.velocity[i, 2]
        kinetic += 0.5 * (model.mass[i] * (ux * ux + uy * uy) + model.inertia[i] * w * w)
        rise = state.position[i, 1] - 0.5 * state.clock[Clock.PREVIOUS] * uy
        potential += model.gravity * model.mass[i] * (rise - model.centroid[i, 1])
    return kinetic, potential
