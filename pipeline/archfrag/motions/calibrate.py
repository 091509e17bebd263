"""Units, directions and senses of channels, and what is wrong with them.

Headers of obspy's formats, StationXML and the user state them. Each fact goes to the `Channel`;
what contradicts its code or the user becomes a warning.
"""

import contextlib
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from archfrag.errors import RecordError, reason_of
from archfrag.files import Named, read_bytes
from archfrag.motions.channel import (
    HORIZONTAL,
    METRES_PER_SECOND_SQUARED,
    STANDARD_GRAVITY,
    VERTICAL,
    Acceptable,
    Channel,
    Trace,
    Warned,
    azimuth_of_code,
    turned_by,
    unit_factor,
    wrong_length,
)
from archfrag.motions.measures import odd_samples, peak_of

Inventory = Any  # obspy's, whose import takes time
ACCEPTABLE: tuple[Acceptable, ...] = get_args(Acceptable)
_BOREHOLE = re.compile(r"(EW|NS|UD)1")  # of KiK-net, whose surface is 2
LARGEST_INVENTORY = 50_000_000  # [bytes]
TOLERANCE = 5.0  # [degrees] by which SEED lets a channel N, E or Z deviate
UNEQUAL = 0.02  # of the total sensitivity, by which the product of stages may be off
UNDERGROUND = 5.0  # [m] from which on a sensor counts as one in a borehole
_SAC_QUANTITIES = {6: "a displacement", 7: "a velocity", 50: "volts"}  # IDEP
# IFTYPE other than a time series, and IQUAL (SAC manual, "SAC data file format").
_SAC_FILES = {
    2: "a spectrum (real and imaginary part)",
    3: "a spectrum (amplitude and phase)",
    4: "pairs of x and y",
    51: "a surface over x and y",
}
_SAC_FLAWS = {47: "glitches", 48: "dropouts"}
# What is measured by the instrument code of SEED ("SEED manual", appendix A), unless acceleration.
_INSTRUMENTS = {
    **dict.fromkeys("HLP", "a seismometer (velocity)"),
    "D": "a pressure gauge",
    "F": "a magnetometer",
    "J": "a rotational sensor",
    "M": "a mass position",
    "S": "a strain gauge",
}
# Matches the place of an instrument that does not record the motion of the ground.
_STRUCTURE = (
    r"(?i)\b(roof|penthouse|attic|parapet|(?!1st)\d+(st|nd|rd|th)\s+(floor|fl|level|story)|deck|girder|"
    r"superstructure|crest|chimney|mid-?(span|height)|top (of|center)|bent|pier)\b"
)
_QUANTITIES = {
    "a velocity": r"([nuµmck]?m|in|ft)/s|kine",
    "a displacement": r"([nuµmck]?m|in|ft)",
    "an acceleration in another unit": r"([nuµk]?m|in|ft)/s2|m?g?gal|[mu]g|%g",
}
_UNSTATED = "|unknown|none|n/?a|-|1|integer|float|ascii"
_COUNTS = "(digital_?)?(count|cnt)s?|du|digits"


def accepted_words(words: Iterable[str], place: object) -> tuple[Acceptable, ...]:
    """Return the words of an option `accept`; RecordError for an unknown word.

    `words` are a list, or a text with commas or blanks between them. `place` begins the message.
    """
    text = words if isinstance(words, str) else " ".join(words)
    chosen = text.replace(",", " ").split()
    for word in chosen:
        if word not in ACCEPTABLE:
            raise RecordError(
                f"{place}: accept {word!r} is not one of {', '.join(ACCEPTABLE)}"
            )
    return tuple(word for word in ACCEPTABLE if word in chosen)


def impossible(channel: Channel) -> Iterator[Warned]:
    """Yield a warning for each thing in a channel that is impossible or contradicts its header."""
    data = channel.trace.data
    id = channel.trace.id
    delta = channel.trace.stats.delta
    if channel.announced != channel.held:
        yield (
            "samples",
            f"the header announces {channel.announced} samples of channel "
            f"{channel.code or id}, the file holds "
            f"{'only ' if channel.held < channel.announced else ''}{channel.held}",
        )
    elif channel.contradicted:
        yield "header", f"channel {channel.code or id}: {channel.contradicted}"
    bad = np.flatnonzero(~np.isfinite(data))
    for wrong, what in (
        (not 0.0 < delta < np.inf, f"has a time step of {delta} s, not a positive one"),
        (min(channel.held, len(data)) < 2, "holds less than 2 samples"),
        (np.iscomplexobj(data), "has complex samples; accelerations are real numbers"),
        (np.ma.isMaskedArray(data), "has gaps; a record must be without gaps"),
    ):
        if wrong:
            yield None, f"channel {id} {what}"
    if bad.size:
        yield None, f"channel {id} is not finite, the first time at index {bad[0]}"


def implausible(channel: Channel) -> Iterator[Warned]:
    """Yield a warning if the time step or the peak of a channel in m/s2 is implausible."""
    dt = channel.trace.stats.delta
    # A rate such as 10 Hz need not give 0.1 s to the last digit.
    if not 1e-4 * (1.0 - 1e-9) <= dt <= 0.1 * (1.0 + 1e-9):
        yield (
            "time_step",
            f"time step of channel {channel.code} is {dt:g} s, outside 0.0001 to 0.1 s",
        )
    peak = peak_of(channel.trace.data) / STANDARD_GRAVITY
    if not 1e-5 <= peak <= 5.0:
        yield (
            "pga",
            f"peak of channel {channel.code} is {peak:.4g} g by its unit "
            f"{channel.unit_in_file}, outside 1e-05 to 5 g",
        )


def accept_or_refuse(
    place: object, accept: Sequence[Acceptable], warnings: Iterable[Warned]
) -> list[str]:
    """Return a line for each warning; RecordError for the first that is not in `accept`."""
    lines = []
    for word, fact in warnings:
        if word not in accept:
            how = (
                f"; to use it as it is give `accept` with {word} (--accept {word} on the "
                "command line)"
            )
            raise RecordError(f"{place}: {fact}{how if word else ''}")
        lines.append(f"Accepted: {fact}.")
    return lines


def plain_unit(text: str) -> str:
    """Return a unit in lower case, ``CM/S**2`` and ``cm/sec/sec`` as ``cm/s2``."""
    plain = re.sub(r"[\s^*()]", "", re.sub("â?²", "2", text.lower()))
    return re.sub(r"/s(ec)?/s(ec)?|/sec2", "/s2", plain).replace("/sec", "/s")


def _add_stated(channel: Channel) -> None:
    """Read what the header of a channel, read by obspy, states, and add it to the channel.

    This is its unit, scale, direction, depth and origin time. A warning is added if the samples
    are no acceleration, or if they contradict the header.
    """
    stats = channel.trace.stats
    name = _named(channel)
    source = f"{stats._format} header"
    sac = stats.get("sac", {})
    gse = stats.get("gse2") or stats.get("gse1") or {}
    stated = str(stats.get("ascii", {}).get("unit") or "")
    unit = plain_unit(stated.rstrip(", "))
    quantity = _SAC_FILES.get(_number(sac, "iftype"))
    if _number(sac, "leven", 1.0) == 0.0:
        quantity = "samples at unequal steps"
    quantity = quantity or _SAC_QUANTITIES.get(_number(sac, "idep"))
    if unit in METRES_PER_SECOND_SQUARED:
        channel.unit = unit
    elif re.fullmatch(_COUNTS, unit):
        channel.unit = "counts"
    elif not re.fullmatch(_UNSTATED, unit):
        kinds = (kind for kind, form in _QUANTITIES.items() if re.fullmatch(form, unit))
        quantity = f"{next(kinds, 'no acceleration')} (its unit is {stated!r})"
    if quantity:
        text = (
            f"the header of {name} states {quantity}; samples of acceleration are needed, in "
            f"one of {', '.join(METRES_PER_SECOND_SQUARED)}"
        )
        channel.warn(text, None)
    if stats._format == "KINEMETRICS_EVT" and 0.0 < stats.calib < math.inf:
        channel.g_per_count = stats.calib / 9.81  # obspy's own value of g
    azimuth = _number(sac, "cmpaz", gse.get("hang", -1.0))
    tilt = _number(sac, "cmpinc", gse.get("vang", -1.0))
    # Zeros and -1 are what writers put where they know nothing.
    if 0.0 <= tilt <= 180.0 and (azimuth or tilt or VERTICAL.fullmatch(channel.code)):
        _add_direction(channel, azimuth, tilt - 90.0, source)
    for depth in (channel.depth, _number(sac, "stdp"), 1e3 * _number(gse, "edepth")):
        _add_depth(channel, depth or 0.0, source)
    begin = _number(sac, "b")
    peak = max(abs(_number(sac, key)) for key in ("depmin", "depmax"))
    held = peak_of(channel.trace.data)
    if peak and abs(peak - held) > 0.1 * peak:
        channel.warn(
            f"the header of {name} states a peak of {peak:g}, the samples have {held:g}"
        )
    length = _number(sac, "e", math.nan) - begin
    wrong = wrong_length(length, channel.held, stats.delta)
    if wrong:
        channel.warn(f"{name}: {wrong}")
    flaw = _SAC_FLAWS.get(_number(sac, "iqual"))
    if flaw:
        channel.cautions.append(f"the header of {name} states {flaw} (IQUAL)")
    origin = _number(sac, "o", math.nan)
    if math.isfinite(origin):
        channel.origin_time = str(stats.starttime - begin + origin)


def _number(header, key: str, default=0.0):
    """Return a number of a header; `default` if it is missing or -12345, SAC's mark for this."""
    value = header.get(key)
    return float(default if value in (None, "") or float(value) == -12345.0 else value)


def _named(channel: Channel) -> str:
    return f"channel {channel.code}" if channel.code else "the file"


def _add_direction(channel: Channel, azimuth: float, dip: float, source: str) -> None:
    """Add azimuth and dip [degrees] of a channel; warn if they contradict its code."""
    code = channel.code
    if not math.isfinite(azimuth + dip):
        return
    stated = f"the {source} states a dip of {dip:g} degrees"
    vertical = abs(dip) > 90.0 - TOLERANCE
    if not vertical and abs(dip) > TOLERANCE:
        channel.warn(f"channel {code} is neither vertical nor horizontal: {stated}")
        return
    if (HORIZONTAL if vertical else VERTICAL).fullmatch(code) and not code.isdigit():
        kind = "horizontal" if vertical else "vertical"
        channel.warn(f"channel {code} is {kind} by its code, but {stated}")
        return
    channel.vertical = vertical
    if vertical:
        channel.downwards = dip > 0.0
    if vertical or azimuth < 0.0:
        return
    before = channel.azimuth
    if before is not None and turned_by(before, azimuth) > TOLERANCE:
        channel.warn(
            f"channel {code}: its own header states azimuth {before:g}, the {source} "
            f"{azimuth:g} degrees"
        )
    channel.azimuth = azimuth % 360.0
    by_code = azimuth_of_code(code)
    off = 0.0 if by_code is None else turned_by(by_code, azimuth)
    if off > TOLERANCE:
        sense = "this azimuth counts"
        if off > 180.0 - TOLERANCE:
            sense = "its polarity is reversed"
        channel.cautions.append(
            f"channel {code} has azimuth {by_code:g} by its code, {azimuth:g} by the "
            f"{source}; {sense}"
        )


def _add_depth(channel: Channel, depth: float, source: str) -> None:
    """Set the place of the sensor of a channel if its `depth` [m] is below the ground."""
    if UNDERGROUND <= depth < 20_000.0:
        channel.sensor = f"is {depth:g} m below the surface by its {source}"


def _add_place(channel: Channel, path: Path) -> None:
    """Set the place of the sensor of a channel if it is in a structure or a KiK-net borehole."""
    stats = channel.trace.stats
    station = f"{stats.station} {channel.station} {path.name}".upper()
    kik_net = stats._format == "KNET" or re.search(r"\b[A-Z]{3}H\d\d", station)
    place = re.search(_STRUCTURE, f"{channel.place} {stats.location}")
    ends = [path.suffix[1:].upper(), channel.code.upper()][: 2 if kik_net else 1]
    if any(map(_BOREHOLE.fullmatch, ends)):
        channel.sensor = (
            "is in the borehole of a KiK-net station, whose surface is EW2, NS2, UD2"
        )
    elif place:
        channel.sensor = f"is in a structure by its header ({place[0]})"


def _add_station(channel: Channel, inventory: Inventory) -> None:
    """Add direction and depth of a channel by StationXML; compare its sensitivity and stages."""
    trace = channel.trace
    where = trace.id, trace.stats.starttime
    facts = Named()
    with contextlib.suppress(Exception):  # obspy's, of a channel that is not in it
        facts = inventory.get_channel_metadata(*where)
    azimuth = facts.get("azimuth")
    if facts.get("dip") is not None:
        azimuth = -1.0 if azimuth is None else azimuth
        _add_direction(channel, azimuth, facts["dip"], "StationXML")
    _add_depth(channel, facts.get("local_depth") or 0.0, "StationXML")
    try:
        response = inventory.get_response(*where)
        overall = response.instrument_sensitivity
        total = float(overall.value)
    except Exception:  # which stops the reading where the sensitivity is needed
        return
    gains = [stage.stage_gain for stage in response.response_stages or ()]
    product = np.prod([gain for gain in gains if gain is not None])
    if any(gains) and not abs(product / total - 1.0) <= UNEQUAL:
        channel.cautions.append(
            f"channel {channel.code}: its StationXML states a total sensitivity of {total:.6g} "
            f"and stages whose product is {product:.6g}; reading uses the total, the step "
            "`response` the stages; find out which is right"
        )
    other = _instrument(channel.code)
    if other and "S**2" in str(overall.input_units).upper():
        channel.cautions.append(
            f"channel {channel.code} is of {other} by its code, of an accelerometer by its "
            "StationXML; the StationXML counts"
        )


def _instrument(code: str) -> str:
    """Return the instrument that a SEED code names; empty for an accelerometer or another code."""
    if not re.fullmatch("[FGDCESHBMLVU][A-Z][A-Z1-3]", code.upper()):
        return ""
    return _INSTRUMENTS.get(code[1].upper(), "")


def _compare_with_the_user(channel: Channel, unit: str) -> None:
    """Warn if the header contradicts the `unit` of acceleration that a user or an index gave."""
    calib = channel.trace.stats.calib
    name = _named(channel)
    other = _instrument(channel.code)
    user = f"and the unit {unit} was given"
    if channel.unit == "counts":
        channel.warn(f"the header of {name} states counts, {user}")
    elif calib not in (0.0, 1.0):
        channel.warn(
            f"the header of {name} states a calibration factor of {calib:g}, so that its "
            f"samples are counts, {user}"
        )
    elif other:
        channel.warn(f"{name} is of {other} by its code, {user}")


def to_si(channel: Channel, path: Path, asked: str | None, listed: str, table) -> None:
    """Convert a channel to m/s2, and a vertical channel to positive upwards, in place.

    If it cannot be converted, a warning is added that says why. `asked` is the user's unit,
    `listed` that of an index, `table` the user's StationXML.
    """
    trace = channel.trace
    values = trace.data
    inventory = None
    if channel.is_refused:
        return
    _add_stated(channel)
    _add_place(channel, path)
    if channel.is_refused:
        return
    try:
        if channel.unit in ("", "counts"):
            inventory = find_inventory(path, trace, table)
        if inventory is not None:
            _add_station(channel, inventory)
        _scale(channel, path, asked, listed, inventory)
    except RecordError as error:
        channel.warn(str(error).removeprefix(f"{path}: "), None)
    mean = values.mean()
    motion = peak_of(values - mean)
    if abs(mean) > motion > 0.0:
        unit = channel.unit_in_file or "unit unknown"
        channel.errors.append(
            f"the offset of the samples, {mean:.4g}, is larger than their motion about it, "
            f"{motion:.4g} [{unit} in the file]"
        )
    if not channel.unit_in_file:
        return
    odd = odd_samples(trace.data, trace.stats.delta)
    channel.cautions += [f"{_named(channel)}: {text}" for text in odd]
    if channel.sensor:
        channel.warn(f"{_named(channel)} {channel.sensor}", "sensor")
    down = channel.downwards
    if down is None and inventory is None:
        code = channel.code.upper().lstrip("+")
        down = code.startswith(("DWN", "DOWN", "-UP"))
    if channel.is_vertical and down:
        trace.data = -trace.data
        channel.log.append(f"Sign of {channel.code} changed: it counts downwards.")


def _scale(
    channel: Channel,
    path: Path,
    asked: str | None,
    listed: str,
    inventory: Inventory | None,
) -> None:
    """Multiply the samples so that they are in m/s2.

    The first source that states a unit counts: the file's header; the index that lists the file;
    the K-NET scale factor (which obspy leaves in ``stats.calib``, not applied); StationXML; the
    sensitivities in a COSMOS header; the user. The mean of counts and uncorrected volumes is
    removed: it is the instrument's offset, which can exceed the motion.
    """
    trace = channel.trace
    form = trace.stats._format
    if asked is not None:
        unit_factor(asked, path)
    by_header = channel.unit not in ("", "counts")
    unit, source = (channel.unit, f"{form} header") if by_header else (listed, "index")
    stated = f"states {unit!r}"
    same = True
    raw = "Uncorrected: mean removed" if channel.level == "raw" else ""
    sensitivity = None if unit else _of_counts(channel, path, inventory)
    if sensitivity:
        factor, source = sensitivity
        unit = "counts"
        raw = "Mean removed"
        same = not asked or (asked == "m/s2" and form == "KNET")
        stated = "converts its counts"
        done = f"Converted from counts to m/s2 by the {source}, factor {factor:.9g}."
    elif unit or asked:
        how = f"from the {source}" if unit else "as asked for"
        unit = unit or asked or ""
        factor = unit_factor(unit, source)
        same = METRES_PER_SECOND_SQUARED[asked or unit] == factor
        done = f"Converted to m/s2: unit {unit} {how}, factor {factor:g}."
    else:
        need = (
            "does not state the unit of its samples; give `unit`, one of "
            f"{', '.join(METRES_PER_SECOND_SQUARED)} (--unit on the command line), or for "
            "counts its"
        )
        if channel.unit == "counts":
            need = "states counts and does not state the unit of one; give its"
        raise RecordError(
            f"{path}: the file {need} StationXML as {path.stem}.xml beside it or by "
            "`inventory` (--inventory on the command line)"
        )
    if not by_header and unit != "counts":
        _compare_with_the_user(channel, unit)
    if not same:
        raise RecordError(
            f"{path}: unit {asked!r} asked for but the {source} {stated}; leave `unit` out"
        )
    trace.data = trace.data * factor
    channel.unit_in_file = unit
    channel.log.append(done)
    if raw:
        channel.log.append(f"{raw} ({trace.data.mean():.6g} m/s2).")
        trace.data = trace.data - trace.data.mean()


def _of_counts(
    channel: Channel, path: Path, inventory: Inventory | None
) -> tuple[float, str] | None:
    """Return the factor from counts to m/s2 and its source; None if nothing states one."""
    trace = channel.trace
    if trace.stats._format == "KNET":
        return trace.stats.calib, "file's scale factor"
    if inventory is not None:
        try:
            response = inventory.get_response(trace.id, trace.stats.starttime)
            overall = response.instrument_sensitivity
            unit = (overall.input_units or "").upper()
            value = float(overall.value)
            out = (overall.output_units or "COUNTS").upper()
        except Exception:
            raise RecordError(
                f"{path}: the StationXML has no response for channel {trace.id} at "
                f"{trace.stats.starttime}"
            ) from None
        counts = re.search("COUNT|CNT|DIGIT", out)
        known = counts and plain_unit(unit) == "m/s2"
        if not (known and value and np.isfinite(value)):
            raise RecordError(
                f"{path}: channel {trace.id} has {value:g} {out.lower()}/({unit}) in "
                "StationXML; counts/(M/S**2) are needed"
            )
        return 1.0 / value, f"sensitivity {value:.6g} counts/(m/s2) of its StationXML"
    per_count = channel.g_per_count
    if not per_count:
        return None
    source = f"sensitivity {1.0 / per_count:.6g} counts/g of its header"
    return per_count * STANDARD_GRAVITY, source


def find_inventory(path: Path, trace: Trace, given) -> Inventory | None:
    """Return the StationXML for a trace; None if there is no such file.

    If none is given, it is NAME.xml beside the record `path`, or else NET.STA.xml. RecordError if
    the file cannot be read.
    """
    from obspy import read_inventory  # start-up: a Motion needs no obspy

    if not (given is None or isinstance(given, str | Path)):
        return given
    names = (path.stem, f"{trace.stats.network}.{trace.stats.station}")
    near = (path.with_name(f"{name}.xml") for name in names)
    file = given or next(filter(Path.is_file, near), None)
    if not file:
        return None
    content = read_bytes(
        Path(file), LARGEST_INVENTORY, RecordError, "the StationXML file"
    )
    try:
        # From memory: obspy takes a path for a pattern or an address, and unpacks archives.
        return read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        raise RecordError(
            f"{file}: cannot be read as StationXML ({reason_of(error)})"
        ) from None
