"""Intensity measures of a ground motion, all in SI units.

They are those of its horizontal component, but for RotD50 and RotD100, which need the other
horizontal one too. No measure changes the record: nothing is demeaned, filtered or tapered here
(see `process`).

AvgSA: geometric mean of Sa at 10 periods, equally spaced in logarithm: Eads, Miranda and Lignos
(2015), EESD 44(12). HI: integral of the pseudo-spectral velocity from 0.1 to 2.5 s (Housner 1952,
"Spectrum intensities of strong-motion earthquakes"). ASI: integral of Sa from 0.1 to 0.5 s (Von
Thun et al. 1988). Damping 5 %; trapezoid rule, steps of 0.02 and 0.01 s. RotD50 and RotD100:
percentiles over 180 directions of the horizontal plane, Boore (2010), BSSA 100(4).
"""

import re
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, RecordError
from archfrag.motions import integrals
from archfrag.motions.motion import Motion
from archfrag.motions.process import velocity
from archfrag.motions.spectra import peaks_by_angle, response_spectrum, rotated_spectrum

AVERAGED_PERIODS = 10
_PLAIN = {
    "PGA": "m/s2", "PGV": "m/s", "PGD": "m", "Arias": "m/s", "CAV": "m/s", "CAVstd": "m/s",
    "D5_75": "s", "D5_95": "s", "HI": "m", "ASI": "m/s",
}  # fmt: skip
_OF_PERIODS = {"Sa": (1, "m/s2"), "AvgSA": (2, "m/s2"), "FIV3": (1, "m/s")}
_SPELLINGS = {"SA": "Sa", "SaAvg": "AvgSA"}
_ROTATED = re.compile(r"(RotD(?:50|100))\((.*)\)")
_WITH_PERIODS = re.compile(r"(Sa|SA|AvgSA|SaAvg|FIV3)\(([^()]*)\)")
_ALLOWED = (
    f"{', '.join(_PLAIN)}, Sa(T), AvgSA(T1,T2), FIV3(T) with periods in seconds, and RotD50() or "
    "RotD100() of PGA, PGV or Sa(T)"
)
# Integrals of a spectrum over these periods [s].
_INTEGRALS = {"HI": np.linspace(0.1, 2.5, 121), "ASI": np.linspace(0.1, 0.5, 41)}


class Measure(NamedTuple):
    """A parsed name: its kind, its periods [s] if any, and the SI unit of its values.

    `rotated` is RotD50 or RotD100 where it is one of those of the kind, else empty.
    """

    kind: str
    periods: tuple[float, ...]
    unit: str
    rotated: str = ""


def parse_measure(name: str) -> Measure:
    """Read the name of an intensity measure.

    Parameters
    ----------
    name : str
        ``PGA``, ``PGV``, ``PGD``, ``Arias``, ``CAV``, ``CAVstd``, ``D5_75``, ``D5_95``, ``HI``,
        ``ASI``, ``Sa(0.5)`` or ``SA(0.5)``, ``AvgSA(0.2,1.0)`` or ``SaAvg(0.2,1.0)``,
        ``FIV3(0.5)``, ``RotD50(Sa(0.5))``, ``RotD100(PGA)``.

    Raises
    ------
    InputError
        If the name is none of these or a period is not a positive number.

    Examples
    --------
    >>> from archfrag.motions.measures import parse_measure
    >>> parse_measure("SaAvg(0.2, 1.0)")
    Measure(kind='AvgSA', periods=(0.2, 1.0), unit='m/s2', rotated='')
    """
    text = name.strip() if isinstance(name, str) else ""
    rotated = _ROTATED.fullmatch(text)
    if rotated:
        inner = parse_measure(rotated.group(2))
        if inner.kind not in ("PGA", "PGV", "Sa") or inner.rotated:
            raise InputError(f"intensity measure {name!r} must be of PGA, PGV or Sa(T)")
        return inner._replace(rotated=rotated.group(1))
    if text in _PLAIN:
        return Measure(text, (), _PLAIN[text])
    found = _WITH_PERIODS.fullmatch(text)
    if not found:
        meant = [key for key in _PLAIN if get_close_matches(text.upper(), [key.upper()])]
        hint = f" (did you mean {meant[0]}?)" if meant else ""
        raise InputError(f"unknown intensity measure {name!r}{hint}; allowed are {_ALLOWED}")
    kind = _SPELLINGS.get(found.group(1), found.group(1))
    try:
        periods = tuple(float(part) for part in found.group(2).split(","))
    except ValueError:
        periods = ()
    count, unit = _OF_PERIODS[kind]
    if len(periods) != count or not all(np.isfinite(p) and p > 0.0 for p in periods):
        needed = f"{count} period(s) in seconds, each above 0"
        raise InputError(f"intensity measure {name!r} needs {needed}")
    if kind == "AvgSA" and periods[0] >= periods[1]:
        raise InputError(f"intensity measure {name!r} needs its shorter period first")
    return Measure(kind, periods, unit)


def measure_unit(name: str) -> str:
    """SI unit of the values of an intensity measure: ``m/s2``, ``m/s``, ``m`` or ``s``."""
    return parse_measure(name).unit


def scaling_exponent(name: str) -> int:
    """Power of a factor on a motion with which a measure grows; 0 if it follows no power."""
    kind = parse_measure(name).kind
    return 0 if kind in ("D5_75", "D5_95", "CAVstd") else 2 if kind == "Arias" else 1


def measure(motion: Motion, name: str) -> float:
    """Value of the named intensity measure in its SI unit (see `parse_measure`)."""
    return measure_all(motion, (name,))[name]


def measure_all(motion: Motion, names: Iterable[str]) -> dict[str, float]:
    """Values of several intensity measures by name, in SI units; one pass for all spectra.

    Raises
    ------
    InputError
        If a name is none that `parse_measure` knows, or needs the other horizontal component and
        the motion has none.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> from archfrag.motions.measures import measure_all
    >>> motion = af.Motion(np.sin(np.arange(0.0, 4.0 * np.pi, 0.01)), dt=0.01)
    >>> {name: round(value, 2) for name, value in measure_all(motion, ["PGA", "CAV"]).items()}
    {'PGA': 1.0, 'CAV': 8.0}
    """
    wanted = {name: parse_measure(name) for name in names}
    plain = {name: found for name, found in wanted.items() if not found.rotated}
    periods = sorted({t for found in plain.values() for t in _spectral_periods(found)})
    spectrum = dict(zip(periods, spectral_acceleration(motion, periods) if periods else ()))
    values = {name: _value(motion, found, spectrum) for name, found in plain.items()}
    values |= {name: _rotated(motion, found) for name, found in wanted.items() if found.rotated}
    return {name: values[name] for name in wanted}


def pga(motion: Motion) -> float:
    """Peak ground acceleration: the largest absolute sample [m/s2]."""
    return float(max(motion.acceleration.max(), -motion.acceleration.min()))


def spectral_acceleration(
    motion: Motion, periods: ArrayLike, damping: float = 0.05
) -> NDArray[np.float64]:
    """Pseudo-spectral acceleration of linear oscillators [m/s2].

    The largest (2 pi / T)^2 |u| of u'' + 2 z w u' + w^2 u = -a(t) from rest, with a(t) linear
    between samples, by the exact recursion of Nigam and Jennings (1969), BSSA 59(2). Peaks are
    looked for at 200 points of a period or more, between samples where a period has fewer of them
    (to 0.1 %, even of white noise). The acceleration falls to zero in one step after the record;
    the free vibration that follows counts.

    Parameters
    ----------
    motion : Motion
    periods : array_like, shape (n_period,) [s]
    damping : float
        Fraction of critical damping, in [0, 1).

    Returns
    -------
    numpy.ndarray, shape (n_period,) [m/s2]

    Raises
    ------
    InputError
        If a period is not positive or the damping is outside [0, 1).
    """
    return response_spectrum(motion.acceleration, motion.dt, periods, damping)


def scale_factor(motion: Motion, measure_name: str, level: float) -> float:
    """Factor by which the acceleration must be multiplied to reach a level.

    Parameters
    ----------
    motion : Motion
    measure_name : str
        See `parse_measure`. Arias intensity grows with the square of
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


_SIMPLE: dict[str, Callable[..., float]] = {
    "PGA": pga, "PGV": integrals.pgv, "PGD": integrals.pgd, "Arias": integrals.arias,
    "CAV": integrals.cav, "CAVstd": integrals.cav_standardised, "FIV3": integrals.fiv3,
    "D5_75": partial(integrals.significant_duration, end=0.75),
    "D5_95": integrals.significant_duration,
}  # fmt: skip


def _rotated(motion: Motion, found: Measure) -> float:
    """RotD50 or RotD100 of PGA, PGV or Sa as `found` states."""
    if motion.across is None:
        needed = f"{found.rotated} needs two horizontal components, and there is one"
        raise InputError(f"{motion.id or 'motion'}: {needed}")
    pair = (motion.acceleration, motion.across)
    if found.kind == "Sa":
        peaks = rotated_spectrum(pair, motion.dt, found.periods)[0]
    else:
        if found.kind == "PGV":
            pair = (velocity(motion), velocity(motion._replaced(acceleration=motion.across)))
        peaks = peaks_by_angle(*pair)
    return float(np.percentile(peaks, 50.0 if found.rotated == "RotD50" else 100.0))


def _spectral_periods(found: Measure) -> tuple[float, ...]:
    """Periods at which Sa is needed for a measure."""
    if found.kind == "AvgSA":
        shortest, longest = found.periods
        return tuple(np.geomspace(shortest, longest, AVERAGED_PERIODS).tolist())
    if found.kind in _INTEGRALS:
        return tuple(_INTEGRALS[found.kind].tolist())
    return found.periods if found.kind == "Sa" else ()


def _value(motion: Motion, found: Measure, spectrum: dict[float, float]) -> float:
    at = np.array([spectrum[period] for period in _spectral_periods(found)])
    if found.kind in ("Sa", "AvgSA"):
        return float(at[0] if at.size == 1 else np.exp(np.log(at).mean())) if at.all() else 0.0
    if found.kind in _INTEGRALS:
        periods = _INTEGRALS[found.kind]
        velocities = at * periods / (2.0 * np.pi) if found.kind == "HI" else at
        return float(np.trapezoid(velocities, periods))
    return _SIMPLE[found.kind](motion, *found.periods)
