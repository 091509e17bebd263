"""Ties: bars that only pull, between two bodies or between a body and the ground.

A tie is elastic up to its strength, then it yields. It is slack if it is shorter than its length
without a force, and breaks beyond a given elongation. Its tension acts along the line between its
ends.

In a step h of time stepping its mean tension is that of its mean elongation. Then an elastic tie
neither makes nor loses energy, however stiff it is. With e the elongation in the middle, by the
velocities before the step, and with the rates before (u) and after it (w), the impulse is

    h k (e - set + h/4 (rate(w) - rate(u))).

With n ties the contact problem has the same matrix, changed by rank n: it is solved by the answers
of all bodies and joints to a unit impulse of each tie, and n equations.
"""

import math

from archfrag.physics.contact import blocks, laws
from archfrag.physics.contact.laws import along, cross
from archfrag.physics.contact.placing import inwards, outwards
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import select
from archfrag.physics.neighbours import row_of
from archfrag.physics.numbers import copy_rows, larger, sine_cosine
from archfrag.physics.state import Model
from archfrag.physics.status import Tie, TieMode, TieState, TieWork


@inlined
def _end(tie, side, body):
    """Return where end `side`, 0 or 1, of a tie is.

    `tie` is its row in ``Model.tie``, `body` the position of the body there, which may have
    rotated.
    """
    s, c = sine_cosine(body[2])
    a = tie[Tie.X_0 + 2 * side]
    b = tie[Tie.Y_0 + 2 * side]
    return body[0] + c * a - s * b, body[1] + s * a + c * b


@inlined
def _ends(model, t, bodies):
    """Return the rows of `bodies` for the two bodies that tie `t` joins."""
    tie = model.tie[t]
    return bodies[int(tie[Tie.BODY_0])], bodies[int(tie[Tie.BODY_1])]


@inlined
def _line(model, t, position):
    """Return the elongation of tie `t` [m], its unit vector from end 0 to end 1, and two moments.

    The moments are those of the unit vector about the bodies' centroids [m].
    """
    tie = model.tie[t]
    before, after = _ends(model, t, position)
    p = _end(tie, 0, before)
    q = _end(tie, 1, after)
    dx = q[0] - p[0]
    dy = q[1] - p[1]
    length = math.sqrt(dx * dx + dy * dy)
    unit = dx / length, dy / length
    arm_0 = cross((p[0] - before[0], p[1] - before[1]), unit)
    arm_1 = cross((q[0] - after[0], q[1] - after[1]), unit)
    return length - tie[Tie.LENGTH], unit, arm_0, arm_1


@kernel
def tie_stretch(model, t, position):
    """Return the elongation of a tie [m].

    Reads: model.tie, position.
    """
    return _line(model, t, position)[0]


@kernel
def place_tie(model, t, position, tie):
    """Set the direction and the lever arms of tie `t`; return its elongation [m].

    They go into its row of `tie`, (n_tie, len(TieWork)).

    Reads: model.tie, position.
    Writes: tie.
    """
    stretch, unit, arm_0, arm_1 = _line(model, t, position)
    tie[t, TieWork.DX] = unit[0]
    tie[t, TieWork.DY] = unit[1]
    tie[t, TieWork.ARM_0] = arm_0
    tie[t, TieWork.ARM_1] = arm_1
    return stretch


@inlined
def stretch_rate(model, t, velocity, work):
    """Return the rate at which tie `t` grows longer with the bodies' velocities [m/s]."""
    before, after = _ends(model, t, velocity)
    tie = work.tie[t]
    apart = after[0] - before[0], after[1] - before[1]
    rate = along((tie[TieWork.DX], tie[TieWork.DY]), apart)
    return rate + tie[TieWork.ARM_1] * after[2] - tie[TieWork.ARM_0] * before[2]


@inlined
def _wrench(model, t, side, impulse, work):
    """Return the row of the body at end `side` of tie `t`, and what `impulse` of the tie gives it.

    That is an impulse (x, y), and its moment about the centroid.
    """
    tie = work.tie[t]
    given = impulse if side == 0 else -impulse
    x = given * tie[TieWork.DX]
    y = given * tie[TieWork.DY]
    moment = given * tie[TieWork.ARM_0 + side]
    return int(model.tie[t, Tie.BODY_0 + side]), x, y, moment


@inlined
def _pull(model, t, impulse, work, velocity):
    """Add to `velocity` what `impulse` of tie `t` gives to its two bodies."""
    for side in range(2):
        i, x, y, moment = _wrench(model, t, side, impulse, work)
        velocity[i, 0] += model.inverse_mass[i] * x
        velocity[i, 1] += model.inverse_mass[i] * y
        velocity[i, 2] += model.inverse_inertia[i] * moment


@inlined
def tension(model, t, state, elongation):
    """Return the tension of tie `t` at an elongation [m] in its present mode [N]."""
    tie = model.tie[t]
    mode = state.tie[t, TieState.MODE]
    elastic = tie[Tie.STIFFNESS] * (elongation - state.tie[t, TieState.SET])
    yields = select(mode == TieMode.YIELDS, tie[Tie.STRENGTH], 0.0 * elastic)
    return select(mode == TieMode.TAUT, elastic, yields)


@inlined
def _placed_tension(model, t, state, work):
    return tension(model, t, state, place_tie(model, t, state.position, work.tie))


@inlined
def tie_energy(model, t, state, elongation):
    """Return the elastic energy of tie `t` at an elongation [m] in its present mode [J]."""
    stretch = larger(elongation - state.tie[t, TieState.SET], 0.0)
    mode = state.tie[t, TieState.MODE]
    held = select(mode == TieMode.RUPTURED, 0.0, model.tie[t, Tie.STIFFNESS])
    return 0.5 * held * (stretch * stretch)


@inlined
def is_pulled(model):
    """Return whether there are ties."""
    return model.tie.shape[0] > 0


def pull_count(model: Model) -> int:
    """Return how many ties there are."""
    return len(model.tie)


@inlined
def add_stored(model, state, potential):
    """Return `potential` plus the elastic energy of all ties [J]."""
    for t in range(model.tie.shape[0]):
        potential += tie_energy(model, t, state, tie_stretch(model, t, state.position))
    return potential


@kernel
def reset_pulls(model, state, work):
    """Set the ties of a state taut or slack by where its bodies are, as if they had never yielded.

    Reads: model.tie, state.position.
    Writes: state.tie, work.tie.
    """
    for t in range(model.tie.shape[0]):
        elongation = place_tie(model, t, state.position, work.tie)
        state.tie[t, TieState.MODE] = (
            TieMode.TAUT if elongation >= 0.0 else TieMode.SLACK
        )
        state.tie[t, TieState.SET] = 0.0


@kernel
def pull_at_rest(model, state, work, pull):
    """Add the forces of ties on bodies in the present state to `pull`, (n_body + 2, 3) [N], [N m].

    Moments are about the centroids.

    Reads: model.tie, state (position, tie), work.tie.
    Writes: work.tie, pull.
    """
    for t in range(model.tie.shape[0]):
        force = _placed_tension(model, t, state, work)
        for side in range(2):
            i, x, y, moment = _wrench(model, t, side, force, work)
            pull[i, 0] += x
            pull[i, 1] += y
            pull[i, 2] += moment


@kernel
def pull_bodies(model, state, work):
    """Add the accelerations that ties give in the present state to ``work.free``.

    In the contact problem ties then have no impulses.

    Reads: model (inverse_inertia, inverse_mass, tie), state (position, tie), work.tie.
    Writes: work (free, tie).
    """
    for t in range(model.tie.shape[0]):
        _pull(model, t, _placed_tension(model, t, state, work), work, work.free)
    release_pulls(work)


@kernel
def aim_pulls(model, state, work, step, ahead):
    """Set the impulses of ties over a step, linear in the velocities after it.

    The mean tension is that of the elongation in the middle, plus `ahead` times the step times the
    change of its rate.

    Reads: model.tie, state (position, tie, velocity), work (position, tie).
    Writes: work.tie.
    """
    for t in range(model.tie.shape[0]):
        tie = work.tie[t]
        rigidity = model.tie[t, Tie.STIFFNESS]
        before = place_tie(model, t, state.position, work.tie)
        tie[TieWork.ENERGY] = tie_energy(model, t, state, before)
        elongation = place_tie(model, t, work.position, work.tie)
        rate = stretch_rate(model, t, state.velocity, work)
        gain = ahead * step * step * rigidity
        stretch = elongation - state.tie[t, TieState.SET]
        tie[TieWork.RATE] = rate
        tie[TieWork.KNOWN] = step * rigidity * stretch - gain * rate
        tie[TieWork.GAIN] = gain
        tie[TieWork.MOST] = step * model.tie[t, Tie.STRENGTH]
        tie[TieWork.GUESS] = step * tension(model, t, state, elongation)


@inlined
def release_pulls(work):
    """Let ties have no impulse in the next contact problem, of an impact or of accelerations."""
    work.tie[:] = 0.0


@kernel
def recall_pulls(state, work, where):
    """Start the contact problem from the modes of ties before the step, where `where` holds.

    Reads: state.tie, work.tie.
    Writes: work.tie.
    """
    for t in range(state.tie.shape[0]):
        tie = work.tie[t]
        mode = state.tie[t, TieState.MODE]
        tie[TieWork.MODE] = select(where, mode, tie[TieWork.MODE])


@kernel
def push_by_pulls(model, work, velocity, sense):
    """Add the impulses of the ties to the velocities (`sense` 1), or subtract them (-1).

    The impulses are those by the tensions in the modes before the step.

    Reads: model (inverse_inertia, inverse_mass, tie), work.tie.
    Writes: velocity.
    """
    for t in range(model.tie.shape[0]):
        _pull(model, t, sense * work.tie[t, TieWork.GUESS], work, velocity)


@inlined
def _answer(model, position, work, t, where):
    """Find how bodies and joints answer a unit impulse of tie `t`, in the present modes.

    The answer goes into row `t` of ``work.tie_answer``; it holds where `where` does.
    """
    row = work.row
    solved = work.solved
    solved[:] = 0.0
    work.reaction[:] = 0.0
    _pull(model, t, 1.0, work, solved)
    for _ in range(2):  # what the compliance of the rows leaves is corrected once
        for j in range(work.slide.shape[0]):
            i = row_of(model, j, 0)
            k = row_of(model, j, 1)
            ux = solved[k, 0] - solved[i, 0]
            uy = solved[k, 1] - solved[i, 1]
            for a in range(3):
                rate = row[j, a, 0] * ux + row[j, a, 1] * uy
                rate += row[j, a, 2] * solved[k, 2] - row[j, a, 3] * solved[i, 2]
                work.residual[j, a] = rate
        blocks.substitute(model, position, work, where)
    _keep(work, t)


@inlined
def _keep(work, place):
    """Copy velocities and reactions into row `place` of ``work.tie_answer``."""
    n_row = work.solved.shape[0]
    answer = work.tie_answer[place]
    copy_rows(work.solved, answer, 0, n_row)
    copy_rows(work.reaction, answer[n_row:], 0, work.reaction.shape[0])


@inlined
def _sum_answers(work, first, out):
    """Set `out` to the solution without ties plus the answers to the impulses of all ties.

    Its first row is row `first` of each answer.
    """
    answer = work.tie_answer
    n = work.tie.shape[0]
    for i in range(out.shape[0]):
        for c in range(3):
            out[i, c] = answer[n, first + i, c]
            for t in range(n):
                out[i, c] += work.tie[t, TieWork.IMPULSE] * answer[t, first + i, c]


@inlined
def _solve_impulses(model, work):
    """Find the impulses of all ties by elimination; the matrix is near a unit matrix."""
    n = model.tie.shape[0]
    system = work.tie_system
    for t in range(n):
        tie = work.tie[t]
        taut = tie[TieWork.MODE] == TieMode.TAUT
        gain = tie[TieWork.GAIN]
        for s in range(n + 1):
            rate = stretch_rate(model, t, work.tie_answer[s], work)
            if s == n:
                held = select(
                    tie[TieWork.MODE] == TieMode.YIELDS, tie[TieWork.MOST], 0.0
                )
                system[t, s] = select(taut, tie[TieWork.KNOWN] + gain * rate, held)
            else:
                own = 1.0 if s == t else 0.0
                system[t, s] = select(taut, own - gain * rate, own + 0.0 * gain)
    for t in range(n):
        for r in range(n):
            if r != t:
                factor = system[r, t] / system[t, t]
                for s in range(t, n + 1):
                    system[r, s] -= factor * system[t, s]
    for t in range(n):
        work.tie[t, TieWork.IMPULSE] = system[t, n] / system[t, t]


@kernel
def solve_with_pulls(model, position, work, scale, precision, first):
    """Solve the contact problem in the present modes, with the impulses of ties.

    Arguments and result are those of `solve_modes`.
    """
    left = blocks.solve_modes(model, position, work, scale, precision, first)
    n = model.tie.shape[0]
    if n == 0:
        return left
    _keep(work, n)
    for t in range(n):
        _answer(model, position, work, t, left == left)
    _solve_impulses(model, work)
    _sum_answers(work, 0, work.solved)
    _sum_answers(work, position.shape[0], work.reaction)
    return blocks.measure_residual(model, position, work)


@kernel
def ask_pulls(model, work, slack_force):
    """Set the modes that ties ask for; return where a tie asks for another one.

    Impulses up to `slack_force` beyond a limit count as within it.

    Reads: model.tie, work (solved, tie).
    Writes: work.tie.
    """
    changed = False
    for t in range(model.tie.shape[0]):
        tie = work.tie[t]
        mode = tie[TieWork.MODE]
        most = tie[TieWork.MOST]
        rate = stretch_rate(model, t, work.solved, work)
        trial = tie[TieWork.KNOWN] + tie[TieWork.GAIN] * rate
        tie[TieWork.TRIAL] = trial
        low = select(mode == TieMode.SLACK, slack_force, -slack_force)
        high = select(mode == TieMode.YIELDS, most - slack_force, most + slack_force)
        asked = select(
            trial < low,
            TieMode.SLACK,
            select(trial > high, TieMode.YIELDS, TieMode.TAUT),
        )
        tie[TieWork.ASKED] = select(mode == TieMode.RUPTURED, TieMode.RUPTURED, asked)
        changed = changed | (tie[TieWork.ASKED] != mode)
    return changed


@inlined
def take_asked(work, where):
    """Take the modes that ties ask for, where `where` holds."""
    for t in range(work.tie.shape[0]):
        tie = work.tie[t]
        tie[TieWork.MODE] = select(where, tie[TieWork.ASKED], tie[TieWork.MODE])


@kernel
def accept_pulls(model, state, work, step, where):
    """Accept the modes of ties after a step, and the elongation that stays; return two works [J].

    The first, at most zero, is what ties lose: by yielding, and the energy of those that break.
    The second is the error of their work.

    Reads: model.tie, state (position, tie), work (solved, tie).
    Writes: state.tie, work.tie.
    """
    lost = 0.0 * step
    error = 0.0 * step
    for t in range(model.tie.shape[0]):
        law = model.tie[t]
        tie = work.tie[t]
        own = state.tie[t]
        mode = tie[TieWork.MODE]
        yields = mode == TieMode.YIELDS
        mean = 0.5 * (tie[TieWork.RATE] + stretch_rate(model, t, work.solved, work))
        grows = select(yields, tie[TieWork.TRIAL] - tie[TieWork.MOST], 0.0)
        grows = grows / (step * law[Tie.STIFFNESS])
        yielded = select(yields, law[Tie.STRENGTH], 0.0) * grows
        before = own[TieState.SET]
        own[TieState.SET] = select(where, before + grows, before)
        own[TieState.MODE] = select(where, mode, own[TieState.MODE])
        elongation = place_tie(model, t, state.position, work.tie)
        energy = tie_energy(model, t, state, elongation)
        breaks = where & (elongation > law[Tie.RUPTURE]) & (mode != TieMode.RUPTURED)
        own[TieState.MODE] = select(breaks, TieMode.RUPTURED, own[TieState.MODE])
        lost -= yielded + select(breaks, energy, 0.0)
        error += energy + yielded - tie[TieWork.ENERGY] - tie[TieWork.IMPULSE] * mean
    return lost, error


@kernel
def change_pull(model, state, t, yields, breaks):
    """Change the mode of tie `t`, whose law has ended; return the energy that it gives up [J].

    If `breaks` it ruptures. Else one that is taut yields if `yields` and becomes slack if not; any
    other one becomes taut.

    Reads: model.tie, state (position, tie).
    Writes: state.tie.
    """
    own = state.tie[t]
    if breaks:
        lost = tie_energy(model, t, state, tie_stretch(model, t, state.position))
        own[TieState.MODE] = TieMode.RUPTURED
        return lost
    taut = TieMode.YIELDS if yields else TieMode.SLACK
    own[TieState.MODE] = taut if own[TieState.MODE] == TieMode.TAUT else TieMode.TAUT
    return 0.0


@kernel
def stretch_yielding(model, state):
    """Let ties that yield keep their present elongation; return the energy that this takes [J].

    Reads: model.tie, state (position, tie).
    Writes: state.tie.
    """
    lost = 0.0
    for t in range(model.tie.shape[0]):
        tie = model.tie[t]
        own = state.tie[t]
        if own[TieState.MODE] == TieMode.YIELDS:
            strength = tie[Tie.STRENGTH]
            longer = tie_stretch(model, t, state.position)
            longer = longer - strength / tie[Tie.STIFFNESS]
            lost += strength * (longer - own[TieState.SET])
            own[TieState.SET] = longer
    return lost


@inlined
def _end_on_mega(mega, t, side, position, velocity):
    """Return voussoir, mega-voussoir, place (x, y) and velocity (x, y) at an end of tie `t`.

    `side` is the end, 0 or 1. The place is counted from the mega-voussoir's centroid.
    """
    tie = mega.model.tie[t]
    i = int(tie[Tie.BODY_0 + side])
    k = mega.group[i]
    a = mega.offset[i, 0] + tie[Tie.X_0 + 2 * side]
    b = mega.offset[i, 1] + tie[Tie.Y_0 + 2 * side]
    x, y = outwards(mega.work, k, a, b)
    spin = velocity[k, 2]
    return i, k, x, y, velocity[k, 0] - spin * y, velocity[k, 1] + spin * x


@kernel
def pull_mega_voussoirs(mega, position, velocity):
    """Add the accelerations that ties give to mega-voussoirs to ``work.free``, after `pose`.

    Elongations are left in ``mega.stretch``, forces on voussoirs in ``mega.pull``.

    Writes: mega (pull, stretch, work.free).
    """
    free = mega.work.free
    model = mega.model
    if is_pulled(model):
        mega.pull[:] = 0.0
    for t in range(model.tie.shape[0]):
        first = _end_on_mega(mega, t, 0, position, velocity)
        second = _end_on_mega(mega, t, 1, position, velocity)
        _, k, px, py, vx, vy = first
        _, m, qx, qy, wx, wy = second
        dx = position[m, 0] + qx - position[k, 0] - px
        dy = position[m, 1] + qy - position[k, 1] - py
        length = math.sqrt(dx * dx + dy * dy)
        dx = dx / length
        dy = dy / length
        mega.stretch[t, 0] = length - model.tie[t, Tie.LENGTH]
        mega.stretch[t, 1] = dx * (wx - vx) + dy * (wy - vy)
        force = tension(model, t, mega, mega.stretch[t, 0])
        for sense, (i, k, x, y, _, _) in ((1.0, first), (-1.0, second)):
            fx = sense * force * dx
            fy = sense * force * dy
            moment = x * fy - y * fx
            free[k, 0] += model.inverse_mass[k] * fx
            free[k, 1] += model.inverse_mass[k] * fy
            free[k, 2] += model.inverse_inertia[k] * moment
            fx, fy = inwards(mega.work, k, fx, fy)
            mega.pull[i, 0] += fx
            mega.pull[i, 1] += fy
            mega.pull[i, 2] += moment


@inlined
def set_pull_margins(mega, motion):
    """Set the margins of ties, in the rows of ``motion.value`` behind those of joints.

    A taut tie has its tension and what is left to its strength, a slack one the force that it
    lacks, one that yields its rate, and all what is left to rupture.
    """
    first = motion.model.friction.size
    for t in range(mega.model.tie.shape[0]):
        tie = mega.model.tie[t]
        value = motion.value[first + t]
        mode = mega.tie[t, TieState.MODE]
        stretch = mega.stretch[t, 0]
        rigidity = motion.per_weight * tie[Tie.STIFFNESS]
        elastic = rigidity * (stretch - mega.tie[t, TieState.SET])
        if mode == TieMode.TAUT:
            value[laws.FORCE_0] = elastic
            value[laws.FORCE_1] = motion.per_weight * tie[Tie.STRENGTH] - elastic
        elif mode == TieMode.SLACK:
            value[laws.FORCE_0] = -elastic
        elif mode == TieMode.YIELDS:
            value[laws.SLIP_END] = laws.SLIP_WEIGHT * mega.stretch[t, 1] / motion.speed
        if mode != TieMode.RUPTURED:
            value[laws.FRICTION_PLUS] = rigidity * (tie[Tie.RUPTURE] - stretch)
