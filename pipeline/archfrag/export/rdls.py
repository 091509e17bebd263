"""Metadata of the Risk Data Library Standard, version 0.3, on the files of an export."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import xarray as xr

from archfrag.errors import RecordError
from archfrag.export.writers import CurveSet
from archfrag.files import Named
from archfrag.motions.index import load_index
from archfrag.study.file.schema import StudyKeys

_TEMPLATE = Path(__file__).with_name("rdls.json")


def metadata(
    study: StudyKeys, cube: xr.Dataset, curves: CurveSet, files: Sequence[str]
) -> str:
    """Return metadata in JSON on files, given by name."""
    made = curves.made
    facts = _filled(
        {
            "id": f"{study.id}-{made['cube_sha256'][:16]}",
            "title": study.title,
            "description": curves.origin(""),
            "version": f"archfrag {made['archfrag']}, commit {made['archfrag_commit']}",
            "institution": study.institution,
            "source": str(cube.attrs.get("source", "verdicts of a table")),
            "measure": f"{curves.measure}:{study.intensity.unit}",
        }
    )
    facts["sources"] += _sources(study, cube)
    for name in files:
        kind = name.rpartition(".")[2]
        file = dict.fromkeys(("id", "title", "description", "download_url"), name)
        facts["resources"].append(file | {"data_format": f"{kind.upper()} ({kind})"})
    functions = facts["vulnerability"]["functions"]
    same = functions["fragility"][0] | {"damage_states_names": curves.limit_states}
    functions["fragility"] = [
        same | {"id": name, "analysis_details": curves.described(name)}
        for name in curves.curves
    ]
    return json.dumps(facts, indent=1, ensure_ascii=False) + "\n"


def _filled(texts: Mapping[str, str]) -> Named:
    """Return the template with texts in the places that have their names."""
    template = _TEMPLATE.read_text("utf-8")
    for name, text in texts.items():
        template = template.replace(f'"{{{name}}}"', json.dumps(text))
    return dict(json.loads(template))


def _sources(study: StudyKeys, cube: xr.Dataset) -> Iterator[Named]:
    """Yield the hazard curve and the records, with the terms that their index states."""
    kind = {"type": "dataset", "component": "hazard"}
    if study.risk:
        yield {"id": "hazard curve", "name": Path(study.risk.hazard).name, **kind}
    names = ("record", "record_file", "record_sha256")
    if not {*names} <= {*cube.variables}:
        return
    terms = _terms(study.motions.index or "")
    for record, file, digest in zip(*(cube[name].values.tolist() for name in names)):
        about = {"id": f"record {record}", "name": file, "license": terms.get(record)}
        about |= {"description": f"Ground motion, SHA-256 {digest}", **kind}
        yield {key: text for key, text in about.items() if text}


def _terms(index: str) -> Named:
    """Return the terms of use of records by id; none without an index, or if it was moved."""
    with suppress(RecordError):
        return {each.id: each.metadata.get("terms") for each in load_index(index)}
    return {}
