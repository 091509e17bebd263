"""The commands for a study: `validate`, `run`, `clean` and the steps of a run."""

import contextlib
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import (
    PATH,
    cores_option,
    echo,
    json_option,
    show,
    takes,
    takes_study,
    warn,
)


@click.command()
@takes_study
@json_option
def validate(study_file: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Check a study file and all files that it names.

    Arches, records, hazard and output folder are checked; nothing is run. If there are very many
    arches, only some of them are checked here, and all of them at the start of a run.
    """
    from archfrag.files import counted
    from archfrag.study.checks import check_study
    from archfrag.study.file.schema import load_study

    found = check_study(load_study(study_file, overrides))
    nouns = {"arches": "arch", "records": "record", "levels": "level"}
    parts = ", ".join(counted(found[key], noun) for key, noun in nouns.items())
    runs = f"{found['extent']} {counted(found['runs'], 'run')}".removeprefix("exactly ")
    design = "" if found["design"] == "stripes" else f" by design {found['design']}"
    show(found, f"{study_file}: in order; {parts}, {runs}{design}", as_json)
    for listed in () if as_json else (*found["classes"], *found["partners"]):
        echo(f"  {listed}")
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
    from archfrag.study.file.schema import load_study
    from archfrag.study.running import Stopped, stoppable, without_dask
    from archfrag.study.steps import Options, run_study

    typed = shlex.join(["archfrag", "run", str(study_file), *(f"--set={o}" for o in overrides)])
    try:
        with stoppable() as stop, contextlib.ExitStack() as stack:
            study = load_study(study_file, overrides)
            if study.execution.scheduler is None:
                stack.enter_context(without_dask())
            anything = run_study(study, study_file, Options(_report, cores, quiet), stop)
    except Stopped as stopped:
        warn(f"{stopped}; what is finished is kept; continue with `{typed} --resume`")
        click.get_current_context().exit(128 + stopped.number)
    if not quiet:
        if not anything:
            warn("nothing to do: all results are up to date")
        echo(f"report: {study.folder / 'report.html'}")
        _name_old_exports(study.folder)


def _report(study: Any, compared: Path | None) -> Path:
    from archfrag.report.inputs import report_inputs
    from archfrag.report.page import write_report

    return write_report(report_inputs(study, compared), study.folder / "report.html")


def _name_old_exports(folder: Path) -> None:
    from archfrag.files import counted

    exported = [path for path in (folder / "export").glob("*") if path.is_file()]
    made = max((folder / name).stat().st_mtime for name in ("cube.nc", "fits.json"))
    if old := [path for path in exported if path.stat().st_mtime < made]:
        what = f"{counted(len(old), 'file')} older than the results"
        warn(f"{folder / 'export'}: {what}; run archfrag export again")


@click.command()
@takes_study
@click.option("--yes", is_flag=True, help="Remove without asking.")
def clean(study_file: Path, overrides: tuple[str, ...], yes: bool) -> None:
    """Remove stored runs that a study does not use."""
    from archfrag.files import counted
    from archfrag.study.file.schema import load_study
    from archfrag.study.files import check_own
    from archfrag.study.running import only_run
    from archfrag.study.runs.plan import make_plan
    from archfrag.study.runs.store import count_runs, remove, superfluous

    study = load_study(study_file, overrides)
    check_own(study)
    plan = make_plan(study)
    with only_run(study):
        found = superfluous(plan)
        for why, paths in found.items():
            size = sum(path.stat().st_size for path in paths) / 1e6
            runs, files = counted(count_runs(paths), "run"), counted(len(paths), "file")
            echo(f"{runs} {why}: {files}, {size:.3g} MB")
        if not found:
            echo("nothing to remove: this study uses all stored runs")
        elif yes or click.confirm("Remove them?", abort=True):
            remove([path for paths in found.values() for path in paths])


STEPS: list[click.Command] = []
_QUIET = click.option("--quiet", is_flag=True, help="No progress bar.")


def _step(name: str, help_: str, *options: Callable) -> None:
    """Make the command of a step, which also renews the dates of its files for Snakemake."""

    def command(
        study_file: Path, overrides: tuple[str, ...], batch: int = 0, as_json: bool = False,
        **given: Any,
    ) -> None:  # fmt: skip
        from archfrag.study.file.schema import load_study
        from archfrag.study.files import check_own
        from archfrag.study.steps import Options, batch_step, make_step, products

        study = load_study(study_file, overrides)
        check_own(study)
        step = batch_step(batch, study.execution.batches) if name == "batch" else name
        make_step(study, step, warn, Options(_report, **given))
        for path in filter(Path.is_file, products(study, step)):
            path.touch()
        if as_json:
            echo(products(study, step)[0].read_text(encoding="utf-8"))

    STEPS.append(click.command(name, help=help_)(takes_study(takes(*options)(command))))


_step("motions", "Read the study's records and store them for the workers.")
_step("batch", "Run the simulations of a batch that are missing.",
      click.option("--batch", type=int, default=0, show_default=True,
                   help="Its number, from 0."), cores_option, _QUIET)  # fmt: skip
_step("cube", "Gather the results into one CF netCDF cube.")
_step("fit", "Fit a fragility curve to each arch and each class.", json_option)
_step("report", "Write the report: one HTML file that needs no network.",
      click.option("--compare", "--beside", "compared", type=PATH, metavar="OTHER_STUDY",
                   help="Compare the arches with those of another, finished study."))  # fmt: skip
