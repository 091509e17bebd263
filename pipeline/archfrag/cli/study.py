"""The commands for a study: `validate`, `run` and its steps, `clean`, `export`, `film`, `risk`."""

import contextlib
import os
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import (
    PATH,
    echo,
    json_option,
    show,
    takes,
    takes_study,
    warn,
    with_study,
    wrapped,
)
from archfrag.errors import FitError, attempt
from archfrag.export import FORMATS
from archfrag.files import counted, printable
from archfrag.report import make_report
from archfrag.study.provenance import check_own

members_option = click.option("--members", is_flag=True,
                              help="Include the arches of classes as well.")  # fmt: skip
cores_option = click.option("--cores", "--workers", type=click.IntRange(min=1),
                            help="Number of cores to use; all by default.")  # fmt: skip


@click.command()
@with_study(json_option)
def validate(study: Any, as_json: bool) -> None:
    """Check a study file and all files that it names.

    Arches, records, hazard and output folder are checked; nothing is run. If there are very many
    arches, only some of them are checked here, and all of them at the start of a run.
    """
    from archfrag.study.validate import check_study

    path, found = click.get_current_context().params["study_file"], check_study(study)
    nouns = {"arches": "arch", "records": "record", "levels": "level"}
    parts = ", ".join(counted(found[key], noun) for key, noun in nouns.items())
    runs = f"{found['extent']} {counted(found['runs'], 'run')}".removeprefix("exactly ")
    text = f"{path}: in order; {parts}, {runs} by design {found['design']}"
    texts = text, *found["drawings"], *found["facts"], *found["classes"], *found["partners"]
    show(found, "\n  ".join(texts), as_json)
    for caution in () if as_json else found["cautions"]:
        warn(f"caution: {caution}")


@click.command()
@takes_study
@takes(
    click.option("--resume", is_flag=True,
                 help="Continue a stopped run; the command also does so without it."),
    cores_option,
    click.option("--quiet", is_flag=True, help="Print errors only."),
)  # fmt: skip
def run(
    study_file: Path, overrides: tuple[str, ...], quiet: bool, resume: bool, cores: int | None
) -> None:
    """Run a study, or continue it, from records to report.

    The steps are motions, simulations, cube, curves and report. After Ctrl-C, a kill or a full
    disk the same command continues.
    """
    if not quiet:  # before the imports, which take a second or more
        warn(f"reading {study_file}")
    from archfrag.study.done import finished_folder

    if (folder := finished_folder(study_file, overrides)) is not None:
        return None if quiet else _point_to(folder, folder if overrides else study_file, False)
    from archfrag.study.file.schema import load_study
    from archfrag.study.steps import run_study

    words = ["archfrag", "run", str(study_file), *(f"--set={each}" for each in overrides)]
    with _stoppable(f"continue with `{shlex.join(words)} --resume`") as check:
        study = load_study(study_file, overrides)
        anything = run_study(study, study_file, check, make_report, cores, quiet, overrides)
        if not quiet:
            if anything:
                _summary(study)
            _point_to(study.folder, study.folder if overrides else study_file, anything)


@contextlib.contextmanager
def _stoppable(again: str) -> Iterator[Callable[[], None]]:
    """Stop at a signal, say how to go on, and end the process, whose kernels would go on."""
    from archfrag.study.running import stoppable

    try:
        with stoppable() as check:
            yield check
    except SystemExit as stopped:
        by = signal.Signals(int(stopped.code or 0) - 128).name
        warn(f"stopped by {by}; what is finished is kept; {again}")
        if threading.active_count() == sum(each.daemon for each in threading.enumerate()) + 1:
            raise
        sys.stdout.flush()
        os._exit(int(stopped.code or 0))  # a thread in a kernel cannot be stopped


def _summary(study: Any) -> None:
    """Print the answers of a finished study."""
    from archfrag.study.answer.fits import fit_lines, load_fits
    from archfrag.study.answer.risk import risk_lines, risk_of_study
    from archfrag.study.validate import arch_texts

    fitted = load_fits(study)
    answers, cautions = fit_lines(study, fitted)
    risk = attempt(lambda: risk_of_study(study, fitted))
    if isinstance(risk, str):
        cautions.append(f"no rates of collapse: {risk}")
    elif risk is not None:  # of a study that has a hazard
        lines, more = risk_lines(risk)
        answers, cautions = answers + lines, cautions + more
    texts = *answers, *arch_texts(study)
    for line in (line for text in texts for line in wrapped(text, 8)):
        echo(line)
    for first, *others in (wrapped(f"! {printable(each)}", 2) for each in cautions):
        click.echo("\n".join([click.style("!", fg="yellow") + first[1:], *others]))


def _point_to(folder: Path, named: Path, anything: bool) -> None:
    """Print the path of the report, and that there was nothing to do if so."""
    if not anything:
        warn("nothing to do: all results are up to date")
    report = folder / "report.html"
    if report.is_relative_to(Path.cwd()):
        report = report.relative_to(Path.cwd())
    echo(f"report  {report}  ({shlex.join(['archfrag', 'open', str(named)])})")


@click.command()
@with_study(click.option("--yes", is_flag=True, help="Remove without asking."))
def clean(study: Any, yes: bool) -> None:
    """Remove stored runs that a study does not use."""
    from archfrag.study.running import only_run
    from archfrag.study.runs.store import make_plan, superfluous

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


STEPS: list[click.Command] = []


def _step(name: str, help_: str, *options: Callable) -> None:
    """Make the command of a step, which also renews the dates of its files for Snakemake."""

    def command(study: Any, batch: int = 0, as_json: bool = False, **given: Any) -> None:
        from archfrag.study.steps import batch_step, claim, make_step, products

        check_own(study)
        if name == "motions":  # the first step, of one process
            claim(study, click.get_current_context().params["study_file"])
        step = batch_step(batch, study.execution.batches) if name == "batch" else name
        with _stoppable("the same command goes on"):
            make_step(study, step, warn, report=make_report, **given)
        for path in filter(Path.is_file, products(study, step)):
            path.touch()
        if as_json:
            echo(products(study, step)[0].read_text(encoding="utf-8"))

    STEPS.append(click.command(name, help=help_)(with_study(*options)(command)))


_step("motions", "Read the study's records and store them for the workers.")
_step("batch", "Run the simulations of a batch that are missing.",
      click.option("--batch", type=int, default=0, show_default=True,
                   help="Its number, from 0."), cores_option,
      click.option("--quiet", is_flag=True, help="No progress bar."))  # fmt: skip
_step("cube", "Gather the results into one CF netCDF cube.")
_step("fit", "Fit a fragility curve to each arch and each class.", json_option)
_step("report", "Write the report: one HTML file that needs no network.",
      click.option("--compare", "compared", type=PATH, metavar="OTHER_STUDY",
                   help="Compare the arches with those of another, finished study."))  # fmt: skip


_FORMATS = (f"{name:15}  {about}" for name, (about, _, _) in FORMATS.items())


@click.command(epilog="\b\nFormats:\n" + "\n".join(_FORMATS))
@with_study(
    click.option("--format", "formats", multiple=True, required=True, type=click.Choice(FORMATS),
                 help="Format to write. Repeatable."),
    click.option("--limit-state", "limit_states", multiple=True, metavar="NAME",
                 help="Limit state to write besides collapse: motion, impact, residual, "
                 "rotation or contact_lost; all if not given. Repeatable."),
    click.option("--out", type=click.Path(path_type=Path, file_okay=False), metavar="FOLDER",
                 help="Folder to write to; `export` in the results folder if not given."),
    members_option, json_option,
)  # fmt: skip
def export(
    study: Any, formats: tuple[str, ...], limit_states: tuple[str, ...], out: Path | None,
    members: bool, as_json: bool,
) -> None:  # fmt: skip
    """Export a finished study in the formats of other programs.

    OpenQuake, pelicun and IN-CORE get PGA, Sa and AvgSA in g, and PGV in cm/s. A class of arches
    has one curve, the mean of those of its arches. An arch without a curve is in the tables of
    runs, records and arches only, and a message states why.

    All limit states with a curve are written, and a note names the others and the reason. If the
    curve of a state lies below that of a severer one by more than 0.01 in probability, it takes up
    that one's dispersion as far as needed, and a note states it. The files hold these notes too.
    """
    from archfrag.export.command import export_study

    made = export_study(study, formats, out, members, limit_states)
    for arch, why in made["left_out"].items():
        warn(f"no curve of {arch} is exported: {why}")
    for message in made["notes"]:
        warn(f"note: {message}")
    lines = [f"{each['format']}: {each['file']}" for each in made["files"]]
    states = made["limit_states"]
    lines.append(f"limit states written: {len(states)} ({', '.join(states) or 'no curve'})")
    show(made, "\n".join(lines), as_json)


@click.command()
@with_study(
    click.option("--run", "run_name", default="median", show_default=True,
                 metavar="RECORD@LEVEL",
                 help="Run to show, its level in the study's unit; or median: the record with "
                 "the capacity nearest the median."),
    click.option("--arch", metavar="ID", help="Id of the arch; the first one if not given."),
    click.option("--to", "path", type=PATH, default="film.gif", show_default=True,
                 metavar="FILE", help="File to write: .gif, .mp4 or .svg."),
)  # fmt: skip
def film(study: Any, run_name: str, arch: str | None, path: Path) -> None:
    """Film one run of a finished study, simulated again.

    A browser plays .svg; .mp4 needs ffmpeg.

    \b
    Example:
      archfrag film study.yaml --run syn-m75-r015@0.5 --to fall.gif
    """
    from archfrag.report.film import check_target, example_of, save_film

    check_target(path)
    example = example_of(study, run_name, arch)
    save_film(example, path)
    echo(f"film: {path}: {example.motion.id} at {example.level}, {example.reason}")


def _site(context: click.Context, parameter: click.Parameter, text: str | None) -> Any:
    try:
        lon, lat = map(float, text.split(",")) if text else (None, None)
    except ValueError:
        rule = "must be longitude and latitude, such as 13.35,42.35"
        raise click.BadParameter(f"{text!r} {rule}") from None
    return (lon, lat) if text else None


@click.command()
@with_study(
    click.option("--hazard", "hazards", type=PATH, required=True, multiple=True, metavar="FILE",
                 help="Hazard curve of the site. Repeatable: OpenQuake's mean and quantiles."),
    click.option("--unit", help="Unit of the intensities of a CSV whose header has none."),
    click.option("--years", type=float, default=50.0, show_default=True,
                 help="Period for the probability of collapse [years]."),
    click.option("--site", callback=_site, metavar="LON,LAT",
                 help="Place: the nearest site of OpenQuake's file within 10 km."),
    click.option("--confidence", type=float, default=0.9, show_default=True, help="Of all bands."),
    members_option, json_option,
)  # fmt: skip
def risk(
    study: Any, hazards: tuple[Path, ...], unit: str | None, site: Any, years: float,
    confidence: float, members: bool, as_json: bool,
) -> None:  # fmt: skip
    """Find the rate of collapse of a finished STUDY at a site.

    A class of arches has one rate, the mean of those of its arches.

    FILE is a CSV file with a column `im [g]` or of the measure's name, such as `PGA [g]`, a column
    `rate` (also `annual rate`, `annual rate of exceedance`, `annual frequency of exceedance`,
    `afe`, `mafe`, `lambda`), `poe_50` (probability of exceedance in 50 years) or `return period`
    [years], and a column `rate_NAME` or `poe_50_NAME` for each quantile. Upper and lower case,
    brackets [ ] or ( ), and the separators , ; and tab are all read. OpenQuake's hazard curves in
    CSV work too. The measure must be that of the study.

    \b
    Example:
      archfrag risk study.yaml --hazard hazard_curve-mean-PGA_1.csv --site 13.35,42.35
    """
    from archfrag.study.answer.risk import risk_facts, risk_of, risk_text
    from archfrag.study.hazard import load_hazard
    from archfrag.study.steps import finished

    hazard = load_hazard(hazards, study.intensity.measure, unit, site)
    fitted = finished(study)
    rates = risk_of(fitted.cube, fitted.quoted(members), hazard, years, confidence)
    facts = risk_facts(rates, study)
    show(facts, risk_text(facts), as_json)
    if all("none" in arch for arch in facts["arches"].values()):
        raise FitError("no arch has a curve, so there is no rate")
