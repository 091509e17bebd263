"""The steps of a study, one after the other: each does nothing where its result is current.

A step that is done leaves a stamp: digests of what it was made from, and the SHA-256 of what it
made. Times of modification decide nothing.
"""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from archfrag.errors import ArchfragError, InputError, OutputError
from archfrag.files import counted, make_folder, printable, write_csv
from archfrag.study.checks import check_start, refuse_foreign_results
from archfrag.study.file.members import SHOWN, needs_records
from archfrag.study.file.records import (
    MANIFEST,
    motions_key,
    prepare_motions,
    read_manifest,
    study_inputs,
)
from archfrag.study.file.schema import Study
from archfrag.study.files import (
    OWNER,
    canonical_json,
    changes,
    check_own,
    digest_of,
    read_json,
    read_owner,
    remove_figures,
    sha256_if_there,
    source_hash,
    stamp_file,
    write_text,
)
from archfrag.study.provenance import attributes, versions
from archfrag.study.running import Stop, only_run
from archfrag.study.runs.plan import Plan, make_plan
from archfrag.study.runs.store import Store, replay

REPORT_FILES = ("report.html", "summary.json")
ALL_CURVES = "curves.svg"  # of many arches, in the place of a figure of each
_MOST_LINES = 8
Note = Callable[[str], None]


def batch_step(batch: int | str, batches: int) -> str:
    """Name of the step that makes the runs of one of several batches."""
    return f"batch-{batch}of{batches}"


def step_names(study: Study) -> list[str]:
    """All steps of a study in their order."""
    count = study.execution.batches
    return ["motions", *(batch_step(i, count) for i in range(count)), "cube", "fit", "report"]


def products(study: Study, step: str) -> list[Path]:
    """Files that a step makes; parts of runs have checks of their own."""
    if step.startswith("batch"):
        return [runs_table(study, step)]
    if step == "report":
        return [study.folder / name for name in (*REPORT_FILES, *_curve_files(study))]
    made = {
        "motions": [study.work / MANIFEST],
        "cube": [study.folder / "cube.nc"],
        "fit": [study.folder / "fits.json", study.folder / "curve.csv"],
    }
    return made[step]


def runs_table(study: Study, step: str) -> Path:
    """Table of the runs of a batch, with how long each took."""
    return study.work / "runs" / f"{step}.csv"


def read_timings(study: Study) -> dict[str, list[float]] | None:
    """Wall times of the runs of each arch [s]; None if their tables are not there."""
    import pandas as pd

    names = [name for name in step_names(study) if name.startswith("batch")]
    paths = [runs_table(study, name) for name in names]
    if not all(path.is_file() for path in paths):
        return None
    columns: dict[str, Any] = {"usecols": ["arch", "wall_time"], "converters": {"arch": str}}
    table = pd.concat([pd.read_csv(path, **columns) for path in paths])
    return {str(name): own.tolist() for name, own in table.groupby("arch")["wall_time"]}


def _curve_files(study: Study) -> list[str]:
    """Figures beside the report; of none yet if the arches follow from records not read yet."""
    try:
        n_record = len(read_manifest(study)["records"])
    except InputError:
        n_record = None
    if n_record is None and needs_records(study.arches):
        return []
    names = study.members(n_record).ids
    return [ALL_CURVES] if len(names) > SHOWN else [f"curve-{name}.svg" for name in names]


@dataclass(frozen=True)
class Options:
    """How steps are made."""

    report: Callable[[Study, Path | None], Path] | None = None  # writes it: of a layer above
    cores: int | None = None  # processes that make runs, in the place of the study's
    quiet: bool = False  # show nothing but errors
    compared: Path | None = None  # another study's file, for the report


def make_step(
    study: Study, step: str, note: Note, options: Options = Options(), plan: Plan | None = None
) -> None:
    """Make one step, whose inputs are there, and leave its stamp.

    Parameters
    ----------
    study : Study
    step : str
        Of `step_names`.
    note : callable
        Takes a line for the user.
    options : Options
    plan : Plan, optional
        Of the study, where it is known; of no use to the first step.
    """
    if step == "motions":
        check_start(study)
        note(f"motions: {counted(len(prepare_motions(study)), 'record')} ready")
    elif step.startswith("batch"):
        _make_runs(study, step, note, options, plan or make_plan(study))
    elif step == "cube":
        from archfrag.study.answer.cube import write_cube

        note(f"cube: {write_cube(study, plan)}")
    elif step == "fit":
        from archfrag.study.answer.fits import fit_cube, fit_lines

        require(study, "cube", plan)
        for line in fit_lines(study, fit_cube(study)):
            note(line)
    elif options.report is not None:
        note(f"report: {options.report(study, options.compared)}")
    finish(study, step, plan)


def _make_runs(study: Study, step: str, note: Note, options: Options, plan: Plan) -> None:
    from archfrag.study.runs.execute import run_batch

    batch, batches = map(int, step.removeprefix("batch-").split("of"))
    log, table = run_batch(study, batch, options.cores, options.quiet, plan)
    path = runs_table(study, step)
    make_folder(path.parent)
    write_csv(path, [table])
    runs = f"{counted(log.runs, 'run')}, {log.kept} kept from before, {log.runs - log.kept} new"
    took = f"{log.wall_time:.1f} s on {counted(log.workers, 'core')}"
    note(f"batch {batch + 1} of {batches}: {runs}; {took}")


def finish(study: Study, step: str, plan: Plan | None = None) -> None:
    """Note that a step is done; figures of the same step that it made no more are removed."""
    files = {
        os.path.relpath(path, study.folder): sha256_if_there(path)
        for path in products(study, step) if path.is_file()
    }  # fmt: skip
    remove_figures(study, _stamp(study, step)[1], kept=files)
    stamp = {"from": _made_from(study, step, plan), "files": files}
    make_folder(stamp_file(study, step).parent)
    write_text(stamp_file(study, step), canonical_json(stamp) + "\n")


def is_done(study: Study, step: str) -> bool:
    """Whether the results of a step are those of the study as it is."""
    if step == "motions":
        return _changed_motions(study) is None
    plan = make_plan(study)
    return not _wrong(study, step, plan) and not (step.startswith("batch") and _unfinished(plan))


def require(study: Study, step: str, plan: Plan | None = None) -> None:
    """See that the results of a step are those of the study as it is.

    Raises
    ------
    InputError
        Saying which file is not.
    """
    if wrong := _wrong(study, step, plan):
        raise InputError(f"{wrong}; `archfrag {step}` on the study file makes it again")


def stale_steps(study: Study) -> tuple[list[str], list[str]]:
    """Steps to be done, and what has changed since they were done last."""
    names = step_names(study)
    changed = _changed_motions(study)
    if changed is not None:
        return names, changed
    plan = make_plan(study)
    gathered = not _wrong(study, "cube", plan)
    for i, step in enumerate(names):
        wrong = _wrong(study, step, plan)
        if step.startswith("batch") and not wrong and not gathered and _unfinished(plan):
            wrong = f"results in {plan.parts} are missing or damaged"
        if wrong:
            return names[i:], [wrong] if stamp_file(study, step).is_file() else []
    return [], []


def _unfinished(plan: Plan) -> bool:
    try:
        replay(plan, Store(plan.parts))
    except InputError:
        return True
    return False


def _changed_motions(study: Study) -> list[str] | None:
    """What has changed since the motions were prepared; None if nothing has."""
    inputs = study_inputs(study)
    try:
        manifest = read_manifest(study)
    except InputError as error:
        there = (study.work / MANIFEST).exists()
        return [str(error)] if there else []
    changed = changes(manifest["inputs"], inputs, study.folder)
    if manifest["key"] != motions_key(study):
        changed.append("the study asks for other records or another measure")
    if changed:
        return changed
    try:
        make_plan(study)
    except InputError as error:
        return [str(error)]
    if wrong := _wrong(study, "motions"):
        return [wrong] if stamp_file(study, "motions").is_file() else []
    return None


def _stamp(study: Study, step: str) -> tuple[dict[str, Any] | None, dict[str, str]]:
    """What a step was made from, None if it is not done, and digests of its files."""
    try:
        stamp = read_json(stamp_file(study, step))
        return dict(stamp["from"]), dict(stamp["files"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None, {}


def _wrong(study: Study, step: str, plan: Plan | None = None) -> str:
    """Why the results of a step are not those of the study as it is; empty if they are."""
    own = {os.path.relpath(path, study.folder): path for path in products(study, step)}
    main = next(iter(own.values()))
    before, files = _stamp(study, step)
    if before is None:
        return f"{main}: is missing, or no step of this study made it"
    for name, digest in files.items():
        if name not in own or sha256_if_there(own[name]) != digest:
            return f"{study.folder / name}: is missing, changed or damaged"
    now = _made_from(study, step, plan)
    if changed := [name for name in now | before if now.get(name) != before.get(name)]:
        return f"{main}: was made before these changed: {', '.join(changed)}"
    return ""


def _made_from(study: Study, step: str, plan: Plan | None = None) -> dict[str, Any]:
    """Digests of all that the results of a step follow from, by the names of messages."""
    found: dict[str, Any] = {"step": step}
    if step.startswith("batch"):
        found |= (plan or make_plan(study)).digests()
        return {name: digest_of(value) for name, value in found.items()}
    found |= {"code": source_hash(), "packages": versions()}
    if step == "motions":
        manifest = read_manifest(study)
        found |= {name: manifest[name] for name in ("key", "inputs")}
    elif step == "cube":
        plan = plan or make_plan(study)
        arches, digests = study.members(len(plan.records)), plan.digests()
        found |= digests | {
            "attributes of arches": [arches.classes, arches.attributes()],
            "parameters of arches": [(m.id, m.values) for m in arches],
            "title": study.title, "institution": study.institution,
            "levels": [digests["levels"], study.intensity.given],
            "settings": attributes(study, plan), "motions": sha256_if_there(study.work / MANIFEST),
        }  # fmt: skip
    else:
        before = ("cube",) if step == "fit" else ("cube", "fit")
        paths = [path for name in before for path in products(study, name)]
        found |= {path.name: sha256_if_there(path) for path in paths}
        found["report.confidence"] = study.report.confidence
        found["limit_states"] = study.limit_states.model_dump()
    if step == "report":
        found |= {"motions": sha256_if_there(study.work / MANIFEST), "report.at": study.report.at}
        if study.risk is not None:
            hazard = Path(study.risk.hazard)
            given = study.risk.model_dump(exclude={"hazard"})
            found["risk"] = [given, hazard.name, sha256_if_there(hazard)]
    return {name: digest_of(value) for name, value in found.items()}


def run_study(study: Study, study_file: Path, options: Options, stop: Stop) -> bool:
    """Do all of a study that is not done yet; whether there was anything to do.

    Raises
    ------
    ArchfragError
        Of whatever step fails; finished steps and runs are kept.
    """
    check_own(study)
    refuse_foreign_results(study)
    owner = _refuse_another_file(study, study_file)
    if not stale_steps(study)[0]:
        return False
    check_start(study)
    make_folder(study.work)
    with only_run(study):
        write_text(study.work / OWNER, canonical_json(owner) + "\n")
        stale, changed = stale_steps(study)
        if changed and not options.quiet:
            _print_changes(changed)

        def note(text: str) -> None:
            if not options.quiet:
                print(f"archfrag: {printable(text)}", file=sys.stderr, flush=True)

        plan = None
        for step in stale:
            stop.check()
            if step != "motions":
                plan = plan or make_plan(study)
            # What follows from a step made again may be what it was.
            if step in ("motions", stale[0]) or _wrong(study, step, plan):
                make_step(study, step, note, options, plan)
        left, changed = stale_steps(study)
        if left:
            what = f"{(changed or left)[0]}, while the run was at work"
            raise ArchfragError(f"{study.folder}: {what}; the same command makes it again")
    return bool(stale)


def _refuse_another_file(study: Study, path: Path) -> dict[str, str]:
    """See that the results are not those of a study file beside this one with the same id.

    Returned is who owns the results: the id, and the file relative to the results, so that both
    may be moved together.
    """
    before = read_owner(study).get("file")
    if before is not None:
        file = study.folder / before
        if file.is_file() and not file.samefile(path):
            raise OutputError(
                f"{study.folder}: holds the results of {file.resolve()}, which has the id "
                f"{study.id!r} too; give {path.name} another id or output"
            )
    return {"id": study.id, "file": os.path.relpath(path.resolve(), study.folder.resolve())}


def _print_changes(changed: Sequence[str]) -> None:
    for line in changed[:_MOST_LINES]:
        print(f"archfrag: {printable(line)}", file=sys.stderr)
    if len(changed) > _MOST_LINES:
        print(f"archfrag: … and {len(changed) - _MOST_LINES} more", file=sys.stderr)
    kept = "finished runs that are still what they were are kept"
    print(f"archfrag: what follows from it is made again; {kept}", file=sys.stderr, flush=True)
