"""Tables written piece by piece as CSV or Parquet, completely or not at all."""

import contextlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from archfrag.errors import InputError
from archfrag.study.files import replacing


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


def write_csv(table: Table, path: Path) -> None:
    """Write a table as CSV: header, UTF-8, numbers to their last bit, nothing where none is."""
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        for number, piece in enumerate(table.pieces):
            piece.to_csv(file, index=False, header=number == 0, lineterminator="\n")


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
