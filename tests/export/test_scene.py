"""Arches for other programs: scenes, drawings, and the page's script in LMGC90.

ARCHFRAG_LMGC90_PYTHON names an interpreter that has compas_lmgc90. Measured with 0.1.11.
"""

import csv
import json
import os
import re
import subprocess
from types import SimpleNamespace

import ezdxf
import jsonschema
import numpy as np
import pytest
import shapely

import archfrag as af
from archfrag.arch.drawing import drawing_text
from archfrag.errors import InputError
from archfrag.export import scenes
from archfrag.export.scenes import export_arches
from archfrag.motions.measures import measure
from archfrag.study.file.prepared import load_prepared, load_record, prepare_motions
from archfrag.study.file.schema import Method, load_study
from archfrag.study.runs.store import make_plan
from tests.study.small import ROOT, command, small_study, write_at2

RING = "profile: circular, radius: 10.0, thickness: 1.5, embrace: 157.5, voussoirs: 7"
ARCHES = {
    "ring": f"{RING}, friction: 0.7",
    "straight": f"{RING}, friction: 0.7, sector: false",
    "several": f"{RING}, friction: [0.7, 0.6, 0.7, .inf, 0.7, 0.7, 0.6, 0.7]",
    "block": "profile: block, width: 0.4, height: 2.0, friction: .inf",
    "piers": f"{RING}, friction: 0.7, ends: {{height: 4.0, width: 3.0, courses: 2, depth: 2.0}}",
    "fill": f"{RING}, friction: 0.7, fill: {{height_over_crown: 0.5, unit_weight: 18000}}",
    "tied": f"{RING}, friction: 0.7, ties: [{{level: 4.0, area: 5.0e-4, prestress: 2.0e+4}}, "
    "{level: 5.0, area: 5.0e-4, strength: 9.0e+4, rupture: 0.5}]",
    "spread": f"{RING}, friction: 0.7, springings: {{spread: 0.05}}",
    "inset": f"{RING}, friction: 0.7, joints: {{stiffness: 3.0e+10}}",
    "face": f"{RING}, friction: 0.7, joints: {{stiffness: 2.0e+10, model: face, points: 3}}",
    "mixed": f"{RING}, friction: 0.7, joints: {{stiffness: [.inf, 1.0e+10, 2.0e+10, 1.0e+10, "
    "1.0e+10, 1.0e+10, 1.0e+10, .inf], shear: 5.0e+9, damping: 0.1}",
}


def study_of(folder, arches=ARCHES, *, prepared=True, text=""):
    rows = "\n".join(f"  - {{id: {name}, {keys}}}" for name, keys in arches.items())
    path = small_study(
        folder,
        (
            f"id: small\ntitle: 'Arches [of  two\\n kinds]'\noutput: out\narches:\n{rows}\n"
            "motions: {files: ['records/*.AT2']}\n"
            "intensity: {measure: PGA, unit: g, levels: [0.1, 0.6, 1.2]}\n" + text
        ),
    )
    study = load_study(path)
    if prepared:
        prepare_motions(study)
    return study


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A study of all kinds of arches, its folder of exports, and its scene."""
    study = study_of(
        tmp_path_factory.mktemp("scene"), text="method: {bases: {right: 0.02}}\n"
    )
    export_arches(study, ["scene", "dxf"])
    folder = study.folder / "export"
    return study, folder, json.loads((folder / "small-scene.json").read_text())


@pytest.fixture(scope="module", params=ARCHES)
def pair(request, made):
    """An arch as archfrag has it, and as the scene has it."""
    built = {each.id: each.entry.build() for each in made[0].members}
    return built[request.param], next(
        a for a in made[2]["arches"] if a["id"] == request.param
    )


def test_a_scene_fits_its_schema_and_every_part_is_asked_for(made):
    schema = json.loads(scenes.SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(made[2], schema)
    for change in (
        lambda scene: scene["arches"][0].update(bodys=[]),
        lambda scene: scene["arches"][0]["joints"][0].update(friction=-1),
        lambda scene: scene["motions"][0].pop("dt"),
        lambda scene: scene["units"].update(mass="t"),
    ):
        spoilt = json.loads(json.dumps(made[2]))
        change(spoilt)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(spoilt, schema)


def test_every_number_has_a_unit(made):
    def numbers(value, key):
        if isinstance(value, dict):
            return set().union(*(numbers(each, name) for name, each in value.items()))
        if isinstance(value, list):
            return set().union(*(numbers(each, key) for each in value), set())
        return {key} if isinstance(value, float) else set()

    assert numbers(made[2], "") - {"levels", "power"} <= set(made[2]["units"])


class TestArches:
    def test_masses_and_places(self, pair):
        arch, scene = pair
        bodies = scene["bodies"][: arch.n_voussoir]
        for i, body in enumerate(bodies):
            assert (body["mass"], body["inertia"]) == (
                arch.chain.mass[i],
                arch.chain.inertia[i],
            )
            assert body["centroid"] == arch.centroids[i].tolist()
            shape = shapely.Polygon(body["outline"])
            assert shape.exterior.is_ccw
            weighed = body["density"] * body["depth"] * shape.area
            assert weighed == pytest.approx(body["mass"], rel=1e-12)
            assert shapely.Polygon(arch.outlines[i]).equals(shape)
            if "fill" not in arch.parameters:
                assert body["density"] == pytest.approx(2000.0, rel=2e-4)
        kinds = [body["kind"] for body in scene["bodies"]]
        assert kinds.count("ground") == (1 if arch.free_end else 2)
        assert kinds.count("pier") == (4 if "ends" in arch.parameters else 0)
        assert scene["gravity"] == 9.80665

    def test_joints_lie_on_both_their_bodies(self, pair):
        arch, scene = pair
        shapes = [shapely.Polygon(body["outline"]) for body in scene["bodies"]]
        slack = 0.1 if arch.chain.start is not None else 1e-9  # hinges that have opened
        assert len(scene["joints"]) == arch.n_joint
        for number, joint in enumerate(scene["joints"]):
            for body in joint["bodies"]:
                away = [
                    shapes[body].exterior.distance(shapely.Point(e))
                    for e in joint["ends"]
                ]
                assert max(away) < slack
            friction = arch.chain.friction[number]
            assert joint["friction"] == ("inf" if np.isinf(friction) else friction)
            if not arch.joints:
                assert not {"kn", "ks"} & set(joint)
        grounds = shapes[arch.n_voussoir :]
        for ground in grounds:
            assert ground.exterior.is_ccw
            assert ground.area > 1.5 * 0.4**2
            assert max(
                ground.intersection(shape).area for shape in shapes[: arch.n_voussoir]
            ) < (slack * slack)
        if len(grounds) == 2:
            assert not grounds[0].intersects(grounds[1])

    def test_the_outlines_make_the_arch_again(self, pair):
        arch, scene = pair
        if scene["id"] in ("spread", "fill", "inset", "mixed"):
            return  # joints have opened or are shorter, or bodies carry more than themselves
        bodies = [b for b in scene["bodies"] if b["kind"] != "ground"]
        ground = [
            scene["joints"][j]["ends"] for j in (0, -1)[: 1 if arch.free_end else 2]
        ]
        friction = [float(joint["friction"]) for joint in scene["joints"]]
        again = af.Arch.from_polygons(
            [body["outline"] for body in bodies],
            friction,
            ground=ground,
            depth=[body["depth"] for body in bodies],
        )
        rigid = af.onset(arch.changed(chain=arch.chain._replace(joint=None, tie=None)))
        found = af.onset(again)
        assert [found.plus, found.minus] == pytest.approx(
            [rigid.plus, rigid.minus], rel=1e-3
        )


def test_blocks_of_ground_of_a_narrow_arch_do_not_meet():
    arch = af.Arch.circular(1.0, 1.2, 180.0, voussoirs=7, friction=0.7)
    left, right = (shapely.Polygon(block) for _, block in scenes._ground(arch))
    assert not left.intersects(right)


def test_joints_that_give(made):
    found = {arch["id"]: arch for arch in made[2]["arches"]}
    face, mixed, inset = (found[name] for name in ("face", "mixed", "inset"))
    assert [joint["kn"] for joint in mixed["joints"]] == [
        "inf",
        1e10,
        2e10,
        *[1e10] * 4,
        "inf",
    ]
    assert {joint["ks"] for joint in mixed["joints"]} == {5e9}
    assert (mixed["damping"], mixed["model"]) == (0.1, "inset")
    assert {(joint["kn"], joint["ks"]) for joint in face["joints"]} == {(2e10, 2e10)}
    assert (face["damping"], face["model"], face["points"]) == (0.05, "face", 3)
    assert {(joint["kn"], joint["ks"]) for joint in inset["joints"]} == {(3e10, 3e10)}
    assert (inset["damping"], inset["model"], "points" in inset) == (
        0.05,
        "inset",
        False,
    )
    length = [np.hypot(*np.subtract(*joint["ends"])) for joint in inset["joints"]]
    assert 1.0 < min(length) <= max(length) < 1.5


def test_ties(made):
    arch = next(each for each in made[0].members if each.id == "tied").entry.build()
    first, second = next(a for a in made[2]["arches"] if a["id"] == "tied")["ties"]
    assert [first["ends"], second["ends"]] == arch.tie_lines.tolist()
    assert first["bodies"] == arch.tie_bodies[0].tolist()
    width = first["ends"][1][0] - first["ends"][0][0]
    assert first["stiffness"] == pytest.approx(2e11 * 5e-4 / width)
    assert first["prestress"] == pytest.approx(2e4)
    assert (first["strength"], first["rupture"]) == ("inf", "inf")
    assert (second["strength"], second["rupture"]) == (9e4, 0.5)
    assert second["prestress"] == pytest.approx(0.0, abs=1.0)
    anchored = af.Block(0.4, 2.0, 0.7).tied(
        area=1e-4, ends=[(-1, 1.0, 0.0), (0, 0.2, 1.5)]
    )
    entry = SimpleNamespace(build=lambda: anchored)
    member = SimpleNamespace(entry=entry, id="a", arch_class="a")
    assert scenes._arch(member, Method())["ties"][0]["bodies"] == [1, 0]


def test_motions_are_those_of_the_study_to_the_last_bit(made):
    study, _, scene = made
    plan = make_plan(study)
    assert scene["arches"][0]["delays"] == [0.0, 0.02]
    assert scene["intensity"] == {
        "measure": "PGA",
        "unit": "g",
        "levels": [0.1, 0.6, 1.2],
        "power": 1.0,
    }
    for number, (record, motion) in enumerate(
        zip(load_prepared(study), scene["motions"], strict=True)
    ):
        exact = load_record(study.work, record)
        assert (motion["id"], motion["event"], motion["dt"]) == (
            record.id,
            record.event,
            exact.dt,
        )
        assert motion["horizontal"] == exact.acceleration.tolist()
        assert "vertical" not in motion
        cases = np.zeros(3, [("record", int), ("level", float)])
        cases["record"] = number
        cases["level"] = plan.levels
        assert motion["factors"] == plan.factors(cases).tolist()
        scaled = af.Motion(
            np.array(motion["horizontal"]) * motion["factors"][1], motion["dt"]
        )
        assert measure(scaled, "PGA") == pytest.approx(0.6 * 9.80665)


def test_vertical_components(tmp_path):
    small_study(tmp_path)
    for path in (tmp_path / "records").glob("*.AT2"):
        path.rename(path.with_name(path.stem + "090.AT2"))
    for name in ("wave0", "wave1"):
        write_at2(
            tmp_path / "records" / f"{name}-UP.AT2",
            np.linspace(0, 0.1, 150),
            0.01,
            "UP",
        )
    text = (
        (tmp_path / "small.yaml")
        .read_text()
        .replace("files: [", "vertical: true\n  files: [")
    )
    (tmp_path / "small.yaml").write_text(text)
    study = load_study(tmp_path / "small.yaml")
    prepare_motions(study)
    export_arches(study, ["scene"])
    scene = json.loads((study.folder / "export" / "small-scene.json").read_text())
    jsonschema.validate(scene, json.loads(scenes.SCHEMA.read_text()))
    exact = load_record(study.work, load_prepared(study)[0])
    assert scene["motions"][0]["vertical"] == exact.vertical.tolist()
    assert max(scene["motions"][0]["vertical"]) == pytest.approx(0.980665)


def test_a_title_is_kept_as_it_is_and_the_file_says_who_made_it(made):
    about = made[2]["made"]
    assert about["title"] == made[0].title
    assert (about["study"], about["archfrag"]) == ("small", af.__version__)
    text = (made[1] / "small-scene.json").read_text()
    assert max(map(len, text.splitlines())) > 1000  # samples of a record are one line
    assert text.count("\n") < 6000


def test_of_a_class_there_is_the_first_arch_or_all(tmp_path, monkeypatch):
    vary = "vary: {samples: 4, of: {thickness: {distribution: uniform, start: 1.4, stop: 1.6}}}"
    study = study_of(
        tmp_path, {"k": f"{RING}, friction: 0.7, {vary}", "one": ARCHES["block"]}
    )
    found = export_arches(study, ["scene", "dxf"])
    assert found["notes"] == [
        "scene and dxf have k-0001 of 4 arches of k; --members: all"
    ]
    names = [each["file"].rsplit("/", 1)[1] for each in found["files"]]
    assert names == ["small-scene.json", "small-k-0001.dxf", "small-one.dxf"]
    found = export_arches(study, ["scene"], members=True)
    scene = json.loads((study.folder / "export" / "small-scene.json").read_text())
    ids = [f"k-000{n}" for n in (1, 2, 3, 4)]
    assert [(a["id"], a["class"]) for a in scene["arches"]] == [
        *((i, "k") for i in ids),
        ("one",) * 2,
    ]
    assert found["notes"] == []
    monkeypatch.setattr(scenes, "MOST_ARCHES", 4)
    message = (
        "study small has 5 arches; scene and dxf take at most 4; leave out --members"
    )
    with pytest.raises(InputError, match=message):
        export_arches(study, ["scene"], tmp_path / "none", members=True)
    assert not (tmp_path / "none").exists()


def test_needs_motions_but_no_runs(tmp_path):
    study = study_of(tmp_path, {"one": ARCHES["block"]}, prepared=False)
    path = tmp_path / "small.yaml"
    refused = command("export", path, "--format=scene")
    assert refused.exit_code != 0
    assert "`archfrag motions` on the study file" in refused.stderr
    assert not (study.folder / "export").exists()
    assert command("export", path, "--format=dxf").exit_code == 0
    assert command("motions", path).exit_code == 0
    done = command("export", path, "--format=scene", "--out", tmp_path / "x")
    assert done.stdout == f"scene: {tmp_path / 'x' / 'small-scene.json'}\n"
    both = command(
        "export", path, "--format=scene", "--format=csv", "--out", tmp_path / "y"
    )
    assert both.exit_code != 0
    assert not (tmp_path / "y").exists()


class TestDrawings:
    @pytest.mark.parametrize("name", [n for n in ARCHES if n != "spread"])
    def test_read_again_it_is_the_same_arch(self, made, name):
        arch = next(each for each in made[0].members if each.id == name).entry.build()
        with pytest.warns(UserWarning, match="GROUND"):
            again = af.Arch.from_dxf(
                made[1] / f"small-{name}.dxf", friction=0.7, layer="VOUSSOIRS"
            )
        assert again.free_end == arch.free_end
        for ours, theirs in zip(again.outlines, arch.outlines, strict=True):
            assert (
                shapely.Polygon(ours).hausdorff_distance(shapely.Polygon(theirs)) < 1e-9
            )
        whole = arch.given.ring if "ends" not in arch.parameters else arch
        np.testing.assert_allclose(again.intrados, whole.intrados, rtol=0, atol=1e-9)
        np.testing.assert_allclose(again.extrados, whole.extrados, rtol=0, atol=1e-9)

    def test_layers_units_and_no_date(self, made):
        path = made[1] / "small-tied.dxf"
        drawing = ezdxf.readfile(path)
        assert not drawing.audit().errors
        assert drawing.header["$INSUNITS"] == 6
        found = [(each.dxftype(), each.dxf.layer) for each in drawing.modelspace()]
        assert {kind: found.count(kind) for kind in found} == {
            ("LWPOLYLINE", "VOUSSOIRS"): 7,
            ("LINE", "VOUSSOIRS"): 2,
            ("LWPOLYLINE", "GROUND"): 2,
            ("LINE", "TIES"): 2,
        }
        assert all(each.closed for each in drawing.modelspace().query("LWPOLYLINE"))
        before = path.read_bytes()
        export_arches(made[0], ["dxf"])
        assert path.read_bytes() == before
        assert not ezdxf.options.write_fixed_meta_data_for_testing

    def test_the_option_of_ezdxf_is_put_back_after_an_error(self):
        with pytest.raises(AttributeError):
            drawing_text([("A", None)])
        assert not ezdxf.options.write_fixed_meta_data_for_testing


def test_script_of_the_page_in_lmgc90(tmp_path):
    """Verdicts of two levels, and the keystone before the first impact as on the page."""
    if "ARCHFRAG_LMGC90_PYTHON" not in os.environ:
        pytest.skip(
            "ARCHFRAG_LMGC90_PYTHON names no interpreter that has compas_lmgc90"
        )
    page = (ROOT / "docs" / "howto" / "scenes.md").read_text("utf-8")
    (script,) = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    (tmp_path / "in_lmgc90.py").write_text(script)
    refusals = {
        "ring": (ARCHES["ring"], "is not convex"),
        "inset": (ARCHES["inset"], "gives, or bears"),
        "fill": (ARCHES["fill"].replace("7,", "7, sector: false,", 1), "carries fill"),
        "tied": (ARCHES["tied"].replace("7,", "7, sector: false,", 1), "has ties"),
    }
    arches = {name: keys for name, (keys, _) in refusals.items()}
    study_of(tmp_path, {"straight": ARCHES["straight"]} | arches, prepared=False)
    pulse = np.array([*[1.0] * 300, 0.25, *[-0.5] * 600])
    for path in (tmp_path / "records").iterdir():
        path.unlink()
    write_at2(tmp_path / "records" / "pulse.AT2", pulse, 0.001)
    text = (
        (tmp_path / "small.yaml")
        .read_text()
        .replace("[0.1, 0.6, 1.2]", "[0.5, 0.9, 1.2]")
    )
    (tmp_path / "small.yaml").write_text(text)
    for step in ("motions", "export"):
        arguments = ["--format=scene"] * (step == "export")
        assert command(step, tmp_path / "small.yaml", *arguments).exit_code == 0

    def ask(*code):
        return subprocess.run(
            [os.environ["ARCHFRAG_LMGC90_PYTHON"], *code],
            cwd=tmp_path,
            timeout=300,
            text=True,
            capture_output=True,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
        )

    scene = "out/export/small-scene.json"
    done = ask("in_lmgc90.py", scene, "straight", "0.002")
    assert done.returncode == 0, done.stderr[-2000:]
    with (tmp_path / "verdicts.csv").open(newline="") as file:
        rows = [
            (row["record"], row["PGA [g]"], row["verdict"])
            for row in csv.DictReader(file)
        ]
    assert rows == [("pulse", "0.5", "survived"), ("pulse", "0.9", "collapsed")]
    keystone = (
        "import json, in_lmgc90 as page; scene = json.load(open('out/export/small-scene.json'));"
        "arch = next(a for a in scene['arches'] if a['id'] == 'straight');"
        "motion = scene['motions'][0]; page.FOLLOW = -0.49;"
        "moved, _ = page.run(arch, motion, motion['factors'][0], 0.0005);"
        "print(moved[399, 3, 0], moved[799, 3, 0])"
    )
    done = ask("-c", keystone)
    assert done.returncode == 0, done.stderr[-2000:]
    found = [float(text) for text in done.stdout.split()[-2:]]
    assert found == pytest.approx([-0.01621, -0.04211], rel=2e-3)
    for name, (_, message) in refusals.items():
        refused = ask("in_lmgc90.py", scene, name, "0.002")
        assert refused.returncode != 0
        assert message in refused.stderr
