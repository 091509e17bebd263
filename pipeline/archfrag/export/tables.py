"""Tables of curves, runs, records and arches, written as CSV or Parquet."""

import contextlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import InputError
from archfrag.export.curve_set import CurveSet
from archfrag.files import replacing
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import Fragility
from archfrag.study.answer.curves import Answer

PIECE = 20_000  # runs held at a time: some ten megabytes
_POINTS = 211
_RUN = ("arch", "record", "level")
# Text of records and arches that groups runs; other text would be repeated in every row.
_GROUPS = ("arch", "record", "event", "arch_class")


class Column(NamedTuple):
    """A column of a table: what it is, its unit (CF's spelling), its codes by meaning."""

    about: str
    unit: str = ""
    codes: dict[str, int] | None = None

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON, without what does not apply."""
        return {key: value for key, value in self._asdict().items() if value}


class Table(NamedTuple):
    """A table in pieces of the same columns; at least one piece, which may have no row."""

    name: str
    columns: dict[str, Column]
    pieces: Iterable[pd.DataFrame]

    @property
    def facts(self) -> dict[str, dict[str, Any]]:
        """Descriptions of the columns, for JSON."""
        return {name: column.facts for name, column in self.columns.items()}


class Unit(NamedTuple):
    """Units of intensities: the study's and SI, with the factor from SI to the study's."""

    given: str
    si: str
    factor: float


def require_pyarrow() -> tuple[Any, Any]:
    """pyarrow and its module of Parquet."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "format parquet needs pyarrow, which is not installed: `pip install "
            "'archfrag[parquet]'`; csv holds the same tables"
        ) from None
    return pyarrow, pyarrow.parquet


def write_parquet(table: Table, path: Path, facts: dict[str, Any]) -> None:
    """Write a table as Parquet, a row group for each piece; completely or not at all."""
    arrow, parquet = require_pyarrow()
    about = json.dumps(facts | {"columns": table.facts}, ensure_ascii=False)
    with contextlib.ExitStack() as stack:
        temporary = stack.enter_context(replacing(path))
        writer = None
        for piece in table.pieces:
            rows = arrow.Table.from_pandas(piece, preserve_index=False)
            if writer is None:
                schema = rows.schema.with_metadata({"archfrag": about})
                writer = stack.enter_context(parquet.ParquetWriter(temporary, schema))
            writer.write_table(rows.cast(schema))


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
    curves: CurveSet, answers: Mapping[str, Answer], unit: Unit
) -> tuple[Table, Table]:
    """Points and parameters of all curves.

    Bands of collapse are those that the report quotes; those of other limit states are from the
    covariance of the fit.
    """
    levels = np.linspace(0.0, 1.05 * curves.levels[1], _POINTS)
    confidence = next(iter(answers.values())).confidence
    points, parameters = [], []
    for arch, states in curves.curves.items():
        for state, fit in states.items():
            if not isinstance(fit, Fragility):
                continue
            labels = {"arch": arch, "limit_state": state, "measure": curves.measure}
            known = answers[arch]
            lower, upper = (np.interp(levels, known.im, end) for end in (known.lower, known.upper))
            if state != "collapse":
                ends = fit.theta_interval(confidence), fit.beta_interval(confidence)
                known = Answer(fit, fit, *ends, method="covariance of the fit")
                lower, upper = fit.band(levels, confidence)
            values = {
                "im": levels * unit.factor, "unit": unit.given, "intensity": levels,
                "probability": fit.probability(levels), "lower": lower, "upper": upper,
            }  # fmt: skip
            points.append(pd.DataFrame(labels | values))
            row: dict[str, Any] = {name: f(fit, known) for name, (_, _, f) in _PARAMETER.items()}
            row |= {k: unit.factor * row[k] for k, f in _PARAMETER.items() if f[1] == "given"}
            parameters.append(labels | row | {"unit": unit.given})
    units = {"given": unit.given, "si": unit.si}
    about, stated = (
        {
            name: Column(text.format(percent=f"{100 * confidence:g} %"), units.get(of, of))
            for name, (text, of, *_) in (_LABELS | columns).items()
        }
        for columns in (_POINT, _PARAMETER)
    )
    return (
        Table("curves", about, points or [pd.DataFrame(columns=list(about))]),
        Table("parameters", stated, [pd.DataFrame(parameters, columns=list(stated))]),
    )


def runs_table(cube: xr.Dataset, piece: int = PIECE) -> Table:
    """All values of all runs, read from the cube in pieces of some arches.

    Values of a record, an arch or a level stand in each of their runs; text about a record but
    its event is in the table of records. Values by model or measure have a column for each.
    """
    columns: dict[str, tuple[Column, xr.Variable]] = {}
    for name in dict.fromkeys((*_RUN, "intensity", *map(str, cube.variables))):
        variable = cube.variables[name]
        own = [d for d in variable.dims if d in _RUN]
        text = variable.dtype.kind in "OSU" and name not in _GROUPS
        if own and own != ["arch", "level"] and not text:  # of arch and level: counts of records
            columns |= _columns(cube, name)

    def pieces() -> Iterator[pd.DataFrame]:
        n_arch, n_record, n_level = (cube.sizes[name] for name in _RUN)
        at_once = max(piece // max(n_record * n_level, 1), 1)
        stored = (cube["verdict"].encoding.get("chunksizes") or (1,))[0]  # each chunk is read once
        at_once = -(-at_once // stored) * stored
        for first in range(0, max(n_arch, 1), at_once):
            some = xr.Dataset({name: variable for name, (_, variable) in columns.items()})
            some = some.isel(arch=slice(first, first + at_once))
            frame = some.to_dataframe(dim_order=list(_RUN)).reset_index()[list(columns)]
            yield frame[frame["verdict"] != Verdict.NOT_SIMULATED].reset_index(drop=True)

    return Table("runs", {name: about for name, (about, _) in columns.items()}, pieces())


def facts_table(cube: xr.Dataset, dimension: str) -> Table:
    """What the cube holds of each record, or of each arch."""
    found: dict[str, tuple[Column, xr.Variable]] = {}
    for name in sorted(map(str, cube.variables), key=dimension.__ne__):
        if [d for d in cube.variables[name].dims if d in _RUN] == [dimension]:
            found |= _columns(cube, name)
    frame = pd.DataFrame({name: variable.values for name, (_, variable) in found.items()})
    plural = {"arch": "arches", "record": "records"}[dimension]
    return Table(plural, {name: about for name, (about, _) in found.items()}, [frame])


def _columns(cube: xr.Dataset, name: str) -> dict[str, tuple[Column, xr.Variable]]:
    """Columns that a variable becomes: one, or one for each label of its other dimension."""
    variable = cube.variables[name]
    about, codes = variable.attrs, None
    if "flag_meanings" in about:
        values = np.atleast_1d(about["flag_values"]).tolist()
        codes = dict(zip(about["flag_meanings"].split(), values))
    text = ". ".join(filter(None, (about.get("long_name", name), about.get("comment", ""))))
    column = Column(text, str(about.get("units", "")), codes)
    other = [str(d) for d in variable.dims if d not in _RUN]
    if not other:
        return {name: (column, variable)}
    labels, units = cube[other[0]].values, [column.unit] * cube.sizes[other[0]]
    if f"{other[0]}_units" in cube:
        units = cube[f"{other[0]}_units"].values.astype(str).tolist()
    return {
        f"{name}_{label}": (column._replace(unit=unit), variable.isel({other[0]: n}))
        for n, (label, unit) in enumerate(zip(labels, units))
    }
