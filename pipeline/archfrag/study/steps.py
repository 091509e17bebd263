"""The steps of a study in their order, with a lock on its folder and a stop by signals.

Runs that are stored are kept. Cube, fit and report are made again whenever anything has changed.
"""

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from tqdm import tqdm

from archfrag.errors import ArchfragError, InputError, OutputError
from archfrag.files import (
    cannot_write,
    counted,
    make_folder,
    printable,
    relative_path,
    write_csv,
)
from archfrag.simulation.warmup import TICK
from archfrag.study import provenance
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.fits import fit_cube, fit_lines, load_fits
from archfrag.study.file.prepared import (
    load_prepared,
    prepare_motions,
    read_manifest,
    study_inputs,
)
from archfrag.study.file.schema import StudyKeys
from archfrag.study.file.sources import input_paths
from archfrag.study.provenance import products
from archfrag.study.runs.execute import run_batch
from archfrag.study.validate import check_start
from archfrag.system import every, locked

if TYPE_CHECKING:
    from archfrag.study.answer.curves import Fitted

_MOST_LINES = 8  # on what changed
Say = Callable[[str], None]
Report = Callable[[StudyKeys], Path]  # writes the report; from a layer above


def batches(study: StudyKeys) -> list[str]:
    """Return the names of the steps that make the runs of a study, one for each batch."""
    count = study.execution.batches
    return [f"batch-{number}of{count}" for number in range(count)]


def _tables(study: StudyKeys) -> list[Path]:
    """Return the paths of the tables of runs, one for each batch."""
    return [path for step in batches(study) for path in products(study, step)]


def read_timings(study: StudyKeys) -> dict[str, list[float]]:
    """Return the wall times of the runs by arch [s]; empty if a table of runs is missing."""
    paths = _tables(study)
    if not all(path.is_file() for path in paths):
        return {}
    table = pd.concat([pd.read_csv(path, converters={"arch": str}) for path in paths])
    return {str(name): own.tolist() for name, own in table.groupby("arch")["wall_time"]}


def make_step(
    study: StudyKeys,
    step: str,
    say: Say | None,
    *,
    report: Report | None = None,
    cores: int | None = None,
    quiet: bool = False,
) -> None:
    """Make one step of a study: motions, a batch of runs, cube, fit or report.

    The steps before it must have been made. `say`, if given, is called with each line for the
    user. `report` writes the report; only that step needs it. `cores` replaces the study's number
    of workers. If `quiet`, no progress is shown.
    """
    told: Say = say or (lambda text: None)
    if step == "motions":
        check_start(study)
        told(f"motions: {counted(len(prepare_motions(study)), 'record')} ready")
        return
    if step.startswith("batch"):
        _make_batch(study, step, told, cores, quiet)
        return
    provenance.check_outputs(study, step)
    if step == "cube":
        told(f"cube: {write_cube(study)}")
    elif step == "fit":
        _require(study, "cube")
        fitted = fit_cube(study)
        if say:
            answers, cautions = fit_lines(study, fitted)
            for line in (*answers, *(f"caution: {each}" for each in cautions)):
                say(line)
    elif report is not None:
        told(f"report: {report(study)}")
    provenance.write_stamp(study, step)


def _make_batch(
    study: StudyKeys, step: str, told: Say, cores: int | None, quiet: bool
) -> None:
    """Make the runs of a batch that are missing, and the table of all its runs."""
    batch, count = map(int, step.removeprefix("batch-").split("of"))
    log, table = run_batch(study, batch, cores, quiet)
    (path,) = products(study, step)
    make_folder(path.parent)
    write_csv(path, [table])
    name = f"batch {batch + 1} of {count}: " if count > 1 else "simulations: "
    new = log["runs"] - log["kept"]
    text = f"{name}{counted(log['runs'], 'run')}, {log['kept']} kept from before, {new} new"
    if new:
        text += (
            f"; {log['wall_time'] - log['compile_time']:.1f} s on "
            f"{counted(log['workers'], 'core')}"
        )
    told(text)


def _require(study: StudyKeys, *steps: str) -> None:
    """Raise InputError if the results of one of `steps` are missing or out of date."""
    for step in steps:
        wrong = provenance.out_of_date(study, step)
        if wrong:
            raise InputError(
                f"{wrong}; `archfrag {step}` on the study file makes it again"
            )


def finished(study: StudyKeys) -> "Fitted":
    """Return the curves and the cube of a study; InputError if they are missing or out of date."""
    _require(study, "cube", "fit")
    return load_fits(study)


def changed_since(study: StudyKeys) -> tuple[bool, list[str]]:
    """Return whether the stored motions can be used, and a list of changes since the last run."""
    inputs = study_inputs(study)
    try:
        manifest = read_manifest(study)
        changed = provenance.changes(manifest["inputs"], inputs, study.folder)
        if changed:
            return False, changed
        load_prepared(study)
    except InputError as error:
        return False, [str(error)] if products(study, "motions")[0].exists() else []
    if provenance.read_stamp(study.folder)["from"]:
        changed = list(
            filter(None, [provenance.out_of_date(study, "cube", "fit", "report")])
        )
    return manifest["code"] == provenance.code(), changed


def run_study(
    study: StudyKeys,
    study_file: Path,
    check_stopped: Callable[[], None],
    report: Report,
    cores: int | None = None,
    quiet: bool = False,
) -> bool:
    """Run all steps of a study that are not done yet; return whether there were any.

    `check_stopped` raises between steps if a signal came, as that of `stoppable` does. `report`
    writes the report. `cores` replaces the study's number of workers. ArchfragError if an input
    changes during the run.
    """
    provenance.check_own(study)
    if provenance.finished_folder(study_file, *study.given):
        return False
    check_start(study)

    def say(text: str) -> None:
        if not quiet:
            print(f"archfrag: {printable(text)}", file=sys.stderr, flush=True)

    make_folder(study.work)
    with only_run(study):
        provenance.claim(study, study_file)
        ready, changed = changed_since(study)
        for line in changed[:_MOST_LINES]:
            say(line)
        if changed:
            say(
                "what follows from it is made again; other runs that are finished are kept"
            )
        named = provenance.files_named(study)
        before = provenance.contents(study.folder, named)
        for step in (*["motions"] * (not ready), *batches(study)):
            check_stopped()
            make_step(study, step, say, cores=cores, quiet=quiet)
        for step in ("cube", "fit", "report"):
            check_stopped()
            with clock(step, say, quiet):  # the answers are for the end of the run
                make_step(study, step, None, report=report)
        inputs = provenance.contents(study.folder, _places(study))
        late = provenance.changes(
            read_manifest(study)["inputs"], study_inputs(study), study.folder
        )
        now = provenance.contents(study.folder, named)
        late += [f"{path} has changed" for path in named if now[path] != before[path]]
        if late:
            raise ArchfragError(
                f"{study.folder}: {late[0]}, while the run was at work; the same command makes "
                "it again"
            )
        provenance.write_stamp(study, "report", inputs=inputs)
    return True


def _places(study: StudyKeys) -> set[str]:
    """Return the paths that must be unchanged if the next run is to find nothing to do.

    These are inputs, the folders of records, stored motions and the tables of runs. Paths are
    relative to the folder of the results, and may be patterns.
    """
    inputs = input_paths(study)
    stored = [each.stored for record in load_prepared(study) for each in record.motions]
    paths: Iterator[str | Path] = chain(
        *inputs.values(),
        (path.parent for path in inputs["record"]),
        (os.path.dirname(entry.path) for entry in study.motions.files),
        provenance.files_named(study),
        (study.work / file for file in stored),
        products(study, "motions"),
        _tables(study),
    )
    return {relative_path(path, study.folder) for path in paths}


@contextlib.contextmanager
def clock(what: str, say: Callable[[str], None], quiet: bool) -> Iterator[None]:
    """Say how long the block took; meanwhile show the time elapsed on a terminal.

    If `quiet`, the time elapsed is not shown. `what` names the block.
    """
    started = time.perf_counter()
    form = f"archfrag: {what}: {{elapsed}}"
    hidden = quiet or not sys.stderr.isatty()
    with (
        tqdm(bar_format=form, leave=False, disable=hidden) as bar,
        every(TICK, bar.refresh),
    ):
        yield
    say(f"{what}: {time.perf_counter() - started:.1f} s")


@contextlib.contextmanager
def only_run(study: StudyKeys) -> Iterator[None]:
    """Hold the lock of a study's folder during the block.

    OutputError if another run holds it. The system releases the lock whatever ends the process. A
    file system that has no locks gives none.
    """
    path = study.work / "lock"
    with contextlib.ExitStack() as stack:
        try:
            ours = stack.enter_context(locked(path))
        except OSError as error:
            raise cannot_write(path, error) from error
        if not ours:
            raise OutputError(
                f"{study.folder}: another run of study {study.id!r} is at work here; wait "
                "for it or stop it"
            )
        yield
