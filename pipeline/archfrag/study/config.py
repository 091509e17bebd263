"""The study file: what is allowed in it, and one message for whatever is not."""

import json
import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError, StudyError
from archfrag.files import WORK
from archfrag.motions.plausible import Acceptable
from archfrag.study.arches import Identifier, StudyArch
from archfrag.study.design import (
    Design,
    Hazard,
    LimitStates,
    Method,
    ReportKeys,
    Stripes,
    parameter_texts,
)
from archfrag.study.members import check_buildable, members
from archfrag.study.processing import Steps
from archfrag.study.section import PathText, Rising, Section, first_message, refuse, refuse_key
from archfrag.study.synthetic import Synthetic
from archfrag.study.yaml_file import DEEPEST, dump_yaml, parse_value, read_yaml

if TYPE_CHECKING:
    from archfrag.motions.formats.columns import Columns

# Units that a level may be given in, by the SI unit of its measure, with the factor to SI.
LEVEL_UNITS: dict[str, dict[str, float]] = {
    "m/s2": {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01},
    "m/s": {"m/s": 1.0, "cm/s": 0.01},
    "m": {"m": 1.0, "cm": 0.01},
}
PERIODS = (0.01, 20.0)  # of a spectral measure [s]


class ColumnKeys(Section):
    """Where the numbers of a plain text are."""

    acceleration: int | None = None
    """Column of the horizontal acceleration from 1; without it each number is a sample."""
    time: int | None = None
    """Column of the times [s]."""
    dt: float | None = None
    """Time step of a file without times [s]."""
    vertical: int | None = None
    """Column of the vertical acceleration, positive upwards."""
    skip: int = 0
    """Lines before the first row."""

    @model_validator(mode="after")
    def _agree(self) -> Self:
        self.build()
        return self

    def build(self) -> "Columns":
        """The same for `archfrag.motions.read`."""
        from archfrag.motions.formats.columns import Columns

        try:
            return Columns(**self.model_dump())
        except InputError as error:
            raise refuse(str(error).removeprefix("columns ")) from None


class FileSet(Section):
    """Records by path or pattern."""

    path: PathText
    """A file, or a pattern with * and ? in any case, relative to the study file."""
    unit: str | None = None
    """Unit of the samples where the file does not state it; never guessed."""
    inventory: PathText | None = None
    """StationXML with the response, for records in counts."""
    columns: ColumnKeys | None = None
    """Where the numbers are, for plain text."""
    accept: Annotated[tuple[Acceptable, ...], Field(strict=False)] = ()
    """Let pass: pga (1e-5 to 5 g), time_step (1e-4 to 0.1 s), samples (other than announced),
    header (its peak is off by a tenth)."""


def _as_file_set(given: Any) -> Any:
    return {"path": given} if isinstance(given, str) else given


FileSets = Annotated[
    tuple[Annotated[FileSet, BeforeValidator(_as_file_set)], ...], Field(strict=False)
]


class Motions(Section):
    """The ground motions of the study."""

    index: PathText | None = None
    """Index (CSV) of shipped records, relative to the study file."""
    select: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] | None = None
    """Ids of the records to use, in this order; all where not given."""
    files: FileSets = ()
    """Record files or patterns; each a path, or a mapping with path and what to know of them."""
    vertical: bool = False
    """Whether vertical components move the arches too, from the records' own files or from those
    beside them; scaled by the factor of the horizontal one. A record without one is refused.
    Of synthetic motions synthetic.vertical decides."""
    processing: Steps = ()
    """What is done to each record before it is measured and scaled, in this order."""
    synthetic: Synthetic | None = None
    """Motions made by archfrag from magnitudes, distances and a seed; not stored."""

    @model_validator(mode="after")
    def _have_a_source(self) -> Self:
        if self.index is None and not self.files and self.synthetic is None:
            raise refuse("must have a key index, files or synthetic")
        if self.select is not None and len(set(self.select)) < len(self.select):
            twice = next(name for name in self.select if self.select.count(name) > 1)
            raise refuse(f"must have different ids under select, but {twice!r} is there twice")
        return self


MOST_ARCHES, MOST_LEVELS = 1000, 1000
Level = Annotated[float, Field(gt=0.0, le=1e6)]


class LevelRange(Rising):
    """Equally spaced levels."""

    start: Level
    """First level."""
    stop: Level
    """Last level."""
    count: Annotated[int, Field(ge=2, le=MOST_LEVELS)]
    """How many, both ends included."""

    @model_validator(mode="after")
    def _differ(self) -> Self:
        _rising(self.values())
        return self

    def values(self) -> tuple[float, ...]:
        """The levels, to twelve digits: what a person would have typed."""
        step = (self.stop - self.start) / (self.count - 1)
        return tuple(float(f"{self.start + i * step:.12g}") for i in range(self.count))


def _rising(levels: tuple[float, ...]) -> tuple[float, ...]:
    for before, level in pairwise(levels):
        if level <= before:
            raise refuse(f"must increase, but {level:g} follows {before:g}")
    return levels


def _listed_or_range(given: Any) -> str:
    return "range" if isinstance(given, dict | LevelRange) else "listed"


Levels = Annotated[
    tuple[Level, ...],
    Field(strict=False, min_length=1, max_length=MOST_LEVELS),
    AfterValidator(_rising),
]


class Intensity(Section):
    """How strong the motions are made."""

    measure: str
    """PGA, PGV, PGD, Arias, CAV, HI, ASI, or, with periods from 0.01 to 20 s, Sa(T), AvgSA(T1,T2)
    or FIV3(T); RotD50() or RotD100() of PGA, PGV or Sa(T)."""
    unit: str
    """Unit of the levels: g, m/s2, cm/s2 or gal for accelerations, m/s or cm/s for velocities, m
    or cm for lengths."""
    levels: Annotated[
        Annotated[Levels, Tag("listed")] | Annotated[LevelRange, Tag("range")],
        Discriminator(_listed_or_range),
    ]
    """Increasing list, or start, stop and count."""

    @model_validator(mode="after")
    def _agree(self) -> Self:
        from archfrag.motions.measures import measure_unit, parse_measure, scaling_exponent

        try:
            periods = parse_measure(self.measure).periods
        except InputError as error:
            raise refuse_key("measure", str(error)) from None
        for period in periods:
            if not PERIODS[0] <= period <= PERIODS[1]:
                text = f"it must be from {PERIODS[0]:g} to {PERIODS[1]:g} s"
                raise refuse_key("measure", f"{self.measure} has a period of {period:g} s; {text}")
        allowed = LEVEL_UNITS.get(measure_unit(self.measure), {})
        if not scaling_exponent(self.measure):
            raise refuse(f"has measure {self.measure}, to which no motion can be scaled")
        if self.unit not in allowed:
            some = f"{', '.join(allowed)}, in which {self.measure} can be given"
            raise refuse_key("unit", f"unit {self.unit!r} is not one of {some}")
        return self

    @property
    def given(self) -> tuple[float, ...]:
        """Levels in the user's unit."""
        return self.levels.values() if isinstance(self.levels, LevelRange) else self.levels

    @property
    def si(self) -> tuple[float, ...]:
        """Levels in the SI unit of the measure."""
        from archfrag.motions.measures import measure_unit

        factor = LEVEL_UNITS[measure_unit(self.measure)][self.unit]
        return tuple(level * factor for level in self.given)

    @property
    def factor(self) -> float:
        """SI unit of the measure over the unit of the levels, by the first of them."""
        return self.si[0] / self.given[0]


class Execution(Section):
    """Where and in what portions it runs; never changes a result."""

    workers: Annotated[int, Field(ge=1)] | None = None
    """One-thread processes. Where not given: for the first seconds none, as small studies are done
    before processes have started; then as many as cores."""
    scheduler: str | None = None
    """Address of a running dask scheduler, in the place of own workers. Whoever reaches it may run
    code as its user: use tls:// with the certificates of dask's configuration, or a network that
    nobody else is on."""
    chunk: Annotated[int, Field(ge=1)] | None = None
    """Runs in one part file; chosen by the number of runs where not given."""
    batches: Annotated[int, Field(ge=1, le=999)] = 1
    """Snakemake jobs that the runs are shared out to."""


class Study(Section):
    """A study file."""

    id: Identifier
    """Name of the study: letters, digits and _ . + - only."""
    title: Annotated[str, Field(min_length=1, max_length=500)]
    """Heading of the report."""
    institution: Annotated[str, Field(max_length=500)] = "not stated"
    """Who made the study, for the cube's attributes."""
    output: PathText = "results"
    """Folder of the results, relative to the study file; results/ID beside it if not given."""
    arches: Annotated[
        tuple[StudyArch, ...], Field(strict=False, min_length=1, max_length=MOST_ARCHES)
    ]
    """Arches, columns or blocks; classes of them drawn by `vary` or listed in a table."""
    motions: Motions
    intensity: Intensity
    method: Method = Method()
    design: Design = Stripes()
    limit_states: LimitStates = LimitStates()
    risk: Hazard | None = None
    report: ReportKeys = ReportKeys()
    execution: Execution = Execution()

    @property
    def folder(self) -> Path:
        """Folder of the results: what is for people."""
        return Path(self.output)

    @property
    def work(self) -> Path:
        """Folder of all that is for archfrag: motions, parts, logs and the state of the run."""
        return self.folder / WORK


def load_study(path: str | Path, overrides: Sequence[str] = ()) -> Study:
    """Read a study file.

    Parameters
    ----------
    path : str or Path
        YAML file; paths in it are relative to its folder.
    overrides : sequence of str
        ``key.key=value`` with the value in YAML, over the file's; paths in them are relative to
        the current folder.

    Returns
    -------
    Study
        With absolute paths.

    Raises
    ------
    StudyError
        One message with the file, the key, its value and what is allowed.
    """
    path = Path(path)
    folder = Path(os.path.realpath(path)).parent
    given = _anchored(read_yaml(path), (), folder)
    for text in overrides:
        _override(given, text)
    given.setdefault("output", str(folder / "results" / str(given.get("id"))))
    try:
        study = Study.model_validate(given)
    except ValidationError as error:
        raise StudyError(f"{path}: {first_message(error, given)}") from error
    try:
        # Arches that each record has of its own are known once the records are.
        check_buildable(members(study, n_record=1).checked())
    except StudyError as error:
        raise StudyError(f"{path}: {error}") from error
    return study


def dump_study(study: Study) -> str:
    """A study as the text of a study file, with absolute paths and defaults filled in."""
    return dump_yaml(study.model_dump(mode="python", exclude_none=True))


def study_schema() -> str:
    """JSON schema of study files, for editors; the text of ``configs/study.schema.json``."""
    from archfrag.simulation.checks import method_names

    schema = Study.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "archfrag study"
    method = schema["$defs"]["Method"]["properties"]
    method["name"]["enum"] = list(method_names())
    for key, text in parameter_texts().items():
        method[key]["description"] = text
    file_sets = schema["$defs"]["Motions"]["properties"]["files"]
    file_sets["items"] = {"anyOf": [{"type": "string"}, file_sets["items"]]}
    return json.dumps(schema, indent=2, ensure_ascii=False, sort_keys=True) + "\n"


# Keys whose values are paths; * is the number of an entry.
_PATHS = {
    ("output",),
    ("arches", "*", "table"),
    ("arches", "*", "drawing"),
    ("motions", "index"),
    ("motions", "files", "*"),
    ("motions", "files", "*", "path"),
    ("motions", "files", "*", "inventory"),
    ("risk", "hazard"),
}


def _anchored(value: Any, key: tuple[str, ...], folder: Path) -> Any:
    """The value of a key of a raw study with its paths made absolute."""
    if not any(path[: len(key)] == key for path in _PATHS):
        return value
    if isinstance(value, dict):
        return {k: _anchored(entry, (*key, str(k)), folder) for k, entry in value.items()}
    if isinstance(value, list):
        return [_anchored(entry, (*key, "*"), folder) for entry in value]
    if key in _PATHS and isinstance(value, str) and value:
        expanded = os.path.expanduser(value)
        return value if expanded.startswith("~") else os.path.abspath(folder / expanded)
    return value


def _override(given: dict[str, Any], text: str) -> None:
    key, equals, value_text = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts) or len(parts) > DEEPEST:
        raise StudyError(f"--set {text}: must be key=value, for example method.dt=0.0005")
    value = parse_value(value_text, f"--set {key}")
    below = tuple("*" if part.isdigit() else part for part in parts)
    value = _anchored(value, below, Path.cwd())
    place: Any = given
    for i, part in enumerate(parts):
        index: Any = part
        above = ".".join(parts[:i])
        if isinstance(place, list):
            if not re.fullmatch("[0-9]{1,6}", part) or int(part) >= len(place):
                many = f"{above} has {len(place)} entries, counted from 0"
                raise StudyError(f"--set {text}: {many}, and {part} is none of them")
            index = int(part)
        elif not isinstance(place, dict):
            raise StudyError(f"--set {text}: {above} has no keys")
        if i + 1 == len(parts):
            place[index] = value
        else:
            place = place.setdefault(index, {}) if isinstance(place, dict) else place[index]
