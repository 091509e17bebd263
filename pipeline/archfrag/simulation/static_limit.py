"""How far an arch can rotate, slowly, along its mechanism before it falls by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.simulation.rest import Hinge, Onset

FloatArray = NDArray[np.float64]
_POSITIONS = 4000  # of the mechanism that are looked at
_LARGEST = 0.5 * np.pi  # rotation of the first body [rad]


def static_limit(arch: Arch, start: Onset) -> float:
    """Rotation at which the mechanism of onset is in unstable equilibrium under its weight.

    Beyond it the arch falls though the ground is at rest, if its hinges stay where they are. It
    is the rotation of the voussoir that rotates most where the potential energy of the four-hinge
    linkage (of the one body of a block or a column) is largest: of a block the angle between its
    diagonal and its side, arctan(width / height).

    Parameters
    ----------
    arch : Arch
    start : Onset
        Of `archfrag.onset`.

    Returns
    -------
    float
        The smaller of those of the two mechanisms [rad]; nan where they slide, or are neither
        one hinge below a free end nor four hinges.

    Examples
    --------
    >>> import archfrag as af
    >>> from archfrag.simulation.static_limit import static_limit
    >>> block = af.Block(width=0.2, height=1.0, friction=0.8)
    >>> round(static_limit(block, af.onset(block)), 4)  # arctan(0.2)
    0.1974
    """
    ends = ((start.hinges, start.sliding), (start.hinges_minus, start.sliding_minus))
    limits = [_limit(arch, hinges) for hinges, sliding in ends if hinges and not sliding]
    known = [limit for limit in limits if np.isfinite(limit)]
    return min(known, default=np.nan)


def _limit(arch: Arch, hinges: list[Hinge]) -> float:
    points = np.array(
        [(arch.intrados if side == "intrados" else arch.extrados)[joint] for joint, side in hinges]
    )
    joints = [joint for joint, _ in hinges]
    if arch.free_end and len(hinges) == 1:
        joints.append(arch.n_voussoir)
    elif len(hinges) != 4:
        return np.nan
    least = np.inf
    for sense in (1.0, -1.0):
        angle = sense * np.linspace(0.0, _LARGEST, _POSITIONS)
        placed = _linkage(points, angle) if len(points) == 4 else [(points[0], angle)]
        energy = np.zeros(angle.size)
        for pivot, (moved, rotation), first, last in zip(points, placed, joints, joints[1:]):
            arm = arch.chain.centroid[first:last] - pivot
            lift = np.sin(rotation)[:, None] * arm[:, 0] + np.cos(rotation)[:, None] * arm[:, 1]
            height = np.broadcast_to(moved, (angle.size, 2))[:, 1]
            energy += (lift + height[:, None]) @ arch.chain.mass[first:last]
        left = np.isfinite(energy)
        end = int(np.argmin(left)) if not left.all() else angle.size
        rise = np.diff(energy[:end])
        # Only in one sense does the weight resist.
        if rise.size and rise[0] > 0.0:
            past = rise <= 0.0
            top = int(np.argmax(past)) if past.any() else rise.size
            # The energy is a parabola about its top: its slope vanishes between two positions.
            part = 0.5 + rise[top - 1] / (rise[top - 1] - rise[top]) if past.any() else 0.0
            place = top - 1 + part if past.any() else float(top)
            reached = [np.interp(place, np.arange(end), np.abs(r[:end])) for _, r in placed]
            least = min(least, float(max(reached)))
    return least if np.isfinite(least) else np.nan


def _linkage(points: FloatArray, angle: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Where the first hinge of each of three bars is and how far the bar has rotated.

    The first bar rotates by `angle` about the first of four hinges, the last hinge is fixed; nan
    where the bars cannot reach.
    """
    (first, second, third, last) = points
    arm = second - first
    rotated = np.stack(
        [np.cos(angle) * arm[0] - np.sin(angle) * arm[1],
         np.sin(angle) * arm[0] + np.cos(angle) * arm[1]], axis=1,
    )  # fmt: skip
    moved = first + rotated
    to_last = last - moved
    distance = np.hypot(to_last[:, 0], to_last[:, 1])
    middle, end = np.hypot(*(third - second)), np.hypot(*(last - third))
    along = (middle**2 - end**2 + distance**2) / (2.0 * distance)
    with np.errstate(invalid="ignore"):
        across = np.sqrt(middle**2 - along**2)
    unit = to_last / distance[:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    side = np.sign((third - second) @ np.array([-(last - second)[1], (last - second)[0]]))
    knee = moved + along[:, None] * unit + side * across[:, None] * normal

    def rotation(ends: FloatArray, reference: FloatArray) -> FloatArray:
        now = np.arctan2(ends[:, 1], ends[:, 0]) - np.arctan2(reference[1], reference[0])
        return (now + np.pi) % (2.0 * np.pi) - np.pi

    return [
        (first, angle),
        (moved, rotation(knee - moved, third - second)),
        (knee, rotation(last - knee, last - third)),
    ]
