"""The cube in long form: a row for each run that was simulated."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from archfrag.export.tables import Described, Table
from archfrag.fragility.counts import Verdict

PIECE = 20_000  # runs held at a time: some ten megabytes
_RUN = ("arch", "record", "level")
# Text of records and arches that groups runs; other text would be repeated in every row.
_GROUPS = ("arch", "record", "event", "arch_class")


def runs_table(cube: xr.Dataset, piece: int = PIECE) -> Table:
    """All values of all runs, read from the cube in pieces.

    Values of a record, an arch or a level stand in each of their runs; text about a record but
    its event is in the table of records. Values by model or measure have a column for each.
    """
    columns = {
        name: described
        for variable in _run_variables(cube)
        for name, described in _describe(cube, variable)
    }
    return Table("runs", columns, _pieces(cube, piece))


def facts_table(cube: xr.Dataset, dimension: str) -> Table:
    """What the cube holds of each record, or of each arch."""
    columns: dict[str, Described] = {}
    values: dict[str, NDArray] = {}
    for name in sorted(map(str, cube.variables), key=dimension.__ne__):
        variable = cube.variables[name]
        if [d for d in variable.dims if d in _RUN] != [dimension]:
            continue
        described = _describe(cube, name)
        wide = variable.transpose(dimension, ...).values.reshape(cube.sizes[dimension], -1)
        columns |= dict(described)
        values |= {each: wide[:, n] for n, (each, _) in enumerate(described)}
    plural = {"arch": "arches", "record": "records"}[dimension]
    return Table(plural, columns, [pd.DataFrame(values)])


def _run_variables(cube: xr.Dataset) -> list[str]:
    """Variables that have one value, or one for each label of another dimension, in a run."""
    found = []
    for name, variable in cube.variables.items():
        own = [d for d in variable.dims if d in _RUN]
        summary = own == ["arch", "level"]  # a count over records
        text = variable.dtype.kind in "OSU" and name not in _GROUPS
        if own and not summary and not text:
            found.append(str(name))
    first = [*_RUN, "intensity"]
    return [*first, *(name for name in found if name not in first)]


def _describe(cube: xr.Dataset, name: str) -> list[tuple[str, Described]]:
    """Columns that a variable becomes."""
    variable = cube.variables[name]
    about = variable.attrs
    codes = None
    if "flag_meanings" in about:
        values = np.atleast_1d(about["flag_values"]).tolist()
        codes = dict(zip(about["flag_meanings"].split(), values))
    text = ". ".join(filter(None, (about.get("long_name", name), about.get("comment", ""))))
    described = Described(text, str(about.get("units", "")), codes)
    other = [str(d) for d in variable.dims if d not in _RUN]
    if not other:
        return [(name, described)]
    labels, units = cube[other[0]].values, [described.unit] * cube.sizes[other[0]]
    if f"{other[0]}_units" in cube:
        units = cube[f"{other[0]}_units"].values.astype(str).tolist()
    return [(f"{name}_{each}", described._replace(unit=unit)) for each, unit in zip(labels, units)]


def _pieces(cube: xr.Dataset, piece: int) -> Iterator[pd.DataFrame]:
    names = _run_variables(cube)
    n_arch, n_record = cube.sizes["arch"], cube.sizes["record"]
    arches, records = _steps(cube, piece)
    for first in range(0, max(n_arch, 1), arches):
        for start in range(0, max(n_record, 1), records):
            block = cube.isel(
                arch=slice(first, first + arches), record=slice(start, start + records)
            )
            yield _rows(block, names)


def _steps(cube: xr.Dataset, piece: int) -> tuple[int, int]:
    """Arches and records in a piece: full chunks of the file, so that each is read once."""
    chunks = dict(zip(_RUN, cube["verdict"].encoding.get("chunksizes") or (1, 1, 1)))
    n_level = max(cube.sizes["level"], 1)
    arches = chunks["arch"] if chunks["arch"] * n_level <= piece else 1
    records = max(piece // (arches * n_level), 1)
    if records > chunks["record"]:
        records -= records % chunks["record"]
    return arches, records


def _rows(block: xr.Dataset, names: list[str]) -> pd.DataFrame:
    columns = {}
    for name in names:
        variable = block.variables[name]
        other = [d for d in variable.dims if d not in _RUN]
        for n, (column, _) in enumerate(_describe(block, name)):
            columns[column] = variable.isel(dict.fromkeys(other, n))
    frame = xr.Dataset(columns).to_dataframe(dim_order=list(_RUN)).reset_index()
    return frame[frame["verdict"] != Verdict.NOT_SIMULATED].reset_index(drop=True)
