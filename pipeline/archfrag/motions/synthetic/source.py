"""The Fourier amplitude that a point source gives at a site, and its duration.

The equivalent point source of Stafford, Boore, Youngs and Bommer (2022) [2]_, fitted to the
ground-motion model of Chiou and Youngs (2014): crustal earthquakes of active regions on rock with
Vs30 = 760 m/s, as the average over depths to the top of rupture. `median_adjustment` brings its
response spectra to the mean of two ground-motion models.

References
----------
.. [1] Boore (2003), Simulation of ground motion using the stochastic method, Pure and Applied
   Geophysics 160, 635-676.
.. [2] Stafford, Boore, Youngs and Bommer (2022), Host-region parameters for an adjustable model
   for crustal earthquakes ..., Earthquake Spectra 38(2), 917-949, optimised functional form.
.. [3] Boore and Thompson (2014), Path durations for use in the stochastic-method simulation of
   ground motions, BSSA 104(5), 2541-2552, table 1: active regions.
.. [4] Al Atik and Abrahamson (2021), A methodology for the development of 1D reference VS
   profiles compatible with ground-motion prediction equations, BSSA 111(4), 1765-1783.
.. [5] Bayless and Abrahamson (2019), Summary of the BA18 ground-motion model for Fourier amplitude
   spectra, BSSA 109(5), 2088-2105: c8 ln(min(Vs30, 1000) / 760); the nonlinear term is left out.
.. [6] Made by multiplying the amplitude at 1 / T by what Sa(T) of many simulations lacks and
   repeating (spectra brought back to Fourier amplitudes as by inverse random vibration theory: Al
   Atik et al. 2014, BSSA 104(1), 336-346), for the geometric mean of Chiou and Youngs (2014) and
   Abrahamson, Silva and Kamai (2014) and a vertical strike-slip fault; constant beyond the table.
"""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

Row = NDArray[np.float64]
SHEAR_VELOCITY, DENSITY = 3.5, 2.75  # [km/s], [g/cm3]
RADIATION_PATTERN, FREE_SURFACE, PARTITION = 0.55, 2.0, 1.0 / np.sqrt(2.0)
KAPPA = 0.039  # [s]
_STRESS = (4.599, 0.4624)  # ln bar; slope below M 5
_SATURATION = (-0.8712, 0.4451, 1.1513, 5.0948, 7.2725)
_DECAY = (1.1611, 0.5, 50.0)  # near rate, far rate, transition distance [km]
_QUALITY = (205.4, 0.6884, 0.1354, 5.1278)  # Q0; exponent n = a + b tanh(M - c)
_PATH_DISTANCE = (0.0, 7.0, 45.0, 125.0, 175.0, 270.0)  # [km]
_PATH_DURATION = (0.0, 2.4, 8.4, 10.9, 17.4, 34.2)  # [s]
_PATH_SLOPE = 0.156  # beyond [s/km]
# Boore (2003), after Saragoni and Hart (1974): where the window peaks and what is left of it at
# the end of its nominal length, which is twice the duration of ground motion.
WINDOW_PEAK, _WINDOW_END, WINDOW_LENGTH = 0.2, 0.05, 2.0
VS30 = 760.0  # [m/s]


def read_table(name: str) -> dict[str, Row]:
    """Columns of a table of numbers that lies beside this file, by their names."""
    lines = Path(__file__).with_name(name).read_text(encoding="utf-8").splitlines()
    head, *rows = (line.split(",") for line in lines if not line.startswith("#"))
    return dict(zip(head, np.array(rows, dtype=np.float64).T))


# Coefficients of Bayless and Abrahamson by their names, at 61 frequencies [Hz].
COEFFICIENTS = read_table("bayless_abrahamson.csv")
FREQUENCIES = COEFFICIENTS["frequency_hz"]
_AMPLIFICATION = tuple(read_table("amplification.csv").values())
_ADJUSTMENT = read_table("adjustment.csv")  # ln factor by magnitude, distance and frequency
_MAGNITUDES, _DISTANCES = (np.unique(_ADJUSTMENT.pop(key)) for key in ("magnitude", "distance_km"))


def corner_frequency(magnitude: float) -> float:
    """Corner [Hz] by Brune (1970): 4.9058e6 beta (stress / M0)^(1/3) in km/s, bar, dyne cm."""
    stress = np.exp(_STRESS[0] + _STRESS[1] * min(magnitude - 5.0, 0.0))
    return float(4.9058e6 * SHEAR_VELOCITY * np.cbrt(stress / _seismic_moment(magnitude)))


def _seismic_moment(magnitude: float) -> float:
    """Seismic moment [dyne cm]: Hanks and Kanamori (1979)."""
    return 10.0 ** (1.5 * (magnitude + 10.7))


def low_cut(magnitude: float) -> float:
    """Frequency below which the motion is filtered away [Hz]: half the corner, 0.05 to 0.1 Hz."""
    return float(np.clip(0.5 * corner_frequency(magnitude), 0.05, 0.1))


def point_source_distance(magnitude: float, distance: float) -> float:
    """Rupture distance and the near-source saturation length of [2]_ [km]."""
    a, b, c, d, e = _SATURATION
    bend = np.log1p(np.exp(-d * (magnitude - e)))
    return float(distance + np.exp(a + b * magnitude + (b - c) / d * bend))


def ground_motion_duration(magnitude: float, distance: float) -> float:
    """Duration of source and path [s]: 1 / corner frequency, and [3]_."""
    reach = point_source_distance(magnitude, distance)
    path = np.interp(reach, _PATH_DISTANCE, _PATH_DURATION)
    beyond = _PATH_SLOPE * max(reach - _PATH_DISTANCE[-1], 0.0)
    return float(1.0 / corner_frequency(magnitude) + path + beyond)


def fourier_amplitude(frequency: ArrayLike, magnitude: float, distance: float) -> Row:
    """Fourier amplitude of a horizontal acceleration [m/s]: form of [1]_, values of [2]_, [4]_."""
    f = np.asarray(frequency, dtype=np.float64)
    # 1e-20 with these units gives cm s; 1e-2 more gives m s.
    constant = RADIATION_PATTERN * FREE_SURFACE * PARTITION * 1e-22
    constant /= 4.0 * np.pi * DENSITY * SHEAR_VELOCITY**3
    source = constant * _seismic_moment(magnitude) / (1.0 + (f / corner_frequency(magnitude)) ** 2)

    near, far, transition = _DECAY
    reach = point_source_distance(magnitude, distance)
    bend = (distance**2 + transition**2) / (1.0 + transition**2)
    decay = reach**-near * bend ** (0.5 * (near - far))

    quality, n0, n1, n2 = _QUALITY
    exponent = n0 + n1 * np.tanh(magnitude - n2)
    loss = np.exp(-np.pi * f ** (1.0 - exponent) * distance / (quality * SHEAR_VELOCITY))

    nodes, factors = _AMPLIFICATION
    with np.errstate(divide="ignore"):
        amplification = np.exp(np.interp(np.log(f), np.log(nodes), np.log(factors)))
    site = amplification * np.exp(-np.pi * KAPPA * f)
    return (2.0 * np.pi * f) ** 2 * source * decay * loss * site


def window(time: ArrayLike, length: float) -> Row:
    """Saragoni and Hart's window with peak 1, (a t / length)^b exp(-c t / length), as in [1]_."""
    b = -WINDOW_PEAK * np.log(_WINDOW_END) / (1.0 + WINDOW_PEAK * (np.log(WINDOW_PEAK) - 1.0))
    c = b / WINDOW_PEAK
    part = np.maximum(np.asarray(time, dtype=np.float64) / length, 0.0)
    return (np.e / WINDOW_PEAK * part) ** b * np.exp(-c * part)


def site_factor(frequency: ArrayLike, vs30: float) -> Row:
    """Amplitude over that at 760 m/s: linear site term of [5]_."""
    f = np.asarray(frequency, dtype=np.float64)
    return np.exp(np.interp(f, FREQUENCIES, COEFFICIENTS["c8"]) * np.log(min(vs30, 1000.0) / VS30))


def median_adjustment(frequency: ArrayLike, magnitude: float, distance: float) -> Row:
    """Factor that brings the median Sa to CY14 and ASK14, linear in M, ln R and ln f [6]_."""
    values = np.stack(list(_ADJUSTMENT.values()), axis=-1)
    values = values.reshape(_MAGNITUDES.size, _DISTANCES.size, -1)
    at_magnitude = _along(_MAGNITUDES, values, magnitude)
    row = _along(np.log(_DISTANCES), at_magnitude, np.log(max(distance, _DISTANCES[0])))
    with np.errstate(divide="ignore"):
        return np.exp(np.interp(np.log(frequency), np.log(list(map(float, _ADJUSTMENT))), row))


def _along(axis: NDArray, values: NDArray, place: float) -> NDArray:
    """Linear interpolation along the first axis, constant beyond its ends."""
    position = np.interp(place, axis, np.arange(axis.size))
    low = min(int(position), axis.size - 2)
    return values[low] + (position - low) * (values[low + 1] - values[low])
