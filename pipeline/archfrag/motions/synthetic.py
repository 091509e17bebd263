"""Synthetic ground motions by the stochastic point-source method of Boore (2003).

Gaussian noise is shaped in time by a window of the expected duration and in frequency by the
Fourier amplitude spectrum that source, path and site give [1]_. The spectrum and every
parameter in it are the equivalent point source of Stafford, Boore, Youngs and Bommer (2022)
[2]_, fitted to the ground-motion model of Chiou and Youngs (2014): crustal earthquakes of
active regions on rock with Vs30 = 760 m/s, as the average over depths to the top of rupture.

What the method leaves out: the amplitude spectrum is the same for every earthquake of one
magnitude and distance, so that the scatter between these motions is that of phase only, less
than the scatter between records; there is no directivity and no long-period pulse.

References
----------
.. [1] Boore (2003), Simulation of ground motion using the stochastic method, Pure and Applied
   Geophysics 160, 635-676.
.. [2] Stafford, Boore, Youngs and Bommer (2022), Host-region parameters for an adjustable model
   for crustal earthquakes ..., Earthquake Spectra 38(2), 917-949.
.. [3] Boore and Thompson (2014), Path durations for use in the stochastic-method simulation of
   ground motions, BSSA 104(5), 2541-2552.
.. [4] Al Atik and Abrahamson (2021), A methodology for the development of 1D reference VS
   profiles compatible with ground-motion prediction equations, BSSA 111(4), 1765-1783.
"""

import csv
import hashlib
import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, OutputError
from archfrag.motions.index import COLUMNS, INDEX_NAME
from archfrag.motions.motion import Motion

MODEL = "Boore (2003) stochastic point source, Stafford et al. (2022) parameters"
VS30 = 760.0

# Stafford et al. (2022), optimised functional form.
SHEAR_VELOCITY = 3.5  # [km/s]
DENSITY = 2.75  # [g/cm3]
RADIATION_PATTERN = 0.55
FREE_SURFACE = 2.0
PARTITION = 1.0 / np.sqrt(2.0)
KAPPA = 0.039  # [s]
_STRESS = (4.599, 0.4624)  # ln bar; slope below M 5
_SATURATION = (-0.8712, 0.4451, 1.1513, 5.0948, 7.2725)
_SPREADING = (1.1611, 0.5, 50.0)  # near rate, far rate, transition distance [km]
_QUALITY = (205.4, 0.6884, 0.1354, 5.1278)  # Q0; exponent n = a + b tanh(M - c)

# Boore and Thompson (2014), table 1: path duration in active regions, 0.156 s/km beyond.
_PATH_DISTANCE = (0.0, 7.0, 45.0, 125.0, 175.0, 270.0)  # [km]
_PATH_DURATION = (0.0, 2.4, 8.4, 10.9, 17.4, 34.2)  # [s]
_PATH_SLOPE = 0.156  # [s/km]

# Boore (2003), after Saragoni and Hart (1974): where the window peaks and what is left of it at
# the end of its nominal length, which is twice the duration of ground motion.
_WINDOW_PEAK = 0.2
_WINDOW_END = 0.05
_WINDOW_LENGTH = 2.0

# Amplification from the source to a surface with Vs30 = 760 m/s: the profile of Al Atik and
# Abrahamson (2021) as used by Stafford et al. (2022), at 29 of its 302 frequencies; linear in
# log-log between them it differs by less than 0.1 % from all.
_AMPLIFICATION = np.array(
    [
        (0.01, 1.0), (0.1, 1.264743), (0.128825, 1.343563), (0.165959, 1.423873),
        (0.213796, 1.507478), (0.275423, 1.588421), (0.354813, 1.660755), (0.457088, 1.725979),
        (0.588844, 1.788483), (0.758578, 1.853331), (1.0, 1.931032), (1.28825, 2.0064),
        (1.659587, 2.082088), (2.137962, 2.156601), (2.754228, 2.230798), (3.548134, 2.307549),
        (4.570881, 2.391837), (5.888436, 2.491416), (7.585776, 2.611704), (10.0, 2.750306),
        (12.882492, 2.882748), (16.59587, 3.020564), (21.37962, 3.163971), (27.4534, 3.311217),
        (35.3893, 3.466789), (45.6192, 3.628651), (58.8062, 3.797022), (75.8052, 3.972112),
        (100.0, 4.170967),
    ]
)  # fmt: skip

TIME_STEP = 0.01
_QUANTUM = 1e-6  # [m/s2]: rounding hides what compilers and processors disagree on
_MARGIN = 5.0  # [s] before and after the window, for the ringing of the low cut
_QUIET = 1.0  # [s] of zeros at each end

# Magnitude and the distances [km] of the shipped suite; one motion each.
SUITE = {
    5.5: (5.0, 10.0, 15.0, 20.0, 30.0, 40.0),
    6.0: (5.0, 10.0, 20.0, 30.0, 40.0, 60.0),
    6.5: (5.0, 10.0, 20.0, 30.0, 50.0, 70.0),
    7.0: (5.0, 10.0, 20.0, 40.0, 60.0, 100.0),
    7.5: (10.0, 15.0, 20.0, 40.0, 60.0, 100.0),
}
FIRST_SEED = 20250101
FOLDER = "synthetic"
COMPONENT = "HN1"
TERMS = "made by archfrag; BSD-3-Clause as archfrag itself"


def corner_frequency(magnitude: float) -> float:
    """Corner of the omega-squared source, 4.9058e6 beta (stress / M0)^(1/3) [Hz].

    Brune (1970, 1971) with beta in km/s, stress parameter in bar and M0 in dyne cm; the stress
    parameter is that of Stafford et al. (2022), 99.4 bar from magnitude 5 on.
    """
    stress = np.exp(_STRESS[0] + _STRESS[1] * min(magnitude - 5.0, 0.0))
    return float(4.9058e6 * SHEAR_VELOCITY * np.cbrt(stress / _seismic_moment(magnitude)))


def point_source_distance(magnitude: float, distance: float) -> float:
    """Distance at which a point source shakes like the fault [km].

    The rupture distance [km] plus the near-source saturation length of Stafford et al. (2022).
    """
    a, b, c, d, e = _SATURATION
    bend = np.log1p(np.exp(-d * (magnitude - e)))
    return float(distance + np.exp(a + b * magnitude + (b - c) / d * bend))


def ground_motion_duration(magnitude: float, distance: float) -> float:
    """Duration of source and path [s]: 1 / corner frequency, and Boore and Thompson (2014)."""
    reach = point_source_distance(magnitude, distance)
    path = np.interp(reach, _PATH_DISTANCE, _PATH_DURATION)
    beyond = _PATH_SLOPE * max(reach - _PATH_DISTANCE[-1], 0.0)
    return float(1.0 / corner_frequency(magnitude) + path + beyond)


def fourier_amplitude(
    frequency: ArrayLike, magnitude: float, distance: float
) -> NDArray[np.float64]:
    """Fourier amplitude of the acceleration of one horizontal component at the surface [m/s].

    Source, spreading, anelastic loss, amplification and kappa: the product of Boore (2003) with
    the forms and values of Stafford et al. (2022).

    Parameters
    ----------
    frequency : array_like, shape (n_frequency,) [Hz]
    magnitude : float
        Moment magnitude.
    distance : float [km]
        Closest distance to the rupture.
    """
    f = np.asarray(frequency, dtype=np.float64)
    # 1e-20 with these units gives cm s; 1e-2 more gives m s.
    constant = RADIATION_PATTERN * FREE_SURFACE * PARTITION * 1e-22
    constant /= 4.0 * np.pi * DENSITY * SHEAR_VELOCITY**3
    source = constant * _seismic_moment(magnitude) / (1.0 + (f / corner_frequency(magnitude)) ** 2)

    near, far, transition = _SPREADING
    reach = point_source_distance(magnitude, distance)
    bend = (distance**2 + transition**2) / (1.0 + transition**2)
    spreading = reach**-near * bend ** (0.5 * (near - far))

    quality, n0, n1, n2 = _QUALITY
    exponent = n0 + n1 * np.tanh(magnitude - n2)
    loss = np.exp(-np.pi * f ** (1.0 - exponent) * distance / (quality * SHEAR_VELOCITY))

    with np.errstate(divide="ignore"):
        log_f = np.log(f)
    amplification = np.exp(
        np.interp(log_f, np.log(_AMPLIFICATION[:, 0]), np.log(_AMPLIFICATION[:, 1]))
    )
    site = amplification * np.exp(-np.pi * KAPPA * f)
    return (2.0 * np.pi * f) ** 2 * source * spreading * loss * site


def window(time: ArrayLike, length: float) -> NDArray[np.float64]:
    """Saragoni and Hart's window with peak 1: (a t / length)^b exp(-c t / length).

    As Boore (2003) sets it: peak at 0.2 of the length, 0.05 of the peak at its end.

    Parameters
    ----------
    time : array_like, shape (n_sample,) [s]
        From the start of the window; zero before it.
    length : float [s]
    """
    b = -_WINDOW_PEAK * np.log(_WINDOW_END) / (1.0 + _WINDOW_PEAK * (np.log(_WINDOW_PEAK) - 1.0))
    c = b / _WINDOW_PEAK
    share = np.maximum(np.asarray(time, dtype=np.float64) / length, 0.0)
    return (np.e / _WINDOW_PEAK * share) ** b * np.exp(-c * share)


def low_cut(magnitude: float) -> float:
    """Frequency below which the motion is filtered away [Hz]: half the corner, 0.05 to 0.1 Hz."""
    return float(np.clip(0.5 * corner_frequency(magnitude), 0.05, 0.1))


def make_motion(magnitude: float, distance: float, seed: int, dt: float = TIME_STEP) -> Motion:
    """Make one motion; the same arguments give the same samples.

    The steps of Boore (2003): noise, window, spectrum with mean square 1, target
    spectrum with low cut 1 / (1 + (f_low / f)^8), back to time. Then the ends are tapered, a
    straight line under the same taper is subtracted so that velocity and displacement end at
    zero, and samples are rounded to 1e-6 m/s2 and single precision.

    Parameters
    ----------
    magnitude : float
        Moment magnitude, 3 to 8: the range of the parameters.
    distance : float [km]
        Closest distance to the rupture, 0 to 300.
    seed : int
        Of numpy's PCG64 generator.
    dt : float [s]

    Raises
    ------
    InputError
        If magnitude, distance or time step is outside its range.
    """
    if not 3.0 <= magnitude <= 8.0:
        raise InputError(f"magnitude {magnitude} is outside 3 to 8, the range of the model")
    if not 0.0 <= distance <= 300.0:
        raise InputError(f"distance {distance} km is outside 0 to 300 km, the range of the model")
    if not 0.0 < dt <= 0.02:
        raise InputError(f"time step {dt} s must be above 0 and at most 0.02 s")
    length = _WINDOW_LENGTH * ground_motion_duration(magnitude, distance)
    active = round((1.25 * length + 2.0 * _MARGIN) / dt) + 1
    size = 1 << int(np.ceil(np.log2(active + 1.5 / (low_cut(magnitude) * dt))))

    time = np.arange(size) * dt - _MARGIN
    noise = np.random.Generator(np.random.PCG64(seed)).standard_normal(size)
    spectrum = np.fft.rfft(noise * window(time, length))
    spectrum /= np.sqrt(np.mean(np.abs(spectrum) ** 2))
    f = np.fft.rfftfreq(size, dt)
    target = np.zeros_like(f)
    target[1:] = fourier_amplitude(f[1:], magnitude, distance)
    target[1:] /= 1.0 + (low_cut(magnitude) / f[1:]) ** 8
    shaken = np.fft.irfft(spectrum * target, size)[:active] / dt

    closed = _closed(shaken * _taper(active, int(_MARGIN / dt)), dt)
    quiet = np.zeros(int(_QUIET / dt))
    samples = np.concatenate((quiet, np.round(closed / _QUANTUM) * _QUANTUM, quiet))
    return Motion(
        samples.astype(np.float32),
        dt,
        id=f"M{magnitude:g}-R{distance:g}-{seed}",
        metadata={
            "event": f"synthetic M{magnitude:g}",
            "Mw": magnitude,
            "distance_km": distance,
            "Vs30_mps": VS30,
            "seed": seed,
            "model": MODEL,
        },
        log=(f"Made by {MODEL}, seed {seed}.",),
    )


def suite() -> list[Motion]:
    """Make the shipped motions: each magnitude and distance of ``SUITE``, seeds one after another.

    No motion was chosen by its result.
    """
    pairs = [(magnitude, distance) for magnitude in SUITE for distance in SUITE[magnitude]]
    return [
        make_motion(magnitude, distance, FIRST_SEED + number)
        for number, (magnitude, distance) in enumerate(pairs)
    ]


def make_suite(out_dir: str | Path) -> list[Path]:
    """Write the shipped motions: ``synthetic/*.mseed`` in m/s2 and ``index.csv``.

    Parameters
    ----------
    out_dir : path
        Folder, made if needed. Files of the same names are replaced, each whole; the index last.

    Returns
    -------
    list of Path
        The record files, in the order of the index.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    folder = Path(out_dir)
    paths, rows = [], []
    try:
        (folder / FOLDER).mkdir(parents=True, exist_ok=True)
        for motion in suite():
            number = motion.metadata["seed"] - FIRST_SEED + 1
            magnitude, distance = motion.metadata["Mw"], motion.metadata["distance_km"]
            name = f"syn-m{round(10 * magnitude):02d}-r{round(distance):03d}"
            path = folder / FOLDER / f"{name}.mseed"
            _write_miniseed(path, motion, number)
            paths.append(path)
            rows.append(
                {
                    "id": name,
                    "file": f"{FOLDER}/{path.name}",
                    "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                    "event": motion.metadata["event"],
                    "Mw": magnitude,
                    "distance_km": distance,
                    "Vs30_mps": VS30,
                    "component": COMPONENT,
                    "dt_s": motion.dt,
                    "unit": "m/s2",
                    "terms": TERMS,
                    "seed": motion.metadata["seed"],
                    "model": MODEL,
                }
            )
        part = folder / f".{INDEX_NAME}.part"
        with open(part, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        os.replace(part, folder / INDEX_NAME)
    except OSError as error:
        raise OutputError(
            f"{folder}: the motions cannot be written there ({error.strerror or error})"
        ) from None
    return paths


def _write_miniseed(path: Path, motion: Motion, number: int) -> None:
    from obspy import Stream, Trace, UTCDateTime

    header = {
        "network": "XX",
        "station": f"SYN{number:02d}",
        "channel": COMPONENT,
        "delta": motion.dt,
        "starttime": UTCDateTime(2000, 1, 1),
    }
    part = path.with_name(f".{path.name}.part")
    stream = Stream([Trace(motion.acceleration.astype(np.float32), header=header)])
    stream.write(str(part), format="MSEED", encoding="FLOAT32", reclen=4096, byteorder=">")
    os.replace(part, path)


def _seismic_moment(magnitude: float) -> float:
    """Seismic moment [dyne cm]: Hanks and Kanamori (1979)."""
    return 10.0 ** (1.5 * (magnitude + 10.7))


def _taper(size: int, ramp: int) -> NDArray[np.float64]:
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(ramp) / ramp)
    return np.concatenate((rise, np.ones(size - 2 * ramp), rise[::-1]))


def _closed(samples: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    """Subtract a tapered line so that the trapezoid rule ends at zero velocity and place."""
    size = samples.size
    taper = _taper(size, size // 4)
    position = np.linspace(0.0, 1.0, size)
    shapes = np.stack((taper, taper * position))

    def ends(row: NDArray[np.float64]) -> tuple[float, float]:
        # The ends of a row are zero, so that plain sums are trapezoid sums.
        return row.sum() * dt, (row * (1.0 - position)).sum() * dt

    coefficients = np.linalg.solve(np.array([ends(s) for s in shapes]).T, ends(samples))
    return samples - coefficients @ shapes
