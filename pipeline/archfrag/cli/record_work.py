"""Work of the commands `archfrag records` that is more than one call, and their figures as SVG."""

import math
import os
import signal
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.files import counted, opened
from archfrag.motions import selection
from archfrag.motions import target as targets
from archfrag.motions.flatfile import PERIODS, measure_records, read_flatfile
from archfrag.motions.formats import TEXT, recognise
from archfrag.motions.index import index_table
from archfrag.motions.measures import spectral_acceleration, velocity
from archfrag.motions.motion import Motion
from archfrag.motions.partners import vertical_files
from archfrag.motions.read import read_motions
from archfrag.motions.synthetic import Plan, make_suite, plan_motions
from archfrag.study.file.schema import PERIODS as PERIOD_ENDS
from archfrag.study.files import available_cores

SHOWN_PERIODS = np.geomspace(0.02, 5.0, 80)  # of a record's spectrum [s]
MOST = 24  # channels in a figure
_SPECTRAL = r"T(\d+(?:\.\d+)?)S"
_MANY = 32  # files from which processes divide the work
_NORMAL_975 = 1.959964  # quantile of the standard normal


def inspection_text(found: dict[str, Any]) -> str:
    """What `inspect_record` found in a file: a line for each channel and for each fault."""
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
    if reading["columns"] is None or not file.is_file():
        return reading
    with opened(file) as content:
        binary = b"\0" in content.read(512)
    if binary or recognise(str(file), TEXT):
        return {**reading, "columns": None}
    return reading


def measure_files(
    files: Sequence[Path], out: Path, periods: str | None, reading: dict[str, Any]
) -> pd.DataFrame:
    """Flatfile of record files, with the options to read them again."""
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
        return pd.concat(pool.map(measured, requested, chunksize=8), ignore_index=True)


def _periods(text: str | None) -> list[float]:
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
) -> pd.DataFrame:
    """Rows of the components of one file."""
    reading = reading_of(file, reading)
    name = os.path.relpath(file, out.parent)
    motions = read_motions(file, **reading)
    named = (replace(motion, metadata={**motion.metadata, "file": name}) for motion in motions)
    known = {"unit": reading["unit"], "accept": " ".join(reading["accept"]),
             "columns": str(reading["columns"] or "")}  # fmt: skip
    table = measure_records(named, periods)
    return table.assign(**{key: value for key, value in known.items() if value})


def table_spectra(table: pd.DataFrame) -> dict[float, NDArray[np.float64]]:
    """Sa [g] of the rows of a flatfile, by period [s]."""
    columns = table.columns.to_series().str.extract(rf"^{_SPECTRAL}$")[0].dropna()
    return {float(period): table[name].to_numpy(float) for name, period in columns.items()}


def select_from(flatfile: Path, options: dict[str, Any]) -> selection.Selection:
    """Selection of the records of a flatfile by the options of the command."""
    table = read_flatfile(flatfile)
    return selection.select_records(
        table, _target(options, sorted(table_spectra(table))), options["count"], options["seed"],
        max_scale=options["max_scale"], per_event=options["per_event"],
    )  # fmt: skip


def _target(options: dict[str, Any], measured: Sequence[float]) -> targets.Target:
    """Target at periods that the records were measured at, since between them scatter is lost."""
    scenario = ("magnitude", "distance", "vs30", "period")
    given = [name for name in (*scenario, "sa", "epsilon") if options[name] is not None]
    if options["target"] is not None:
        if given:
            raise InputError(f"--target and --{given[0]}: a target is a file or a scenario")
        return targets.read_target(options["target"])
    missing = [f"--{name}" for name in scenario if name not in given]
    if missing or ("sa" in given) == ("epsilon" in given):
        lacking = ", ".join(missing) or "one of --sa and --epsilon"
        raise InputError(f"a target is --target FILE.csv or a scenario; {lacking} is needed")
    rupture = targets.Rupture(options["magnitude"], options["distance"], options["vs30"])
    level, period, model = options["sa"], options["period"], options["model"]
    if level is None:
        ln_median, sd, _ = targets.predict(rupture, model, [period])
        level = float(np.exp(ln_median[0] + options["epsilon"] * sd[0]))
    near = {
        min(measured, key=lambda have: abs(math.log(have / t)), default=t) for t in targets.PERIODS
    }
    return targets.conditional_spectrum(rupture, level, period, sorted(near), model)


def selection_text(found: selection.Selection, out: Path) -> str:
    """How many records were selected from how many, and how near to the target they are."""
    median, sd = (np.nanmax(np.abs(error), initial=0.0) for error in found.errors)
    near = f"median within {100 * median:.1f} % of the target's, sd within {100 * sd:.1f} %"
    count = counted(len(found.table), "record")
    return f"{count} selected of {found.candidates}: {near}: {out}"


def make_chosen(out: Path, requested: dict[str, Any]) -> list[Path]:
    """Make synthetic motions with their index: those asked for, or those that archfrag ships."""
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


def measured_spectra(found: Mapping[float, NDArray[np.float64]]) -> str:
    """Figure of the response spectra of a flatfile, period [s] to Sa [g] (n_record,)."""
    periods = sorted(found)
    if len(periods) < 2:
        raise InputError(f"a figure of spectra needs two periods or more; there is {len(periods)}")
    rows = np.stack([found[period] for period in periods])
    chart, axes = _chart()
    axes.plot(periods, rows, color="grey", linewidth=0.5)
    low, median, high = np.nanquantile(rows, [0.16, 0.5, 0.84], axis=1)
    axes.fill_between(periods, low, high, color="tab:cyan", alpha=0.35, label="16 to 84 %")
    axes.plot(periods, median, color="tab:blue", linewidth=2.0, label="median")
    return _svg(chart, axes)


def selected_spectra(found: selection.Selection) -> str:
    """Figure of selected, scaled records and their target: medians, 2.5 and 97.5 %."""
    target, (chart, axes) = found.target, _chart()
    axes.plot(target.periods, np.exp(found.ln_sa).T, color="grey", linewidth=0.5)
    selected = found.ln_sa.mean(axis=0), found.sd, "tab:orange", "selected"
    for mean, sd, colour, label in (selected, (target.ln_mean, target.sd, "tab:blue", "target")):
        axes.plot(target.periods, np.exp(mean), color=colour, linewidth=2.0, label=label)
        for end in (-_NORMAL_975, _NORMAL_975):
            spectrum = np.exp(mean + end * np.nan_to_num(sd))
            axes.plot(target.periods, spectrum, color=colour, linewidth=0.8)
    return _svg(chart, axes)


def channels(traces: Sequence[tuple[str, Motion]]) -> str:
    """Figure of acceleration and velocity of labelled channels as read, and of their spectra."""
    if not 1 <= len(traces) <= MOST:
        raise InputError(
            f"a figure shows 1 to {MOST} channels with a known unit; there are {len(traces)}"
        )
    rows = len(traces)
    chart, axes = _chart(4.5 + 1.4 * rows, (rows + 1, 2), [1.0] * rows + [3.0])
    for row, (label, motion) in enumerate(traces):
        acceleration = np.asarray(motion.acceleration) / STANDARD_GRAVITY
        histories = (
            (f"{label}: acceleration [g]", acceleration),
            ("velocity [cm/s]", 100.0 * velocity(motion)),
        )
        for column, (title, values) in enumerate(histories):
            own = chart.add_subplot(axes.get_gridspec()[row, column])
            own.plot(np.arange(acceleration.size) * motion.dt, values, "tab:blue", linewidth=0.6)
            own.set_title(title, loc="left", fontsize="small")
        sa = spectral_acceleration(motion, SHOWN_PERIODS) / STANDARD_GRAVITY
        axes.plot(SHOWN_PERIODS, sa, linewidth=1.2, label=label)
    return _svg(chart, axes)


def _chart(
    height: float = 4.5, shape: tuple[int, int] = (1, 1), heights: Sequence[float] = (1.0,)
) -> tuple[Any, Any]:
    """A figure of matplotlib with axes of spectra, which have the last row of a grid."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    chart = Figure(figsize=(9.0, height), layout="constrained")
    axes = chart.add_subplot(chart.add_gridspec(*shape, height_ratios=heights)[-1, :])
    axes.set(xscale="log", yscale="log", xlabel="period [s]", ylabel="Sa, 5 % damping [g]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
    return chart, axes


def _svg(chart: Any, axes: Any) -> str:
    import matplotlib

    axes.legend(frameon=False)
    text = StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "archfrag"}):
        chart.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()
