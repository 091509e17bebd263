"""Which files are components of one record, and which records are of one earthquake."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.files import Named
from archfrag.motions.channel import AZIMUTHS, azimuth_of, quadrant
from archfrag.motions.motion import REVERSED, Motion, seconds

# Matches a direction in a name: it is at the end of a word, and no small letter within one.
_CODE = re.compile(
    r"(?<![A-Za-z\d])[Hh][12](?![A-Za-z\d])"
    r"|(?<=(?<![A-Za-z\d])[A-Z][GHLN])(?P<sensor>[12])(?![A-Za-z\d])"  # HN1
    r"|[NS]\d{1,2}(?:\.\d+)?[EW](?![A-Za-z\d])"
    r"|(?:EW|WE|NS|[ENSWXYRTL]|(?<![A-Za-z])(?:ew|we|ns|[enswxyrtl]))(?=\d?(?![A-Za-z\d]))"
    r"|\d{3}(?!\d)|(?<!\d)\d{1,2}(?!\d)"
)
_ANGLES = (
    AZIMUTHS,
    {"X": 0.0, "Y": 90.0},
    {"R": 0.0, "L": 0.0, "T": 90.0},
    {"H1": 0.0, "H2": 90.0},
)
APART = 60.0  # [s] between origin times, or starts of records, of one earthquake
_VERTICALS = [
    sign + code
    for sign in ("", "-", "+")
    for code in ("u", "v", "z", "ud", "up", "dwn", "down", "vert", "vertical")
]


def partners(names: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the other horizontal of each file, and the vertical of each, by names of files.

    `names` are those of one folder. Two files are a pair of horizontals if their names are equal
    but for a direction, the directions are at right angles, and there is no third such name:
    numbered files are no components. Their vertical has the same name with ``UP``, ``Z`` or the
    like instead of the direction. Files without a partner are in neither mapping.

    >>> partners(["ELC180.AT2", "ELC270.AT2", "quake1.txt", "quake2.txt", "ELC-UP.AT2"])[0]
    {'ELC180.AT2': 'ELC270.AT2', 'ELC270.AT2': 'ELC180.AT2'}
    """
    # For what is around a direction: name of the file, kind of the code, angle [degrees].
    frames: dict[tuple[str, str], list[tuple[str, int, float]]] = {}
    for name in sorted(names):
        for code in _CODE.finditer(name):
            word = ("H" if code["sensor"] else "") + code[0].upper()
            azimuth = float(word) if word.isdecimal() else quadrant(word)
            plain = None if (azimuth or 0.0) > 360.0 else azimuth
            kinds = (
                (i, angle[word]) for i, angle in enumerate(_ANGLES) if word in angle
            )
            kind, direction = next(kinds, (0, plain))
            if direction is not None:
                members = frames.setdefault(_frame(name, code), [])
                members.append((name, kind, direction))
    by_lower_case = {name.lower(): name for name in names}
    pairs: dict[str, set[str]] = {}
    verticals: dict[str, str] = {}
    for (before, after), members in frames.items():
        paired = len(members) == 2 and members[0][1] == members[1][1]
        paired = paired and (members[0][2] - members[1][2]) % 180.0 == 90.0
        for (one, *_), (other, *_) in (members, members[::-1]) if paired else ():
            pairs.setdefault(one, set()).add(other)
        paths = (f"{before}{code}{after}" for code in _VERTICALS)
        vertical = [by_lower_case[path] for path in paths if path in by_lower_case]
        if len(vertical) == 1 and (paired or len(members) == 1):
            verticals |= {
                name: vertical[0] for name, *_ in members if name != vertical[0]
            }
    mutual = {
        one: other
        for one, others in pairs.items()
        for other in others
        if len(others) == len(pairs[other]) == 1
    }
    return mutual, verticals


def vertical_files(paths: Sequence[Path]) -> set[Path]:
    """Return those of `paths` whose names make them the vertical of another one."""
    folders: dict[Path, list[str]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path.name)
    return {
        folder / name
        for folder, names in folders.items()
        for name in partners(names)[1].values()
    }


def folder_names(folder: Path) -> list[str]:
    """Return the names of the files of a folder; none if it cannot be read."""
    try:
        return sorted(entry.name for entry in os.scandir(folder) if entry.is_file())
    except OSError:
        return []


def other_horizontal(motion: Motion, motions: Sequence[Motion]) -> Motion | None:
    """Return the other horizontal of the same instrument; None if it is not clear which it is.

    `motions` are the horizontals of a file, `motion` among them. If no other one is of this
    instrument, they may be of any.
    """
    others = [other for other in motions if other is not motion]
    family = _family(motion)
    alike = [other for other in others if _family(other) == family] or others
    return alike[0] if len(alike) == 1 else None


def _family(motion: Motion) -> str:
    """Return the code of a component without its last letter, the direction."""
    return (motion.facts.trace or motion.facts.component)[:-1]


def _frame(name: str, code: re.Match[str]) -> tuple[str, str]:
    """Return the text before and after a direction in the name of a file, in lower case."""
    return name[: code.start()].lower(), name[code.end() :].lower()


def belong_together(one: Motion, other: Motion) -> bool:
    """Tell whether two files, whose names suggest it, are components of one record.

    If both starts are known, these decide: they may differ by the longer duration at most. If not,
    an equal event and station are enough, or else equal numbers of samples, unless the names
    differ in numbers that need not be azimuths, such as 10 and 100.
    """
    both = one.facts, other.facts
    late = abs(seconds(both[0].start_time) - seconds(both[1].start_time))
    if not np.isnan(late):
        return late <= max(one.duration, other.duration)
    sites = [(facts.event.casefold(), facts.station.casefold()) for facts in both]
    if all(sites[0]) and sites[0] == sites[1]:
        return True
    equal = one.acceleration.size == other.acceleration.size
    return equal and not numbered(both[0].file, both[1].file)


def identity_of(motion: Motion) -> Named:
    """Return the facts by which `are_one` recognises copies and versions of one component."""
    facts = motion.facts
    start = seconds(facts.start_time)
    azimuth = azimuth_of(facts.azimuth, facts.component)
    location = [*facts.trace.split("."), "", "", ""][2]
    direction = facts.component if azimuth is None else azimuth % 360.0
    station = facts.station.casefold()
    return {
        "id": motion.id,
        "samples": hash((motion.dt, motion.acceleration.tobytes())),
        "place": (station, location, direction) if station else None,
        "event": facts.event,
        "level": facts.level,
        "start": start,
        "end": start + motion.duration,
    }


def are_one(one: Named, other: Named) -> bool:
    """Tell whether two motions are copies or versions (raw, processed) of one component.

    `one` and `other` are results of `identity_of`. Motions with equal samples are one component.
    If not, their station, instrument and direction must be equal, and they must overlap in time;
    if a start is not known, one must be raw, the other processed, and both of the same event.
    """
    if one["samples"] == other["samples"]:
        return True
    if one["place"] is None or one["place"] != other["place"]:
        return False
    if np.isnan(one["start"]) or np.isnan(other["start"]):
        levels = {one["level"], other["level"]} == {"raw", "processed"}
        return levels and bool(one["event"]) and one["event"] == other["event"]
    return bool(one["start"] < other["end"] and other["start"] < one["end"])


def numbered(one: str, other: str) -> bool:
    """Tell whether two names differ in numbers that need not be azimuths, as 10 and 100 do."""
    return any(
        _frame(one, a) == _frame(other, b)
        and a[0].isdecimal()
        and b[0].isdecimal()
        and not a["sensor"]
        and not len(a[0]) == len(b[0]) == 3
        for a in _CODE.finditer(one)
        for b in _CODE.finditer(other)
    )


def earthquakes(records: Sequence[Any]) -> list[str]:
    """Return the name of the earthquake of each record; empty if it is neither stated nor shared.

    A record has an `id`, a `duration` [s] and facts as attributes. An event in a header or an
    index counts first. Without one, records share an earthquake if they are of one file, or if
    their origin times or starts are at most a minute apart, or if they overlap in time.
    """
    group = np.arange(len(records))
    origins = np.array([seconds(record.origin_time) for record in records])
    starts = np.array([seconds(record.start_time) for record in records])
    ends = starts + [record.duration for record in records]

    def join(members) -> None:
        group[np.isin(group, group[members])] = group[members].min()

    def names(members) -> list[str]:
        return list(dict.fromkeys(filter(None, (records[i].event for i in members))))

    by_file: dict[str, list[int]] = {}
    for i, record in enumerate(records):
        for file in (record.file_sha256, record.source_sha256, record.pair):
            by_file.setdefault(file, []).append(i)
    by_file.pop("", None)
    for of_one in by_file.values():
        join(of_one)
    for first, last in ((origins, origins), (starts, ends)):
        known = np.count_nonzero(~np.isnan(first))
        order = np.argsort(first, kind="stable")[:known]  # nan last
        until = np.maximum.accumulate(np.fmax(last[order], first[order] + APART))
        for near in np.split(order, np.flatnonzero(first[order[1:]] > until[:-1]) + 1):
            # Where several events are named, the times are not those of earthquakes.
            if near.size and len(names(near)) < 2:
                join(near)
    events = []
    for number, record in zip(group, records):
        members = np.flatnonzero(group == number)
        id = records[members[0]].id.removesuffix(REVERSED)
        name = f"earthquake of {id}" if members.size > 1 else ""
        events.append(record.event or next(iter(names(members)), name))
    return events
