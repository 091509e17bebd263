"""From a ring of voussoirs to the chain of rigid bodies that the mechanics take."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.arch import STANDARD_GRAVITY, checks
from archfrag.arch.ring import Ring
from archfrag.errors import GeometryError
from archfrag.mechanics.types import Chain


def assemble(
    ring: Ring,
    friction: NDArray[np.float64],
    surface_density: float,
    dead_load: NDArray[np.float64],
    free_end: bool,
) -> Chain:
    """Chain of a ring.

    A point mass p at the distance d from the centroid of a body of mass m and inertia J moves
    the centroid by p/(m + p) of d and gives J + m p/(m + p) d² about the new one.
    """
    area, plane_centroid, polar = (
        np.array([getattr(figure.section, name) for figure in ring.voussoirs])
        for name in ("area", "centroid", "polar")
    )
    back = np.array([figure.back for figure in ring.voussoirs])
    # Whatever overflows here is refused below.
    with np.errstate(all="ignore"):
        own, added = surface_density * area, dead_load / STANDARD_GRAVITY
        mass = own + added
        lever = back - plane_centroid
        centroid = plane_centroid + (added / mass)[:, None] * lever
        inertia = surface_density * polar + own * (added / mass) * (lever**2).sum(axis=1)
        good = (mass > 0.0) & (inertia > 0.0) & np.isfinite(mass + inertia + centroid.sum(axis=1))
    if not good.all():
        body = int(np.argmin(good))
        raise GeometryError(
            f"voussoir {body} has a mass of {mass[body]:.6g} kg and an inertia of "
            f"{inertia[body]:.6g} kg m2; both must be finite and greater than 0, so look again at "
            "its size, density, depth and dead_load"
        )
    corners = np.stack([ring.lines.intrados, ring.lines.extrados], axis=1)
    if ring.sense < 0:
        corners = corners[:, ::-1]
    n_joint = len(friction)
    face_before, face_after = corners[:n_joint].copy(), corners[:n_joint].copy()
    face_before[1:] -= centroid[: n_joint - 1, None]
    resting = n_joint if free_end else n_joint - 1
    face_after[:resting] -= centroid[:, None]
    return Chain(
        mass=mass,
        inertia=inertia,
        centroid=np.ascontiguousarray(centroid),
        face_before=face_before,
        face_after=face_after,
        friction=friction,
        gravity=STANDARD_GRAVITY,
    )


def fields_of(
    profile: str,
    shape: dict[str, Any],
    ring: Ring,
    friction: ArrayLike,
    density: float,
    depth: float,
    dead_load: ArrayLike | None,
    free_end: bool = False,
) -> dict[str, Any]:
    """Attributes of an Arch, once what gives its ring mass and friction is checked."""
    n_voussoir = len(ring.voussoirs)
    n_joint = n_voussoir if free_end else n_voussoir + 1
    coefficient = checks.shared_or_each("friction", friction, n_joint, "joint", infinite=True)
    load = checks.shared_or_each(
        "dead_load", 0.0 if dead_load is None else dead_load, n_voussoir, "voussoir", "N"
    )
    density = checks.number("density", density, "kg/m3")
    depth = checks.number("depth", depth)
    given = {
        "profile": profile,
        **shape,
        "friction": plain(friction),
        "density": density,
        "depth": depth,
    }
    if profile != "block":
        given["dead_load"] = None if dead_load is None else plain(dead_load)
    return {
        "chain": assemble(ring, coefficient, density * depth, load, free_end),
        "intrados": ring.lines.intrados,
        "extrados": ring.lines.extrados,
        "outlines": tuple(figure.outline for figure in ring.voussoirs),
        "free_end": free_end,
        "flipped": ring.sense < 0,
        "parameters": given,
    }


def plain(value: ArrayLike) -> Any:
    """Numbers as strict JSON takes them: nested lists of floats, infinity as "inf"."""
    if isinstance(value, list):
        return [plain(item) for item in value]
    listed = np.asarray(value, dtype=float).tolist()
    if isinstance(listed, list):
        return plain(listed)
    return "inf" if math.isinf(listed) else listed
