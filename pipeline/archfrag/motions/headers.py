"""What headers of obspy's formats and StationXML state: unit, quantity, direction, depth, origin.

Each fact goes to the `Channel`; what contradicts its code or the user becomes a warning.
"""

import contextlib
import math
import re
from typing import Any

import numpy as np

from archfrag.motions.channel import (
    HORIZONTAL,
    METRES_PER_SECOND_SQUARED,
    VERTICAL,
    Channel,
    Trace,
    azimuth_of_code,
    turned_by,
)

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
    """Return a unit in lower case, ``CM/S**2`` and ``cm/sec/sec`` as ``cm/s2``."""
    plain = re.sub(r"[\s^*()]", "", text.lower())
    return re.sub(r"/s(ec)?/s(ec)?|/sec2", "/s2", plain).replace("/sec", "/s")


def add_stated(trace: Trace) -> None:
    """Add what a header of one of obspy's formats states; warn if it is no acceleration."""
    stats, channel = trace.stats, trace.stats.record
    sac, gse, text = (stats.get(key, {}) for key in ("sac", "gse2", "ascii"))
    unit = plain_unit(str(text.get("unit") or "").rstrip(", "))
    quantity = _SAC_QUANTITIES.get(_number(sac.get("idep"), -1))
    if unit in METRES_PER_SECOND_SQUARED:
        channel.unit = unit
    elif unit in _COUNTS:
        channel.unit = "counts"
    elif unit not in _UNSTATED:
        kinds = (kind for kind, form in _QUANTITIES.items() if re.fullmatch(form, unit))
        quantity = f"{next(kinds, 'no acceleration')} (its unit is {text['unit']!r})"
    if quantity:
        units = ", ".join(METRES_PER_SECOND_SQUARED)
        needed = f"samples of acceleration are needed, in one of {units}"
        stated = f"the header of {_named(channel)} states {quantity}"
        channel.warnings.append((None, f"{stated}; {needed}"))
    if stats._format == "KINEMETRICS_EVT" and 0.0 < stats.calib < math.inf:
        channel.g_per_count = stats.calib / 9.81  # obspy's own value of g
    azimuth = _number(sac.get("cmpaz", gse.get("hang")), -1.0)
    tilt = _number(sac.get("cmpinc", gse.get("vang")), -1.0)
    # Zeros and -1 are what writers put where they know nothing.
    if 0.0 <= tilt <= 180.0 and (azimuth or tilt or VERTICAL.fullmatch(channel.code)):
        _add_direction(channel, azimuth, tilt - 90.0, f"{stats._format} header")
    _add_depth(channel, _number(sac.get("stdp"), 0.0), "SAC header")
    origin = _number(sac.get("o"), math.nan)
    if math.isfinite(origin):
        channel.origin_time = str(stats.starttime - _number(sac.get("b"), 0.0) + origin)


def _named(channel: Channel) -> str:
    return f"channel {channel.code}" if channel.code else "the file"


def _number(value: Any, default: Any) -> Any:
    """Return a number of a header; `default` if it is missing, or -12345, as SAC writes then."""
    return default if value in (None, "") or float(value) == -12345.0 else float(value)


def _add_direction(channel: Channel, azimuth: float, dip: float, source: str) -> None:
    """Add azimuth and dip [degrees] of a channel; warn if they contradict its code."""
    code = channel.code
    if not (math.isfinite(azimuth) and math.isfinite(dip)):
        return
    stated, vertical = f"the {source} states a dip of {dip:g} degrees", abs(dip) > 90.0 - TOLERANCE
    if not vertical and abs(dip) > TOLERANCE:
        text = f"channel {code} is neither vertical nor horizontal: {stated}"
        channel.warnings.append(("header", text))
        return
    if (HORIZONTAL if vertical else VERTICAL).fullmatch(code) and not code.isdigit():
        kind = "horizontal" if vertical else "vertical"
        text = f"channel {code} is {kind} by its code, but {stated}"
        channel.warnings.append(("header", text))
        return
    before, channel.vertical = channel.azimuth, vertical
    if vertical:
        channel.downwards = dip > 0.0
    if vertical or azimuth < 0.0:
        return
    if before is not None and turned_by(before, azimuth) > TOLERANCE:
        text = f"its own header states azimuth {before:g}, the {source} {azimuth:g} degrees"
        channel.warnings.append(("header", f"channel {code}: {text}"))
    channel.azimuth = azimuth % 360.0
    by_code = azimuth_of_code(code)
    if by_code is not None and (off := turned_by(by_code, azimuth)) > TOLERANCE:
        sense = "its polarity is reversed" if off > 180.0 - TOLERANCE else "this azimuth counts"
        differ = f"azimuth {by_code:g} by its code, {azimuth:g} by the {source}"
        channel.cautions.append(f"channel {code} has {differ}; {sense}")


def _add_depth(channel: Channel, depth: float, source: str) -> None:
    """Note a sensor that is below the ground."""
    if UNDERGROUND <= depth < 20_000.0:
        channel.sensor = f"is {depth:g} m below the surface by its {source}"


def add_station(trace: Trace, inventory: Any) -> None:
    """Add direction and depth of a channel by StationXML; compare its sensitivity and stages."""
    channel, time, facts = trace.stats.record, trace.stats.starttime, dict[str, Any]()
    with contextlib.suppress(Exception):  # obspy's, of a channel that is not in it
        facts = inventory.get_channel_metadata(trace.id, time)
    azimuth, dip = (facts.get(key) for key in ("azimuth", "dip"))
    if dip is not None:
        _add_direction(channel, -1.0 if azimuth is None else azimuth, dip, "StationXML")
    _add_depth(channel, float(facts.get("local_depth") or 0.0), "StationXML")
    try:
        response = inventory.get_response(trace.id, time)
        total = float(response.instrument_sensitivity.value)
    except Exception:  # which stops the reading where the sensitivity is needed
        return
    gains = [stage.stage_gain for stage in response.response_stages or ()]
    product = float(np.prod([gain for gain in gains if gain is not None]))
    if any(gains) and not abs(product / total - 1.0) <= UNEQUAL:
        numbers = f"a total sensitivity of {total:.6g} and stages whose product is {product:.6g}"
        use = "the total is used, by the step `response` the stages; find out which is right"
        channel.cautions.append(f"channel {channel.code}: its StationXML states {numbers}; {use}")
    units = str(response.instrument_sensitivity.input_units).upper()
    if _is_seismometer(channel.code) and "S**2" in units:
        both = "is of a seismometer by its code, of an accelerometer by its StationXML"
        channel.cautions.append(f"channel {channel.code} {both}; the StationXML counts")


def _is_seismometer(code: str) -> bool:
    """Tell whether a code of SEED names a seismometer, which measures velocity."""
    return bool(re.fullmatch(r"[FGDCESHBMLVU][HLP][A-Z1-3]", code.upper()))


def compare_with_the_user(trace: Trace, unit: str) -> None:
    """Warn if the header contradicts that the samples are in a unit of acceleration."""
    stats, channel, user = trace.stats, trace.stats.record, f"and the unit {unit} was given"
    text = ""
    if channel.unit == "counts":
        text = f"the header of {_named(channel)} states counts, {user}"
    elif stats.calib not in (0.0, 1.0):
        what = f"the header of {_named(channel)} states a calibration factor of {stats.calib:g}"
        text = f"{what}, so that its samples are counts, {user}"
    elif _is_seismometer(channel.code):
        text = f"{_named(channel)} is of a seismometer (velocity) by its code, {user}"
    if text:
        channel.warnings.append(("header", text))
