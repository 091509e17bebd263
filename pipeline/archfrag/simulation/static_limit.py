"""How far an arch can rotate, slowly, along its mechanism before it falls by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.simulation.rest import Hinge, Onset

_POSITIONS = 4000  # of the mechanism that are evaluated
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
        The smaller of those of the two mechanisms [rad]; nan if they slide, or have neither one
        hinge below a free end nor four hinges.

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
    return min((limit for limit in limits if np.isfinite(limit)), default=np.nan)


def _limit(arch: Arch, hinges: list[Hinge]) -> float:
    # Points of the plane are complex numbers: x + i y.
    points = np.array([getattr(arch, side)[joint] @ [1.0, 1j] for joint, side in hinges])
    centroid = arch.chain.centroid @ [1.0, 1j]
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
            arm = np.exp(1j * rotation)[:, None] * (centroid[first:last] - pivot)
            height = (arm + np.reshape(moved, (-1, 1))).imag
            energy += height @ arch.chain.mass[first:last]
        left = np.isfinite(energy)
        end = int(np.argmin(left)) if not left.all() else angle.size
        rise = np.diff(energy[:end])
        # Only in one sense does the weight resist.
        if not rise.size or rise[0] <= 0.0:
            continue
        place = float(rise.size)
        if (past := rise <= 0.0).any():
            top = int(np.argmax(past))
            # The energy is a parabola about its top: its slope vanishes between two positions.
            place = top - 0.5 + rise[top - 1] / (rise[top - 1] - rise[top])
        reached = [np.interp(place, np.arange(end), np.abs(r[:end])) for _, r in placed]
        least = min(least, float(max(reached)))
    return least if np.isfinite(least) else np.nan


def _linkage(
    points: NDArray[np.complex128], angle: NDArray[np.float64]
) -> list[tuple[NDArray[np.complex128], NDArray[np.float64]]]:
    """Where the first hinge of each of three bars is and how far the bar has rotated.

    The first bar rotates by `angle` about the first of four hinges, the last hinge is fixed; nan
    where the bars cannot reach.
    """
    first, second, third, last = points
    moved = first + np.exp(1j * angle) * (second - first)
    distance, middle, end = abs(last - moved), abs(third - second), abs(last - third)
    along = (middle**2 - end**2 + distance**2) / (2.0 * distance)
    with np.errstate(invalid="ignore"):
        height = np.sqrt(middle**2 - along**2)
    side = np.sign(((third - second) * np.conj(last - second)).imag)
    knee = moved + (along + 1j * side * height) * (last - moved) / distance
    return [
        (first, angle),
        (moved, np.angle((knee - moved) / (third - second))),
        (knee, np.angle((last - knee) / (last - third))),
    ]
