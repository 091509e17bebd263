"""The commands `archfrag records ...`."""

import json
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import (
    PATH,
    figure_option,
    json_option,
    show,
    takes,
    takes_format,
    takes_record,
    warn,
)
from archfrag.errors import InputError, RecordError, ServiceError
from archfrag.files import counted, write_csv
from archfrag.study.provenance import finite, write_text

_files = click.argument("files", nargs=-1, required=True, type=PATH)
_out = click.option("--out", type=PATH, required=True, help="Folder to write to.")


def _list_or_ends(low: float, high: float) -> Any:
    """A callback for numbers within limits: the numbers, and whether they are two ends."""

    def numbers(context: click.Context, parameter: click.Parameter, text: str | None) -> Any:
        if text is None:
            return None
        ends = ":" in text
        try:
            given = [float(part) for part in text.split(":" if ends else ",")]
        except ValueError:
            given = []
        increasing = len(given) == 2 and given[0] < given[-1]
        if not given or (ends and not increasing) or not low <= min(given) <= max(given) <= high:
            forms = "a list such as 6,6.5,7, or two increasing ends such as 6:7"
            rule = f"must be numbers from {low:g} to {high:g}: {forms}"
            raise InputError(f"{parameter.opts[0]} {text}: {rule}")
        return given, ends

    return numbers


@click.group()
def records() -> None:
    """Inspect, measure, select, convert, fetch and make records."""


@records.command()
@_files
@takes_format
@json_option
@click.pass_context
def inspect(
    context: click.Context, files: tuple[Path, ...], as_json: bool, **reading: Any
) -> None:
    """List the content of record FILES and their errors.

    Each channel of each file is shown with its faults. If a file cannot be read, the others are
    shown and the exit code is 2.

    \b
    Example:
      archfrag records inspect *.V2
    """
    from archfrag.cli.record_work import inspection_text, reading_of
    from archfrag.motions.index import goes_with_records
    from archfrag.motions.read import inspect_record

    found = []
    for file in files:
        if len(files) > 1 and goes_with_records(file):
            continue
        try:
            found.append(finite(inspect_record(file, **reading_of(file, reading))))
        except RecordError as error:
            found.append({"file": str(file), "error": str(error)})
    shown = [inspection_text(facts) for facts in found if "error" not in facts]
    if shown or as_json:
        show(found, "\n".join(shown), as_json)
    for facts in found:
        if "error" in facts:
            warn(f"error: {facts['error']}")
    if len(shown) < len(found):
        context.exit(RecordError.exit_code)


@records.command()
@_files
@click.option("--out", type=PATH, required=True, metavar="FLATFILE.csv", help="Table to write.")
@click.option("--periods", metavar="T,T,...", help="Periods of Sa [s], besides 0.01 to 10 s.")
@takes_record
@figure_option
@json_option
def measure(
    files: tuple[Path, ...], out: Path, figure: Path | None, periods: str | None, as_json: bool,
    **reading: Any,
) -> None:  # fmt: skip
    """Measure record FILES and write a flatfile.

    Each horizontal component has a row; files with the vertical component of another file are
    left out. Columns are named as in the NGA flatfiles. The figure shows the response spectra.

    \b
    Example:
      archfrag records measure records/*.AT2 --out flatfile.csv --figure spectra.svg
    """
    from archfrag.cli import record_work as work

    table = work.measure_files(files, out, periods, reading)
    write_csv(out, [table], float_format="%.6g")
    if figure is not None:
        write_text(figure, work.measured_spectra(table))
    rows = json.loads(table.to_json(orient="records", double_precision=15))
    show(rows, f"{counted(len(table), 'component')} measured: {out}", as_json)


@records.command()
@click.argument("flatfile", type=PATH)
@takes(
    click.option("--out", type=PATH, required=True, metavar="INDEX.csv", help="Index to write."),
    click.option("--count", type=int, required=True, help="Number of records."),
    click.option("--target", type=PATH, metavar="FILE.csv",
                 help="Target spectrum: columns period_s, Sa_g and, for its scatter, sd."),
    click.option("--magnitude", type=float, help="Moment magnitude of a conditional spectrum."),
    click.option("--distance", type=float, help="Its distance to the rupture [km]."),
    click.option("--vs30", type=float, help="Its Vs30 [m/s]."),
    click.option("--period", type=float, help="Its conditioning period [s]."),
    click.option("--sa", type=float, help="Sa at that period [g], or --epsilon."),
    click.option("--epsilon", type=float, help="Standard deviations of Sa above the median."),
    click.option("--model", default="CY14", show_default=True, help="Ground-motion model."),
    click.option("--max-scale", type=float, default=4.0, show_default=True,
                 help="Largest scale factor; its inverse is the smallest."),
    click.option("--per-event", type=int, help="Largest number of records of one event."),
    click.option("--seed", type=int, default=1, show_default=True),
    figure_option, json_option,
)  # fmt: skip
def select(flatfile: Path, out: Path, figure: Path | None, as_json: bool, **options: Any) -> None:
    """Select records of a FLATFILE for a target.

    The scaled spectra of the records have the mean and the scatter of the target. The target is
    a file, or a conditional spectrum of an earthquake and a site. The same seed selects the same
    records. The figure shows target and selected spectra.

    \b
    Example:
      archfrag records select flatfile.csv --out selected.csv --count 30 \\
        --magnitude 6.5 --distance 15 --vs30 500 --period 0.5 --epsilon 1 --figure selected.svg
    """
    from archfrag.cli import record_work as work
    from archfrag.motions.selection import read_flatfile, select_records, spectrum_columns

    table, own = read_flatfile(flatfile), ("count", "seed", "max_scale", "per_event")
    target = work.target_of(options, sorted(spectrum_columns(table)))
    selection = select_records(table, target, **{name: options[name] for name in own})
    selection.write(out, folder=flatfile.parent)
    if figure is not None:
        write_text(figure, work.selected_spectra(selection))
    for caution in selection.cautions:
        warn(f"caution: {caution}")
    facts, count = selection.facts(), counted(len(selection.table), "record")
    median, sd = (max(abs(error or 0.0) for error in facts[key])
                  for key in ("median_error", "sd_error"))  # fmt: skip
    near = f"median within {100 * median:.1f} % of the target's, sd within {100 * sd:.1f} %"
    show(facts, f"{count} selected of {selection.candidates}: {near}: {out}", as_json)


@records.command()
@_files
@takes(
    _out,
    click.option("--to", "form", type=click.Choice(["mseed", "text"]), default="mseed",
                 show_default=True, help="miniSEED, or columns of text."),
    click.option("--in", "requested", type=click.Choice(["m/s2", "g"]), default="m/s2",
                 show_default=True, help="Unit to write."),
    takes_record, json_option,
)  # fmt: skip
def convert(
    files: tuple[Path, ...], out: Path, form: str, requested: str, as_json: bool, **reading: Any
) -> None:
    """Write record FILES in another format.

    An index in the same folder states where they come from and what was done to them.

    \b
    Example:
      archfrag records convert CE23837.V1C --to text --in g --out converted
    """
    from archfrag.cli.record_work import reading_of
    from archfrag.motions.convert import convert_record

    written = [
        {"file": str(path), "source": str(file)} for file in files
        for path in convert_record(file, out, form, requested, **reading_of(file, reading))
    ]  # fmt: skip
    show(written, "\n".join(entry["file"] for entry in written), as_json)


@records.command()
@click.argument("events", nargs=-1, required=True, metavar="EVENT_ID...")
@takes(
    _out,
    click.option("--from", "stations_from", required=True, metavar="SERVICE",
                 help="Service of stations and waveforms: NCEDC, SCEDC, INGV, ... or https://..."),
    click.option("--events-from", default="USGS", show_default=True, metavar="SERVICE",
                 help="Service that knows the given event identifiers."),
    click.option("--radius", type=click.FloatRange(0.0, 2000.0), default=100.0, show_default=True,
                 help="Largest epicentral distance [km]."),
    click.option("--channels", default="HN,EN,BN", show_default=True, metavar="KINDS",
                 help="Accelerometers, the best first; each station gives one kind."),
    click.option("--before", type=click.FloatRange(0.0, 3600.0), default=30.0, show_default=True,
                 help="Begin before the origin time [s]."),
    click.option("--after", type=click.FloatRange(1.0, 7200.0), default=180.0, show_default=True,
                 help="End after the origin time [s]."),
    click.option("--stations", "most", type=click.IntRange(1), default=100, show_default=True,
                 help="Largest number of stations of an event, the nearest first."),
    json_option,
)  # fmt: skip
def fetch(
    events: tuple[str, ...], out: Path, channels: str, as_json: bool, **options: Any
) -> None:
    """Fetch records of events from data centres.

    FDSN web services send them as miniSEED with StationXML; archfrag adds an index. Files that
    are in the folder are kept, so the same command continues where it stopped. The exit code is
    7 if a service failed that may answer later, and 2 if there is no record at all.

    \b
    Example:
      archfrag records fetch nc72282711 --from NCEDC --radius 50 --out napa
    """
    from archfrag.motions.fetch import fetch_records

    kinds = tuple(kind.strip() for kind in channels.split(","))
    found: dict[str, list[Any]] = {"new": [], "kept": [], "failures": []}
    for kind, text in fetch_records(out, events, channels=kinds, **options):
        if kind in found:
            found[kind].append(text)
        else:
            found["failures"].append({"kind": kind, "message": text})
            warn(text)
    new, kept, failures = found.values()
    text = f"{counted(len(new), 'record')} fetched, {len(kept)} were there: {out}"
    show({"folder": str(out), **found}, text, as_json)
    if passing := sum(failure["kind"] == "service" for failure in failures):
        count = counted(passing, "request")
        raise ServiceError(f"{count} failed; try again later: the same command continues")
    if not new and not kept:
        raise InputError("no record was fetched, for the reasons stated above")


@records.command()
@takes(
    _out,
    click.option("--events", type=click.IntRange(1, 100_000), help="Earthquakes."),
    click.option("--records-per-event", type=click.IntRange(1, 100_000), help="Of each (1)."),
    click.option("--magnitude", metavar="M,...|M:M", callback=_list_or_ends(3.0, 8.0),
                 help="Moment magnitudes: a list that the earthquakes take in turn, or two ends "
                 "between which they are drawn."),
    click.option("--distance-km", metavar="D,...|D:D", callback=_list_or_ends(0.0, 300.0),
                 help="Distances to the rupture [km]: a list that the records take in turn, or "
                 "two ends."),
    click.option("--sites", type=click.IntRange(1), help="Number of sites (one a record)."),
    click.option("--vs30", type=click.FloatRange(450.0, 1000.0), help="Of sites [m/s] (760)."),
    click.option("--vertical", is_flag=True, default=None, help="Also make vertical components."),
    click.option("--pulses", type=click.FloatRange(0.0, 1.0), help="Fraction with a pulse."),
    click.option("--seed", type=click.IntRange(0, 10**9), help="Of the random numbers (1)."),
    json_option,
)  # fmt: skip
def make(out: Path, as_json: bool, **requested: Any) -> None:
    """Make synthetic motions with their index.

    A study reads them by `motions: {index: OUT/index.csv}`. Without any option but --out the
    motions are those that archfrag ships.

    \b
    Example:
      archfrag records make --events 10 --records-per-event 3 --magnitude 5.5:7.5 \\
        --distance-km 10:100 --out synthetic
    """
    from archfrag.cli.record_work import make_chosen

    paths = make_chosen(out, requested)
    facts = {"folder": str(out), "files": [str(path) for path in paths]}
    show(facts, f"{counted(len(paths), 'record')} and index.csv written to {out}", as_json)
