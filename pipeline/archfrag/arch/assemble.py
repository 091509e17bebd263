"""From a ring of voussoirs to the chain of rigid bodies that the mechanics take."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.arch import STANDARD_GRAVITY, checks
from archfrag.arch.ring import Ring
from archfrag.errors import GeometryError
from archfrag.mechanics.types import Chain


def fields_of(
    profile: str,
    shape: dict[str, Any],
    ring: Ring,
    friction: ArrayLike,
    free_end: bool = False,
    density: float = 2000.0,
    depth: float = 1.0,
    dead_load: ArrayLike | None = None,
) -> dict[str, Any]:
    """Attributes of an `Arch`, from its ring and what gives it mass and friction, checked here."""
    n_voussoir = len(ring.voussoirs)
    n_joint = n_voussoir if free_end else n_voussoir + 1
    coefficient = checks.shared_or_each("friction", friction, n_joint, "joint", infinite=True)
    load = 0.0 if dead_load is None else dead_load
    weight = checks.shared_or_each("dead_load", load, n_voussoir, "voussoir", "N")
    density = checks.number("density", density, "kg/m3")
    depth = checks.number("depth", depth)
    matter = {"friction": plain(friction), "density": density, "depth": depth}
    if profile != "block":
        matter["dead_load"] = plain(dead_load)
    mass, inertia, centroid = _bodies(ring, density * depth, weight / STANDARD_GRAVITY)
    corners = np.stack([ring.lines.intrados, ring.lines.extrados], axis=1)
    if ring.sense < 0:
        corners = corners[:, ::-1]
    face_before, face_after = corners[:n_joint].copy(), corners[:n_joint].copy()
    face_before[1:] -= centroid[: n_joint - 1, None]
    face_after[:n_voussoir] -= centroid[:, None]
    chain = Chain(
        mass, inertia, np.ascontiguousarray(centroid), face_before, face_after, coefficient,
        STANDARD_GRAVITY,
    )  # fmt: skip
    return {
        "chain": chain,
        "intrados": ring.lines.intrados,
        "extrados": ring.lines.extrados,
        "outlines": tuple(figure.outline for figure in ring.voussoirs),
        "free_end": free_end,
        "flipped": ring.sense < 0,
        "parameters": {"profile": profile, **shape, **matter},
    }


def _bodies(
    ring: Ring, surface_density: float, added: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Masses, inertias and centroids of voussoirs with point masses `added` on their backs.

    A point mass p at the distance d from the centroid of a body of mass m and inertia J moves
    the centroid by p/(m + p) of d and gives J + m p/(m + p) d² about the new one.
    """
    area, plane_centroid, polar = (
        np.array([getattr(figure.section, name) for figure in ring.voussoirs])
        for name in ("area", "centroid", "polar")
    )
    # Whatever overflows here is refused below.
    with np.errstate(all="ignore"):
        own = surface_density * area
        mass = own + added
        lever = np.array([figure.back for figure in ring.voussoirs]) - plane_centroid
        centroid = plane_centroid + (added / mass)[:, None] * lever
        inertia = surface_density * polar + own * (added / mass) * (lever**2).sum(axis=1)
        good = (mass > 0.0) & (inertia > 0.0) & np.isfinite(mass + inertia + centroid.sum(axis=1))
    if not good.all():
        body = int(np.argmin(good))
        raise GeometryError(
            f"voussoir {body} has a mass of {mass[body]:.6g} kg and an inertia of "
            f"{inertia[body]:.6g} kg m2; both must be finite and greater than 0. Check its size, "
            "density, depth and dead_load"
        )
    return mass, inertia, centroid


def plain(value: ArrayLike | None) -> Any:
    """Numbers as strict JSON takes them: nested lists of floats, infinity as "inf"."""
    if value is None:
        return None
    if isinstance(value, list):
        return [plain(item) for item in value]
    listed = np.asarray(value, dtype=float).tolist()
    if isinstance(listed, list):
        return plain(listed)
    return "inf" if math.isinf(listed) else listed
