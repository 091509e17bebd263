"""Which components belong together, and which directions they have: by names, headers, starts."""

import os
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.errors import RecordError
from archfrag.motions.motion import Motion

Trace = Any  # obspy's, whose import takes time
VERTICAL = re.compile(r"[-+]?(U|V|Z|UD\d?|UP|DWN|DOWN|VERT|VERTICAL|..Z)", re.IGNORECASE)
HORIZONTAL = re.compile(
    r"[-+]?((EW|NS)\d?|[ENXYRTHL]\d?|[NS]\d+(\.\d+)?[EW]|\d{1,3}|..[ENXYRT12])", re.IGNORECASE
)
AZIMUTHS = {"N": 0.0, "NORTH": 0.0, "NS": 0.0, "E": 90.0, "EAST": 90.0, "EW": 90.0, "WE": 90.0,
            "S": 180.0, "SOUTH": 180.0, "W": 270.0, "WEST": 270.0}  # fmt: skip
_QUADRANT = re.compile(r"([NS])(\d+(?:\.\d+)?)([EW])")
# Where a direction may stand in a name: it ends a word, and is no small letter within one.
_CODE = re.compile(
    r"(?<![A-Za-z\d])[Hh][12](?![A-Za-z\d])"
    r"|(?<=(?<![A-Za-z\d])[A-Z][GHLN])(?P<sensor>[12])(?![A-Za-z\d])"  # HN1
    r"|[NS]\d{1,2}(?:\.\d+)?[EW](?![A-Za-z\d])"
    r"|(?:EW|WE|NS|[ENSWXYRTL]|(?<![A-Za-z])(?:ew|we|ns|[enswxyrtl]))(?=\d?(?![A-Za-z\d]))"
    r"|\d{3}(?!\d)|(?<!\d)\d{1,2}(?!\d)"
)
_ANGLES = (AZIMUTHS, {"X": 0.0, "Y": 90.0}, {"R": 0.0, "L": 0.0, "T": 90.0},
           {"H1": 0.0, "H2": 90.0})  # fmt: skip
SKEWED = 5.0  # [degrees] by which two components may be off a right angle
_VERTICALS = [sign + code for sign in ("", "-", "+") for code in (
    "u", "v", "z", "ud", "up", "dwn", "down", "vert", "vertical")]  # fmt: skip


def channel_code(trace: Trace) -> str:
    """Name of the component: by the header of the record, or the channel code."""
    return str(trace.stats.get("record", {}).get("component", trace.stats.channel)).strip()


def instrument(trace: Trace) -> str:
    """Return the key that channels of one instrument share."""
    stats, code = trace.stats, channel_code(trace)
    if stats._format == "KNET":
        return f"{stats.station}.{code[2:]}"
    family = code[:-1] if len(code) == 3 and code.isalnum() and not code.isdigit() else ""
    return f"{stats.network}.{stats.station}.{stats.location}.{family}"


def is_vertical(trace: Trace) -> bool:
    """Whether a channel is vertical, by its header or its code."""
    return bool(trace.stats.record.get("vertical", VERTICAL.fullmatch(channel_code(trace))))


def is_horizontal(trace: Trace) -> bool:
    """Whether a channel is known to be horizontal, by its header or its code."""
    by_code = HORIZONTAL.fullmatch(channel_code(trace)) is None
    return not trace.stats.record.get("vertical", by_code)


def quadrant(text: str) -> float | None:
    """Azimuth of a bearing such as S16W [degrees from north], None if it is not one."""
    if (found := _QUADRANT.fullmatch(text.upper())) is None:
        return None
    angle = float(found[2]) if found[1] == "N" else 180.0 - float(found[2])
    return (angle if found[3] == "E" else -angle) % 360.0


def azimuth_of_code(code: str) -> float | None:
    """Azimuth [degrees] by the name of a component: ``N``, ``EW1``, ``HNE``, ``180``, ``S45E``."""
    text = code.strip().upper().lstrip("-+")
    if (bearing := quadrant(text)) is not None:
        return bearing
    if re.fullmatch(r"\d{2,3}", text):
        return float(text) % 360.0
    return AZIMUTHS.get(re.sub(r"^[A-Z][A-Z](?=[NE]$)|\d$", "", text))


def turned_by(one: float, other: float) -> float:
    """Angle between two azimuths, 0 to 180 degrees."""
    return abs((one - other + 180.0) % 360.0 - 180.0)


def azimuth_of(motion: Motion, which: str = "") -> float | None:
    """Azimuth of a motion's component, or of its ``_transverse``, as stated or by its code."""
    given = motion.metadata.get(f"azimuth{which}")
    if given in (None, ""):
        return azimuth_of_code(str(motion.metadata.get(f"component{which}", "")))
    return float(given)


def check_right_angle(motion: Motion, what: str, remedy: str = "") -> None:
    """Raise RecordError if azimuths are known by which two components are not at right angles."""
    one, other = azimuth_of(motion), azimuth_of(motion, "_transverse")
    if one is None or other is None or abs(turned_by(one, other) - 90.0) <= SKEWED:
        return
    angle = f"have azimuths {one:g} and {other:g} degrees, not at right angles"
    raise RecordError(f"{motion.id or 'motion'}: {what}: the components {angle}{remedy}")


def partners(names: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Names of the other horizontal component by that of each, and of the vertical, in a folder.

    Two names that are equal but for a direction are a pair if these are at right angles and there
    is no third such name: numbered files are no components. Their vertical has the same name
    with ``UP``, ``Z`` or the like instead of the direction.

    >>> partners(["ELC180.AT2", "ELC270.AT2", "quake1.txt", "quake2.txt", "ELC-UP.AT2"])[0]
    {'ELC180.AT2': 'ELC270.AT2', 'ELC270.AT2': 'ELC180.AT2'}
    """
    # For what is around a direction: name of the file, kind of the code, angle [degrees].
    frames: dict[tuple[str, str], list[tuple[str, int, float]]] = {}
    for name in sorted(names):
        for code in _CODE.finditer(name):
            word = ("H" if code["sensor"] else "") + code[0].upper()
            azimuth = float(word) if word.isdecimal() else quadrant(word)
            plain = None if azimuth is None or azimuth > 360.0 else (name, 0, azimuth)
            kinds = ((name, kind, each[word]) for kind, each in enumerate(_ANGLES) if word in each)
            if direction := next(kinds, plain):
                frames.setdefault(_frame(name, code), []).append(direction)
    known = {name.lower(): name for name in names}
    pairs: dict[str, set[str]] = {}
    verticals: dict[str, str] = {}
    for (before, after), members in frames.items():
        paired = len(members) == 2 and members[0][1] == members[1][1]
        paired = paired and (members[0][2] - members[1][2]) % 180.0 == 90.0
        for (one, *_), (other, *_) in (members, members[::-1]) if paired else ():
            pairs.setdefault(one, set()).add(other)
        vertical = [known[n] for code in _VERTICALS if (n := f"{before}{code}{after}") in known]
        if len(vertical) == 1 and (paired or len(members) == 1):
            verticals |= {name: vertical[0] for name, *_ in members if name != vertical[0]}
    single = {one: next(iter(others)) for one, others in pairs.items() if len(others) == 1}
    return {one: other for one, other in single.items() if single.get(other) == one}, verticals


def vertical_files(paths: Sequence[Path]) -> set[Path]:
    """Files that by their names are the vertical component of another one among them."""
    found = set()
    for folder in {path.parent for path in paths}:
        names = [path.name for path in paths if path.parent == folder]
        found |= {folder / name for name in partners(names)[1].values()}
    return found


def folder_names(folder: Path) -> list[str]:
    """Names of the files of a folder; none if it cannot be read."""
    try:
        return sorted(entry.name for entry in os.scandir(folder) if entry.is_file())
    except OSError:
        return []


def other_horizontal(motion: Motion, motions: Sequence[Motion]) -> Motion | None:
    """The other horizontal component of an instrument, of those of one file."""
    others = [other for other in motions if other is not motion]
    family, *families = (str(one.metadata.get("trace") or one.metadata.get("component", ""))[:-1]
                         for one in (motion, *others))  # fmt: skip
    found = [other for other, its in zip(others, families) if its == family] or others
    return found[0] if len(found) == 1 else None


def _frame(name: str, code: re.Match[str]) -> tuple[str, str]:
    """What is around a direction in the name of a file."""
    return name[: code.start()].lower(), name[code.end() :].lower()


def belong_together(one: Motion, other: Motion) -> bool:
    """Whether more than their names shows that two files are components of one record.

    Equal starts, or an equal event and station do. Equal numbers of samples do, unless the names
    differ in numbers that need not be azimuths, such as 10 and 100.
    """
    own, its = one.metadata, other.metadata
    starts = [seconds(about.get("start_time")) for about in (own, its)]
    if not np.isnan(starts).any():
        return abs(starts[0] - starts[1]) <= max(one.duration, other.duration)
    sites = [tuple(str(about.get(key) or "").casefold() for key in ("event", "station"))
             for about in (own, its)]  # fmt: skip
    if all(sites[0]) and sites[0] == sites[1]:
        return True
    equal = one.acceleration.size == other.acceleration.size
    return equal and not numbered(own["file"], its["file"])


def numbered(one: str, other: str) -> bool:
    """Whether two names differ in numbers that need not be azimuths, as 10 and 100 do."""
    codes = ((a, b) for a in _CODE.finditer(one) for b in _CODE.finditer(other)
             if _frame(one, a) == _frame(other, b))  # fmt: skip
    return any(a[0].isdecimal() and b[0].isdecimal() and not a["sensor"]
               and not len(a[0]) == len(b[0]) == 3 for a, b in codes)  # fmt: skip


def seconds(time: Any) -> float:
    """Seconds of a time of UTC in ISO's form; nan if it is not known."""
    try:
        found = datetime.fromisoformat(str(time))
    except ValueError:
        return float("nan")
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def joined(motion: Motion, other: Motion, kind: str) -> Motion:
    """Join a motion with its vertical or transverse, cut to the time of both, or RecordError."""
    own, its, code = motion.metadata, other.metadata, other.metadata.get("component", "")
    its_name, one_file = its.get("file") or other.id, own.get("file") == its.get("file")
    if kind == "vertical":
        keys = ("component", "trace") if one_file else ("component", "trace", "file")
        labels = {f"vertical_{key}": its.get(key, "") for key in keys}
    else:
        known = (key for key in ("component", "azimuth", "trace", "file")
                 if its.get(key) not in (None, ""))  # fmt: skip
        labels = {f"{key}_transverse": its[key] for key in known} | {"id_transverse": other.id}
    name = f"{motion.id} and {its_name} ({code})"
    for fact in () if one_file else ("event", "date", "station"):
        one, two = str(own.get(fact) or ""), str(its.get(fact) or "")
        if one and two and one.casefold() != two.casefold():
            raise RecordError(f"{name}: do not belong together, {fact} is {one!r} and {two!r}")
    if not np.isclose(motion.dt, other.dt, rtol=1e-6, atol=0.0):
        raise RecordError(f"{name}: time steps {motion.dt:g} s and {other.dt:g} s must be equal")
    start, its_start = (seconds(about.get("start_time")) for about in (own, its))
    later = 0 if np.isnan([start, its_start]).any() else round((its_start - start) / motion.dt)
    first, its_first = max(0, later), max(0, -later)
    count = min(motion.acceleration.size - first, other.acceleration.size - its_first)
    if count < 2:
        raise RecordError(f"{name}: have no time in common")
    word = "Vertical" if kind == "vertical" else "Other horizontal"
    its_log = other.log[1:] if one_file else other.log
    steps = (s if s in its.get("accepted", ()) else f"{word} {code}: {s}" for s in its_log)
    log = (*motion.log, *steps)
    if count < max(motion.acceleration.size, other.acceleration.size):
        log = (*log, f"Cut to the {count} samples in common with {its_name} ({code}).")
    arrays = {part: None if samples is None else samples[first : first + count]
              for part, samples in motion.components.items()}  # fmt: skip
    arrays[kind] = other.acceleration[its_first : its_first + count]
    for found in ("errors", "cautions", "accepted"):
        if both := [*own.get(found, ()), *its.get(found, ())]:
            labels[found] = list(dict.fromkeys(both))
    return motion._replaced(**arrays, metadata={**own, **labels}, log=log)
