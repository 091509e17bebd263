"""The steps of a study, and by content which of them are up to date.

A step that is done leaves a stamp: a digest of what it was made from, and the SHA-256 of what it
made. Stamps of steps that are out of date are removed, and Snakemake makes what has no stamp:
times of modification decide nothing.
"""

import json
from pathlib import Path
from typing import Any

from archfrag.errors import InputError
from archfrag.study.config import Study
from archfrag.study.files import (
    canonical_json,
    changes,
    digest_of,
    make_folder,
    remember,
    sha256_if_there,
    source_hash,
    write_text,
)
from archfrag.study.members import SHOWN, members, needs_records
from archfrag.study.plan import Plan, make_plan
from archfrag.study.records import MANIFEST, motions_key, read_manifest, study_inputs
from archfrag.study.store import Store, replay

STEPS = "steps"
FITTING = ("study/fits.py", "study/curves.py", "study/comparisons.py")
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
        "files": {str(path.relative_to(study.folder)): sha256_if_there(path) for path in files},
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


def forget_stale(study: Study) -> tuple[list[str], list[str]]:
    """Remove the stamps of steps that are out of date; returned is what `stale_steps` returns."""
    stale, changed = stale_steps(study)
    good = {f"{step}.json" for step in step_names(study) if step not in stale}
    for path in (study.work / STEPS).glob("*.json"):
        if path.name not in good:
            path.unlink(missing_ok=True)
    return stale, changed


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
    changed = changes(manifest["inputs"], inputs)
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
        stamp = json.loads(stamp_file(study, step).read_text(encoding="utf-8"))
        before, files = dict(stamp["from"]), stamp["files"].items()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return f"{main}: is missing, or no step of this study made it"
    for name, digest in files:
        if sha256_if_there(study.folder / name) != digest:
            return f"{study.folder / name}: is missing, changed or damaged"
    now = _made_from(study, step, plan)
    if changed := [name for name in now | before if now.get(name) != before.get(name)]:
        return f"{main}: was made before these changed: {', '.join(changed)}"
    return ""


def _made_from(study: Study, step: str, plan: Plan | None = None) -> dict[str, Any]:
    """Digests of all that the results of a step follow from, by the names of messages."""
    found: dict[str, Any] = {"step": step}
    if step == "motions":
        manifest = read_manifest(study)
        found |= {name: manifest[name] for name in ("key", "inputs")}
        found["archfrag"] = source_hash("motions", "study/records.py", "study/files.py")
    if step.startswith("batch") or step == "cube":
        found |= (plan or make_plan(study)).digests()
    if step == "cube":
        arches = members(study, len((plan or make_plan(study)).records))
        found |= {
            "attributes of arches": [arches.classes, arches.attributes()],
            "title": study.title, "institution": study.institution,
            "levels": [found["levels"], study.intensity.given],
            "code of studies": source_hash("study"),
            "motions": sha256_if_there(study.work / MANIFEST),
        }  # fmt: skip
    if step in ("fit", "report"):
        found |= {path.name: sha256_if_there(path) for path in products(study, "cube")}
        found |= {
            "code of fits": source_hash("fragility", *FITTING),
            "report.confidence": study.report.confidence,
            "limit_states": study.limit_states.model_dump(),
        }
    if step == "report":
        found |= {path.name: sha256_if_there(path) for path in products(study, "fit")}
        found |= {
            "motions": sha256_if_there(study.work / MANIFEST), "title": study.title,
            "report.at": study.report.at, "code of the report": source_hash("report"),
            "code of rates": source_hash("study/risk.py"),
        }  # fmt: skip
        if study.risk is not None:
            found["risk"] = [study.risk.model_dump(), sha256_if_there(study.risk.hazard)]
    return {name: digest_of(value) for name, value in found.items()}
