"""Arches on piers and under fill: geometry, drawings, study files, refusals, all methods."""

import json
import math

import numpy as np
import pytest
from pydantic import ValidationError

import archfrag as af
from archfrag.errors import GeometryError, InputError
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import expand
from tests.arch.test_arch import MAKERS
from tests.arch.test_drawing import draw
from tests.piers import ends_of, on_piers

RING = af.Arch.circular(10.75, 1.5, 120.0, voussoirs=6, friction=0.7)
FILL = {"height_over_crown": 0.5, "unit_weight": 18e3}
UNEVEN = {
    "height": [8.0, 6.0],
    "width": [5.0, 4.0],
    "base_width": [6.0, 4.0],
    "courses": [3, 2],
    "above": [0.0, 2.0],
    "friction": [0.6, 0.5],
    "density": [2200.0, 1800.0],
    "depth": [1.5, 1.0],
}
PORTALS = {
    "even": on_piers(RING, 8.0, 5.0),
    "uneven under fill": on_piers(RING, **UNEVEN).filled(**FILL),
    **{
        name: on_piers(make(7), 6.0, 2.0, courses=2)
        for name, make in MAKERS.items()
        if name not in ("sector", "segmental")
    },
}
FLAT = MAKERS["segmental"](7)
REACH = abs(FLAT.extrados[0, 0] - FLAT.intrados[0, 0])
PORTALS["as wide as the skewback"] = on_piers(FLAT, 3.0, REACH, courses=2)


@pytest.mark.parametrize("arch", PORTALS.values(), ids=PORTALS.keys())
class TestPortals:
    def test_faces_of_a_joint_coincide_and_piers_have_level_joints(self, arch):
        chain, (first, last) = arch.chain, arch.springings
        assert arch.n_joint == arch.n_voussoir + 1 == len(arch.intrados)
        for joint in range(arch.n_joint):
            before = chain.face_before[joint] + (
                chain.centroid[joint - 1] if joint else 0.0
            )
            after = chain.face_after[joint] + (
                chain.centroid[joint] if joint < arch.n_voussoir else 0.0
            )
            ends = [arch.intrados[joint], arch.extrados[joint]]
            np.testing.assert_allclose(before, after, rtol=0, atol=1e-12)
            np.testing.assert_allclose(after, ends, rtol=0, atol=1e-12)
        level = arch.extrados[:, 1] - arch.intrados[:, 1]
        assert not np.concatenate([level[:first], level[last + 1 :]]).any()
        assert (arch.extrados[:first, 0] < arch.intrados[:first, 0]).all()
        assert (arch.extrados[last + 1 :, 0] > arch.intrados[last + 1 :, 0]).all()

    def test_its_drawing_is_the_same_arch(self, arch, tmp_path):
        """A drawing of straight blocks; of exact sectors only the polygons of their samples."""
        outlines = [outline.tolist() for outline in arch.outlines]
        ground = np.stack([arch.intrados, arch.extrados], axis=1)[[0, -1]].tolist()
        draw(tmp_path / "a.dxf", outlines[::-1], ground)
        (first, last), each = arch.springings, np.ones(arch.n_voussoir)
        density = 2000.0 * each
        depth = each
        ends = arch.parameters["ends"]
        ends = ends if isinstance(ends, list) else [ends] * 2
        for part, pier in zip((slice(0, first), slice(last, None)), ends):
            density[part] = pier["density"] or 2000.0
            depth[part] = pier["depth"] or 1.0
        matter = {"density": density.tolist(), "depth": depth.tolist()}
        again = af.Arch.from_dxf(tmp_path / "a.dxf", arch.chain.friction, **matter)
        np.testing.assert_allclose(again.intrados, arch.intrados, atol=1e-12)
        np.testing.assert_allclose(again.extrados, arch.extrados, atol=1e-12)
        if "fill" not in arch.parameters and not arch.parameters.get("sector"):
            for ours, theirs in zip(arch.chain[:7], again.chain[:7]):
                np.testing.assert_allclose(
                    theirs, ours, atol=1e-12 * np.abs(ours).max()
                )

    def test_parameters_as_json_and_an_entry_give_the_same(self, arch):
        given = json.loads(json.dumps(arch.parameters, allow_nan=False))
        entry = {key: value for key, value in given.items() if value is not None}
        again = ArchEntry.model_validate({"id": "a", **entry}).build()
        for ours, theirs in zip(arch.chain[:7], again.chain[:7]):
            np.testing.assert_array_equal(ours, theirs)


def test_dimensions_are_those_of_the_ring():
    assert on_piers(RING, **UNEVEN).dimensions == pytest.approx(
        RING.dimensions, rel=1e-12
    )


def test_recesses_come_after_piers_and_fill():
    one = on_piers(RING, **UNEVEN).filled(**FILL)
    recessed = one.recessed(intrados=0.1)
    np.testing.assert_allclose(recessed.intrados[0], one.intrados[0] - [0.1, 0.0])
    for call in (recessed.filled, lambda **_: on_piers(recessed, 5.0, 5.0)):
        with pytest.raises(GeometryError, match="already; Bridge"):
            call(**FILL)


@pytest.mark.parametrize("towards", [None, "+x", "-x"])
def test_thrust_line_stays_in_piers(towards):
    """Nearly along the weight of a body, its curve was far outside."""
    arch = on_piers(RING, 12.0, 6.0, courses=3)
    line = af.onset(arch).thrust_line(towards)
    assert line[:, 1].min() >= arch.intrados[:, 1].min() - 1e-9
    assert np.abs(line[:, 0]).max() <= np.abs(arch.extrados[:, 0]).max() + 1e-9


def test_values_of_each_body():
    arch = on_piers(RING, **UNEVEN)
    np.testing.assert_array_equal(
        arch.chain.friction, [0.6] * 3 + [0.7] * 7 + [0.5] * 2
    )
    even = on_piers(RING, **{**UNEVEN, "density": None, "depth": None})
    ratio = [2200.0 * 1.5 / 2000.0] * 3 + [1.0] * 6 + [0.9] * 2
    np.testing.assert_allclose(arch.chain.mass / even.chain.mass, ratio, rtol=1e-14)
    depth = np.linspace(1.0, 2.0, 6)
    ring = af.Arch.circular(
        10.75, 1.5, 120.0, 6, 0.7, depth=depth, density=1000.0 * depth
    )
    np.testing.assert_allclose(
        ring.chain.mass / RING.chain.mass, 0.5 * depth**2, rtol=1e-14
    )
    own = on_piers(ring, 5.0, 5.0).chain.mass / on_piers(RING, 5.0, 5.0).chain.mass
    np.testing.assert_allclose(own[[0, -1]], [0.5, 2.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: on_piers(RING, 0.0, 5.0), "ends[0].height = 0.0 is impossible"),
        (
            lambda: on_piers(RING, [5.0, -1.0], 5.0),
            "ends[1].height = -1.0 is impossible",
        ),
        (
            lambda: af.Bridge([RING], ends=[{}, {}, {}]),
            "ends must be one mapping, such as",
        ),
        (
            lambda: on_piers(RING, 5.0, 1.0),
            "width = 1 m of the left pier is impossible; the springing",
        ),
        (
            lambda: on_piers(RING, 5.0, [5.0, 1.0]),
            "of the right pier is impossible; the springing joints on it reach 1.29904 m",
        ),
        (
            lambda: on_piers(RING, 5.0, 5.0, courses=1.5),
            "ends[0].courses = 1.5 is impossible",
        ),
        (lambda: on_piers(RING, 5.0, 5.0, courses=1500), "the bridge has 3006 bodies"),
        (
            lambda: on_piers(MAKERS["horseshoe"](7), 1.0, 2.0, courses=4),
            "fewer courses or more",
        ),
        (
            lambda: on_piers(MAKERS["horseshoe"](7), 3.0, 2.0, above=1.0),
            "where a ring bulges",
        ),
        (
            lambda: on_piers(RING, 1.0, 5.0, base_width=0.1, above=20.0),
            "width = 5 m of the left pier is",
        ),
        (
            lambda: on_piers(af.Block(1.0, 2.0, 0.7), 5.0, 5.0),
            "an arch between two springings",
        ),
        (
            lambda: af.Block(1.0, 2.0, 0.7).filled(**FILL),
            "an arch between two springings",
        ),
        (
            lambda: af.Arch.from_joints(RING.extrados, RING.intrados, 0.7).filled(
                **FILL
            ),
            "its intrados below",
        ),
        (
            lambda: RING.filled(-0.1, 18e3),
            "fill.height_over_crown = -0.1 is impossible",
        ),
        (lambda: RING.filled(0.1, math.nan), "fill.unit_weight = nan is impossible"),
        (
            lambda: RING.filled(0.1, 18e3, inertia=0.5),
            "fill.inertia = 0.5 is impossible; it must",
        ),
        (
            lambda: RING.filled(0.1, 18e3, backing_height=2.0),
            "backing_unit_weight must be given",
        ),
        (
            lambda: RING.filled(
                0.5, 18e3, backing_height=9.0, backing_unit_weight=22e3
            ),
            "it must be at most 6.625 m",
        ),
        (
            lambda: af.Arch.circular(
                10.0,
                1.0,
                90.0,
                4,
                [0.7] * 8,
                ends=ends_of(height=5.0, width=3.0, courses=[1, 2], friction=0.5),
            ),
            "a pier has friction, and so has each joint",
        ),
        (
            lambda: af.Arch.circular(
                10.0, 1.0, 90.0, 4, 0.7, depth=[1.0, 0.0, 1.0, 1.0]
            ),
            "depth[1] = 0.0 is impossible",
        ),
        (
            lambda: af.Bridge([RING] * 31, piers={"height": 9.0, "width": 5.0}),
            "the bridge has 31 spans; it may have 30",
        ),
    ],
)
def test_refusals(make, part):
    with pytest.raises(GeometryError) as caught:
        make()
    assert part in str(caught.value)


def test_methods_agree_on_a_portal_under_fill():
    """A pulse in which it rocks by a third of a metre, and one in which it falls."""
    arch = on_piers(RING, 8.0, 5.0, courses=2).filled(**FILL)
    pulse = np.where(np.arange(300) < 100, 1.0, -0.5) * 9.80665
    for scale, verdict in ((0.4, "STANDING"), (1.0, "COLLAPSED")):
        runs = [
            af.simulate(arch, af.Motion(pulse, 0.005), scale, method=method)
            for method in ("time_stepping", "event_driven", "auto")
        ]
        assert {run.status.name for run in runs} == {verdict}
        if verdict == "STANDING":
            peaks = [run.peak_displacement for run in runs]
            np.testing.assert_allclose(peaks, 0.371, rtol=3e-3)


ENTRY = {
    "id": "bridge",
    "profile": "segmental",
    "span": 8.0,
    "rise": 2.0,
    "thickness": 0.6,
    "voussoirs": 7,
    "friction": 0.6,
    "dead_load": 1e3,
    "fill": FILL,
    "ends": {"height": 3.0, "width": 2.0, "courses": 2},
    "recess": {"intrados": 0.02},
}


def test_an_entry_with_all_of_them_varies():
    vary = {
        "samples": 2,
        "of": {
            "rise": {"distribution": "uniform", "start": 1.8, "stop": 2.2},
            "density": {"distribution": "uniform", "start": 1900.0, "stop": 2100.0},
        },
        "each_joint": {
            "friction": {"distribution": "uniform", "start": 0.9, "stop": 1.1},
            "recess_extrados": {"distribution": "uniform", "start": 0.0, "stop": 0.05},
        },
    }
    one, other = (
        member.entry.build()
        for member in expand([ArchEntry.model_validate({**ENTRY, "vary": vary})])
    )
    assert one.n_joint == other.n_joint == 12
    assert len(set(one.chain.friction)) == 12
    for each in (one, other):
        start = af.onset(each)
        assert start.stands
        level = each.parameters["rise"] + 0.3 + 0.5  # of the fill
        span = (
            each.extrados[each.springings[1], 0] - each.extrados[each.springings[0], 0]
        )
        assert each.chain.mass.sum() > 18e3 / 9.80665 * span * (
            level - each.parameters["rise"]
        )


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (
            {
                "vary": {
                    "samples": 2,
                    "each_joint": {
                        "position": {"distribution": "normal", "mean": 1.0, "sd": 0.1}
                    },
                }
            },
            "with piers",
        ),
        (
            {
                "friction": [0.6] * 8,
                "vary": {
                    "samples": 2,
                    "each_joint": {
                        "friction": {
                            "distribution": "uniform",
                            "start": 0.9,
                            "stop": 1.1,
                        }
                    },
                },
            },
            "unless all joints share",
        ),
        ({"fill": {**FILL, "cohesion": 1.0}}, "is not a known key"),
        ({"ends": {"height": 3.0}}, "must be given"),
    ],
)
def test_entries_that_cannot_be(change, part):
    with pytest.raises((ValidationError, InputError), match=part):
        ArchEntry.model_validate({**ENTRY, **change}).build()
