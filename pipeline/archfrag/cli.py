"""The command `archfrag`: thin, and quick to answer because nothing is imported before use."""

import errno
import functools
import json
import os
import shlex
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from archfrag.cli_export import export
from archfrag.cli_records import (
    echo,
    json_option,
    reads_record,
    records,
    set_option,
    study_argument,
    takes,
)
from archfrag.cli_risk import risk


class _Group(click.Group):
    """Commands whose errors are one message and an exit code, but for mistakes of ours.

    Errors of archfrag, of files and of memory are the user's to correct; what else is raised keeps
    its traceback.
    """

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        # Processes that this one starts load no modules from the current folder.
        os.environ["PYTHONSAFEPATH"] = "1"
        return super().__call__(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MemoryError:
            click.echo("archfrag: error: the memory of this machine does not suffice", err=True)
            ctx.exit(1)
        except OSError as error:
            if error.errno == errno.EPIPE or error.strerror is None:
                raise
            place = f"{os.fsdecode(error.filename)}: " if error.filename else ""
            echo(f"archfrag: error: {place}{error.strerror}", err=True)
            ctx.exit(1)
        except Exception as error:
            # Not imported yet means not raised: the import is too slow for --help.
            errors = sys.modules.get("archfrag.errors")
            if errors is None or not isinstance(error, errors.ArchfragError):
                raise
            if not getattr(error, "reported", False):
                echo(f"archfrag: error: {error}", err=True)
            ctx.exit(error.exit_code)


def _version(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        import archfrag
        from archfrag.study.provenance import commit

        echo(f"archfrag {archfrag.__version__} (commit {commit()})")
        ctx.exit()


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version,
              help="Show version and commit, and end.")  # fmt: skip
def main() -> None:
    """From earthquake records to collapse probabilities of masonry arches.

    A study file states which arches, which records and which levels; `archfrag run STUDY` does
    everything up to the report. The other commands are its steps, and answers for one arch.
    """


@main.command()
@click.argument("folder", type=click.Path(path_type=Path), default=".")
def init(folder: Path) -> None:
    """Write a commented study to start from into FOLDER (.).

    The shipped motions come with it.
    """
    from archfrag.study.workflow import write_starter

    echo(f"run it with: archfrag run {shlex.quote(str(write_starter(folder)))}")


main.add_command(records)
main.add_command(export)
main.add_command(risk)

_folder = click.Path(path_type=Path, exists=True, file_okay=False)
_log = click.option("--log", "log_file", type=click.Path(path_type=Path),
                    help="Write messages and errors to this file too.")  # fmt: skip


def _step(command: Callable) -> Callable:
    """Make a command of a step: reads the study file, reports, keeps a log and a stamp."""

    @functools.wraps(command)
    def wrapped(
        study_file: Path, overrides: tuple[str, ...], log_file: Path | None, **options: Any
    ) -> None:
        from archfrag.study.tree import follow_run

        follow_run()
        from archfrag.study.config import load_study
        from archfrag.study.files import check_own
        from archfrag.study.steps import batch_step, finish
        from archfrag.study.workflow import step_log

        name = command.__name__
        with step_log(log_file) as note:
            study = load_study(study_file, overrides)
            check_own(study)
            command(study, note, **options)
            if name == "batch":
                name = batch_step(options["batch"], study.execution.batches)
            if name != "results":  # which has noted each of its steps
                finish(study, name)

    main.command()(study_argument(set_option(_log(wrapped))))
    return command


_PROFILES = ("circular", "segmental", "pointed", "elliptic", "catenary", "block")
_TEXTS = {
    "drawing": "take the blocks from a DXF file: closed polylines, and lines on the ground",
    "layer": "of the drawing; the only one with polylines if not given",
    "drawing_unit": "m, dm, cm, mm, in or ft; what the drawing states if not given",
}
_NUMBERS = {
    "radius": "mid-thickness radius of a circular arch [m]",
    "embrace": "angle between the springings [degrees]",
    "span": "of the centre line [m]",
    "rise": "of the centre line [m]",
    "thickness": "of the ring [m]",
    "width": "of a block [m]",
    "height": "of a block [m]",
    "density": "of the masonry [kg/m3]",
    "depth": "across the plane [m]",
    "thickness_factor": "of a drawing: its joints are longer by it",
}


def _takes_arch(command: Callable) -> Callable:
    """Options that give an arch: by numbers, or by its id in a study file."""

    @functools.wraps(command)
    def wrapped(study: Path | None, arch_id: str | None, **options: Any) -> None:
        names = ("profile", "voussoirs", "friction", "straight", *_TEXTS, *_NUMBERS)
        given = {name: options.pop(name) for name in names}
        from archfrag.study.single import arch_by_numbers, arch_of_study

        command(
            arch_by_numbers(given) if study is None else arch_of_study(study, arch_id), **options
        )

    return takes(
        click.option("--study", type=click.Path(path_type=Path), metavar="STUDY",
                     help="take the arch from a study file"),
        click.option("--arch", "arch_id", metavar="ID", help="which arch of the study"),
        click.option("--profile", type=click.Choice(_PROFILES), default="circular",
                     show_default=True),
        click.option("--voussoirs", type=int, help="number of voussoirs"),
        click.option("--friction", type=float, help="Coulomb coefficient; inf: its limit"),
        click.option("--straight", is_flag=True, help="straight-sided voussoirs"),
        *(click.option(f"--{name.replace('_', '-')}", type=kind, help=text)
          for kind, texts in ((str, _TEXTS), (float, _NUMBERS)) for name, text in texts.items()),
    )(wrapped)  # fmt: skip


@main.command()
@_takes_arch
@json_option
def onset(arch: Any, as_json: bool) -> None:
    """Find the steady ground acceleration that an arch bears.

    Also how it starts to move.
    """
    from archfrag.simulate import onset as find_onset
    from archfrag.study.single import onset_facts, onset_text

    start = find_onset(arch)
    echo(json.dumps(onset_facts(start)) if as_json else onset_text(start))


@main.command()
@_takes_arch
@click.option("--output", type=click.Path(path_type=Path), required=True, metavar="FILE",
              help="DXF file to write.")  # fmt: skip
@click.option("--output-unit", default="m", show_default=True, help="m, dm, cm, mm, in or ft")
def draw(arch: Any, output: Path, output_unit: str) -> None:
    """Draw an arch as DXF.

    Blocks are closed polylines, what they stand on are lines.
    """
    arch.to_dxf(output, output_unit)
    echo(f"drawing: {output}")


@main.command()
@_takes_arch
@click.argument("record", type=click.Path(path_type=Path))
@reads_record
@click.option("--component", help="horizontal component to take, e.g. E")
@click.option("--scale", type=float, default=1.0, show_default=True, help="factor on the record")
@click.option("--pga", type=float, help="peak to scale the record to [g], in place of --scale")
@click.option("--method", default="auto", show_default=True)
@click.option("--dt", type=float, help="time step [s]; the method's default if not given")
@click.option("--rtol", type=float, help="relative error; the method's default if not given")
@click.option("--follow", type=float, default=20.0, show_default=True,
              help="how long to go on past the record's end while the arch moves [s]")  # fmt: skip
@click.option("--mechanism", "history", is_flag=True, help="show how the mechanism changed")
@json_option
def simulate(
    arch: Any, record: Path, scale: float, pga: float | None, as_json: bool, **options: Any
) -> None:
    """Move one arch by one record, until it rests or collapses."""
    from archfrag.arch import STANDARD_GRAVITY
    from archfrag.motions.measures import scale_factor
    from archfrag.motions.read import read_motion
    from archfrag.simulate import simulate as run_simulation
    from archfrag.study.single import response_facts, response_text

    keys = ("unit", "component", "inventory", "accept", "columns")
    reading = {key: options.pop(key) for key in keys}
    motion = read_motion(record, **reading)
    if pga is not None:
        scale = scale_factor(motion, "PGA", pga * STANDARD_GRAVITY)
    response = run_simulation(arch, motion, scale=scale, **options)
    facts = response_facts(response, scale)
    echo(json.dumps(facts) if as_json else response_text(response, scale))


@main.command(hidden=find_spec("archbench") is None)
@click.argument("parts", nargs=-1, metavar="[PART]...")
@takes(
    click.option("--quick", is_flag=True, help="The reduced set: 12 minutes on two cores."),
    click.option("--output", "--out", type=click.Path(path_type=Path, file_okay=False),
                 default=Path("results/evidence"), show_default=True,
                 help="Folder of the tables; the same command continues in it."),
    click.option("--records", type=_folder,
                 help="Folder of the shipped records, if not records/."),
    click.option("--real", type=_folder,
                 help="Folder with real records (at2/*.AT2); without it scenes of them are "
                 "skipped."),
    click.option("--solvers", multiple=True, metavar="NAME",
                 help="Other solver to run beside ours, or all that are installed. Repeatable."),
    click.option("--cores", "--workers", "workers", type=click.IntRange(min=1),
                 help="Cores to use; all if not given."),
)  # fmt: skip
def evidence(parts: tuple[str, ...], output: Path, **options: Any) -> None:
    """Measure cost against error.

    Makes tables, charts and a page. PARTS are speed, fragility, growth, stability, corner_cases,
    bands, designs and compiling; all if none is named. Needs the repository: archbench is not in
    the wheel.
    """
    from importlib import import_module

    from archfrag.errors import InputError

    try:
        gather = import_module("archbench.page").gather
    except ModuleNotFoundError as missing:
        if missing.name is None or not missing.name.startswith("archbench"):
            raise
        raise InputError(
            "archfrag evidence needs archbench, which is not in the wheel; allowed "
            "is an installation from the repository: pip install -e .[bench]"
        ) from None
    echo(gather(parts, output, report=functools.partial(echo, err=True), **options))


@main.command()
@study_argument
@set_option
@json_option
def validate(study_file: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Check a study file and all files that it names.

    Arches, records, hazard and output folder are checked; nothing is run. Of very many arches some
    are checked, and all of them when they are run.
    """
    from dataclasses import asdict

    from archfrag.study.checks import check_study
    from archfrag.study.config import load_study

    found = check_study(load_study(study_file, overrides))
    echo(json.dumps(asdict(found)) if as_json else f"{study_file}: in order; {found}")
    for listed in () if as_json else (*found.classes, *found.partners):
        echo(f"  {listed}")
    for caution in () if as_json else found.cautions:
        echo(f"archfrag: caution: {caution}", err=True)


@main.command()
@click.option("--method", help="Only the kernels of this method; all methods if not given.")
def warmup(method: str | None) -> None:
    """Compile the kernels now, so that nothing waits for it later."""
    from archfrag.simulate import warmup as compile_kernels

    def show(message: str) -> None:
        if sys.stderr.isatty():
            click.echo(f"\r{message}\033[K", err=True, nl=False)
        elif not messages:
            echo(message, err=True)
        messages.append(message)

    messages: list[str] = []
    seconds = compile_kernels(method, show)
    click.echo("\r\033[K" if sys.stderr.isatty() else "", err=True, nl=False)
    echo(f"kernels ready after {seconds:.1f} s")


@main.command()
@study_argument
@set_option
@click.option("--resume", is_flag=True, help="Go on where a run was killed.")
@click.option("--cores", "--workers", type=click.IntRange(min=1),
              help="Cores to use; all if not given.")  # fmt: skip
@click.option("--profile", type=_folder,
              help="Snakemake profile, e.g. configs/profiles/slurm.")  # fmt: skip
@click.option("--quiet", is_flag=True, help="Nothing but errors.")
def run(study_file: Path, overrides: tuple[str, ...], quiet: bool, **options: Any) -> None:
    """Run a study: do all of it that is not done yet.

    That is motions, simulations, cube, curves and report.
    """
    from archfrag.study.config import load_study
    from archfrag.study.tree import Stopped, stoppable
    from archfrag.study.workflow import RunOptions, run_study

    typed = shlex.join(["archfrag", "run", str(study_file), *(f"--set={o}" for o in overrides)])
    try:
        with stoppable() as stop:
            study = load_study(study_file, overrides)
            how = RunOptions(typed=typed, study_file=study_file, quiet=quiet, **options)
            anything = run_study(study, how, stop)
    except Stopped as stopped:
        echo(
            f"archfrag: {stopped}; what is finished is kept, `{typed} --resume` goes on", err=True
        )
        click.get_current_context().exit(128 + stopped.number)
    if not quiet:
        if not anything:
            echo("archfrag: nothing to do: all results are up to date", err=True)
        echo(f"report: {study.folder / 'report.html'}")
        _name_old_exports(study.folder)


def _name_old_exports(folder: Path) -> None:
    from archfrag.files import counted

    exported = [path for path in (folder / "export").glob("*") if path.is_file()]
    made = max((folder / name).stat().st_mtime for name in ("cube.nc", "fits.json"))
    if old := [path for path in exported if path.stat().st_mtime < made]:
        what = f"{counted(len(old), 'file')} older than the results"
        echo(f"archfrag: {folder / 'export'}: {what}; make anew: archfrag export", err=True)


@main.command()
@study_argument
@set_option
@click.option("--yes", is_flag=True, help="Remove without asking.")
def clean(study_file: Path, overrides: tuple[str, ...], yes: bool) -> None:
    """Remove stored runs of no use to a study."""
    from archfrag.files import counted
    from archfrag.study.config import load_study
    from archfrag.study.files import check_own
    from archfrag.study.plan import make_plan
    from archfrag.study.store import count_runs, remove, superfluous
    from archfrag.study.tree import only_run

    study = load_study(study_file, overrides)
    check_own(study)
    plan = make_plan(study)
    with only_run(study) as lock:
        lock.refuse_stopped(study.folder, shlex.join(["archfrag", "run", str(study_file)]))
        found = superfluous(plan)
        for why, paths in found.items():
            size = sum(path.stat().st_size for path in paths) / 1e6
            runs, files = counted(count_runs(paths), "run"), counted(len(paths), "file")
            echo(f"{runs} {why}: {files}, {size:.3g} MB")
        if not found:
            echo("nothing to remove: all stored runs are of use to this study")
        elif yes or click.confirm("Remove them?", abort=True):
            remove([path for paths in found.values() for path in paths])


@_step
def motions(study: Any, note: Callable[[str], None]) -> None:
    """Read the study's records and store them for the workers."""
    from archfrag.files import counted
    from archfrag.study.checks import check_start
    from archfrag.study.records import prepare_motions

    check_start(study)
    stored = prepare_motions(study)
    note(f"motions: {counted(len(stored), 'record')} ready")


@_step
@click.option("--batch", type=int, default=0, show_default=True, help="Which, counted from 0.")
@click.option("--cores", "--workers", type=click.IntRange(min=1),
              help="Cores to use, a worker on each; overrides the study.")  # fmt: skip
@click.option("--quiet", is_flag=True, help="No progress bar.")
def batch(
    study: Any, note: Callable[[str], None], batch: int, cores: int | None, quiet: bool
) -> None:
    """Run the simulations of a batch that are not done yet."""
    from archfrag.files import counted
    from archfrag.study.batch import run_batch

    log = run_batch(study, batch, cores, quiet)
    count = study.execution.batches
    runs = f"{counted(log.runs, 'run')}, {log.kept} kept from before, {log.runs - log.kept} new"
    took = f"{log.wall_time:.1f} s on {counted(log.workers, 'core')}"
    note(f"batch {batch + 1} of {count}: {runs}; {took}")


@_step
def cube(study: Any, note: Callable[[str], None]) -> None:
    """Gather the results into one CF netCDF cube."""
    from archfrag.study.cube import write_cube, write_timings

    path = write_cube(study)
    write_timings(study)
    note(f"cube: {path}")


@_step
@json_option
def fit(study: Any, note: Callable[[str], None], as_json: bool = False) -> None:
    """Fit a fragility curve to each arch and each class."""
    from archfrag.study import fits
    from archfrag.study.members import SHOWN
    from archfrag.study.steps import require

    require(study, "cube")
    found = fits.fit_cube(study)
    for name, curve in list(found.items())[:SHOWN]:
        note(f"fit: {fits.fit_text(study, name, curve)}")
    path = study.folder / fits.FITS
    if len(found) > SHOWN:
        note(f"fit: {len(found) - SHOWN} more arches in {path}")
    for name, curve in fits.load_answers(path, "classes").items():
        note(f"fit: class {fits.fit_text(study, name, curve)}")
    with fits.open_cube(study) as cube:
        for caution in fits.cautions_of_cube(study, cube, found):
            note(f"caution: {caution}")
    if as_json:
        echo(path.read_text(encoding="utf-8"))


@_step
@click.option("--beside", type=click.Path(path_type=Path), metavar="OTHER_STUDY",
              help="Compare the arches with those of another, finished study.")  # fmt: skip
def report(study: Any, note: Callable[[str], None], beside: Path | None = None) -> None:
    """Write the report: one HTML file that needs no network."""
    from archfrag.report.inputs import report_inputs
    from archfrag.report.page import write_report

    inputs = report_inputs(study, beside)
    note(f"report: {write_report(inputs, study.folder / 'report.html')}")


@_step
def results(study: Any, note: Callable[[str], None]) -> None:
    """Make cube, curves and report if they are not up to date."""
    from archfrag.study.steps import finish, is_done

    stale = False
    for name, make in (("cube", cube), ("fit", fit), ("report", report)):
        stale = stale or not is_done(study, name)
        if stale:
            make(study, note)
            finish(study, name)


if __name__ == "__main__":
    main()
