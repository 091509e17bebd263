"""Usual values of what people state: beyond them a unit or a number was probably mistaken."""

from collections.abc import Iterator
from typing import Any

import numpy as np

_UNIT = "is that its unit?"
# Key: unit, least and largest usual value, and what to ask.
USUAL: dict[str, tuple[str, float, float, str]] = {
    "span": ("m", 0.3, 200.0, _UNIT),
    "height": ("m", 0.3, 200.0, _UNIT),  # of a column, a wall or a block
    "thickness": ("m", 0.01, 10.0, _UNIT),
    "thickness_factor": (
        "",
        0.4,
        2.5,
        "is it the factor on the thickness that is drawn?",
    ),
    "density": ("kg/m3", 1000.0, 3500.0, _UNIT),
    "depth": ("m", 0.05, 100.0, _UNIT),
    "friction": ("", 0.0, 2.0, "was an angle meant?"),  # its coefficient
    "piers.height": ("m", 0.1, 200.0, _UNIT),
    "piers.width": ("m", 0.05, 50.0, _UNIT),
    "piers.base_width": ("m", 0.05, 50.0, _UNIT),
    "piers.density": ("kg/m3", 1000.0, 3500.0, _UNIT),
    "piers.depth": ("m", 0.05, 100.0, _UNIT),
    "fill.height_over_crown": ("m", 0.0, 20.0, _UNIT),
    "fill.unit_weight": ("N/m3", 5e3, 4e4, _UNIT),
    "fill.backing_unit_weight": ("N/m3", 5e3, 4e4, _UNIT),
    "strength": ("N/m2", 2e5, 3e8, _UNIT),  # from adobe to granite
    # From thick lime mortar to dry joints of hard stone.
    "joints.stiffness": ("Pa/m", 1e8, 1e13, _UNIT),
    "ties.area": ("m2", 1e-6, 0.1, _UNIT),
    "ties.modulus": ("N/m2", 1e9, 1e12, _UNIT),  # from timber to carbon fibre
    # The largest of levels or of a hazard curve, by the kind of the measure.
    "PGA": ("m/s2", 0.3, 100.0, _UNIT),
    "Sa": ("m/s2", 0.03, 200.0, _UNIT),
    "AvgSA": ("m/s2", 0.03, 200.0, _UNIT),
    "PGV": ("m/s", 0.02, 20.0, _UNIT),
    "PGD": ("m", 0.005, 20.0, _UNIT),
    "Arias": ("m/s", 0.02, 2000.0, _UNIT),
    "CAV": ("m/s", 0.2, 2000.0, _UNIT),
    "HI": ("m", 0.02, 100.0, _UNIT),
    "rate": ("1/year", 1e-6, 20.0, "is it a number a year?"),
    # Of an earthquake and of a record.
    "Mw": ("", 3.0, 9.6, "is it a moment magnitude?"),
    "distance_km": ("km", 0.0, 1000.0, _UNIT),
    "Vs30_mps": ("m/s", 80.0, 3000.0, _UNIT),
}


def unusual(key: str, value: Any, name: str = "") -> Iterator[str]:
    """Yield a question on the first of some values that is beyond the usual ones, if there is one.

    `key` is one of `USUAL`, any other has no bounds; `name` is its place, if that is longer.
    """
    unit, least, most, question = USUAL.get(key, ("", -np.inf, np.inf, ""))
    for one in np.ravel([] if value is None else value).tolist():
        if not least <= one <= most:
            stated = f"{name or key} = {one:.4g} {unit}".rstrip()
            yield f"{stated}: usual are {least:g} to {f'{most:g} {unit}'.rstrip()}; {question}"
            return
