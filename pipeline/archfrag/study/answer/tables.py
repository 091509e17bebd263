"""Tables of the runs, records and arches of a cube, with a description of each column."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.files import Named
from archfrag.fragility.verdicts import Verdict

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
