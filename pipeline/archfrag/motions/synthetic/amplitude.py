"""Fourier amplitude and duration of the ground motion at a site, and how the amplitude varies.

The source is the equivalent point source of Stafford, Boore, Youngs and Bommer (2022) [2]_, fitted
to the ground-motion model of Chiou and Youngs (2014): crustal earthquakes of active regions on
rock with Vs30 = 760 m/s, as the average over depths to the top of rupture. `median_adjustment`
brings its response spectra to the geometric mean of two ground-motion models.

The logarithm of the amplitude varies by normal terms of the earthquake (tau), the site (phi_s2s)
and the record (phi_ss), by [7]_ and [8]_. Each term is a row over frequency. Response spectra then
vary as those of records do, as [9]_ explains. For a vertical component the ratio V/H of response
spectra is that of [10]_ for strike-slip faults.

References
----------
.. [1] Boore (2003), Pure and Applied Geophysics 160, 635-676: the stochastic method.
.. [2] Stafford, Boore, Youngs and Bommer (2022), Earthquake Spectra 38(2), 917-949, optimised
   functional form.
.. [3] Boore and Thompson (2014), BSSA 104(5), 2541-2552, table 1: path durations, active regions.
.. [4] Al Atik and Abrahamson (2021), BSSA 111(4), 1765-1783: amplification of reference profiles.
.. [5] Bayless and Abrahamson (2019), BSSA 109(5), 2088-2105: c8 ln(min(Vs30, 1000) / 760); the
   nonlinear term is left out.
.. [6] Found by repetition: the amplitude at 1 / T is multiplied by the target Sa(T) over Sa(T) of
   many simulations (spectra brought back to Fourier amplitudes as by inverse random vibration
   theory: Al Atik et al. 2014, BSSA 104(1), 336-346). The target is the geometric mean of Chiou
   and Youngs (2014) and Abrahamson, Silva and Kamai (2014) for a vertical strike-slip fault.
   Beyond the table the factor is constant.
.. [7] Bayless and Abrahamson (2018), PEER report 2018/07, and its electronic supplement.
.. [8] Bayless and Abrahamson (2019), BSSA 109(3), 1058-1070: correlation between frequencies.
.. [9] Stafford (2017), BSSA 107(6), 2774-2791.
.. [10] Gulerce and Abrahamson (2011), Earthquake Spectra 27(4), 1023-1047.
"""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RegularGridInterpolator

from archfrag.motions.channel import STANDARD_GRAVITY, Samples

SHEAR_VELOCITY = 3.5  # [km/s]
# Boore (2003), after Saragoni and Hart (1974): where the window peaks and what is left of it at
# the end of its nominal length, which is twice the duration of ground motion.
WINDOW_PEAK = 0.2
_WINDOW_END = 0.05
WINDOW_LENGTH = 2.0
VS30 = 760.0  # [m/s]


def read_table(name: str) -> dict[str, Samples]:
    """Read the columns of a table of numbers beside this file, by their names."""
    lines = Path(__file__).with_name(name).read_text(encoding="utf-8").splitlines()
    head, *rows = (line.split(",") for line in lines if not line.startswith("#"))
    return dict(zip(head, np.array(rows, float).T))


# Coefficients of Bayless and Abrahamson by their names, at 61 frequencies [Hz].
COEFFICIENTS = read_table("bayless_abrahamson.csv")
FREQUENCIES = COEFFICIENTS["frequency_hz"]
GRID: Samples = np.geomspace(0.05, 50.0, 150)  # of integrals over frequency [Hz]
TERMS = {"event": "tau", "site": "phi_s2s", "record": "phi_ss"}
# Correlation of the record terms of a vertical with those of its horizontal: horizontals of one
# record have about 0.7 (Wang, Takedatsu, Olsen and Day 2019, BSSA 109(6)); with it the ratio of a
# vertical to its horizontal varies as Gulerce and Abrahamson found.
COMPONENT_CORRELATION = 0.7
RATIO = read_table("gulerce_abrahamson.csv")  # coefficients by period
_AMPLIFICATION = tuple(read_table("amplification.csv").values())
_ADJUSTMENT = read_table("adjustment.csv")
_MAGNITUDES, _DISTANCES = (
    np.unique(_ADJUSTMENT.pop(key)) for key in ("magnitude", "distance_km")
)
# ln factor by magnitude, distance and ln frequency.
_NODES = np.log(np.array([*_ADJUSTMENT], float))
_FACTORS = np.column_stack([*_ADJUSTMENT.values()]).reshape(
    _MAGNITUDES.size, _DISTANCES.size, -1
)


def at_frequencies(frequency: Samples, row: Samples) -> Samples:
    """Interpolate a row from ``FREQUENCIES`` to `frequency` [Hz], linearly in ln f."""
    return np.interp(np.log(frequency), np.log(FREQUENCIES), row)


def corner_frequency(magnitude: float) -> float:
    """Return Brune's (1970) corner, 4.9058e6 beta (stress / M0)^(1/3) [Hz, km/s, bar, dyne cm]."""
    stress = np.exp(4.599 + 0.4624 * min(magnitude - 5.0, 0.0))  # [bar]
    moment = 10.0 ** (1.5 * (magnitude + 10.7))  # Hanks and Kanamori (1979)
    return float(4.9058e6 * SHEAR_VELOCITY * np.cbrt(stress / moment))


def low_cut(magnitude: float) -> float:
    """Return the frequency of the low cut [Hz]: half the corner frequency, in 0.05 to 0.1 Hz."""
    return float(np.clip(0.5 * corner_frequency(magnitude), 0.05, 0.1))


def point_source_distance(magnitude: float, distance: float) -> float:
    """Return rupture distance plus the near-source saturation length of [2]_ [km]."""
    b = 0.4451
    d = 5.0948
    bend = np.log1p(np.exp(-d * (magnitude - 7.2725)))
    return float(distance + np.exp(-0.8712 + b * magnitude + (b - 1.1513) / d * bend))


def ground_motion_duration(magnitude: float, distance: float) -> float:
    """Return the duration [s]: 1 / corner frequency of the source, plus that of the path [3]_."""
    reach = point_source_distance(magnitude, distance)
    distances = (0.0, 7.0, 45.0, 125.0, 175.0, 270.0)  # [km]
    path = np.interp(reach, distances, (0.0, 2.4, 8.4, 10.9, 17.4, 34.2))
    beyond = 0.156 * max(reach - distances[-1], 0.0)
    return float(1.0 / corner_frequency(magnitude) + path + beyond)


def fourier_amplitude(
    frequency: ArrayLike, magnitude: float, distance: float
) -> Samples:
    """Return the Fourier amplitude of a horizontal component [m/s] at `frequency` [Hz].

    The form is that of [1]_, the values are those of [2]_ and [4]_. `distance` is to the rupture
    [km].
    """
    f = np.asarray(frequency, float)
    # 1e-20 with these units gives cm s; 1e-2 more gives m s.
    radiation = 0.55
    surface = 2.0
    partition = 1.0 / np.sqrt(2.0)
    constant = radiation * surface * partition * 1e-22
    constant /= 4.0 * np.pi * 2.75 * SHEAR_VELOCITY**3  # density [g/cm3]
    moment = 10.0 ** (1.5 * (magnitude + 10.7))
    source = constant * moment / (1.0 + (f / corner_frequency(magnitude)) ** 2)
    near = 1.1611  # rate, beyond the transition 0.5
    transition = 50.0  # [km]
    bend = (distance**2 + transition**2) / (1.0 + transition**2)
    reach = point_source_distance(magnitude, distance)
    decay = reach**-near * bend ** (0.5 * (near - 0.5))
    exponent = 0.6884 + 0.1354 * np.tanh(magnitude - 5.1278)
    loss = np.exp(-np.pi * f ** (1.0 - exponent) * distance / (205.4 * SHEAR_VELOCITY))
    nodes, factors = _AMPLIFICATION
    with np.errstate(divide="ignore"):
        amplification = np.exp(np.interp(np.log(f), np.log(nodes), np.log(factors)))
    site = amplification * np.exp(-np.pi * 0.039 * f)  # kappa [s]
    return (2.0 * np.pi * f) ** 2 * source * decay * loss * site


def window(time: ArrayLike, length: float) -> Samples:
    """Return Saragoni and Hart's window of [1]_, (a t / length)^b exp(-c t / length), peak 1."""
    b = (
        -WINDOW_PEAK
        * np.log(_WINDOW_END)
        / (1.0 + WINDOW_PEAK * (np.log(WINDOW_PEAK) - 1.0))
    )
    c = b / WINDOW_PEAK
    part = np.maximum(np.asarray(time, float) / length, 0.0)
    return (np.e / WINDOW_PEAK * part) ** b * np.exp(-c * part)


def site_factor(frequency: ArrayLike, vs30: float) -> Samples:
    """Return the amplitude at `vs30` [m/s] over that at 760 m/s: the linear site term of [5]_."""
    f = np.asarray(frequency, float)
    slope = np.interp(f, FREQUENCIES, COEFFICIENTS["c8"])
    return np.exp(slope * np.log(min(vs30, 1000.0) / VS30))


def median_adjustment(
    frequency: ArrayLike, magnitude: float, distance: float
) -> Samples:
    """Return the factor on the amplitude that brings Sa to the median of CY14 and ASK14 [6]_.

    Its logarithm is interpolated linearly in magnitude, ln distance and ln frequency.
    """
    near = np.log(np.clip(distance, *_DISTANCES[[0, -1]]))
    place = np.clip(magnitude, *_MAGNITUDES[[0, -1]]), near
    row = RegularGridInterpolator((_MAGNITUDES, np.log(_DISTANCES)), _FACTORS)(place)
    with np.errstate(divide="ignore"):
        return np.exp(np.interp(np.log(frequency), _NODES, row))


def correlation(frequency: ArrayLike) -> Samples:
    """Return the correlation of ln amplitude between all pairs of frequencies [Hz], by [8]_."""
    f = np.clip(np.asarray(frequency, float), *FREQUENCIES[[0, -1]])
    lower = np.minimum(f[:, None], f)
    apart = np.abs(np.log(f[:, None] / f))
    a, b, c, d = (np.interp(lower, FREQUENCIES, COEFFICIENTS[name]) for name in "ABCD")
    values = np.tanh(a * np.exp(b * apart) + c * np.exp(d * apart))
    values[apart == 0.0] = 1.0
    return values


_ROOT = np.linalg.cholesky(correlation(FREQUENCIES))


# Squared factors of many drawn variations at ``GRID``, shape (150, 300).
_TOTAL = np.sqrt(sum(COEFFICIENTS[name] ** 2 for name in TERMS.values()))
_DRAWN = np.random.Generator(np.random.PCG64(0)).standard_normal(
    (FREQUENCIES.size, 150)
)
_ROWS = [at_frequencies(GRID, row) for row in (_ROOT @ _DRAWN * _TOTAL[:, None]).T]
_POWERS = np.exp(2.0 * np.concatenate((_ROWS, np.negative(_ROWS))).T)


def draw_term(kind: str, generator: np.random.Generator) -> Samples:
    """Draw a term of ln amplitude (``event``, ``site`` or ``record``) at ``FREQUENCIES``."""
    return COEFFICIENTS[TERMS[kind]] * (
        _ROOT @ generator.standard_normal(FREQUENCIES.size)
    )


def _power_fractions(amplitude: Samples, period: Samples) -> Samples:
    """Return the part of an oscillator's mean square from each frequency, (n_period, n_frequency).

    `amplitude` is at ``GRID``; oscillators have a `period` [s] each and 5 % damping.
    """
    ratio = GRID * period[:, None]
    oscillator = 1.0 / ((1.0 - ratio**2) ** 2 + (2.0 * 0.05 * ratio) ** 2)
    power = amplitude**2 * oscillator * np.gradient(GRID)
    return power / power.sum(axis=1, keepdims=True)


def median_correction(amplitude: Samples) -> Samples:
    """Return the correction of ln amplitude, (61,), that keeps the median of Sa under variation.

    The mean square of an oscillator is a sum over frequencies of lognormal variables, whose median
    is above the sum of their medians unless all vary as one. The correction at a frequency f is
    found by repetition so that the mean of the sum's logarithm, over 150 drawn rows of variation
    and the same with opposite sign, is unchanged at the period 1 / f.
    """
    fractions = _power_fractions(amplitude, 1.0 / FREQUENCIES)
    correction = np.zeros(FREQUENCIES.size)
    for _ in range(6):
        gain = np.exp(2.0 * at_frequencies(GRID, correction))
        correction -= 0.5 * np.log((fractions * gain) @ _POWERS).mean(axis=1)
    return correction


def vertical_ratio(
    magnitude: float, distance: float, vs30: float, rock_pga: float
) -> Samples:
    """Return median V/H of Sa (5 %) by [10]_ at the periods of ``RATIO``, (22,); rock_pga in g."""
    t = RATIO
    period = RATIO["period_s"]
    c = 1.88
    n = 1.18
    over = magnitude - 6.75
    scaling = t["a1"] + t["a8"] * (8.5 - magnitude) ** 2
    scaling += (t["a2"] + 0.0147 * over) * np.log(np.hypot(distance, 10.0))
    scaling += (0.0334 if over < 0.0 else -0.034) * over
    # Vs30 beyond which sites no longer differ [m/s].
    middle = np.exp(8.0 - 0.795 * np.log(period / 0.21))
    long = np.exp(6.76 - 0.297 * np.log(period))
    ends = [period <= 0.5, period <= 1.0, period < 2.0]
    velocity = np.minimum(vs30, np.select(ends, [1500.0, middle, long], 700.0))
    ratio = velocity / t["v_lin"]
    nonlinear = t["b"] * (np.log(rock_pga + c * ratio**n) - np.log(rock_pga + c))
    linear = t["b"] * n * np.log(ratio)
    site = t["a10"] * np.log(ratio) - np.where(velocity < t["v_lin"], nonlinear, linear)
    return np.exp(scaling + site)


def vertical_factor(
    amplitude: Samples, magnitude: float, distance: float, vs30: float
) -> Samples:
    """Return ln of the factor from horizontal to vertical Fourier amplitudes, (61,).

    With it the ratio V/H of response spectra is that of the model [10]_. This ratio is the root of
    the ratio of mean squares; the factor is found by repetition.
    """
    # The model's reference PGA is at 1100 m/s.
    rock = amplitude * site_factor(GRID, 1100.0) / site_factor(GRID, vs30)
    rock_pga = _expected_peak(rock, magnitude, distance) / STANDARD_GRAVITY
    kept = RATIO["period_s"] >= 0.04  # below, amplitudes no longer decide the spectrum
    periods = RATIO["period_s"][kept][::-1]
    target = np.log(vertical_ratio(magnitude, distance, vs30, rock_pga))[kept][::-1]
    fractions = _power_fractions(amplitude, periods)
    nodes = np.log(1.0 / periods)
    logarithm = target.copy()
    for _ in range(20):
        gain = np.exp(2.0 * np.interp(np.log(GRID), nodes, logarithm))
        logarithm += target - 0.5 * np.log(fractions @ gain)
    return np.interp(np.log(FREQUENCIES), nodes, logarithm)


def _expected_peak(amplitude: Samples, magnitude: float, distance: float) -> float:
    """Return the peak of a stationary motion of this amplitude [m/s2]: Davenport (1964)."""
    duration = ground_motion_duration(magnitude, distance)
    power = 2.0 * amplitude**2 * np.gradient(GRID)
    crossings = 2.0 * duration * np.sqrt((power * GRID**2).sum() / power.sum())
    reach = np.sqrt(2.0 * np.log(max(crossings, 2.0)))
    return float((reach + 0.5772 / reach) * np.sqrt(power.sum() / duration))
