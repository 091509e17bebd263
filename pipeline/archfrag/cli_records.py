"""The commands `archfrag records ...`: nothing is imported before use."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
set_option = click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE",
                          help="Override a key of the study file, e.g. --set method.dt=0.0005; "
                          "paths are relative to the current folder. Repeatable.")  # fmt: skip
study_argument = click.argument("study_file", metavar="STUDY", type=click.Path(path_type=Path))
_path = click.Path(path_type=Path)
_files = click.argument("files", nargs=-1, required=True, type=_path)
_out = click.option("--out", type=_path, required=True, help="Folder to write to.")
_figure = click.option("--figure", type=_path, metavar="FILE.svg", help="Draw a figure.")
_seed = click.option("--seed", type=int, default=1, show_default=True)


def takes(*options: Callable) -> Callable:
    """Options of a command in the order of its help."""

    def decorate(command: Callable) -> Callable:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def _columns(context: click.Context, parameter: click.Parameter, text: str | None) -> Any:
    from archfrag.motions.formats.columns import parse_columns

    return None if text is None else parse_columns(text)


_known = takes(
    click.option("--unit", help="unit of the samples where the file does not state it"),
    click.option("--inventory", type=_path,
                 help="StationXML of a record in counts, if not beside it as NAME.xml"),
    click.option("--columns", callback=_columns, metavar="KEY=N,...",
                 help="where the numbers of files in no format are: time=1,acceleration=2, or "
                 "acceleration=1,dt=0.01; dt=0.01 alone takes all numbers, row after row; also "
                 "vertical=COLUMN and skip=LINES"),
)  # fmt: skip
reads_record = takes(
    _known,
    click.option("--accept", multiple=True,
                 type=click.Choice(["pga", "time_step", "samples", "header"]),
                 help="Let pass a peak outside 1e-5 to 5 g, a time step outside 1e-4 to 0.1 s, "
                 "another number of samples than announced, another peak than the header states. "
                 "Repeatable."),
)  # fmt: skip


def echo(text: str, err: bool = False) -> None:
    """Print a line; of text that came from elsewhere a terminal obeys nothing."""
    from archfrag.files import printable

    click.echo(printable(text), err=err)


def _note(message: str) -> None:
    echo(f"archfrag: {message}", err=True)


def _print(facts: Any, text: str, as_json: bool) -> None:
    echo(json.dumps(facts, allow_nan=False) if as_json else text)


def _drawing(figure: Path | None) -> None:
    """Refuse a figure that is none, before anything is done."""
    from archfrag.errors import InputError

    if figure is not None and figure.suffix.lower() != ".svg":
        raise InputError(f"--figure {figure}: figures are written as SVG; name a FILE.svg")


def _save(shown: Any, figure: Path) -> None:
    from archfrag.report.picture import standalone
    from archfrag.study.files import write_text

    write_text(figure, standalone(shown))


@click.group()
def records() -> None:
    """Inspect, measure, select, convert, fetch and make records."""


@records.command()
@_files
@_known
@_figure
@json_option
@click.pass_context
def inspect(
    context: click.Context, files: tuple[Path, ...], figure: Path | None, as_json: bool,
    **reading: Any,
) -> None:  # fmt: skip
    """What is in record FILES, and what is wrong.

    Each channel of each file is shown with its faults. Nothing but an unreadable file is
    refused; the others are shown nevertheless, and the exit code is 2. The figure has
    acceleration, velocity and response spectra.

    \b
    Example:
      archfrag records inspect *.V2 --figure records.svg
    """
    from archfrag.errors import RecordError
    from archfrag.motions.index import goes_with_records
    from archfrag.motions.inspection import inspect_record
    from archfrag.study import record_commands as commands

    _drawing(figure)
    found, facts, unreadable = [], [], []
    for file in files:
        if len(files) > 1 and goes_with_records(file):
            continue
        try:
            found.append(inspect_record(file, **commands.reading_of(file, reading)))
            facts.append(commands.inspection_facts(found[-1]))
        except RecordError as error:
            unreadable.append(str(error))
            facts.append({"file": str(file), "error": str(error)})
    if figure is not None and found:
        from archfrag.report.motion_figures import inspected

        _save(inspected(commands.inspection_motions(found)), figure)
    if found or as_json:
        _print(facts, "\n".join(map(commands.inspection_text, found)), as_json)
    for message in unreadable:
        _note(f"error: {message}")
    if unreadable:
        context.exit(RecordError.exit_code)


@records.command()
@_files
@click.option("--out", type=_path, required=True, metavar="FLATFILE.csv", help="Table to write.")
@click.option("--periods", metavar="T,T,...", help="Periods of Sa [s] beside 0.01 to 10 s.")
@reads_record
@_figure
@json_option
def measure(
    files: tuple[Path, ...], out: Path, figure: Path | None, periods: str | None, as_json: bool,
    **reading: Any,
) -> None:  # fmt: skip
    """Measure record FILES and write a flatfile.

    Every horizontal component has a row; files of verticals beside theirs are left out. Columns
    are named as in the NGA flatfiles; the figure has the response spectra.

    \b
    Example:
      archfrag records measure records/*.AT2 --out flatfile.csv --figure spectra.svg
    """
    from archfrag.files import counted
    from archfrag.motions.flatfile import write_flatfile
    from archfrag.study.record_commands import measure_files, table_spectra

    _drawing(figure)
    table = measure_files(files, out, periods, reading)
    write_flatfile(out, table)
    if figure is not None:
        from archfrag.report.motion_figures import measured

        _save(measured(table_spectra(table)), figure)
    rows = json.loads(table.to_json(orient="records", double_precision=15))
    _print(rows, f"{counted(len(table), 'component')} measured: {out}", as_json)


@records.command()
@click.argument("flatfile", type=_path)
@takes(
    click.option("--out", type=_path, required=True, metavar="INDEX.csv", help="Index to write."),
    click.option("--count", type=int, required=True, help="How many records."),
    click.option("--target", type=_path, metavar="FILE.csv",
                 help="Target spectrum: columns period_s, Sa_g and, for its scatter, sd."),
    click.option("--magnitude", type=float, help="Of a conditional spectrum: moment magnitude,"),
    click.option("--distance", type=float, help="distance to the rupture [km],"),
    click.option("--vs30", type=float, help="Vs30 of the site [m/s],"),
    click.option("--period", type=float, help="conditioning period [s],"),
    click.option("--sa", type=float, help="and Sa there [g], or"),
    click.option("--epsilon", type=float, help="its standard deviations above the median."),
    click.option("--model", default="CY14", show_default=True,
                 help="Ground-motion model, by its name in pygmm."),
    click.option("--max-scale", type=float, default=4.0, show_default=True,
                 help="Largest scale factor; its inverse is the smallest."),
    click.option("--per-event", type=int, help="Most records of one event."),
    _seed, _figure, json_option,
)  # fmt: skip
def select(flatfile: Path, out: Path, figure: Path | None, as_json: bool, **options: Any) -> None:
    """Select records of a FLATFILE for a target.

    Their scaled spectra are distributed as the target's, in mean and scatter. The target is a
    file, or a conditional spectrum of an earthquake and a site. The same seed selects the same
    records. The figure has target and selected spectra.

    \b
    Example:
      archfrag records select flatfile.csv --out selected.csv --count 30 \\
        --magnitude 6.5 --distance 15 --vs30 500 --period 0.5 --epsilon 1 --figure selected.svg
    """
    from archfrag.study.record_commands import save_selection, select_from, selection_text

    _drawing(figure)
    selection = select_from(flatfile, options)
    selection.write(out, folder=flatfile.parent)
    if figure is not None:
        save_selection(selection, figure)
    for caution in selection.cautions:
        _note(f"caution: {caution}")
    _print(selection.facts(), selection_text(selection, out), as_json)


@records.command()
@_files
@takes(
    _out,
    click.option("--to", "form", default="mseed",
                 type=click.Choice(["mseed", "at2", "text"], case_sensitive=False),
                 show_default=True, help="miniSEED, PEER's AT2, or columns of text."),
    click.option("--in", "wanted", type=click.Choice(["m/s2", "g"]), default="m/s2",
                 show_default=True, help="Unit to write."),
    reads_record, json_option,
)  # fmt: skip
def convert(
    files: tuple[Path, ...], out: Path, form: str, wanted: str, as_json: bool, **reading: Any
) -> None:
    """Write record FILES in another format.

    The index beside them states where they come from and what was done to them.

    \b
    Example:
      archfrag records convert CE23837.V1C --to at2 --in g --out converted
    """
    from archfrag.motions.channels import Options
    from archfrag.motions.convert import convert_record
    from archfrag.study.record_commands import reading_of

    written = [
        {"file": str(path), "source": str(file)}
        for file in files
        for path in convert_record(file, out, form, wanted, Options(**reading_of(file, reading)))
    ]
    _print(written, "\n".join(entry["file"] for entry in written), as_json)


@records.command()
@click.argument("events", nargs=-1, required=True, metavar="EVENT_ID...")
@takes(
    _out,
    click.option("--from", "stations_from", required=True, metavar="SERVICE",
                 help="Service of stations and waveforms: NCEDC, SCEDC, INGV, ... or https://..."),
    click.option("--events-from", default="USGS", show_default=True, metavar="SERVICE",
                 help="Service of events, whose identifiers are given."),
    click.option("--radius", type=float, default=100.0, show_default=True,
                 help="Largest epicentral distance [km]."),
    click.option("--channels", default="HN,EN,BN", show_default=True, metavar="KINDS",
                 help="Accelerometers, the best first; one kind is taken at a station."),
    click.option("--before", type=float, default=30.0, show_default=True,
                 help="Begin before the origin time [s]."),
    click.option("--after", type=float, default=180.0, show_default=True,
                 help="End after the origin time [s]."),
    click.option("--stations", "most", type=int, default=100, show_default=True,
                 help="Most stations of an event, the nearest first."),
    click.option("--timeout", type=float, default=60.0, show_default=True,
                 help="Longest wait for one answer [s]."),
    click.option("--max-size", type=float, default=100.0, show_default=True,
                 help="Largest answer [MB]."),
    json_option,
)  # fmt: skip
def fetch(
    events: tuple[str, ...], out: Path, channels: str, timeout: float, max_size: float,
    as_json: bool, **options: Any,
) -> None:  # fmt: skip
    """Fetch records of events from data centres.

    They come by FDSN web services as miniSEED with StationXML and an index. What is in the
    folder already is kept: the same command goes on where it was stopped. The exit code is 7
    if a service failed that may answer later, and 2 if there is no record at all.

    \b
    Example:
      archfrag records fetch nc72282711 --from NCEDC --radius 50 --out napa
    """
    from archfrag.errors import InputError, ServiceError
    from archfrag.files import counted
    from archfrag.motions.fetch import Limits, Request, fetch_records

    kinds = tuple(kind.strip() for kind in channels.split(","))
    limits = Limits(timeout, max_size)
    request = Request(events, channels=kinds, limits=limits, **options)
    fetched = fetch_records(request, out, _note)
    failures = [{"kind": refusal.kind, "message": str(refusal)} for refusal in fetched.refused]
    facts = {"folder": str(out), "new": fetched.new, "kept": fetched.kept, "failures": failures}
    text = f"{counted(len(fetched.new), 'record')} fetched, {len(fetched.kept)} were there: {out}"
    _print(facts, text, as_json)
    if fetched.passing:
        count = counted(len(fetched.passing), "request")
        raise ServiceError(f"{count} failed; try again later: the same command goes on")
    if not fetched.new and not fetched.kept:
        raise InputError("no record was fetched, for the reasons stated above")


@records.command()
@takes(
    _out,
    click.option("--events", type=int, help="Earthquakes."),
    click.option("--records-per-event", type=int, help="Records of each; 1 if not given."),
    click.option("--magnitude", metavar="M,...|M:M",
                 help="Moment magnitudes: a list gone through by the earthquakes, or two ends "
                 "between which they are drawn."),
    click.option("--distance-km", metavar="D,...|D:D",
                 help="Distances to the rupture [km]: a list gone through by the records, or "
                 "two ends."),
    click.option("--sites", type=int,
                 help="Sites that the records go through; one for each if not given."),
    click.option("--vs30", type=float, help="Of the sites [m/s], 450 to 1000; 760 if not given."),
    click.option("--vertical", is_flag=True, default=None, help="With vertical components."),
    click.option("--pulses", type=float,
                 help="Probability that a motion has the pulse of a near fault."),
    click.option("--seed", type=int, help="What is drawn follows from it; 1 if not given."),
    json_option,
)  # fmt: skip
def make(out: Path, as_json: bool, **wanted: Any) -> None:
    """Make synthetic motions with their index.

    Options are the keys of `motions.synthetic` in a study, which makes the same motions without
    files. Without any of them the motions are those that archfrag ships.

    \b
    Example:
      archfrag records make --events 10 --records-per-event 3 --magnitude 5.5:7.5 \\
        --distance-km 10:100 --out synthetic
    """
    from archfrag.files import counted
    from archfrag.study.record_commands import make_chosen

    paths = make_chosen(out, wanted)
    facts = {"folder": str(out), "files": [str(path) for path in paths]}
    _print(facts, f"{counted(len(paths), 'record')} and index.csv written to {out}", as_json)
