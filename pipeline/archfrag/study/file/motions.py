"""Motions of a study file: record files, and steps that process them in order."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, create_model

from archfrag.files import Named
from archfrag.motions.calibrate import Acceptable
from archfrag.study.keys import PathText, Section, refuse

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

MOST_LISTED = 12  # pairs of a first shock and its record
with Path(__file__).with_name("steps.toml").open("rb") as _file:
    STEPS: Named = tomllib.load(_file)
_KINDS: Named = {"float": float, "int": int, "bool": bool, "str": str}


def _mapping(given):
    named = {given: {}} if isinstance(given, str) else given
    if not isinstance(named, dict) or len(named) != 1:
        raise refuse(f"must have one of the keys {', '.join(STEPS)}")
    ((name, settings),) = named.items()
    return {name: {} if settings is None else settings}


def _settings(step: str):
    """Make the pydantic model of the settings of a step, from its entry in `STEPS`."""
    fields: Named = {}
    for key, about in STEPS[step].get("settings", {}).items():
        if "one_of" in about:
            kind: Any = Literal[tuple(about["one_of"])]
        else:
            bounds = Field(**about.get("bounds", {}))
            kind = Annotated[_KINDS[about["kind"]], bounds]
        if "list" in about:
            kind = Annotated[list[kind], Field(**about["list"])]
        default = about.get("default", ... if "required" in about else None)
        kind = kind | None if default is None else kind
        fields[key] = kind, Field(default, description=about["text"])
    about = STEPS[step]["text"]
    return create_model(step.capitalize(), __base__=Section, __doc__=about, **fields)


_blocks: Named = {name: (_settings(name), None) for name in STEPS}
_Step: Any = Annotated[
    create_model(
        "Step",
        __base__=Section,
        __doc__="One step: its name, and its settings.",
        **_blocks,
    ),
    BeforeValidator(_mapping),
]


class FileSet(Section):
    """Records by path or pattern."""

    path: PathText
    """A file, or a pattern with * and ? in any case, relative to the study file."""
    unit: str | None = None
    """Unit of the samples if the file does not state it; never guessed."""
    inventory: PathText | None = None
    """StationXML with the response, for records in counts."""
    columns: str | None = None
    """Columns of plain text: time=1,acceleration=2 or acceleration=1,dt=0.01; dt=0.01 alone reads
    one motion, row after row; also vertical=COLUMN and skip=LINES."""
    accept: Annotated[
        list[Acceptable],
        BeforeValidator(
            lambda given: given.split() if isinstance(given, str) else given
        ),
    ] = Field(default_factory=list)
    """Let pass: pga (1e-5 to 5 g), time_step (1e-4 to 0.1 s), samples (other than announced),
    header (its peak is off by a tenth, or it contradicts the unit or the channel code), sensor (in
    a borehole or a structure; left out where its file has others)."""


def _named(levels: list[float]) -> list[float]:
    """Return the levels of first shocks, which are part of the names of arches.

    Levels above 0 are refused if two agree in their first 12 digits.
    """
    names = [f"{level:.12g}" for level in levels if level]
    if len({*names}) < len(names):
        raise refuse("must differ in their first 12 digits, by which they name arches")
    return levels


Pause = Annotated[float, Field(ge=0.0, le=3600.0)]  # [s]


class FirstShocks(Section):
    """Motions that shake each arch before its record, after which it comes to rest."""

    kind_key = "records"
    common = ("level", "gap")
    kinds: ClassVar = {
        "index": (("index",), ("records",)),
        "records": (("records",), ()),
    }

    records: list[str] | None = Field(None, min_length=1)
    """Ids of the study's records, or of the index, that come first; all of the index if not given.
    Before the n-th record comes the n-th of them, reversed before a reversed record (both_senses);
    if they are fewer, they begin again."""
    index: PathText | None = None
    """Index (CSV) of other motions that come first, processed as the records are."""
    level: Annotated[
        Annotated[list[Annotated[float, Field(ge=0.0, le=1e6)]], Field(min_length=1)],
        BeforeValidator(lambda given: given if isinstance(given, list) else [given]),
        AfterValidator(_named),
    ]
    """Level of the first shocks or a list of levels, in the study's measure and unit. Besides the
    intact arch ID the study then has an arch ID-after-LEVEL for each of them but 0."""
    gap: Pause = 20.0
    """Time without acceleration between both motions [s]."""

    def endings(self, unit: float) -> list[tuple[str, tuple[float, float]]]:
        """Return a pair for each level above 0: a suffix of arch names, and (level [SI], gap [s]).

        `unit` is the unit of the levels in SI units.
        """
        levels = filter(None, self.level)
        return [(f"-after-{each:.12g}", (each * unit, self.gap)) for each in levels]


def pairs_text(records: Sequence[Any]) -> list[str]:
    """Return a list with one line on which first shock comes before which record.

    The list is empty if no record has a first shock.
    """
    pairs = [f"{each.first.id} before {each.id}" for each in records if each.first]
    more = len(pairs) - MOST_LISTED
    listed = ", ".join(pairs[:MOST_LISTED]) + f" and {more} more" * (more > 0)
    return [f"first shocks: {listed}"] * bool(pairs)


class Motions(Section):
    """The ground motions of the study."""

    index: PathText | None = None
    """Index (CSV) of shipped records, relative to the study file."""
    select: list[str] | None = Field(None, min_length=1)
    """Ids of the records to use, in this order; all if not given."""
    files: list[
        Annotated[
            FileSet, BeforeValidator(lambda g: {"path": g} if isinstance(g, str) else g)
        ]
    ] = Field(default_factory=list)
    """Record files or patterns; each a path, or a mapping with path, unit, columns and so on."""
    vertical: bool = False
    """Whether vertical components move the arches too, from the same file or from a matching file
    next to it, scaled as the horizontal one. Every record must then have one."""
    both_senses: bool = False
    """Whether each record is also used with its horizontal components reversed, as ID-rev, so
    that its sense does not decide. Both belong to one earthquake; the vertical stays as it is."""
    processing: list[_Step] = Field(default_factory=list, max_length=50)
    """Steps applied to each record before it is measured and scaled, in this order."""
    before: FirstShocks | None = None
    """First shocks: motions that shake each arch before its record."""

    @property
    def first(self) -> "Motions | None":
        """The motions of the index of first shocks; None if they have no index of their own."""
        if self.before is None or self.before.index is None:
            return None
        own: Named = {"index": self.before.index, "files": []}
        return self.model_copy(update=own | dict.fromkeys(("select", "before")))

    @property
    def steps(self) -> list[tuple[str, Named]]:
        """Name and settings of each step of processing, with defaults filled in."""
        return [
            (name, getattr(step, name).model_dump())
            for step in self.processing
            for name in step.model_fields_set
        ]


def apply_step(
    name: str, settings: Named, motion: "Motion", record: Path, inventory: str | None
) -> "Motion":
    """Apply one step of processing to a motion.

    `settings` are those of the step. `record` is the file of the motion and `inventory` its
    StationXML, which only the step response needs. InputError if the step does not suit the
    motion.
    """
    from archfrag.motions import process  # start-up: workers load no obspy

    if name == "choose":  # done where records are read
        return motion
    if name == "response":
        return process.remove_response(motion, record, inventory, **settings)
    changed: Motion = getattr(process, name)(motion, **settings)
    return changed
