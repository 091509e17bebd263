"""Joints that bear on less than their length: mortar lost or edges spalled at their ends."""

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import checks
from archfrag.arch.assemble import plain
from archfrag.arch.model import Arch
from archfrag.errors import GeometryError


def recessed(arch: Arch, intrados: ArrayLike = 0.0, extrados: ArrayLike = 0.0) -> Arch:
    """The arch with joints that bear nothing near their ends.

    Parameters
    ----------
    arch : Arch
    intrados, extrados : float or (n_joint,) array_like
        Depth from the joint's end at the intrados or extrados, along the joint, over which it
        bears nothing [m]; one for all joints or one for each.

    Returns
    -------
    Arch
        With the same bodies: masses, inertias, centroids and outlines stay, for what is lost is
        mortar or a splinter. Only the ends of the joints, about which voussoirs hinge, move.

    Raises
    ------
    GeometryError
        If a depth is negative or nothing of a joint is left.

    Notes
    -----
    Both faces of a joint are recessed alike, so that a closed joint stays closed.

    Examples
    --------
    >>> import archfrag as af
    >>> from archfrag.arch.recess import recessed
    >>> block = recessed(af.Block(width=0.4, height=2.0, friction=0.8), 0.05, 0.05)
    >>> round(af.onset(block).plus, 6)
    0.15
    """
    depths = [
        checks.shared_or_each(f"recess.{name}", value, arch.n_joint, "joint", "m")
        for name, value in (("intrados", intrados), ("extrados", extrados))
    ]
    start, end = arch.intrados[: arch.n_joint], arch.extrados[: arch.n_joint]
    length = np.hypot(*(end - start).T)
    left = length - depths[0] - depths[1]
    if not np.all(left > checks.SMALLEST):
        joint = int(np.argmin(left))
        raise GeometryError(
            f"recess of joint {joint} leaves {left[joint]:.6g} m of its {length[joint]:.6g} m; it "
            f"must leave more than {checks.SMALLEST:g} m"
        )
    along = (end - start) / length[:, None]
    moved = depths[0][:, None] * along, -depths[1][:, None] * along
    ends = [arch.intrados.copy(), arch.extrados.copy()]
    for line, step in zip(ends, moved):
        line[: arch.n_joint] += step
    corner = np.stack(moved[::-1] if arch.flipped else moved, axis=1)
    depth = {"intrados": plain(intrados), "extrados": plain(extrados)}
    chain = arch.chain._replace(
        face_before=np.ascontiguousarray(arch.chain.face_before + corner),
        face_after=np.ascontiguousarray(arch.chain.face_after + corner),
    )
    changed = {"chain": chain, "intrados": ends[0], "extrados": ends[1]}
    return Arch(**{**vars(arch), **changed, "parameters": {**arch.parameters, "recess": depth}})
