"""Names and units of intensity measures in the programs that receive curves."""

from typing import NamedTuple

from archfrag.errors import InputError
from archfrag.motions.measures import Measure, parse_measure
from archfrag.motions.units import STANDARD_GRAVITY


class Named(NamedTuple):
    """An intensity measure as a receiver calls it.

    `factor` times a value in SI gives the value in `unit`; `note` is empty or states what the
    receiver's measure must be for the curve to hold.
    """

    name: str
    unit: str
    factor: float
    note: str


_PER_G = 1.0 / STANDARD_GRAVITY
_OPENQUAKE = {
    "PGA": ("PGA", "g", _PER_G),
    "PGV": ("PGV", "cm/s", 100.0),
    "PGD": ("PGD", "cm", 100.0),
    "Arias": ("IA", "m/s", 1.0),
    "CAV": ("CAV", "g s", _PER_G),
    "Sa": ("SA({0!r})", "g", _PER_G),
    "AvgSA": ("AvgSA", "g", _PER_G),
    "FIV3": ("FIV3({0!r})", "cm/s", 100.0),
}
_PELICUN = {
    "PGA": ("Peak Ground Acceleration", "g", _PER_G),
    "PGV": ("Peak Ground Velocity", "cmps", 100.0),
    "Sa": ("Spectral Acceleration|{0!r}", "g", _PER_G),
}
_IN_CORE = {
    "PGA": ("PGA", "g", _PER_G),
    "PGV": ("PGV", "cm/s", 100.0),
    "PGD": ("PGD", "m", 1.0),
    "Sa": ("{0!r} Sec Sa", "g", _PER_G),
}


def openquake_measure(measure: str) -> Named:
    """OpenQuake's name and unit of a measure (hazardlib's imt.py)."""
    parsed = parse_measure(measure)
    named = _named("OpenQuake", measure, parsed, _OPENQUAKE)
    if parsed.kind == "AvgSA":
        first, last = parsed.periods
        note = (
            "OpenQuake's AvgSA must be the geometric mean of spectral accelerations from "
            f"{first:g} to {last:g} s, as {measure} is; its periods are set with the "
            "ground-motion model"
        )
        return named._replace(note="; ".join(filter(None, (note, named.note))))
    return named


def pelicun_measure(measure: str) -> Named:
    """Demand type and unit of a measure in pelicun."""
    parsed = parse_measure(measure)
    if parsed.kind == "PGD":
        raise InputError(
            "pelicun has no demand type for PGD, the peak displacement of the ground: its PGD is "
            "permanent ground deformation"
        )
    return _named("pelicun", measure, parsed, _PELICUN)


def in_core_measure(measure: str) -> Named:
    """Demand type and unit of a measure in IN-CORE."""
    return _named("IN-CORE", measure, parse_measure(measure), _IN_CORE)


def _named(
    receiver: str, measure: str, parsed: Measure, known: dict[str, tuple[str, str, float]]
) -> Named:
    if parsed.kind not in known:
        raise InputError(
            f"{receiver} has no name for the intensity measure {measure}; it knows "
            f"{', '.join(known)}; csv and parquet take any"
        )
    name, unit, factor = known[parsed.kind]
    note = ""
    if parsed.rotated:
        note = f"the values of {parsed.kind} must be {parsed.rotated} of two horizontal components"
    return Named(name.format(*parsed.periods), unit, factor, note)
