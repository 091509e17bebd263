"""Thrust lines: where on the joints of an arch their reactions act, and curves between them."""

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.arch.geometry import cross
from archfrag.physics.state import Work


def contact_centres(work: Work, reaction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the contact centres (Eq 34): where on each joint the reaction has no moment [m]."""
    point = work.point
    normal = work.normal
    force = reaction[:, :2]
    arm = point[:, 0]
    press = np.einsum("jk,jk->j", force, normal)
    moment = reaction[:, 2] - (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])
    length = np.linalg.norm(point[:, 1] - point[:, 0], axis=1)
    loaded = press > 1e-12 * np.abs(reaction[:, :2]).max()
    fraction = np.full(press.size, np.nan)
    fraction[loaded] = -moment[loaded] / (press * length)[loaded]
    return point[:, 0] + fraction[:, None] * (point[:, 1] - point[:, 0])


def thrust_curve(arch: Arch, centre: NDArray, load: float) -> NDArray[np.float64]:
    """Return the thrust line through contact centres under weights and a steady load [g].

    Ties add forces to bodies; their lines between contact centres are straight.
    """
    chain = arch.chain
    if chain.tie is not None:
        return centre[np.isfinite(centre).all(axis=1)]
    body = arch.centroids
    force = chain.mass[:, None] * np.array([-load, -1.0])
    after = np.cumsum(
        force, axis=0
    )  # by which the force beyond each body exceeds the first one
    if arch.free_end:
        first = -after[-1]
        start = centre
        end = np.vstack([centre[1:], body[-1:]])
    else:
        # Moments of each body about the centre of its first joint are in equilibrium.
        start = centre[:-1]
        end = centre[1:]
        right = cross(body - start, force) - cross(end - start, after)
        left = np.column_stack([start[:, 1] - end[:, 1], end[:, 0] - start[:, 0]])
        known = np.isfinite(right)
        first = np.linalg.lstsq(left[known], right[known], rcond=None)[0]
    reaction = first + np.vstack([np.zeros(2), after[:-1]])
    turn = cross(reaction, force)
    along = np.abs(turn) < 1e-9 * np.linalg.norm(reaction, axis=1) * np.linalg.norm(
        force, axis=1
    )
    turn[along] = np.nan
    # The forces at the ends of a body meet on the line of its weight. Spread evenly, the weight
    # bends the line between them to a parabola that is tangent to both.
    corner = start + (cross(body - start, force) / turn)[:, None] * reaction
    # Where they meet beyond both ends, as in a pier almost along its weight, the line is straight.
    chord = end - start
    place = ((corner - start) * chord).sum(axis=1) / (chord**2).sum(axis=1)
    along |= ~((place > 0.0) & (place < 1.0))
    corner[along] = 0.5 * (start + end)[along]
    part = np.linspace(0.0, 1.0, 9)[:, None, None]
    line = (
        (1.0 - part) ** 2 * start + 2.0 * part * (1.0 - part) * corner + part**2 * end
    )
    line = line.swapaxes(0, 1).reshape(-1, 2)
    return line[np.isfinite(line).all(axis=1)]
