"""One channel of a record: its unit and direction, what its file states, what reading finds.

A `Channel` stands on an obspy Trace, which holds the samples, as ``stats.record``.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from archfrag.errors import RecordError

Trace = Any  # obspy's, whose import takes time
Acceptable = Literal["pga", "time_step", "samples", "header", "sensor"]
Warned = tuple[Acceptable | None, str]  # None: nothing makes it acceptable

STANDARD_GRAVITY = 9.80665  # [m/s2]
METRES_PER_SECOND_SQUARED = {
    "m/s2": 1.0,
    "cm/s2": 1e-2,
    "gal": 1e-2,
    "mm/s2": 1e-3,
    "g": STANDARD_GRAVITY,
}

VERTICAL = re.compile(
    r"[-+]?(U|V|Z|UD\d?|UP|DWN|DOWN|VERT|VERTICAL|..Z)", re.IGNORECASE
)
HORIZONTAL = re.compile(
    r"[-+]?((EW|NS)\d?|[ENXYRTHL]\d?|[NS]\d+(\.\d+)?[EW]|\d{1,3}|..[ENXYRT12])",
    re.IGNORECASE,
)
AZIMUTHS = {
    "N": 0.0,
    "NORTH": 0.0,
    "NS": 0.0,
    "E": 90.0,
    "EAST": 90.0,
    "EW": 90.0,
    "WE": 90.0,
    "S": 180.0,
    "SOUTH": 180.0,
    "W": 270.0,
    "WEST": 270.0,
}
_QUADRANT = re.compile(r"([NS])(\d+(?:\.\d+)?)([EW])")
_SEED = re.compile(r"[A-Z]{2}[A-Z\d]")
_SKEWED = 5.0  # [degrees] by which two components may be off a right angle
# What a motion's metadata take over from the header.
_HEADER = (
    "event",
    "date",
    "station",
    "magnitude",
    "vs30_mps",
    "epicentral_km",
    "azimuth",
    "level",
    "origin_time",
)


@dataclass
class Channel:
    """What the file states of a channel (empty or None: nothing), and what reading it found."""

    code: str = ""  # name of the component, such as HNE, 090 or UP
    vertical: bool | None = None
    downwards: bool | None = None  # of a vertical: positive samples are downwards
    azimuth: float | None = None  # [degrees] of a horizontal
    sensor: str = ""  # where it is, unless on the ground
    place: str = ""  # what its header says of it
    depth: float | None = None  # [m] below the ground
    number: str = ""  # of the channel in its file
    event: str = ""
    date: str = ""
    station: str = ""
    magnitude: float | None = None
    epicentral_km: float | None = None
    vs30_mps: float | None = None
    origin_time: str = ""
    level: str = ""  # raw or processed
    unit: str = ""  # of the samples in the file, or counts
    g_per_count: float | None = None
    announced: int = 0  # number of samples
    contradicted: str = (
        ""  # how a stated peak or length differs from that of the samples
    )

    held: int = 0  # number of samples in the file
    unit_in_file: str = (
        ""  # from which the samples were converted; empty: they are as in the file
    )
    accept: tuple[Acceptable, ...] = ()
    accepted: tuple[str, ...] = ()
    log: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)  # of obspy's reader
    warnings: list[Warned] = field(default_factory=list)  # refused unless accepted
    errors: list[str] = field(
        default_factory=list
    )  # contradictions, which refuse nothing
    cautions: list[str] = field(default_factory=list)

    @property
    def is_vertical(self) -> bool:
        """Tell whether the channel is vertical, by its header or else its code."""
        return (
            bool(VERTICAL.fullmatch(self.code))
            if self.vertical is None
            else self.vertical
        )

    @property
    def is_horizontal(self) -> bool:
        """Tell whether the channel is known to be horizontal, by its header or else its code."""
        by_code = HORIZONTAL.fullmatch(self.code) is not None
        return by_code if self.vertical is None else not self.vertical

    @property
    def facts(self) -> dict[str, Any]:
        """Return the facts of the header that a motion's metadata take over."""
        return filled({key: getattr(self, key) for key in _HEADER})


def filled(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts that are neither empty nor None."""
    return {key: fact for key, fact in facts.items() if fact not in (None, "")}


def wrong_length(stated: float | None, count: int, dt: float) -> str:
    """Return how a length [s] contradicts a number of samples and their step; empty if not."""
    length = (count - 1) * dt
    if (
        not stated
        or not stated > 0.0
        or abs(stated - length) <= max(0.02 * length, 1.0)
    ):
        return ""
    text = (
        f"the header states a length of {stated:g} s, {count} samples at {dt:g} s last"
    )
    return f"{text} {length:g} s"


def unit_factor(unit: str, place: str) -> float:
    """Return the factor from a unit of acceleration to m/s2."""
    if unit not in METRES_PER_SECOND_SQUARED:
        allowed = f"allowed are {', '.join(METRES_PER_SECOND_SQUARED)}"
        raise RecordError(f"{place}: unknown unit {unit!r} of acceleration; {allowed}")
    return METRES_PER_SECOND_SQUARED[unit]


def instrument(trace: Trace) -> str:
    """Return the key that channels of one instrument share."""
    stats = trace.stats
    code = trace.stats.record.code
    if stats._format == "KNET":
        return f"{stats.station}.{code[2:]}"
    family = (
        code[:-1] if len(code) == 3 and code.isalnum() and not code.isdigit() else ""
    )
    return f"{stats.network}.{stats.station}.{stats.location}.{family}"


def split_by_direction(
    traces: Sequence[Trace], place: object, surely: bool = True
) -> tuple[list[Trace], list[Trace]]:
    """Return the horizontal and the vertical traces of a record.

    RecordError if all are vertical, or if it is not `surely` known that the others are horizontal.
    """
    verticals = [trace for trace in traces if trace.stats.record.is_vertical]
    others = [trace for trace in traces if not trace.stats.record.is_vertical]
    if not others:
        raise RecordError(
            f"{place}: holds only the vertical component; a horizontal is needed"
        )
    sure = all(trace.stats.record.is_horizontal for trace in others)
    if surely and len(traces) > 1 and not sure:
        names = ", ".join(repr(trace.stats.record.code) for trace in traces)
        remedy = "name them as SEED does (HNE, HNN, HNZ), or read one by `component` (--component)"
        raise RecordError(
            f"{place}: the codes {names} do not tell what is horizontal; {remedy}"
        )
    return others, verticals


def choose_horizontal(
    traces: Sequence[Trace],
    place: object,
    component: str | None,
    listed: str | None = None,
) -> tuple[Trace, list[Trace]]:
    """Return the horizontal trace to use, its log saying why, and the vertical traces.

    `component` is a channel code, its last letter or a trace id. An index may have `listed` one,
    which counts where there are several.
    """
    horizontals, verticals = split_by_direction(
        traces, place, not (component or listed)
    )
    codes = [trace.stats.record.code for trace in horizontals]
    first = horizontals[0]
    names = ", ".join(code or "(no code)" for code in codes)
    if len(horizontals) == 1 and listed and _may_be(first.stats.record, listed):
        listed = None
    if component := component or listed:
        spellings = (
            [trace.id for trace in horizontals] + codes + [code[-1:] for code in codes]
        )
        upper = [spelling.upper() for spelling in spellings]
        if component.upper() not in upper:
            raise RecordError(
                f"{place}: no horizontal component {component!r}; there is {names}"
            )
        return horizontals[upper.index(component.upper()) % len(horizontals)], verticals
    channel = first.stats.record
    if len(horizontals) > 1:
        channel.log.insert(0, f"Horizontal {codes[0]} taken, the first of {names}.")
    elif not channel.is_horizontal:
        channel.log.insert(
            0, f"Channel {codes[0]!r} taken to be horizontal: the only one."
        )
    return first, verticals


def _may_be(channel: Channel, listed: str) -> bool:
    """Tell whether an index may mean the only horizontal of a file by a component's name."""
    azimuth = (
        azimuth_of_code(channel.code) if channel.azimuth is None else channel.azimuth
    )
    named = azimuth_of_code(listed)
    if azimuth is not None and named is not None:
        return turned_by(azimuth, named) <= _SKEWED
    codes = all(_SEED.fullmatch(code.upper()) for code in (channel.code, listed))
    return not channel.code or (HORIZONTAL.fullmatch(listed) is not None and not codes)


def quadrant(text: str) -> float | None:
    """Return the azimuth of a bearing such as S16W [degrees from north]; None for other text."""
    if (bearing := _QUADRANT.fullmatch(text.upper())) is None:
        return None
    angle = float(bearing[2]) if bearing[1] == "N" else 180.0 - float(bearing[2])
    return (angle if bearing[3] == "E" else -angle) % 360.0


def azimuth_of_code(code: str) -> float | None:
    """Return the azimuth [degrees] of a name (``N``, ``EW1``, ``HNE``, ``180``), else None."""
    text = code.strip().upper().lstrip("-+")
    if (bearing := quadrant(text)) is not None:
        return bearing
    if re.fullmatch(r"\d{2,3}", text):
        return float(text) % 360.0
    return AZIMUTHS.get(re.sub(r"^[A-Z][A-Z](?=[NE]$)|\d$", "", text))


def turned_by(one: float, other: float) -> float:
    """Return the angle between two azimuths, 0 to 180 degrees."""
    return abs((one - other + 180.0) % 360.0 - 180.0)


def azimuth_of(metadata: Mapping[str, Any], which: str = "") -> float | None:
    """Return the azimuth of a motion's component, or of its ``_transverse``; None if unknown."""
    stated = metadata.get(f"azimuth{which}")
    if stated in (None, ""):
        return azimuth_of_code(str(metadata.get(f"component{which}", "")))
    return float(stated)


def check_right_angle(metadata: Mapping[str, Any], what: str, remedy: str) -> None:
    """Raise RecordError if the azimuths of two components are known and not at right angles."""
    one = azimuth_of(metadata)
    other = azimuth_of(metadata, "_transverse")
    if (
        one is not None
        and other is not None
        and abs(turned_by(one, other) - 90.0) > _SKEWED
    ):
        angle = f"azimuths {one:g} and {other:g} degrees, not at right angles"
        raise RecordError(f"{what}: the components have {angle}{remedy}")
