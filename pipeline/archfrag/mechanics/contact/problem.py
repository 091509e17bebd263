"""The contact problem of a state that is posed, whichever solver is used."""

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.blocks import FOR_STEPS
from archfrag.mechanics.contact.modes import reconcile_modes, velocity_scale
from archfrag.mechanics.contact.path import PATHS, SOFT_PATHS, solve_by_path
from archfrag.mechanics.status import Count

# Rounds in which all joints take the modes that they ask for; mostly these have been tried.
STRAIGHT = 1


@kernel
def solve_anyhow(model, state, work, path):
    """Solve a contact problem that is posed: by Newton's iteration, or by the solution's path.

    Parameters
    ----------
    model : archfrag.mechanics.model.Model
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
        With the contacts placed where the bodies are by `position`.
    path : archfrag.mechanics.contact.path.Path

    Returns
    -------
    solved, compliant : bool
        Compliant where the solution is that of slightly compliant joints.
    """
    count = state.count
    for j in range(state.slip.size):
        work.touch[j, 0], work.touch[j, 1] = state.touch[j, 0], state.touch[j, 1]
        work.slide[j], work.known[j] = state.slide[j], 0.0
    scale = velocity_scale(work.position, work)
    solved, made = reconcile_modes(model, work.position, work, scale, FOR_STEPS, STRAIGHT)
    count[Count.ITERATIONS] += made
    if solved:
        return True, False
    solved, compliant, rounds, breaks = solve_by_path(
        model, work.position, work, path, PATHS, SOFT_PATHS
    )
    count[Count.ITERATIONS] += rounds
    count[Count.PATHS] += breaks > 0
    count[Count.COMPLIANT] += compliant
    return solved, compliant
