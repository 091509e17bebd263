"""Scenes and drawings of bridges: bodies before and after each joint, a ground under each base."""

import json
from itertools import combinations

import jsonschema
import numpy as np
import pytest
import shapely

import archfrag as af
from archfrag.export import scenes
from archfrag.export.scenes import export_arches
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from tests.study.small import TEXT, small_study

RING = (
    "profile: circular, radius: 2.5, thickness: 0.5, embrace: 180.0, voussoirs: 9, "
    "friction: 0.6"
)
PIER = "{height: 4.0, width: 1.0, courses: 2}"
ARCHES = {
    "two": f"{RING}, spans: 2, piers: {PIER}",
    "straight": f"{RING}, sector: false, spans: 3, piers: {PIER}",
    "unequal": f"{RING}, spans: [{{radius: 2.0}}, {{voussoirs: 7}}, {{embrace: 150.0}}], "
    "piers: [{height: 4.0, width: 1.2}, {height: 6.0, width: 1.5, base_width: 2.0, courses: 3}]",
    "ends": f"{RING}, spans: 2, piers: {PIER}, ends: [{{height: 3.0, width: 1.5}}, null]",
    "tied": f"{RING}, spans: 2, piers: {PIER}, ties: [{{level: 1.0, area: 5.0e-4}}]",
    "wide": f"{RING}, spans: 2, piers: {{height: 2.0, width: 1.0, base_width: 5.0, courses: 2}}",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    rows = "\n".join(f"  - {{id: {name}, {keys}}}" for name, keys in ARCHES.items())
    head, _, rest = TEXT.partition("arches:")
    text = f"{head}arches:\n{rows}\nmotions:{rest.partition('motions:')[2]}"
    study = load_study(small_study(tmp_path_factory.mktemp("bridges"), text))
    prepare_motions(study)
    export_arches(study, ["scene", "dxf"])
    folder = study.folder / "export"
    return study, folder, json.loads((folder / "small-scene.json").read_text())


@pytest.fixture(params=ARCHES)
def pair(request, made):
    built = {each.id: each.entry.build() for each in made[0].members}
    named = {each["id"]: each for each in made[2]["arches"]}
    return built[request.param], named[request.param]


def test_the_schema_takes_bridges(made):
    jsonschema.validate(made[2], json.loads(scenes.SCHEMA.read_text()))


def test_each_joint_lies_on_the_bodies_before_and_after_it(pair):
    arch, scene = pair
    n = arch.n_voussoir
    shapes = [shapely.Polygon(body["outline"]) for body in scene["bodies"]]
    # Body -1 is the left ground, body n + k - 1 that of base k.
    rows = np.where(arch.pairs < 0, n, arch.pairs + (arch.pairs >= n))
    assert [joint["bodies"] for joint in scene["joints"]] == rows.tolist()
    for joint in scene["joints"]:
        for body in joint["bodies"]:
            edge = shapes[body].exterior
            assert max(edge.distance(shapely.Point(e)) for e in joint["ends"]) < 1e-9


def test_each_base_has_its_ground(pair):
    arch, scene = pair
    kinds = [body["kind"] for body in scene["bodies"]]
    rings = sum(len(span.bodies) for span in arch.spans)
    count = {kind: kinds.count(kind) for kind in kinds}
    piers = {"pier": arch.n_voussoir - rings}
    assert count == {"voussoir": rings, **piers, "ground": len(arch.bases)}
    assert kinds[-len(arch.bases) :] == ["ground"] * len(arch.bases)
    shapes = [shapely.Polygon(body["outline"]) for body in scene["bodies"]]
    for one, other in combinations(shapes, 2):
        assert one.intersection(other).area < 1e-9
    for one, other in combinations(shapes[arch.n_voussoir :], 2):
        assert not one.intersects(other)


@pytest.mark.filterwarnings("ignore:.* are not part of the arch")
def test_the_drawing_is_the_same_bridge(pair, made):
    arch, scene = pair
    if scene["id"] in ("tied", "ends"):
        arch = arch.changed(chain=arch.chain._replace(tie=None))
    path = made[1] / f"small-{scene['id']}.dxf"
    again = af.Arch.from_dxf(path, friction=0.6, layer="VOUSSOIRS")
    assert len(again.spans) == len(arch.spans)
    found, whole = af.onset(again), af.onset(arch)
    assert [found.plus, found.minus] == pytest.approx(
        [whole.plus, whole.minus], rel=1e-3
    )


def test_the_scene_stands_alone(pair):
    """Built from nothing but its scene, a bridge has the same onset."""
    arch, scene = pair
    if scene["id"] == "tied":
        return
    bodies = [body for body in scene["bodies"] if body["kind"] != "ground"]
    ground = [
        joint["ends"]
        for joint in scene["joints"]
        if max(joint["bodies"]) >= len(bodies)
    ]
    again = af.Arch.from_polygons(
        [body["outline"] for body in bodies],
        0.6,
        ground=ground,
        depth=[body["depth"] for body in bodies],
    )
    found, whole = af.onset(again), af.onset(arch)
    assert [found.plus, found.minus] == pytest.approx(
        [whole.plus, whole.minus], rel=1e-3
    )


def test_ties_of_a_span_are_on_its_bodies(made):
    scene = next(each for each in made[2]["arches"] if each["id"] == "tied")
    shapes = [shapely.Polygon(body["outline"]) for body in scene["bodies"]]
    assert len(scene["ties"]) == 2
    for tie in scene["ties"]:
        for body, end in zip(tie["bodies"], tie["ends"]):
            assert shapes[body].distance(shapely.Point(end)) < 1e-6
