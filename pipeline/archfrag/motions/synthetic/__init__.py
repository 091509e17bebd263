"""Synthetic ground motions by the stochastic point-source method of Boore (2003), and suites.

Gaussian noise is shaped in time by a window of the expected duration and in frequency by the
Fourier amplitude of source, path and site (see `amplitude`), which varies between events, sites
and records. One motion follows from its magnitude, distance, options and three seeds alone. It
may have the velocity pulse of a near fault.

References
----------
.. [1] Shahi and Baker (2011), BSSA 101(2), 742-755: the period of a pulse, and the amplification
   of Sa over the same motion without it. The period's coefficients are those of PEER report
   2013/15 of the same authors, too; the amplification's are from memory and without a second
   source: check them before use.
.. [2] Mavroeidis and Papageorgiou (2003), BSSA 93(3), 1099-1131: the form of a pulse.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from obspy import Stream, Trace, UTCDateTime

from archfrag.errors import InputError
from archfrag.files import Named, check_targets, make_folder, replacing, sha256_of
from archfrag.motions.channel import Samples
from archfrag.motions.index import COLUMNS, INDEX_NAME, write_index
from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.process import cosine_taper
from archfrag.motions.synthetic import amplitude as fourier
from archfrag.motions.synthetic.amplitude import FREQUENCIES, GRID, VS30, draw_term

MODEL = (
    "Boore (2003) stochastic point source, Stafford et al. (2022) parameters, median of CY14 and "
    "ASK14, variation of Bayless and Abrahamson (2018, 2019)"
)
CYCLES = 2.0  # of a pulse, gamma: neither paper predicts it
DT = 0.01  # time step of all motions [s]
_QUANTUM = 1e-6  # [m/s2]: rounding hides what compilers and processors disagree on
_MARGIN = 5.0  # [s] before and after the window, for the ringing of the low cut
_QUIET = 1.0  # [s] of zeros at each end
# The period at which a pulse amplifies Sa most, over its own period Tp, and the median factor on
# Sa there [1]_.
_PEAK_PERIOD = 0.88
_PEAK_GAIN = np.exp(1.131 * np.exp(-3.11 * (np.log(_PEAK_PERIOD) + 0.127) ** 2) + 0.058)
# Names of the streams of random numbers that one seed gives, independent of each other.
_STREAMS = (
    "event",
    "site",
    "record",
    "noise",
    "vertical_record",
    "vertical_noise",
    "pulse",
)
# Magnitude and the distances [km] of the shipped suite: three earthquakes of each magnitude, the
# first with the first and the fourth distance, and so on; each motion at a site of its own.
SUITE = {
    5.5: (5.0, 10.0, 15.0, 20.0, 30.0, 40.0),
    6.0: (5.0, 10.0, 20.0, 30.0, 40.0, 60.0),
    6.5: (5.0, 10.0, 20.0, 30.0, 50.0, 70.0),
    7.0: (5.0, 10.0, 20.0, 40.0, 60.0, 100.0),
    7.5: (10.0, 15.0, 20.0, 40.0, 60.0, 100.0),
}
FIRST_SEED = 20250101  # of the first motion
FOLDER = "synthetic"
COMPONENT = "HN1"
TERMS = "made by archfrag; BSD-3-Clause as archfrag itself"
# The seeds of the motions of a suite begin at the suite's own seed times this.
SPACING = 10**6
# where seeds of drawn magnitudes and distances lie, apart from those of motions
_DRAWN = 2**62
_RANGES = (
    ("magnitude", 3.0, 8.0),
    ("distance [km]", 0.0, 300.0),
    *[("seed", 0, 2**63 - 1)] * 3,
    ("vs30 [m/s]", 450.0, 1000.0),
)


class Recipe(NamedTuple):
    """Parameters of a synthetic motion; seeds are 0 to 2^63 - 1."""

    magnitude: float  # moment magnitude, 3 to 8
    distance: float  # to the rupture, 0 to 300 [km]
    seed: int
    event_seed: int | None = None  # equal for the motions of one event; `seed` if None
    site_seed: int | None = None  # equal for the motions at one site; `seed` if None
    vs30: float = VS30  # [m/s], 450 to 1000: the range of V/H and of linear soil
    vary: bool = True  # whether amplitudes vary; if not, only phases do
    vertical: bool = False  # whether there is a vertical component
    pulse: bool = False  # whether the horizontal has the velocity pulse of a near fault
    id: str = ""  # of the record in a suite; `make_motion` does not use it


def make_motion(recipe: Recipe) -> Motion:
    """Make one motion; InputError if a parameter is outside the range of the model.

    The steps are those of Boore (2003): noise, window, spectrum with mean square 1, target
    spectrum with low cut 1 / (1 + (f_low / f)^8) and variation, back to time. Then come a taper,
    the pulse if asked for, and `_finished`.
    """
    magnitude, distance, seed, *others, vs30 = recipe[:6]
    event, site = (seed if other is None else other for other in others)
    for (name, low, high), value in zip(_RANGES, (*recipe[:3], event, site, vs30)):
        if not low <= value <= high:
            raise InputError(
                f"{name} = {value} is outside {low:g} to {high:g}, the model's range"
            )
    dt = DT
    length = fourier.WINDOW_LENGTH * fourier.ground_motion_duration(magnitude, distance)
    active = round((1.25 * length + 2.0 * _MARGIN) / dt) + 1
    size = 1 << int(np.ceil(np.log2(active + 1.5 / (fourier.low_cut(magnitude) * dt))))
    time = np.arange(size, dtype=float) * dt - _MARGIN
    shape = fourier.window(time, length)
    f = np.fft.rfftfreq(size, dt)[1:].astype(float)
    amplitude = _amplitude(f, magnitude, distance, vs30)

    def wave(stream: str, term: Samples) -> Samples:
        """Return one component [m/s2]: noise in the window, with the target spectrum, tapered.

        `term` is what is added to ln amplitude at ``FREQUENCIES``, (61,).
        """
        noise = _generator(stream, seed).standard_normal(size)
        spectrum = np.fft.rfft(noise * shape)
        spectrum /= np.sqrt(np.mean(np.abs(spectrum) ** 2))
        spectrum[0] = 0.0
        spectrum[1:] *= amplitude * np.exp(fourier.at_frequencies(f, term))
        samples = np.fft.irfft(spectrum, size)[:active] / dt
        return samples * cosine_taper(active, int(_MARGIN / dt))

    facts: dict[str, float | str] = {
        "event": f"synthetic M{magnitude:g} {event}",
        "Mw": magnitude,
        "distance_km": distance,
        "Vs30_mps": vs30,
        "seed": seed,
        "event_seed": event,
        "site_seed": site,
        "model": MODEL,
    }
    terms = _terms(recipe, event, site)
    horizontal = wave("noise", terms[0])
    if recipe.pulse:
        after_peak = time[:active] - fourier.WINDOW_PEAK * length
        pulse = _generator("pulse", seed)
        horizontal, facts["pulse_period_s"] = _with_pulse(
            horizontal, after_peak, magnitude, pulse
        )
    vertical = (
        _finished(wave("vertical_noise", terms[1]), dt) if recipe.vertical else None
    )
    log = f"Made by {MODEL}; seeds {seed}, {event}, {site}."
    name = f"M{magnitude:g}-R{distance:g}-{seed}"
    return Motion(_finished(horizontal, dt), dt, vertical, name, facts, (log,))


def _generator(stream: str, seed: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([_STREAMS.index(stream), seed]))


def _amplitude(f: Samples, magnitude: float, distance: float, vs30: float) -> Samples:
    """Return the Fourier amplitude without variation [m/s] at frequencies `f` above 0 [Hz]."""
    amplitude = fourier.fourier_amplitude(f, magnitude, distance)
    amplitude *= fourier.site_factor(f, vs30)
    amplitude *= fourier.median_adjustment(f, magnitude, distance)
    return amplitude / (1.0 + (fourier.low_cut(magnitude) / f) ** 8)


@lru_cache(maxsize=256)
def _corrections(
    magnitude: float, distance: float, vs30: float, vertical: bool
) -> Samples:
    """Return what is added to ln amplitude of a scenario, (61,).

    If `vertical`, it is ln(V/H), for the vertical component alone. If not, it is the correction
    that keeps the median of Sa under variation, for both components.
    """
    amplitude = _amplitude(GRID, magnitude, distance, vs30)
    if vertical:
        return fourier.vertical_factor(amplitude, magnitude, distance, vs30)
    return fourier.median_correction(amplitude)


def _terms(recipe: Recipe, event: int, site: int) -> tuple[Samples, Samples]:
    """Return additions to ln amplitude of the horizontal and of the vertical, each shape (61,)."""
    scenario = recipe.magnitude, recipe.distance, recipe.vs30
    ratio = (
        _corrections(*scenario, True) if recipe.vertical else np.zeros(FREQUENCIES.size)
    )
    if not recipe.vary:
        return np.zeros(ratio.size), ratio
    common = _corrections(*scenario, False)
    common = common + draw_term("event", _generator("event", event))
    common += draw_term("site", _generator("site", site))
    record = draw_term("record", _generator("record", recipe.seed))
    other = draw_term("record", _generator("vertical_record", recipe.seed))
    alike = fourier.COMPONENT_CORRELATION
    vertical = common + alike * record + np.sqrt(1.0 - alike**2) * other + ratio
    return common + record, vertical


def _finished(samples: Samples, dt: float) -> Samples:
    """Return the accelerations of a component as they are stored, with 1 s of zeros at each end.

    A tapered straight line is subtracted first, so that velocity and displacement end at zero.
    Then the samples are rounded.
    """
    # The ends of rows are zero, so that plain sums are trapezoid sums.
    taper = cosine_taper(samples.size, samples.size // 4)
    position = np.linspace(0.0, 1.0, samples.size)
    shapes = np.stack((taper, taper * position))
    ends = [
        (row.sum() * dt, (row * (1.0 - position)).sum() * dt)
        for row in (*shapes, samples)
    ]
    closed = samples - np.linalg.solve(np.array(ends[:2]).T, ends[2]) @ shapes
    quiet = np.zeros(int(_QUIET / dt))
    rounded = np.round(closed / _QUANTUM) * _QUANTUM
    return np.concatenate((quiet, rounded, quiet)).astype(np.float32).astype(float)


def _with_pulse(
    samples: Samples, time: Samples, magnitude: float, generator: np.random.Generator
) -> tuple[Samples, float]:
    """Add a velocity pulse about time zero; return the accelerations [m/s2] and its period Tp [s].

    The pulse is so large that Sa(0.88 Tp) grows by the median factor of [1]_, if squares of Sa
    add. ln Tp is normal with mean -5.73 + 0.99 M and deviation 0.56 [1]_. The velocity of the
    pulse is (1 + cos(2 pi t / (gamma Tp))) cos(2 pi t / Tp + phase) / 2 [2]_, zero beyond
    abs(t) = gamma Tp / 2. `time` [s] is that of each sample.
    """
    period = float(
        np.exp(-5.73 + 0.99 * magnitude + 0.56 * generator.standard_normal())
    )
    phase = generator.uniform(0.0, 2.0 * np.pi)
    angle = 2.0 * np.pi * time / period
    envelope = 1.0 + np.cos(angle / CYCLES)
    slope = -np.sin(angle / CYCLES) / CYCLES * np.cos(angle + phase)
    slope -= envelope * np.sin(angle + phase)
    pulse = np.where(np.abs(angle) <= np.pi * CYCLES, np.pi / period * slope, 0.0)
    dt = time[1] - time[0]
    at = _PEAK_PERIOD * period
    without, alone = (
        spectral_acceleration(Motion(a, dt), at)[0] for a in (samples, pulse)
    )
    gain = np.sqrt(_PEAK_GAIN**2 - 1.0)
    return samples + gain * without / alone * pulse, period


def plan_motions(
    events: int,
    records_per_event: int,
    magnitude: Sequence[float],
    distance: Sequence[float],
    drawn_magnitude: bool = False,
    drawn_distance: bool = False,
    seed: int = 1,
    sites: int | None = None,
    vs30: float = VS30,
    vertical: bool = False,
    pulses: float = 0.0,
) -> list[Recipe]:
    """Return the recipes of a suite, event by event.

    Events take the values of `magnitude` in turn; if `drawn_magnitude`, theirs are drawn between
    the first and the second value. Records take the values of `distance` [km] in turn; if
    `drawn_distance`, theirs are drawn between the first two, uniformly in logarithm. `seed` is
    from 0 to 10^9. Record n is at site n modulo `sites`; without `sites` each has a site of its
    own. `vs30` [m/s] is that of all sites, and `pulses` the chance that a record has a pulse.
    InputError if there are more records than seeds.
    """
    count = events * records_per_event
    first = seed * SPACING
    if count > SPACING:
        raise InputError(
            f"{count} motions are more than {SPACING}, the seeds of one suite"
        )
    generator = np.random.Generator(np.random.PCG64(_DRAWN + seed))
    magnitudes = np.resize(magnitude, events)
    distances = np.resize(distance, count)
    if drawn_magnitude:
        magnitudes = generator.uniform(magnitude[0], magnitude[1], events).round(6)
    if drawn_distance:
        ends = np.log(np.maximum(distance, 1e-3))
        distances = np.exp(generator.uniform(ends[0], ends[1], count).round(6)).round(2)
    with_pulse = generator.uniform(size=count) < pulses
    return [
        Recipe(
            float(magnitudes[event]),
            float(distances[number]),
            first + number,
            first + event,
            first + (number if sites is None else number % sites),
            vs30=vs30,
            vertical=vertical,
            pulse=bool(with_pulse[number]),
            id=f"e{event + 1}-r{record + 1}",
        )
        for number, (event, record) in enumerate(np.ndindex(events, records_per_event))
    ]


def shipped_recipes() -> list[Recipe]:
    """Return the recipes of the shipped motions; no motion was chosen by its result."""
    recipes: list[Recipe] = []
    for group, (magnitude, distances) in enumerate(SUITE.items()):
        for place, distance in enumerate(distances):
            seed, event = (
                FIRST_SEED + n for n in (len(recipes), group * 3 + place % 3)
            )
            name = f"syn-m{round(10 * magnitude):02d}-r{round(distance):03d}"
            recipes.append(Recipe(magnitude, distance, seed, event, id=name))
    return recipes


def make_suite(
    out_dir: str | Path, recipes: Sequence[Recipe] | None = None
) -> list[Path]:
    """Write motions as ``synthetic/*.mseed`` [m/s2], and their index; return the record files.

    Without `recipes` they are the shipped motions.
    """
    folder = Path(out_dir)
    rows: list[Named] = []
    make_folder(folder / FOLDER)
    recipes = shipped_recipes() if recipes is None else recipes
    paths = [folder / FOLDER / f"{recipe.id}.mseed" for recipe in recipes]
    check_targets([folder / INDEX_NAME, *paths])
    for number, (recipe, path) in enumerate(zip(recipes, paths), start=1):
        motion = make_motion(recipe)
        stream = Stream()
        header = {
            "network": "XX",
            "station": f"S{number % 10000:04d}",
            "delta": motion.dt,
            "starttime": UTCDateTime(2000, 1, 1),
        }
        for channel, samples in zip((COMPONENT, "HNZ"), motion.components.values()):
            header["channel"] = channel
            stream.append(Trace(samples.astype(np.float32), header))
        with replacing(path, lasting=False) as part:
            stream.write(
                str(part), "MSEED", encoding="FLOAT32", reclen=4096, byteorder=">"
            )
        facts = {name: motion.metadata.get(name) for name in COLUMNS}
        facts |= {
            "id": recipe.id,
            "file": f"{FOLDER}/{path.name}",
            "sha256": sha256_of(path),
            "component": COMPONENT,
            "dt_s": motion.dt,
            "unit": "m/s2",
            "terms": TERMS,
        }
        if any(each.pulse for each in recipes):
            facts["pulse"] = recipe.pulse
        rows.append(facts)
    write_index(folder, rows)
    return paths
