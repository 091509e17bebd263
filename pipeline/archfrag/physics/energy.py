"""Energy balance of a run: work of the joints by law, and the integrator's error."""

import math

from archfrag.physics.contact.laws import contact_of, cross, force_of
from archfrag.physics.contact.placing import at_point
from archfrag.physics.contact.ties import add_stored, is_pulled
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.numbers import larger, smaller
from archfrag.physics.state import Clock
from archfrag.physics.status import Energy, Peak

# Kinetic energy of a chain that sways in rest, over its weight times its shortest joint.
CALM = 1e-4
# A chain still moves if it was not calm in this time, over that of a fall through its shortest
# joint: longer than a turning point lasts [1].
RECENT = 4.0


@kernel
def contact_works(state, work):
    """Return the work of the joints in a step: friction, impacts, unexplained [J].

    From the relative velocities before the step in ``work.earlier``, after it in `relative`.
    """
    friction = impact = balance_error = 0.0
    hits = False
    for j in range(state.slip.shape[0]):
        fx, fy = force_of(j, work)
        moment = work.reaction[j, 2]
        ux = 0.5 * (work.earlier[j, 0] + work.relative[j, 0])
        uy = 0.5 * (work.earlier[j, 1] + work.relative[j, 1])
        u = 0.5 * (work.earlier[j, 2] + work.relative[j, 2])
        now = work.contact
        before = state.contact
        made = (now[j, 0] > before[j, 0]) | (now[j, 1] > before[j, 1])
        done = fx * ux + fy * uy + moment * u
        fresh = made | (state.impact[j] > 0.0)
        hits = hits | fresh
        impact += select(fresh, done, 0.0)
        slides = opposite(fresh) & ((work.slide[j] != 0.0) | (state.slide[j] != 0.0))
        if some(slides):
            nx, ny, px, py = contact_of(j, work)
            slip = at_point(ux, uy, u, px - work.pivot[j, 0], py - work.pivot[j, 1])
            rubbed = cross((nx, ny), (fx, fy)) * cross((nx, ny), slip)
            rubbed = select(slides, rubbed, 0.0)
            friction += rubbed
            done = done - rubbed
        balance_error += select(fresh, 0.0, done)
    # What an impact takes it takes at all joints.
    impact += select(hits, balance_error, 0.0)
    return friction, impact, select(hits, 0.0, balance_error)


@inlined
def unexplained_work(friction, impact, balance_error):
    """Return the work in a step that no law explains: the integrator's error [J].

    An impact at one joint and the friction that it causes at others belong together.
    """
    return balance_error + larger(friction + impact, 0.0)


@inlined
def _record_error(unexplained, where, energy):
    energy[Energy.BALANCE_ERROR] += select(where, unexplained, 0.0)
    most = larger(energy[Energy.BALANCE_ERROR_PEAK], abs(energy[Energy.BALANCE_ERROR]))
    energy[Energy.BALANCE_ERROR_PEAK] = select(
        where, most, energy[Energy.BALANCE_ERROR_PEAK]
    )


@inlined
def record_work(friction, impact, balance_error, where, energy):
    """Add the works of all joints over one step [J]; see `unexplained_work`."""
    both = friction + impact
    makes = both > 0.0
    rubs = select(impact > 0.0, both, select(friction > 0.0, 0.0, friction))
    energy[Energy.FRICTION] += select(where & opposite(makes), rubs, 0.0)
    energy[Energy.IMPACT] += select(where & opposite(makes), both - rubs, 0.0)
    _record_error(unexplained_work(friction, impact, balance_error), where, energy)


@inlined
def record_step(state, work, where):
    """Record the work of a solved step; the state still has the old velocities."""
    friction, impact, balance_error = contact_works(state, work)
    record_work(friction, impact, balance_error, where, state.energy)


@inlined
def record_pulls(state, yielded, unexplained, where):
    """Record what ties dissipate by yielding, and the error of their work in a step [J]."""
    state.energy[Energy.FRICTION] += select(where, yielded, 0.0)
    _record_error(unexplained, where, state.energy)


@inlined
def record_faces(friction, damped, unexplained, where, energy):
    """Record the work in a step of friction and dashpots of joints that give, and that which their
    laws do not explain [J].

    What dashpots have given in sum is an error, too.
    """
    energy[Energy.FRICTION] += select(where, friction, 0.0)
    spent = energy[Energy.IMPACT] + damped
    energy[Energy.IMPACT] = select(where, smaller(spent, 0.0), energy[Energy.IMPACT])
    _record_error(unexplained + larger(spent, 0.0), where, energy)


@inlined
def kinetic_energy(model, velocity):
    """Return the kinetic energy of all bodies [J]."""
    kinetic = 0.0
    for i in range(1, velocity.shape[0] - 1):
        ux = velocity[i, 0]
        uy = velocity[i, 1]
        w = velocity[i, 2]
        kinetic += 0.5 * (
            model.mass[i] * (ux * ux + uy * uy) + model.inertia[i] * (w * w)
        )
    return kinetic


@inlined
def energies_of(model, state):
    """Return kinetic and potential energy, with the elastic one of ties [J]."""
    potential = 0.0
    for i in range(1, state.position.shape[0] - 1):
        rise = state.position[i, 1] - model.centroid[i, 1]
        potential += model.gravity * model.mass[i] * rise
    return kinetic_energy(model, state.velocity), add_stored(model, state, potential)


@inlined
def record_calm(model, state, kinetic, where):
    """Record when a chain with ties has more kinetic energy than a sway in rest, and whether any
    has just before the time that is noted (`Grounds.noted`).
    """
    clock = state.clock
    tied = is_pulled(model)
    left = clock[Clock.NOTED] - clock[Clock.TIME]
    if tied or some(left > 0.0):
        weight = 0.0
        length = model.length[0]
        for i in range(1, model.mass.shape[0] - 1):
            weight += model.gravity * model.mass[i]
        for j in range(1, model.length.shape[0]):
            length = min(length, model.length[j])
        lively = where & (kinetic > CALM * weight * length)
        if tied:
            clock[Clock.LIVELY] = select(lively, clock[Clock.TIME], clock[Clock.LIVELY])
        recent = RECENT * math.sqrt(length / model.gravity)
        moves = lively & (left > 0.0) & (left <= recent)
        peak = state.peak
        peak[Peak.MOVED_BEFORE] = select(moves, 1.0, peak[Peak.MOVED_BEFORE])


@kernel
def balance_energy(model, state):
    """Record the energy that no work explains; return the kinetic energy [J].

    Writes: state.energy.
    """
    energy = state.energy
    kinetic, potential = energies_of(model, state)
    change = (
        kinetic - energy[Energy.START_KINETIC] + potential - state.clock[Clock.START]
    )
    explained = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
    energy[Energy.BALANCE_ERROR] = change - explained
    energy[Energy.BALANCE_ERROR_PEAK] = max(
        energy[Energy.BALANCE_ERROR_PEAK], abs(energy[Energy.BALANCE_ERROR])
    )
    return kinetic
