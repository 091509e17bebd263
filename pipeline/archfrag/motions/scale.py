"""Scaling a motion to a level of an intensity measure."""

import numpy as np

from archfrag.errors import InputError, RecordError
from archfrag.motions.measures import measure, parse_measure, scaling_exponent
from archfrag.motions.motion import Motion


def scale_factor(motion: Motion, measure_name: str, level: float) -> float:
    """Factor by which the acceleration must be multiplied to reach a level.

    Parameters
    ----------
    motion : Motion
    measure_name : str
        See `archfrag.motions.measures.parse_measure`. Arias intensity grows with the square of
        the factor; a duration does not change with it and is refused.
    level : float
        Wanted value in the SI unit of the measure, above 0.

    Raises
    ------
    InputError
        If the level is not a positive number or the measure does not change with scaling.
    RecordError
        If the record has no motion to scale.
    """
    exponent = scaling_exponent(measure_name)
    if not exponent:
        raise InputError(
            f"intensity measure {measure_name!r} does not change when a record is scaled, or "
            "by no power of the factor; use PGA, PGV, PGD, Arias, CAV, HI, ASI, Sa(T), "
            "AvgSA(T1,T2) or FIV3(T)"
        )
    if not (np.isfinite(level) and level > 0.0):
        unit = parse_measure(measure_name).unit
        raise InputError(f"level {level} {unit} of {measure_name} must be a number above 0")
    return factor_of(motion, measure_name, measure(motion, measure_name), level)


def factor_of(motion: Motion, measure_name: str, value: float, level: float) -> float:
    """As `scale_factor` of a motion whose value in the measure is known.

    Raises
    ------
    RecordError
        If the value is 0.
    """
    if value == 0.0:
        raise RecordError(
            f"{motion.id or 'motion'}: {measure_name} of the record is 0, so no factor can bring "
            f"it to {level:g}"
        )
    return float((level / value) ** (1.0 / scaling_exponent(measure_name)))
