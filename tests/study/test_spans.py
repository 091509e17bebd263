"""Bridges of several spans in study files, tables and commands: each key works or is refused."""

import itertools
import json

import numpy as np
import pytest
from click.testing import CliRunner

import archfrag as af
from archfrag.cli.arch import onset
from archfrag.errors import ArchfragError
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import expand
from archfrag.study.keys import at

RING = {
    "id": "b",
    "profile": "segmental",
    "span": 5.0,
    "rise": 2.0,
    "thickness": 0.6,
    "voussoirs": 7,
    "friction": 0.7,
}
PIER = {"height": 3.0, "width": 2.0, "courses": 2}
SPANS = {**RING, "spans": 3, "piers": PIER}


def uniform(start, stop, **more):
    return {"distribution": "uniform", "start": start, "stop": stop, **more}


RISE = {"samples": 2, "of": {"rise": uniform(1.8, 2.2)}}


def drawn(entry, **vary):
    """Return the arches of an entry that varies."""
    given = {**entry, "vary": {"samples": 2, **vary}}
    with at("study", given):
        return [each.entry.build() for each in expand([ArchEntry(**given)])]


def built(**entry):
    with at("study", entry):
        return ArchEntry.model_validate(entry).build()


def test_a_ring_has_the_keys_of_the_bridge_and_its_own():
    shared = {key: RING[key] for key in ("id", "profile", "thickness", "friction")}
    own = [{"span": 5.0, "rise": 2.0, "voussoirs": 7}, {"span": 7.0, "rise": 3.0}]
    own[1]["voussoirs"] = 9
    third = {"profile": "pointed", "span": 5.0, "rise": 4.0, "voussoirs": 8}
    bridge = built(**shared, spans=[*own, third], piers=[PIER, {**PIER, "height": 4.0}])
    assert [len(span.bodies) for span in bridge.spans] == [7, 9, 8]
    spans = [bridge.dimensions_of(span)[0] for span in bridge.spans]
    alone = [built(**shared | each).dimensions[0] for each in (*own, third)]
    assert spans == pytest.approx(alone, rel=1e-12)
    base = {
        name: bridge.intrados[joint, 1] for name, (joint, _) in bridge.bases.items()
    }
    assert base["pier 1"] - base["pier 2"] == pytest.approx(1.0)


def test_rings_and_piers_vary_together_and_joints_one_by_one():
    of = {"thickness": uniform(0.5, 0.7), "piers.height": uniform(2.0, 4.0)}
    one, other = drawn(SPANS, of=of)
    assert one.parameters["piers"]["height"] != other.parameters["piers"]["height"]
    for arch in (one, other):
        thickness = {round(arch.dimensions_of(span)[2], 9) for span in arch.spans}
        assert len(thickness) == 1
    piers = [PIER, {**PIER, "height": 4.0}]
    of = {"piers.height": uniform(0.8, 1.2, relative=True)}
    for arch in drawn({**SPANS, "piers": piers}, of=of):
        first, second = (pier["height"] for pier in arch.parameters["piers"])
        assert second / first == pytest.approx(4.0 / 3.0)
    scatter = {"friction": uniform(0.9, 1.1), "recess_intrados": uniform(0.0, 0.05)}
    one, _ = drawn(SPANS, each_joint=scatter)
    assert len(set(one.chain.friction)) == one.n_joint == 28
    ends = {"ends.width": uniform(1.8, 2.2)}
    one, other = drawn({**RING, "ends": PIER}, of=ends)
    assert one.parameters["ends"]["width"] != other.parameters["ends"]["width"]


@pytest.mark.parametrize(
    ("entry", "part"),
    [
        ({**RING, "piers": PIER}, "piers stand between spans; those of a single"),
        (
            {**RING, "spans": 3},
            "piers must be given: one block for all, or a list of 2",
        ),
        ({**SPANS, "piers": [PIER]}, "piers must be given: one block for all, or a"),
        ({**SPANS, "ends": [PIER]}, "ends must be one block for both or a list"),
        ({**SPANS, "spans": [{}, {"rise": -1.0}, {}]}, "cannot have spans[1]: rise"),
        ({**SPANS, "spans": [{}, {"fill": {}}, {}]}, "fill is not a key of a span"),
        (
            {**RING, "radius": 3.0, "spans": [{}, {}], "piers": PIER},
            "radius is a key that no profile of spans has",
        ),
        (
            {
                **SPANS,
                "spans": [{}, {"rise": 2.2}],
                "vary": {"samples": 2, "of": {"rise": uniform(1.8, 2.2)}},
            },
            "vary.of.rise would not change spans[1]",
        ),
        (
            {
                **SPANS,
                "vary": {"samples": 2, "each_joint": {"position": uniform(-0.1, 0.1)}},
            },
            "with piers cannot have position",
        ),
        (
            {"id": "b", "drawing": "b.dxf", "friction": 0.7, "spans": 2},
            "spans is given with a drawing, which shows all spans",
        ),
        ({**SPANS, "friction": [0.7] * 9}, "friction of shape (9,) is impossible"),
        ({**SPANS, "ties": [{"level": 1.0, "area": 1e-3, "span": 4}]}, "1 to 3"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(entry, part):
    with pytest.raises(ArchfragError) as error:
        built(**entry)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


def test_a_table_of_bridges_makes_a_class(tmp_path):
    table = tmp_path / "stock.csv"
    table.write_text(
        "id,spans,span [m],rise [m],thickness [m],"
        "piers.height [m],piers.width [m],piers.courses,line\n"
        "north,3,5,2,0.6,3,2,2,Aosta\n"
        "south,2,6,2,0.6,,,,Susa\n"
        "alone,1,6,2,0.6,,,,Susa\n"
    )
    shared = {key: RING[key] for key in ("id", "profile", "voussoirs", "friction")}
    entry = ArchEntry(**shared, table=str(table), piers={"height": 2.5, "width": 1.8})
    north, south, alone = expand([entry])
    assert (north.values["spans"], north.values["piers.height"]) == (3.0, 3.0)
    assert north.attributes == {"line": "Aosta"}
    assert [len(each.entry.build().spans) for each in (north, south, alone)] == [
        3,
        2,
        1,
    ]
    assert north.entry.build().parameters["piers"]["courses"] == 2
    assert south.entry.build().parameters["piers"]["width"] == 1.8


def test_options_of_a_command_make_the_bridge_of_a_study():
    options = "--profile segmental --span 5 --rise 2 --thickness 0.6 --voussoirs 7 --friction 0.7"
    piers = "--spans 3 --pier-height 3 --pier-width 2 --pier-courses 2 --json"
    told = CliRunner().invoke(onset, [*options.split(), *piers.split()])
    assert told.exit_code == 0, told.output
    facts = json.loads(told.output.splitlines()[0])
    bridge = built(**SPANS)
    weight = bridge.chain.mass.sum() * bridge.chain.gravity
    assert sum(facts["arch"]["weights"].values()) == pytest.approx(weight, rel=1e-12)
    assert np.shape(facts["arch"]["springings"]) == (6, 2, 2)
    one = CliRunner().invoke(onset, [*options.split(), "--pier-height", "3"])
    assert "--pier-width must be given" in str(one.exception)


FEATURES = {
    "fill": {"fill": {"height_over_crown": 0.3, "unit_weight": 18e3}},
    "ties": {"ties": [{"level": 0.5, "area": 1e-3, "modulus": 2e11}]},
    "strength": {"strength": 2e6},
    "recess": {"recess": {"intrados": 0.01, "extrados": 0.01}},
    "dead_load": {"dead_load": 5e3},
    "inset": {"joints": {"stiffness": 3e10}},
    "face": {"joints": {"stiffness": 3e10, "model": "face"}},
    "springings": {"springings": {"spread": 0.01}},
    "ends": {"ends": {"height": 3.0, "width": 1.0}},
    "transverse": {"transverse": "pier 1"},
    "wave_speed": {},
    "bases": {},
    "vertical": {},
}
REFUSED = {
    ("ties", "face"): "needs rigid joints",
    ("strength", "face"): "needs joints.model inset",
    ("inset", "face"): "",
    ("ties", "transverse"): "transverse takes a pier alone",
    ("springings", "transverse"): "transverse takes a pier alone",
    ("transverse", "wave_speed"): "has no right base",
    ("transverse", "bases"): "has no right base",
    ("wave_speed", "bases"): "are both given",
}
OF_OTHERS = {("ends", "transverse")}  # the column of pier 1 has nothing of the ends


def rotation_with(*names):
    """Largest rotation of two spans, or of a column, with some features [rad]."""
    ring = {"profile": "circular", "radius": 2.5, "thickness": 0.5, "embrace": 180.0}
    entry = {"id": "b", **ring, "voussoirs": 5, "friction": 0.6, "spans": 2}
    entry["piers"] = {"height": 4.0, "width": 1.0}
    for name in names:
        entry |= FEATURES[name]
    moved = {"wave_speed": 200.0, "bases": {"pier 1": 0.02}}
    time = 0.005 * np.arange(200)
    wave = 9.8 * np.sin(2.0 * np.pi * time) * (time < 0.5)
    up = {"vertical": 0.3 * wave} if "vertical" in names else {}
    method = {name: moved[name] for name in names if name in moved}
    motion = af.Motion(wave, 0.005, **up)
    return af.simulate(built(**entry), motion, 0.28, follow=1.0, **method).peak_rotation


def test_each_feature_runs_with_each_other_or_is_refused_and_none_is_ignored():
    alone = {name: rotation_with(name) for name in FEATURES}
    assert len({*alone.values(), rotation_with()}) == len(FEATURES) + 1
    for pair in itertools.combinations(FEATURES, 2):
        if pair in REFUSED:
            if REFUSED[pair]:  # one key cannot have two values
                with pytest.raises(ArchfragError, match=REFUSED[pair]):
                    rotation_with(*pair)
        elif pair not in OF_OTHERS:
            assert rotation_with(*pair) not in [alone[name] for name in pair], pair
