"""The contact problem of a state that is posed, along the solution's path."""

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.path import copy_modes, solve_by_path
from archfrag.mechanics.status import Count


@kernel
def solve_anyhow(model, state, work, path):
    """Solve a contact problem that is posed along paths, the first from the state's own modes.

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
    copy_modes(state, work)
    for j in range(work.slide.size):
        work.known[j] = 0.0
    solved, compliant, rounds, breaks = solve_by_path(model, work.position, work, path, False)
    count[Count.ITERATIONS] += rounds + breaks
    count[Count.PATHS] += breaks > 0
    count[Count.COMPLIANT] += compliant
    return solved, compliant
