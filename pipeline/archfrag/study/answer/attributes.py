"""What a cube states about its study and its making: global attributes."""

import platform
from pathlib import Path
from typing import Any

from archfrag.files import counted
from archfrag.study import provenance
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.prepared import read_manifest
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import strict_json
from archfrag.study.runs.store import Plan
from archfrag.version import __version__


def attributes(study: StudyKeys, plan: Plan) -> dict[str, str]:
    """Return the global attributes: the same on every run of the same study with this code."""
    inputs = read_manifest(study)["inputs"]
    about = study.intensity
    facts = {
        "config": {
            "id": study.id,
            "title": study.title,
            "arches": [_portable_arch(entry) for entry in study.arches],
            "intensity": {**about.model_dump(), "levels": list(about.given)},
            "method": study.method.model_dump(),
            "design": study.design.model_dump(),
        },
        "inputs_sha256": _by_name(inputs["record"]),
        "index_sha256": _by_name(inputs["index"]),
        "inventories_sha256": _by_name(inputs["inventory"]),
        "processing": [
            {"step": name, "settings": given} for name, given in study.motions.steps
        ],
        "versions": provenance.versions(),
    }
    if before := study.motions.before:
        pairs = {each.id: each.first.id for each in plan.records if each.first}
        names = list(dict.fromkeys(pairs.values()))
        facts["first_shocks"] = {"gap": before.gap, "records": names, "before": pairs}
    count = sum(record.vertical for record in plan.records)
    of = len(plan.records)
    some = f"used for {count} of {of} records"
    counts = f"{counted(len(plan.arches), 'arch')} under {counted(of, 'record')}"
    return {
        "Conventions": "CF-1.11",
        "title": study.title,
        "institution": study.institution,
        "source": f"rigid-block simulations with archfrag {__version__}, method "
        f"{study.method.name}",
        "vertical_component": some
        if 0 < count < of
        else "used"
        if count
        else "not used",
        "history": "Records read, processed and scaled to levels of the intensity measure; "
        f"simulations as the design {study.design.kind} asks for them; results gathered by "
        "archfrag.",
        "references": "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; the "
        "README of archfrag",
        "comment": f"{counts} scaled by {about.measure}. Wall times and machine are in a log "
        "beside this file.",
        "loss_limit": f"{study.method.loss_limit:g}",
        "archfrag_study": study.id,
        **{f"archfrag_{name}": strict_json(fact) for name, fact in facts.items()},
        "archfrag_commit": provenance.commit(),
        "archfrag_machine": platform.machine(),
        "archfrag_plan": provenance.digest_of(
            [plan.identity, facts, [member.chain for member in plan.arches]]
        ),
    }


def _portable_arch(entry: ArchEntry) -> dict[str, Any]:
    """Return an entry as a study gives it, defaults filled in, without folders."""
    if entry.table is not None:
        return {**entry.parameters, "table": Path(entry.table).name}
    facts = {"id": entry.id, **entry.build().parameters}
    if entry.drawing is not None:
        sha256 = provenance.sha256_if_there(entry.drawing)
        facts |= {"drawing": Path(entry.drawing).name, "sha256": sha256}
    if entry.vary is not None:
        facts["vary"] = entry.vary.model_dump(exclude_none=True)
    return facts


def _by_name(digests: dict[str, str]) -> dict[str, str]:
    """Return digests by the shortest ends of their paths that distinguish all, without a place."""
    paths = [Path(path).parts for path in digests]
    for size in range(1, max(map(len, paths), default=1) + 1):
        ends = ["/".join(parts[-size:]) for parts in paths]
        if len(set(ends)) == len(ends):
            break
    return dict(zip(ends, digests.values()))
