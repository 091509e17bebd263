"""The commands `archfrag records ...`."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from archfrag.cli.options import (
    PATH,
    Once,
    check_written,
    figure_option,
    json_option,
    option,
    refuse_given,
    show,
    takes,
    takes_format,
    takes_record,
    warn,
)
from archfrag.errors import InputError, RecordError, ServiceError
from archfrag.files import Named, counted, number, opened, relative_path, write_csv
from archfrag.motions import selection, synthetic
from archfrag.motions.channel import STANDARD_GRAVITY
from archfrag.motions.fetch import fetch_records
from archfrag.motions.formats import TEXT, recognise
from archfrag.motions.index import goes_with_records, index_table
from archfrag.motions.partners import vertical_files
from archfrag.motions.read import inspect_record, read_horizontals
from archfrag.motions.target import Target, scenario_target
from archfrag.study.file.schema import PERIODS
from archfrag.study.provenance import finite, write_text

Options = Named
_files = click.argument("files", nargs=-1, required=True, type=PATH)


_out = option("--out", PATH, "Folder to write to.", required=True)


def _list_or_ends(low: float, high: float) -> Callable[..., Any]:
    """Return a callback that reads numbers from `low` to `high`: a list, or two ends.

    The callback returns the numbers, and whether they are two ends.
    """

    def numbers(context: click.Context, parameter: click.Parameter, text: str | None):
        if text is None:
            return None
        ends = ":" in text
        try:
            values = [number(part) for part in text.split(":" if ends else ",")]
        except ValueError:
            values = [np.nan]
        wrong = ends and not (len(values) == 2 and values[0] < values[1])
        if wrong or not low <= min(values) <= max(values) <= high:
            raise InputError(
                f"{parameter.opts[0]} {text}: must be numbers from {low:g} to {high:g}: a list "
                "such as 6,6.5,7, or two increasing ends such as 6:7"
            )
        return values, ends

    return numbers


def _reading(file: Path, reading: Options) -> Options:
    """Return the options for reading a file, without columns unless it is plain text."""
    if reading["columns"] is not None and file.is_file():
        with opened(file) as content:
            binary = b"\0" in content.read(512)
        if binary or recognise(str(file), TEXT):
            return {**reading, "columns": None}
    return reading


@click.group()
def records() -> None:
    """Inspect, measure, select, fetch and make records."""


records.command_class = Once


@records.command()
@_files
@takes_format
@json_option
def inspect(files: tuple[Path, ...], as_json: bool, **reading) -> None:
    """List the content of record FILES and their errors.

    Each channel of each file is shown with its errors. If a file cannot be read, the others are
    shown and the exit code is 2.

    \b
    Example:
      archfrag records inspect *.V2
    """
    entries = []
    for file in files:
        if len(files) > 1 and goes_with_records(file):
            continue
        try:
            entries.append(finite(inspect_record(file, **_reading(file, reading))))
        except RecordError as error:
            entries.append({"file": str(file), "error": str(error)})
    shown = [_inspection(facts) for facts in entries if "error" not in facts]
    if shown or as_json:
        show(entries, "\n".join(shown), as_json)
    for facts in entries:
        if "error" in facts:
            warn(f"error: {facts['error']}")
    if len(shown) < len(entries):
        click.get_current_context().exit(RecordError.exit_code)


def _inspection(facts: Options) -> str:
    """Return a line for each channel that `inspect_record` lists, and for each error."""
    magnitude = None if facts["magnitude"] is None else f"M {facts['magnitude']:g}"
    stations = dict.fromkeys(channel["station"] for channel in facts["channels"])
    head = (
        *(facts[key] for key in ("format", "event", "date")),
        magnitude,
        *list(stations)[:3],
    )
    lines = [f"{facts['file']}: {', '.join(filter(None, head))}"]
    for channel in facts["channels"]:
        parts = [
            f"{channel['count']} samples at {channel['dt']:g} s",
            f"{channel['duration']:.2f} s",
            channel["unit"] or "unit unknown",
        ]
        if channel["PGA"] is not None:
            parts.append(f"PGA {channel['PGA'] / STANDARD_GRAVITY:.4g} g")
        parts += [
            channel["level"],
            "vertical" if channel["vertical"] else "",
            channel["start"],
        ]
        lines.append(
            f"  {channel['code'] or '(no code)':9s} {', '.join(filter(None, parts))}"
        )
        lines += [f"    ! {error}" for error in channel["errors"]]
    return "\n".join([*lines, *(f"  ! {error}" for error in facts["errors"])])


@records.command()
@_files
@option("--out", PATH, "Table to write.", required=True, metavar="FLATFILE.csv")
@option("--periods", str, "Periods of Sa [s], besides 0.01 to 10 s.", metavar="T,T,...")
@takes_record
@figure_option
@json_option
def measure(
    files: tuple[Path, ...],
    out: Path,
    figure: Path | None,
    periods: str | None,
    as_json: bool,
    **reading,
) -> None:
    """Measure record FILES and write a flatfile.

    Each horizontal component has a row; files with the vertical component of another file are
    left out. Columns are named as in the NGA flatfiles. The figure shows the response spectra.

    \b
    Example:
      archfrag records measure records/*.AT2 --out flatfile.csv --figure spectra.svg
    """
    check_written(out, figure)
    table = _measured(files, out, periods, reading)
    write_csv(out, [table], float_format="%.6g")
    if figure is not None:
        columns = selection.spectrum_columns(table)
        spectra = table[[columns[period] for period in sorted(columns)]].to_numpy(float)
        band = np.nanquantile(spectra, [0.16, 0.5, 0.84], axis=0)
        _draw(figure, sorted(columns), spectra, {"median, 16 to 84 %": band})
    rows = json.loads(table.to_json(orient="records", double_precision=15))
    show(rows, f"{counted(len(table), 'component')} measured: {out}", as_json)


def _measured(
    files: Sequence[Path], out: Path, text: str | None, reading: Options
) -> pd.DataFrame:
    """Return the flatfile of record files as a table.

    Its periods are `selection.PERIODS` and those of `text`, such as 0.15,0.35; paths are relative
    to the folder of `out`.
    """
    low, high = PERIODS
    try:
        more = [number(part) for part in text.split(",")] if text else []
        wrong = any(not low <= t <= high or round(t, 3) != t for t in more)
    except ValueError:
        wrong = True
    if wrong:
        raise InputError(
            f"--periods {text}: numbers from {low:g} to {high:g} s, of at most three decimals, "
            "are needed"
        )
    verticals = vertical_files(sorted(files))
    tables = []
    for file in (file for file in dict.fromkeys(files) if file not in verticals):
        options = _reading(file, reading)
        name = relative_path(file, out.parent)
        motions = [
            motion.stating(file=name) for motion in read_horizontals(file, **options)
        ]
        how = {
            "unit": options["unit"],
            "accept": " ".join(options["accept"]),
            "columns": str(options["columns"] or ""),
        }
        table = selection.measure_records(motions, sorted({*selection.PERIODS, *more}))
        tables.append(
            table.assign(**{key: value for key, value in how.items() if value})
        )
    return pd.concat(tables, ignore_index=True)


def _draw(figure: Path, periods: Sequence[float], spectra, bands: Options) -> None:
    """Write response spectra [g] as SVG.

    `bands` has by label three rows: low, median and high.
    """
    from archfrag import plots  # start-up: matplotlib

    colours = (plots.VERMILION, plots.BLUE)[-len(bands) :]
    drawn = [
        (rows, colour, label) for (label, rows), colour in zip(bands.items(), colours)
    ]
    write_text(figure, plots.svg_of(plots.plot_spectra(periods, spectra, drawn).figure))


@records.command()
@click.argument("flatfile", type=PATH)
@takes(
    option("--out", PATH, "Index to write.", required=True, metavar="INDEX.csv"),
    option("--count", int, "Number of records (of each level).", required=True),
    option(
        "--target",
        PATH,
        "Target spectrum: columns period_s, Sa_g, for its scatter sd, and level if each level of "
        "a study has its own.",
        metavar="FILE.csv",
    ),
    option("--magnitude", float, "Moment magnitude of a conditional spectrum."),
    option("--distance", float, "Its distance to the rupture [km]."),
    option("--vs30", float, "Its Vs30 [m/s]."),
    option("--period", float, "Its conditioning period [s]."),
    option("--sa", float, "Sa at that period [g], or --epsilon."),
    option("--epsilon", float, "Standard deviations of Sa above the median."),
    option("--model", str, "Ground-motion model.", "CY14"),
    option(
        "--max-scale", float, "Largest scale factor; its inverse is the smallest.", 4.0
    ),
    option("--per-event", int, "Largest number of records of one event."),
    option("--seed", int, "", 1),
    figure_option,
    json_option,
)
def select(
    flatfile: Path, out: Path, figure: Path | None, as_json: bool, **options
) -> None:
    """Select records of a FLATFILE for a target.

    The scaled spectra of the records have the mean and the scatter of the target. The target is
    a file, or a conditional spectrum of an earthquake and a site. The same seed selects the same
    records. The figure shows target and selected spectra. If the file has targets by level, the
    index has a column level, and a study runs each record at its levels alone; each level has a
    figure of its own.

    \b
    Example:
      archfrag records select flatfile.csv --out selected.csv --count 30 \\
        --magnitude 6.5 --distance 15 --vs30 500 --period 0.5 --epsilon 1 --figure selected.svg
    """
    table = selection.read_flatfile(flatfile)
    names = ("count", "seed", "max_scale", "per_event")
    targets = _targets(options, sorted(selection.spectrum_columns(table)))
    figures = {
        level: figure and figure.with_stem("-".join([figure.stem, *_digits(level)]))
        for level in targets
    }
    check_written(out, selection.target_file(out), *figures.values())
    given = {name: options[name] for name in names}
    selected = {
        level: selection.select_records(table, target, **given)
        for level, target in targets.items()
    }
    selection.write_selected(selected, out, folder=flatfile.parent)
    for level, chosen in selected.items():
        for caution in chosen.cautions:
            warn(
                ": ".join(["caution", *map("level {}".format, _digits(level)), caution])
            )
        own = figures[level]
        if own is not None:
            _draw_selected(own, chosen)
    every = {level: chosen.facts() for level, chosen in selected.items()}
    texts = [
        ": ".join([*map("level {}".format, _digits(level)), _chosen_text(facts)])
        for level, facts in every.items()
    ]
    facts = every.get(None) or {"levels": {f"{at:g}": own for at, own in every.items()}}
    show(facts, f"{'; '.join(texts)}: {out}", as_json)


def _digits(level: float | None) -> list[str]:
    return [] if level is None else [f"{level:g}"]


def _chosen_text(facts: Options) -> str:
    """Return words on a selection from its facts."""
    median, sd = (
        max(abs(error or 0.0) for error in facts[key])
        for key in ("median_error", "sd_error")
    )
    return (
        f"{counted(len(facts['records']), 'record')} selected of {facts['candidates']}: median "
        f"within {100 * median:.1f} % of the target's, sd within {100 * sd:.1f} %"
    )


def _draw_selected(figure: Path, chosen: selection.Selection) -> None:
    """Write the spectra of selected records and of their target as SVG."""
    away = 1.96 * np.array([[-1.0], [0.0], [1.0]])
    target = chosen.target
    bands = {
        "selected": chosen.ln_sa.mean(axis=0) + away * np.nan_to_num(chosen.sd),
        "target": target.ln_mean + away * target.sd,
    }
    bands = {f"{name}, 2.5 to 97.5 %": np.exp(rows) for name, rows in bands.items()}
    _draw(figure, target.periods.tolist(), np.exp(chosen.ln_sa), bands)


def _targets(options: Options, measured: Sequence[float]) -> dict[float | None, Target]:
    """Return targets by level: those of a file, or one of a scenario at `measured` periods.

    InputError if both are given, or if the scenario is incomplete.
    """
    scenario = ("magnitude", "distance", "vs30", "period")
    named = [name for name in (*scenario, "sa", "epsilon") if options[name] is not None]
    if options["target"] is not None:
        if named:
            raise InputError(
                f"--target and --{named[0]}: a target is a file or a scenario"
            )
        refuse_given("a target of a file has no model", "model")
        return selection.read_targets(options["target"])
    missing = [f"--{name}" for name in scenario if name not in named]
    if missing or ("sa" in named) == ("epsilon" in named):
        lacking = ", ".join(missing) or "one of --sa and --epsilon"
        raise InputError(
            f"a target is --target FILE.csv or a scenario; {lacking} is needed"
        )
    rupture = options["magnitude"], options["distance"], options["vs30"]
    level = options["sa"], options["epsilon"]
    return {
        None: scenario_target(
            rupture, options["period"], level, measured, options["model"]
        )
    }


@records.command()
@click.argument("events", nargs=-1, required=True, metavar="EVENT_ID...")
@takes(
    _out,
    option(
        "--from",
        str,
        "Service of stations and waveforms: NCEDC, SCEDC, INGV, ... or https://...",
        required=True,
        metavar="SERVICE",
    ),
    option(
        "--events-from",
        str,
        "Service that knows the given event identifiers.",
        "USGS",
        metavar="SERVICE",
    ),
    option(
        "--radius",
        click.FloatRange(0.0, 2000.0),
        "Largest epicentral distance [km].",
        100.0,
    ),
    option(
        "--channels",
        str,
        "Accelerometers, the best first; each station gives one kind.",
        "HN,EN,BN",
        metavar="KINDS",
    ),
    option(
        "--before",
        click.FloatRange(0.0, 3600.0),
        "Begin before the origin time [s].",
        30.0,
    ),
    option(
        "--after",
        click.FloatRange(1.0, 7200.0),
        "End after the origin time [s].",
        180.0,
    ),
    option(
        "--stations",
        click.IntRange(1),
        "Largest number of stations of an event, the nearest first.",
        100,
    ),
    json_option,
)
def fetch(
    events: tuple[str, ...],
    out: Path,
    channels: str,
    stations: int,
    as_json: bool,
    **where,
) -> None:
    """Fetch records of events from data centres.

    FDSN web services send them as miniSEED with StationXML; archfrag adds an index. Files that
    are in the folder are kept, so the same command continues where it stopped. The exit code is
    7 if a service failed that may answer later, and 2 if there is no record at all.

    \b
    Example:
      archfrag records fetch nc72282711 --from NCEDC --radius 50 --out napa
    """
    kinds = tuple(kind.strip() for kind in channels.split(","))
    fetched: dict[str, list[Any]] = {"new": [], "kept": [], "failures": []}
    services = where.pop("from"), where.pop("events_from")
    for kind, text in fetch_records(
        out, events, services, stations, channels=kinds, **where
    ):
        if kind in fetched:
            fetched[kind].append(text)
        else:
            fetched["failures"].append({"kind": kind, "message": text})
            warn(text)
    new, kept, failures = fetched.values()
    text = f"{counted(len(new), 'record')} fetched, {len(kept)} were there: {out}"
    show({"folder": str(out), **fetched}, text, as_json)
    passing = sum(failure["kind"] == "service" for failure in failures)
    if passing:
        raise ServiceError(
            f"{counted(passing, 'request')} failed; try again later: the same command continues"
        )
    if not new and not kept:
        raise InputError("no record was fetched, for the reasons stated above")


@records.command()
@takes(
    _out,
    option("--events", click.IntRange(1, 100_000), "Earthquakes."),
    option("--records-per-event", click.IntRange(1, 100_000), "Of each (1)."),
    option(
        "--magnitude",
        str,
        "Moment magnitudes: a list that the earthquakes take in turn, or two ends "
        "between which they are drawn.",
        metavar="M,...|M:M",
        callback=_list_or_ends(3.0, 8.0),
    ),
    option(
        "--distance-km",
        str,
        "Distances to the rupture [km]: a list that the records take in turn, or two ends.",
        metavar="D,...|D:D",
        callback=_list_or_ends(0.0, 300.0),
    ),
    option("--sites", click.IntRange(1), "Number of sites (one a record)."),
    option("--vs30", click.FloatRange(450.0, 1000.0), "Of sites [m/s] (760)."),
    click.option(
        "--vertical", is_flag=True, default=None, help="Also make vertical components."
    ),
    option("--pulses", click.FloatRange(0.0, 1.0), "Fraction with a pulse."),
    option("--seed", click.IntRange(0, 10**9), "Of the random numbers (1)."),
    json_option,
)
def make(out: Path, as_json: bool, **requested) -> None:
    """Make synthetic motions with their index.

    A study reads them by `motions: {index: OUT/index.csv}`. Without any option but --out the
    motions are those that archfrag ships.

    \b
    Example:
      archfrag records make --events 10 --records-per-event 3 --magnitude 5.5:7.5 \\
        --distance-km 10:100 --out synthetic
    """
    others = [name for name, row in index_table(out).items() if not row.get("model")]
    if others:
        raise InputError(
            f"--out {out}: the index there lists other records ({others[0]}); name another folder"
        )
    paths = synthetic.make_suite(out, _recipes(requested))
    facts = {"folder": str(out), "files": [str(path) for path in paths]}
    show(
        facts,
        f"{counted(len(paths), 'record')} and index.csv written to {out}",
        as_json,
    )


def _recipes(requested: Options) -> list[synthetic.Recipe] | None:
    """Return recipes of the requested motions; None if no option is given.

    None stands for the motions that archfrag ships.
    """
    given = {key: value for key, value in requested.items() if value is not None}
    if not given:
        return None
    needed = ("events", "magnitude", "distance_km")
    missing = [f"--{key.replace('_', '-')}" for key in needed if key not in given]
    if missing:
        raise InputError(f"{', '.join(missing)}: needed with the other options")
    given["magnitude"], given["drawn_magnitude"] = given["magnitude"]
    given["distance"], given["drawn_distance"] = given.pop("distance_km")
    return synthetic.plan_motions(**{"records_per_event": 1, **given})
