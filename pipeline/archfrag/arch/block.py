"""Block: a single rectangular body on the ground."""

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import checks
from archfrag.arch.assemble import fields_of
from archfrag.arch.model import Arch
from archfrag.arch.profiles import JointLines
from archfrag.arch.ring import straight_ring


class Block(Arch):
    """Rectangular block on the ground: a chain of one body and one joint, with a free end.

    The middle of its base is the origin. Its right edge is the intrados and its left edge the
    extrados, as at the left springing of an arch.

    Parameters
    ----------
    width, height : float
        Sides [m].
    friction : float
        Coulomb coefficient of the base; inf: the limit of large friction.
    density : float
        [kg/m3].
    depth : float
        Across the plane [m].

    Raises
    ------
    GeometryError
        Naming the parameter, its value and what is allowed.

    Examples
    --------
    >>> import archfrag as af
    >>> round(af.onset(af.Block(width=0.2, height=1.0, friction=0.8)).plus, 6)
    0.2
    """

    def __init__(
        self,
        width: float,
        height: float,
        friction: ArrayLike,
        density: float = 2000.0,
        depth: float = 1.0,
    ) -> None:
        width, height = checks.number("width", width), checks.number("height", height)
        side = 0.5 * width
        right = np.array([[side, 0.0], [side, height]])
        ring = straight_ring(JointLines(right, right * [-1.0, 1.0]))
        shape = {"width": width, "height": height}
        super().__init__(**fields_of("block", shape, ring, friction, density, depth, None, True))
