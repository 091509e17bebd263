"""Synthetic ground motions by the stochastic point-source method of Boore (2003).

Gaussian noise is shaped in time by a window of the expected duration and in frequency by the
Fourier amplitude of source, path and site (see `source`), which varies between events, sites and
records (see `variation`). One motion follows from its magnitude, distance, options and three
seeds alone.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.motions.motion import Motion
from archfrag.motions.synthetic.pulse import add_pulse
from archfrag.motions.synthetic.source import (
    VS30,
    WINDOW_LENGTH,
    WINDOW_PEAK,
    fourier_amplitude,
    ground_motion_duration,
    low_cut,
    median_adjustment,
    site_factor,
    window,
)  # fmt: skip
from archfrag.motions.synthetic.variation import draw_term, frequencies, grid, median_correction
from archfrag.motions.synthetic.vertical import COMPONENT_CORRELATION, vertical_factor

MODEL = (
    "Boore (2003) stochastic point source, Stafford et al. (2022) parameters, median of CY14 and "
    "ASK14, variation of Bayless and Abrahamson (2018, 2019)"
)
TIME_STEP = 0.01
_QUANTUM = 1e-6  # [m/s2]: rounding hides what compilers and processors disagree on
_MARGIN = 5.0  # [s] before and after the window, for the ringing of the low cut
_QUIET = 1.0  # [s] of zeros at each end
# Streams of random numbers that one seed may be asked for.
_STREAMS = ("event", "site", "record", "noise", "vertical_record", "vertical_noise", "pulse")


class Seeds(NamedTuple):
    """What random numbers follow from, 0 to 2^63 - 1: those of one event have one `event`."""

    record: int
    event: int
    site: int


class Options(NamedTuple):
    """How a motion is made: time step [s], site, whether amplitudes vary, vertical, pulse.

    `vs30` is from 450 to 1000 m/s: the range of V/H and where nonlinear soil may be left out.
    Without `vary` only phases do; `pulse` is the horizontal velocity pulse of a near fault.
    """

    dt: float = TIME_STEP
    vs30: float = VS30
    vary: bool = True
    vertical: bool = False
    pulse: bool = False


def make_motion(
    magnitude: float, distance: float, seed: int | Seeds, options: Options | None = None
) -> Motion:
    """Make one motion; the same arguments give the same samples.

    The steps of Boore (2003): noise, window, spectrum with mean square 1, target spectrum with low
    cut 1 / (1 + (f_low / f)^8) and variation, back to time. Then the ends are tapered, a pulse is
    added if there is one, a line under a taper is subtracted so that velocity and displacement end
    at zero, and samples are rounded to 1e-6 m/s2 and single precision.

    Magnitudes are from 3 to 8, distances to the rupture from 0 to 300 km, the range of the
    parameters; a number as `seed` is that of record, event and site. InputError outside them.
    """
    options = options or Options()
    seeds = seed if isinstance(seed, Seeds) else Seeds(seed, seed, seed)
    _check(magnitude, distance, seeds, options)
    frame = _frame(magnitude, distance, options)
    terms = _terms(magnitude, distance, seeds, options)
    facts: dict[str, float | str] = {
        "event": f"synthetic M{magnitude:g} {seeds.event}", "Mw": magnitude,
        "distance_km": distance, "Vs30_mps": options.vs30, "seed": seeds.record,
        "event_seed": seeds.event, "site_seed": seeds.site, "model": MODEL,
    }  # fmt: skip
    horizontal = _shaken(frame, _generator("noise", seeds.record), terms["horizontal"])
    if options.pulse:
        stream = _generator("pulse", seeds.record)
        made = add_pulse(horizontal, frame.after_peak, magnitude, stream)
        horizontal, facts["pulse_period_s"] = made
    vertical = None
    if options.vertical:
        stream = _generator("vertical_noise", seeds.record)
        vertical = _finished(_shaken(frame, stream, terms["vertical"]), options.dt)
    log = f"Made by {MODEL}; seeds {seeds.record}, {seeds.event}, {seeds.site}."
    name = f"M{magnitude:g}-R{distance:g}-{seeds.record}"
    samples = _finished(horizontal, options.dt)
    return Motion(samples, options.dt, vertical, name, facts, (log,))


class _Frame(NamedTuple):
    """What is common to motions of one magnitude, distance and time step."""

    dt: float
    after_peak: NDArray[np.float64]  # time from the peak of the window, of samples kept [s]
    window: NDArray[np.float64]  # (size,)
    log_f: NDArray[np.float64]  # of the frequencies above zero
    amplitude: NDArray[np.float64]  # without variation, at these frequencies [m/s]


def _frame(magnitude: float, distance: float, options: Options) -> _Frame:
    dt = options.dt
    length = WINDOW_LENGTH * ground_motion_duration(magnitude, distance)
    active = round((1.25 * length + 2.0 * _MARGIN) / dt) + 1
    size = 1 << int(np.ceil(np.log2(active + 1.5 / (low_cut(magnitude) * dt))))
    time = np.arange(size, dtype=np.float64) * np.float64(dt) - _MARGIN
    f = np.fft.rfftfreq(size, dt)[1:].astype(np.float64)
    amplitude = _amplitude(f, magnitude, distance, options.vs30)
    after_peak = time[:active] - WINDOW_PEAK * length
    return _Frame(dt, after_peak, window(time, length), np.log(f), amplitude)


def _shaken(
    frame: _Frame, generator: np.random.Generator, term: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Noise in the window with the amplitude and its variation, tapered, (active,) [m/s2]."""
    size, active = frame.window.size, frame.after_peak.size
    spectrum = np.fft.rfft(generator.standard_normal(size) * frame.window)
    spectrum /= np.sqrt(np.mean(np.abs(spectrum) ** 2))
    spectrum[0] = 0.0
    spectrum[1:] *= frame.amplitude * np.exp(np.interp(frame.log_f, np.log(frequencies()), term))
    samples = np.fft.irfft(spectrum, size)[:active] / frame.dt
    return samples * _taper(active, int(_MARGIN / frame.dt))


def _check(magnitude: float, distance: float, seeds: Seeds, options: Options) -> None:
    for name, value, low, high in (
        ("magnitude", magnitude, 3.0, 8.0), ("distance [km]", distance, 0.0, 300.0),
        ("vs30 [m/s]", options.vs30, 450.0, 1000.0),
    ):  # fmt: skip
        if not low <= value <= high:
            allowed = f"{low:g} to {high:g}, the range of the model"
            raise InputError(f"{name} = {value} is outside {allowed}")
    if not 0.0 < options.dt <= 0.02:
        raise InputError(f"time step {options.dt} s must be above 0 and at most 0.02 s")
    for seed in (seeds.record, seeds.event, seeds.site):
        if not 0 <= seed < 2**63:
            raise InputError(f"seed {seed} must be from 0 to 2^63 - 1")


def _generator(stream: str, seed: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([_STREAMS.index(stream), seed]))


def _amplitude(
    f: NDArray[np.float64], magnitude: float, distance: float, vs30: float
) -> NDArray[np.float64]:
    """Fourier amplitude without variation, above zero frequency [m/s]."""
    amplitude = fourier_amplitude(f, magnitude, distance) * site_factor(f, vs30)
    amplitude *= median_adjustment(f, magnitude, distance)
    return amplitude / (1.0 + (low_cut(magnitude) / f) ** 8)


def _terms(
    magnitude: float, distance: float, seeds: Seeds, options: Options
) -> dict[str, NDArray[np.float64]]:
    """What is added to ln amplitude of each component, each shape (61,)."""
    ratio = np.zeros(frequencies().size)
    if options.vertical:
        ratio = _vertical(magnitude, distance, options.vs30)
    if not options.vary:
        return {"horizontal": np.zeros(ratio.size), "vertical": ratio}
    common = _correction(magnitude, distance, options.vs30).copy()
    for kind, seed in (("event", seeds.event), ("site", seeds.site)):
        common += draw_term(kind, _generator(kind, seed))
    record = draw_term("record", _generator("record", seeds.record))
    other = draw_term("record", _generator("vertical_record", seeds.record))
    apart = np.sqrt(1.0 - COMPONENT_CORRELATION**2)
    return {
        "horizontal": common + record,
        "vertical": common + COMPONENT_CORRELATION * record + apart * other + ratio,
    }


@lru_cache(maxsize=256)
def _correction(magnitude: float, distance: float, vs30: float) -> NDArray[np.float64]:
    return median_correction(_amplitude(grid(), magnitude, distance, vs30))


@lru_cache(maxsize=256)
def _vertical(magnitude: float, distance: float, vs30: float) -> NDArray[np.float64]:
    amplitude = _amplitude(grid(), magnitude, distance, vs30)
    return vertical_factor(amplitude, magnitude, distance, vs30)


def _finished(samples: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    quiet = np.zeros(int(_QUIET / dt))
    rounded = np.round(_closed(samples, dt) / _QUANTUM) * _QUANTUM
    return np.concatenate((quiet, rounded, quiet)).astype(np.float32).astype(np.float64)


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
