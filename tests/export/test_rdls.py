"""Metadata of the Risk Data Library Standard 0.3 beside exports.

ARCHFRAG_RDLS_SCHEMA names its rdls_schema.json; the file is under another licence than archfrag,
so that it is not here. Without it types and closed lists are checked as its version 0.3 has them.
"""

import json
import os
from pathlib import Path

import jsonschema
import pandas as pd
import pytest

from archfrag.export.rdls import metadata
from archfrag.export.writers import CurveSet
from archfrag.study.file.schema import load_study
from tests.export.made import MADE, curve_set
from tests.report import synthetic
from tests.study.small import TEXT, command, small_study

REQUIRED = {
    "id": str,
    "title": str,
    "risk_data_type": list,
    "attributions": list,
    "spatial": dict,
    "license": str,
    "resources": list,
}
CLOSED = {
    "approach": {"analytical", "empirical", "hybrid", "judgement"},
    "relationship": {"math_parametric", "math_bespoke", "discrete"},
    "hazard_primary": {"earthquake"},
    "hazard_process_primary": {"primary_rupture", "ground_motion", "liquefaction"},
    "hazard_analysis_type": {"probabilistic", "deterministic", "empirical"},
    "category": {"buildings", "infrastructure"},
    "impact_type": {"direct", "indirect", "total"},
    "impact_modelling": {"inferred", "observed", "simulated"},
    "impact_metric": {"damage_ratio", "probability", "loss_ratio"},
}


def check(text):
    """The facts, after what version 0.3 asks for; by its schema, if that is named."""
    facts = json.loads(text)
    assert facts["links"][0]["href"].endswith("/0__3__0/rdls_schema.json")
    for name, kind in REQUIRED.items():
        assert isinstance(facts[name], kind), name
        assert facts[name], name
    assert facts["risk_data_type"] == ["vulnerability"]
    roles = {each["role"] for each in facts["attributions"]}
    assert roles == {"publisher", "creator", "contact_point"}
    for each in facts["attributions"]:
        assert {"id", "entity"} < {*each}
        assert {*each["entity"]} == {"name", "url"}
    for each in facts["resources"]:
        assert {"id", "title", "description", "data_format", "download_url"} == {*each}
        assert each["data_format"] in ("XML (xml)", "JSON (json)", "CSV (csv)")
    for each in facts["sources"]:
        assert each["type"] in ("dataset", "model")
        assert each["component"] in ("hazard", "vulnerability")
        assert all(isinstance(text, str) and text for text in each.values())
    functions = facts["vulnerability"]["functions"]["fragility"]
    for each in functions:
        for name, known in CLOSED.items():
            assert each[name] in known, name
    for some in (facts["sources"], facts["resources"], functions):
        names = [each["id"] for each in some]
        assert len({*names}) == len(names) > 0
    schema = os.environ.get("ARCHFRAG_RDLS_SCHEMA")
    if schema:
        text = Path(schema).read_text("utf-8")
        jsonschema.Draft202012Validator(json.loads(text)).validate(facts)
    return facts


def test_records_hazard_versions_and_states(tmp_path):
    text = TEXT.replace('files: ["records/*.AT2"]', "index: records/index.csv")
    path = small_study(tmp_path, text + "risk: {hazard: site.csv}\n")
    rows = {"id": ["a", "b"], "file": ["wave0.AT2", "wave1.AT2"], "unit": ["g", "g"]}
    index = tmp_path / "records" / "index.csv"
    pd.DataFrame(rows | {"terms": ["CC-BY-4.0", ""]}).to_csv(index, index=False)
    cube = synthetic.cube(items=synthetic.motions(2))
    cube = cube.assign_coords(record=["a", "b"]).assign(
        record_file=("record", rows["file"]), record_sha256=("record", ["1f", "2f"])
    )
    study = load_study(path)
    curves = curve_set()
    facts = check(metadata(study, cube, curves, ["small-pelicun.csv", "small.xml"]))
    assert facts["title"] == study.title
    assert MADE["cube_sha256"] in facts["description"]
    assert facts["version"] == "archfrag 0.1.0, commit abc"
    records = {each["id"]: each for each in facts["sources"]}
    assert records["record a"]["license"] == "CC-BY-4.0"
    assert "license" not in records["record b"]
    assert "2f" in records["record b"]["description"]
    assert records["hazard curve"]["name"] == "site.csv"
    (one, two) = facts["vulnerability"]["functions"]["fragility"]
    assert [one["id"], two["id"]] == ["ring-7", "wall+2"]
    assert one["damage_states_names"] == ["rocking", "damage", "collapse"]
    assert one["intensity_measure"] == "PGA:g"
    index.unlink()  # moved since the run: terms are not known, the rest is
    lost = check(metadata(study, cube, curves, ["x.csv"]))
    assert all("license" not in each for each in lost["sources"])


@pytest.mark.parametrize("title", ['A "title" \\ with {id} & \n more', "{title}"])
def test_any_title(tmp_path, title):
    study = load_study(small_study(tmp_path)).model_copy(update={"title": title})
    curves = CurveSet(curve_set().curves, {}, "PGV", (1.0, 2.0), MADE)
    facts = check(metadata(study, synthetic.cube(), curves, ["a.json"]))
    assert facts["title"] == title


def test_it_lies_beside_every_export(tmp_path):
    path = small_study(tmp_path)
    assert command("run", path, "--quiet").exit_code == 0
    call = "export", path, "--format", "csv", "--out", tmp_path / "all"
    assert command(*call).exit_code == 0
    facts = check((tmp_path / "all" / "small-rdls.json").read_text("utf-8"))
    files = {each.name for each in (tmp_path / "all").iterdir()}
    named = {each["download_url"] for each in facts["resources"]}
    assert files == named | {"small-rdls.json"}
