"""Arch: what a user builds, and with it the chain of rigid bodies that the mechanics take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.arch import checks
from archfrag.arch.assemble import fields_of
from archfrag.arch.profiles import (
    JointLines,
    catenary,
    ellipse,
    normal_lines,
    pointed_lines,
    radial_lines,
)
from archfrag.arch.ring import Ring, sector_ring, straight_ring
from archfrag.errors import GeometryError
from archfrag.mechanics.types import Chain

# Below this rise in parts of the span rounding shows in the joints.
_FLATTEST = 1e-6
_LENGTH = "(the centre line's length)"


@dataclass(frozen=True, eq=False, repr=False)
class Arch:
    """Rigid voussoirs in a row between two rigid springings, or on one.

    Made by one of the class methods: `circular`, `segmental`, `pointed`, `elliptic`, `catenary`
    for ready-made profiles, `from_joints` for any other. All raise `GeometryError`, in a message
    that names the parameter, its value and what is allowed, for anything of which no ring can be
    built. What they have in common is listed here.

    Other Parameters
    ----------------
    thickness : float
        Of the ring, measured along its joints [m].
    voussoirs : int
        Number of bodies, at least 2.
    friction : float or (n_joint,) array_like
        Coulomb coefficient of all joints or of each; inf: the limit of large friction. A joint
        under compression does not slide then; one that slides has no normal force, which happens
        at impacts (about one in twelve of a closed ring), as with a coefficient of 1e6.
    density : float
        Of the masonry [kg/m3].
    depth : float
        Width of the arch across its plane [m].
    joints : (voussoirs + 1,) array_like, optional
        Where the joints stand, increasing from 0 at the left springing: in degrees up to
        `embrace` for `circular`, as parts of the centre line's length up to 1 for the others.
        Equal voussoirs if not given.
    dead_load : float or (voussoirs,) array_like, optional
        Weight on the back of all voussoirs or of each [N]: a point mass fixed to the middle of
        the voussoir's extrados. It has weight and inertia, so that equilibrium depends only on
        the direction of the body force.

    Attributes
    ----------
    chain : Chain
        Masses, inertias, centroids and joint faces for the mechanics.
    intrados, extrados : (n_voussoir + 1, 2) ndarray
        Ends of the joint lines by the user's names [m]; with a free end the last is no joint.
    outlines : tuple of (m, 2) ndarray
        Of the voussoirs, for drawing; not closed [m].
    free_end : bool
        Whether the last voussoir touches no ground.
    flipped : bool
        Whether corner 0 of the chain's joints is the user's extrados.
    parameters : dict
        What the user gave, defaults filled in, ready for strict JSON (infinite friction: "inf").

    Notes
    -----
    Ready-made profiles are symmetric about x = 0 with the springings of their centre line at
    height 0 (`circular`: the centre of the circle at the origin), and run from the left
    springing, joint 0, over the crown.
    """

    chain: Chain
    intrados: NDArray[np.float64]
    extrados: NDArray[np.float64]
    outlines: tuple[NDArray[np.float64], ...]
    free_end: bool
    flipped: bool
    parameters: dict[str, Any]

    @property
    def n_voussoir(self) -> int:
        """Number of bodies."""
        return len(self.chain.mass)

    @property
    def n_joint(self) -> int:
        """Number of joints, those with the ground included."""
        return len(self.chain.friction)

    def corner_name(self, corner: int) -> str:
        """User's name of corner 0 or 1 of the chain's joints: "intrados" or "extrados"."""
        return ("intrados", "extrados")[corner != self.flipped]

    def __repr__(self) -> str:
        name = self.parameters["profile"]
        return f"<Arch {name}: {self.n_voussoir} voussoirs, {self.n_joint} joints>"

    @classmethod
    def circular(
        cls,
        radius: float,
        thickness: float,
        embrace: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        density: float = 2000.0,
        depth: float = 1.0,
        sector: bool = True,
        joints: ArrayLike | None = None,
        dead_load: ArrayLike | None = None,
    ) -> Arch:
        """Circular arch, symmetric about the vertical through the centre, which is the origin.

        Parameters
        ----------
        radius : float
            Mid-thickness radius [m].
        embrace : float
            Angle between the springings [degrees], less than 360.
        sector : bool
            Exact annular sectors; False: straight-sided, with the same joints.
        thickness, voussoirs, friction, density, depth, joints, dead_load
            See `Arch`; `thickness` is less than twice the radius.

        Examples
        --------
        >>> import archfrag as af
        >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
        >>> arch.n_voussoir, arch.n_joint
        (7, 8)
        >>> round(float(arch.chain.mass.sum()))
        82467
        """
        radius = checks.number("radius", radius)
        thickness = checks.number("thickness", thickness, below=2.0 * radius, note="2 x radius")
        embrace = checks.number("embrace", embrace, "degrees", below=360.0)
        voussoirs = checks.count("voussoirs", voussoirs)
        position = checks.joint_positions(joints, voussoirs, embrace, "degrees")
        shape = {"radius": radius, "thickness": thickness, "embrace": embrace}
        ring = _circular_ring(np.zeros(2), radius, thickness, np.radians(position), sector)
        return cls._ready_made(
            "circular", shape, ring, friction, density, depth, joints, dead_load, sector
        )

    @classmethod
    def segmental(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        density: float = 2000.0,
        depth: float = 1.0,
        sector: bool = True,
        joints: ArrayLike | None = None,
        dead_load: ArrayLike | None = None,
    ) -> Arch:
        """Circular arch of at most a semicircle, given by its span and rise.

        Parameters
        ----------
        span, rise : float
            Of the centre line; the rise is at most half the span [m].
        sector : bool
            Exact annular sectors; False: straight-sided, with the same joints.
        thickness, voussoirs, friction, density, depth, joints, dead_load
            See `Arch`.

        Examples
        --------
        >>> import archfrag as af
        >>> bridge = af.Arch.segmental(span=8.0, rise=2.0, thickness=0.6, voussoirs=9, friction=1)
        >>> af.onset(bridge).stands
        True
        """
        note = "1e-6 x span and half the span"
        shape, position = _spanned(
            (span, rise, thickness, voussoirs), joints, (_FLATTEST, 0.5), note
        )
        span, rise, thickness = shape.values()
        radius = (0.25 * span**2 + rise**2) / (2.0 * rise)
        note = "2 x radius of the centre line"
        checks.number("thickness", thickness, below=2.0 * radius, note=note)
        angle = 4.0 * math.atan2(2.0 * rise, span) * position
        centre = np.array([0.0, rise - radius])
        ring = _circular_ring(centre, radius, thickness, angle, sector)
        return cls._ready_made(
            "segmental", shape, ring, friction, density, depth, joints, dead_load, sector
        )

    @classmethod
    def pointed(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        density: float = 2000.0,
        depth: float = 1.0,
        joints: ArrayLike | None = None,
        dead_load: ArrayLike | None = None,
    ) -> Arch:
        """Pointed arch: two circular arcs with horizontal springings meet at the crown.

        Joints are radial to their arc. A joint at the crown is vertical and longer than the
        thickness; without one the keystone keeps the points of both arcs. Sides are straight.

        Parameters
        ----------
        span, rise : float
            Of the centre line; the rise is at least half the span [m].
        thickness, voussoirs, friction, density, depth, joints, dead_load
            See `Arch`.

        Examples
        --------
        >>> import archfrag as af
        >>> gothic = af.Arch.pointed(span=6.0, rise=4.0, thickness=0.6, voussoirs=12, friction=0.7)
        >>> gothic
        <Arch pointed: 12 voussoirs, 13 joints>
        """
        given, ends = (span, rise, thickness, voussoirs), (0.5, math.inf)
        shape, position = _spanned(given, joints, ends, "half the span")
        ring = straight_ring(pointed_lines(shape, position))
        return cls._ready_made("pointed", shape, ring, friction, density, depth, joints, dead_load)

    @classmethod
    def elliptic(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        density: float = 2000.0,
        depth: float = 1.0,
        joints: ArrayLike | None = None,
        dead_load: ArrayLike | None = None,
    ) -> Arch:
        """Upper half of an ellipse, flat or tall; straight-sided.

        Parameters
        ----------
        span, rise : float
            Of the centre line: its horizontal axis and half its vertical one [m].
        thickness, voussoirs, friction, density, depth, joints, dead_load
            See `Arch`; joints are perpendicular to the centre line and must not cross.

        Examples
        --------
        >>> import archfrag as af
        >>> arch = af.Arch.elliptic(span=8.0, rise=2.5, thickness=0.8, voussoirs=11, friction=0.7)
        >>> arch.n_joint
        12
        """
        given, ends = (span, rise, thickness, voussoirs), (_FLATTEST, math.inf)
        shape, position = _spanned(given, joints, ends, "1e-6 x span")
        ring = straight_ring(normal_lines(ellipse, shape, position))
        matter = friction, density, depth, joints, dead_load
        return cls._ready_made("elliptic", shape, ring, *matter)

    @classmethod
    def catenary(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        density: float = 2000.0,
        depth: float = 1.0,
        joints: ArrayLike | None = None,
        dead_load: ArrayLike | None = None,
    ) -> Arch:
        """Hanging chain upside down; straight-sided.

        Parameters
        ----------
        span, rise : float
            Of the centre line [m].
        thickness, voussoirs, friction, density, depth, joints, dead_load
            See `Arch`; joints are perpendicular to the centre line and must not cross.

        Examples
        --------
        >>> import archfrag as af
        >>> arch = af.Arch.catenary(span=6.0, rise=4.0, thickness=0.4, voussoirs=13, friction=0.7)
        >>> af.onset(arch).stands
        True
        """
        given, ends = (span, rise, thickness, voussoirs), (_FLATTEST, math.inf)
        shape, position = _spanned(given, joints, ends, "1e-6 x span")
        ring = straight_ring(normal_lines(catenary, shape, position))
        matter = friction, density, depth, joints, dead_load
        return cls._ready_made("catenary", shape, ring, *matter)

    @classmethod
    def from_joints(
        cls,
        intrados: ArrayLike,
        extrados: ArrayLike,
        friction: ArrayLike,
        *,
        density: float = 2000.0,
        depth: float = 1.0,
        dead_load: ArrayLike | None = None,
        free_end: bool = False,
    ) -> Arch:
        """Straight-sided chain of any profile, given by the ends of its joints.

        Either order of travel and either side may be taken for the intrados; the names stay the
        user's (see `flipped` and `corner_name`).

        Parameters
        ----------
        intrados, extrados : (n + 1, 2) array_like
            Ends of the joints, in order along the chain [m]. At least 2 voussoirs, or 1 with a
            free end.
        friction : float or (n_joint,) array_like
            See `Arch`; n_joint is n + 1, or n with a free end.
        free_end : bool
            The last voussoir touches no ground, as in a column or a wall; the last pair of points
            is then its free face and no joint.
        density, depth, dead_load
            See `Arch`.

        Raises
        ------
        GeometryError
            Also if corners coincide, joints cross, a voussoir is not a convex quadrilateral, the
            chain doubles back, or two voussoirs overlap.

        Examples
        --------
        >>> import numpy as np, archfrag as af
        >>> height = np.linspace(0.0, 6.0, 8)
        >>> right = np.column_stack([np.linspace(0.55, 0.45, 8), height])
        >>> column = af.Arch.from_joints(right, right * [-1, 1], friction=0.7, free_end=True)
        >>> column.n_joint, round(af.onset(column).plus, 3)
        (7, 0.19)
        """
        free_end = checks.flag("free_end", free_end)
        least = 2 if free_end else 3
        why = "a chain has 1 voussoir or more" if free_end else "an arch has 2 voussoirs or more"
        inner = checks.points("intrados", intrados, least, why)
        outer = checks.points("extrados", extrados, least, why)
        if inner.shape != outer.shape:
            raise GeometryError(
                f"intrados has {len(inner)} points and extrados {len(outer)}; they must be as many"
            )
        shape = {"intrados": inner.tolist(), "extrados": outer.tolist(), "free_end": free_end}
        ring = straight_ring(JointLines(inner, outer))
        return cls(
            **fields_of("from_joints", shape, ring, friction, density, depth, dead_load, free_end)
        )

    @classmethod
    def from_polygons(
        cls,
        outlines: Sequence[ArrayLike],
        friction: ArrayLike,
        *,
        ground: Sequence[ArrayLike] = (),
        density: float = 2000.0,
        depth: float = 1.0,
        dead_load: ArrayLike | None = None,
        thickness_factor: float = 1.0,
        tolerance: float | None = None,
    ) -> Arch:
        """Chain of simple polygons in any order: joints are the edges that two have in common.

        Parameters
        ----------
        outlines : sequence of (m, 2) or (m, 3) array_like
            Corners x, y of the blocks [m] in either sense; the third column is the bulge of the
            side to the next corner, the tangent of a quarter of its arc's angle (positive
            anticlockwise, 0 straight). Area, centroid and inertia of arcs are exact.
        ground : sequence of (2, 2) array_like
            One or two lines on which end blocks stand; the other end of a chain with one is free.
            Without any the chain stands on the sides opposite to the joints of its ends.
        friction, density, depth, dead_load
            See `Arch`; joints and voussoirs count from the end further left, or from the ground.
        thickness_factor : float
            Joints are longer by it about their middles, and the sides between them follow.
        tolerance : float, optional
            Within which edges of neighbours agree [m]; 1e-5 of the size of all if not given.

        Raises
        ------
        GeometryError
            If an outline crosses itself, two overlap, or they do not form one chain.

        Examples
        --------
        >>> import archfrag as af
        >>> plinth = [(-0.5, 0), (0.5, 0), (0.5, 0.3), (-0.5, 0.3)]
        >>> shaft = [(-0.2, 0.3), (0.2, 0.3), (0.2, 2.3), (-0.2, 2.3)]
        >>> column = af.Arch.from_polygons(
        ...     [shaft, plinth], friction=0.8, ground=[[(-0.5, 0), (0.5, 0)]]
        ... )
        >>> column.n_joint, round(af.onset(column).plus, 3)
        (2, 0.2)
        """
        from archfrag.arch.polygons import given_polygons, polygon_fields

        drawn = given_polygons(outlines, ground)
        matter = {
            "friction": friction, "density": density, "depth": depth, "dead_load": dead_load
        }  # fmt: skip
        return cls(**polygon_fields(drawn, thickness_factor, tolerance, matter))

    @classmethod
    def from_dxf(
        cls,
        path: str | Path,
        friction: ArrayLike,
        *,
        layer: str | None = None,
        unit: str | None = None,
        density: float = 2000.0,
        depth: float = 1.0,
        dead_load: ArrayLike | None = None,
        thickness_factor: float = 1.0,
        tolerance: float | None = None,
    ) -> Arch:
        """Chain of the blocks of a DXF drawing.

        Parameters
        ----------
        path : str or Path
            Its blocks are closed polylines (LWPOLYLINE or 2D POLYLINE, sides straight or arcs) of
            one layer; a LINE of that layer shows an edge on the ground.
        layer : str, optional
            The only one with polylines if not given.
        unit : str, optional
            m, dm, cm, mm, in or ft, over what the drawing states ($INSUNITS).
        friction, density, depth, dead_load, thickness_factor, tolerance
            See `from_polygons`.

        Raises
        ------
        GeometryError
            Naming file, layer and handle of what is no block or does not fit into one chain.

        Examples
        --------
        >>> import archfrag as af, tempfile, pathlib
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "bridge.dxf"
        >>> bridge = af.Arch.segmental(span=8.0, rise=2.0, thickness=0.6, voussoirs=9, friction=1)
        >>> bridge.to_dxf(file, unit="mm")
        >>> abs(af.onset(af.Arch.from_dxf(file, 1)).plus - af.onset(bridge).plus) < 1e-12
        True
        """
        from archfrag.arch.drawing import read_drawing
        from archfrag.arch.polygons import polygon_fields

        drawn = read_drawing(path, layer, unit)
        matter = {
            "friction": friction, "density": density, "depth": depth, "dead_load": dead_load
        }  # fmt: skip
        return cls(**polygon_fields(drawn, thickness_factor, tolerance, matter))

    def to_dxf(self, path: str | Path, unit: str = "m", layer: str = "VOUSSOIRS") -> None:
        """Draw the blocks as closed polylines and what they stand on as lines.

        Parameters
        ----------
        path : str or Path
            File to write; the same arch and version of ezdxf make the same bytes.
        unit : str
            m, dm, cm, mm, in or ft.
        layer : str
            Of all that is drawn.

        Raises
        ------
        GeometryError
            If the unit or the layer's name is none.
        OutputError
            If the file cannot be written.

        Notes
        -----
        Read again by `from_dxf` with the same friction, density, depth and dead load, which no
        drawing holds, it is the same arch, its sides intrados and extrados as seen from outside
        of the arch. Recesses are not drawn.
        """
        from archfrag.arch.drawing import write_dxf

        write_dxf(self, path, unit, layer)

    @classmethod
    def _ready_made(
        cls,
        profile: str,
        shape: dict[str, Any],
        ring: Ring,
        friction: ArrayLike,
        density: float,
        depth: float,
        joints: ArrayLike | None,
        dead_load: ArrayLike | None,
        sector: bool | None = None,
    ) -> Arch:
        """Arch of a ready-made profile, with what its user gave."""
        given: dict[str, Any] = {**shape, "voussoirs": len(ring.voussoirs)}
        if sector is not None:
            given["sector"] = bool(sector)
        given["joints"] = None if joints is None else np.asarray(joints, dtype=float).tolist()
        return cls(**fields_of(profile, given, ring, friction, density, depth, dead_load))


def _circular_ring(
    centre: NDArray[np.float64],
    radius: float,
    thickness: float,
    angle: NDArray[np.float64],
    sector: bool,
) -> Ring:
    """Ring between radial joints, of annular sectors or straight-sided voussoirs."""
    lines = radial_lines(centre, radius, thickness, angle)
    if checks.flag("sector", sector):
        return sector_ring(lines, centre, radius, thickness, angle)
    return straight_ring(lines)


def _spanned(
    given: tuple[float, float, float, int],
    joints: ArrayLike | None,
    ends: tuple[float, float],
    note: str,
) -> tuple[dict[str, float], NDArray[np.float64]]:
    """Checked span, rise and thickness, and positions of the joints in parts of the length.

    The rise must be within `ends`, in parts of the span; `note` is their name.
    """
    span = checks.number("span", given[0])
    least, most = (end * span for end in ends)
    rise = checks.number("rise", given[1], at_least=least, at_most=most, note=note)
    thickness = checks.number("thickness", given[2])
    count = checks.count("voussoirs", given[3])
    position = checks.joint_positions(joints, count, 1.0, _LENGTH)
    return {"span": span, "rise": rise, "thickness": thickness}, position
