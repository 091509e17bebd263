"""How long steps are: short at impacts, long between them.

A step in which a corner would close is refused after its first linear problem. Its gap, the rate
at which it closes and the acceleration that the problem gives determine when it will close; the
step is made again so that it ends one and a half of the shortest steps before. These follow
until the impact is over: velocities lie half a step from the positions, an impact extends over
two steps, and between unequal ones it would change the velocities of another instant and so make
or lose energy. Then steps grow again.

What acts until the impact acts on the mechanism before it (`due_kick`): divided at the middle of
a step it would act on the one after it, which takes the acceleration times a step or two too much
speed. Impacts that follow each other closely are taken as they come. Where shortest and largest
steps are equal none is refused.
"""

import math
from typing import NamedTuple

from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.contact.modes import closes_soon, opening_rate
from archfrag.mechanics.contact.placing import MINUS, PLUS, corner_offset
from archfrag.mechanics.model import Clock
from archfrag.mechanics.numbers import larger, select, smaller, some
from archfrag.mechanics.status import Count
from archfrag.methods.time_stepping.step import QUIET

# A step this much longer than the shortest is not worth refusing.
NEARLY = 1.05
# An impact that has come later than expected by this part of the shortest step is over.
LATE = 0.25
# A refused step ends so many of the shortest before the impact.
LEAD = 1.5
# The most of a refused step that is made again.
MOST = 0.9


class Steps(NamedTuple):
    """Sizes of steps."""

    largest: float  # [s]
    impact: float  # at impacts: the shortest [s]
    growth: float  # largest ratio of a step to the one before


@inlined
def _gap(j, k, face, tangent, state, work):
    """Gap at a corner by the contact's own normals [m]."""
    ex, ey = corner_offset(j, k, face, tangent, state.slip[j])
    side = work.side_normal
    plus = side[j, k, PLUS, 0] * ex + side[j, k, PLUS, 1] * ey
    minus = side[j, k, MINUS, 0] * ex + side[j, k, MINUS, 1] * ey
    return larger(plus, minus)


@kernel
def time_to_impact(state, work, ahead):
    """When the first of the corners that ask to close will do so, from now on [s].

    Returns step and time ahead where no corner does.

    The gap g + r t + a t (t + p) / 2 follows from its present value g, its rate r before the step,
    half a step p back, and the acceleration a over it.
    """
    step, previous = state.clock[Clock.STEP], state.clock[Clock.PREVIOUS]
    first, per_step = step + ahead, 1.0 / step
    for j in range(state.slip.shape[0]):
        for k in range(2):
            closes = closes_soon(j, k, work, ahead * per_step)
            if some(closes):
                now = _gap(j, k, work.face, work.tangent, state, work)
                coasting = _gap(j, k, work.next_face, work.next_tangent, state, work)
                rate = (coasting - now) * per_step
                end = opening_rate(j, k, work) * step
                bend = 2.0 * (end - coasting) * per_step / (step + larger(previous, 0.0))
                slope = rate + 0.5 * bend * previous
                root = larger(slope * slope - 2.0 * bend * now, 0.0)
                below = math.sqrt(root) - slope
                time = select(now > 0.0, 2.0 * now / below, 0.0)
                time = select((time >= 0.0) & (time < step + ahead), time, step + ahead)
                first = select(closes & (time < first), time, first)
    return first


@inlined
def shorten(state, work, steps, refused, unsolved):
    """Cut the steps that were refused before the impact, and halve those without solution."""
    clock = state.clock
    step = clock[Clock.STEP]
    if some(refused):
        wait = time_to_impact(state, work, LEAD * steps.impact)
        cut = smaller(wait - LEAD * steps.impact, MOST * step)
        clock[Clock.STEP] = select(refused, larger(cut, steps.impact), step)
        clock[Clock.IMPACT] = select(refused, clock[Clock.TIME] + wait, clock[Clock.IMPACT])
    if some(unsolved):
        half = larger(0.5 * step, steps.impact)
        clock[Clock.STEP] = select(unsolved, half, clock[Clock.STEP])
        state.count[Count.SHORTENED] += select(unsolved, 1.0, 0.0)


@inlined
def next_step(state, steps, where, until):
    """Size of the step after one that has been made; none goes on past `until`."""
    clock = state.clock
    ahead = clock[Clock.IMPACT] - clock[Clock.TIME]
    hits = False
    for j in range(state.impact.shape[0]):
        hits = hits | (state.impact[j] > 0.0)
    grown = smaller(steps.growth * clock[Clock.STEP], steps.largest)
    grown = select(hits, larger(clock[Clock.STEP], steps.impact), grown)
    due = larger(ahead - LEAD * steps.impact, steps.impact)
    waits = (ahead > -LATE * steps.impact) & (due < grown)
    step = select(waits, due, grown)
    left = until - clock[Clock.TIME]
    step = select((left > 0.0) & (left < step), left, step)
    clock[Clock.STEP] = select(where, step, clock[Clock.STEP])


@inlined
def lone_impacts(state, steps):
    """The shortest step where no impact has been for some steps, else none [s]."""
    latest = -QUIET
    for j in range(state.impact.shape[0]):
        latest = larger(latest, state.impact[j])
    return select(latest > -QUIET, 0.0, steps.impact)


@inlined
def locates(state, steps, live):
    """Where a step is long enough to be refused if a corner closes in it."""
    return live & (state.clock[Clock.STEP] > NEARLY * steps.impact)
