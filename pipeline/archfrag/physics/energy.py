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
# A chain still moves if it was not calm within this time, over the time of a fall through its
# shortest joint [1]. A turning point lasts less long.
RECENT = 4.0


@kernel
def contact_works(state, work):
    """Return the work of all joints in a step [J]: of friction, of impacts, and unexplained.

    It is the work of the impulses in ``work.reaction`` at the mean of the relative velocities
    before the step, ``work.earlier``, and after it, ``work.relative``. In a step with an impact no
    work is unexplained: what is not work of friction counts as work of impacts.
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
    # An impact at one joint takes energy at all joints.
    impact += select(hits, balance_error, 0.0)
    return friction, impact, select(hits, 0.0, balance_error)


@inlined
def unexplained_work(friction, impact, balance_error):
    """Return the work in a step that no law explains: the integrator's error [J].

    The arguments are what `contact_works` returns. Friction and impacts only take energy: if their
    sum is positive, it is an error too. They are summed, since an impact at one joint and the
    friction that it causes at others belong together.
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
    """Add the work of all joints in a step to `energy`, where `where` holds [J].

    The first three arguments are what `contact_works` returns. Where friction or impacts give
    energy, the other one gets their sum; where the sum is positive it is part of
    `unexplained_work`.
    """
    both = friction + impact
    makes = both > 0.0
    rubs = select(impact > 0.0, both, select(friction > 0.0, 0.0, friction))
    energy[Energy.FRICTION] += select(where & opposite(makes), rubs, 0.0)
    energy[Energy.IMPACT] += select(where & opposite(makes), both - rubs, 0.0)
    _record_error(unexplained_work(friction, impact, balance_error), where, energy)


@inlined
def record_step(state, work, where):
    """Record the work of the joints in a solved step; `state` must be that before the step."""
    friction, impact, balance_error = contact_works(state, work)
    record_work(friction, impact, balance_error, where, state.energy)


@inlined
def record_pulls(state, yielded, unexplained, where):
    """Record the work of ties in a step [J], where `where` holds.

    `yielded`, at most zero, is what they lose by yielding and breaking; `unexplained` is the error
    of their work.
    """
    state.energy[Energy.FRICTION] += select(where, yielded, 0.0)
    _record_error(unexplained, where, state.energy)


@inlined
def record_faces(friction, damped, unexplained, where, energy):
    """Record the work of joints that give in a step [J], where `where` holds.

    `friction` and `damped` are the work of friction and of dashpots, `unexplained` is what their
    laws do not explain. If dashpots have given energy in sum, that is an error, too.
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
    """Return the kinetic and the potential energy of a chain [J].

    The potential energy is that of the weights, zero as built, plus the elastic energy of ties.
    """
    potential = 0.0
    for i in range(1, state.position.shape[0] - 1):
        rise = state.position[i, 1] - model.centroid[i, 1]
        potential += model.gravity * model.mass[i] * rise
    return kinetic_energy(model, state.velocity), add_stored(model, state, potential)


@inlined
def record_calm(model, state, kinetic, where):
    """Record whether a chain moves more than by a sway at rest, where `where` holds.

    It does if `kinetic`, its kinetic energy [J], is above that of `CALM`. Then ``Clock.LIVELY`` is
    set to the present time if the chain has ties, and ``Peak.MOVED_BEFORE`` is set to one if the
    time to note, ``Grounds.noted``, comes within `RECENT`.
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
