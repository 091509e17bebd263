"""The steps of a study, and by content which of them are up to date.

A step that is done leaves a stamp: a digest of what it was made from, and the SHA-256 of what it
made. Times of modification decide nothing.
"""

import os
from pathlib import Path
from typing import Any

from archfrag.errors import InputError
from archfrag.study.config import Study
from archfrag.study.files import (
    canonical_json,
    changes,
    digest_of,
    make_folder,
    read_json,
    remember,
    sha256_if_there,
    source_hash,
    write_text,
)
from archfrag.study.members import SHOWN, members, needs_records
from archfrag.study.plan import Plan, make_plan
from archfrag.study.provenance import attributes, versions
from archfrag.study.records import MANIFEST, motions_key, read_manifest, study_inputs
from archfrag.study.store import Store, replay

STEPS = "steps"
REPORT_FILES = ("report.html", "summary.json")
ALL_CURVES = "curves.svg"  # of many arches, in the place of a figure of each
_COMMAND = {"cube": "archfrag cube", "fit": "archfrag fit"}


def batch_step(batch: int | str, batches: int) -> str:
    """Name of the step that is one of several batches."""
    return f"batch-{batch}of{batches}"


def step_names(study: Study) -> list[str]:
    """All steps of a study in their order."""
    count = study.execution.batches
    return ["motions", *(batch_step(i, count) for i in range(count)), "cube", "fit", "report"]


def stamp_file(study: Study, step: str) -> Path:
    """File that states that a step is done."""
    return study.work / STEPS / f"{step}.json"


def products(study: Study, step: str) -> list[Path]:
    """Files that a step makes; parts of batches have checks of their own."""
    made = {
        "motions": [study.work / MANIFEST],
        "cube": [study.folder / "cube.nc", study.work / "timings.csv"],
        "fit": [study.folder / "fits.json"],
    }
    if step == "report":
        return [study.folder / name for name in (*REPORT_FILES, *_curve_files(study))]
    return made.get(step, [])


def _curve_files(study: Study) -> list[str]:
    """Figures beside the report; of none yet if the arches follow from records not read yet."""
    try:
        n_record = len(read_manifest(study)["records"])
    except InputError:
        n_record = None
    if n_record is None and needs_records(study.arches):
        return []
    names = members(study, n_record).ids
    return [ALL_CURVES] if len(names) > SHOWN else [f"curve-{name}.svg" for name in names]


def finish(study: Study, step: str) -> None:
    """Note that a step is done."""
    files = [path for path in products(study, step) if path.is_file()]
    stamp = {
        "from": _made_from(study, step),
        "files": {os.path.relpath(path, study.folder): sha256_if_there(path) for path in files},
    }
    remember(study, [path.name for path in files if path.parent == study.folder], step)
    make_folder(study.work / STEPS)
    write_text(stamp_file(study, step), canonical_json(stamp) + "\n")


def is_done(study: Study, step: str) -> bool:
    """Whether the results of a step are those of the study as it is."""
    return not _wrong(study, step)


def require(study: Study, step: str) -> None:
    """See that the results of a step are those of the study as it is.

    Raises
    ------
    InputError
        Saying which file is not.
    """
    if wrong := _wrong(study, step):
        raise InputError(f"{wrong}; `{_COMMAND[step]}` on the study file makes it anew")


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


def _wrong(study: Study, step: str, plan: Plan | None = None) -> str:
    """Why the results of a step are not those of the study as it is; empty if they are."""
    main = next(iter(products(study, step)), study.work / "parts")
    try:
        stamp = read_json(stamp_file(study, step))
        before, files = dict(stamp["from"]), stamp["files"].items()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return f"{main}: is missing, or no step of this study made it"
    own = {os.path.relpath(path, study.folder): path for path in products(study, step)}
    for name, digest in files:
        if name not in own or sha256_if_there(own[name]) != digest:
            return f"{study.folder / name}: is missing, changed or damaged"
    now = _made_from(study, step, plan)
    if changed := [name for name in now | before if now.get(name) != before.get(name)]:
        return f"{main}: was made before these changed: {', '.join(changed)}"
    return ""


def _made_from(study: Study, step: str, plan: Plan | None = None) -> dict[str, Any]:
    """Digests of all that the results of a step follow from, by the names of messages."""
    found: dict[str, Any] = {"step": step}
    if step.startswith("batch") or step == "cube":
        plan = plan or make_plan(study)
        found |= plan.digests()
    if not step.startswith("batch"):
        found |= {"code": source_hash(), "packages": versions()}
    if step == "motions":
        manifest = read_manifest(study)
        found |= {name: manifest[name] for name in ("key", "inputs")}
    elif step == "cube":
        assert plan is not None
        arches = members(study, len(plan.records))
        found |= {
            "attributes of arches": [arches.classes, arches.attributes()],
            "parameters of arches": [(m.id, m.values) for m in arches],
            "title": study.title, "institution": study.institution,
            "levels": [found["levels"], study.intensity.given],
            "settings": attributes(study, plan), "motions": sha256_if_there(study.work / MANIFEST),
        }  # fmt: skip
    elif step in ("fit", "report"):
        found |= {path.name: sha256_if_there(path) for path in products(study, "cube")}
        found["report.confidence"] = study.report.confidence
        found["limit_states"] = study.limit_states.model_dump()
    if step == "report":
        found |= {path.name: sha256_if_there(path) for path in products(study, "fit")}
        found |= {"motions": sha256_if_there(study.work / MANIFEST), "report.at": study.report.at}
        if study.risk is not None:
            hazard = Path(study.risk.hazard)
            given = study.risk.model_dump(exclude={"hazard"})
            found["risk"] = [given, hazard.name, sha256_if_there(hazard)]
    return {name: digest_of(value) for name, value in found.items()}
