"""Which components belong together, and which directions they have: by names, headers, starts."""

import os
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from archfrag.errors import RecordError
from archfrag.motions.motion import Motion

VERTICAL = re.compile(r"[-+]?(U|V|Z|UD\d?|UP|DWN|DOWN|VERT|VERTICAL|..Z)", re.IGNORECASE)
HORIZONTAL = re.compile(
    r"[-+]?((EW|NS)\d?|[ENXYRTHL]\d?|[NS]\d+(\.\d+)?[EW]|\d{1,3}|..[ENXYRT12])", re.IGNORECASE
)
AZIMUTHS = {"N": 0.0, "NORTH": 0.0, "NS": 0.0, "E": 90.0, "EAST": 90.0, "EW": 90.0, "WE": 90.0,
            "S": 180.0, "SOUTH": 180.0, "W": 270.0, "WEST": 270.0}  # fmt: skip
_QUADRANT = re.compile(r"([NS])(\d+(?:\.\d+)?)([EW])", re.IGNORECASE)
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
_UPWARD = [
    sign + code
    for sign in ("", "-", "+")
    for code in ("u", "v", "z", "ud", "up", "dwn", "down", "vert", "vertical")
]
_COMMON = ("event", "date", "station")
_Direction = tuple[str, int, float]  # name of the file, kind of the code, angle [degrees]


def quadrant(text: str) -> float | None:
    """Azimuth of a bearing such as S16W [degrees clockwise from north], None if it is none."""
    found = _QUADRANT.fullmatch(text)
    if found is None:
        return None
    origin, angle, towards = found.group(1).upper(), float(found.group(2)), found.group(3).upper()
    angle = angle if origin == "N" else 180.0 - angle
    return (angle if towards == "E" else -angle) % 360.0


def partners(names: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Files of a folder that by their names hold components of one record.

    Two names that are equal but for a direction are a pair if these are at right angles and there
    is no third such name: numbered files are no components. Their vertical is of the same name
    with ``UP``, ``Z`` or the like in the place of the direction.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    dict
        Name of the other horizontal component by that of each; they are mutual.
    dict
        Name of the vertical component by that of each horizontal one.

    Examples
    --------
    >>> from archfrag.motions.partners import partners
    >>> pairs, verticals = partners(["ELC180.AT2", "ELC270.AT2", "ELC-UP.AT2"])
    >>> pairs["ELC180.AT2"], verticals["ELC180.AT2"]
    ('ELC270.AT2', 'ELC-UP.AT2')
    >>> partners(["quake1.txt", "quake2.txt"])
    ({}, {})
    """
    frames: dict[tuple[str, str], list[_Direction]] = {}
    for name in sorted(names):
        for code in _CODE.finditer(name):
            direction = _direction(("H" if code["sensor"] else "") + code[0].upper())
            if direction is not None:
                frame = name[: code.start()].lower(), name[code.end() :].lower()
                frames.setdefault(frame, []).append((name, *direction))
    known = {name.lower(): name for name in names}
    pairs: dict[str, set[str]] = {}
    verticals: dict[str, str] = {}
    for (before, after), members in frames.items():
        paired = len(members) == 2 and _at_right_angles(*members)
        for (one, *_), (other, *_) in (members, members[::-1]) if paired else ():
            pairs.setdefault(one, set()).add(other)
        upward = [known[n] for up in _UPWARD if (n := f"{before}{up}{after}") in known]
        if len(upward) == 1 and (paired or len(members) == 1):
            verticals |= {name: upward[0] for name, *_ in members if name != upward[0]}
    single = {one: next(iter(others)) for one, others in pairs.items() if len(others) == 1}
    return {one: other for one, other in single.items() if single.get(other) == one}, verticals


def _direction(code: str) -> tuple[int, float] | None:
    """Kind of a code and its angle to others of the kind [degrees]; None if it is no direction."""
    for kind, angles in enumerate(_ANGLES):
        if code in angles:
            return kind, angles[code]
    azimuth = float(code) if code.isdecimal() else quadrant(code)
    return None if azimuth is None or azimuth > 360.0 else (0, azimuth)


def _at_right_angles(one: _Direction, other: _Direction) -> bool:
    return one[1] == other[1] and (one[2] - other[2]) % 180.0 == 90.0


def vertical_files(paths: Sequence[Path]) -> set[Path]:
    """Files that by their names are the vertical component of another one among them."""
    folders: dict[Path, list[str]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path.name)
    return {
        folder / name for folder, names in folders.items() for name in partners(names)[1].values()
    }


def with_vertical(motion: Motion, upward: Motion) -> Motion:
    """A motion with its vertical component from another file, cut to the time of both.

    Parameters
    ----------
    motion, upward : Motion
        The latter with its vertical component in the place of the horizontal one.

    Raises
    ------
    RecordError
        If headers state different stations or events, time steps differ, or they have no time in
        common.
    """
    joined = _joined(motion, upward, "vertical")
    code = upward.metadata.get("component", "")
    labels = {"vertical_component": code, "vertical_file": upward.metadata.get("file", ""),
              "vertical_trace": upward.metadata.get("trace", "")}  # fmt: skip
    log = (*joined.log, *(f"Vertical {code}: {step}" for step in upward.log))
    return joined._replaced(metadata={**joined.metadata, **labels}, log=log)


def with_across(motion: Motion, other: Motion) -> Motion:
    """A motion with the other horizontal component; parameters and errors as `with_vertical`."""
    joined = _joined(motion, other, "across")
    code = other.metadata.get("component", "")
    keys = ("component", "azimuth", "trace", "file")
    found = {f"{key}_across": other.metadata[key] for key in keys if other.metadata.get(key)}
    log = (*joined.log, *(f"Other horizontal {code}: {step}" for step in other.log))
    return joined._replaced(metadata={**joined.metadata, **found}, log=log)


def other_horizontal(motion: Motion, motions: Sequence[Motion]) -> Motion | None:
    """The other horizontal component of an instrument, of those of one file."""
    others = [other for other in motions if other is not motion]
    alike = [other for other in others if _family(other) == _family(motion)]
    found = alike or others
    return found[0] if len(found) == 1 else None


def _family(motion: Motion) -> str:
    return str(motion.metadata.get("trace") or motion.metadata.get("component", ""))[:-1]


def folder_names(folder: Path) -> list[str]:
    """Names of the files of a folder; none if it cannot be read."""
    try:
        return sorted(entry.name for entry in os.scandir(folder) if entry.is_file())
    except OSError:
        return []


def common_span(
    name: str, steps: tuple[float, float], later: int, sizes: tuple[int, int]
) -> tuple[slice, slice, int]:
    """Samples that two rows have in common, of which the second begins that much later."""
    if not np.isclose(*steps, rtol=1e-6, atol=0.0):
        raise RecordError(f"{name}: time steps {steps[0]:g} s and {steps[1]:g} s must be equal")
    first, its_first = max(0, later), max(0, -later)
    count = min(sizes[0] - first, sizes[1] - its_first)
    if count < 2:
        raise RecordError(f"{name}: have no time in common")
    return slice(first, first + count), slice(its_first, its_first + count), count


def _joined(motion: Motion, other: Motion, key: str) -> Motion:
    own, its = motion.metadata, other.metadata
    its_name = its.get("file") or other.id
    name = f"{motion.id} and {its_name}"
    for fact in _COMMON:
        one, two = str(own.get(fact) or ""), str(its.get(fact) or "")
        if one and two and one.casefold() != two.casefold():
            raise RecordError(
                f"{name}: do not belong together, {fact} is {one!r} of the one and {two!r} of "
                "the other"
            )
    timed = own.get("start_time") and its.get("start_time")
    later = round((_start(other) - _start(motion)) / motion.dt) if timed else 0
    sizes = motion.acceleration.size, other.acceleration.size
    kept, its_kept, count = common_span(name, (motion.dt, other.dt), later, sizes)
    log = motion.log
    if count < max(sizes):
        log = (*log, f"Cut to the {count} samples in common with {its_name}.")
    arrays = {
        part: samples if samples is None else samples[kept]
        for part, samples in motion.components.items()
    }
    return motion._replaced(**(arrays | {key: other.acceleration[its_kept]}), log=log)


def _start(motion: Motion) -> float:
    return datetime.fromisoformat(str(motion.metadata["start_time"])).timestamp()
