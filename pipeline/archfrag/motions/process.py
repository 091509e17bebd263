"""Processing steps of a motion; each writes a line in its log.

A step does the same to all components. What its settings may be is checked in
`archfrag.study.file.motions`; what depends on the motion, too, is checked here.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
import scipy  # whose parts are loaded when they are used: scipy.signal takes a second
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyfit
from obspy import Inventory, Trace, UTCDateTime

from archfrag.errors import InputError, RecordError, reason_of
from archfrag.files import Named
from archfrag.motions.calibrate import find_inventory
from archfrag.motions.channel import (
    STANDARD_GRAVITY,
    Facts,
    Samples,
    azimuth_of,
    check_right_angle,
)
from archfrag.motions.measures import arias_times, integral
from archfrag.motions.motion import REVERSED, Motion


def demean(motion: Motion) -> Motion:
    """Subtract from each component its mean: the offset of a raw record can exceed the motion."""
    rows = motion.components.values()
    offsets = " and ".join(f"{samples.mean():.6g}" for samples in rows)
    return motion.changed(lambda a: a - a.mean(), f"Mean removed ({offsets} m/s2).")


def detrend(motion: Motion) -> Motion:
    """Subtract from each component the straight line that fits it best (least squares)."""
    return motion.changed(scipy.signal.detrend, "Linear trend removed.")


def baseline(motion: Motion, order: int = 2) -> Motion:
    """Subtract the derivative of the polynomial that fits the velocity best (least squares).

    The polynomial, of an `order` from 1 to 5, is zero at the first sample, where the record is at
    rest. Order 2 is that of Graizer (1979); see Boore (2001), BSSA 91(5).
    """
    unit = np.linspace(0.0, 1.0, motion.acceleration.size)
    powers = np.arange(1, order + 1)

    def straight(samples: Samples) -> Samples:
        fit = Polynomial(polyfit(unit, integral(samples, 1.0), powers))
        return samples - fit.deriv()(unit) / (unit.size - 1)

    done = f"Baseline removed, velocity polynomial of order {order}."
    return motion.changed(straight, done)


def cosine_taper(size: int, ramp: int) -> Samples:
    """Return a window (size,) of ones with half a cosine wave over `ramp` samples at each end."""
    wave = np.hanning(2 * ramp + 1)
    return np.concatenate((wave[:ramp], np.ones(size - 2 * ramp), wave[ramp + 1 :]))


def taper(
    motion: Motion,
    fraction: float = 0.05,
    side: Literal["both", "left", "right"] = "both",
) -> Motion:
    """Bring one or both ends of a motion to zero by half a cosine wave.

    Each wave takes a `fraction` of the record, up to 0.5. `side` tells which end it is.
    """
    size = motion.acceleration.size
    count = max(1, int(fraction * size))
    factor = cosine_taper(size, count)
    if side == "right":
        factor[:count] = 1.0
    if side == "left":
        factor[-count:] = 1.0
    done = f"Tapered by a cosine over {fraction:g} of it, {side} ends."
    return motion.changed(lambda a: a * factor, done)


def bandpass(
    motion: Motion,
    lowest: float | None,
    highest: float | None,
    order: int = 4,
    causal: bool = False,
) -> Motion:
    """Filter with a Butterworth band-pass.

    The filter passes forwards and backwards, which shifts no phase; if `causal`, only forwards.
    Corners are in Hz. Without the lowest it is a low-pass, without the highest a high-pass. At a
    corner two passes halve the amplitude, and one pass leaves 0.71 of it. `order` (1 to 10) is
    that of one pass. InputError unless 0 < lowest < highest < 1 / (2 dt).

    With a lowest corner and two passes, zeros for 0.75 order / lowest [s] are first put before and
    after the record. They stay: what the filter spreads into them is part of the motion. Without
    them displacements are wrong by factors. Boore (2005), BSSA 95(2), 745-750.
    """
    rate = 1.0 / motion.dt
    corners = [f for f in (lowest, highest) if f is not None]
    if not corners or not (np.diff([0.0, *corners, 0.5 * rate]) > 0.0).all():
        raise InputError(
            f"{motion.id or 'motion'}: corners {lowest} and {highest} Hz must satisfy "
            f"0 < lowest < highest < {0.5 / motion.dt:g} Hz"
        )
    kind = "lowpass" if lowest is None else "highpass"
    if corners[1:]:
        kind = "bandpass"
    filters = scipy.signal.butter(
        order, np.squeeze(corners), kind, fs=rate, output="sos"
    )
    done = (
        f"Band-pass {lowest or 0.0:g} to {'the highest' if highest is None else f'{highest:g}'} "
        f"Hz, Butterworth of order {order}, forwards "
        f"{'only (causal)' if causal else 'and backwards'}."
    )
    if causal:
        return motion.changed(lambda a: scipy.signal.sosfilt(filters, a), done)
    taps = 2 * len(filters) + 1 - min((filters[:, [2, 5]] == 0.0).sum(axis=0))
    # scipy's own but for short records
    edge = min(3 * taps, motion.acceleration.size - 1)
    pad = 0
    start = motion.facts.start_time
    if lowest:
        edge = 0
        pad = math.ceil(0.75 * order / (lowest * motion.dt))
        done += f" {pad * motion.dt:g} s of zeros put before and after it first."
        if start:
            start = str(UTCDateTime(start) - pad * motion.dt)

    def filtered(samples: Samples) -> Samples:
        return scipy.signal.sosfiltfilt(filters, np.pad(samples, pad), padlen=edge)

    return motion.stating(start_time=start).changed(filtered, done)


def trim(
    motion: Motion,
    arias: Sequence[float] | None = None,
    threshold_g: float | None = None,
    times: Sequence[float] | None = None,
    margin: float = 0.0,
) -> Motion:
    """Keep the samples from one time to another [s]; InputError unless two samples remain.

    One of three arguments gives the times, InputError if none or several do. `times` are the times
    themselves. `arias` are two fractions: the Arias intensity reaches them at these times (0 and 1
    are the ends of the record). `threshold_g` is an acceleration [g]: a horizontal component
    reaches it for the first and for the last time. The range by `arias` or `threshold_g` is
    extended by a `margin` [s] on both sides.
    """
    name = motion.id or "motion"
    dt = motion.dt
    length = motion.duration
    if [arias, threshold_g, times].count(None) != 2:
        raise InputError("one of arias, threshold_g and times is needed")
    if times is not None:
        start, end = times
    elif arias is not None:
        reached = arias_times(motion, motion.transverse, arias)
        start = max(0.0, reached[0] - margin) if arias[0] > 0.0 else 0.0
        end = reached[1] + margin if arias[1] < 1.0 else length
    else:
        least = (threshold_g or 0.0) * STANDARD_GRAVITY
        strong = np.abs(motion.acceleration) >= least
        if motion.transverse is not None:
            strong |= np.abs(motion.transverse) >= least
        reached = (dt * np.flatnonzero(strong)).tolist()
        if not reached:
            raise InputError(
                f"{name}: no sample reaches the threshold {least:g} m/s2 ({threshold_g:.4g} g) "
                "of the trim"
            )
        start = max(0.0, reached[0] - margin)
        end = reached[-1] + margin
    first = int(np.ceil(start / dt - 1e-9)) if start >= 0.0 else -1
    last = int(np.floor(min(end, length) / dt + 1e-9))
    if first < 0 or last <= first:
        raise InputError(
            f"{name}: cannot cut from {start} s to {end} s; the record lasts {length:g} s and at "
            "least two samples must remain"
        )
    done = f"Cut to {first * dt:g} to {last * dt:g} s."
    return motion.changed(lambda a: a[first : last + 1].copy(), done)


def resample(motion: Motion, dt: float) -> Motion:
    """Resample a motion to the time step `dt` [s], band-limited.

    It is done by scipy's `resample_poly` with a Kaiser window of 64 zero crossings. Up to 0.9 of
    the lower Nyquist frequency no amplitude changes by more than 0.01 %. InputError if the ratio
    of the steps is not one of integers up to 1000.
    """
    ratio = motion.dt / dt if dt > 0.0 else 0.0
    up, down = Fraction(ratio).limit_denominator(1000).as_integer_ratio()
    if not 0 < up <= 1000 or abs(up / down - ratio) > 1e-9 * ratio:
        raise InputError(
            f"{motion.id}: {motion.dt:g} to {dt:g} s is no ratio of integers to 1000"
        )
    if up == down:
        return motion
    size = 2 * 64 * max(up, down) + 1
    window = scipy.signal.firwin(size, 1.0 / max(up, down), window=("kaiser", 10.0))
    done = f"Resampled from {motion.dt:g} to {dt:g} s, band-limited ({up}:{down})."
    return motion.changed(
        lambda a: scipy.signal.resample_poly(a, up, down, window=window),
        done,
        dt=motion.dt * down / up,
    )


def rotate(
    motion: Motion, azimuth: float | None = None, angle: float | None = None
) -> Motion:
    """Return the motion along another horizontal direction, and transverse to it.

    The direction is that of the arch's +x. It is given by its `azimuth` [degrees clockwise from
    north], or by an `angle` [degrees] from the first component towards the other one, which is
    then taken to be perpendicular to the first. InputError unless one of the two is given.
    RecordError if there is one component only, an azimuth that is needed is not known, or the
    components are nearly parallel.
    """
    name = motion.id or "motion"
    if (azimuth is None) == (angle is None):
        raise InputError("rotate: one of azimuth and angle is needed")
    if motion.transverse is None:
        raise RecordError(
            f"{name}: rotate needs two horizontal components, and there is one"
        )
    other = motion.facts.of_transverse or Facts()
    codes = [motion.facts.component, other.component]
    azimuths = [0.0, 90.0]
    turned = float(angle or 0.0) if azimuth is None else azimuth
    if azimuth is None:
        check_right_angle(
            motion.facts, f"{name}: rotate by an angle", "; give an azimuth instead"
        )
        words = f"by {turned:g} degrees from {codes[0]} towards {codes[1]}"
    else:
        for place, facts in enumerate((motion.facts, other)):
            known = azimuth_of(facts.azimuth, facts.component)
            if known is None:
                raise RecordError(
                    f"{name}: the azimuth of {codes[place]!r} is not known; give an angle"
                )
            azimuths[place] = known
        words = (
            f"to azimuth {turned:g} degrees (from {azimuths[0]:g} and {azimuths[1]:g})"
        )
    first, second = np.deg2rad(azimuths)
    sine = np.sin(second - first)
    if abs(sine) < 0.5:
        raise RecordError(
            f"{name}: components {' and '.join(codes)} have azimuths {azimuths[0]:g} and "
            f"{azimuths[1]:g} degrees, too close to each other to be rotated"
        )
    along = np.deg2rad(turned)
    # a(azimuth) = N cos + E sin holds for both components; solved for the direction.
    waves = [
        np.sin(second - direction) / sine * motion.acceleration
        + np.sin(direction - first) / sine * motion.transverse
        for direction in (along, along + 0.5 * np.pi)
    ]
    labels: list[Named] = [
        {"component": f"{degrees:g}", "azimuth": degrees % 360.0}
        if azimuth is not None
        # Angles from a component are no azimuths.
        else {
            "component": f"{codes[0]} turned by {degrees:g}".strip(),
            "azimuth": None,
        }
        for degrees in (turned, turned + 90.0)
    ]
    log = (*motion.log, f"Horizontal components {' and '.join(codes)} rotated {words}.")
    stated = motion.stating(**labels[0], of_transverse=replace(other, **labels[1]))
    return replace(stated, acceleration=waves[0], transverse=waves[1], log=log)


def remove_response(
    motion: Motion,
    record: str | Path,
    inventory: str | Path | Inventory | None = None,
    water_level: float = 60.0,
    band: tuple[float, float, float, float] | None = None,
) -> Motion:
    """Divide the spectrum of each component by its instrument's response (obspy).

    `motion` was read from the file `record` and scaled by the sensitivity of its StationXML (see
    `find_inventory`); this is first undone. Where the response is more than `water_level` [dB]
    below its largest value, this level is used instead. `band` (f1, f2, f3, f4) [Hz] is what to
    keep: cosine tapers are from f1 to f2 and from f3 to f4. RecordError if a StationXML is missing
    or has no response that can be removed.
    """
    table = None
    changed = Named()
    start = UTCDateTime(motion.facts.start_time or 0)
    for key, samples in motion.components.items():
        own = getattr(motion.facts, f"of_{key}", motion.facts)
        codes = (own or Facts()).trace.split(".")
        header = Named(zip(("network", "station", "location", "channel"), codes))
        header |= {"delta": motion.dt, "starttime": start}
        trace = Trace(samples.copy(), header)
        table = table or find_inventory(Path(record), trace, inventory)
        if table is None:
            raise RecordError(
                f"{record}: has no StationXML by which to remove its response; give `inventory`"
            )
        try:
            response = table.get_response(trace.id, start)
            trace.data *= response.instrument_sensitivity.value
            trace.remove_response(
                table,
                output="ACC",
                water_level=water_level,
                pre_filt=band,
                zero_mean=False,
                taper=False,
            )
        except Exception as error:
            raise RecordError(
                f"{record}: the response of channel {trace.id} cannot be removed "
                f"({reason_of(error)})"
            ) from None
        changed[key] = trace.data.astype(float)
    kept = f", {', '.join(f'{corner:g}' for corner in band)} Hz" if band else ""
    done = (
        f"Response removed by StationXML (obspy, water level {water_level:g} dB{kept})."
    )
    return replace(motion, **changed, log=(*motion.log, done))


def both_senses(motion: Motion) -> list[Motion]:
    """Return a motion, and the same with its horizontal components reversed."""
    other = motion.changed(np.negative, "Horizontal components reversed.")
    id = motion.id + REVERSED
    return [motion, replace(other, vertical=motion.vertical, id=id)]
