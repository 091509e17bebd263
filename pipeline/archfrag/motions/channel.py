"""One channel of a record: its unit and direction, what its file states, what reading finds.

`Facts` are what a motion knows of its record. A `Channel` is read from a file. It is the attribute
``stats.record`` of an obspy Trace, which holds the samples.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import RecordError
from archfrag.files import Named

Samples = NDArray[np.float64]
Trace = Any  # obspy's, whose import takes time
Acceptable = Literal["pga", "time_step", "samples", "header", "sensor"]
# A word by which a user accepts what is wrong (None: it is never accepted), and what is wrong.
Warned = tuple[Acceptable | None, str]

STANDARD_GRAVITY = 9.80665  # [m/s2]
METRES_PER_SECOND_SQUARED = {
    "m/s2": 1.0,
    "cm/s2": 1e-2,
    "gal": 1e-2,
    "mm/s2": 1e-3,
    "g": STANDARD_GRAVITY,
}

VERTICAL = re.compile(r"(?i)[-+]?(U|V|Z|UD\d?|UP|DWN|DOWN|VERT|VERTICAL|..Z)")
HORIZONTAL = re.compile(
    r"(?i)[-+]?((EW|NS)\d?|[ENXYRTHL]\d?|[NS]\d+(\.\d+)?[EW]|\d{1,3}|..[ENXYRT12])"
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
_QUADRANT = r"([NS])(\d+(?:\.\d+)?)([EW])"
_SKEWED = 5.0  # [degrees] by which two components may be off a right angle
# How indices of records spell facts.
_SPELLINGS = {"Mw": "magnitude", "Vs30_mps": "vs30_mps", "event_id": "event"}


@dataclass(frozen=True)
class Facts(Mapping[str, Any]):
    """Known facts of a record, as attributes and as a mapping without what is empty or None."""

    file: str = ""  # its name
    format: str = ""
    unit_in_file: str = ""  # from which the samples were converted
    event: str = ""  # name of the earthquake
    date: str = ""
    station: str = ""
    magnitude: float | None = None  # moment magnitude, or another one of the header
    distance_km: float | None = None  # to the rupture
    epicentral_km: float | None = None
    vs30_mps: float | None = None  # [m/s]
    level: str = ""  # raw or processed
    start_time: str = ""  # of the first sample, in UTC
    origin_time: str = ""  # of the earthquake, in UTC
    component: str = ""
    azimuth: float | None = None  # [degrees] of a horizontal
    trace: str = ""  # codes of network, station, location and channel
    of_vertical: "Facts | None" = None  # facts of the other components of a motion
    of_transverse: "Facts | None" = None
    errors: list[str] = field(default_factory=list, hash=False)  # of the file
    cautions: list[str] = field(default_factory=list, hash=False)
    accepted: list[str] = field(default_factory=list, hash=False)
    file_sha256: str = ""
    source_sha256: str = ""  # of the file that a study's own file was made of
    levels: list[float] = field(
        default_factory=list, hash=False
    )  # of a study, see index
    pair: str = ""  # equal for the files with the components of one record
    more: Mapping[str, Any] = field(default_factory=dict, hash=False)  # other facts

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> Self:
        """Return the facts of a mapping; those that have no field here are in `more`.

        Names may be spelled as here or as in an index of records.
        """
        named = Named()
        more = dict(facts.get("more", {}))
        # Sorted, Mw counts before magnitude, and event before event_id.
        for key, fact in sorted(filled(facts).items()):
            name = _SPELLINGS.get(key, key)
            kind = cls.__dataclass_fields__.get(name)
            if kind is None:
                more[key] = fact
                continue
            read = _READERS.get(kind.type)
            try:
                named.setdefault(name, read(fact) if read else fact)
            except ValueError:  # a number in words stays as it is
                more[name] = fact
        return cls(**named | {"more": more})

    @property
    def _known(self) -> Named:
        return filled({**asdict(self), "more": None, **self.more})

    def __getitem__(self, key: str):
        return self._known[_SPELLINGS.get(key, key)]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)


# By the type of a fact: the function that reads it.
_READERS: dict[Any, Any] = {str: str, float | None: float, "Facts | None": Facts.of}


@dataclass
class Channel:
    """What the file states of a channel (empty or None: nothing), and what reading it found."""

    code: str = ""  # name of the component, such as HNE, 090 or UP
    vertical: bool | None = None
    downwards: bool | None = None  # of a vertical: positive samples are downwards
    azimuth: float | None = None  # [degrees] of a horizontal
    sensor: str = ""  # where it is, unless on the ground
    place: str = ""  # where the sensor is, in words of its header
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
    g_per_count: float | None = None  # acceleration of one count [g]
    announced: int = 0  # number of samples by the header
    contradicted: str = ""  # how a stated peak or length differs from the samples'

    trace: Trace = None  # its samples, once the pieces of the file are joined
    held: int = 0  # number of samples in the file
    unit_in_file: str = (
        ""  # from which the samples were converted; empty: they are not converted
    )
    accept: tuple[Acceptable, ...] = ()
    accepted: list[str] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)  # of obspy's reader
    warnings: list[Warned] = field(default_factory=list)  # refused unless accepted
    errors: list[str] = field(default_factory=list)  # with which it is read
    cautions: list[str] = field(default_factory=list)

    @property
    def is_vertical(self) -> bool:
        """Tell whether the channel is vertical, by its header or else its code."""
        if self.vertical is None:
            return VERTICAL.fullmatch(self.code) is not None
        return self.vertical

    @property
    def is_horizontal(self) -> bool:
        """Tell whether the channel is known to be horizontal, by its header or else its code."""
        if self.vertical is None:
            return HORIZONTAL.fullmatch(self.code) is not None
        return not self.vertical

    @property
    def is_refused(self) -> bool:
        """Tell whether the channel has a warning that cannot be accepted."""
        return any(word is None for word, _ in self.warnings)

    def warn(self, text: str, word: Acceptable | None = "header") -> None:
        """Add a warning with its `text`, and the `word` by which a user accepts it.

        It can never be accepted if `word` is None.
        """
        self.warnings.append((word, text))

    @property
    def instrument(self) -> str:
        """A key that is equal for the channels of one instrument."""
        stats = self.trace.stats
        code = self.code
        if stats._format == "KNET":
            return f"{stats.station}.{code[2:]}"
        seed = len(code) == 3 and code.isalnum() and not code.isdigit()
        return f"{stats.network}.{stats.station}.{stats.location}.{code[:-1] * seed}"


def filled(facts: Mapping[str, Any]) -> Named:
    """Return the facts that are neither empty nor None."""
    return {key: fact for key, fact in facts.items() if fact not in (None, "", [], {})}


def wrong_length(stated: float | None, count: int, dt: float) -> str:
    """Return a text if a `stated` length [s] contradicts `count` samples of step `dt` [s].

    It is empty if there is no contradiction, or no length is stated.
    """
    length = (count - 1) * dt
    if (
        not stated
        or not stated > 0.0
        or abs(stated - length) <= max(0.02 * length, 1.0)
    ):
        return ""
    return (
        f"the header states a length of {stated:g} s, {count} samples at {dt:g} s last "
        f"{length:g} s"
    )


def unit_factor(unit: str, place: object) -> float:
    """Return the factor from a unit of acceleration to m/s2; RecordError for an unknown unit."""
    if unit not in METRES_PER_SECOND_SQUARED:
        raise RecordError(
            f"{place}: unknown unit {unit!r} of acceleration; allowed are "
            f"{', '.join(METRES_PER_SECOND_SQUARED)}"
        )
    return METRES_PER_SECOND_SQUARED[unit]


def split_by_direction(
    channels: Sequence[Channel], place: object, surely: bool = True
) -> tuple[list[Channel], list[Channel]]:
    """Return the horizontal and the vertical channels of a record.

    RecordError if all are vertical. If `surely` and there are several channels, RecordError also
    if one that is not vertical is not known to be horizontal.
    """
    verticals = [channel for channel in channels if channel.is_vertical]
    others = [channel for channel in channels if not channel.is_vertical]
    if not others:
        raise RecordError(
            f"{place}: holds only the vertical component; a horizontal is needed"
        )
    if surely and channels[1:] and not all(each.is_horizontal for each in others):
        raise RecordError(
            f"{place}: the codes {', '.join(repr(each.code) for each in channels)} do not tell "
            "what is horizontal; name them as SEED does (HNE, HNN, HNZ), or read one by "
            "`component` (--component)"
        )
    return others, verticals


def choose_horizontal(
    channels: Sequence[Channel],
    place: object,
    component: str | None,
    listed: str | None = None,
) -> tuple[Channel, list[Channel]]:
    """Return the horizontal channel to use, and the vertical channels.

    `component` is a channel code, its last letter or a trace id; RecordError if there is no such
    horizontal. `listed` is the component in an index, which counts if no `component` is given.
    Without either the first horizontal is used, and its log says so.
    """
    horizontals, verticals = split_by_direction(
        channels, place, not (component or listed)
    )
    first = horizontals[0]
    codes = [channel.code for channel in horizontals]
    names = ", ".join(code or "(no code)" for code in codes)
    if not horizontals[1:] and listed and _may_be(first, listed):
        listed = None
    asked = component or listed
    if asked:
        ids = [channel.trace.id for channel in horizontals]
        upper = [
            name.upper() for name in (*ids, *codes, *(code[-1:] for code in codes))
        ]
        if asked.upper() not in upper:
            raise RecordError(
                f"{place}: no horizontal component {asked!r}; there is {names}"
            )
        return horizontals[upper.index(asked.upper()) % len(horizontals)], verticals
    if horizontals[1:]:
        first.log.insert(0, f"Horizontal {codes[0]} taken, the first of {names}.")
    elif not first.is_horizontal:
        first.log.insert(
            0, f"Channel {codes[0]!r} taken to be horizontal: the only one."
        )
    return first, verticals


def _may_be(channel: Channel, listed: str) -> bool:
    """Tell whether the name `listed` in an index may mean the only horizontal of a file."""
    azimuth = azimuth_of(channel.azimuth, channel.code)
    named = azimuth_of_code(listed)
    if azimuth is not None and named is not None:
        return turned_by(azimuth, named) <= _SKEWED
    codes = all(
        re.fullmatch(r"[A-Z]{2}[A-Z\d]", code.upper())
        for code in (channel.code, listed)
    )
    return not channel.code or (HORIZONTAL.fullmatch(listed) is not None and not codes)


def quadrant(text: str) -> float | None:
    """Return the azimuth of a bearing such as S16W [degrees from north]; None for other text."""
    bearing = re.fullmatch(_QUADRANT, text.upper())
    if bearing is None:
        return None
    angle = float(bearing[2])
    angle = angle if bearing[1] == "N" else 180.0 - angle
    return (angle if bearing[3] == "E" else -angle) % 360.0


def azimuth_of_code(code: str) -> float | None:
    """Return the azimuth [degrees] of a name (``N``, ``EW1``, HNE, ``180``); None without one."""
    text = code.strip().upper().lstrip("-+")
    if re.fullmatch(r"\d{2,3}", text):
        return float(text) % 360.0
    plain = re.sub(r"^[A-Z][A-Z](?=[NE]$)|\d$", "", text)
    return AZIMUTHS.get(plain, quadrant(text))


def turned_by(one: float, other: float) -> float:
    """Return the angle between two azimuths, 0 to 180 degrees."""
    return abs((one - other + 180.0) % 360.0 - 180.0)


def azimuth_of(stated: float | None, code: str) -> float | None:
    """Return the azimuth of a component, as stated or else by its code; None if unknown."""
    return azimuth_of_code(code) if stated is None else stated


def check_right_angle(facts: Facts, what: str, remedy: str) -> None:
    """Raise RecordError if the azimuths of two components are known and not at right angles."""
    other = facts.of_transverse or Facts()
    both = [azimuth_of(each.azimuth, each.component) for each in (facts, other)]
    if None not in both and abs(turned_by(*both) - 90.0) > _SKEWED:  # type: ignore[arg-type]
        raise RecordError(
            f"{what}: the components have azimuths {both[0]:g} and {both[1]:g} degrees, not at "
            f"right angles{remedy}"
        )
