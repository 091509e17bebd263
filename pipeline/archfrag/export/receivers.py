"""Names and units of intensity measures in the programs that receive curves."""

from typing import NamedTuple

from archfrag.errors import InputError
from archfrag.motions.measures import parse_measure
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

    @property
    def remark(self) -> str:
        """The note as the end of a description."""
        return f" Note: {self.note}." if self.note else ""


_PER_G = 1.0 / STANDARD_GRAVITY
#: By receiver (OpenQuake: hazardlib's imt.py) and kind of measure: name, unit, factor from SI.
_KNOWN = {
    "OpenQuake": {
        "PGA": ("PGA", "g", _PER_G),
        "PGV": ("PGV", "cm/s", 100.0),
        "PGD": ("PGD", "cm", 100.0),
        "Arias": ("IA", "m/s", 1.0),
        "CAV": ("CAV", "g s", _PER_G),
        "Sa": ("SA({0!r})", "g", _PER_G),
        "AvgSA": ("AvgSA", "g", _PER_G),
        "FIV3": ("FIV3({0!r})", "cm/s", 100.0),
    },
    "pelicun": {
        "PGA": ("Peak Ground Acceleration", "g", _PER_G),
        "PGV": ("Peak Ground Velocity", "cmps", 100.0),
        "Sa": ("Spectral Acceleration|{0!r}", "g", _PER_G),
    },
    "IN-CORE": {
        "PGA": ("PGA", "g", _PER_G),
        "PGV": ("PGV", "cm/s", 100.0),
        "PGD": ("PGD", "m", 1.0),
        "Sa": ("{0!r} Sec Sa", "g", _PER_G),
    },
}


def named_measure(receiver: str, measure: str) -> Named:
    """Name and unit of a measure in ``"OpenQuake"``, ``"pelicun"`` or ``"IN-CORE"``."""
    parsed, known = parse_measure(measure), _KNOWN[receiver]
    if (receiver, parsed.kind) == ("pelicun", "PGD"):
        raise InputError(
            "pelicun has no demand type for PGD, the peak displacement of the ground: its PGD is "
            "permanent ground deformation"
        )
    if parsed.kind not in known:
        raise InputError(
            f"{receiver} has no name for the intensity measure {measure}; it knows "
            f"{', '.join(known)}; csv and parquet take any"
        )
    name, unit, factor = known[parsed.kind]
    notes = []
    if parsed.kind == "AvgSA":
        first, last = parsed.periods
        notes.append(
            "OpenQuake's AvgSA must be the geometric mean of spectral accelerations from "
            f"{first:g} to {last:g} s, as {measure} is; its periods are set with the "
            "ground-motion model"
        )
    if parsed.rotated:
        must = f"must be {parsed.rotated} of two horizontal components"
        notes.append(f"the values of {parsed.kind} {must}")
    return Named(name.format(*parsed.periods), unit, factor, "; ".join(notes))
