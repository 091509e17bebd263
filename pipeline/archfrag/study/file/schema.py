"""A study file as a whole: what is allowed in it, how it is read, and its schema for editors."""

import json
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from archfrag.errors import InputError, StudyError
from archfrag.files import WORK, read_text
from archfrag.motions.calibrate import Acceptable
from archfrag.study.file.arches import ArchEntry, Identifier
from archfrag.study.file.blocks import (
    Execution,
    Intensity,
    LimitStates,
    Method,
    ReportKeys,
    RiskKeys,
)
from archfrag.study.file.members import Members, check_buildable, expand
from archfrag.study.file.messages import PathText, Section, first_message, parse_value, refuse
from archfrag.study.file.processing import Steps
from archfrag.study.runs import AnyDesign
from archfrag.study.runs.design import Stripes

MOST_ARCHES, DEEPEST = 1000, 20
LARGEST_FILE = 500_000  # [bytes] read in about three seconds
# Keys whose values are paths, or lists of them.
PATHS = {"output", "table", "drawing", "index", "files", "path", "inventory", "hazard"}


def _check_columns(given: Any) -> Any:
    """Check that words such as ``time=1,acceleration=2`` state where the numbers are."""
    from archfrag.motions.formats.columns import parse_columns

    if isinstance(given, dict):
        words = ",".join(f"{key}={value}" for key, value in given.items())
        raise refuse(f"must be in words, here columns: {words!r}")
    try:
        return str(parse_columns(str(given)))
    except InputError as error:
        raise refuse(f"must state where the numbers are; {error}") from None


def _as_words(given: Any) -> Any:
    return given.replace(",", " ").split() if isinstance(given, str) else given


class FileSet(Section):
    """Records by path or pattern."""

    path: PathText
    """A file, or a pattern with * and ? in any case, relative to the study file."""
    unit: str | None = None
    """Unit of the samples if the file does not state it; never guessed."""
    inventory: PathText | None = None
    """StationXML with the response, for records in counts."""
    columns: Annotated[str, BeforeValidator(_check_columns)] | None = None
    """Columns of plain text: time=1,acceleration=2 or acceleration=1,dt=0.01; dt=0.01 alone reads
    all numbers, row after row; also vertical=COLUMN and skip=LINES."""
    accept: Annotated[list[Acceptable], BeforeValidator(_as_words)] = Field(default_factory=list)
    """Let pass: pga (1e-5 to 5 g), time_step (1e-4 to 0.1 s), samples (other than announced),
    header (its peak is off by a tenth)."""

    @model_validator(mode="before")
    @classmethod
    def _as_mapping(cls, given: Any) -> Any:
        return {"path": given} if isinstance(given, str) else given


class Motions(Section):
    """The ground motions of the study."""

    index: PathText | None = None
    """Index (CSV) of shipped records, relative to the study file."""
    select: Annotated[list[str], Field(min_length=1)] | None = None
    """Ids of the records to use, in this order; all if not given."""
    files: list[FileSet] = Field(default_factory=list)
    """Record files or patterns; each a path, or a mapping with path, unit, columns and so on."""
    vertical: bool = False
    """Whether vertical components move the arches too, from the same file or from a matching file
    next to it, scaled as the horizontal one. Every record must then have one."""
    processing: Steps = Field(default_factory=list)
    """Steps applied to each record before it is measured and scaled, in this order."""

    gone: ClassVar = {
        "synthetic": "make the motions by `archfrag records make --out FOLDER` with the same "
        "numbers as options, and write index: FOLDER/index.csv"
    }

    @model_validator(mode="after")
    def _have_a_source(self) -> Self:
        if self.index is None and not self.files:
            raise refuse("must have a key index or files")
        selected = self.select or []
        if twice := [name for name in selected if selected.count(name) > 1]:
            raise refuse(f"must have different ids under select, but {twice[0]!r} is there twice")
        return self


class Study(Section):
    """A study file."""

    id: Identifier
    """Name of the study: letters, digits and _ . + - only."""
    title: Annotated[str, Field(min_length=1, max_length=500)]
    """Heading of the report."""
    institution: Annotated[str, Field(max_length=500)] = "not stated"
    """Institution that made the study, for the attributes of the cube."""
    output: PathText = "results"
    """Folder of the results, relative to the study file; results/ID beside it if not given."""
    arches: Annotated[list[ArchEntry], Field(min_length=1, max_length=MOST_ARCHES)]
    """Arches, columns or blocks; classes of them sampled by `vary` or listed in a table."""
    motions: Motions
    intensity: Intensity
    method: Method = Method()
    design: AnyDesign = Stripes()
    limit_states: LimitStates = LimitStates()
    risk: RiskKeys | None = None
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

    def members(self, n_record: int | None = None) -> Members:
        """The arches that the entries amount to, as `expand`; files are read once."""
        of, known = self._expanded.get(n_record, (None, Members()))
        if of is not self.arches:  # not yet, or of the study that this one is a copy of
            known = expand(self.arches, n_record)
            self._expanded[n_record] = self.arches, known
        return known

    @cached_property
    def _expanded(self) -> dict[int | None, tuple[Any, Members]]:
        return {}


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
    given = parse_value(read_text(path, LARGEST_FILE, StudyError, "the study file"), str(path))
    if not isinstance(given, dict):
        raise StudyError(f"{path}: must hold keys with values, such as id, arches and motions")
    for text in overrides:
        _override(given, text)
    given.setdefault("output", str(folder / "results" / str(given.get("id"))))
    try:
        study = Study.model_validate(given, context={"folder": folder})
        # Arches that each record has of its own are known once the records are.
        check_buildable(study.members(n_record=1).checked())
    except ValidationError as error:
        raise StudyError(f"{path}: {first_message(error, given)}") from error
    except StudyError as error:
        raise StudyError(f"{path}: {error}") from error
    return study


def study_schema() -> str:
    """JSON schema of study files, for editors; the text of ``configs/study.schema.json``."""
    from archfrag.simulation.checks import method_names

    schema = Study.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "archfrag study"
    schema["$defs"]["Method"]["properties"]["name"]["enum"] = list(method_names())
    file_sets = schema["$defs"]["Motions"]["properties"]["files"]
    file_sets["items"] = {"anyOf": [{"type": "string"}, file_sets["items"]]}
    return json.dumps(schema, indent=2, ensure_ascii=False, sort_keys=True) + "\n"


def _override(given: dict[str, Any], text: str) -> None:
    """Put the value of an option --set into a raw study."""
    key, equals, value_text = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts) or len(parts) > DEEPEST:
        raise StudyError(f"--set {text}: must be key=value, for example method.dt=0.0005")
    value = parse_value(value_text, f"--set {key}")
    name = next((part for part in reversed(parts) if not part.isdigit()), "")
    block: Any = given
    try:
        for part in parts[:-1]:
            block = block.setdefault(part, {}) if isinstance(block, dict) else block[int(part)]
        last = parts[-1] if isinstance(block, dict) else int(parts[-1])
        block[last] = _from_here(value, name)
    except (IndexError, TypeError, ValueError):
        what = "a list is counted from 0, and only a block or a list has keys"
        raise StudyError(f"--set {text}: the study has no such place; {what}") from None


def _from_here(value: Any, key: str) -> Any:
    """The value of a key from the command line, with its paths below the current folder."""
    if isinstance(value, dict):
        return {name: _from_here(inner, str(name)) for name, inner in value.items()}
    if isinstance(value, list):
        return [_from_here(inner, key) for inner in value]
    if key not in PATHS or not isinstance(value, str) or not value:
        return value
    expanded = os.path.expanduser(value)
    return value if expanded.startswith("~") else os.path.abspath(expanded)
