"""Which components belong together, and which directions they have: by names, headers, starts."""

import os
import re
from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache
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
_LONGEST_CODE = 5
_COMMON = ("event", "date", "station")
_Frame = tuple[str, str]


def quadrant(text: str) -> float | None:
    """Azimuth of a bearing such as S16W [degrees clockwise from north], None if it is none."""
    found = _QUADRANT.fullmatch(text)
    if found is None:
        return None
    origin, angle, towards = found.group(1).upper(), float(found.group(2)), found.group(3).upper()
    angle = angle if origin == "N" else 180.0 - angle
    return (angle if towards == "E" else -angle) % 360.0


def sibling(path: Path, names: Sequence[str], vertical: bool) -> Path | None:
    """File of the vertical component, or of the other horizontal one, that belongs to a record.

    Parameters
    ----------
    path : Path
        Of a horizontal component.
    names : sequence of str
        Files of its folder.
    vertical : bool
        Which of the two is wanted.

    Returns
    -------
    Path or None
        The file whose name differs from that of `path` in the code of the component only, in the
        smallest number of characters. None if there is none.

    Examples
    --------
    >>> from pathlib import Path
    >>> from archfrag.motions.partners import sibling
    >>> str(sibling(Path("ELC180.AT2"), ["ELC180.AT2", "ELC-UP.AT2", "TAF-UP.AT2"], True))
    'ELC-UP.AT2'
    """
    table = _by_frame(tuple(names), VERTICAL if vertical else HORIZONTAL)
    for frame in _frames(path.name, HORIZONTAL):
        found = [name for name in table.get(frame, ()) if name != path.name]
        if found:
            return path.with_name(found[0])
    return None


def vertical_files(paths: Sequence[Path]) -> set[Path]:
    """Files that by their names are the vertical component of another one among them."""
    folders: dict[Path, list[str]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path.name)
    found: set[Path] = set()
    for folder, names in folders.items():
        verticals, horizontals = (_by_frame(tuple(names), c) for c in (VERTICAL, HORIZONTAL))
        for frame in verticals.keys() & horizontals.keys():
            found.update(folder / name for name in verticals[frame])
    return found


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
    keys = ("component", "azimuth", "trace", "file")
    found = {f"{key}_across": other.metadata[key] for key in keys if other.metadata.get(key)}
    return joined._replaced(metadata={**joined.metadata, **found})


def other_horizontal(motion: Motion, motions: Sequence[Motion]) -> Motion | None:
    """The other horizontal component of an instrument, of those of one file."""
    others = [other for other in motions if other is not motion]
    alike = [other for other in others if _family(other) == _family(motion)]
    found = alike or others
    return found[0] if len(found) == 1 else None


def _family(motion: Motion) -> str:
    return str(motion.metadata.get("trace") or motion.metadata.get("component", ""))[:-1]


@lru_cache(maxsize=8192)
def _frames(name: str, code: re.Pattern[str]) -> list[_Frame]:
    """What stands before and after a code of a component, the shortest codes first."""
    return [
        (name[:start].lower(), name[start + length :].lower())
        for length in range(1, min(_LONGEST_CODE, len(name)) + 1)
        for start in range(len(name) - length, -1, -1)
        if code.fullmatch(name, start, start + length)
    ]


@lru_cache(maxsize=32)
def _by_frame(names: tuple[str, ...], code: re.Pattern[str]) -> dict[_Frame, list[str]]:
    table: dict[_Frame, list[str]] = {}
    for name in sorted(names):
        for frame in _frames(name, code):
            table.setdefault(frame, []).append(name)
    return table


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
