"""Tables written as CSV or Parquet, completely or not at all; the tables of curves."""

import contextlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from archfrag.errors import InputError
from archfrag.export.curve_set import CurveSet
from archfrag.files import replacing
from archfrag.fragility.bands import beta_interval, confidence_band, theta_interval
from archfrag.fragility.curve import Fragility
from archfrag.study.curves import Answer

_COVARIANCE = "covariance of the fit"
_POINTS = 211


class Described(NamedTuple):
    """A column of a table: what it is, its unit (CF's spelling), its codes by meaning."""

    about: str
    unit: str = ""
    codes: dict[str, int] | None = None

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON, without what does not apply."""
        facts = {"about": self.about, "unit": self.unit, "codes": self.codes}
        return {key: value for key, value in facts.items() if value}


class Table(NamedTuple):
    """A table in pieces of the same columns; at least one piece, which may have no row."""

    name: str
    columns: dict[str, Described]
    pieces: Iterable[pd.DataFrame]


def write_parquet(table: Table, path: Path, facts: dict[str, Any]) -> None:
    """Write a table as Parquet, a row group for each piece."""
    arrow, parquet = require_pyarrow()
    about = json.dumps(facts | {"columns": column_facts(table)}, ensure_ascii=False)
    with contextlib.ExitStack() as stack:
        temporary = stack.enter_context(replacing(path))
        writer = None
        for piece in table.pieces:
            rows = arrow.Table.from_pandas(piece, preserve_index=False)
            if writer is None:
                schema = rows.schema.with_metadata({"archfrag": about})
                writer = stack.enter_context(parquet.ParquetWriter(temporary, schema))
            writer.write_table(rows.cast(schema))


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


def column_facts(table: Table) -> dict[str, dict[str, Any]]:
    """Descriptions of the columns for JSON."""
    return {name: column.facts for name, column in table.columns.items()}


class Unit(NamedTuple):
    """Units of intensities: the study's and SI, with the factor from SI to the study's."""

    given: str
    si: str
    factor: float


_LABELS = {
    "arch": Described("name of the arch, or of the class of arches"),
    "limit_state": Described("limit state; states go from the mildest to the severest"),
    "measure": Described("intensity measure"),
}


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
                ends = theta_interval(fit, confidence), beta_interval(fit, confidence)
                known = Answer(fit, fit, *ends, method=_COVARIANCE)
                band = confidence_band(fit, levels, confidence)
                lower, upper = band.lower, band.upper
            values = {
                "im": levels * unit.factor, "unit": unit.given, "intensity": levels,
                "probability": fit.probability(levels), "lower": lower, "upper": upper,
            }  # fmt: skip
            points.append(pd.DataFrame(labels | values))
            parameters.append(labels | _parameters(fit, known, unit))
    about, stated = _point_columns(unit, confidence), _parameter_columns(unit, confidence)
    return (
        Table("curves", about, points or [pd.DataFrame(columns=list(about))]),
        Table("parameters", stated, [pd.DataFrame(parameters, columns=list(stated))]),
    )


def _parameters(fit: Fragility, known: Answer, unit: Unit) -> dict[str, object]:
    likeliest = known.likelihood if isinstance(known.likelihood, Fragility) else None
    return {
        "theta": fit.theta * unit.factor, "theta_lower": known.theta[0] * unit.factor,
        "theta_upper": known.theta[1] * unit.factor, "unit": unit.given, "theta_si": fit.theta,
        "beta": fit.beta, "beta_lower": known.beta[0], "beta_upper": known.beta[1],
        "theta_maximum_likelihood": likeliest.theta * unit.factor if likeliest else np.nan,
        "beta_maximum_likelihood": likeliest.beta if likeliest else np.nan,
        "standard_error_ln_theta": fit.standard_errors[0],
        "standard_error_beta": fit.standard_errors[1],
        "correlation_ln_theta_beta": fit.correlation, "runs": fit.n_total, "kind": fit.kind,
        "band": known.method,
    }  # fmt: skip


def _point_columns(unit: Unit, confidence: float) -> dict[str, Described]:
    percent = f"{100 * confidence:g} % band at each level"
    return _LABELS | {
        "im": Described("intensity in the unit of the study", unit.given),
        "unit": Described("unit of im"),
        "intensity": Described("the same intensity in SI, as in the table of runs", unit.si),
        "probability": Described("probability of exceeding the limit state", "1"),
        "lower": Described(f"lower end of the {percent}", "1"),
        "upper": Described(f"upper end of the {percent}", "1"),
    }


def _parameter_columns(unit: Unit, confidence: float) -> dict[str, Described]:
    ends = f"of the {100 * confidence:g} % interval of"
    return _LABELS | {
        "theta": Described("median capacity", unit.given),
        "theta_lower": Described(f"lower end {ends} theta", unit.given),
        "theta_upper": Described(f"upper end {ends} theta", unit.given),
        "unit": Described("unit of theta, theta_lower and theta_upper"),
        "theta_si": Described("median capacity in SI", unit.si),
        "beta": Described("standard deviation of the logarithm of capacity", "1"),
        "beta_lower": Described(f"lower end {ends} beta", "1"),
        "beta_upper": Described(f"upper end {ends} beta", "1"),
        "theta_maximum_likelihood": Described("by maximum likelihood", unit.given),
        "beta_maximum_likelihood": Described("by maximum likelihood", "1"),
        "standard_error_ln_theta": Described("from the covariance of the fit", "1"),
        "standard_error_beta": Described("from the covariance of the fit", "1"),
        "correlation_ln_theta_beta": Described("of the two estimates", "1"),
        "runs": Described("runs or records that were used", "1"),
        "kind": Described("kind of the fit"),
        "band": Described("what bands and intervals are from"),
    }
