"""Intensity measures of a ground motion, all in SI units.

They are measures of its horizontal component. RotD50 and RotD100 of any of them are percentiles
of it in 180 directions of the horizontal plane, a degree apart, Boore (2010), BSSA 100(4); they
need the second horizontal component. No measure changes the record: filter a raw record first
(see `process`), since its velocity means nothing as it is. Samples are integrated from rest by
the trapezoid rule. Damping is 5 %.

Arias intensity: pi / (2 g) times the integral of the squared acceleration, Arias (1970). CAV:
integral of the absolute acceleration, linear between samples, EPRI (1988), NP-5930. CAVstd: CAV of
those seconds alone in which the peak is 0.025 g or more, EPRI (1991), TR-100082. D5_95: time from
5 to 95 % of the Arias intensity, Trifunac and Brady (1975), BSSA 65(3). HI: integral of the
pseudo-spectral velocity from 0.1 to 2.5 s in steps of 0.02 s, Housner (1952), "Spectrum
intensities". AvgSA: geometric mean of Sa at 10 periods, equally spaced in logarithm, Eads, Miranda
and Lignos (2015), EESD 44(12). Sa_avg2 and Sa_avg3: geometric mean of Sa at 10 equally spaced
periods from 0.2 T to 2 T or 3 T, as in Aristeidou, Shahnazaryan and O'Reilly (2024), Soil Dyn.
Earthquake Eng. 184, whose model OpenQuake has for these names.

FIV3(T): filtered incremental velocity, Davalos and Miranda (2019), EESD 48(12), Eq 3, with alpha
0.7 and beta 0.85. The acceleration passes once, forwards in time, through a low-pass Butterworth
filter of second order with corner beta / T, made by the bilinear transform; no filter is needed
where the corner is not below the Nyquist frequency. From each sample on it is integrated over
alpha T, as far as the record reaches; its integral is linear between samples. FIV3 is the
largest of two sums: of the three highest local maxima, and of the three lowest local minima, in
magnitude. It is 0 if the record is shorter than alpha T. Programs that filter backwards too have
a filter of fourth order, and smaller values.

Spectra are of linear oscillators under an acceleration that is linear between samples, by the
recursion of Nigam and Jennings (1969), BSSA 59(2), exact for such a motion. Between two samples
the response y = w^2 u to an acceleration a + s t is a particular solution and a free vibration,
y = -a - s t + 2 z s / w + f(t). Where the slope s changes by ds, y and y' stay as they are: f
changes by -2 z ds / w, and g = f' / w by ds / w.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, RecordError
from archfrag.files import Named, number
from archfrag.motions.channel import STANDARD_GRAVITY, Samples, check_right_angle
from archfrag.physics.oscillator import largest_response

# By the SI unit of a measure: the units in which its levels may be given, with their factors.
LEVEL_UNITS: dict[str, dict[str, float]] = {
    "m/s2": {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01},
    "m/s": {"m/s": 1.0, "cm/s": 0.01},
    "m": {"m": 1.0, "cm": 0.01},
}
Shaking = Any  # an `archfrag.Motion`, which imports this file
_DAMPING = 0.05  # fraction of critical
_DIGITS = 10  # of a spectrum; more depend on the machine's exponential function
_ANGLES = np.deg2rad(np.arange(180.0))  # of directions in the horizontal plane
_HUSID = np.pi / (2.0 * STANDARD_GRAVITY)
_HOUSNER = np.linspace(0.1, 2.5, 121)  # [s]
_SPELLINGS = {"SA": "Sa", "SaAvg": "AvgSA"}
# Limits beyond which reading adds a caution. In 106 components of nine agencies (mean removed from
# raw ones) the largest offset is 0.0001, the largest drift 0.09 and the largest peak in the last
# second 0.15; one more, an analogue record, drifts by 0.25.
OFFSET = 0.01  # of the mean to the peak
DRIFT = 0.2  # of the velocity at the end, or of its mean over a record, to its peak
SHORT = 10.0  # [s]
SHAKING = 0.25  # of the peak in the last second to that of the record
# ALONE: a sample stands alone if it exceeds by this factor all samples 2 to 5 places away. SPIKE:
# there is a question if the peak falls by this factor without such samples; in real records it
# falls by 1.2 at most. FLAT: so many equal samples at the peak raise one; real records have at
# most 2. STUCK: so does a longer constant stretch within the motion; real records have at most 33
# equal samples there (0.17 s, a weak raw record).
ALONE = 2.5
SPIKE = 1.8
FLAT = 3  # [samples]
STUCK = 0.5  # [s]
_NEAR = np.array([-5, -4, -3, -2, 2, 3, 4, 5])


class Measure(NamedTuple):
    """A parsed name: its kind, its periods [s] if any, and the SI unit of its values."""

    kind: str
    periods: tuple[float, ...]
    unit: str
    rotated: str = ""  # RotD50 or RotD100


def integral(samples: Samples, dt: float) -> Samples:
    """Return the integral from the first sample by the trapezoid rule, shape (n_sample,)."""
    values = np.zeros(samples.size)
    np.add(samples[1:], samples[:-1], out=values[1:])
    values *= 0.5 * dt
    return np.cumsum(values, out=values)


def arias_times(
    motion: Shaking, transverse: Samples | None, fractions: Sequence[float]
) -> list[float]:
    """Return the times [s] at which the Arias intensity reaches `fractions` of its final value.

    The intensity is that of the motion's horizontal component, plus that of `transverse` [m/s2]
    if this is given. All times are 0 if the motion is zero.
    """
    squares = motion.acceleration**2 + (0.0 if transverse is None else transverse**2)
    husid = _HUSID * integral(squares, motion.dt)
    moved = husid[-1] != 0.0
    return [
        float(np.interp(part * husid[-1], husid, motion.time)) if moved else 0.0
        for part in fractions
    ]


def peak_of(values: Samples) -> float:
    """Return the largest magnitude."""
    return float(np.abs(values).max())


def _cav(motion: Shaking, count: int = 2**16, least: float = 0.0) -> float:
    """Return CAV [m/s], summed over the windows of `count` steps with a peak >= `least` [m/s2]."""
    record = motion.acceleration
    total = 0.0
    for start in range(0, record.size - 1, count):
        part = record[start : start + count + 1]
        if peak_of(part) >= least:
            before, after = np.abs([part[:-1], part[1:]])
            # Integral of |a| over each step, a linear in it.
            sizes = before + after
            crossing = part[:-1] * part[1:] < 0.0
            squares = before**2 + after**2
            np.divide(squares, sizes, out=sizes, where=crossing)
            total += (0.5 * motion.dt * sizes).sum()
    return total


def _fiv3(
    motion: Shaking, period: float, alpha: float = 0.7, beta: float = 0.85
) -> float:
    """Return FIV3 [m/s] at a period [s]."""
    filtered = motion.acceleration
    corner = 2.0 * beta / period * motion.dt
    if corner < 1.0:
        filtered = scipy.signal.lfilter(*scipy.signal.butter(2, corner), filtered)
    velocity = integral(filtered, motion.dt)
    ends = motion.time + alpha * period
    ends = ends[ends <= motion.duration]
    steps = np.interp(ends, motion.time, velocity) - velocity[: ends.size]
    sums = []
    for side in (steps, -steps):
        extremes = np.sort(side[scipy.signal.find_peaks(side)[0]])
        sums.append(abs(extremes[-3:].sum()))
    return max(sums)


def _mean(spectrum: Samples, periods: Samples) -> float:
    """Return the geometric mean of Sa, (n_period,)."""
    return np.exp(np.log(spectrum).mean()) if spectrum.all() else 0.0


def _intensity(spectrum: Samples, periods: Samples) -> float:
    """Return the integral over `periods` of the pseudo-spectral velocity of Sa, (n_period,)."""
    return float(np.trapezoid(spectrum * periods / (2.0 * np.pi), periods))


def _multiples(most: float, period: float) -> Samples:
    return period * np.linspace(0.2, most, 10)


# By kind of measure: its SI unit; the power p, if a factor f on the motion multiplies it by f**p,
# else 0; the number of periods in its name; the function of a motion and these periods. If it is
# one of a spectrum, this function is one of Sa and of the periods of Sa, and what follows gives
# the latter by the periods in its name.
_KINDS: Named = {
    "PGA": ("m/s2", 1, 0, lambda m: peak_of(m.acceleration)),
    "PGV": ("m/s", 1, 0, lambda m: peak_of(integral(m.acceleration, m.dt))),
    "PGD": (
        "m",
        1,
        0,
        lambda m: peak_of(integral(integral(m.acceleration, m.dt), m.dt)),
    ),
    "Arias": ("m/s", 2, 0, lambda m: _HUSID * integral(m.acceleration**2, m.dt)[-1]),
    "CAV": ("m/s", 1, 0, _cav),
    "CAVstd": (
        "m/s",
        0,
        0,
        lambda m: _cav(m, round(1.0 / m.dt) or 1, 0.025 * STANDARD_GRAVITY),
    ),
    "D5_95": ("s", 0, 0, lambda m: np.diff(arias_times(m, None, (0.05, 0.95)))[0]),
    "HI": ("m", 1, 0, _intensity, lambda: _HOUSNER),
    "Sa": ("m/s2", 1, 1, lambda spectrum, _: spectrum[0], lambda period: period),
    "AvgSA": ("m/s2", 1, 2, _mean, lambda low, high: np.geomspace(low, high, 10)),
    "Sa_avg2": ("m/s2", 1, 1, _mean, partial(_multiples, 2.0)),
    "Sa_avg3": ("m/s2", 1, 1, _mean, partial(_multiples, 3.0)),
    "FIV3": ("m/s", 1, 1, _fiv3),
}
PLAIN = [name for name, kind in _KINDS.items() if not kind[2]]
_ALLOWED = (
    f"{', '.join(PLAIN)}, Sa(T), AvgSA(T1,T2), Sa_avg2(T), Sa_avg3(T), FIV3(T), RotD50() or "
    "RotD100() of any of these"
)


def parse_measure(name: str) -> Measure:
    """Read the name of an intensity measure; InputError for an unknown name or period.

    ``PGA``, ``PGV``, ``PGD``, ``Arias``, ``CAV``, ``CAVstd``, ``D5_95``, ``HI``, ``Sa(0.5)`` or
    ``SA(0.5)``, ``AvgSA(0.2,1.0)`` or ``SaAvg(0.2,1.0)``, ``Sa_avg2(0.5)``, ``Sa_avg3(0.5)``,
    ``FIV3(0.5)``, ``RotD50(...)`` and ``RotD100(...)`` of each, such as ``RotD50(Sa(0.5))``.

    >>> parse_measure("SaAvg(0.2, 1.0)")
    Measure(kind='AvgSA', periods=(0.2, 1.0), unit='m/s2', rotated='')
    """
    text = name.strip() if isinstance(name, str) else ""
    rotated = re.fullmatch(r"(RotD(?:50|100))\((.*)\)", text)
    if rotated:
        inner = parse_measure(rotated[2])
        if inner.rotated:
            raise InputError(f"intensity measure {name!r} is rotated twice")
        return inner._replace(rotated=rotated[1])
    word, _, inside = text.partition("(")
    kind = _SPELLINGS.get(word, word)
    unit, _, count, *_ = _KINDS.get(kind, ("", 0, 0))
    if not unit or bool(count) != text.endswith(")"):
        raise InputError(f"unknown intensity measure {name!r}; allowed are {_ALLOWED}")
    try:
        periods = tuple(number(part) for part in inside[:-1].split(",") if count)
    except ValueError:
        periods = ()
    if len(periods) != count or not all(0.0 < period < np.inf for period in periods):
        raise InputError(
            f"intensity measure {name!r} needs {count} period(s), each above 0 s"
        )
    if periods != tuple(sorted(set(periods))):
        raise InputError(f"intensity measure {name!r} needs its shorter period first")
    return Measure(kind, periods, unit)


def measure_unit(name: str) -> str:
    """Return the SI unit of an intensity measure: ``m/s2``, ``m/s``, ``m`` or ``s``."""
    return parse_measure(name).unit


def scaling_exponent(name: str) -> int:
    """Return the power p of a measure: a factor f on the motion multiplies it by f**p.

    It is 0 if the measure does not grow so, as D5_95 and CAVstd.
    """
    return _KINDS[parse_measure(name).kind][1]


def measure(motion: Shaking, name: str) -> float:
    """Return an intensity measure in its SI unit; InputError for an unknown name.

    RotD50 and RotD100 need two horizontal components: InputError if there is one only, RecordError
    if they are known not to be at right angles.
    """
    asked = parse_measure(name)
    _, _, _, value, *grid = _KINDS[asked.kind]
    if not (asked.rotated or grid):
        return float(value(motion, *asked.periods))
    ground = motion.acceleration
    angles = np.zeros(1)
    if asked.rotated:
        place = f"{motion.id or 'motion'}: {name}"
        if motion.transverse is None:
            raise InputError(f"{place} needs two horizontal components")
        check_right_angle(motion.facts, place, "; rotate them to an azimuth first")
        ground = ground + 1j * motion.transverse
        angles = _ANGLES
    if grid:
        periods = grid[0](*asked.periods)
        spectra = _spectrum(ground, motion.dt, periods, np.exp(1j * angles))
        values = [value(spectrum, periods) for spectrum in spectra.T]
    else:
        both = [ground.real, ground.imag]
        if (
            asked.kind == "PGV"
        ):  # integrated once, for velocities turn as accelerations do
            both = [integral(part, 1.0) * motion.dt for part in both]
            value = _KINDS["PGA"][3]
        turned = (both[0] * np.cos(a) + both[1] * np.sin(a) for a in angles)
        alone = replace(motion, vertical=None, transverse=None)
        values = [
            value(replace(alone, acceleration=row), *asked.periods) for row in turned
        ]
    return float(np.percentile(values, float(asked.rotated[4:] or 50)))


def measures_of(
    motions: Sequence[Shaking], names: Collection[str]
) -> list[dict[str, float]]:
    """Return some measures of each motion by name, with the errors of `measure`.

    The spectrum of a motion is computed once, for all periods of all measures.
    """
    grids: dict[str, tuple[Any, Samples]] = {}
    for name in names:
        asked = parse_measure(name)
        _, _, _, value, *grid = _KINDS[asked.kind]
        if grid and not asked.rotated:
            grids[name] = value, np.atleast_1d(grid[0](*asked.periods))
    periods = np.unique([each for _, grid in grids.values() for each in grid])
    found = []
    spectra = spectra_of(motions, periods) if periods.size else motions
    for motion, spectrum in zip(motions, spectra):
        values = {}
        for name in names:
            if name in grids:
                value, grid = grids[name]
                sa = spectrum[np.searchsorted(periods, grid)]
                values[name] = float(value(sa, grid))
            else:
                values[name] = measure(motion, name)
        found.append(values)
    return found


def spectral_acceleration(motion: Shaking, periods: ArrayLike) -> Samples:
    """Return the pseudo-spectral acceleration of linear oscillators, shape (n_period,) [m/s2].

    At each of the `periods` T [s] it is w^2 times the largest |u|, where w = 2 pi / T, z = 0.05
    and u'' + 2 z w u' + w^2 u = -a(t) from rest. u is evaluated at 200 or more points of a period,
    which gives its peak to 0.1 %, even under white noise. After the record the acceleration falls
    to zero in one step; the free vibration that follows counts. InputError unless all periods are
    above 0.
    """
    return _spectrum(motion.acceleration, motion.dt, periods)[:, 0]


def spectra_of(motions: Sequence[Shaking], periods: ArrayLike) -> Samples:
    """Return `spectral_acceleration` of some motions, shape (n_motion, n_period) [m/s2].

    Two motions are computed side by side, as parts of a complex number.
    """
    found: list[Samples] = []
    for pair in zip_longest(motions[::2], motions[1::2]):
        if pair[1] is None or pair[0].dt != pair[1].dt:
            found += (spectral_acceleration(one, periods) for one in pair if one)
            continue
        records = [motion.acceleration for motion in pair]
        ground = np.zeros(max(record.size for record in records), complex)
        for part, record in zip((ground.real, ground.imag), records):
            part[: record.size] = record
        found += list(_spectrum(ground, pair[0].dt, periods, (1.0, 1.0j)).T)
    return np.stack(found)


def scale_factor(
    motion: Shaking, measure_name: str, level: float, value: float | None = None
) -> float:
    """Return the factor on a motion that brings a measure to a `level`.

    `level` is in the SI unit of the measure. `value` is the measure of the motion without a
    factor; it is computed if not given. InputError if `level` is not above 0, or if the measure
    does not grow by a power of the factor. RecordError if the measure of the motion is 0.
    """
    exponent = scaling_exponent(measure_name)
    if not exponent:
        raise InputError(
            f"measure {measure_name!r} does not grow with scaling; use "
            f"{', '.join(name for name, kind in _KINDS.items() if kind[1])}"
        )
    if not 0.0 < level < np.inf:
        raise InputError(
            f"level {level} {measure_unit(measure_name)} of {measure_name} must be a number "
            "above 0"
        )
    value = measure(motion, measure_name) if value is None else value
    if value == 0.0:
        raise RecordError(f"{motion.id or 'motion'}: {measure_name} of the record is 0")
    return float((level / value) ** (1.0 / exponent))


def sample_cautions(samples: Samples, dt: float) -> list[str]:
    """Return cautions on accelerations [m/s2]: an offset, a drift, an end during strong motion."""
    peak = peak_of(samples)
    if not peak > 0.0:
        return []
    velocity = integral(samples, dt)
    offset = abs(samples.mean()) / peak
    slow = abs(velocity[-1])
    where = "at the end"
    mean = abs(velocity.mean())
    if (
        samples.size * dt > SHORT and mean > slow
    ):  # of a pulse it is not that of a drift
        slow = mean
        where = "on average"
    drift = slow / (peak_of(velocity) or 1.0)
    # The last second of a record, less of a short motion: a cycle of a sine ends at rest.
    last = max(2, round(min(1.0 / dt, 0.03 * samples.size)))
    shaking = peak_of(samples[-last:]) / peak
    cautions = (
        (
            offset > OFFSET,
            f"its mean is {offset:.2g} of its peak: an offset counts as motion; `demean`",
        ),
        (
            drift > DRIFT,
            f"its velocity {where} is {drift:.2g} of PGV: the baseline drifts; correct it by "
            "`baseline`, or by `detrend` and `bandpass`",
        ),
        (
            shaking > SHAKING,
            f"it has {shaking:.2g} of its peak within its last {last * dt:.2g} s: the record "
            "ends while it shakes; find a longer one",
        ),
    )
    return [text for is_so, text in cautions if is_so]


def odd_samples(samples: Samples, dt: float) -> list[str]:
    """Return questions about what no ground motion has: spikes, flat tops and gaps.

    `samples` are the accelerations as read from a file [m/s2].
    """
    about = samples - np.median(samples)
    return [*_spikes(about, dt), *_flat_parts(about, dt)] if about.any() else []


def _spikes(samples: Samples, dt: float) -> Iterator[str]:
    """Yield a question if samples that stand alone set the peak."""
    size = np.abs(samples)
    strong = np.flatnonzero(size >= 0.5 * size.max())
    near = np.pad(size, _NEAR.max())[strong[:, None] + _NEAR + _NEAR.max()].max(axis=1)
    alone = strong[size[strong] > ALONE * near]
    others = np.delete(size, np.clip(alone[:, None] + [-1, 0, 1], 0, size.size - 1))
    peak = size.max()
    rest = others.max(initial=0.0)
    if alone.size and 0.0 < SPIKE * rest < peak:
        time = alone[size[alone].argmax()] * dt
        yield (
            f"its peak, {peak:.4g} m/s2 at {time:.6g} s, stands alone: without {alone.size} such "
            f"sample(s) the peak is {rest:.4g} m/s2; is it a spike of the instrument?"
        )


def _flat_parts(samples: Samples, dt: float) -> Iterator[str]:
    """Yield a question if tops are cut off, and one if a stretch of the motion is constant."""
    size = np.abs(samples)
    peak = peak_of(samples)
    ends = np.flatnonzero(np.diff(samples, append=np.inf))
    lengths = np.diff(ends, prepend=-1)
    extreme = np.isin(samples[ends], [samples.max(), samples.min()]) & (
        size[ends] >= 0.5 * peak
    )
    tops = lengths[(lengths >= FLAT) & extreme]
    strong = np.flatnonzero(size >= 0.1 * peak)
    part = tops.sum() / np.count_nonzero(size >= 0.5 * peak)
    if tops.size > 1 or (tops.max(initial=0) > FLAT + 1 and part < 0.5):
        yield (
            f"{tops.size} time(s) it stays at its largest value for {FLAT} samples or more: did "
            "the instrument clip?"
        )
    inside = (ends > strong[0]) & (ends - lengths < strong[-1]) & ~extreme
    longest = int((lengths * inside).argmax())
    span = lengths[longest] * dt
    if inside[longest] and span > STUCK:
        start = (ends[longest] - lengths[longest] + 1) * dt
        yield (
            f"it is constant for {span:.4g} s from {start:.6g} s on: is a part of it missing?"
        )


def _spectrum(
    ground: NDArray[Any],
    dt: float,
    periods: ArrayLike,
    directions: ArrayLike = (1.0,),
) -> Samples:
    """Return Sa [m/s2] in each direction, shape (n_period, n_direction).

    `ground` is the first horizontal component plus i times the second [m/s2]. `directions` are
    complex numbers of size one.
    """
    chosen = np.atleast_1d(np.asarray(periods, float))
    if not (np.isfinite(chosen).all() and (chosen > 0.0).all()):
        raise InputError(
            f"periods {chosen.tolist()} must be positive numbers of seconds"
        )
    # A period after the record, in which it falls to zero within one step.
    after = np.ceil(chosen / dt).astype(int) + 2
    padded = np.pad(ground, (0, after.max(initial=0)))
    ways = np.asarray(directions, complex)
    largest = np.zeros((chosen.size, ways.size))
    rates = (2.0 * np.pi / chosen).tolist()
    for rate, count, row in zip(rates, after + ground.size, largest):
        largest_response(padded[:count], dt, rate, _DAMPING, ways, row)
    scale = 10.0 ** (
        _DIGITS - 1 - np.floor(np.log10(np.where(largest > 0.0, largest, 1.0)))
    )
    return np.round(largest * scale) / scale
