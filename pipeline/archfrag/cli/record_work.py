"""Work of the commands `archfrag records` that is more than one call, and their figures as SVG."""

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.files import opened
from archfrag.motions import selection
from archfrag.motions import target as targets
from archfrag.motions.formats import TEXT, one_reader, recognise
from archfrag.motions.index import index_table
from archfrag.motions.partners import vertical_files
from archfrag.motions.read import read_horizontals
from archfrag.motions.synthetic import make_suite, plan_motions
from archfrag.study.file.schema import PERIODS as PERIOD_ENDS


def inspection_text(found: dict[str, Any]) -> str:
    """Write what `inspect_record` found: a line for each channel and for each error."""
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
        lines += [f"    ! {error}" for error in channel["errors"]]
    return "\n".join([*lines, *(f"  ! {error}" for error in found["errors"])])


def reading_of(file: Path, reading: dict[str, Any]) -> dict[str, Any]:
    """Options to read a file with: columns are for plain text only."""
    if reading["columns"] is None or not file.is_file():
        return reading
    with opened(file) as content:
        binary = b"\0" in content.read(512)
    return {**reading, "columns": None} if binary or recognise(str(file), TEXT) else reading


def measure_files(
    files: Sequence[Path], out: Path, text: str | None, reading: dict[str, Any]
) -> pd.DataFrame:
    """Flatfile of record files at our periods and those of a text, with the options to read."""
    low, high = PERIOD_ENDS
    try:
        more = [float(part) for part in text.split(",")] if text else []
        if not all(low <= period <= high and round(period, 3) == period for period in more):
            raise ValueError
    except ValueError:
        needed = f"numbers from {low:g} to {high:g} s, of at most three decimals, are needed"
        raise InputError(f"--periods {text}: {needed}") from None
    periods = sorted({*selection.PERIODS, *more})
    verticals, tables = vertical_files(sorted(files)), []
    with one_reader():
        for file in [path for path in dict.fromkeys(files) if path not in verticals]:
            options, name = reading_of(file, reading), os.path.relpath(file, out.parent)
            motions = [replace(motion, metadata={**motion.metadata, "file": name})
                       for motion in read_horizontals(file, **options)]  # fmt: skip
            known = {"unit": options["unit"], "accept": " ".join(options["accept"]),
                     "columns": str(options["columns"] or "")}  # fmt: skip
            table = selection.measure_records(motions, periods)
            tables.append(table.assign(**{key: value for key, value in known.items() if value}))
    return pd.concat(tables, ignore_index=True)


def target_of(options: dict[str, Any], measured: Sequence[float]) -> targets.Target:
    """Target at periods that the records were measured at, since between them scatter is lost."""
    scenario = ("magnitude", "distance", "vs30", "period")
    given = [name for name in (*scenario, "sa", "epsilon") if options[name] is not None]
    if options["target"] is not None:
        if given:
            raise InputError(f"--target and --{given[0]}: a target is a file or a scenario")
        return selection.read_target(options["target"])
    missing = [f"--{name}" for name in scenario if name not in given]
    if missing or ("sa" in given) == ("epsilon" in given):
        lacking = ", ".join(missing) or "one of --sa and --epsilon"
        raise InputError(f"a target is --target FILE.csv or a scenario; {lacking} is needed")
    rupture = options["magnitude"], options["distance"], options["vs30"]
    level, period, model = options["sa"], options["period"], options["model"]
    if level is None:
        ln_median, sd, _ = targets.predict(rupture, model, [period])
        level = float(np.exp(ln_median[0] + options["epsilon"] * sd[0]))
    near = {min(measured, key=lambda have: abs(math.log(have / t)), default=t)
            for t in targets.PERIODS}  # fmt: skip
    return targets.conditional_spectrum(rupture, level, period, sorted(near), model)


def make_chosen(out: Path, requested: dict[str, Any]) -> list[Path]:
    """Make synthetic motions with their index: those asked for, or those that archfrag ships."""
    others = [name for name, row in index_table(out).items() if not row.get("model")]
    if others:
        listed = f"the index there lists other records ({others[0]})"
        raise InputError(f"--out {out}: {listed}; name another folder")
    given = {key: value for key, value in requested.items() if value is not None}
    if not given:
        return make_suite(out)
    needed = {"--events": "events", "--magnitude": "magnitude", "--distance-km": "distance_km"}
    if missing := [option for option, key in needed.items() if key not in given]:
        raise InputError(f"{', '.join(missing)}: needed with the other options")
    given["magnitude"], given["drawn_magnitude"] = given["magnitude"]
    given["distance"], given["drawn_distance"] = given.pop("distance_km")
    return make_suite(out, plan_motions(**{"records_per_event": 1, **given}))


def measured_spectra(table: pd.DataFrame) -> str:
    """Figure of the response spectra of a flatfile, 16 to 84 % shaded."""
    from archfrag.plots import BLUE, plot_spectra, svg_of

    columns = selection.spectrum_columns(table)
    periods = sorted(columns)
    rows = table[[columns[period] for period in periods]].to_numpy(float)
    band = np.nanquantile(rows, [0.16, 0.5, 0.84], axis=0)
    return svg_of(plot_spectra(periods, rows, [(band, BLUE, "median, 16 to 84 %")]).figure)


def selected_spectra(found: selection.Selection) -> str:
    """Figure of selected, scaled records and their target: medians, 2.5 and 97.5 %."""
    from archfrag.plots import BLUE, VERMILION, plot_spectra, svg_of

    target, bands = found.target, []
    selected = found.ln_sa.mean(axis=0), found.sd, VERMILION, "selected"
    for mean, sd, colour, label in (selected, (target.ln_mean, target.sd, BLUE, "target")):
        rows = np.exp(mean + 1.96 * np.array([[-1.0], [0.0], [1.0]]) * np.nan_to_num(sd))
        bands.append((rows, colour, f"{label}, 2.5 to 97.5 %"))
    return svg_of(plot_spectra(target.periods, np.exp(found.ln_sa), bands).figure)
