"""Which components belong together, and which directions they have: by names, headers, starts."""

import os
import re
from collections.abc import Sequence
from datetime import datetime
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
                frame = name[: code.start()].lower(), name[code.end() :].lower()
                frames.setdefault(frame, []).append(direction)
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


def joined(motion: Motion, other: Motion, kind: str) -> Motion:
    """Join a motion with its vertical or transverse, cut to the time of both, or RecordError."""
    own, its, code = motion.metadata, other.metadata, other.metadata.get("component", "")
    its_name, one_file = its.get("file") or other.id, own.get("file") == its.get("file")
    if kind == "vertical":
        keys = ("component", "trace") if one_file else ("component", "trace", "file")
        labels = {f"vertical_{key}": its.get(key, "") for key in keys}
    else:
        known = (key for key in ("component", "azimuth", "trace", "file") if its.get(key))
        labels = {f"{key}_transverse": its[key] for key in known} | {"id_transverse": other.id}
    name = f"{motion.id} and {its_name} ({code})"
    for fact in () if one_file else ("event", "date", "station"):
        one, two = str(own.get(fact) or ""), str(its.get(fact) or "")
        if one and two and one.casefold() != two.casefold():
            raise RecordError(f"{name}: do not belong together, {fact} is {one!r} and {two!r}")
    if not np.isclose(motion.dt, other.dt, rtol=1e-6, atol=0.0):
        raise RecordError(f"{name}: time steps {motion.dt:g} s and {other.dt:g} s must be equal")
    starts = [datetime.fromisoformat(str(about["start_time"])).timestamp()
              for about in (own, its) if about.get("start_time")]  # fmt: skip
    later = round((starts[1] - starts[0]) / motion.dt) if len(starts) == 2 else 0
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
    for found in ("errors", "accepted"):
        if both := [*own.get(found, ()), *its.get(found, ())]:
            labels[found] = list(dict.fromkeys(both))
    return motion._replaced(**arrays, metadata={**own, **labels}, log=log)
