"""Choose step sizes: short at impacts, long between them.

A step in which a corner would close is refused after its first linear problem. Its gap, the rate
at which it closes and the acceleration that the problem gives determine when it will close. The
step is made again so that it ends shortly before; the next one has the impact in its middle, where
reactions act. Then steps may be long again at once: a step does not depend on its neighbours.

The step that leads up to an impact shows more exactly when it will be, and the next one is made
for that. A long step that closes a corner after all, or in which the contacts give energy or take
some that no law explains, is made again shorter.

Impacts that follow each other more closely than the shortest step are taken as they come. Where
shortest and largest steps are equal none is refused.
"""

import math

from archfrag.physics.contact.blocks import FOR_STEPS
from archfrag.physics.contact.laws import MINUS, PLUS
from archfrag.physics.contact.modes import closes_soon, solve_contact, start_modes
from archfrag.physics.contact.placing import corner_velocity
from archfrag.physics.energy import contact_works, kinetic_energy, unexplained_work
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.numbers import flag, larger, smaller
from archfrag.physics.state import Clock
from archfrag.physics.status import Count, Energy
from archfrag.physics.steps.step import (
    add_carried,
    bend_of,
    is_centred,
    offset_of,
    set_step,
    time_before,
)

# A step this much longer than the shortest is not worth refusing.
NEARLY = 1.05
# A refused step ends LEAD of the shortest steps before the impact, unless the impact is nearer
# than SOON of them.
LEAD = 0.75
SOON = 1.25
# The energy that a step may make or lose unexplained, over its tolerance and the largest kinetic
# energy. A step with more, or without a solution, is made again with QUARTER of its length.
ENERGY_OF_STEP = 0.01
QUARTER = 0.25
# A refused step is made again with at most MOST of its length, and with at least LEAST of the
# shortest step.
MOST = 0.9
LEAST = 0.25


@inlined
def _closing_time(gap, before, after, bend, step, latest):
    """Return the time from the beginning of a step at which a gap closes, at most `latest` [s].

    `gap` is that at the middle of the step, `before` and `after` are its rates on either side, and
    `bend` is the centripetal part of its acceleration.
    """
    start = gap - 0.5 * step * before + 0.125 * step * step * bend
    rate = before - 0.5 * step * bend
    acceleration = (after - before) / step + bend
    root = larger(rate * rate - 2.0 * acceleration * start, 0.0)
    time = select(start > 0.0, 2.0 * start / (math.sqrt(root) - rate), 0.0)
    return select((time >= 0.0) & (time < latest), time, latest)


@inlined
def beyond(step, shortest, ahead):
    """Return the time `ahead` after a step [s] as `closes_soon` takes it [1].

    The bias of open corners covers a span from the middle of the step to half a step after it, or
    half the shortest if that is less. Returned is the time from the end of that span, over the
    span.
    """
    half = 0.5 * smaller(step, shortest)
    return (ahead - half) / (0.5 * step + half)


@kernel
def time_to_impact(model, state, work, shortest, ahead):
    """Return the time from now at which the first corner that asks to close will close [s].

    If no corner does, it is the step plus `ahead`.
    """
    step = state.clock[Clock.STEP]
    latest = step + ahead
    first = latest
    for j in range(state.slip.size):
        for k in range(2):
            closes = closes_soon(j, k, work, beyond(step, shortest, ahead))
            if some(closes):
                ex, ey = offset_of(j, k, model, work)
                hx, hy = bend_of(j, k, model, state.velocity, work)
                ux, uy = corner_velocity(j, k, work.earlier, work)
                vx, vy = corner_velocity(j, k, work.relative, work)
                time = 0.0 * step
                # The corner closes when the last of both laws, Eqs 23a and 23b, lets it.
                for sense in (PLUS, MINUS):
                    nx = work.side_normal[j, k, sense, 0]
                    ny = work.side_normal[j, k, sense, 1]
                    closing = _closing_time(
                        nx * ex + ny * ey,
                        nx * ux + ny * uy,
                        nx * vx + ny * vy,
                        nx * hx + ny * hy,
                        step,
                        latest,
                    )
                    time = larger(time, closing)
                first = select(closes & (time < first), time, first)
    return first


@kernel
def refuse_poor(model, state, work, solved, stops, tolerance):
    """Find solved steps that are not good enough; return masks of those to repeat and to shorten.

    Reactions of the last step may be wrong for the time before an impact, as they are where joints
    open instead: such a step is repeated without them. Where `stops` holds, a step is to be
    shortened if it closes a corner or has too large an energy error: a slip that ends inside a
    long step sticks until its end, held by a friction that made energy.

    Writes: state.force, work.reaction.
    """
    force = state.force
    carries = False
    for j in range(state.slip.size):
        carries = carries | (abs(force[j, 0]) + abs(force[j, 1]) > 0.0)
    step = state.clock[Clock.STEP]
    again = solved & carries & is_centred(state.clock, step)
    shorter = solved & stops
    if some(again | shorter):
        before = time_before(state, step)
        if some(again):
            add_carried(state, work, before)
        friction, impact, balance_error = contact_works(state, work)
        if some(again):
            add_carried(state, work, -before)
        closes = False
        for j in range(state.slip.size):
            for k in range(2):
                closes = closes | (work.contact[j, k] > state.contact[j, k])
        kinetic = kinetic_energy(model, work.solved)
        kinetic = larger(state.energy[Energy.LARGEST_KINETIC], kinetic)
        error = abs(unexplained_work(friction, impact, balance_error))
        wrong = error > ENERGY_OF_STEP * tolerance * kinetic
        again = again & wrong
        shorter = shorter & (closes | wrong)
        if some(again):
            for j in range(state.slip.size):
                for c in range(3):
                    force[j, c] = select(again, 0.0, force[j, c])
    return again, shorter


@kernel
def expect_impact(model, state, work, options, solved):
    """Update the time at which an impact is expected, in the solved step that leads up to it.

    Writes: state.clock.
    """
    clock = state.clock
    shortest = options.time_step
    step = clock[Clock.STEP]
    ahead = clock[Clock.IMPACT] - clock[Clock.TIME] - step
    near = solved & (ahead > 0.0) & (ahead < SOON * shortest)
    if some(near):
        latest = 2.0 * SOON * shortest
        wait = time_to_impact(model, state, work, shortest, latest)
        impact = clock[Clock.TIME] + larger(wait, step + 0.5 * LEAST * shortest)
        near = near & (wait < step + latest)
        clock[Clock.IMPACT] = select(near, impact, clock[Clock.IMPACT])


@inlined
def shorten(model, state, work, options, refused, poor):
    """Shorten steps: `refused` ones to end before the impact, `poor` ones to a quarter."""
    clock = state.clock
    step = clock[Clock.STEP]
    if some(refused):
        wait = time_to_impact(
            model, state, work, options.time_step, LEAD * options.time_step
        )
        # Too near for a step before it: the impact comes into the middle of this one.
        middle = larger(2.0 * wait, LEAST * options.time_step)
        cut = select(
            wait < SOON * options.time_step, middle, wait - LEAD * options.time_step
        )
        clock[Clock.STEP] = select(refused, smaller(cut, MOST * step), step)
        clock[Clock.IMPACT] = select(
            refused, clock[Clock.TIME] + wait, clock[Clock.IMPACT]
        )
    if some(poor):
        part = larger(QUARTER * step, options.time_step)
        clock[Clock.STEP] = select(poor, part, clock[Clock.STEP])
        state.count[Count.SHORTENED] += flag(poor)


@inlined
def next_step(state, options, where, until):
    """Set the size of the next step of rigid joints, which ends at `until` at the latest."""
    clock = state.clock
    ahead = clock[Clock.IMPACT] - clock[Clock.TIME]
    unfinished = False
    for j in range(state.impact.size):
        unfinished = unfinished | (state.impact[j] > 0.0)
    # An impact off the middle of its step ends in the next one.
    step = select(
        unfinished, smaller(clock[Clock.STEP], options.time_step), options.largest_step
    )
    far = ahead - LEAD * options.time_step
    due = select(ahead < SOON * options.time_step, 2.0 * ahead, far)
    step = select((ahead > 0.0) & (due < step), due, step)
    set_step(clock, step, until, where)


@inlined
def locates(state, options, live):
    """Return where a step is refused if a corner closes in it.

    It is longer than the shortest, and has no impact expected in its middle. The chain moves: what
    closes in one that stands does so by rounding.
    """
    clock = state.clock
    step = clock[Clock.STEP]
    moves = clock[Clock.FASTEST] >= options.held
    long = moves & (step > NEARLY * options.time_step)
    return live & long & opposite(is_centred(clock, step))


@kernel
def solve_contacts(runs, live):
    """Solve the contact problems of steps, and shorten the steps where that is due.

    Return the masks solved and unsolved. A run in neither has had its step shortened, or its modes
    go on changing in the next call.
    """
    model = runs.model
    state = runs.state
    work = runs.work
    options = runs.options
    clock = state.clock
    step = clock[Clock.STEP]
    stops = locates(state, options, live)
    start_modes(state, work, clock[Clock.ITERATIONS] == 0.0, opposite(stops))
    lead = LEAD * options.time_step
    ahead = select(stops, beyond(step, options.time_step, lead), -1.0)
    solved, refused, active, iterations = solve_contact(
        model, work.position, work, live, clock[Clock.ITERATIONS], ahead, FOR_STEPS
    )
    clock[Clock.ITERATIONS] = select(active, iterations, 0.0)
    state.count[Count.ITERATIONS] += select(live & opposite(active), iterations, 0.0)
    failed = live & opposite(solved | refused | active)
    poor = failed & (step > 1.5 * options.time_step)
    unsolved = failed & opposite(poor)
    again, shorter = refuse_poor(model, state, work, solved, stops, options.tolerance)
    solved = solved & opposite(again | shorter)
    poor = poor | shorter
    expect_impact(model, state, work, options, solved)
    if some(refused | poor):
        shorten(model, state, work, options, refused, poor)
    return solved, unsolved
