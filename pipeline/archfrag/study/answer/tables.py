"""Tables of runs, records and arches, with a description of each column, and in a code's words."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.files import Named
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import collapse_rate
from archfrag.fragility.verdicts import Verdict
from archfrag.study.answer.rates import StudyRisk
from archfrag.study.file.schema import CodeKeys

PIECE = 20_000  # runs held at a time: some ten megabytes
_RUN = ("arch", "record", "level")
# Text of records and arches that groups runs; other text would be repeated in every row.
_GROUPS = ("arch", "record", "event", "arch_class")
# What each column is: `about`, and where they apply `unit` (CF's spelling) and `codes` by meaning.
Columns = dict[str, Named]
# A table in pieces of the same columns. There is at least one piece; it may have no row.
Pieces = tuple[Columns, Iterable[pd.DataFrame]]


def runs_table(cube: xr.Dataset, piece: int = PIECE) -> Pieces:
    """Return a table of all values of all runs, read from the cube a few arches at a time.

    A value of a record, an arch or a level is repeated in each of its runs. Of the texts about a
    record, only the event is there. A value by model or measure has a column for each. `piece` is
    the number of runs to hold at a time.
    """
    names = []
    for name in dict.fromkeys((*_RUN, "intensity", *map(str, cube.variables))):
        variable = cube.variables[name]
        own = [d for d in variable.dims if d in _RUN]
        if (
            own
            and own != ["arch", "level"]
            and not (
                variable.dtype.kind in "OSU" and name not in _GROUPS and own[1:] == []
            )
        ):  # of arch and level: counts of records
            names.append(name)
    columns, values = _columns(cube, names)

    def pieces() -> Iterator[pd.DataFrame]:
        n_arch, n_record, n_level = (cube.sizes[name] for name in _RUN)
        at_once = max(piece // max(n_record * n_level, 1), 1)
        stored = (cube["verdict"].encoding.get("chunksizes") or (1,))[
            0
        ]  # each chunk is read once
        at_once = -(-at_once // stored) * stored
        for first in range(0, max(n_arch, 1), at_once):
            some = xr.Dataset(values).isel(arch=slice(first, first + at_once))
            frame = some.to_dataframe(dim_order=list(_RUN)).reset_index()[list(columns)]
            yield frame[frame["verdict"] != Verdict.NOT_RUN].reset_index(drop=True)

    return columns, pieces()


def facts_table(cube: xr.Dataset, dimension: str) -> Pieces:
    """Return a table of the values of each record or each arch.

    `dimension` is "record" or "arch".
    """
    columns, values = _columns(
        cube,
        [
            name
            for name in sorted(map(str, cube.variables), key=dimension.__ne__)
            if [d for d in cube.variables[name].dims if d in _RUN] == [dimension]
        ],
    )
    return columns, [pd.DataFrame({name: each.values for name, each in values.items()})]


def _columns(
    cube: xr.Dataset, names: Iterable[str]
) -> tuple[Columns, dict[str, xr.Variable]]:
    """Return the descriptions of the columns of variables, and their values.

    A variable with a further dimension, such as measure, has a column for each label of it.
    """
    columns = Columns()
    values = dict[str, xr.Variable]()
    for name in names:
        variable = cube.variables[name]
        codes = {}
        attrs = variable.attrs
        if "flag_meanings" in attrs:
            codes = dict(
                zip(
                    attrs["flag_meanings"].split(),
                    np.ravel(attrs["flag_values"]).tolist(),
                )
            )
        text = ". ".join(
            filter(None, (attrs.get("long_name", name), attrs.get("comment", "")))
        )
        unit = str(attrs.get("units", ""))
        other = [str(d) for d in variable.dims if d not in _RUN]
        if not other:
            columns[name] = about_column(text, unit, codes)
            values[name] = variable
            continue
        of_each = cube.get(f"{other[0]}_unit")
        for n, label in enumerate(cube[other[0]].values):
            unit = unit if of_each is None else str(of_each.values[n])
            columns[f"{name}_{label}"] = about_column(text, unit, codes)
            values[f"{name}_{label}"] = variable.isel({other[0]: n})
    return columns, values


def about_column(text: str, unit: str, codes: Mapping[str, int] | None = None) -> Named:
    """Return text, unit and codes of a column, without those that are empty."""
    facts = {"about": text, "unit": unit, "codes": codes}
    return {key: value for key, value in facts.items() if value}


_USE = {"I": 0.7, "II": 1.0, "III": 1.5, "IV": 2.0}  # C_U, table 2.4.II
_EXCEEDED = {"SLV": 0.10, "SLC": 0.05}  # P_VR
_PERIODS = {"SD": 475.0, "NC": 2475.0}  # [years]
CODE_COLUMNS = (
    "arch",
    "code_state",
    "return_period",
    "demand",
    "limit_state",
    "probability",
    "capacity",
    "ratio",
    "rate",
    "rate_is_lower_bound",
)


def return_periods(code: CodeKeys) -> dict[str, float]:
    """Return the return periods of the limit states of a code [years]."""
    if code.norm == "eurocode8":
        return dict(_PERIODS)
    life = _USE[code.use_class] * code.life
    return {name: -life / np.log1p(-p) for name, p in _EXCEEDED.items()}


def code_table(
    curves: Mapping[str, Curve], risk: StudyRisk, code: CodeKeys
) -> pd.DataFrame:
    """Return a row for each arch, limit state of the code, and limit state that has a curve.

    `curves` have intensities in one unit, in which demand and capacity are given. The demand is
    the hazard curve's intensity, nan beyond its points; the capacity is the largest intensity at
    which the curve's probability is at most that of `code`. `ratio` is capacity over demand,
    `rate` the annual rate at which the limit state is exceeded [1/year].

    NTC 2018 (D.M. 17 January 2018), 2.4 and table 3.2.I: T_R = -V_R / ln(1 - P_VR), V_R = C_U
    V_N, P_VR = 10 % (SLV) and 5 % (SLC). EN 1998-3:2005, 2.1(3), recommends 475 (SD) and 2475
    years (NC); national annexes may differ. NTC 2018, 8.3, calls capacity over demand zeta_E,
    as the guidelines for bridges of 2020 (D.M. 578/2020) do. Neither gives a fragility curve or
    a probability at the capacity.
    """
    rows = list[tuple]()
    for name, curve in curves.items():
        arch = risk.arches[name]
        if isinstance(arch, str):
            continue
        of_si = arch.fit.limit_states
        for state, own in curve.limit_states.items():
            onset = arch.onset if own.members is not None else np.min(arch.onset)
            rate = collapse_rate(risk.hazard.main, of_si[state], onset=onset)
            capacity = float(own.quantile(code.probability))
            for word, years in return_periods(code).items():
                demand = float(risk.hazard.main.level_of(years)) / own.si
                site = name, word, years, demand
                allowed = state, code.probability, capacity, capacity / demand
                rows.append((*site, *allowed, rate.quoted, rate.is_bound))
    return pd.DataFrame(rows, columns=list(CODE_COLUMNS))
