"""Two horizontal components rotated into the plane of an arch."""

import re

import numpy as np

from archfrag.errors import InputError, RecordError
from archfrag.motions.motion import Motion
from archfrag.motions.partners import AZIMUTHS, quadrant

_LEAST_SINE = 0.5  # of the angle between two components that a plane can be made of


def azimuth_of_code(code: str) -> float | None:
    """Azimuth [degrees] by the name of a component: ``N``, ``EW1``, ``HNE``, ``180``, ``S45E``."""
    text = code.strip().upper().lstrip("-+")
    if (bearing := quadrant(text)) is not None:
        return bearing
    if re.fullmatch(r"\d{1,3}", text):
        return float(text) % 360.0 if len(text) > 1 else None
    if re.fullmatch(r"[A-Z][A-Z][NE]", text):
        text = text[-1]
    return AZIMUTHS.get(re.sub(r"\d$", "", text))


def rotate(motion: Motion, azimuth: float | None = None, angle: float | None = None) -> Motion:
    """The motion of the ground in another vertical plane, and across it.

    Parameters
    ----------
    motion : Motion
        With both horizontal components (`across`).
    azimuth : float [degrees]
        Of the +x of the arch, clockwise from north. The components' own azimuths must be known:
        ``azimuth`` and ``azimuth_across`` of the metadata.
    angle : float [degrees]
        In the place of `azimuth`: counted from the first component towards the other one, which
        is taken to be perpendicular.

    Raises
    ------
    RecordError
        If there is one component only, an azimuth is not known, or both are nearly parallel.
    InputError
        Unless one of `azimuth` and `angle` is given.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> from archfrag.motions.rotate import rotate
    >>> motion = af.Motion([0.0, 1.0, 0.0], 0.01, across=[0.0, 1.0, 0.0])
    >>> rotate(motion, angle=45.0).acceleration.round(3).tolist()
    [0.0, 1.414, 0.0]
    """
    name = motion.id or "motion"
    if (azimuth is None) == (angle is None):
        raise InputError("rotate: one of azimuth and angle is needed")
    if motion.across is None:
        raise RecordError(f"{name}: rotate needs two horizontal components, and there is one")
    codes = [str(motion.metadata.get(key, "")) for key in ("component", "component_across")]
    own = (0.0, 90.0) if azimuth is None else _azimuths(motion, codes)
    wanted = float(angle or 0.0) if azimuth is None else azimuth
    one, other = np.deg2rad(own)
    sine = np.sin(other - one)
    if abs(sine) < _LEAST_SINE:
        raise RecordError(
            f"{name}: components {codes[0]} and {codes[1]} have azimuths {own[0]:g} and "
            f"{own[1]:g} degrees, too close to each other to be rotated"
        )
    along = np.deg2rad(wanted)
    # a(azimuth) = N cos + E sin holds for both components; solved for the wanted direction.
    first, second = (
        np.float64(np.sin(other - direction) / sine) * motion.acceleration
        + np.float64(np.sin(direction - one) / sine) * motion.across
        for direction in (along, along + 0.5 * np.pi)
    )
    labels: dict[str, str | float] = {
        "component": f"{wanted:g}", "component_across": f"{wanted + 90.0:g}",
    }  # fmt: skip
    words = f"by {wanted:g} degrees from {codes[0]} towards {codes[1]}"
    if azimuth is not None:
        labels |= {"azimuth": wanted % 360.0, "azimuth_across": (wanted + 90.0) % 360.0}
        words = f"to azimuth {azimuth:g} degrees (from {own[0]:g} and {own[1]:g})"
    log = (*motion.log, f"Horizontal components {' and '.join(codes)} rotated {words}.")
    about = {**motion.metadata, **labels}
    return motion._replaced(acceleration=first, across=second, metadata=about, log=log)


def _azimuths(motion: Motion, codes: list[str]) -> tuple[float, float]:
    found = []
    for key, code in zip(("azimuth", "azimuth_across"), codes):
        given = motion.metadata.get(key)
        value = azimuth_of_code(code) if given in (None, "") else float(given)
        if value is None:
            raise RecordError(
                f"{motion.id or 'motion'}: the azimuth of component {code!r} is not known, so "
                "that it cannot be rotated to one; rotate by an angle from it"
            )
        found.append(value)
    return found[0], found[1]
