"""A study file as a whole: what is allowed in it, how it is read, and its schema for editors."""

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    model_validator,
)

from archfrag.errors import InputError
from archfrag.files import WORK, Named
from archfrag.motions.measures import (
    LEVEL_UNITS,
    measure_unit,
    parse_measure,
    scaling_exponent,
)
from archfrag.simulation import arguments
from archfrag.simulation.arguments import method_names
from archfrag.study.designs import AnyDesign, Stripes
from archfrag.study.file.arches import ArchEntry, Identifier
from archfrag.study.file.members import Members, check_buildable, checked, expand
from archfrag.study.file.motions import Motions, Pause
from archfrag.study.keys import PathText, Section, at, refuse
from archfrag.study.provenance import origin_of
from archfrag.study.yaml_text import read_keys

PERIODS = (0.01, 20.0)  # of a spectral measure [s]
MOST_LEVELS = 1000
Level = Annotated[float, Field(gt=0.0, le=1e6)]
Part = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1)]


class LevelRange(Section):
    """Equally spaced levels."""

    start: Level
    """First level."""
    stop: Level
    """Last level."""
    count: int = Field(ge=2, le=MOST_LEVELS)
    """Number of levels, both ends included."""


def _listed(levels: list[float] | LevelRange) -> list[float]:
    """Return the list of levels, which must increase.

    Those of a range are rounded to 12 digits, as a person would type them.
    """
    if isinstance(levels, LevelRange):
        step = (levels.stop - levels.start) / (levels.count - 1)
        levels = [float(f"{levels.start + i * step:.12g}") for i in range(levels.count)]
    for before, level in pairwise(levels):
        if level <= before:
            raise refuse(f"must increase, but {level:g} follows {before:g}")
    return levels


class Intensity(Section):
    """The levels to which the motions are scaled."""

    measure: str
    """PGA, PGV, PGD, Arias, CAV, HI, or, with periods from 0.01 to 20 s, Sa(T), AvgSA(T1,T2),
    Sa_avg2(T), Sa_avg3(T) or FIV3(T); RotD50() or RotD100() of any of these."""
    unit: str
    """Unit of the levels: of accelerations g, m/s2, cm/s2 or gal, else m/s or cm/s, m or cm."""
    levels: Annotated[
        Annotated[list[Level], Field(min_length=1, max_length=MOST_LEVELS), Tag("list")]
        | Annotated[LevelRange, Tag("range")],
        Discriminator(lambda given: "range" if isinstance(given, dict) else "list"),
        AfterValidator(_listed),
    ]
    """Increasing list, or start, stop and count."""

    @model_validator(mode="after")
    def _agree(self) -> Self:
        low, high = PERIODS
        with at(f"= {self.measure}", kind=lambda text: refuse(text, "measure")):
            periods = parse_measure(self.measure).periods
            if not all(low <= period <= high for period in periods):
                raise InputError(f"must have periods from {low:g} to {high:g} s")
            if not scaling_exponent(self.measure):
                raise InputError("no motion can be scaled to it")
        allowed = LEVEL_UNITS.get(measure_unit(self.measure), {})
        if self.unit not in allowed:
            text = f"must be one of {', '.join(allowed)}, the units of {self.measure}"
            raise refuse(f"= {self.unit} {text}", "unit")
        return self

    @property
    def given(self) -> tuple[float, ...]:
        """Levels in the user's unit."""
        return tuple(self.levels)  # type: ignore[arg-type]  # which `_listed` has made a list

    @property
    def si(self) -> tuple[float, ...]:
        """Levels in the SI unit of the measure."""
        return tuple(level * self.factor for level in self.given)

    @property
    def factor(self) -> float:
        """Unit of the levels in SI units, such as 9.80665 for g."""
        return LEVEL_UNITS[measure_unit(self.measure)][self.unit]


Line = Annotated[str, Field(min_length=1, max_length=200)]


class Method(Section):
    """Method that integrates the equations of motion."""

    name: str = "auto"
    """Method; with auto archfrag chooses one."""
    dt: float | None = Field(default=None, ge=1e-6, le=0.1)
    """Fixed time step [s]; if not given, steps follow rtol."""
    rtol: float | None = Field(default=None, ge=1e-12, lt=1.0)
    """Allowed relative error, unless dt is given; the method's default if not given."""
    follow: Pause = 20.0
    """Longest time to simulate after a record while the arch still moves [s]."""
    loss_limit: float = Field(default=0.5, ge=0.02, le=10.0)
    """Gap at both corners of a joint, over its length, beyond which contact is lost for good."""
    wave_speed: float | None = Field(default=None, ge=-1e6, le=1e6)
    """Speed of a wave along the arch [m/s]: a base moves later than the left one by its distance
    over this speed. If it is negative, the wave comes from the right."""
    bases: dict[str, float] | None = None
    """Instead of that, times by which bases move later than the left one [s], by their names:
    pier 1 and so on, right. The others move as the left one."""

    @model_validator(mode="after")
    def _is_known(self) -> Self:
        names = arguments.method_names()
        if self.name not in names:
            raise refuse(f"= {self.name} must be one of {', '.join(names)}", "name")
        with at("cannot be used", kind=refuse):
            arguments.check_taken(
                arguments.check_method(self.name), dt=self.dt, rtol=self.rtol
            )
        return self


class LimitStates(Section):
    """Damage before collapse; motion, first impact, lost contact and collapse need no number."""

    rotation: Part = 0.5
    """Peak rotation over that at which the mechanism of onset is in unstable equilibrium."""
    residual: Part = 0.01
    """Residual displacement over the mean length of the joints."""


class CodeKeys(Section):
    """Limit states of a building code, for a table of demand and capacity."""

    norm: Literal["ntc2018", "eurocode8"]
    """Code: ntc2018 (SLV and SLC) or eurocode8 (part 3: SD and NC)."""
    probability: float = Field(gt=0.0, lt=1.0)
    """Largest probability of the limit state at the capacity; yours, as no code gives it."""
    life: float = Field(default=50.0, ge=1.0, le=1000.0)
    """Nominal life V_N of ntc2018 [years]."""
    use_class: Literal["I", "II", "III", "IV"] = "II"
    """Class of use of ntc2018."""

    @model_validator(mode="after")
    def _of_norm(self) -> Self:
        given = self.model_fields_set & {"life", "use_class"}
        if self.norm == "eurocode8" and given:
            text = "is of ntc2018; eurocode8 recommends return periods: leave it out"
            raise refuse(text, *sorted(given))
        return self


class ReportKeys(Section):
    """What stands on the first page of the report."""

    project: Line | None = None
    """Name of the project."""
    client: Line | None = None
    """For whom the report is."""
    author: Line | None = None
    """Who answers for it."""
    logo: PathText | None = None
    """Picture for the head of the page: PNG, JPEG or SVG, at most 500 kB."""
    at: Level | None = None
    """Level whose probability of collapse the report gives first, in the study's unit."""
    confidence: float = Field(default=0.9, ge=0.5, lt=1.0)
    """Confidence of all bands and intervals, two-sided."""
    code: CodeKeys | None = None
    """Table of demand and capacity in the words of a building code; needs risk."""


class RiskKeys(Section):
    """A hazard curve, for the rate of collapse."""

    hazard: PathText
    """CSV of intensity and annual rate or probability, or a file of OpenQuake."""
    unit: str | None = None
    """Unit of its intensities if the file does not state it."""
    years: float = Field(50.0, gt=0.0, le=1e4)
    """Period for the probability of collapse [years]."""
    site: list[float] | None = Field(default=None, min_length=2, max_length=2)
    """Longitude and latitude, if the file has several sites [degrees]."""


def _place(scheduler: str, info) -> str:
    """Make the path of a scheduler's file absolute; an address stays as it is."""
    if not scheduler.endswith(".json"):
        return scheduler
    return TypeAdapter[str](PathText).validate_python(scheduler, context=info.context)


class Execution(Section):
    """Workers and portions of the run; they never change a result."""

    workers: Count | None = None
    """Number of threads of this process; as many as cores by default."""
    scheduler: Annotated[str, Field(min_length=1), AfterValidator(_place)] | None = None
    """Address of a running dask scheduler, or its scheduler file (.json), to use instead of
    threads. It executes any code sent to it: use tls:// with the certificates of dask's
    configuration, or a private network."""
    chunk: Count | None = None
    """Runs in one part file; depends on the number of runs if not given."""
    batches: int = Field(default=1, ge=1, le=999)
    """Number of Snakemake jobs among which the runs are divided."""


class StudyKeys(Section):
    """A study file."""

    id: Identifier
    """Name of the study: letters, digits and _ . + - only."""
    title: str = Field(min_length=1, max_length=500)
    """Heading of the report."""
    institution: str = Field("not stated", max_length=500)
    """Institution that made the study, for the attributes of the cube."""
    output: PathText = "results"
    """Folder of the results, relative to the study file; results/ID beside it if not given."""
    arches: list[ArchEntry] = Field(min_length=1, max_length=1000)
    """Arches, columns or blocks; classes of them sampled by `vary` or listed in a table."""
    motions: Motions
    intensity: Intensity
    method: Method = Method()
    design: AnyDesign = Stripes()
    limit_states: LimitStates = LimitStates()
    risk: RiskKeys | None = None
    report: ReportKeys = ReportKeys()
    execution: Execution = Execution()

    @model_validator(mode="after")
    def _steps_faces(self) -> Self:
        name = self.method.name
        for place, entry in enumerate(self.arches):
            if entry.value("joints.model") == "face" and name not in (
                "auto",
                "time_stepping",
            ):
                text = f"face needs method time_stepping or auto, not {name}"
                raise refuse(text, f"arches[{place}].joints.model")
        return self

    @model_validator(mode="after")
    def _code_has_hazard(self) -> Self:
        if self.report.code is not None and self.risk is None:
            text = "needs the hazard of the site for its demand: give risk.hazard, or leave it out"
            raise refuse(text, "report.code")
        return self

    _expanded: tuple[Any, Members] = (None, ())
    _given: tuple[Named, Path] = ({}, Path())  # keys as written, their folder

    @property
    def folder(self) -> Path:
        """Folder of the results."""
        return Path(self.output)

    @property
    def work(self) -> Path:
        """Hidden folder in that of the results: motions, parts, logs and the state of the run."""
        return self.folder / WORK

    @property
    def members(self) -> Members:
        """All arches of the study, as `expand` returns them. Files are read only once."""
        before = self.motions.before
        endings = before.endings(self.intensity.factor) if before else []
        given = self.arches, endings
        if self._expanded[0] != given:  # not yet, or this is a changed copy
            self._expanded = given, expand(*given)
        return self._expanded[1]

    @property
    def given(self) -> tuple[Named, Path]:
        """Keys as they were written, and the folder of the file."""
        return self._given

    @property
    def origin(self) -> dict[str, str]:
        """Digests, by name, of what the results depend on, except files."""
        return origin_of(*self._given, self.folder)


def load_study(path: str | Path, overrides: Sequence[str] = ()) -> StudyKeys:
    """Read a study file in YAML and check it.

    Relative paths in the file are below its folder; those returned are absolute. Each of
    `overrides` is a text ``key.key=value``, with the value as the file would give it. InputError
    is one message with file, key, value and what is allowed.
    """
    return study_of(*read_keys(Path(path), overrides), path)


def study_of(given: Named, folder: Path, place) -> StudyKeys:
    """Check the keys of a study and return it.

    `given` are the keys, and relative paths in them are below `folder`. The message of an
    InputError begins with `place`, which says where the keys are from.
    """
    given.setdefault("output", str(folder / "results" / str(given.get("id"))))
    with at(place, given):
        study = StudyKeys.model_validate(given, context={"folder": folder})
        check_buildable(checked(study.members))
    study._given = given, folder
    return study


def study_schema() -> str:
    """Return the JSON schema of study files for editors: ``configs/study.schema.json``."""
    schema = StudyKeys.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "archfrag study"
    schema["$defs"]["Method"]["properties"]["name"]["enum"] = list(method_names())
    file_sets = schema["$defs"]["Motions"]["properties"]["files"]
    file_sets["items"] = {"anyOf": [{"type": "string"}, file_sets["items"]]}
    design = schema["properties"]["design"]
    names = sorted(design["discriminator"]["mapping"])
    blocks = {key: design.pop(key) for key in ("discriminator", "oneOf")}
    design["anyOf"] = [{"enum": names, "type": "string"}, blocks]
    return json.dumps(schema, indent=2, ensure_ascii=False, sort_keys=True) + "\n"
