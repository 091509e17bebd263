"""Tables of the evidence on disk: CSV to read, netCDF to keep, both with where they come from."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from archfrag.errors import InputError
from archfrag.study.files import replacing
from archfrag.study.provenance import commit, machine, strict_json, versions


def save(
    folder: Path, part: str, frames: Mapping[str, pd.DataFrame], facts: Mapping[str, object]
) -> list[Path]:
    """Write a part's tables, each whole or not at all.

    Parameters
    ----------
    folder : Path
        Of the evidence; the tables go to its folder `part`.
    part : str
    frames : mapping of str to DataFrame
    facts : mapping
        What was asked for; goes into the netCDF files beside versions, commit and machine.

    Returns
    -------
    list of Path
    """
    home = folder / part
    home.mkdir(parents=True, exist_ok=True)
    written = []
    when = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    for name, frame in frames.items():
        with replacing(home / f"{name}.csv") as temporary:
            frame.to_csv(temporary, index=False)
        table = frame.copy()
        for column in table.columns:
            if not pd.api.types.is_numeric_dtype(table[column]):
                table[column] = table[column].astype(str)
        data = xr.Dataset.from_dataframe(table.rename_axis("row"))
        data.attrs = {
            "title": f"archfrag evidence: {part}, {name}",
            "created": when,
            "archfrag_arguments": strict_json(dict(facts)),
            "archfrag_versions": strict_json(versions()),
            "archfrag_commit": commit(),
            "archfrag_machine": strict_json(machine()),
        }
        with replacing(home / f"{name}.nc") as temporary:
            data.to_netcdf(temporary)
        written += [home / f"{name}.csv", home / f"{name}.nc"]
    return written


def load(folder: Path, part: str) -> dict[str, pd.DataFrame]:
    """A part's tables as they were saved; none if it was not measured.

    Raises
    ------
    InputError
        If a table cannot be read.
    """
    frames = {}
    for path in sorted((folder / part).glob("*.csv")):
        try:
            frames[path.stem] = pd.read_csv(path, keep_default_na=True)
        except (OSError, ValueError) as error:
            raise InputError(f"{path} is no table of the evidence: {error}") from error
    return frames
