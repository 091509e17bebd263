"""Units of acceleration that a record may be given in."""

from archfrag.errors import RecordError

STANDARD_GRAVITY = 9.80665  # [m/s2]
METRES_PER_SECOND_SQUARED = {
    "m/s2": 1.0,
    "cm/s2": 1e-2,
    "gal": 1e-2,
    "mm/s2": 1e-3,
    "g": STANDARD_GRAVITY,
}


def unit_factor(unit: str, place: str) -> float:
    """What a value in `unit` is multiplied by to be in m/s2."""
    try:
        return METRES_PER_SECOND_SQUARED[unit]
    except (KeyError, TypeError):
        allowed = ", ".join(METRES_PER_SECOND_SQUARED)
        raise RecordError(
            f"{place}: unknown unit {unit!r} of acceleration; allowed are {allowed}"
        ) from None
