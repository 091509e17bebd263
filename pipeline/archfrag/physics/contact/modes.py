"""Find which corners touch and which joints stick, by Newton's iteration on the modes.

For given modes the contact problem is linear (`blocks`). Its solution gives for each joint whether
it keeps Signorini's and Coulomb's laws in the mode assumed, and which mode it asks for: three
functions, for an open joint, a closed one and one that touches at a corner. The modes asked for
are taken until none changes (`solve_contact`). Where many joints answer each other's changes that
goes round in circles, and `archfrag.physics.contact.path` changes the modes one at a time.
"""

import math

from archfrag.physics.contact import laws
from archfrag.physics.contact.laws import along, cross, opening_rate
from archfrag.physics.contact.placing import corner_velocity, relative_velocity
from archfrag.physics.contact.ties import (
    ask_pulls,
    recall_pulls,
    solve_with_pulls,
    take_asked,
)
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.numbers import choose, count_of, flag, larger

# Part of the bodies' velocities below which relative ones are not distinguished.
ROUNDING = 1e-5
# Iterations after which modes hardly ever are reconciled, and joints that allow one more of them.
MOST_ITERATIONS = 8
ITERATION_PER_JOINTS = 16


@inlined
def mode_if_closed(j, model, work, slip, slack, slack_force):
    """Return the mode that closed joint `j` asks for: whether each corner stays, and its slide.

    A corner that would need a tensile force opens (Eq 5). Friction beyond Coulomb's limit makes a
    joint slide; a slip against its friction makes it stick (Eq 6). `slip` is the relative
    velocity; `slack` and `slack_force` are those of `ask_modes`.
    """
    slide = work.slide[j]
    force_0, force_1, normal, tangential = laws.closed_forces(j, work)
    sticks = slide == 0.0
    against = slide * cross(laws.normal_of(j, work), slip) > slack
    asked = select(opposite(sticks) & against, 0.0, slide)
    if not math.isinf(model.friction[j]):
        excess = abs(tangential) - model.friction[j] * larger(normal, 0.0)
        sense = select(tangential > 0.0, 1.0, -1.0)
        asked = select(sticks & (excess > slack_force), sense, asked)
    return force_0 >= -slack_force, force_1 >= -slack_force, asked


@inlined
def mode_if_corner(j, second, model, work, slip, slack, slack_force):
    """Return the mode that a joint at one corner asks for: where it opens, and its slide.

    `second` is where that corner is corner 1. The joint opens where it would need a tensile force.
    Sticking needs a reaction inside the cones about both normals (Eqs 6, 20, 23). Sliding needs
    one that pushes along its ray, and a slip along its friction. Arguments as of `mode_if_closed`.
    """
    slide = work.slide[j]
    after = laws.side_of(j, 0, laws.PLUS, work)
    before = laws.side_of(j, 0, laws.MINUS, work)
    after = choose(second, laws.side_of(j, 1, laws.PLUS, work), after)
    before = choose(second, laws.side_of(j, 1, laws.MINUS, work), before)
    n = model.ray[j, 0]
    t = model.ray[j, 1]
    size = 1.0 / math.sqrt(n * n + t * t)
    high, low = laws.cone_rays(j, model, after, before)
    force = laws.force_of(j, work)
    above = cross(high, force) * size
    below = cross(force, low) * size
    outside = larger(above, below) > slack_force
    sticks = slide == 0.0
    onwards = slide > 0.0
    tensile = along(force, (after[0] + before[0], after[1] + before[1])) <= 0.0
    if_sticks = select(outside, select(above >= below, 1.0, -1.0), 0.0)
    push = select(onwards, along(force, high), along(force, low)) * size
    against = slide * cross(choose(onwards, after, before), slip) > slack
    lost = (sticks & outside & tensile) | (opposite(sticks) & (push < -slack_force))
    return lost, select(sticks, if_sticks, select(against, 0.0, slide))


@kernel
def ask_modes(model, work, slack, slack_force):
    """Set the modes that the laws ask for (Eqs 24, 25); return where a joint asks for another one.

    The modes asked for are left in ``work.asked_contact`` and ``work.asked_slide``. Violations of
    a law up to `slack` in velocity and up to `slack_force` in force count as none.

    Writes: work (asked_contact, asked_slide).
    """
    changed = False
    for j in range(work.slide.shape[0]):
        at_0, at_1 = laws.touching(j, work)
        slide = work.slide[j]
        rate_0 = laws.rate_of(j, 0, work)
        rate_1 = laws.rate_of(j, 1, work)
        closing_0 = opening_rate(j, 0, rate_0, work) < -slack
        closing_0 = closing_0 & (work.candidate[j, 0] > 0.5)
        closing_1 = opening_rate(j, 1, rate_1, work) < -slack
        closing_1 = closing_1 & (work.candidate[j, 1] > 0.5)
        closed = at_0 & at_1
        one = at_0 ^ at_1
        # A joint without contact asks for the corners that close (Eq 5).
        asks_0 = closing_0
        asks_1 = closing_1
        asked = 0.0
        if some(closed):
            keeps_0, keeps_1, slides = mode_if_closed(
                j, model, work, rate_0, slack, slack_force
            )
            asks_0 = (closed & keeps_0) | (opposite(closed) & asks_0)
            asks_1 = (closed & keeps_1) | (opposite(closed) & asks_1)
            asked = select(closed, slides, asked)
        if some(one):
            slip = choose(at_1, rate_1, rate_0)
            lost, slides = mode_if_corner(
                j, at_1, model, work, slip, slack, slack_force
            )
            kept = one & opposite(lost)
            shut = kept & ((at_0 & closing_1) | (at_1 & closing_0))
            if math.isinf(model.friction[j]):
                slides = select(shut, 0.0, slides)
            asks_0 = (kept & at_0) | shut | (opposite(one) & asks_0)
            asks_1 = (kept & at_1) | shut | (opposite(one) & asks_1)
            asked = select(one, slides, asked)
        known = work.known[j]
        if math.isinf(model.friction[j]):
            known = select(asks_0 & asks_1, 0.0, known)
        asked = select(asks_0 | asks_1, select(known == 0.0, asked, known), 0.0)
        work.asked_contact[j, 0] = flag(asks_0)
        work.asked_contact[j, 1] = flag(asks_1)
        work.asked_slide[j] = asked
        changed = changed | (asks_0 ^ at_0) | (asks_1 ^ at_1) | (asked != slide)
    return changed


@kernel
def velocity_scale(model, position, work):
    """Return the largest relative velocity without reactions of corners that may touch.

    It is at least what rounding leaves of the bodies' velocities, for a chain in flight that moves
    as one body. ``work.relative`` is overwritten.

    Reads: model.body, position, work (candidate, free, pivot, point, relative).
    Writes: work.relative.
    """
    relative_velocity(model, position, work.free, work.pivot, work.relative)
    scale = 0.0
    for i in range(1, work.free.shape[0] - 1):
        fastest = larger(abs(work.free[i, 0]), abs(work.free[i, 1]))
        scale = larger(scale, ROUNDING * fastest)
    for j in range(work.slide.shape[0]):
        for k in range(2):
            ux, uy = corner_velocity(j, k, work.relative, work)
            fastest = larger(abs(ux), abs(uy))
            scale = larger(scale, select(work.candidate[j, k] > 0.5, fastest, 0.0))
    return scale


@kernel
def largest_force(work):
    """Return the largest component x or y of a reaction; one if all are zero.

    Reads: work.reaction.
    """
    largest = 0.0
    for j in range(work.slide.shape[0]):
        force = larger(abs(work.reaction[j, 0]), abs(work.reaction[j, 1]))
        largest = larger(largest, force)
    return select(largest == 0.0, 1.0, largest)


@inlined
def closes_soon(j, k, work, ahead):
    """Return where an open corner asks to close, or would do so a little later.

    The bias makes the law hold at one instant after the middle of the step. `ahead` is the time
    beyond that instant, over the time from the middle to it [1].
    """
    ux = (1.0 + ahead) * work.corner_rate[j, k, 0] - ahead * work.bias[j, k, 0]
    uy = (1.0 + ahead) * work.corner_rate[j, k, 1] - ahead * work.bias[j, k, 1]
    asks = (work.asked_contact[j, k] > 0.5) | (opening_rate(j, k, (ux, uy), work) < 0.0)
    return (work.contact[j, k] < 0.5) & (work.candidate[j, k] > 0.5) & asks


@inlined
def start_modes(state, work, where, expects):
    """Start a contact problem from the modes before the step, where `where` holds.

    Where `expects` holds, an open corner starts closed, and its joint sticking, if the velocities
    before the step would close it.
    """
    for j in range(state.slip.shape[0]):
        slide = state.slide[j]
        for k in range(2):
            ux, uy = corner_velocity(j, k, work.earlier, work)
            ahead = ux + work.bias[j, k, 0], uy + work.bias[j, k, 1]
            closes = expects & (along(laws.normal_of(j, work), ahead) < 0.0)
            contact = state.contact[j, k]
            closes = closes & (contact < 0.5) & (work.candidate[j, k] > 0.5)
            contact = select(closes, 1.0, contact)
            slide = select(closes, 0.0, slide)
            work.contact[j, k] = select(where, contact, work.contact[j, k])
        work.slide[j] = select(where, slide, work.slide[j])
    recall_pulls(state, work, where)


@kernel
def solve_contact(model, position, work, live, iterations, ahead, precision):
    """Solve one contact problem by Newton's iteration: each joint takes the mode it asks for.

    `live` masks the runs to solve. A run whose modes are not reconciled after `MOST_ITERATIONS` is
    given up: hardly any is later. Of runs side by side the slower half does not keep the others
    waiting: it goes on in the next call, from the modes that it has reached. `iterations` counts
    the linear problems of each run, with those of calls before. Where `ahead` is larger than -1, a
    run is refused after its first linear problem if a corner closes, or would in that time
    (`closes_soon`).

    Return the masks solved, refused and active (runs that go on), and iterations.
    """
    scale = velocity_scale(model, position, work)
    n_joint = work.slide.shape[0]
    limit = float(MOST_ITERATIONS + n_joint // ITERATION_PER_JOINTS)
    active = live
    reconciled = False
    refused = False
    first = 0
    while True:
        left = solve_with_pulls(model, position, work, scale, precision, first)
        slack = precision.slack * scale
        slack_force = precision.slack * largest_force(work)
        changed = ask_modes(model, work, slack, slack_force)
        changed = changed | ask_pulls(model, work, slack_force)
        looks = active & (iterations == 0.0) & (ahead > -1.0)
        if some(looks):
            for j in range(n_joint):
                for k in range(2):
                    refused = refused | (looks & closes_soon(j, k, work, ahead))
        iterations = iterations + flag(active)
        active = active & opposite(refused)
        reconciled = reconciled | (active & opposite(changed))
        active = active & changed & (iterations < limit)
        first = n_joint
        for j in range(n_joint):
            differs = work.asked_slide[j] != work.slide[j]
            for k in range(2):
                differs = differs | (work.asked_contact[j, k] != work.contact[j, k])
                work.contact[j, k] = select(
                    active, work.asked_contact[j, k], work.contact[j, k]
                )
            work.slide[j] = select(active, work.asked_slide[j], work.slide[j])
            if first == n_joint and some(active & differs):
                first = j
        take_asked(work, active)
        if 2 * count_of(active) <= count_of(live):
            break
    return reconciled & (left <= precision.left * scale), refused, active, iterations
