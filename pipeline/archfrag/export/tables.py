"""Tables of curves, runs, records and arches, written as CSV or Parquet."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import from_extra
from archfrag.export import CurveSet
from archfrag.files import replacing
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import Fragility
from archfrag.study.answer.curves import Answer

PIECE = 20_000  # runs held at a time: some ten megabytes
_POINTS = 211
_RUN = ("arch", "record", "level")
# Text of records and arches that groups runs; other text would be repeated in every row.
_GROUPS = ("arch", "record", "event", "arch_class")
# What each column is: `about`, and where they apply `unit` (CF's spelling) and `codes` by meaning.
Columns = dict[str, dict[str, Any]]


class Table(NamedTuple):
    """A table in pieces of the same columns; at least one piece, which may have no row."""

    columns: Columns
    pieces: Iterable[pd.DataFrame]


def write_parquet(table: Table, path: Path, facts: dict[str, Any]) -> None:
    """Write a table as Parquet, a row group for each piece; completely or not at all."""
    arrow, parquet = (from_extra(name, "parquet") for name in ("pyarrow", "pyarrow.parquet"))
    about = json.dumps(facts | {"columns": table.columns}, ensure_ascii=False)
    pieces = (arrow.Table.from_pandas(each, preserve_index=False) for each in table.pieces)
    first = next(pieces)
    schema = first.schema.with_metadata({"archfrag": about})
    with replacing(path) as temporary, parquet.ParquetWriter(temporary, schema) as writer:
        writer.write_table(first.cast(schema))
        for piece in pieces:
            writer.write_table(piece.cast(schema))


# Columns of the tables of curves: what they are and in which unit, which is "given" or "si" for
# intensities. In a text, {percent} is the confidence. Of parameters also how the value follows
# from the curve and the answer that it belongs to, before its unit is changed to the study's.
_LABELS = {
    "arch": ("name of the arch, or of the class of arches", ""),
    "limit_state": ("limit state; states go from the mildest to the severest", ""),
    "measure": ("intensity measure", ""),
}
_POINT = {
    "im": ("intensity in the unit of the study", "given"),
    "unit": ("unit of im", ""),
    "intensity": ("the same intensity in SI, as in the table of runs", "si"),
    "probability": ("probability of exceeding the limit state", "1"),
    "lower": ("lower end of the {percent} band at each level", "1"),
    "upper": ("upper end of the {percent} band at each level", "1"),
}
_PARAMETER: dict[str, tuple[str, str, Callable[[Fragility, Answer], object]]] = {
    "theta": ("median capacity", "given", lambda fit, _: fit.theta),
    "theta_lower": ("lower end of the {percent} interval of theta", "given",
                    lambda _, known: known.theta[0]),
    "theta_upper": ("upper end of the {percent} interval of theta", "given",
                    lambda _, known: known.theta[1]),
    "unit": ("unit of theta, theta_lower and theta_upper", "", lambda *_: ""),
    "theta_si": ("median capacity in SI", "si", lambda fit, _: fit.theta),
    "beta": ("standard deviation of the logarithm of capacity", "1", lambda fit, _: fit.beta),
    "beta_lower": ("lower end of the {percent} interval of beta", "1",
                   lambda _, known: known.beta[0]),
    "beta_upper": ("upper end of the {percent} interval of beta", "1",
                   lambda _, known: known.beta[1]),
    "theta_maximum_likelihood": ("by maximum likelihood", "given",
                                 lambda _, known: getattr(known.likelihood, "theta", np.nan)),
    "beta_maximum_likelihood": ("by maximum likelihood", "1",
                                lambda _, known: getattr(known.likelihood, "beta", np.nan)),
    "standard_error_ln_theta": ("from the covariance of the fit", "1",
                                lambda fit, _: fit.standard_errors[0]),
    "standard_error_beta": ("from the covariance of the fit", "1",
                            lambda fit, _: fit.standard_errors[1]),
    "correlation_ln_theta_beta": ("of the two estimates", "1", lambda fit, _: fit.correlation),
    "runs": ("runs or records that were used", "1", lambda fit, _: fit.n_total),
    "kind": ("kind of the fit", "", lambda fit, _: fit.kind),
    "band": ("what bands and intervals are from", "", lambda _, known: known.method),
}  # fmt: skip


def curve_tables(
    curves: CurveSet, answers: Mapping[str, Answer], unit: str, si: str, factor: float
) -> dict[str, Table]:
    """Points and parameters of all curves; an intensity in `unit` times `factor` is in `si`.

    Bands of collapse are those that the report quotes; those of other limit states are from the
    covariance of the fit.
    """
    levels = np.linspace(0.0, 1.05 * curves.levels[1], _POINTS)
    confidence = next(iter(answers.values())).confidence
    units, percent = {"given": unit, "si": si}, f"{100 * confidence:g} %"
    about, stated = (
        {
            name: _about(text.format(percent=percent), units.get(of, of))
            for name, (text, of, *_) in (_LABELS | columns).items()
        }
        for columns in (_POINT, _PARAMETER)
    )
    points, parameters = [pd.DataFrame(columns=list(about))], []
    known = [(arch, *each) for arch, states in curves.curves.items() for each in states.items()]
    for arch, state, fit in known:
        if isinstance(fit, str):
            continue
        labels = {"arch": arch, "limit_state": state, "measure": curves.measure, "unit": unit}
        found = answers[arch]
        lower, upper = (np.interp(levels, found.im, end) for end in (found.lower, found.upper))
        if state != "collapse":
            ends = fit.theta_interval(confidence), fit.beta_interval(confidence)
            found = Answer(fit, fit, *ends, method="covariance of the fit")
            lower, upper = fit.band(levels, confidence)
        values = {
            "im": levels / factor, "intensity": levels, "probability": fit.probability(levels),
            "lower": lower, "upper": upper,
        }  # fmt: skip
        points.append(pd.DataFrame(labels | values, columns=list(about)))
        row: dict[str, Any] = {name: value(fit, found) for name, (*_, value) in _PARAMETER.items()}
        row |= {name: row[name] / factor for name, f in _PARAMETER.items() if f[1] == "given"}
        parameters.append(row | labels)
    return {
        "curves": Table(about, points[1:] or points),
        "parameters": Table(stated, [pd.DataFrame(parameters, columns=list(stated))]),
    }


def runs_table(cube: xr.Dataset, piece: int = PIECE) -> Table:
    """All values of all runs, read from the cube in pieces of some arches.

    Values of a record, an arch or a level stand in each of their runs; text about a record but
    its event is in the table of records. Values by model or measure have a column for each.
    """
    columns, values = Columns(), dict[str, xr.Variable]()
    for name in dict.fromkeys((*_RUN, "intensity", *map(str, cube.variables))):
        variable = cube.variables[name]
        own = [d for d in variable.dims if d in _RUN]
        text = variable.dtype.kind in "OSU" and name not in _GROUPS
        if own and own != ["arch", "level"] and not text:  # of arch and level: counts of records
            _add_columns(cube, name, columns, values)

    def pieces() -> Iterator[pd.DataFrame]:
        n_arch, n_record, n_level = (cube.sizes[name] for name in _RUN)
        at_once = max(piece // max(n_record * n_level, 1), 1)
        stored = (cube["verdict"].encoding.get("chunksizes") or (1,))[0]  # each chunk is read once
        at_once = -(-at_once // stored) * stored
        for first in range(0, max(n_arch, 1), at_once):
            some = xr.Dataset(values).isel(arch=slice(first, first + at_once))
            frame = some.to_dataframe(dim_order=list(_RUN)).reset_index()[list(columns)]
            yield frame[frame["verdict"] != Verdict.NOT_SIMULATED].reset_index(drop=True)

    return Table(columns, pieces())


def facts_table(cube: xr.Dataset, dimension: str) -> Table:
    """What the cube holds of each record, or of each arch."""
    columns, values = Columns(), dict[str, xr.Variable]()
    for name in sorted(map(str, cube.variables), key=dimension.__ne__):
        if [d for d in cube.variables[name].dims if d in _RUN] == [dimension]:
            _add_columns(cube, name, columns, values)
    frame = pd.DataFrame({name: variable.values for name, variable in values.items()})
    return Table(columns, [frame])


def _add_columns(
    cube: xr.Dataset, name: str, columns: Columns, values: dict[str, xr.Variable]
) -> None:
    """Add a variable as one column, or as one for each label of its other dimension."""
    variable = cube.variables[name]
    attrs, codes = variable.attrs, {}
    if "flag_meanings" in attrs:
        codes = dict(zip(attrs["flag_meanings"].split(), np.ravel(attrs["flag_values"]).tolist()))
    text = ". ".join(filter(None, (attrs.get("long_name", name), attrs.get("comment", ""))))
    unit = str(attrs.get("units", ""))
    other = [str(d) for d in variable.dims if d not in _RUN]
    if not other:
        columns[name], values[name] = _about(text, unit, codes), variable
        return
    of_each = cube.get(f"{other[0]}_unit")
    for n, label in enumerate(cube[other[0]].values):
        unit = unit if of_each is None else str(of_each.values[n])
        columns[f"{name}_{label}"] = _about(text, unit, codes)
        values[f"{name}_{label}"] = variable.isel({other[0]: n})


def _about(text: str, unit: str, codes: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Facts on a column, without what does not apply."""
    facts = {"about": text, "unit": unit, "codes": codes}
    return {key: value for key, value in facts.items() if value}
