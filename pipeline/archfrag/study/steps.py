"""The steps of a study, one after the other: each does nothing where its result is current.

A study has one stamp: of each step that is done digests of what it was made from, and the SHA-256
of what it made; and one digest of all, if all is done. Times of modification decide nothing.
"""

import contextlib
import os
import sys
from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from archfrag.errors import ArchfragError, InputError, OutputError
from archfrag.files import counted, make_folder, printable, write_csv
from archfrag.study import provenance
from archfrag.study.answer.attributes import attributes
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.fits import fit_cube, fit_lines, load_fits
from archfrag.study.done import stamp_of_all
from archfrag.study.file.prepared import (
    MANIFEST,
    prepare_motions,
    read_manifest,
    study_inputs,
)
from archfrag.study.file.schema import StudyKeys
from archfrag.study.file.sources import input_paths
from archfrag.study.products import check_outputs, products, step_names
from archfrag.study.running import clock, only_run
from archfrag.study.runs.execute import run_batch
from archfrag.study.runs.store import Plan, gather, make_plan
from archfrag.study.validate import check_start

if TYPE_CHECKING:
    from archfrag.study.answer.curves import Fitted

_MOST_LINES = 8  # on what changed
Say = Callable[[str], None]
Report = Callable[[StudyKeys], Path]  # writes it: of a layer above


def _tables(study: StudyKeys) -> list[Path]:
    """Return the tables of the runs of all batches."""
    return [
        products(study, name)[0]
        for name in step_names(study)
        if name.startswith("batch")
    ]


def read_timings(study: StudyKeys) -> dict[str, list[float]]:
    """Return the wall times of the runs of each arch [s]; empty if their tables are not there."""
    paths = _tables(study)
    if not all(path.is_file() for path in paths):
        return {}
    table = pd.concat([pd.read_csv(path, converters={"arch": str}) for path in paths])
    return {str(name): own.tolist() for name, own in table.groupby("arch")["wall_time"]}


def make_step(
    study: StudyKeys,
    step: str,
    say: Say | None,
    plan: Plan | None = None,
    *,
    report: Report | None = None,
    cores: int | None = None,
    quiet: bool = False,
) -> None:
    """Make one step of `step_names`, whose inputs are there, unless it is current.

    `say`, if any, takes a line for the user; `plan` is that of the study, if known; `cores` take
    the place of the study's workers.
    """
    told: Say = say or (lambda text: None)
    if step == "motions":
        if "motions" not in stale_steps(study)[0]:
            return
        check_start(study)
        told(f"motions: {counted(len(prepare_motions(study)), 'record')} ready")
        return finish(study, step)
    plan = plan or make_plan(study)
    if step.startswith("batch"):
        return _make_batch(study, step, told, plan, cores, quiet)
    if not out_of_date(study, step, plan):
        return None
    check_outputs(study, [step])
    if step == "cube":
        told(f"cube: {write_cube(study, plan)}")
    elif step == "fit":
        require(study, "cube", plan)
        fitted = fit_cube(study)
        answers, cautions = fit_lines(study, fitted) if say else ([], [])
        for line in [*answers, *(f"caution: {each}" for each in cautions)]:
            told(line)
    elif report is not None:
        told(f"report: {report(study)}")
    return finish(study, step, plan)


def _make_batch(
    study: StudyKeys, step: str, told: Say, plan: Plan, cores: int | None, quiet: bool
) -> None:
    """Make the runs of a batch that are missing, and the table of all its runs."""
    batch, batches = map(int, step.removeprefix("batch-").split("of"))
    log, table = run_batch(study, batch, cores, quiet, plan)
    (path,) = products(study, step)
    make_folder(path.parent)
    write_csv(path, [table])
    name = f"batch {batch + 1} of {batches}: " if batches > 1 else "simulations: "
    seconds = log["wall_time"] - log["compile_time"]
    new = log["runs"] - log["kept"]
    took = f"; {seconds:.1f} s on {counted(log['workers'], 'core')}" if new else ""
    told(
        f"{name}{counted(log['runs'], 'run')}, {log['kept']} kept from before, {new} new{took}"
    )


def finish(study: StudyKeys, step: str, plan: Plan | None = None) -> None:
    """Put a step into the study's stamp; remove figures that it made before and not now.

    Batches, which may end at the same time, are not in it: their runs are known by their parts.
    """
    made = {
        os.path.relpath(path, study.folder): provenance.sha256_if_there(path)
        for path in products(study, step)
        if path.is_file()
    }
    for name, digest in provenance.read_stamp(study, step)[1].items():
        path = study.folder / name
        ours = (
            name not in made
            and provenance.FIGURE.fullmatch(name)
            and not path.is_symlink()
        )
        if ours and provenance.sha256_if_there(path) == digest:
            path.unlink(missing_ok=True)
    stamp = {"from": _made_from(study, step, plan), "files": made}
    provenance.write_stamp(study.work, step, stamp)


def require(study: StudyKeys, step: str, plan: Plan | None = None) -> None:
    """See that the results of a step are those of the study as it is; else InputError."""
    if wrong := out_of_date(study, step, plan):
        raise InputError(f"{wrong}; `archfrag {step}` on the study file makes it again")


def finished(study: StudyKeys) -> "Fitted":
    """Return cube and answers of a study; InputError if they are out of date."""
    require(study, "cube")
    require(study, "fit")
    return load_fits(study)


def stale_steps(study: StudyKeys) -> tuple[list[str], list[str]]:
    """Return the steps to be done, and what has changed since they were done last."""
    names = step_names(study)
    inputs = study_inputs(study)
    try:
        if changed := provenance.changes(
            read_manifest(study)["inputs"], inputs, study.folder
        ):
            return names, changed
        plan = make_plan(study)
    except InputError as error:
        return names, [str(error)] if (study.work / MANIFEST).exists() else []
    for step in ("motions", *names[-3:]):
        if wrong := out_of_date(study, step, plan):
            known = provenance.read_stamp(study, step)[0]
            if step == "cube" and not _runs_are_there(study, plan, known):
                step = names[1]
            return names[names.index(step) :], [wrong] * (known is not None)
    return [], []


def _runs_are_there(
    study: StudyKeys, plan: Plan, before: dict[str, str] | None
) -> bool:
    """Return whether all runs of a plan are made, and that of the cube `before`, if any, was the
    same.
    """
    now = {name: provenance.digest_of(digest) for name, digest in plan.digests.items()}
    if before is not None and not now.items() <= before.items():
        return False
    with contextlib.suppress(InputError):
        gather(plan)
        return all(path.is_file() for path in _tables(study))
    return False


def out_of_date(study: StudyKeys, step: str, plan: Plan | None = None) -> str:
    """Return why the results of a step are out of date; empty if they are not."""
    own = {os.path.relpath(path, study.folder): path for path in products(study, step)}
    main = next(iter(own.values()))
    before, made = provenance.read_stamp(study, step)
    if before is None:
        return f"{main}: is missing, or no step of this study made it"
    for name, digest in made.items():
        if name not in own or provenance.sha256_if_there(own[name]) != digest:
            return f"{study.folder / name}: is missing, changed or damaged"
    now = _made_from(study, step, plan)
    if changed := [name for name in now | before if now.get(name) != before.get(name)]:
        return f"{main}: was made before these changed: {', '.join(changed)}"
    return ""


def _made_from(study: StudyKeys, step: str, plan: Plan | None = None) -> dict[str, str]:
    """Return digests of a step's inputs, by the names that messages use."""
    code = {
        "code": provenance.digest_of_code("**/*"),
        "packages": provenance.versions(),
    }
    if step == "cube":
        inputs = _inputs_of_cube(study, plan or make_plan(study))
    else:
        inputs = _INPUTS[step](study) if step in _INPUTS else {}  # batches have none
    return {
        name: provenance.digest_of(value) for name, value in (code | inputs).items()
    }


def _inputs_of_motions(study: StudyKeys) -> dict[str, Any]:
    return {name: read_manifest(study)[name] for name in ("key", "inputs")}


def _inputs_of_cube(study: StudyKeys, plan: Plan) -> dict[str, Any]:
    return {
        **plan.digests,
        "attributes of arches": [(m.arch_class, m.attributes) for m in plan.arches],
        "parameters of arches": [(m.id, m.values) for m in plan.arches],
        "title": study.title,
        "institution": study.institution,
        "settings": attributes(study, plan)
        | {"archfrag_commit": ""},  # the code has a digest
        "motions": provenance.sha256_if_there(study.work / MANIFEST),
    }


def _inputs_of_fit(
    study: StudyKeys, before: Sequence[str] = ("cube",)
) -> dict[str, Any]:
    paths = [path for name in before for path in products(study, name)]
    return {
        **{path.name: provenance.sha256_if_there(path) for path in paths},
        "report.confidence": study.report.confidence,
        "limit_states": study.limit_states.model_dump(),
    }


def _inputs_of_report(study: StudyKeys) -> dict[str, Any]:
    logo = Path(study.report.logo or "")
    risk = {}
    if study.risk is not None:
        hazard = Path(study.risk.hazard)
        given = study.risk.model_dump(exclude={"hazard"})
        risk = {"risk": [given, hazard.name, provenance.sha256_if_there(hazard)]}
    return {
        **_inputs_of_fit(study, ("cube", "fit")),
        "motions": provenance.sha256_if_there(study.work / MANIFEST),
        "report": study.report.model_dump(exclude={"confidence", "logo"}),
        "logo": [logo.name, provenance.sha256_if_there(logo)],
        **risk,
    }


_INPUTS: dict[str, Callable[[StudyKeys], dict[str, Any]]] = {
    "motions": _inputs_of_motions,
    "fit": _inputs_of_fit,
    "report": _inputs_of_report,
}


def run_study(
    study: StudyKeys,
    study_file: Path,
    check_stopped: Callable[[], None],
    report: Report,
    cores: int | None = None,
    quiet: bool = False,
    overrides: Sequence[str] | None = None,
) -> bool:
    """Do all of a study that is not done yet; whether there was anything to do.

    If the study is that of its file with `overrides`, `done.finished_folder` will know it again.
    """
    provenance.check_own(study)
    claim(study, study_file, write=False)
    if not stale_steps(study)[0]:
        return False
    check_start(study)

    def say(text: str) -> None:
        if not quiet:
            print(f"archfrag: {printable(text)}", file=sys.stderr, flush=True)

    make_folder(study.work)
    with only_run(study):
        claim(study, study_file)
        stale, changed = stale_steps(study)
        for line in changed[:_MOST_LINES]:
            say(line)
        if changed:
            say(
                "what follows from it is made again; other runs that are finished are kept"
            )
        plan = None
        for step in stale:
            check_stopped()
            if step != "motions":
                plan = plan or make_plan(study)
            of_runs = step == "motions" or step.startswith("batch")
            with contextlib.nullcontext() if of_runs else clock(step, say, quiet):
                # The answers are for the end of the run.
                told = say if of_runs else None
                make_step(
                    study, step, told, plan, report=report, cores=cores, quiet=quiet
                )
        stamp = {}
        if overrides is not None:  # before the last look at all that it is of
            made = chain.from_iterable(
                products(study, step) for step in step_names(study)
            )
            manifest = read_manifest(study)
            prepared = (*manifest["records"], *manifest["first"])
            made = chain(made, (study.work / record.file for record in prepared))
            stamp = stamp_of_all(study, study_file, overrides, input_paths(study), made)
        still, changed = stale_steps(study)
        if still:
            what = f"{(changed or still)[0]}, while the run was at work"
            raise ArchfragError(
                f"{study.folder}: {what}; the same command makes it again"
            )
        provenance.write_stamp(study.work, "all", stamp)
    return True


def claim(study: StudyKeys, study_file: Path, write: bool = True) -> None:
    """See that results are not those of another study file (OutputError); `write` whose they are.

    Its path is relative to them, so that both may be moved.
    """
    file = study.folder / str(
        provenance.read_state(study.work / provenance.OWNER).get("file", "")
    )
    if file.is_file() and not file.samefile(study_file):
        raise OutputError(
            f"{study.folder}: holds the results of {file.resolve()}; give {study_file.name} "
            "another output, or another id if it names none"
        )
    if write:
        here = os.path.relpath(study_file.resolve(), study.folder.resolve())
        owner = provenance.canonical_json({"id": study.id, "file": here})
        provenance.write_text(make_folder(study.work) / provenance.OWNER, owner + "\n")
