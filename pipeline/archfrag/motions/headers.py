"""What headers of obspy's formats and StationXML state: unit, quantity, direction, depth, origin.

Each fact goes to ``stats.record``; what contradicts the channel code or the user is a warning.
"""

import contextlib
import math
import re
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from archfrag.motions import partners
from archfrag.motions.motion import METRES_PER_SECOND_SQUARED
from archfrag.motions.partners import HORIZONTAL, VERTICAL, Trace, channel_code

Acceptable = Literal["pga", "time_step", "samples", "header"]
Warned = tuple[Acceptable | None, str]  # None: nothing makes it acceptable

TOLERANCE = 5.0  # [degrees] by which SEED lets a channel N, E or Z deviate
UNEQUAL = 0.02  # of the total sensitivity, by which the product of stages may be off
UNDERGROUND = 5.0  # [m] from which on a sensor counts as one in a borehole
_SAC_QUANTITIES = {6: "a displacement", 7: "a velocity", 50: "volts"}  # IDEP
_QUANTITIES = {
    "a velocity": r"([nuµmck]?m|in|ft)/s|kine", "a displacement": r"([nuµmck]?m|in|ft)",
    "an acceleration in another unit": r"([nuµk]?m|in|ft)/s2|m?g?gal|mg",
}  # fmt: skip
_UNSTATED = {"", "unknown", "none", "na", "n/a", "-", "1", "integer", "float", "ascii"}
_COUNTS = {"count", "counts", "cnt", "cnts", "digital_counts", "digitalcounts", "du", "digits"}


def plain_unit(text: str) -> str:
    """A unit in lower case, ``CM/S**2`` and ``cm/sec/sec`` as ``cm/s2``."""
    plain = re.sub(r"[\s^*()]", "", text.lower())
    return re.sub(r"/s(ec)?/s(ec)?|/sec2", "/s2", plain).replace("/sec", "/s")


def add_stated(trace: Trace) -> Iterator[Warned]:
    """Add what a header of one of obspy's formats states; warn if it is no acceleration."""
    stats, record = trace.stats, trace.stats.record
    sac, gse, text = (stats.get(key, {}) for key in ("sac", "gse2", "ascii"))
    unit = plain_unit(str(text.get("unit") or "").rstrip(", "))
    quantity = _SAC_QUANTITIES.get(_number(sac.get("idep"), -1))
    if unit in METRES_PER_SECOND_SQUARED:
        record.unit = unit
    elif unit in _COUNTS:
        record.unit = "counts"
    elif unit not in _UNSTATED:
        found = (kind for kind, form in _QUANTITIES.items() if re.fullmatch(form, unit))
        quantity = f"{next(found, 'no acceleration')} (its unit is {text['unit']!r})"
    if quantity:
        units = ", ".join(METRES_PER_SECOND_SQUARED)
        needed = f"samples of acceleration are needed, in one of {units}"
        yield None, f"the header of {_named(trace)} states {quantity}; {needed}"
    if stats._format == "KINEMETRICS_EVT" and 0.0 < stats.calib < math.inf:
        record.g_per_count = stats.calib / 9.81  # obspy's own value of g
    azimuth = _number(sac.get("cmpaz", gse.get("hang")), -1.0)
    tilt = _number(sac.get("cmpinc", gse.get("vang")), -1.0)
    # Zeros and -1 are what writers put where they know nothing.
    if 0.0 <= tilt <= 180.0 and (azimuth or tilt or VERTICAL.fullmatch(channel_code(trace))):
        yield from add_direction(trace, azimuth, tilt - 90.0, f"{stats._format} header")
    add_depth(trace, _number(sac.get("stdp"), 0.0), "SAC header")
    origin = _number(sac.get("o"), math.nan)
    if math.isfinite(origin):
        record.origin_time = str(stats.starttime - _number(sac.get("b"), 0.0) + origin)


def _named(trace: Trace) -> str:
    return f"channel {code}" if (code := channel_code(trace)) else "the file"


def _number(value: Any, default: Any) -> Any:
    """A number of a header; `default` if it is missing, or -12345 as SAC writes for that."""
    return default if value in (None, "") or float(value) == -12345.0 else float(value)


def add_direction(trace: Trace, azimuth: float, dip: float, source: str) -> Iterator[Warned]:
    """Add azimuth and dip [degrees] of a channel; warn where they contradict its code."""
    record, code = trace.stats.record, channel_code(trace)
    if not (math.isfinite(azimuth) and math.isfinite(dip)):
        return
    stated, vertical = f"the {source} states a dip of {dip:g} degrees", abs(dip) > 90.0 - TOLERANCE
    if not vertical and abs(dip) > TOLERANCE:
        yield "header", f"channel {code} is neither vertical nor horizontal: {stated}"
        return
    other = HORIZONTAL if vertical else VERTICAL
    if other.fullmatch(code) and not code.isdigit():
        kind = "horizontal" if vertical else "vertical"
        yield "header", f"channel {code} is {kind} by its code, but {stated}"
        return
    before = record.get("azimuth")
    record.vertical = vertical
    if vertical:
        record.downwards = dip > 0.0
        return
    if azimuth < 0.0:
        return
    if before is not None and partners.turned_by(before, azimuth) > TOLERANCE:
        known = f"its own header states azimuth {before:g}"
        yield "header", f"channel {code}: {known}, the {source} {azimuth:g} degrees"
    record.azimuth = azimuth % 360.0
    by_code = partners.azimuth_of_code(code)
    if by_code is not None and (off := partners.turned_by(by_code, azimuth)) > TOLERANCE:
        sense = "its polarity is reversed" if off > 180.0 - TOLERANCE else "this azimuth counts"
        differ = f"azimuth {by_code:g} by its code, {azimuth:g} by the {source}"
        record.cautions += (f"channel {code} has {differ}; {sense}",)


def add_depth(trace: Trace, depth: float, source: str) -> None:
    """Note a sensor that is below the ground."""
    if UNDERGROUND <= depth < 20_000.0:
        trace.stats.record.sensor = f"is {depth:g} m below the surface by its {source}"


def add_station(trace: Trace, inventory: Any) -> Iterator[Warned]:
    """Add direction and depth of a channel by StationXML; compare its sensitivity and stages."""
    code, time, channel = channel_code(trace), trace.stats.starttime, dict[str, Any]()
    with contextlib.suppress(Exception):  # obspy's, of a channel that is not in it
        channel = inventory.get_channel_metadata(trace.id, time)
    azimuth, dip = (channel.get(key) for key in ("azimuth", "dip"))
    if dip is not None:
        yield from add_direction(trace, -1.0 if azimuth is None else azimuth, dip, "StationXML")
    add_depth(trace, float(channel.get("local_depth") or 0.0), "StationXML")
    try:
        response = inventory.get_response(trace.id, time)
        total = float(response.instrument_sensitivity.value)
    except Exception:  # which is refused where the sensitivity is needed
        return
    gains = [stage.stage_gain for stage in response.response_stages or ()]
    product = float(np.prod([gain for gain in gains if gain is not None]))
    if any(gains) and not abs(product / total - 1.0) <= UNEQUAL:
        numbers = f"a total sensitivity of {total:.6g} and stages whose product is {product:.6g}"
        use = "the total is used, by the step `response` the stages; find out which is right"
        trace.stats.record.cautions += (f"channel {code}: its StationXML states {numbers}; {use}",)
    if is_seismometer(code) and "S**2" in str(response.instrument_sensitivity.input_units).upper():
        both = "is of a seismometer by its code, of an accelerometer by its StationXML"
        trace.stats.record.cautions += (f"channel {code} {both}; the StationXML counts",)


def is_seismometer(code: str) -> bool:
    """Return whether a code of SEED names a seismometer, which measures velocity."""
    return bool(re.fullmatch(r"[FGDCESHBMLVU][HLP][A-Z1-3]", code.upper()))


def against_the_user(trace: Trace, unit: str) -> Iterator[Warned]:
    """Warn where the header contradicts that the samples are in a unit of acceleration."""
    stats, given = trace.stats, f"and the unit {unit} was given"
    if stats.record.get("unit") == "counts":
        yield "header", f"the header of {_named(trace)} states counts, {given}"
    elif stats.calib not in (0.0, 1.0):
        what = f"the header of {_named(trace)} states a calibration factor of {stats.calib:g}"
        yield "header", f"{what}, so that its samples are counts, {given}"
    elif is_seismometer(channel_code(trace)):
        yield "header", f"{_named(trace)} is of a seismometer (velocity) by its code, {given}"
