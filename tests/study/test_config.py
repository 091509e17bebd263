"""Study files: what is accepted, and what becomes of it."""

import json

import jsonschema
import numpy as np
import pytest
import yaml

from archfrag.errors import InputError
from archfrag.study.file.schema import load_study, study_schema
from archfrag.study.validate import check_study
from tests.study.small import ROOT, TEXT, command, dumped, small_study


def test_a_refusal_names_file_key_value_and_what_is_allowed(tmp_path):
    path = small_study(tmp_path, TEXT.replace("thickness: 1.5", "thickness: 25.0"))
    with pytest.raises(InputError) as caught:
        load_study(path)
    assert caught.value.exit_code == 2
    assert str(caught.value) == (
        f"{path}: arches[0] (ring): cannot exist: thickness = 25.0 is impossible; it must be "
        "less than 20 m, twice the radius of the centre line"
    )
    with pytest.raises(InputError, match=r"nowhere\.yaml cannot be read: No such file"):
        load_study(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("radius", "friction", "read"),
    [
        ("1e1", "inf", [np.inf] * 8),
        (".1e2", "5e-1", [0.5] * 8),
        ("1.e+1", "[1, inf, 1, 1, 1, 1, 1, .inf]", [1, np.inf, 1, 1, 1, 1, 1, np.inf]),
    ],
)
def test_numbers_as_people_write_them(tmp_path, radius, friction, read):
    text = TEXT.replace("friction: 0.7", f"friction: {friction}").replace(
        "10.0", radius
    )
    arch = load_study(small_study(tmp_path, text)).arches[0]
    assert arch.build().chain.friction.tolist() == read
    assert arch.radius == 10.0


def test_levels_in_user_units_become_si(tmp_path):
    text = TEXT.replace("[0.1, 0.6, 1.2]", "{start: 0.1, stop: 1.2, count: 12}")
    study = load_study(small_study(tmp_path, text))
    assert study.intensity.given[:3] == (0.1, 0.2, 0.3)
    np.testing.assert_allclose(study.intensity.si, 9.80665 * np.linspace(0.1, 1.2, 12))
    study = load_study(
        small_study(tmp_path), ["intensity.measure=PGV", "intensity.unit=cm/s"]
    )
    np.testing.assert_allclose(study.intensity.si, [0.001, 0.006, 0.012])


def test_paths_are_relative_to_the_study_file_those_of_overrides_too(
    tmp_path, monkeypatch
):
    (tmp_path / "here").mkdir()
    there = tmp_path / "there"
    path = small_study(there)
    monkeypatch.chdir(tmp_path / "here")
    study = load_study(path, ["motions.files=['x/*.AT2', {path: y.txt, unit: g}]"])
    assert study.folder == there / "out"
    assert [f.path for f in study.motions.files] == [
        str(there / "x/*.AT2"),
        str(there / "y.txt"),
    ]
    assert load_study(path, ["output=../o"]).folder == tmp_path / "o"
    assert load_study(path, ["method.follow=1.5"]).method.follow == 1.5
    assert load_study(path, ["arches.1.width=0.5"]).arches[1].width == 0.5


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.stem
)
def test_shipped_configs_are_valid_by_models_and_by_schema(path, tmp_path):
    """If the schema differs, write study_schema() to configs/study.schema.json."""
    assert (ROOT / "configs" / "study.schema.json").read_text() == study_schema()
    study = load_study(path)
    schema = json.loads(study_schema())
    kept = {"own_records": path.parent / "results" / "own-records"}
    assert study.folder == kept.get(path.stem, ROOT / "results" / path.stem)
    again = tmp_path / "study.yaml"
    again.write_text(dumped(study))
    assert load_study(again).model_dump() == study.model_dump()
    raw = yaml.safe_load(dumped(study))
    jsonschema.validate(raw, schema)
    raw["arches"][0]["radus"] = 1.0
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(raw, schema)


def test_levels_of_an_arch_that_has_spread_are_compared_with_it_as_built(tmp_path):
    spread = TEXT.replace("friction: 0.7", "friction: 0.7, springings: {spread: 0.01}")
    near, far = (
        spread.replace("[0.1, 0.6, 1.2]", levels)
        for levels in ("[0.6, 1.2]", "[9, 20]")
    )
    assert not check_study(load_study(small_study(tmp_path, near)))["cautions"]
    found = check_study(load_study(small_study(tmp_path, far)))["cautions"]
    assert any(
        "ring: all levels are more than 10 times the onset of motion (0.37 g)" in text
        for text in found
    )


def test_hinges_inside_the_edges_of_a_thin_arch_are_a_caution(tmp_path):
    thin = TEXT.replace("radius: 10.0, thickness: 1.5", "radius: 2.5, thickness: 0.28")
    (caution,) = check_study(load_study(small_study(tmp_path, thin)))["cautions"]
    assert caution.startswith(
        "ring: hinges 10 mm inside the edges of the joints lower the onset"
    )


def test_faces_are_for_time_stepping(tmp_path):
    soft = "friction: 0.7, joints: {stiffness: 3.0e+10, model: face}"
    face = TEXT.replace("friction: 0.7", soft)
    assert load_study(small_study(tmp_path, face)).arches[0].joints.model == "face"
    events = face.replace("time_stepping, dt: 2.0e-3", "event_driven, rtol: 1e-6")
    rule = r"arches\[0\].joints.model face needs method time_stepping or auto, not event_driven"
    with pytest.raises(InputError, match=rule):
        load_study(small_study(tmp_path, events))


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("friction: 0.7", "friction: 33", "was an angle meant?"),
        (
            "radius: 10.0, thickness: 1.5",
            "radius: 1.0e4, thickness: 1.5e3",
            "lengths are in m",
        ),
        ("[0.1, 0.6, 1.2]", "[0.01, 0.02]", "no level is above the onset of motion"),
        ("[0.1, 0.6, 1.2]", "[20, 40]", "more than 10 times the onset"),
    ],
)
def test_what_a_mistaken_unit_gives_is_a_caution(tmp_path, old, new, part):
    assert not check_study(load_study(small_study(tmp_path)))["cautions"]
    found = check_study(load_study(small_study(tmp_path, TEXT.replace(old, new))))
    assert any(text.startswith("ring: ") and part in text for text in found["cautions"])


def test_validate_computes_no_spectra_that_nobody_asks_for(tmp_path, monkeypatch):
    path = small_study(tmp_path)
    monkeypatch.setattr("archfrag.motions.measures._spectrum", None)
    assert command("validate", path).exit_code == 0
    assert isinstance(command("motions", path).exception, TypeError)
