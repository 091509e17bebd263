"""The commands for a study: `init`, `warmup`, `validate`, the steps of a run, and `clean`."""

import contextlib
import functools
import os
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from archfrag.cli import COMMANDS
from archfrag.cli.options import (
    PATH,
    command,
    cores_option,
    echo,
    json_option,
    method_option,
    option,
    pairs_of,
    point_to_report,
    refuse_given,
    show,
    takes,
    takes_study,
    warn,
    wrapped,
)
from archfrag.errors import FitError
from archfrag.export import FORMATS
from archfrag.files import cannot_write, counted, printable
from archfrag.report import make_report
from archfrag.simulation.warmup import warmup as compile_kernels
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import FITS, fit_runs, load_fits
from archfrag.study.answer.outside import read_runs
from archfrag.study.answer.rates import answer_lines
from archfrag.study.file.schema import RiskKeys, load_study
from archfrag.study.hazard import load_hazard
from archfrag.study.provenance import check_own, claim, products
from archfrag.study.runs.store import make_plan, superfluous
from archfrag.study.steps import make_step, only_run, run_study
from archfrag.study.validate import arch_texts, check_study, write_starter
from archfrag.system import Deferred, stoppable

exports = Deferred("archfrag.export.command")


def with_study(*options: Callable) -> Callable:
    """Return a decorator that gives a command options, and a study read from its file."""

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def wrapped(study_file: Path, overrides: tuple[str, ...], **given) -> None:
            command(load_study(study_file, overrides), **given)

        return takes(takes_study, *options)(wrapped)

    return decorate


@command()
@click.argument("folder", type=PATH, default=".")
def init(folder: Path) -> None:
    """Write a commented study into FOLDER (.), to start from.

    The shipped motions come with it.
    """
    echo(f"run it with: archfrag run {shlex.quote(str(write_starter(folder)))}")


@command()
@method_option(None, "Only the kernels of this method; all methods if not given.")
def warmup(method: str | None) -> None:
    """Compile the kernels now, so that later commands start at once."""

    def show_line(message: str) -> None:
        click.echo(f"\r{message}\033[K", err=True, nl=False)

    seconds = compile_kernels(method, show_line if sys.stderr.isatty() else None)
    click.echo("\r\033[K" if sys.stderr.isatty() else "", err=True, nl=False)
    echo(f"kernels ready after {seconds:.1f} s")


@command()
@with_study(json_option)
def validate(study, as_json: bool) -> None:
    """Check a study file and all files that it names.

    Arches, records, hazard and output folder are checked; nothing is run. If there are very many
    arches, only some of them are checked here, and all of them at the start of a run.
    """
    path = click.get_current_context().params["study_file"]
    found = check_study(study)
    nouns = {"arches": "arch", "records": "record", "levels": "level"}
    parts = ", ".join(counted(found[key], noun) for key, noun in nouns.items())
    runs = f"{found['extent']} {counted(found['runs'], 'run')}".removeprefix("exactly ")
    texts = [f"{path}: in order; {parts}, {runs} by design {found['design']}"]
    for key in ("drawings", "facts", "classes", "partners"):
        texts += found[key]
    show(found, "\n  ".join(texts), as_json)
    for caution in () if as_json else found["cautions"]:
        warn(f"caution: {caution}")


def run_all(
    study_file: Path, overrides: tuple[str, ...], cores: int | None, quiet: bool
) -> None:
    """Make what is missing of a study, and print its answers."""
    more = (f"--set={each}" for each in overrides)
    words = ["archfrag", "run", str(study_file), *more]
    with _stoppable(f"continue with `{shlex.join(words)} --resume`") as check:
        study = load_study(study_file, overrides)
        anything = run_study(study, study_file, check, make_report, cores, quiet)
        if not quiet:
            if anything:
                _summary(study, load_fits(study))
            point_to_report(
                study.folder, study.folder if overrides else study_file, anything
            )


@contextlib.contextmanager
def _stoppable(again: str) -> Iterator[Callable[[], None]]:
    """Stop at a signal, print how to continue, and end the process.

    The process ends even if a thread is in a kernel, which would go on. `again` is the hint.
    """
    try:
        with stoppable() as check:
            yield check
    except SystemExit as stopped:
        by = signal.Signals(int(stopped.code or 0) - 128).name
        warn(f"stopped by {by}; what is finished is kept; {again}")
        if (
            threading.active_count()
            == sum(each.daemon for each in threading.enumerate()) + 1
        ):
            raise
        sys.stdout.flush()
        os._exit(int(stopped.code or 0))  # a thread in a kernel cannot be stopped


def _summary(study, fitted: Fitted) -> None:
    """Print the answers of a finished study, or of a table."""
    answers, cautions = answer_lines(study, fitted)
    for text in (*answers, *(arch_texts(study) if study.arches else ())):
        echo("\n".join(wrapped(text, 8)))
    for each in cautions:
        text = "\n".join(wrapped(f"! {printable(each)}", 2))
        click.echo(click.style("!", fg="yellow") + text[1:])


@command()
@with_study(option("--yes", bool, "Remove without asking."))
def clean(study, yes: bool) -> None:
    """Remove stored runs that a study does not use."""
    check_own(study)
    plan = make_plan(study)
    with only_run(study):
        found = superfluous(plan)
        for why, paths in found.items():
            size = sum(path.stat().st_size for path in paths) / 1e6
            echo(f"{counted(len(paths), 'file')} of runs {why}, {size:.3g} MB")
        if not found:
            echo("nothing to remove: this study uses all stored runs")
        elif yes or click.confirm("Remove them?", abort=True):
            for path in (path for paths in found.values() for path in paths):
                path.unlink()
                with contextlib.suppress(OSError):  # a folder that is not empty yet
                    path.parent.rmdir()


def _step(name: str, *options: Callable) -> click.Command:
    """Return the command of a step.

    The command also renews the dates of the step's files, for Snakemake.
    """

    def make(study, batch: int = 0, as_json: bool = False, **given) -> None:
        check_own(study)
        if name == "motions":  # the first step, of one process
            claim(study, click.get_current_context().params["study_file"])
        step = name
        if name == "batch":
            step = f"batch-{batch}of{study.execution.batches}"
        with _stoppable("the same command goes on"):
            make_step(study, step, warn, report=make_report, **given)
        for path in filter(Path.is_file, products(study, step)):
            try:
                path.touch()
            except OSError as error:
                raise cannot_write(path, error) from error
        if as_json:
            echo(products(study, step)[0].read_text(encoding="utf-8"))

    return command(name, help=COMMANDS[name][1])(with_study(*options)(make))


motions_command = _step("motions")
batch_command = _step(
    "batch",
    option("--batch", int, "Its number, from 0.", 0),
    cores_option,
    option("--quiet", bool, "No progress bar."),
)
cube_command = _step("cube")
_fit_study: Any = _step("fit", json_option).callback
report_command = _step("report")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


@command("fit")
@takes_study
@option(
    "--columns",
    str,
    "Names of columns by what they hold: intensity=PGA,verdict=fell.",
    multiple=True,
    callback=pairs_of,
    metavar="WHAT=NAME,...",
)
@option("--measure", str, "Measure of the intensity, if its column does not state it.")
@option("--unit", str, "Unit of the intensity, if its column does not state it.")
@click.option(
    "--states",
    type=_names,
    metavar="NAME,...",
    default="",
    help="Damage states of a column, in order, from none to collapse.",
)
@option("--confidence", float, "Of all bands.", 0.9)
@option("--hazard", PATH, "Hazard curve of a site, for the rate of collapse.")
@option("--output", PATH, "Folder to write to; results/NAME if not given.")
@option(
    "--format formats",
    click.Choice(FORMATS),
    "Format to export to, as `archfrag export` does. Repeatable.",
    multiple=True,
)
@json_option
def fit_command(
    study_file: Path, overrides: tuple[str, ...], as_json: bool, **given
) -> None:
    """Fit fragility curves to a table of verdicts, or to a study.

    STUDY is a CSV file of verdicts of any program or experiment: a row for each run, with columns
    record, event, `PGA [g]` (or intensity) and verdict (collapsed or survived, 1 or 0); or for
    each record, with columns lower and upper. Of a study only --set and --json have a meaning.

    \b
    Example:
      archfrag fit tests.csv --columns "intensity=table PGA,verdict=fell" --measure PGA --unit g
    """
    if study_file.suffix.lower() not in (".csv", ".tsv", ".txt"):
        refuse_given(f"{study_file} is no table of verdicts", *given)
        return _fit_study(study_file, overrides, as_json=as_json)
    refuse_given(f"{study_file} is no study file", "overrides")
    hazard = given.pop("hazard")
    formats = given.pop("formats")
    study, cube = read_runs(study_file, **given)
    if hazard is not None:
        load_hazard([hazard], study.intensity.measure)  # before anything is written
        study = study.model_copy(
            update={"risk": RiskKeys.model_construct(hazard=str(hazard))}
        )
    fitted = fit_runs(study, cube)
    report = make_report(study, fitted)
    files = (
        exports.export_study(study, formats, fitted=fitted)["files"] if formats else ()
    )
    if as_json:
        return echo((study.folder / FITS).read_text("utf-8"))
    _summary(study, fitted)
    for each in files:
        echo(f"{each['format']}: {each['file']}")
    echo(f"report  {report}")
    if not any(curve.fitted for curve in fitted.curves.values()):
        raise FitError("the table gives no curve")
    return None
