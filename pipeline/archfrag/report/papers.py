"""Plain tables beside the report: capacities, runs in words, and what each file is."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.files import write_csv
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.tables import runs_table
from archfrag.study.provenance import README, write_text
from archfrag.version import __version__

RUN_COLUMNS = (
    "arch",
    "arch_class",
    "record",
    "event",
    "magnitude",
    "distance",
    "intensity",
    "scale_factor",
    "verdict",
    "collapse_mode",
    "collapse_joint",
    "collapse_time",
    "lost_contact_time",
    "lost_contact_joint",
    "peak_rotation",
    "residual_rotation",
    "peak_displacement",
    "residual_displacement",
    "impacts",
    "openings",
    "slides",
    "end_time",
    "status",
    "energy_error",
    "moving_before",
)
_HEAD = "Results of archfrag"
_FILES = (
    Path(__file__).with_name("readme.txt").read_text("utf-8")
)  # what each of them is


def write_papers(
    fitted: Fitted, measure: str, unit: str, factor: float, folder: Path
) -> None:
    """Write ``capacities.csv``, ``runs.csv`` and ``README.txt``; an SI level times `factor` is in
    `unit`. A README of somebody else is left alone.
    """
    units = {name: f"{name} [{unit}]" for name in ("lower", "upper", "capacity")}
    cube = fitted.cube
    table = fitted.capacities(factor).rename(columns=units).replace(np.inf, np.nan)
    runs = runs_in_words(cube, f"{measure} [{unit}]", factor)
    for name, pieces in (("capacities.csv", [table]), ("runs.csv", runs)):
        write_csv(folder / name, pieces, float_format="%.7g")
    path = folder / README
    if not path.is_file() or path.read_bytes().startswith(_HEAD.encode()):
        title, study = (cube.attrs.get(key, "") for key in ("title", "archfrag_study"))
        about = f"{_HEAD} {__version__}: {title} (study {study})\nIntensities are "
        write_text(path, f"{about}{measure} [{unit}].\n\n{_FILES}")


def runs_in_words(
    cube: xr.Dataset, intensity: str, factor: float
) -> Iterator[pd.DataFrame]:
    """Yield the runs in pieces, with words for codes and units in the names."""
    about, pieces = runs_table(cube)
    units = {
        name: about[name].get("unit", "1") for name in RUN_COLUMNS if name in about
    }
    names = {
        name: name if unit == "1" else f"{name} [{unit}]"
        for name, unit in units.items()
    }
    names["intensity"] = intensity
    for piece in pieces:
        own: dict[str, Any] = {
            "intensity": [_stated(si, factor) for si in piece["intensity"]]
        }
        for name in names:
            if codes := about[name].get("codes"):
                words = {code: word.replace("_", " ") for word, code in codes.items()}
                own[name] = piece[name].map(words)
            elif name.endswith("_joint"):
                own[name] = piece[name].where(piece[name] >= 0).astype("Int64")
        yield piece.assign(**own)[list(names)].rename(columns=names)


def _stated(si: float, factor: float) -> str:
    """Write an SI level times `factor` as a study gives it, or in full."""
    short = f"{factor * si:.12g}"
    return short if float(short) * (1.0 / factor) == si else repr(float(factor * si))
