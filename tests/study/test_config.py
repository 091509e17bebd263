"""Study files: what is accepted, and the sentence for what is not."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from archfrag.errors import StudyError
from archfrag.simulation.checks import method_names
from archfrag.study.config import dump_study, load_study, study_schema
from archfrag.study.yaml_file import dump_yaml, parse_value
from tests.study.small import ROOT, TEXT, small_study

RING = "radius: 10.0"


def refused(tmp_path, text, *overrides):
    """Sentence with which a study is refused, without the path of its file."""
    path = small_study(tmp_path, text)
    with pytest.raises(StudyError) as caught:
        load_study(path, overrides)
    assert caught.value.exit_code == 2
    return str(caught.value).removeprefix(f"{path}: ")


BAD = {
    "typo in a key": (
        ("radius:", "radus:"),
        "arches[0].radus is no known key; did you mean radius?",
    ),
    "typo at the top": (
        ("method:", "metod:"),
        "metod is no known key; did you mean method?",
    ),
    "key from elsewhere": (
        ("dt: 2.0e-3", "colour: 1"),
        "method.colour is no known key; allowed are name, dt, rtol, follow, loss_limit, settings",
    ),
    "unknown method": (
        ("name: time_stepping", "name: euler"),
        f"method.name = euler must be one of {', '.join(method_names())}",
    ),
    "level zero": (
        ("[0.1, 0.6", "[0.0, 0.6"),
        "intensity.levels = [0.0, 0.6, 1.2] must be greater than 0, but entry 0 is 0",
    ),
    "level below zero": (
        ("[0.1, 0.6, 1.2]", "{start: -0.1, stop: 1.0, count: 3}"),
        "intensity.levels.start = -0.1 must be greater than 0",
    ),
    "levels fall": (
        ("[0.1, 0.6", "[0.7, 0.6"),
        "intensity.levels = [0.7, 0.6, 1.2] must increase, but 0.6 follows 0.7",
    ),
    "no levels": (
        ("[0.1, 0.6, 1.2]", "[]"),
        "intensity.levels = [] must have at least one entry",
    ),
    "range upside down": (
        ("[0.1, 0.6, 1.2]", "{start: 1.0, stop: 0.5, count: 3}"),
        "intensity.levels must have stop above start = 1, not 0.5",
    ),
    "NaN": ((RING, "radius: .nan"), "arches[0].radius = nan must be a finite number"),
    "infinite radius": ((RING, "radius: .inf"), "arches[0].radius = inf must be a finite number"),
    "NaN friction": (
        ("friction: 0.7", "friction: .nan"),
        "arches[0] (ring): friction = nan is impossible; it must be one number or one for each "
        "of the 8 joints, all at least 0 (inf: the limit of large friction)",
    ),
    "text for a number": ((RING, "radius: ten"), "arches[0].radius = ten must be a number"),
    "half a voussoir": (
        ("voussoirs: 7", "voussoirs: 7.5"),
        "arches[0].voussoirs = 7.5 must be a whole number",
    ),
    "impossible geometry": (
        ("thickness: 1.5", "thickness: 25.0"),
        "arches[0] (ring): thickness = 25.0 m is impossible; it must be a finite number greater "
        "than 0 m and less than 20 m (2 x radius)",
    ),
    "unknown profile": (
        ("profile: block", "profile: blok"),
        "arches[1].profile = blok must be one of circular, segmental, pointed, elliptic, "
        "catenary, from_joints, block, polygons",
    ),
    "no profile": (("profile: block, ", ""), "arches[1].profile is missing"),
    "same id twice": (
        ("id: slab", "id: ring"),
        "arches[1].id: 'ring' is the id of arches[0] too; each arch needs its own",
    ),
    "id with a space": (
        ("id: slab", "id: my slab"),
        "arches[1].id = my slab must begin with a letter or a digit and hold only letters, "
        "digits and _ . + -",
    ),
    "unknown unit": (
        ("unit: g", "unit: kg"),
        "intensity.unit: unit 'kg' is not one of g, m/s2, cm/s2, gal, in which PGA can be given",
    ),
    "unknown measure": (
        ("measure: PGA", "measure: Sa"),
        "intensity.measure: unknown intensity measure 'Sa'; allowed are PGA, PGV, PGD, Arias, "
        "CAV, CAVstd, D5_75, D5_95, HI, ASI, Sa(T), AvgSA(T1,T2), FIV3(T) with periods in "
        "seconds, and RotD50() or RotD100() of PGA, PGV or Sa(T)",
    ),
    "a duration": (
        ("measure: PGA", "measure: D5_95"),
        "intensity has measure D5_95, to which no motion can be scaled",
    ),
    "missing key": (("title: A small study\n", ""), "title is missing"),
    "no source of records": (
        ('files: ["records/*.AT2"]', "select: [a]"),
        "motions must have a key index, files or synthetic",
    ),
    "selected twice": (
        ('files: ["records/*.AT2"]', "{index: a.csv, select: [b, b]}"),
        "motions must have different ids under select, but 'b' is there twice",
    ),
    "dt zero": (
        ("dt: 2.0e-3", "dt: 0.0"),
        "method.dt = 0.0 must be greater than or equal to 1e-06",
    ),
    "rtol one": (("dt: 2.0e-3", "rtol: 1.0"), "method.rtol = 1.0 must be less than 1"),
    "no workers": (
        ("workers: 2", "workers: 0"),
        "execution.workers = 0 must be greater than or equal to 1",
    ),
    "YAML syntax": (
        ("title: A small study", "title: [}"),
        "line 2: expected the node content, but found '}'",
    ),
    "key twice": (("title: A small study", "id: other"), "line 2: the key id is given twice"),
    "two wrong": (
        (f"{RING}, thickness: 1.5", "radius: x, thickness: y"),
        "arches[0].thickness = y must be a number (1 more key is wrong too)",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_study_gives_its_sentence(tmp_path, case):
    (old, new), sentence = BAD[case]
    assert old in TEXT
    assert refused(tmp_path, TEXT.replace(old, new, 1)) == sentence


def test_file_that_is_no_study(tmp_path):
    assert refused(tmp_path, "- a\n- b\n") == (
        "must hold keys with values, such as id, arches and motions"
    )
    with pytest.raises(StudyError, match=r"nowhere\.yaml cannot be read: No such file"):
        load_study(tmp_path / "nowhere.yaml")


def test_no_sliding_lists_and_exponents_are_accepted(tmp_path):
    text = TEXT.replace("friction: 0.7", "friction: [.inf, 1, 1, 1, 1, 1, 1, 0.5]")
    study = load_study(small_study(tmp_path, text.replace("2.0e-3", "2e-3")))
    assert study.method.dt == 2e-3
    friction = study.arches[0].build().chain.friction
    np.testing.assert_array_equal(friction, [np.inf, 1, 1, 1, 1, 1, 1, 0.5])
    assert np.isinf(study.arches[1].build().chain.friction).all()
    plain = load_study(small_study(tmp_path, TEXT.replace("friction: .inf", "friction: inf")))
    assert plain.arches[1].friction == np.inf


def test_levels_in_user_units_become_si(tmp_path):
    text = TEXT.replace("[0.1, 0.6, 1.2]", "{start: 0.1, stop: 1.2, count: 12}")
    study = load_study(small_study(tmp_path, text))
    assert study.intensity.given[:3] == (0.1, 0.2, 0.3)
    np.testing.assert_allclose(study.intensity.si, 9.80665 * np.linspace(0.1, 1.2, 12))
    velocity = TEXT.replace("PGA", "PGV").replace("unit: g", "unit: cm/s")
    study = load_study(small_study(tmp_path, velocity))
    np.testing.assert_allclose(study.intensity.si, [0.001, 0.006, 0.012])


def test_paths_are_relative_to_the_study_file_and_of_overrides_to_here(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    path = small_study(tmp_path / "there")
    monkeypatch.chdir(tmp_path / "here")
    study = load_study(path, ["motions.files=['x/*.AT2', {path: y.txt, unit: g}]"])
    assert study.folder == tmp_path / "there" / "out"
    assert [entry.path for entry in study.motions.files] == [
        str(tmp_path / "here" / "x" / "*.AT2"), str(tmp_path / "here" / "y.txt"),
    ]  # fmt: skip
    assert study.motions.files[1].unit == "g"
    for override in ("motions.files.0=y.AT2", "motions.files.0.path=y.AT2"):
        study = load_study(path, ["motions.files=[{path: x}]", override])
        assert study.motions.files[0].path == str(tmp_path / "here" / "y.AT2")
    for override, folder in {"output=o": "o", "output=../o": "../o"}.items():
        assert load_study(path, [override]).folder == (tmp_path / "here" / folder).resolve()


def test_results_lie_beside_the_study_file_unless_it_says_otherwise(tmp_path):
    path = small_study(tmp_path, TEXT.replace("output: out\n", ""))
    assert load_study(path).folder == tmp_path / "results" / "small"
    assert load_study(path, ["id=other"]).folder == tmp_path / "results" / "other"


def test_overrides_reach_into_lists_and_are_checked(tmp_path):
    path = small_study(tmp_path)
    assert load_study(path, ["arches.0.friction=0.5"]).arches[0].friction == 0.5
    for override, sentence in {
        "arches.4.friction=1": "--set arches.4.friction=1: arches has 2 entries, counted from 0, "
        "and 4 is none of them",
        "dt": "--set dt: must be key=value, for example method.dt=0.0005",
        "id.x=1": "--set id.x=1: id has no keys",
        "metod.dt=1": "metod is no known key; did you mean method?",
    }.items():
        assert refused(tmp_path, TEXT, override) == sentence


def test_dumped_study_is_the_same_study(tmp_path):
    study = load_study(small_study(tmp_path))
    again = tmp_path / "elsewhere" / "study.yaml"
    again.parent.mkdir()
    again.write_text(dump_study(study))
    assert load_study(again) == study


@given(st.text(st.characters(exclude_categories=["Cc", "Cs"]), max_size=12))
@example("1e5")
@example("1:30")
@example("inf")
@example("no")
@example("~")
def test_text_is_the_same_text_after_writing_and_reading(text):
    assert parse_value(dump_yaml({"title": text}), "here") == {"title": text}


def test_schema_beside_the_configs_is_the_one_of_the_models():
    assert (ROOT / "configs" / "study.schema.json").read_text() == study_schema(), (
        "write study_schema() to configs/study.schema.json"
    )


def test_schema_tells_what_the_registry_says_of_methods():
    from archfrag.methods.registry import METHODS
    from archfrag.simulation.checks import own_parameters

    method = json.loads(study_schema())["$defs"]["Method"]["properties"]
    assert method["name"]["enum"] == list(dict.fromkeys(["auto", *METHODS]))
    for info in METHODS.values():
        for parameter in info.parameters:
            if parameter.name in own_parameters(info):
                continue  # given under settings
            assert info.name in method[parameter.name]["description"]
    assert "[s]" in method["dt"]["description"]
    assert "0.0005 if not given" in method["dt"]["description"]


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_configs_are_valid_by_models_and_by_schema(path):
    import jsonschema

    study = load_study(path)
    kept = {"own_records": path.parent / "results" / "own-records"}
    assert study.folder == kept.get(path.stem, ROOT / "results" / path.stem)
    schema = json.loads(study_schema())
    raw = yaml.safe_load(dump_study(study))
    jsonschema.validate(raw, schema)
    raw["arches"][0]["radus"] = 1.0
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(raw, schema)


def test_a_method_whose_package_is_missing_is_refused_before_anything_runs(tmp_path, monkeypatch):
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    text = TEXT.replace("name: time_stepping", "name: quadratic_programme")
    assert "needs the package piqp" in refused(tmp_path, text)
