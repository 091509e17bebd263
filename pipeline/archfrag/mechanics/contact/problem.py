"""The contact problem of a state that is posed, by whichever way solves it."""

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.blocks import FOR_STEPS
from archfrag.mechanics.contact.modes import solve_contact
from archfrag.mechanics.contact.path import PATHS, SOFT_PATHS, solve_by_path
from archfrag.mechanics.status import Count


@kernel
def solve_anyhow(model, state, work, path):
    """Solve a contact problem that is posed: by Newton's iteration, or by the solution's path.

    Returns
    -------
    solved, compliant : bool
        Compliant where the solution is that of slightly compliant joints.
    """
    count = state.count
    for j in range(state.slip.size):
        work.touch[j, 0], work.touch[j, 1] = state.touch[j, 0], state.touch[j, 1]
        work.slide[j], work.known[j] = state.slide[j], 0.0
    patience = 60 + 4 * model.friction.size
    solved, _, rounds = solve_contact(
        model, state.position, work, True, (False, 0.0, 0.0), patience, FOR_STEPS
    )
    count[Count.ITERATIONS] += rounds
    if solved:
        return True, False
    solved, compliant, rounds, breaks = solve_by_path(
        model, state.position, work, path, PATHS, SOFT_PATHS
    )
    count[Count.ITERATIONS] += rounds
    count[Count.PATHS] += breaks > 0
    count[Count.COMPLIANT] += compliant
    return solved, compliant
