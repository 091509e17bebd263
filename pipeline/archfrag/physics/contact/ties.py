"""Ties: bars that only pull, between two bodies or between a body and the ground.

A tie is elastic up to its strength, then it yields; it is slack where it is shorter than without
a force, and breaks beyond an elongation. Its tension acts along the line between its ends.

In a step h of time stepping its mean tension is that of its mean elongation. Then an elastic tie
neither makes nor loses energy, however stiff it is. With e the elongation in the middle, by the
velocities before the step, and with the rates before (u) and after it (w), the impulse is

    h k (e - set + h/4 (rate(w) - rate(u))).

With k ties the contact problem is one of the same matrix changed by rank k: the answers of all
bodies and joints to a unit impulse of each tie, and k equations.
"""

import math

from archfrag.physics.contact import blocks
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import select
from archfrag.physics.numbers import larger, sine_cosine
from archfrag.physics.status import Tie, TieState, TieWork

SLACK = 0.0
TAUT = 1.0
YIELDS = 2.0
BROKEN = 3.0


@inlined
def _end(model, t, side, x, y, angle):
    """Return where an end of a tie is, of a body at x, y that has rotated."""
    s, c = sine_cosine(angle)
    a = model.tie[t, Tie.X_0 + 2 * side]
    b = model.tie[t, Tie.Y_0 + 2 * side]
    return x + c * a - s * b, y + s * a + c * b


@inlined
def _ends(model, t, position):
    """Return where the ends of a tie are, and the rows of its bodies."""
    i = int(model.tie[t, Tie.BODY_0])
    k = int(model.tie[t, Tie.BODY_1])
    px, py = _end(model, t, 0, position[i, 0], position[i, 1], position[i, 2])
    qx, qy = _end(model, t, 1, position[k, 0], position[k, 1], position[k, 2])
    return i, k, px, py, qx, qy


@kernel
def tie_stretch(model, t, position):
    """Return the elongation of a tie [m].

    Reads: model.tie, position.
    """
    _, _, px, py, qx, qy = _ends(model, t, position)
    length = math.sqrt((qx - px) * (qx - px) + (qy - py) * (qy - py))
    return length - model.tie[t, Tie.LENGTH]


@kernel
def place_tie(model, t, position, tie):
    """Set the direction and the arms of a tie, ``work.tie``; return its elongation [m].

    Reads: model.tie, position.
    Writes: tie.
    """
    i, k, px, py, qx, qy = _ends(model, t, position)
    dx = qx - px
    dy = qy - py
    length = math.sqrt(dx * dx + dy * dy)
    ux = dx / length
    uy = dy / length
    tie[t, TieWork.DX] = ux
    tie[t, TieWork.DY] = uy
    tie[t, TieWork.ARM_0] = (px - position[i, 0]) * uy - (py - position[i, 1]) * ux
    tie[t, TieWork.ARM_1] = (qx - position[k, 0]) * uy - (qy - position[k, 1]) * ux
    return length - model.tie[t, Tie.LENGTH]


@inlined
def stretch_rate(model, t, velocity, tie):
    """Return the rate at which a tie grows longer [m/s]."""
    i = int(model.tie[t, Tie.BODY_0])
    k = int(model.tie[t, Tie.BODY_1])
    rate = tie[t, TieWork.DX] * (velocity[k, 0] - velocity[i, 0])
    rate += tie[t, TieWork.DY] * (velocity[k, 1] - velocity[i, 1])
    return (
        rate
        + tie[t, TieWork.ARM_1] * velocity[k, 2]
        - tie[t, TieWork.ARM_0] * velocity[i, 2]
    )


@inlined
def _pull(model, t, impulse, tie, velocity):
    """Add to velocities what a tie's impulse gives to its bodies."""
    i = int(model.tie[t, Tie.BODY_0])
    k = int(model.tie[t, Tie.BODY_1])
    x = impulse * tie[t, TieWork.DX]
    y = impulse * tie[t, TieWork.DY]
    velocity[i, 0] += model.inverse_mass[i] * x
    velocity[i, 1] += model.inverse_mass[i] * y
    velocity[i, 2] += model.inverse_inertia[i] * (impulse * tie[t, TieWork.ARM_0])
    velocity[k, 0] -= model.inverse_mass[k] * x
    velocity[k, 1] -= model.inverse_mass[k] * y
    velocity[k, 2] -= model.inverse_inertia[k] * (impulse * tie[t, TieWork.ARM_1])


@inlined
def tension(model, t, state, elongation):
    """Return the tension of a tie in its present mode [N]."""
    mode = state.tie[t, TieState.MODE]
    strength = model.tie[t, Tie.STRENGTH]
    elastic = model.tie[t, Tie.STIFFNESS] * (elongation - state.tie[t, TieState.SET])
    return select(
        mode == TAUT, elastic, select(mode == YIELDS, strength, 0.0 * elastic)
    )


@inlined
def tie_energy(model, t, state, elongation):
    """Return the elastic energy of a tie [J]."""
    stretch = larger(elongation - state.tie[t, TieState.SET], 0.0)
    held = select(
        state.tie[t, TieState.MODE] == BROKEN, 0.0, model.tie[t, Tie.STIFFNESS]
    )
    return 0.5 * held * (stretch * stretch)


@kernel
def set_ties(model, state, work):
    """Let the ties of a state be taut or slack, without a set.

    Reads: model.tie, state.position.
    Writes: state.tie, work.tie.
    """
    for t in range(model.tie.shape[0]):
        elongation = place_tie(model, t, state.position, work.tie)
        state.tie[t, TieState.MODE] = TAUT if elongation >= 0.0 else SLACK
        state.tie[t, TieState.SET] = 0.0


@kernel
def pull_at_rest(model, state, work, pull):
    """Add the forces of ties where bodies are, `pull` (n_body + 2, 3) [N], [N m].

    Moments are about the centroids.

    Reads: model.tie, state (position, tie), work.tie.
    Writes: work.tie, pull.
    """
    for t in range(model.tie.shape[0]):
        force = tension(model, t, state, place_tie(model, t, state.position, work.tie))
        x = force * work.tie[t, TieWork.DX]
        y = force * work.tie[t, TieWork.DY]
        for side in range(2):
            i = int(model.tie[t, Tie.BODY_0 + side])
            sense = 1.0 - 2.0 * side
            pull[i, 0] += sense * x
            pull[i, 1] += sense * y
            pull[i, 2] += sense * force * work.tie[t, TieWork.ARM_0 + side]


@kernel
def pull_by_ties(model, state, work):
    """Add what the tensions of ties give to the accelerations ``work.free``; no impulses.

    Reads: model (inverse_inertia, inverse_mass, tie), state (position, tie), work.tie.
    Writes: work (free, tie).
    """
    for t in range(model.tie.shape[0]):
        force = tension(model, t, state, place_tie(model, t, state.position, work.tie))
        _pull(model, t, force, work.tie, work.free)
    release_ties(model, work)


@kernel
def aim_ties(model, state, work, step, ahead):
    """Set the impulses of ties over a step, linear in the velocities after it.

    The tension is that of the elongation in the middle, changed by so much of the step (`ahead`)
    times the change of its rate.

    Reads: model.tie, state (position, tie, velocity), work (position, tie).
    Writes: work.tie.
    """
    for t in range(model.tie.shape[0]):
        tie = work.tie
        stiffness = model.tie[t, Tie.STIFFNESS]
        energy = tie_energy(model, t, state, place_tie(model, t, state.position, tie))
        elongation = place_tie(model, t, work.position, tie)
        rate = stretch_rate(model, t, state.velocity, tie)
        gain = ahead * step * step * stiffness
        stretch = elongation - state.tie[t, TieState.SET]
        tie[t, TieWork.RATE] = rate
        tie[t, TieWork.ENERGY] = energy
        tie[t, TieWork.KNOWN] = step * stiffness * stretch - gain * rate
        tie[t, TieWork.GAIN] = gain
        tie[t, TieWork.MOST] = step * model.tie[t, Tie.STRENGTH]
        tie[t, TieWork.GUESS] = step * tension(model, t, state, elongation)


@kernel
def release_ties(model, work):
    """Let ties have no impulse in the next contact problem: an impact, or accelerations.

    Writes: work.tie.
    """
    for t in range(model.tie.shape[0]):
        for column in (
            TieWork.KNOWN,
            TieWork.GAIN,
            TieWork.MOST,
            TieWork.GUESS,
            TieWork.MODE,
        ):
            work.tie[t, column] = 0.0


@kernel
def start_ties(state, work, where):
    """Start from the modes of ties before the step.

    Reads: state.tie, work.tie.
    Writes: work.tie.
    """
    for t in range(state.tie.shape[0]):
        mode = work.tie[t, TieWork.MODE]
        work.tie[t, TieWork.MODE] = select(where, state.tie[t, TieState.MODE], mode)


@kernel
def push_by_ties(model, work, velocity, sense):
    """Add impulses by the tensions before a step to velocities, or take them away.

    Reads: model (inverse_inertia, inverse_mass, tie), work.tie.
    Writes: velocity.
    """
    for t in range(model.tie.shape[0]):
        _pull(model, t, sense * work.tie[t, TieWork.GUESS], work.tie, velocity)


@inlined
def _answer(model, position, work, t, where):
    """Find how bodies and joints answer a unit impulse of a tie, in the present modes."""
    row = work.row
    solved = work.solved
    n_row = position.shape[0]
    for i in range(n_row):
        solved[i, 0] = solved[i, 1] = solved[i, 2] = 0.0 * work.free[i, 0]
    for j in range(work.slide.shape[0]):
        work.reaction[j, 0] = work.reaction[j, 1] = work.reaction[j, 2] = (
            0.0 * solved[0, 0]
        )
    _pull(model, t, 1.0, work.tie, solved)
    for _ in range(2):  # what the compliance of the rows leaves is corrected once
        for j in range(work.slide.shape[0]):
            ux = solved[j + 1, 0] - solved[j, 0]
            uy = solved[j + 1, 1] - solved[j, 1]
            for a in range(3):
                rate = row[j, a, 0] * ux + row[j, a, 1] * uy
                rate += row[j, a, 2] * solved[j + 1, 2] - row[j, a, 3] * solved[j, 2]
                work.residual[j, a] = rate
        blocks.substitute(model, position, work, where)
    _keep(work, t, n_row)


@inlined
def _keep(work, place, n_row):
    """Keep velocities and reactions in ``work.tie_answer``."""
    for c in range(3):
        for i in range(n_row):
            work.tie_answer[place, i, c] = work.solved[i, c]
        for j in range(work.slide.shape[0]):
            work.tie_answer[place, n_row + j, c] = work.reaction[j, c]


@inlined
def _solve_impulses(model, work):
    """Solve the equations of all ties by elimination; their matrix is near a unit matrix."""
    n = model.tie.shape[0]
    system = work.tie_system
    tie = work.tie
    for t in range(n):
        taut = tie[t, TieWork.MODE] == TAUT
        gain = tie[t, TieWork.GAIN]
        held = select(tie[t, TieWork.MODE] == YIELDS, tie[t, TieWork.MOST], 0.0)
        for s in range(n):
            rate = stretch_rate(model, t, work.tie_answer[s], tie)
            own = 1.0 if s == t else 0.0
            system[t, s] = select(taut, own - gain * rate, own + 0.0 * gain)
        rate = stretch_rate(model, t, work.tie_answer[n], tie)
        system[t, n] = select(taut, tie[t, TieWork.KNOWN] + gain * rate, held)
    for t in range(n):
        for r in range(n):
            if r != t:
                factor = system[r, t] / system[t, t]
                for s in range(t, n + 1):
                    system[r, s] -= factor * system[t, s]
    for t in range(n):
        tie[t, TieWork.IMPULSE] = system[t, n] / system[t, t]


@kernel
def solve_with_ties(model, position, work, scale, precision, first):
    """Solve the contact problem in the present modes (`solve_modes`), with the impulses of ties."""
    left = blocks.solve_modes(model, position, work, scale, precision, first)
    n = model.tie.shape[0]
    n_row = position.shape[0]
    if n == 0:
        return left
    _keep(work, n, n_row)
    for t in range(n):
        _answer(model, position, work, t, left == left)
    _solve_impulses(model, work)
    for c in range(3):
        for i in range(n_row):
            work.solved[i, c] = work.tie_answer[n, i, c]
            for t in range(n):
                work.solved[i, c] += (
                    work.tie[t, TieWork.IMPULSE] * work.tie_answer[t, i, c]
                )
        for j in range(work.slide.shape[0]):
            work.reaction[j, c] = work.tie_answer[n, n_row + j, c]
            for t in range(n):
                answer = work.tie_answer[t, n_row + j, c]
                work.reaction[j, c] += work.tie[t, TieWork.IMPULSE] * answer
    return blocks.measure_residual(position, work)


@kernel
def ask_ties(model, work, slack_force):
    """Set the modes that ties ask for; return where one differs from its own.

    Reads: model.tie, work (solved, tie).
    Writes: work.tie.
    """
    changed = False
    for t in range(model.tie.shape[0]):
        tie = work.tie
        mode = tie[t, TieWork.MODE]
        most = tie[t, TieWork.MOST]
        rate = stretch_rate(model, t, work.solved, tie)
        trial = tie[t, TieWork.KNOWN] + tie[t, TieWork.GAIN] * rate
        tie[t, TieWork.TRIAL] = trial
        low = select(mode == SLACK, slack_force, -slack_force)
        high = select(mode == YIELDS, most - slack_force, most + slack_force)
        asked = select(trial < low, SLACK, select(trial > high, YIELDS, TAUT))
        tie[t, TieWork.ASKED] = select(mode == BROKEN, BROKEN, asked)
        changed = changed | (tie[t, TieWork.ASKED] != mode)
    return changed


@inlined
def take_asked(work, where):
    """Take the modes that ties ask for."""
    for t in range(work.tie.shape[0]):
        mode = work.tie[t, TieWork.MODE]
        asked = work.tie[t, TieWork.ASKED]
        work.tie[t, TieWork.MODE] = select(where, asked, mode)


@kernel
def accept_ties(model, state, work, step, where):
    """Accept the modes and sets of ties after a step; return works by yield, unexplained [J].

    What breaks gives up its energy.

    Reads: model.tie, state (position, tie), work (solved, tie).
    Writes: state.tie, work.tie.
    """
    lost = 0.0 * step
    error = 0.0 * step
    for t in range(model.tie.shape[0]):
        tie = work.tie
        stiffness = model.tie[t, Tie.STIFFNESS]
        mode = tie[t, TieWork.MODE]
        impulse = tie[t, TieWork.IMPULSE]
        mean = 0.5 * (tie[t, TieWork.RATE] + stretch_rate(model, t, work.solved, tie))
        grows = select(
            mode == YIELDS, tie[t, TieWork.TRIAL] - tie[t, TieWork.MOST], 0.0
        )
        grows = grows / (step * stiffness)
        yielded = select(mode == YIELDS, model.tie[t, Tie.STRENGTH], 0.0) * grows
        set_now = state.tie[t, TieState.SET] + grows
        state.tie[t, TieState.SET] = select(where, set_now, state.tie[t, TieState.SET])
        state.tie[t, TieState.MODE] = select(where, mode, state.tie[t, TieState.MODE])
        elongation = place_tie(model, t, state.position, tie)
        energy = tie_energy(model, t, state, elongation)
        breaks = where & (elongation > model.tie[t, Tie.RUPTURE]) & (mode != BROKEN)
        state.tie[t, TieState.MODE] = select(
            breaks, BROKEN, state.tie[t, TieState.MODE]
        )
        lost -= yielded + select(breaks, energy, 0.0)
        error += energy + yielded - tie[t, TieWork.ENERGY] - impulse * mean
    return lost, error


@kernel
def change_tie(model, state, t, yields, breaks):
    """Change the mode of a tie whose law has ended; return the energy that it gives up [J].

    One that is taut becomes slack unless it `yields` or `breaks`, any other one becomes taut.

    Reads: model.tie, state (position, tie).
    Writes: state.tie.
    """
    mode = state.tie[t, TieState.MODE]
    if breaks:
        lost = tie_energy(model, t, state, tie_stretch(model, t, state.position))
        state.tie[t, TieState.MODE] = BROKEN
        return lost
    taut = YIELDS if yields else SLACK
    state.tie[t, TieState.MODE] = taut if mode == TAUT else TAUT
    return 0.0


@kernel
def stretch_yielding(model, state):
    """Let the sets of ties that yield follow their elongation; return what that takes [J].

    Reads: model.tie, state (position, tie).
    Writes: state.tie.
    """
    lost = 0.0
    for t in range(model.tie.shape[0]):
        if state.tie[t, TieState.MODE] != YIELDS:
            continue
        strength = model.tie[t, Tie.STRENGTH]
        longer = (
            tie_stretch(model, t, state.position)
            - strength / model.tie[t, Tie.STIFFNESS]
        )
        lost += strength * (longer - state.tie[t, TieState.SET])
        state.tie[t, TieState.SET] = longer
    return lost
