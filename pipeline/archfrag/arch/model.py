"""Arch and Block: what a user builds, and with it the chain of rigid bodies of the mechanics."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from archfrag.arch import checks, facts
from archfrag.arch import ring as rings
from archfrag.arch.building import Given, fields_of, plain, tie_row
from archfrag.arch.checks import FloatArray
from archfrag.arch.drawing import read_drawing
from archfrag.arch.marks import Mark, arch_marks, frame
from archfrag.arch.polygons import Blocks, polygon_shape
from archfrag.arch.quasi_static import follow_tie
from archfrag.arch.shape import Shape
from archfrag.arch.transverse import column_of
from archfrag.errors import GeometryError
from archfrag.files import Named, counted
from archfrag.properties import LATER, SMALLEST, unusual

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Profiles over a span: least and largest rise over span (below 1e-6 rounding shows),
# and the function that makes the ring.
_OVER_SPAN: dict[str, tuple[float, float, Any]] = {
    "segmental": (1e-6, 0.5, rings.segmental_ring),
    "pointed": (0.5, np.inf, rings.pointed_ring),
    "elliptic": (1e-6, np.inf, partial(rings.normal_ring, rings.ellipse)),
    "catenary": (1e-6, np.inf, partial(rings.normal_ring, rings.catenary)),
}
_SHOWN = ("radius", "span", "rise", "thickness", "width", "height")  # in the repr


class Arch(Shape):
    """Rigid voussoirs in a row between two rigid springings, or on one.

    Make one with a class method: `circular`, `segmental`, `pointed`, `elliptic`, `catenary`,
    `from_joints`, `from_polygons` or `from_dxf`. If no arch can be built, they raise
    `GeometryError`, which names the parameter, its value and what is allowed. Ready-made profiles
    are symmetric about x = 0 with the springings of their centre line at height 0 (`circular`: the
    centre of the circle at the origin). Joint 0 is the left springing. All share these parameters:

    Other Parameters
    ----------------
    thickness : float
        Of the ring, measured along its joints [m].
    voussoirs : int
        Number of bodies, at least 2.
    friction : float or (n_joint,) array_like
        Coulomb coefficient of all joints or of each. With inf, the limit of large friction, a
        joint slides only where it has no normal force, as with a coefficient of 1e6.
    density, depth : float or (voussoirs,) array_like
        Density of the masonry [kg/m3], 2000 if not given; depth across the plane of the arch [m],
        1 if not given.
    joint_positions : (voussoirs + 1,) array_like, optional
        Positions of the joints from 0 at the left springing: up to `embrace` [degrees] for
        `circular`, up to 1, as fractions of the centre line, for the others. Equal if not given.
    dead_load : float or (voussoirs,) array_like, optional
        Weight on each voussoir [N]: a point mass in the middle of its extrados.

    Attributes
    ----------
    intrados, extrados : (n_voussoir + 1, 2) ndarray
        Ends of the joint lines [m]; with a free end the last line is no joint.
    parameters : dict
        What the user gave, with defaults, for strict JSON.

    Examples
    --------
    >>> import archfrag as af
    >>> af.Arch.pointed(span=6.0, rise=4.0, thickness=0.6, voussoirs=12, friction=0.7)
    <Arch pointed: 12 voussoirs, 13 joints; span 6 m, rise 4 m, thickness 0.6 m; 125 kN>
    """

    @property
    def marks(self) -> list[Mark]:
        """What a drawing shows of the arch at rest: fill, voussoirs, ties and ground."""
        return arch_marks(self)

    def _frame(self, *motion) -> tuple[FloatArray, FloatArray]:
        return frame(self, *motion)

    def corner_name(self, corner: int, joint: int | None = None) -> str:
        """Return the user's name of a corner of the joints, "intrados" or "extrados".

        `corner` is 0 or 1, as the chain numbers them. At a `joint` of an inner pier it is "right"
        or "left".
        """
        if joint is not None and any(
            part.name.startswith("pier") and joint in part.joints for part in self.parts
        ):
            return ("right", "left")[corner]
        return ("intrados", "extrados")[corner != self.flipped]

    def __repr__(self) -> str:
        given = self.parameters
        width, height = self.extent
        facts = [f"{key} {given[key]:g} m" for key in _SHOWN if key in given]
        many = len(self.spans) > 1
        name = (
            f"Bridge of {len(self.spans)} spans" if many else f"Arch {given['profile']}"
        )
        facts = facts or [f"{width:.3g} m wide", f"{height:.3g} m high"]
        weight = self.chain.mass.sum() * self.chain.gravity / 1e3
        return (
            f"<{name}: {counted(self.n_voussoir, 'voussoir')}, "
            f"{counted(self.n_joint, 'joint')}; {', '.join(facts)}; {weight:.3g} kN>"
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the arch to scale with the numbers of its joints, in `ax` or in new axes."""
        from archfrag.plots import plot_arch

        return plot_arch(self, ax)

    def _repr_html_(self) -> str:
        from archfrag.plots import html_of

        return html_of(self)

    @classmethod
    def circular(
        cls,
        radius: float,
        thickness: float,
        embrace: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        sector: bool = True,
        joint_positions: ArrayLike | None = None,
        **material,
    ) -> Arch:
        """Build a circular arch, symmetric about the vertical through its centre, the origin.

        Parameters
        ----------
        radius : float
            Mid-thickness radius [m].
        embrace : float
            Angle between the springings [degrees], less than 360.
        sector : bool
            Exact annular sectors; False: straight-sided, with the same joints.
        thickness, voussoirs, friction, joint_positions, **material
            See `Arch`; `thickness` is less than twice the radius.

        Examples
        --------
        >>> import archfrag as af
        >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
        >>> arch.n_voussoir, arch.n_joint
        (7, 8)
        """
        radius = checks.number("radius", radius)
        thickness = checks.number("thickness", thickness)
        embrace = checks.number("embrace", embrace, closed=False)
        voussoirs = checks.count("voussoirs", voussoirs)
        sector = checks.flag("sector", sector)
        angle = np.radians(
            checks.joint_positions(joint_positions, voussoirs, embrace, "degrees")
        )
        ring = rings.circular_ring(np.zeros(2), radius, thickness, angle, sector)
        given = {
            "radius": radius,
            "thickness": thickness,
            "embrace": embrace,
            "voussoirs": voussoirs,
            "sector": sector,
            "joint_positions": plain(joint_positions),
        }
        return cls._built_of("circular", given, ring, friction, **material)

    @classmethod
    def segmental(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        sector: bool = True,
        **more,
    ) -> Arch:
        """Build a circular arch of at most a semicircle from its span and rise.

        Parameters
        ----------
        span, rise : float
            Of the centre line; the rise is at most half the span [m].
        sector : bool
            Exact annular sectors; False: straight-sided, with the same joints.
        thickness, voussoirs, friction, **more
            See `Arch`.
        """
        more["sector"] = checks.flag("sector", sector)
        return cls._over_span(
            "segmental", span, rise, thickness, voussoirs, friction, **more
        )

    @classmethod
    def pointed(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        **more,
    ) -> Arch:
        """Build a pointed arch: two circular arcs with horizontal springings meet at the crown.

        Joints are radial to their arc. A joint at the crown is vertical and longer than the
        thickness; without one the keystone keeps the points of both arcs. Sides are straight.
        The parameters are those of `segmental`; the rise is at least half the span.
        """
        return cls._over_span(
            "pointed", span, rise, thickness, voussoirs, friction, **more
        )

    @classmethod
    def elliptic(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        **more,
    ) -> Arch:
        """Build the upper half of an ellipse, flat or tall, with straight sides.

        Joints are perpendicular to the centre line and must not cross. The parameters are those
        of `segmental`; span and rise are the horizontal axis and half the vertical one.
        """
        return cls._over_span(
            "elliptic", span, rise, thickness, voussoirs, friction, **more
        )

    @classmethod
    def catenary(
        cls,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        **more,
    ) -> Arch:
        """Build a hanging chain upside down, with straight sides.

        Joints are perpendicular to the centre line and must not cross. The parameters are those
        of `segmental`.
        """
        return cls._over_span(
            "catenary", span, rise, thickness, voussoirs, friction, **more
        )

    @classmethod
    def _over_span(
        cls,
        profile: str,
        span: float,
        rise: float,
        thickness: float,
        voussoirs: int,
        friction: ArrayLike,
        *,
        joint_positions: ArrayLike | None = None,
        sector: bool | None = None,
        **material,
    ) -> Arch:
        """Check the parameters that profiles over a span share, and build the arch."""
        least, most, ring_of = _OVER_SPAN[profile]
        span = checks.number("span", span)
        rise = checks.number(
            "rise",
            rise,
            least=least * span,
            most=most * span,
            meaning=f"{least:g} to {most:g} x span",
        )
        thickness = checks.number("thickness", thickness)
        voussoirs = checks.count("voussoirs", voussoirs)
        position = checks.joint_positions(
            joint_positions, voussoirs, 1.0, "(the centre line's length)"
        )
        own = {} if sector is None else {"sector": sector}
        ring = ring_of(span, rise, thickness, position, **own)
        shape = {
            "span": span,
            "rise": rise,
            "thickness": thickness,
            "voussoirs": voussoirs,
            **own,
            "joint_positions": plain(joint_positions),
        }
        return cls._built_of(profile, shape, ring, friction, **material)

    @classmethod
    def from_joints(
        cls,
        intrados: ArrayLike,
        extrados: ArrayLike,
        friction: ArrayLike,
        *,
        free_end: bool = False,
        **material,
    ) -> Arch:
        """Build a straight-sided chain of any profile from the ends of its joints.

        You may list the joints from either end and take either side for the intrados: the names
        stay yours (see `flipped` and `corner_name`). Voussoirs must be convex quadrilaterals in
        a row of which no two overlap.

        Parameters
        ----------
        intrados, extrados : (n + 1, 2) array_like
            Ends of the joints, in order along the chain [m]. At least 2 voussoirs, or 1 with a
            free end.
        free_end : bool
            The last voussoir touches no ground, as in a column or a wall; the last pair of points
            is then its free face and no joint.
        friction, **material
            See `Arch`; n_joint is n + 1, or n with a free end.

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
        least, why = (2, "for one voussoir") if free_end else (3, "for two voussoirs")
        inner = checks.points("intrados", intrados, least, why)
        outer = checks.points("extrados", extrados, least, why)
        if inner.shape != outer.shape:
            raise GeometryError(
                f"intrados has {len(inner)} points and extrados {len(outer)}; they "
                "must be equal"
            )
        shape = {
            "intrados": inner.tolist(),
            "extrados": outer.tolist(),
            "free_end": free_end,
        }
        ring = rings.straight_ring(inner, outer)
        return cls._built_of("from_joints", shape, ring, friction, free_end, **material)

    @classmethod
    def from_polygons(
        cls,
        outlines: Sequence[ArrayLike],
        friction: ArrayLike,
        *,
        ground: Sequence[ArrayLike] = (),
        thickness_factor: float = 1.0,
        tolerance: float | None = None,
        **material,
    ) -> Arch:
        """Build a chain of simple polygons in any order; edges that two share become joints.

        Outlines must neither cross themselves nor overlap. Blocks of a bridge of several spans
        form a tree: a block with three joints is the top course of an inner pier.

        Parameters
        ----------
        outlines : sequence of (m, 2) or (m, 3) array_like
            Corners x, y of the blocks [m] in either sense; the third column is the bulge of the
            side to the next corner, the tangent of a quarter of its arc's angle (positive
            anticlockwise, 0 straight). Area, centroid and inertia of arcs are exact.
        ground : sequence of (2, 2) array_like
            Lines on which end blocks and inner piers stand. With one line the other end is free.
            Without any the chain stands on the sides opposite to the joints of its ends.
        friction, **material
            See `Arch`. Joints and voussoirs count from the end further left, or from the ground.
        thickness_factor, tolerance : float
            Factor on the length of each joint, about its middle; the sides between joints follow.
            The tolerance is the distance within which edges of neighbours agree [m]; 1e-5 of the
            size of all if not given.

        Examples
        --------
        >>> import archfrag as af
        >>> plinth = [(-0.5, 0), (0.5, 0), (0.5, 0.3), (-0.5, 0.3)]
        >>> shaft = [(-0.2, 0.3), (0.2, 0.3), (0.2, 2.3), (-0.2, 2.3)]
        >>> ground = [[(-0.5, 0), (0.5, 0)]]
        >>> column = af.Arch.from_polygons([shaft, plinth], friction=0.8, ground=ground)
        >>> column.n_joint, round(af.onset(column).plus, 3)
        (2, 0.2)
        """
        drawn = Blocks.from_points(outlines, ground)
        return cls._of_blocks(
            drawn, thickness_factor, tolerance, friction=friction, **material
        )

    @classmethod
    def from_dxf(
        cls,
        path: str | Path,
        friction: ArrayLike,
        *,
        layer: str | Sequence[str] | None = None,
        unit: str | None = None,
        thickness_factor: float = 1.0,
        tolerance: float | None = None,
        **material,
    ) -> Arch:
        """Build a chain from the blocks of a DXF drawing.

        `GeometryError` names file, layer and handle of an entity that is no block or does not fit.
        A warning counts the other visible entities, except text and dimensions. Entities that are
        frozen, off or invisible are not read.

        Parameters
        ----------
        path : str or Path
            Its blocks are closed polylines (LWPOLYLINE or 2D POLYLINE, sides straight or arcs) of
            one or more layers, drawn or inserted (INSERT); a LINE of these layers shows an edge on
            the ground.
        layer : str or sequence of str, optional
            Layer or layers of the blocks; the only one with polylines if not given.
        unit : str, optional
            m, dm, cm, mm, in or ft; overrides what the drawing states ($INSUNITS).
        friction, thickness_factor, tolerance, **material
            See `from_polygons`.
        """
        drawn = read_drawing(path, layer, unit)
        if drawn.caution:
            warnings.warn(drawn.caution, UserWarning, stacklevel=2)
        return cls._of_blocks(
            drawn, thickness_factor, tolerance, friction=friction, **material
        )

    def tied(
        self,
        level: float | None = None,
        *,
        area: float,
        modulus: float = 2.0e11,
        prestress: float = 0.0,
        strength: float = np.inf,
        rupture: float = np.inf,
        ends: Sequence[tuple[int, float, float]] | None = None,
        span: int | None = None,
    ) -> Arch:
        """Return the arch with one more tie: a bar that only pulls.

        It is elastic up to its strength, then it yields. It is slack while it is shorter than its
        length without a force. A tie without prestress does not change the onset of motion: rigid
        bodies have to move before it pulls. An arch whose springing has moved follows the
        prestress slowly until it rests; `StabilityError` if it falls.

        Parameters
        ----------
        level : float, optional
            Height of a horizontal tie from outer face to outer face [m].
        area, modulus : float
            Area of its cross-section [m2]; Young's modulus [N/m2].
        prestress, strength : float
            Tension at rest and tension at which it yields [N].
        rupture : float
            Elongation at which it breaks [m].
        ends : two of (int, float, float), optional
            Voussoir, x and y [m] of each end, instead of `level`; the left base is voussoir -1,
            other bases come after the last voussoir.
        span : int, optional
            Span of a tie at a `level`, from 1; if not given, each span gets one.

        Examples
        --------
        >>> import archfrag as af
        >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
        >>> tied = arch.tied(level=6.0, area=5e-4, prestress=2e4)
        >>> af.onset(tied).plus > af.onset(arch).plus
        True
        """
        spans = range(1, len(self.spans) + 1)
        if span not in (None, *spans) or (span and ends):
            raise GeometryError(
                f"span = {span} is impossible for a tie; it must be 1 to {len(spans)}"
            )
        given: Named = {
            "level": level,
            "area": area,
            "modulus": modulus,
            "prestress": prestress,
            "strength": strength,
            "rupture": rupture,
            "ends": ends,
        }
        if len(spans) > 1 and span is None and ends is None:
            arch: Arch = self
            for number in spans:
                arch = arch.tied(**given, span=number)
            return arch
        if self.chain.joint is not None:
            raise GeometryError("a tie needs rigid joints: joints.model inset")
        row = tie_row(self, **given, span=span or 1)
        given["span"] = span
        ties = [row] if self.chain.tie is None else [*self.chain.tie, row]
        told = {
            key: value for key, value in given.items() if value not in (None, np.inf)
        }
        tied = self.changed(
            chain=self.chain._replace(tie=np.array(ties)),
            parameters={
                **self.parameters,
                "ties": [*self.parameters.get("ties", ()), told],
            },
        )
        tied = tied._warned(f"ties[{len(ties) - 1}]")
        if self.chain.start is None or prestress == 0.0:
            return tied
        return follow_tie(tied)

    def recessed(self, intrados: ArrayLike = 0.0, extrados: ArrayLike = 0.0) -> Arch:
        """Return the arch with joints that transmit nothing near their ends.

        Bodies keep their masses, inertias, centroids and outlines, for only mortar or a splinter
        is lost. Both faces of a joint are recessed alike, so that a closed joint stays closed.
        `GeometryError` if a depth is negative or nothing of a joint is left.

        Parameters
        ----------
        intrados, extrados : float or (n_joint,) array_like
            Depth from the joint's end at the intrados or extrados, along the joint, over which it
            transmits nothing [m]; one for all joints or one for each.

        Examples
        --------
        >>> import archfrag as af
        >>> block = af.Block(width=0.4, height=2.0, friction=0.8).recessed(0.05, 0.05)
        >>> round(af.onset(block).plus, 6)
        0.15
        """
        if self.chain.start is not None:
            raise GeometryError("a springing has moved already; recessed comes before")
        if self.joints:
            raise GeometryError(
                "the arch has joints that give already; recessed comes before"
            )
        n_joint = self.n_joint
        given = {"intrados": intrados, "extrados": extrados}
        depths = [
            checks.shared_or_each(f"recess.{side}", depth, n_joint, "joint")
            for side, depth in given.items()
        ]
        face = self.extrados[:n_joint] - self.intrados[:n_joint]
        length = np.hypot(*face.T)
        left = length - depths[0] - depths[1]
        if not np.all(left > SMALLEST):
            joint = int(np.argmin(left))
            raise GeometryError(
                f"recess of joint {joint} leaves {left[joint]:.6g} m of its "
                f"{length[joint]:.6g} m; it must leave more than {SMALLEST:g} m"
            )
        along = face / length[:, None]
        lost = np.stack([depths[0][:, None] * along, -depths[1][:, None] * along])
        lines = np.stack([self.intrados, self.extrados])
        lines[:, :n_joint] += lost
        corner = lost[:: -1 if self.flipped else 1].swapaxes(0, 1)
        chain = self.chain._replace(
            face_before=self.chain.face_before + corner,
            face_after=self.chain.face_after + corner,
        )
        before = self.parameters.get("recess", {})
        recess = {
            side: plain(np.add(before.get(side, 0.0), depth))
            for side, depth in given.items()
        }
        return self.changed(
            intrados=lines[0],
            extrados=lines[1],
            chain=chain,
            parameters={**self.parameters, "recess": recess},
        )

    def filled(self, height_over_crown: float, unit_weight: float, **more) -> Arch:
        """Return the arch with the weight and mass of fill and backing over its extrados.

        Each body carries the column above it up to a level surface: a point mass on its extrados,
        below the column's centroid. Tops of piers carry fill too. The soil neither resists (no
        passive pressure) nor pushes. `GeometryError` if the backing reaches above the fill.

        Parameters
        ----------
        height_over_crown : float
            Of the surface over the highest point of the ring [m].
        unit_weight : float
            Of the fill [N/m3].
        backing_height, backing_unit_weight : float, optional
            Height of the backing, which replaces fill, over the middle of the lower springing
            joint [m]; its unit weight [N/m3].
        inertia : float, optional
            Part of the mass that moves with the ring. Only 1 can be modelled: a body has one mass.

        Examples
        --------
        >>> import archfrag as af
        >>> ring = af.Arch.segmental(8.0, 2.0, 0.5, voussoirs=12, friction=0.6)
        >>> ring.filled(height_over_crown=0.5, unit_weight=18e3)
        <Arch segmental: 12 voussoirs, 13 joints; span 8 m, rise 2 m, thickness 0.5 m; 262 kN>
        """
        given = {"height_over_crown": height_over_crown, "unit_weight": unit_weight}
        return self._with(fill={**given, **more})

    def transverse(self, pier: str) -> Arch:
        """Return a pier with its share of rings and fill as a column that rocks across the bridge.

        The column stands in the vertical plane across the bridge. Its bodies are the courses of
        the pier, as wide as they are deep in the bridge, with their friction, and on them its
        share: half of each ring beside the pier with dead load, fill and backing, and the fill on
        the pier. The share is one body from the level of the springings upwards, with its mass,
        centroid and inertia across the bridge. Recesses, joints and strength of the column come
        after.

        It has no help from the spans beside it, which hold the pier by their stiffness across
        the bridge, and there are no spandrels: that is on the safe side. Fill moves with
        the share and does not push on it. What a plane along the bridge feels at the same time
        is not in it.

        Parameters
        ----------
        pier : str
            "pier 1" and so on, "left pier" or "right pier".

        Raises
        ------
        GeometryError
            If there is no such pier, or the bridge has recesses, joints, strength, springings that
            have moved or ties.

        Examples
        --------
        >>> import archfrag as af
        >>> ring = af.Arch.circular(2.5, 0.5, 180.0, voussoirs=9, friction=0.6, depth=2.0)
        >>> bridge = af.Bridge([ring, ring], piers={"height": 4.0, "width": 1.0})
        >>> column = bridge.transverse("pier 1")
        >>> column.n_voussoir, round(af.onset(column).plus, 3)
        (2, 0.264)
        """
        return Arch(**fields_of(column_of(self, pier)))

    def _with(self, **more: Named) -> Arch:
        later = set(LATER) & set(self.parameters)
        if later:
            raise GeometryError(
                f"the arch has {', '.join(sorted(later))} already; Bridge and filled come before"
            )
        return self.rebuilt(**more)._warned(*more)

    def rebuilt(self, **more) -> Arch:
        """Build the arch anew with some of its inputs replaced, such as `fill`.

        The names are those of `Given`. Recesses, moved springings and ties are not kept.
        """
        return Arch(**fields_of(self.given._replace(**more)))

    @classmethod
    def _built_of(cls, *given, **material) -> Self:
        return cls(**fields_of(Given(*given, **material)))._warned()

    @classmethod
    def _of_blocks(
        cls, drawn: Blocks, factor: float, tolerance: float | None, **material
    ) -> Arch:
        """Build the arch of blocks, see `from_polygons`, and warn of unusual values."""
        shape, ring, free = polygon_shape(drawn, tolerance, factor)
        arch = cls._built_of("polygons", shape, ring, free_end=free, **material)
        facts.warn_of_units(unusual("thickness_factor", factor))
        return arch

    def _warned(self, *keys: str) -> Self:
        """Warn of values that are probably in another unit, and return the arch.

        `keys` are as for `facts.unit_cautions`.
        """
        facts.warn_of_units(facts.unit_cautions(self, *keys))
        return self


class Bridge(Arch):
    """Arches in a row on piers between them, with outer springings on the ground or on piers.

    The top course of an inner pier is cut to the springing joints of two rings, so that bodies are
    a tree. Each ring moves to spring from the faces of its piers, its intrados as high as that of
    the ring beside it. Joints and bodies count pier by pier, each from its base upwards; then from
    the left base over rings and top courses to the right one. `Arch.place` names a joint. Whatever
    takes an `Arch` takes a bridge. `GeometryError` if a pier does not fit its springing joints.

    Parameters
    ----------
    rings : sequence of Arch
        From left to right; a ring may occur several times. With one ring and `ends` the bridge is
        an arch on two piers or buttresses.
    piers : mapping or sequence of mappings
        Inner piers: one for all, or one fewer than rings. Keys are height, from the base to the
        intrados of the springing, and width there [m]; base_width, if it differs [m]; courses,
        bodies equally high but for the top one, 1 by default; above, height of the level top over
        the extrados of the springing, 0 by default [m]; friction, density [kg/m3] and depth [m],
        if not given those of the rings beside it.
    ends : mapping, or two of mapping or None, optional
        Outer piers, left and right, with the same keys; on the ground where None. Their inner
        face is upright, their width is at the top.

    Examples
    --------
    >>> import archfrag as af
    >>> ring = af.Arch.circular(2.5, 0.5, 180.0, voussoirs=9, friction=0.6)
    >>> bridge = af.Bridge([ring, ring], piers={"height": 4.0, "width": 1.0, "courses": 2})
    >>> bridge
    <Bridge of 2 spans: 20 voussoirs, 22 joints; radius 2.5 m, thickness 0.5 m; 232 kN>
    >>> bridge.place(0), bridge.place(12)
    ('pier 1, base', 'span 2, joint 0')
    """

    def __init__(
        self, rings: Sequence[Arch], piers: Any = (), ends: Any = None
    ) -> None:
        if not rings or not all(isinstance(ring, Arch) for ring in rings):
            raise GeometryError("rings must be one Arch or more")
        for number, ring in enumerate(rings, 1):
            more = {*LATER, "spans", "ends", "fill"} & ring.parameters.keys()
            if more:
                raise GeometryError(
                    f"ring {number} has {', '.join(sorted(more))} already; Bridge comes before"
                )
        first, *others = (ring.given for ring in rings)
        super().__init__(
            **fields_of(first._replace(spans=(*others,), piers=piers, ends=ends))
        )
        self._warned("piers", "ends")


class Block(Arch):
    """Rectangular block on the ground: a chain of one body and one joint, with a free end.

    The middle of its base is the origin. Its right edge is the intrados and its left edge the
    extrados, as at the left springing of an arch.

    Parameters
    ----------
    width, height : float
        Sides [m].
    friction, density, depth
        See `Arch`.

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
        width = checks.number("width", width)
        height = checks.number("height", height)
        right = np.array([[0.5 * width, 0.0], [0.5 * width, height]])
        ring = rings.straight_ring(right, right * [-1.0, 1.0])
        shape = {"width": width, "height": height}
        super().__init__(
            **fields_of(Given("block", shape, ring, friction, True, density, depth))
        )
        self._warned()
