"""Runs of other programs and of experiments: a table of verdicts becomes a study and its cube."""

import contextlib
import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import InputError
from archfrag.files import Named, number, read_text, table_of, unquoted
from archfrag.fragility.curve import tails
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.measures import LEVEL_UNITS, measure_unit
from archfrag.study.designs import Cloud, Design, Ida, Stripes
from archfrag.study.file.schema import Intensity, ReportKeys, StudyKeys
from archfrag.study.hazard import measure_of, spelled, with_unit
from archfrag.study.keys import at
from archfrag.study.provenance import digest_of, strict_json

# Values of what a table does not state of its runs, but the answers of a study need.
BLANK = {"collapse_joint": -1, "collapse_mode": 0, "lost_contact_time": np.nan}
LARGEST = 200_000_000  # [bytes] of a file
_NAMED = tomllib.loads(Path(__file__).with_name("outside.toml").read_text("utf-8"))
_ROLES: dict[str, list[str]] = _NAMED["columns"]
_WORDS = {
    w: int(Verdict[k.upper()]) for k, words in _NAMED["verdicts"].items() for w in words
}
_SURVIVED_CODES = {word: 1 - _WORDS[word] for word in _NAMED["answers"]["words"]}
_SURVIVED_NAMES = {*_NAMED["verdicts"]["survived"]} - {*_SURVIVED_CODES}
_UNITS = {unit for units in LEVEL_UNITS.values() for unit in units}
_CHOOSE = "say which by columns"
_ENDS = {"lower", "upper"}
_OUTCOMES = {"verdict", "state"}
_NONE = {
    "intensity": (),
    "lower": ("", "0", "0.0"),
    "upper": ("", "inf"),
}  # cells that mean that there is no level
_RULE = _NAMED["messages"]["verdict"]
_NEEDED = _NAMED["messages"]["columns"]


class VerdictTable(NamedTuple):
    """A table of runs: its cells by what they hold, and the names of its rows and columns."""

    source: str
    rows: Sequence[str]  # such as "line 7"
    heads: Mapping[str, str]  # names of columns by what they hold
    cells: pd.DataFrame  # text by what it holds; defaults for columns that are missing

    def wrong(self, place, what: str, rule: str) -> InputError:
        """Return the InputError of a cell: that of a row (`place`) in the column of `what`.

        `rule` says what is wrong with it.
        """
        cell = self.cells[what][place][:60]
        return InputError(
            f"{self.source}: {self.rows[place]}, column {self.heads[what]!r}: {cell!r} "
            f"{rule}"
        )

    def read(self, what: str, meaning: Callable[[str], Any], rule: str) -> pd.Series:
        """Return what the cells of a column mean.

        `meaning` is called with the text of each cell; it returns None or nan if the text means
        nothing. InputError, with `rule`, for the first such cell.
        """
        found = self.cells[what].map(meaning)
        for place in np.flatnonzero(found.isna()):
            raise self.wrong(place, what, rule)
        return found


def read_runs(
    table,
    columns: Mapping[str, str] | None = None,
    measure: str | None = None,
    unit: str | None = None,
    states: Sequence[str] = (),
    confidence: float = 0.9,
    output: str | os.PathLike[str] | None = None,
) -> tuple[StudyKeys, xr.Dataset]:
    """Read a table of runs; return the keys of a study, and the cube of its runs.

    `archfrag.fit` describes the table and the arguments. InputError names row, column, value and
    what is allowed.
    """
    tails(confidence)
    if not isinstance(columns, Mapping | None):
        raise InputError(
            f"columns is {columns!r}; it must be a mapping, such as {{'intensity': 'PGA', "
            "'verdict': 'fell'}"
        )
    given = read_table(table, columns or {})
    states = _checked_states(given, states)
    measure, unit, factors = _units(given, measure, unit)
    runs = _runs(given, states, factors)
    levels = np.unique(runs["level"]).tolist()
    # The design follows from the form of the runs; stripes may lack some of them.
    design: Design = Ida(kind="ida") if "lower" in given.heads else Stripes()
    if not runs.duplicated(["arch", "record"]).any():
        design = Cloud(kind="cloud")
    path = Path(table) if isinstance(table, str | Path) else Path("fit")
    study = StudyKeys.model_construct(
        id=path.stem.replace(" ", "-"),
        title=f"Fragility from {given.source}",
        arches=[],
        output=str(output or Path("results") / path.stem),
        design=design,
        intensity=Intensity.model_construct(measure=measure, unit=unit, levels=levels),
        report=ReportKeys(confidence=confidence),
    )
    return study, _cube(given, runs, study, states)


def read_table(table, columns: Mapping[str, str]) -> VerdictTable:
    """Read a table of runs and find its columns.

    `table` is a CSV file, a DataFrame or what makes one. `columns` are names of columns by what
    they hold.
    """
    if isinstance(table, str | Path):
        source = str(table)
        with at(source):
            content = read_text(Path(table), LARGEST, InputError, "the table")
            frame = table_of(content).map(unquoted)
        rows = [f"line {line}" for line in frame.index]
    else:
        source = "the table"
        try:
            frame = pd.DataFrame(table).astype(object)
            frame.columns = pd.Index([str(name) for name in frame])
        except (ValueError, TypeError) as error:
            raise InputError(
                f"the table is no table ({error}); give a file, a DataFrame, or columns of one "
                "length by name"
            ) from None
        for name in frame.columns[frame.columns.duplicated()]:
            raise InputError(f"the table: column {name!r} is there twice")
        frame = frame.where(frame.notna(), "").map(lambda cell: str(cell).strip())
        rows = [f"row {n + 1}" for n in range(len(frame))]
    heads = _heads(source, frame.columns.tolist(), columns)
    without = dict.fromkeys(("event", "arch_class", "scale"), "")
    cells: Named = {"arch": "structure", "record": rows, **without}
    cells |= {what: frame[head].to_numpy() for what, head in heads.items()}
    return VerdictTable(source, rows, heads, pd.DataFrame(cells, range(len(rows))))


def _checked_states(given: VerdictTable, states: Sequence[str]) -> list[str]:
    """Return the names of damage states; InputError unless they differ and have a column."""
    names = [states] if isinstance(states, str) else list(map(str, states))
    if names and len({*map(_plain, names)}) < max(len(names), 2):
        raise InputError(
            f"states are {states!r}; they must be a list of different names, from no damage to "
            "collapse"
        )
    if names and "state" not in given.heads:
        raise InputError(
            f"{given.source}: has no column of damage states; leave states out, or name its "
            "column, such as damage state"
        )
    return names


def _level(none: Sequence[str], cell: str) -> float:
    """Return the intensity in a cell, nan if the cell holds none.

    Cells of the texts `none` mean that there is no level: they give 0.
    """
    with contextlib.suppress(ValueError):
        if cell in none or 0.0 < number(cell) <= 1e6:
            return 0.0 if cell in none else number(cell)
    return np.nan


def _plain(name: str) -> str:
    """Return a name as it is compared: in lower case, with blanks for underscores."""
    return name.strip().casefold().replace("_", " ")


def _heads(
    source: str, names: Sequence[str], columns: Mapping[str, str]
) -> dict[str, str]:
    """Return the names of the columns that are used, by what they hold.

    `names` are all columns. `columns` are those that the user has chosen, by what they hold;
    others are recognised by their names. InputError if a column is missing or not clear.
    """
    heads = dict[str, str]()
    stated = {name: _stated(name) for name in reversed(names)}
    plain = {_plain(own): name for name, (own, _) in stated.items()}
    for what, given in columns.items():
        if what not in _ROLES:
            raise InputError(
                f"columns: {what!r} is not known; allowed are {', '.join(_ROLES)}"
            )
        head = str(given)
        heads[what] = head if head in names else plain.get(_plain(head), "")
        if heads[what] not in names:
            raise InputError(
                f"columns: {source} has no column {head!r}, but {', '.join(names)}"
            )
    for what, known in _ROLES.items():
        own = [plain[name] for name in known if name in plain]
        if what not in _NONE:  # brackets behind another name state no unit
            own = [name for name in own if not stated[name][1]]
        if what == "verdict" and what not in heads and own[1:]:
            raise _either(source, own, what)
        if what not in heads and {*own} - {*heads.values()}:
            heads[what] = own[0]
    if (
        "intensity" not in columns
        and _plain(heads.get("intensity", "level")) == "level"
    ):
        free = [name for name in names if name not in heads.values()]
        measured = [name for name in free if measure_of(stated[name][0])]
        if measured[1:]:
            raise _either(source, measured, "intensity")
        heads |= dict(zip(["intensity"], measured))
    by_run = "intensity" in heads and _OUTCOMES & heads.keys()
    by_record = heads.keys() >= _ENDS
    if not by_run and not by_record:
        raise InputError(f"{source}: {_NEEDED}; it has {', '.join(names)}")
    chosen = columns.keys() >= _ENDS
    if by_run and by_record and chosen == bool(_OUTCOMES & columns.keys()):
        raise InputError(
            f"{source}: has runs and brackets ({heads['lower']} and {heads['upper']} beside "
            f"{heads['intensity']}); {_CHOOSE}"
        )
    left = _ENDS if by_run and not chosen else {"intensity", *_OUTCOMES}
    return {what: head for what, head in heads.items() if what not in left}


def _either(source: str, names: Sequence[str], what: str) -> InputError:
    """Return the InputError for two columns that may both be that of `what`."""
    return InputError(
        f"{source}: {names[0]} and {names[1]} may both be the {what}; {_CHOOSE}"
    )


def _stated(head: str) -> tuple[str, str]:
    """Split the name of a column into measure and unit; the unit is empty if there is none."""
    name, unit = with_unit(head)
    found = re.fullmatch(r"(.+?)[\s_]+(\S+)", head)
    if unit is None and found and found[2] in _UNITS:
        name, unit = found.groups()
    return spelled(name), unit or ""


def _runs(
    given: VerdictTable, states: Sequence[str], factors: Mapping[str, float]
) -> pd.DataFrame:
    """Return the runs of a table: level, verdict and cells, with the place of their row as index.

    A bracket gives a run at each of its ends. `factors` are the units of the columns of
    intensities, in the unit of the levels. InputError for the first row that cannot be used.
    """
    for what in ("arch", "record"):
        rule = f"is no name; every row needs its {what}"
        given.read(what, lambda cell: cell or None, rule)
    rule = "is no intensity; it must be a number above 0"
    ends = [given.read(end, partial(_level, _NONE[end]), rule) for end in factors]
    levels = pd.concat(ends, axis=1).replace(0.0, np.nan)
    for end, factor in factors.items():
        if factor != 1.0:
            levels[end] = (factor * levels[end]).map("{:.12g}".format).astype(float)
    for n in np.flatnonzero(levels.isna().all(axis=1)):
        raise given.wrong(n, "upper", "leaves the row without a level; give one end")
    runs = levels.melt(None, None, "end", "level", ignore_index=False).dropna()
    runs = runs.sort_index(kind="stable").join(given.cells)
    keys = ["arch", "record", "level"]
    if "lower" in levels:
        for n in np.flatnonzero(levels["lower"] >= levels["upper"]):
            rule = (
                f"is not above {levels['lower'][n]:g}; the highest level that stood must be below "
                "the lowest that collapsed"
            )
            raise given.wrong(n, "upper", rule)
        runs["code"] = runs["end"] == "upper"
    else:
        runs = runs.assign(**_verdicts(given, states))
    for place, run in runs[runs.duplicated(keys)].iterrows():
        first = runs.index[(runs[keys] == run[keys]).all(axis=1)][0]
        rule = (
            f"is there twice for {run['record']}, see {given.rows[first]}; give a repeated test a "
            "record of its own, and both the same event"
        )
        raise given.wrong(place, run["end"], rule)
    runs = runs[runs["code"] != Verdict.NOT_RUN]
    if runs.empty:
        raise InputError(f"{given.source}: has no run; {_NEEDED}")
    for what, by in (("event", "record"), ("arch_class", "arch")):
        first = runs.groupby(by)[what].transform("first")
        for place, run in runs.assign(first=first)[runs[what] != first].iterrows():
            rule = f"differs from {run['first']!r} in another row of {run[by]}; give it one {what}"
            raise given.wrong(place, what, rule)
    return runs


def _verdicts(given: VerdictTable, states: Sequence[str]) -> Named:
    """Return the verdict of each row as `code`; with damage states also the state, as `damage`.

    A state is its place in `states`, which are ordered from no damage to collapse.
    """
    if "verdict" not in given.heads and not states:
        raise InputError(
            f"{given.source}: column {given.heads['state']!r} is of damage: states must list all "
            "of them in order, from no damage to collapse"
        )
    what = "state" if states and "state" in given.heads else "verdict"
    rule = _RULE
    words = _WORDS
    if what == "state":
        rule = (
            f"is no damage state; they are {', '.join(states)}, or their numbers from 0"
        )
        words = {w: -code for w, code in words.items() if code > 1 and w.isalpha()}
        words |= {str(n): n for n in range(len(states))}
        words |= {_plain(state): n for n, state in enumerate(states)}
    elif _plain(given.heads[what]) in _SURVIVED_NAMES:  # there a 1 is a survival
        words = _WORDS | _SURVIVED_CODES
    found = given.read(
        what, lambda cell: words.get(_plain(cell).removesuffix(".0")), rule
    )
    if what == "verdict":
        return {"code": found}
    code = np.where(found < 0, -found, found == len(states) - 1)
    return {"code": code, "damage": found.clip(lower=0)}


def _units(
    given: VerdictTable, measure: str | None, unit: str | None
) -> tuple[str, str, dict[str, float]]:
    """Return the measure, the unit of the levels, and each column's unit in multiples of it.

    The unit of the levels is that of the first column of intensities. `measure` and `unit` are
    those of the user, for columns that state none. InputError if none is known, or if two
    disagree.
    """
    found = dict[str, tuple[str, str]]()
    for end in filter(given.heads.get, _NONE):
        head = given.heads[end]
        where = f"{given.source}: column {head!r}"
        own, own_unit = _stated(head)
        own = own if measure_of(own) else ""
        for name, stated, asked in (
            ("measure", own, measure),
            ("unit", own_unit, unit),
        ):
            if stated and asked and stated != asked:
                rule = f"states {stated}, but {name} is {asked}; leave {name} out"
                raise InputError(f"{where} {rule}")
            if not (stated or asked):
                raise InputError(
                    f"{where} states no {name}; name it as `PGA [g]`, or give {name}"
                )
        found[end] = str(own or measure), str(own_unit or unit)
    (measure, unit), *others = found.values()
    for other, _ in others:
        if other != measure:
            raise InputError(f"{given.source}: brackets are of {measure} and {other}")
    with at(given.source):
        allowed = LEVEL_UNITS.get(measure_unit(measure), {})
        for end, (_, stated) in found.items():
            if stated not in allowed:
                rule = (
                    f"unit {stated} must be one of {', '.join(allowed)} for {measure}"
                )
                raise InputError(f"column {given.heads[end]!r}: {rule}")
    return (
        measure,
        unit,
        {end: allowed[each] / allowed[unit] for end, (_, each) in found.items()},
    )


def _cube(
    given: VerdictTable, runs: pd.DataFrame, study: StudyKeys, states: Sequence[str]
) -> xr.Dataset:
    """Return the cube of the runs, in the form of `archfrag.study.answer.cube.open_cube`."""
    intensity = study.intensity
    regular = study.design.on_levels
    arches, records = (runs.drop_duplicates(name) for name in ("arch", "record"))
    numbers = runs[["arch", "record", "code", *{"damage"} & {*runs}]].assign(
        intensity=runs["level"] * intensity.factor,
        level=np.searchsorted(intensity.given, runs["level"]) * regular,
        scale_factor=pd.to_numeric(runs["scale"], errors="coerce"),
    )
    cells = numbers.set_index(["arch", "record", "level"]).astype(float).to_xarray()
    cells = cells.sel(arch=arches["arch"].tolist(), record=records["record"].tolist())
    codes = {each.name.lower(): int(each) for each in Verdict}
    flags = {"flag_values": list(codes.values()), "flag_meanings": " ".join(codes)}
    verdict = cells["code"].fillna(Verdict.NOT_RUN).astype("i1").assign_attrs(flags)
    # Any level above 0 where there is no run.
    im = cells["intensity"].fillna(intensity.si[0])
    if regular:
        im = xr.DataArray(np.array(intensity.si), dims="level")
    own = {"measure": intensity.measure, "units": measure_unit(intensity.measure)}
    classes = arches["arch_class"].where(arches["arch_class"] != "", arches["arch"])
    variables: Named = {
        "verdict": verdict,
        "intensity": im.assign_attrs(own),
        "event": ("record", records["event"].tolist()),
        "arch_class": ("arch", classes.tolist()),
        "scale_factor": cells["scale_factor"],
        **{
            name: verdict.copy(data=np.full(verdict.shape, none))
            for name, none in BLANK.items()
        },
    }
    if _plain(given.heads.get("arch_class", "")) == "stock":
        named = arches["arch"].where(arches["arch_class"] != "", "")
        variables["stock_row"] = "arch", named.tolist()
    if "damage" in cells:
        damage = cells["damage"].fillna(-1).astype("i2")
        variables["damage"] = damage.assign_attrs(states=strict_json(states))
    digest = digest_of(given.cells[[*given.heads]].to_dict("list"))
    return xr.Dataset(
        variables,
        attrs={
            "title": study.title,
            "archfrag_study": study.id,
            "archfrag_design": strict_json(study.design.model_dump(mode="json")),
            "archfrag_commit": "none: of a table",
            "table_sha256": digest,
            "table_source": given.source,
        },
    )
