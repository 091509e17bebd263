"""Work of the commands `archfrag records` that is more than one call of `archfrag.motions`."""

import math
import os
import signal
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import counted, opened
from archfrag.study.file.blocks import PERIODS as PERIOD_ENDS
from archfrag.study.provenance import available_cores, finite

if TYPE_CHECKING:
    import pandas as pd

    from archfrag.motions.selection import Selection
    from archfrag.motions.target import Target

_SPECTRAL = r"T(\d+(?:\.\d+)?)S"
_MANY = 32  # files from which processes divide the work


def inspection_facts(found: dict[str, Any]) -> dict[str, Any]:
    """Facts that `inspect_record` found in a file, in SI units, ready for JSON."""
    channels = [
        {key: value for key, value in channel.items() if key != "motion"}
        for channel in found["channels"]
    ]
    return finite(found | {"channels": channels})


def inspection_text(found: dict[str, Any]) -> str:
    """The same as text: a line for each channel and for each fault."""
    from archfrag.arch import STANDARD_GRAVITY

    magnitude = None if found["magnitude"] is None else f"M {found['magnitude']:g}"
    stations = dict.fromkeys(channel["station"] for channel in found["channels"])
    head = (*(found[key] for key in ("format", "event", "date")), magnitude, *list(stations)[:3])
    lines = [f"{found['file']}: {', '.join(part for part in head if part)}"]
    for channel in found["channels"]:
        facts = [f"{channel['count']} samples at {channel['dt']:g} s"]
        facts += [f"{channel['duration']:.2f} s", channel["unit"] or "unit unknown"]
        if channel["PGA"] is not None:
            facts.append(f"PGA {channel['PGA'] / STANDARD_GRAVITY:.4g} g")
        facts += [channel["level"], "vertical" if channel["vertical"] else "", channel["start"]]
        lines.append(f"  {channel['code'] or '(no code)':9s} {', '.join(filter(None, facts))}")
        lines += [f"    ! {fault}" for fault in channel["faults"]]
    return "\n".join([*lines, *(f"  ! {fault}" for fault in found["faults"])])


def reading_of(file: Path, reading: dict[str, Any]) -> dict[str, Any]:
    """Options to read a file with: columns are for plain text only."""
    from archfrag.motions.formats import TEXT, recognise

    if reading["columns"] is None or not file.is_file():
        return reading
    with opened(file) as content:
        binary = b"\0" in content.read(512)
    if binary or recognise(str(file), TEXT):
        return {**reading, "columns": None}
    return reading


def measure_files(
    files: Sequence[Path], out: Path, periods: str | None, reading: dict[str, Any]
) -> "pd.DataFrame":
    """Flatfile of record files, with the options to read them again."""
    import pandas as pd

    from archfrag.motions.partners import vertical_files

    paths = list(dict.fromkeys(files))
    verticals = vertical_files(sorted(paths))
    requested = [path for path in paths if path not in verticals]
    measured = partial(_measured, out=out, periods=_periods(periods), reading=reading)
    workers = available_cores() if len(requested) >= _MANY else 1
    if workers == 1:
        return pd.concat(map(measured, requested), ignore_index=True)
    # Ctrl-C stops the command, not each of its processes.
    ignore = (signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(workers, initializer=signal.signal, initargs=ignore) as pool:
        tables = pool.map(measured, requested, chunksize=8)
        return pd.concat(tables, ignore_index=True)


def _periods(text: str | None) -> list[float]:
    from archfrag.motions.flatfile import PERIODS

    try:
        more = [float(part) for part in text.split(",")] if text else []
    except ValueError:
        raise InputError(f"--periods {text}: numbers with commas between are needed [s]") from None
    low, high = PERIOD_ENDS
    for period in more:
        if not low <= period <= high:
            raise InputError(f"--periods {text}: {period:g} s is outside {low:g} to {high:g} s")
    return sorted({round(period, 3) for period in (*PERIODS, *more)})


def _measured(
    file: Path, out: Path, periods: Sequence[float], reading: dict[str, Any]
) -> "pd.DataFrame":
    """Rows of the components of one file."""
    from archfrag.motions.flatfile import measure_records
    from archfrag.motions.read import read_motions

    reading = reading_of(file, reading)
    name = os.path.relpath(file, out.parent)
    motions = read_motions(file, **reading)
    named = (replace(motion, metadata={**motion.metadata, "file": name}) for motion in motions)
    table = measure_records(named, periods)
    known = {"unit": reading["unit"], "accept": " ".join(reading["accept"]),
             "columns": str(reading["columns"] or "")}  # fmt: skip
    return table.assign(**{key: value for key, value in known.items() if value})


def table_spectra(table: "pd.DataFrame") -> dict[float, NDArray[np.float64]]:
    """Sa [g] of the rows of a flatfile, by period [s]."""
    columns = table.columns.to_series().str.extract(rf"^{_SPECTRAL}$")[0].dropna()
    return {float(period): table[name].to_numpy(float) for name, period in columns.items()}


def select_from(flatfile: Path, options: dict[str, Any]) -> "Selection":
    """Selection of the records of a flatfile by the options of the command."""
    from archfrag.motions.flatfile import read_flatfile
    from archfrag.motions.selection import select_records

    table = read_flatfile(flatfile)
    target = _target(options, sorted(table_spectra(table)))
    return select_records(
        table, target, options["count"], options["seed"],
        max_scale=options["max_scale"], per_event=options["per_event"],
    )  # fmt: skip


def _target(options: dict[str, Any], measured: Sequence[float]) -> "Target":
    """Target at periods that the records were measured at, since between them scatter is lost."""
    from archfrag.motions import target

    scenario = ("magnitude", "distance", "vs30", "period")
    given = [name for name in (*scenario, "sa", "epsilon") if options[name] is not None]
    if options["target"] is not None:
        if given:
            raise InputError(f"--target and --{given[0]}: a target is a file or a scenario")
        return target.read_target(options["target"])
    missing = [f"--{name}" for name in scenario if name not in given]
    levels = [name for name in ("sa", "epsilon") if name in given]
    if missing or len(levels) != 1:
        lacking = ", ".join(missing) or "one of --sa and --epsilon"
        raise InputError(f"a target is --target FILE.csv or a scenario; {lacking} is needed")
    rupture = target.Rupture(options["magnitude"], options["distance"], options["vs30"])
    level, period, model = options["sa"], options["period"], options["model"]
    if level is None:
        ln_median, sd, _ = target.predict(rupture, model, [period])
        level = float(np.exp(ln_median[0] + options["epsilon"] * sd[0]))
    near = {
        min(measured, key=lambda have: abs(math.log(have / t)), default=t) for t in target.PERIODS
    }
    return target.conditional_spectrum(rupture, level, period, sorted(near), model)


def selection_text(selection: "Selection", out: Path) -> str:
    """How many records were selected from how many, and how near to the target they are."""
    median, sd = (np.nanmax(np.abs(error), initial=0.0) for error in selection.errors)
    count = counted(len(selection.table), "record")
    near = f"median within {100 * median:.1f} % of the target's, sd within {100 * sd:.1f} %"
    return f"{count} selected of {selection.candidates}: {near}: {out}"


def make_chosen(out: Path, requested: dict[str, Any]) -> list[Path]:
    """Make synthetic motions with their index: those asked for, or those that archfrag ships."""
    from archfrag.motions.index import index_table
    from archfrag.motions.synthetic import Plan, make_suite, plan_motions

    others = [name for name, row in index_table(out).items() if not row.get("model")]
    if others:
        listed = f"the index there lists other records ({others[0]})"
        raise InputError(f"--out {out}: {listed}; name another folder")
    given = {key: value for key, value in requested.items() if value is not None}
    if not given:
        return make_suite(out)
    missing = [f"--{key.replace('_', '-')}" for key in ("events", "magnitude", "distance_km")
               if key not in given]  # fmt: skip
    if missing:
        raise InputError(f"{', '.join(missing)} {'are' if missing[1:] else 'is'} missing")
    given["magnitude"], given["drawn_magnitude"] = given["magnitude"]
    given["distance"], given["drawn_distance"] = given.pop("distance_km")
    return make_suite(out, plan_motions(Plan(**{"records_per_event": 1, **given})))
