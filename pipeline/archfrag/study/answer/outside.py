"""Runs of other programs and of experiments: a table of verdicts as a cube and a study's keys."""

import contextlib
import os
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import parse_table, read_text, unquoted, with_points
from archfrag.fragility.curve import tails
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.measures import LEVEL_UNITS, measure_unit, parse_measure
from archfrag.study.designs import Cloud, Design, Ida, Stripes
from archfrag.study.file.schema import Intensity, ReportKeys, StudyKeys
from archfrag.study.hazard import spelled
from archfrag.study.keys import at
from archfrag.study.provenance import digest_of, strict_json

# What a table does not state of its runs, and answers to a study ask for.
BLANK = {"collapse_joint": -1, "collapse_mode": 0, "lost_contact_time": np.nan}
LARGEST = 200_000_000  # [bytes] of a file
_NAMED = tomllib.loads(Path(__file__).with_name("outside.toml").read_text("utf-8"))
_ROLES: dict[str, list[str]] = _NAMED["columns"]
_WORDS = {w: Verdict[name.upper()] for name, words in _NAMED["verdicts"].items() for w in words}
_SURVIVED_CODES = {word: Verdict(1 - _WORDS[word]) for word in _NAMED["answers"]["words"]}
_SURVIVED_NAMES = {*_NAMED["verdicts"]["survived"]} - {*_SURVIVED_CODES}
_UNITS = {unit for units in LEVEL_UNITS.values() for unit in units}
_CHOOSE = "say which by columns"
_RULE, _NEEDED = _NAMED["messages"]["verdict"], _NAMED["messages"]["columns"]


class _Run(NamedTuple):
    """A run as a row of the table states it."""

    place: int  # of the row
    arch: str
    record: str
    level: float  # in the unit of the table
    verdict: Verdict
    state: int = 0  # place in the ordered list of damage states


@dataclass(frozen=True)
class VerdictTable:
    """Cells of a table of runs by what they hold, and how its rows are named in messages."""

    source: str
    rows: Sequence[str]  # such as "line 7"
    heads: Mapping[str, str]  # names of columns by what they hold
    cells: Mapping[str, Sequence[str]]

    def wrong(self, place: int, what: str, rule: str) -> InputError:
        """Return the error of a cell."""
        cell, where = self.cells[what][place][:60], f"{self.source}: {self.rows[place]}"
        return InputError(f"{where}, column {self.heads[what]!r}: {cell!r} {rule}")

    def number(self, place: int, what: str) -> float:
        """Return the intensity in a cell."""
        try:
            value = float(self.cells[what][place])
        except ValueError:
            value = np.nan
        if not 0.0 < value <= 1e6:
            raise self.wrong(place, what, "is no intensity; it must be a number above 0")
        return value

    def code(self, place: int, what: str, words: Mapping[str, int], rule: str) -> int:
        """Return what the word or the whole number in a cell stands for."""
        word = _plain(self.cells[what][place]).removesuffix(".0")
        if word not in words:
            raise self.wrong(place, what, rule)
        return words[word]

    def name(self, place: int, what: str, default: str) -> str:
        """Return the name in a cell, or the default of a table without such a column."""
        cell = self.cells[what][place] if what in self.cells else default
        if not cell:
            raise self.wrong(place, what, f"is no name; every row needs its {what}")
        return cell


def read_runs(
    table: Any, columns: Mapping[str, str] | None = None, measure: str | None = None,
    unit: str | None = None, states: Sequence[str] = (), confidence: float = 0.9,
    output: str | os.PathLike[str] | None = None,
) -> tuple[StudyKeys, xr.Dataset]:  # fmt: skip
    """Return a table of runs, as `archfrag.fit` describes it, as a cube with the keys of a study.

    InputError names row, column, value and what is allowed.
    """
    tails(confidence)
    given, states = read_table(table, columns or {}), [str(each) for each in states]
    if "state" in given.cells and "verdict" not in given.cells and len(states) < 2:
        rule = "states must list all of them in order, from no damage to collapse"
        raise InputError(f"{given.source}: column {given.heads['state']!r} is of damage: {rule}")
    seen, runs = dict[tuple[str, str, float], _Run](), list[_Run]()
    for run in (run for place in range(len(given.rows)) for run in _of_row(given, place, states)):
        if (first := seen.setdefault(run[1:4], run)) is not run:
            what = "intensity" if "intensity" in given.cells else "upper"
            rule = f"is there twice for {run.record}, see {given.rows[first.place]}"
            how = "give a repeated test a record of its own, and both the same event"
            raise given.wrong(run.place, what, f"{rule}; {how}")
        runs += [run] * (run.verdict != Verdict.NOT_RUN)
    if not runs:
        raise InputError(f"{given.source}: has no run; {_NEEDED}")
    path = Path(table) if isinstance(table, str | Path) else Path("fit")
    study = StudyKeys.model_construct(
        id=path.stem.replace(" ", "-"), title=f"Fragility from {given.source}", arches=[],
        output=str(output or Path("results") / path.stem), design=_design(given, runs),
        intensity=_intensity(given, runs, measure, unit), report=ReportKeys(confidence=confidence),
    )  # fmt: skip
    return study, _cube(given, runs, study, states)


def read_table(table: Any, columns: Mapping[str, str]) -> VerdictTable:
    """Read a CSV file, a DataFrame, or what makes one, and find its columns."""
    if isinstance(table, str | Path):
        source = str(table)
        with at(source):
            content = read_text(Path(table), LARGEST, InputError, "the table")
            separator, names, found = parse_table(content)
            found = with_points(found, separator)
        rows = [f"line {line}" for line, _ in found]
        cells = [[unquoted(cell) for cell in each] for _, each in found]
    else:
        source, frame = "the table", _frame(table)
        names, rows = [str(name) for name in frame], [f"row {n + 1}" for n in range(len(frame))]
        text = frame.astype(object).where(frame.notna(), "").map(lambda c: str(c).strip())
        cells = text.to_numpy().tolist()
    heads = _heads(source, names, columns)
    kept = {what: [str(each[names.index(head)]) for each in cells] for what, head in heads.items()}
    return VerdictTable(source, rows, heads, kept)


def _frame(table: Any) -> pd.DataFrame:
    try:
        frame = pd.DataFrame(table)
    except (ValueError, TypeError) as error:
        how = "give a file, a DataFrame, or columns of one length by name"
        raise InputError(f"the table is no table ({error}); {how}") from None
    if twice := frame.columns[frame.columns.duplicated()].tolist():
        raise InputError(f"the table: column {twice[0]!r} is there twice")
    return frame


def _plain(name: str) -> str:
    """Return a name as it is compared."""
    return name.strip().casefold().replace("_", " ")


def _heads(source: str, names: Sequence[str], columns: Mapping[str, str]) -> dict[str, str]:
    """Return the name of the column of each thing that the table states."""
    heads, plain = dict[str, str](), {_plain(_stated(name)[0]): name for name in reversed(names)}
    for what, given in columns.items():
        if what not in _ROLES:
            raise InputError(f"columns: {what!r} is not known; allowed are {', '.join(_ROLES)}")
        head = given if given in names else plain.get(_plain(given))
        if head is None:
            raise InputError(f"columns: {source} has no column {given!r}, but {', '.join(names)}")
        heads[what] = head
    for what, known in _ROLES.items():
        own = [plain[name] for name in known if name in plain]
        if what == "verdict" and what not in heads and own[1:]:
            raise InputError(f"{source}: {own[0]} and {own[1]} may both be the {what}; {_CHOOSE}")
        heads |= {what: own[0]} if {*own} - {*heads.values()} and what not in heads else {}
    weak = "intensity" not in columns and _plain(heads.get("intensity", "level")) == "level"
    measured = [name for name in names if _measure_of(name) and name not in heads.values()]
    if weak and len(measured) > 1:
        both = " and ".join(measured[:2])
        raise InputError(f"{source}: {both} may both be the intensity; {_CHOOSE}")
    heads |= {"intensity": measured[0]} if weak and measured else {}
    by_run = "intensity" in heads and {"verdict", "state"} & heads.keys()
    if not by_run and not {"lower", "upper"} <= heads.keys():
        raise InputError(f"{source}: {_NEEDED}; it has {', '.join(names)}")
    left = ("lower", "upper") if by_run else ("intensity", "verdict", "state")
    return {what: head for what, head in heads.items() if what not in left}


def _stated(head: str) -> tuple[str, str | None]:
    """Split the name of a column into what it names and its unit."""
    found = re.fullmatch(r"(.+?)(?:\s*[\[(]\s*|[\s_]+)([^\[\]()]*?)\s*[\])]?", head)
    named = found and found[2] in _UNITS
    return (spelled(found[1]), found[2]) if found and named else (spelled(head), None)


def _measure_of(head: str) -> str | None:
    """Return the measure that the name of a column states, if it does."""
    with contextlib.suppress(InputError):
        parse_measure(name := _stated(head)[0])
        return name
    return None


def _of_row(given: VerdictTable, place: int, states: Sequence[str]) -> Iterator[_Run]:
    """Yield the runs that a row states: one, or those at the ends of a bracket."""
    arch = given.name(place, "arch", "structure")
    about = place, arch, given.name(place, "record", given.rows[place])
    if "lower" in given.cells:
        none = {"lower": ("", "0", "0.0"), "upper": ("", "inf")}
        ends = {w: given.number(place, w) for w in none if given.cells[w][place] not in none[w]}
        if not ends:
            raise given.wrong(place, "upper", "leaves the row without a level; give one end")
        if len(ends) == 2 and ends["lower"] >= ends["upper"]:
            rule = "the highest level that stood must be below the lowest that collapsed"
            raise given.wrong(place, "upper", f"is not above {ends['lower']:g}; {rule}")
        for what, level in ends.items():
            yield _Run(*about, level, Verdict(int(what == "upper")))
        return
    level = given.number(place, "intensity")
    if "state" not in given.cells or not states:
        # In a column that is named "survived" a 1 is a survival.
        words = (
            _WORDS
            if _plain(given.heads["verdict"]) not in _SURVIVED_NAMES
            else _WORDS | _SURVIVED_CODES
        )
        yield _Run(*about, level, Verdict(given.code(place, "verdict", words, _RULE)))
        return
    places = {str(n): n for n in range(len(states))} | {_plain(s): n for n, s in enumerate(states)}
    lost = {w: -code for w, code in _WORDS.items() if code > 1 and not w.isdecimal()}
    rule = f"is no damage state; they are {', '.join(states)}, or their numbers from 0"
    state = given.code(place, "state", lost | places, rule)
    yield _Run(*about, level, Verdict(-state if state < 0 else state == len(states) - 1), state)


def _intensity(
    given: VerdictTable, runs: Sequence[_Run], measure: str | None, unit: str | None
) -> Intensity:
    """Return measure, unit and levels, from the name of the column or as they are given."""
    head = given.heads["intensity" if "intensity" in given.heads else "lower"]
    where, own, own_unit = f"{given.source}: column {head!r}", _measure_of(head), _stated(head)[1]
    for name, stated, asked in (("measure", own, measure), ("unit", own_unit, unit)):
        if stated and asked and stated != asked:
            raise InputError(f"{where} states {stated}, but {name} is {asked}; leave {name} out")
        if not (stated or asked):
            raise InputError(f"{where} states no {name}; name it as `PGA [g]`, or give {name}")
    measure, unit = str(own or measure), str(own_unit or unit)
    with at(given.source):
        if unit not in (allowed := LEVEL_UNITS.get(measure_unit(measure), {})):
            raise InputError(f"unit {unit} must be one of {', '.join(allowed)} for {measure}")
    levels = sorted({run.level for run in runs})
    return Intensity.model_construct(measure=measure, unit=unit, levels=levels)


def _design(given: VerdictTable, runs: Sequence[_Run]) -> Design:
    """Return the design that the runs have the form of."""
    pairs = {(run.arch, run.record) for run in runs}
    if "lower" in given.cells:
        return Ida(kind="ida")
    if len(pairs) == len(runs):
        return Cloud(kind="cloud")
    levels = Counter(arch for arch, _ in {(run.arch, run.level) for run in runs})
    return Stripes() if len(runs) == sum(levels[arch] for arch, _ in pairs) else Ida(kind="ida")


def _of_each(given: VerdictTable, runs: Sequence[_Run], what: str, by: str) -> dict[str, str]:
    """Return a text of each record or arch, empty if there is none; it must not have two."""
    found = dict[str, str]()
    for run in runs:
        name, text = getattr(run, by), given.cells[what][run.place] if what in given.cells else ""
        if found.setdefault(name, text) != text:
            rule = f"differs from {found[name]!r} in another row of {name}; give it one {what}"
            raise given.wrong(run.place, what, rule)
    return found


def _cube(
    given: VerdictTable, runs: Sequence[_Run], study: StudyKeys, states: Sequence[str]
) -> xr.Dataset:
    """Return the cube of the runs, in the form of `archfrag.study.answer.cube.open_cube`."""
    events = _of_each(given, runs, "event", "record")
    classes = _of_each(given, runs, "arch_class", "arch")
    intensity, regular = study.intensity, study.design.on_levels
    records, arches = ({name: n for n, name in enumerate(each)} for each in (events, classes))
    levels = {level: n if regular else 0 for n, level in enumerate(intensity.given)}
    cells = [(arches[run.arch], records[run.record], levels[run.level]) for run in runs]
    dims = "arch", "record", "level"
    shape = len(arches), len(records), max(levels.values()) + 1

    def filled(values: Any, missing: float, kind: str = "f8") -> NDArray:
        cube = np.full(shape, missing, kind)
        cube[tuple(np.transpose(cells))] = values
        return cube

    own = {"measure": intensity.measure, "units": measure_unit(intensity.measure)}
    si = np.array(intensity.si)
    if not regular:  # any level above 0 where there is no run
        si = filled([run.level * intensity.factor for run in runs], si[0])
    factors = [given.cells["scale"][run.place] for run in runs if "scale" in given.cells]
    codes = {each.name.lower(): int(each) for each in Verdict}
    flags = {"flag_values": list(codes.values()), "flag_meanings": " ".join(codes)}
    variables: dict[str, Any] = {
        "verdict": (dims, filled([run.verdict for run in runs], Verdict.NOT_RUN, "i1"), flags),
        "intensity": ("level" if regular else dims, si, own),
        "record": ("record", list(records)), "event": ("record", list(events.values())),
        "arch": ("arch", list(arches)), "level": ("level", np.arange(shape[2])),
        "arch_class": ("arch", [classes[name] or name for name in arches]),
        "scale_factor": (dims, filled(pd.to_numeric(factors or np.nan, errors="coerce"), np.nan)),
    }  # fmt: skip
    variables |= {name: (dims, np.full(shape, none)) for name, none in BLANK.items()}
    if "state" in given.cells and states:
        variables["damage"] = dims, filled([max(run.state, 0) for run in runs], -1, "i2")
        variables["damage"] += ({"states": strict_json(states)},)
    return xr.Dataset(variables, attrs={
        "title": study.title, "archfrag_study": study.id,
        "archfrag_design": strict_json(study.design.model_dump(mode="json")),
        "archfrag_commit": "none: of a table", "table_sha256": digest_of(dict(given.cells)),
    })  # fmt: skip
