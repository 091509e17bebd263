"""The key across of a study: the column of a pier in the place of its bridge, same records."""

import json

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import ArchfragError
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import expand
from archfrag.study.file.schema import load_study
from archfrag.study.keys import at
from tests.study.small import command, small_study

RING = {
    "id": "b",
    "profile": "segmental",
    "span": 5.0,
    "rise": 2.0,
    "thickness": 0.6,
    "voussoirs": 5,
    "friction": 0.7,
    "depth": 1.6,
}
PIER = {"height": 3.0, "width": 1.4, "courses": 2}
TALL = {**PIER, "height": 5.0}
BRIDGE = {**RING, "spans": 3, "piers": [PIER, TALL]}
FILL = {"height_over_crown": 0.5, "unit_weight": 18e3}
ROUGH = {"distribution": "uniform", "start": 0.9, "stop": 1.1}
TIE = {"level": 1.0, "area": 1e-3}
STUDY = """\
id: pair
title: A bridge along and across
output: out
arches:
  - {bridge}
  - {column}
motions: {{files: ["records/*.AT2"]}}
intensity: {{measure: PGA, unit: g, levels: [0.15, 1.0, 4.0]}}
method: {{follow: 5}}
"""


def built(**entry):
    with at("study", entry):
        return ArchEntry.model_validate(entry).build()


def same(one, other):
    for name in ("mass", "inertia", "centroid", "friction", "face_before"):
        np.testing.assert_array_equal(
            getattr(one.chain, name), getattr(other.chain, name)
        )


@pytest.mark.parametrize("fill", [None, FILL])
def test_the_key_gives_the_column_of_the_bridge(fill):
    bridge = built(**BRIDGE, fill=fill)
    for name in ("pier 1", "pier 2"):
        same(built(**BRIDGE, fill=fill, transverse=name), bridge.transverse(name))
    first = built(**BRIDGE, fill=fill, transverse=True)
    assert first.parameters["transverse"] == af.onset(bridge).transverse[0] == "pier 2"
    same(built(**BRIDGE, fill=fill, transverse=False), bridge)


def test_outer_piers_have_columns_too():
    arch = built(**RING, ends=[PIER, TALL])
    same(
        built(**RING, ends=[PIER, TALL], transverse="left pier"),
        arch.transverse("left pier"),
    )
    first = built(**RING, ends=[PIER, TALL], transverse=True)
    assert first.parameters["transverse"] == "right pier"


def test_joints_of_the_column_have_recesses_stiffness_and_strength():
    plain = built(**BRIDGE, transverse="pier 1")
    more = {
        "recess": {"intrados": [0.0, 0.1, 0.0]},
        "joints": {"stiffness": 3e10},
        "strength": 5e6,
    }
    for key, value in more.items():
        column = built(**BRIDGE, transverse="pier 1", **{key: value})
        assert column.n_joint == 3
        assert np.any(column.intrados != plain.intrados), key
    built(**BRIDGE, transverse="pier 1", **more)


def test_columns_vary_with_their_bridge(tmp_path):
    of = {"piers.height": {**ROUGH, "relative": True}, "depth": {**ROUGH}}
    vary = {"samples": 4, "of": of, "each_joint": {"recess_intrados": ROUGH}}
    vary["each_joint"]["recess_intrados"] = {**ROUGH, "start": 0.0, "stop": 0.02}
    entry = ArchEntry(**BRIDGE, transverse=True, vary=vary)
    columns = [each.entry.build() for each in expand([entry])]
    assert len({column.extent[1] for column in columns}) == 4
    assert all(column.n_joint == 3 for column in columns)
    table = tmp_path / "stock.csv"
    table.write_text("id,transverse\none,pier 1\ntwo,true\nwhole,\n")
    members = expand([ArchEntry(**BRIDGE, table=str(table))])
    one, two, whole = (each.entry.build() for each in members)
    assert (one.parameters["transverse"], two.parameters["transverse"]) == (
        "pier 1",
        "pier 2",
    )
    assert len(whole.spans) == 3


@pytest.mark.parametrize(
    ("entry", "part"),
    [
        (
            {**RING, "transverse": True},
            "transverse = 'true' is impossible; the arch has no pi",
        ),
        (
            {**RING, "transverse": "pier 1"},
            "transverse = 'pier 1' is impossible; the arch has",
        ),
        ({**BRIDGE, "transverse": "pier 3"}, "must be pier 1 or pier 2"),
        ({**BRIDGE, "transverse": "left pier"}, "must be pier 1 or pier 2"),
        (
            {**BRIDGE, "transverse": True, "ties": [TIE]},
            "ties is of the whole bridge; transverse takes a pier alone",
        ),
        (
            {**BRIDGE, "transverse": True, "springings": {"spread": 0.01}},
            "springings is of the whole bridge; transverse takes a pier alone",
        ),
        (
            {
                **BRIDGE,
                "transverse": True,
                "vary": {"samples": 2, "each_joint": {"friction": ROUGH}},
            },
            "vary.each_joint with transverse can only have recesses",
        ),
        (
            {"id": "b", "profile": "block", "width": 1.0, "height": 2.0}
            | {"friction": 0.6, "transverse": True},
            "transverse is not a known key; allowed are",
        ),
    ],
)
def test_what_has_no_column_is_refused_in_one_sentence(entry, part):
    with pytest.raises(ArchfragError) as error:
        built(**entry)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


def written(folder, **more):
    text = STUDY.format(
        bridge=json.dumps({**BRIDGE, "id": "along"}),
        column=json.dumps({**BRIDGE, "id": "over", "transverse": True}),
    )
    return small_study(folder, text, "pair.yaml")


def test_validate_and_onset_state_both(tmp_path):
    path = written(tmp_path)
    start = af.onset(load_study(path).members[0].entry.build())
    told = command("validate", path).output
    assert "along: the rings weigh" in told
    assert start.transverse_text in told
    assert "across governs" in start.transverse_text
    assert "the column is pier 2 across the bridge" in told
    told = command("onset", "--study", path, "--arch", "along").output
    assert start.transverse_text in told
    told = command("onset", "--study", path, "--arch", "along", "--json").output
    found = json.loads(told.splitlines()[0])["transverse"]
    assert found == {"pier": "pier 2", "onset": start.transverse[1].plus}
    told = command("onset", "--study", path, "--arch", "over").output
    assert f"moves from {start.transverse[1].plus:.4f} g" in told


def test_a_wave_along_the_bridge_is_refused_for_a_column(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("follow: 5", "wave_speed: 500"))
    told = command("validate", path).output
    assert "the arch has no right base" in told


def test_one_report_has_both_curves(tmp_path):
    path = written(tmp_path)
    done = command("run", path, "--quiet")
    assert done.exit_code == 0, done.output
    report = (tmp_path / "out" / "report.html").read_text()
    assert "onset across the bridge" in report
    assert "A pier moves across the bridge (over)" in report
    facts = json.loads((tmp_path / "out" / "summary.json").read_text())["arches"]
    along, over = facts
    assert (along["id"], over["id"]) == ("along", "over")
    assert over["onset"]["plus"] < along["onset"]["plus"]
    assert over["counts"]["runs"] == 6
    assert over["counts"]["survived"] >= 2
    scene = command("export", path, "--format", "scene")
    assert scene.exit_code == 0, scene.output
