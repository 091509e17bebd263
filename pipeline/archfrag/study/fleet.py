"""Arches of classes: in the rows of a table, or drawn where parameters are not known exactly."""

import csv
import difflib
import hashlib
import io
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from archfrag.errors import InputError, StudyError
from archfrag.files import read_text
from archfrag.study.arches import (
    ARCH_KEYS,
    NUMBER_KEYS,
    ArchEntry,
    Chain,
    FromJoints,
    Polygons,
    Recess,
    Ring,
    Table,
)
from archfrag.study.section import first_message
from archfrag.study.vary import JointScatter
from archfrag.study.yaml_file import parse_value

MOST_ROWS, LARGEST_TABLE, LONGEST_CELL = 10_000, 20_000_000, 20_000  # [1], [bytes], [characters]
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NO_COLUMNS = ("vary", "recess")  # mappings
_ALIKE = 0.85  # of a column's name to a key, by difflib's ratio, for a slip of the keyboard


@dataclass(frozen=True)
class Member:
    """An arch of a study."""

    entry: Chain  # the arch as a study file could have given it; its `id` is unique in the study
    # Id of the study's entry that it was drawn for or listed in; its own id otherwise.
    arch_class: str
    number: int  # of the sample, from 1; 0 if it was not drawn
    record: int | None  # place of the one record that it meets, from 0; None: it meets all
    # What it differs by within its class: numbers drawn, and numbers from a table [SI, degrees].
    values: dict[str, float]
    attributes: dict[str, str]  # text from a table
    place: str  # where it comes from, for messages

    @property
    def id(self) -> str:
        """Name of the arch in results."""
        return self.entry.id

    @cached_property
    def chain(self) -> str:
        """Digest of all that the kernels know of the arch."""
        digest = hashlib.sha256()
        for name, value in self.entry.build().chain._asdict().items():
            array = np.ascontiguousarray(value, "<f8")
            digest.update(f"{name} {array.shape} ".encode() + array.tobytes())
        return digest.hexdigest()


def read_fleet(table: Table) -> list[Member]:
    """Arches of a table."""
    path = Path(table.table)
    columns, lines = _cells(path)
    _check_columns(columns, path)
    adapter: TypeAdapter[Any] = TypeAdapter(ArchEntry)
    defaults, seen, rows = table.defaults(), dict[str, int](), []
    for line, cells in lines:
        place = f"{path}, line {line}"
        if len(cells) != len(columns):
            wanted = f"{len(columns)}, one for each column of the first line"
            raise StudyError(f"{place}: has {len(cells)} cells; it must have {wanted}")
        row = {key: cell.strip() for key, cell in zip(columns, cells)}
        name = row.pop("id")
        if name in seen:
            twice = f"{name!r} is the id of line {seen[name]} too; each arch needs its own"
            raise StudyError(f"{place}, column id: {twice}")
        seen[name] = line
        own = {key: _value(text, f"{place}, column {key}") for key, text in row.items()
               if key in ARCH_KEYS and text}  # fmt: skip
        given = {**defaults, **own, "id": name}
        try:
            entry = adapter.validate_python(given)
        except ValidationError as error:
            raise StudyError(_message(error, given, columns, place)) from None
        # Of rows that leave a cell empty too: the study's entry gives what they have.
        found = {key: getattr(entry, key, None) for key in row if key in NUMBER_KEYS}
        numbers = {k: float(v) for k, v in found.items() if isinstance(v, float | int)}
        attributes = {key: text for key, text in row.items() if key not in ARCH_KEYS}
        rows.append(Member(entry, table.id, 0, None, numbers, attributes, place))
    return rows


def _cells(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """First line of a table, and its other lines that are not empty with their numbers."""
    text = read_text(path, LARGEST_TABLE, StudyError, "the table")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        columns = [name.strip() for name in next(reader, [])]
        lines = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
    except csv.Error as error:
        raise StudyError(f"{path}: is no table in CSV ({error})") from None
    if not lines:
        raise StudyError(f"{path}: must have a line for each arch below its first line")
    if len(lines) > MOST_ROWS:
        raise StudyError(f"{path}: has {len(lines)} arches; it must have at most {MOST_ROWS}")
    return columns, lines


def _check_columns(columns: list[str], path: Path) -> None:
    if "id" not in columns:
        apart = " (commas must be between them)" if len(columns) == 1 else ""
        raise StudyError(f"{path}, line 1: a column id is missing{apart}")
    for number, name in enumerate(columns):
        if not name or not name.isprintable():
            raise StudyError(f"{path}, line 1: column {number + 1} must have a name")
        if name in columns[:number]:
            raise StudyError(f"{path}, line 1: column {name} is there twice")
        if name in _NO_COLUMNS:
            raise StudyError(f"{path}, line 1: {name} must be given in the study file")
        close = difflib.get_close_matches(name.lower(), ARCH_KEYS, n=1, cutoff=_ALIKE)
        if close and name not in ARCH_KEYS:
            hint = f"did you mean {close[0]}? (an attribute must have a name less like it)"
            raise StudyError(f"{path}, line 1: column {name} is no key of an arch; {hint}")


def _value(text: str, place: str) -> Any:
    """Content of a cell: numbers as spreadsheets write them, else as YAML."""
    if len(text) > LONGEST_CELL:
        raise StudyError(f"{place}: must have at most {LONGEST_CELL} characters")
    if _NUMBER.fullmatch(text):
        number = float(text)
        # A spreadsheet may write 7 as 7.0, where an integer is wanted.
        return int(number) if abs(number) < 1e15 and number == int(number) else number
    return text if text[0] not in "[tTfF.-+" else parse_value(text, place)


def _message(error: ValidationError, given: dict[str, Any], columns: list[str], place: str) -> str:
    message = first_message(error, given)
    column = re.split(r"[ .\[]", message, maxsplit=1)[0]
    return f"{place}, {'column ' if column in columns else ''}{message}"


FloatArray = NDArray[np.float64]
LONGEST_ID = 70  # of an entry whose arches get its id with a number behind it
_DIGITS = 4


def draw(
    entry: Chain, count: int, stream: tuple[int, ...] = ()
) -> list[tuple[Chain, dict[str, float]]]:
    """Arches drawn for an entry with `vary`, and the values of its keys that were drawn.

    Keys are drawn by the scheme of `vary` (`archfrag.arch.uncertain.sample`). What differs from
    joint to joint is drawn by plain random numbers, the same for the n-th sample of a seed
    whatever their number: it has as many coordinates as joints, in which no design of some
    points is even, and an arch averages over its joints.
    """
    from archfrag.arch.uncertain import sample

    vary = entry.vary
    assert vary is not None
    if len(entry.id) > LONGEST_ID:
        raise InputError(f"id must have at most {LONGEST_ID} characters where arches are drawn")
    values = sample(
        {key: distribution.marginal() for key, distribution in vary.of.items()},
        count,
        scheme=vary.scheme,
        seed=(vary.seed, *stream),
        correlation=vary.correlation,
    )
    digits = max(_DIGITS, len(str(count)))
    drawn = []
    for i in range(count):
        update: dict[str, Any] = {"id": f"{entry.id}-{i + 1:0{digits}d}", "vary": None}
        shown = {}
        for key, distribution in vary.of.items():
            value = float(values[key][i])
            own = getattr(entry, key)
            update[key] = _times(own, value) if distribution.relative else value
            many = isinstance(update[key], tuple)
            shown[f"{key}_factor" if many else key] = value if many else update[key]
        _stretch_joints(entry, update)
        concrete = entry.model_copy(update=update)
        if vary.joints is not None:
            # Zeros behind a seed are the same seed to numpy: 1 separates joints from keys.
            generator = np.random.default_rng([vary.seed, *stream, i, 1])
            concrete = concrete.model_copy(update=_scatter(concrete, vary.joints, generator))
        _check_bounds(concrete, i + 1, shown)
        drawn.append((concrete, shown))
    return drawn


def _check_bounds(entry: Chain, number: int, values: dict[str, float]) -> None:
    """See that what was drawn is within what a study file may give."""
    given = entry.model_dump()
    try:
        type(entry).model_validate(given)
    except ValidationError as error:
        which = f"sample {number} ({listed(values)})"
        raise InputError(f"{which}: {first_message(error, given)}") from None


def listed(values: dict[str, float]) -> str:
    """What was drawn for an arch, in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items()) or "joints"


def _times(own: Any, factor: float) -> Any:
    if isinstance(own, tuple):
        return tuple(float(f"{value * factor:.10g}") for value in own)
    return float(f"{own * factor:.10g}")


def _stretch_joints(entry: Chain, update: dict[str, Any]) -> None:
    """Joints that are given in degrees keep their parts of an angle of embrace that varies."""
    joints = getattr(entry, "joints", None)
    if joints and "embrace" in update:
        ratio = update["embrace"] / getattr(entry, "embrace")  # noqa: B009
        update["joints"] = (*(joint * ratio for joint in joints[:-1]), update["embrace"])


def _scatter(entry: Chain, joints: JointScatter, generator: np.random.Generator) -> dict[str, Any]:
    """Keys of an arch whose joints differ from each other."""
    from archfrag.arch.uncertain import to_digits

    n_joint = _joints(entry)
    drawn: dict[str, FloatArray] = {}
    # All are drawn, so that one key more leaves the others' numbers as they are.
    for name in JointScatter.model_fields:
        points = np.clip(generator.random(n_joint), 2.0**-32, 1.0 - 2.0**-32)
        distribution = getattr(joints, name)
        if distribution is not None:
            drawn[name] = to_digits(distribution.marginal().quantile(points))
    update: dict[str, Any] = {}
    if "friction" in drawn:
        product = np.broadcast_to(np.asarray(entry.friction, dtype=float), n_joint)
        update["friction"] = tuple(to_digits(product * drawn["friction"]).tolist())
    ends = {side: drawn.get(f"recess_{side}") for side in ("intrados", "extrados")}
    if any(depth is not None for depth in ends.values()):
        own = entry.recess or Recess()
        update["recess"] = own.model_copy(
            update={k: tuple(v.tolist()) for k, v in ends.items() if v is not None}
        )
    if "position" in drawn:
        update["joints"] = _shifted(entry, drawn["position"])
    return update


def _shifted(entry: Chain, shift: FloatArray) -> tuple[float, ...]:
    """Positions of joints that are shifted by parts of a voussoir's length, the springings not."""
    assert isinstance(entry, Ring)
    end = float(getattr(entry, "embrace", 1.0))
    step = end / entry.voussoirs
    equal = (*(step * j for j in range(entry.voussoirs)), end)
    place = np.asarray(entry.joints or equal)
    inner = place[1:-1] + step * shift[1:-1]
    return (float(place[0]), *(float(f"{value:.12g}") for value in inner), float(place[-1]))


def _joints(entry: Chain) -> int:
    if isinstance(entry, Ring):
        return entry.voussoirs + 1
    if isinstance(entry, FromJoints):
        return len(entry.intrados) - entry.free_end
    if isinstance(entry, Polygons):
        return entry.build().n_joint
    return 1
