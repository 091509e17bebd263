"""Move an arch so slowly that it is in equilibrium at every instant.

A step of such a motion is the contact problem of a time step in which bodies have no velocity
before it: M w = h S + H r. With h so long that M w is small beside h S, forces are in equilibrium,
and h w is how far the bodies move. Springings move by their joint faces.
"""

from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact import placing
from archfrag.physics.contact.blocks import EXACT
from archfrag.physics.contact.modes import solve_contact
from archfrag.physics.contact.path import copy_modes, solve_with_fallback
from archfrag.physics.contact.ties import accept_pulls, aim_pulls, recall_pulls
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.numbers import flag
from archfrag.physics.steps.step import offset_of

# Corners nearer than this part of the joint's length may close in a step.
NEAR = 0.02


@kernel
def creep(model, state, work, path, step, loss_limit):
    """Make one step of a slow motion under gravity.

    Returns whether its contact problem is solved, the largest displacement of a centroid in it
    [m], and whether a joint has lost its contact for good.
    """
    end = state.position.shape[0] - 1
    for i in range(1, end):
        work.free[i, 0] = 0.0
        work.free[i, 1] = -step * model.gravity
        work.free[i, 2] = 0.0
        for c in range(3):
            work.position[i, c] = state.position[i, c]
    placing.place_chain(model, work.position, state, 0.0, work.slip, work)
    for j in range(state.slip.size):
        work.known[j] = 0.0
        nx = work.normal[j, 0]
        ny = work.normal[j, 1]
        for k in range(2):
            ex, ey = offset_of(j, k, model, work)
            work.bias[j, k, 0] = ex / step
            work.bias[j, k, 1] = ey / step
            work.candidate[j, k] = flag(nx * ex + ny * ey < NEAR * model.length[j])
    aim_pulls(model, state, work, step, 1.0)
    copy_modes(state, work)
    recall_pulls(state, work, True)
    solved, _, _, _ = solve_contact(model, work.position, work, True, 0.0, -1.0, EXACT)
    if not solved:
        solved, _ = solve_with_fallback(model, state, work, path)
    farthest = 0.0
    for i in range(1, end):
        for c in range(3):
            state.position[i, c] += step * work.solved[i, c]
        farthest = max(
            farthest, step * abs(work.solved[i, 0]), step * abs(work.solved[i, 1])
        )
    placing.move_faces(model, state.position, work)
    accept_pulls(model, state, work, step, True)
    collapsed = follow_joints(model, state, work, True, loss_limit)
    return solved, farthest, collapsed
