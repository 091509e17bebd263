"""Metadata of the Risk Data Library Standard, version 0.3, on the files of an export."""

import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import xarray as xr

from archfrag.errors import RecordError
from archfrag.export.writers import CurveSet
from archfrag.files import Named
from archfrag.motions.index import load_index
from archfrag.study.file.schema import StudyKeys

_FIXED = Path(__file__).with_name("rdls.json")  # what is the same in all files


def metadata(
    study: StudyKeys, cube: xr.Dataset, curves: CurveSet, files: Iterable[str]
) -> str:
    """Return metadata in JSON on files, given by name."""
    made = curves.made
    facts = json.loads(_FIXED.read_text("utf-8"))
    unit = study.intensity.unit
    function = facts["vulnerability"] | {
        "damage_states_names": list(curves.limit_states),
        "intensity_measure": f"{curves.measure}:{unit}",
    }
    functions = [
        {"id": name, **function, "analysis_details": curves.described(name)}
        for name in curves.curves
    ]
    entity = {"name": study.institution, "url": "about:blank"}
    facts |= {
        "id": f"{study.id}-{made['cube_sha256'][:16]}",
        "title": study.title,
        "description": curves.origin(""),
        "version": f"archfrag {made['archfrag']}, commit {made['archfrag_commit']}",
        "attributions": [
            {"id": role, "entity": entity, "role": role}
            for role in ("publisher", "creator", "contact_point")
        ],
        "sources": list(_sources(study, cube)),
        "resources": [_resource(name) for name in files],
        "vulnerability": {"functions": {"fragility": functions}},
    }
    return json.dumps(facts, indent=1, ensure_ascii=False) + "\n"


def _resource(name: str) -> Named:
    """Return what a file is; it lies beside the metadata."""
    kind = Path(name).suffix[1:]
    texts = dict.fromkeys(("id", "title", "description", "download_url"), name)
    return {**texts, "data_format": f"{kind.upper()} ({kind})"}


def _sources(study: StudyKeys, cube: xr.Dataset) -> Iterator[Named]:
    """Yield the runs, the hazard curve and the records, with the terms that their index states."""
    method = str(cube.attrs.get("source", "verdicts of a table"))
    yield {"id": "runs", "name": method, "type": "model", "component": "vulnerability"}
    kind = {"type": "dataset", "component": "hazard"}
    if study.risk:
        yield {"id": "hazard curve", "name": Path(study.risk.hazard).name, **kind}
    if "record_sha256" not in cube:
        return
    terms: Named = {}
    with suppress(RecordError):  # no index, or it was moved
        entries = load_index(study.motions.index or "")
        terms = {each.id: each.metadata.get("terms") for each in entries}
    names = ("record", "record_file", "record_sha256")
    for record, file, digest in zip(*(cube[name].values.tolist() for name in names)):
        source = {"id": f"record {record}", "name": file, **kind}
        source["description"] = f"Ground motion, SHA-256 {digest}"
        yield source | ({"license": terms[record]} if terms.get(record) else {})
