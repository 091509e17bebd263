"""Forces of ties on mega-voussoirs, and on the voussoirs inside them."""

import math

from archfrag.physics.contact.ties import tension
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.status import Tie


@inlined
def _tie_end(mega, t, side, position, velocity):
    """Return voussoir and mega-voussoir at an end of a tie, the end's arm and its velocity."""
    tie = mega.model.tie
    i = int(tie[t, Tie.BODY_0 + side])
    k = mega.group[i]
    c = mega.work.rotated[k, 0]
    s = mega.work.rotated[k, 1]
    x = mega.offset[i, 0] + tie[t, Tie.X_0 + 2 * side]
    y = mega.offset[i, 1] + tie[t, Tie.Y_0 + 2 * side]
    x, y, spin = c * x - s * y, s * x + c * y, velocity[k, 2]
    return i, k, x, y, velocity[k, 0] - spin * y, velocity[k, 1] + spin * x


@kernel
def pull_mega_voussoirs(mega, position, velocity):
    """Add what ties give to the accelerations ``work.free`` of mega-voussoirs, after `pose`.

    Elongations are left in ``mega.stretch``, forces on voussoirs in ``mega.pull``.

    Writes: mega (pull, stretch, work.free).
    """
    tie = mega.model.tie
    free = mega.work.free
    model = mega.model
    for t in range(tie.shape[0]):
        for side in range(2):
            for c in range(3):
                mega.pull[int(tie[t, Tie.BODY_0 + side]), c] = 0.0
    for t in range(tie.shape[0]):
        _, k, px, py, vx, vy = _tie_end(mega, t, 0, position, velocity)
        _, m, qx, qy, wx, wy = _tie_end(mega, t, 1, position, velocity)
        dx = position[m, 0] + qx - position[k, 0] - px
        dy = position[m, 1] + qy - position[k, 1] - py
        length = math.sqrt(dx * dx + dy * dy)
        dx = dx / length
        dy = dy / length
        mega.stretch[t, 0] = length - tie[t, Tie.LENGTH]
        mega.stretch[t, 1] = dx * (wx - vx) + dy * (wy - vy)
        force = tension(model, t, mega, mega.stretch[t, 0])
        for side in range(2):
            i, k, x, y, _, _ = _tie_end(mega, t, side, position, velocity)
            sense = 1.0 - 2.0 * side
            fx = sense * force * dx
            fy = sense * force * dy
            moment = x * fy - y * fx
            c = mega.work.rotated[k, 0]
            s = mega.work.rotated[k, 1]
            free[k, 0] += model.inverse_mass[k] * fx
            free[k, 1] += model.inverse_mass[k] * fy
            free[k, 2] += model.inverse_inertia[k] * moment
            mega.pull[i, 0] += c * fx + s * fy
            mega.pull[i, 1] += c * fy - s * fx
            mega.pull[i, 2] += moment
