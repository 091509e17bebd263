"""All arches of a study: samples of one that is not known exactly, and rows of tables."""

import numpy as np
import pytest
from pydantic import ValidationError

import archfrag as af
from archfrag.api.studies import _arches
from archfrag.errors import InputError, StabilityError
from archfrag.simulation.simulate import onset
from archfrag.study.answer.cube import _arch_variables
from archfrag.study.file.arches import ArchEntry, JointEntry
from archfrag.study.file.members import check_buildable, check_standing, expand
from archfrag.study.file.schema import Method
from archfrag.study.keys import at

SHARED = {"profile": "circular", "embrace": 157.5, "voussoirs": 7, "friction": 0.7}
RING = {"id": "ring", "radius": 10.0, "thickness": 1.5, **SHARED}
BLOCK = {"profile": "block", "width": 0.4, "height": 2.0}
COLUMN = {
    "profile": "from_joints",
    "free_end": True,
    "intrados": [[0, 0], [0, 1], [0, 2]],
    "extrados": [[0.5, 0], [0.5, 1], [0.5, 2]],
}
NO_RING = dict.fromkeys(("radius", "thickness", "embrace", "voussoirs"))


def drawn(vary, count=4, **changed):
    """All arches of an entry, with what was drawn for them."""
    given = {**RING, **changed, "vary": {"samples": count, **vary}}
    given = {key: value for key, value in given.items() if value is not None}
    members = expand([ArchEntry.model_validate(given)])
    check_buildable(members)
    return members


def entries(members):
    return [member.entry for member in members]


def uniform(start, stop):
    return {"distribution": "uniform", "start": start, "stop": stop}


def normal(mean, cov, **more):
    return {"distribution": "normal", "mean": mean, "cov": cov, **more}


class TestVary:
    def test_arches_have_what_was_drawn_and_else_what_the_entry_states(self):
        for number, member in enumerate(
            drawn({"of": {"friction": uniform(0.6, 0.8)}}), start=1
        ):
            arch = member.entry
            assert (arch.id, arch.vary) == (f"ring-{number:04d}", None)
            assert member.values == {"friction": arch.friction}
            assert 0.6 < arch.friction < 0.8
            assert (arch.radius, arch.thickness, arch.density) == (10.0, 1.5, 2000.0)
            assert arch.build().n_voussoir == 7

    def test_relative_values_multiply_a_number_or_a_list(self):
        for member in drawn(
            {"of": {"thickness": normal(1.0, 0.05, relative=True)}}, 64
        ):
            assert member.values == {"thickness": member.entry.thickness}
            assert abs(member.entry.thickness - 1.5) < 0.3
        own = [0.5, 0.6, 0.7, 0.8, 0.7, 0.6, 0.5, 0.4]
        for member in drawn(
            {"of": {"friction": normal(1.0, 0.1, relative=True)}}, friction=own
        ):
            factor = member.values["friction_factor"]
            np.testing.assert_allclose(member.entry.friction, factor * np.array(own))

    def test_joints_in_degrees_go_with_the_angle_of_embrace(self):
        joints = [0.0, 20.0, 40.0, 60.0, 90.0, 120.0, 140.0, 157.5]
        for arch in entries(
            drawn({"of": {"embrace": normal(150.0, 0.02)}}, joint_positions=joints)
        ):
            own = np.array(arch.joint_positions) / arch.embrace
            np.testing.assert_allclose(own, np.array(joints) / 157.5, rtol=1e-9)

    def test_each_joint_has_its_own(self):
        vary = {"recess_intrados": uniform(0.0, 0.05), "friction": normal(1.0, 0.1)}
        found = drawn({"each_joint": vary}, 256)
        assert next(iter(found)).values == {}
        friction = np.array([arch.friction for arch in entries(found)]) / 0.7
        depth = np.array([arch.recess.intrados for arch in entries(found)])
        assert friction.shape == depth.shape == (256, 8)
        assert friction.mean() == pytest.approx(1.0, abs=0.01)
        assert friction.std() == pytest.approx(0.1, rel=0.05)
        assert (depth.mean(), depth.max()) == pytest.approx((0.025, 0.05), rel=0.03)
        # Of 56 correlations with a deviation of 1/16 each.
        pairs = np.corrcoef(np.hstack([friction, depth]).T) - np.eye(16)
        assert np.abs(pairs).max() < 0.28
        assert entries(found)[0].recess.extrados == 0.0
        for given, count in (
            (BLOCK, 1),
            (COLUMN, 2),
        ):  # a block has one, a column no free end
            own = drawn(
                {"each_joint": {"friction": vary["friction"]}}, **NO_RING | given
            )
            assert {len(arch.friction) for arch in entries(own)} == {count}

    @pytest.mark.parametrize(
        ("end", "profile"),
        [
            (157.5, {}),
            (
                1.0,
                {
                    "profile": "segmental",
                    "span": 10.0,
                    "rise": 3.0,
                    "radius": None,
                    "embrace": None,
                },
            ),
        ],
    )
    def test_the_springings_stay_where_they_are(self, end, profile):
        found = entries(
            drawn({"each_joint": {"position": uniform(-0.2, 0.2)}}, 16, **profile)
        )
        joints = np.array([arch.joint_positions for arch in found])
        assert np.all(joints[:, [0, -1]] == [0.0, end])
        assert 0.15 < np.abs(joints / end * 7.0 - np.arange(8)).max() < 0.2

    def test_arches_that_do_not_stand_are_refused_in_one_message(self):
        found = drawn({"of": {"thickness": uniform(0.4, 0.9)}}, 8)
        thin = [member for member in found if not onset(member.entry.build()).stands]
        assert 1 < len(thin) < 8
        with pytest.raises(StabilityError) as refusal:
            check_standing(found, Method())
        value = thin[0].values["thickness"]
        assert f"(thickness = {value:.6g}): does not stand" in str(refusal.value)


TABLE = """\
# From a survey.
id,radius,thickness,friction,region,built
old,10.0,1.5,0.6,north,1880
wide,12,1.8,,south,1901

late,8.0,1.25,inf,north,
"""


def variables(members):
    """Variables that a cube has of members."""
    return _arch_variables(members, [member.entry.build() for member in members])


def fleet(folder, text=TABLE, **changed):
    path = folder / "fleet.csv"
    path.write_text(text, encoding="utf-8", newline="")
    return ArchEntry.model_validate(
        {"id": "fleet", **SHARED, "table": str(path), **changed}
    )


def test_a_key_beside_of_is_said_to_belong_there():
    vary = {"samples": 2, "friction": uniform(0.6, 0.8)}
    message = (
        r"vary.friction is not a known key; allowed are samples, .*, of, each_joint"
    )
    with (
        pytest.raises(InputError, match=message),
        at("arch", given := {**RING, "vary": vary}),
    ):
        ArchEntry.model_validate(given)
    assert drawn({"of": {"friction": uniform(0.6, 0.8)}}, 2)


def test_a_row_named_as_its_class_is_refused(tmp_path):
    with pytest.raises(InputError, match="the id 'fleet' already belongs to"):
        expand([fleet(tmp_path, TABLE.replace("wide", "fleet"))])


@pytest.mark.parametrize(
    ("key", "values", "law"),
    [
        ("joints.stiffness", {"stiffness": [2e10] * 8}, uniform(1e10, 2e10)),
        ("friction", [0.7] * 8, normal(0.7, 0.1)),
        ("density", [2000.0] * 7, normal(2000.0, 0.1)),
        ("depth", [1.0] * 7, uniform(0.9, 1.1)),
        ("dead_load", [0.0] * 7, uniform(0.0, 10.0)),
    ],
)
def test_a_distribution_replaces_no_list(key, values, law):
    with pytest.raises(
        ValueError, match=rf"would replace the list {key}; give factors on it"
    ):
        drawn({"of": {key: law}}, 2, **{key.partition(".")[0]: values})
    factor = {"distribution": "uniform", "start": 0.9, "stop": 1.1, "relative": True}
    assert len(drawn({"of": {key: factor}}, 2, **{key.partition(".")[0]: values})) == 2


SOFT = {"stiffness": 2e10, "shear": 1e10, "damping": 0.1, "model": "face", "points": 3}


def lognormal(median, beta, **more):
    return {"distribution": "lognormal", "median": median, "beta": beta, **more}


class TestJointsThatGive:
    @pytest.mark.parametrize(
        "given", [NO_RING | BLOCK, NO_RING | COLUMN, {"profile": "circular"}], ids=str
    )
    def test_a_block_of_keys_is_what_python_makes_of_them(self, given):
        entry = {**RING, **given, "joints": SOFT}
        entry = {key: value for key, value in entry.items() if value is not None}
        rigid = ArchEntry.model_validate({**entry, "joints": None}).build()
        built = ArchEntry.model_validate(entry).build()
        np.testing.assert_array_equal(
            built.chain.joint, af.jointed(rigid, **SOFT).chain.joint
        )
        assert built.parameters["joints"] == SOFT
        # What Python has is again what a study takes.
        known = {
            key: each for key, each in built.parameters.items() if each is not None
        }
        assert (
            ArchEntry.model_validate({**known, "id": "again"})
            .build()
            .parameters["joints"]
            == SOFT
        )

    def test_positions_recess_and_strength_go_with_it(self):
        at = [0.0, 20.0, 40.0, 60.0, 90.0, 120.0, 140.0, 157.5]
        keys = {
            **RING,
            "joint_positions": at,
            "joints": {"stiffness": [*[2e10] * 7, "inf"]},
            "recess": {"intrados": 0.02},
            "strength": 4e6,
        }
        soft = ArchEntry.model_validate(keys).build()
        ring = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7, joint_positions=at).recessed(
            0.02
        )
        expected = af.jointed(ring, [*[2e10] * 7, np.inf], strength=4e6)
        np.testing.assert_array_equal(soft.chain.face_after, expected.chain.face_after)
        assert soft.parameters == {
            **expected.parameters,
            "recess": {"intrados": 0.02, "extrados": 0.0},
        }

    @pytest.mark.parametrize("stiffness", ["inf", np.inf, ["inf"] * 8])
    def test_infinite_stiffness_is_the_rigid_arch(self, stiffness):
        rigid = ArchEntry.model_validate(RING).build()
        same = ArchEntry.model_validate(
            {**RING, "joints": {"stiffness": stiffness}}
        ).build()
        assert same.parameters == rigid.parameters
        for name, value in rigid.chain._asdict().items():
            np.testing.assert_array_equal(getattr(same.chain, name), value)

    @pytest.mark.parametrize("joints", [None, SOFT, {"model": "face", "damping": 0.1}])
    def test_stiffness_varies_and_other_keys_stay(self, joints):
        law = {"of": {"joints.stiffness": lognormal(3e10, 1.0)}}
        found = drawn(law, 64, joints=joints)
        stiffness = [member.entry.joints.stiffness for member in found]
        assert stiffness == [member.values["joints.stiffness"] for member in found]
        assert np.log(stiffness).mean() == pytest.approx(np.log(3e10), abs=0.05)
        assert np.log(stiffness).std() == pytest.approx(1.0, rel=0.05)
        keys = joints or {}
        for entry in entries(found):
            expected = JointEntry(**{**keys, "stiffness": entry.joints.stiffness})
            assert entry.joints == expected
        shift = [
            np.linalg.norm(e.build().chain.face_after[0, 0]) for e in entries(found)
        ]
        assert (len(set(shift)) == 64) == ("model" not in keys)

    def test_relative_values_multiply_one_or_each(self):
        law = {"of": {"joints.stiffness": lognormal(1.0, 0.5, relative=True)}}
        for member in drawn(law, joints={"stiffness": 2e10, "shear": 1e10}):
            assert member.values == {"joints.stiffness": member.entry.joints.stiffness}
            assert member.entry.joints.shear == 1e10
        own = np.linspace(1e10, 2e10, 8)
        for member in drawn(law, joints={"stiffness": own.tolist()}):
            factor = member.values["joints.stiffness_factor"]
            np.testing.assert_allclose(member.entry.joints.stiffness, factor * own)

    def test_with_scatter_of_positions_and_an_angle_that_varies(self):
        vary = {
            "of": {"embrace": normal(150.0, 0.02)},
            "each_joint": {"position": uniform(-0.1, 0.1)},
        }
        plain = drawn(vary)
        soft = drawn(vary, joints={"stiffness": 2e10})
        for one, other in zip(entries(plain), entries(soft), strict=True):
            assert other.joint_positions == one.joint_positions
            assert other.joints.stiffness == 2e10

    def test_a_column_of_a_table_is_the_stiffness(self, tmp_path):
        table = "id,radius,thickness,joints.stiffness\na,10,1.5,2e10\nb,10,1.5,\nc,10,1.5,inf\n"
        found = expand(
            [fleet(tmp_path, table, joints={"stiffness": 1e10, "damping": 0.2})]
        )
        assert [member.entry.joints.stiffness for member in found] == [
            2e10,
            1e10,
            np.inf,
        ]
        assert [member.values["joints.stiffness"] for member in found] == [
            2e10,
            1e10,
            np.inf,
        ]
        assert {member.entry.joints.damping for member in found} == {0.2}

    def test_a_study_of_python_keeps_scatter_and_stiffness_apart(self):
        scatter = {"friction": normal(1.0, 0.1)}
        law = lognormal(3e10, 1.0)
        vary = {"samples": 4, "each_joint": scatter, "joints.stiffness": law}
        (entry,) = _arches(af.jointed(af.Block(1.0, 2.0, 0.8), 1e10), "b", vary)
        assert entry["vary"]["each_joint"] == scatter
        assert entry["vary"]["of"] == {"joints.stiffness": law}
        assert entry["joints"]["stiffness"] == 1e10
        ArchEntry.model_validate(entry)

    def test_a_sample_that_does_not_stand_is_named(self):
        with pytest.raises(
            StabilityError,
            match=r"^arches\[0\] \(ring\): sample 1 \(joints.stiffness = ",
        ):
            drawn({"of": {"joints.stiffness": lognormal(2e6, 0.1)}})


class TestTables:
    def test_cells_are_keys_and_the_entry_fills_the_others(self, tmp_path):
        entry = fleet(tmp_path)
        found = expand([entry])
        assert [member.id for member in found] == ["old", "wide", "late"]
        assert {member.arch_class for member in found} == {"fleet"}
        assert [arch.friction for arch in entries(found)] == [0.6, 0.7, np.inf]
        assert [arch.radius for arch in entries(found)] == [10.0, 12.0, 8.0]
        assert {(arch.embrace, arch.voussoirs) for arch in entries(found)} == {
            (157.5, 7)
        }
        assert [member.attributes["built"] for member in found] == ["1880", "1901", ""]
        fleet(tmp_path, TABLE.replace("old,10.0", "old,10.25"))  # which is read again
        assert entries(expand([entry]))[0].radius == 10.25

    def test_rows_may_be_a_sample_of_a_stock(self, tmp_path):
        vary = {"samples": 2, "of": {"thickness": normal(1.0, 0.05, relative=True)}}
        found = expand([fleet(tmp_path, rows="sample", vary=vary)])
        rows = [name for name in ("old", "wide", "late") for _ in range(2)]
        assert [member.row for member in found] == rows
        assert variables(found)["stock_row"].values.tolist() == rows
        exactly = expand([fleet(tmp_path, rows="all")])
        assert {member.row for member in exactly} == {""}
        assert "stock_row" not in variables(exactly)
        with pytest.raises(ValidationError, match="not a known key"):
            ArchEntry.model_validate({"id": "a", "profile": "block", "rows": "sample"})

    def test_lists_and_a_spreadsheets_full_numbers(self, tmp_path):
        text = '\ufeffid,radius,thickness,voussoirs,friction\r\na,10,1.5,2.0,"[0.5, 0.6, 0.7]"\r\n'
        (arch,) = entries(expand([fleet(tmp_path, text)]))
        assert (arch.voussoirs, arch.friction) == (2, [0.5, 0.6, 0.7])

    @pytest.mark.parametrize("sign", [";", "\t"])
    def test_any_separator_of_cells(self, tmp_path, sign):
        found = expand([fleet(tmp_path, TABLE.replace(",", sign))])
        assert [arch.radius for arch in entries(found)] == [10.0, 12.0, 8.0]

    def test_rows_may_vary_each_on_its_own(self, tmp_path):
        vary = {"samples": 4, "of": {"thickness": normal(1.0, 0.05, relative=True)}}
        found = expand([fleet(tmp_path, vary=vary)])
        assert len(found) == 12
        assert [member.id for member in found][:2] == ["old-0001", "old-0002"]
        thickness = np.array([arch.thickness for arch in entries(found)])
        np.testing.assert_array_equal(
            thickness, [member.values["thickness"] for member in found]
        )
        factors = thickness.reshape(3, 4) / [[1.5], [1.8], [1.25]]
        assert np.abs(factors[0] - factors[1]).min() > 1e-6
        alone = "".join(
            TABLE.splitlines(True)[i] for i in (1, 3)
        )  # whatever other rows there are
        found = expand([fleet(tmp_path, alone, vary=vary)])
        assert [arch.thickness for arch in entries(found)] == thickness[4:8].tolist()

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("12,1.8", "12,1.8m", ", arch wide: thickness = '1.8m' must be"),
            ("8.0,1.25", "8.0,", ", arch late: thickness must be given"),
            ("late,8.0", "old,8.0", ": several arches have the id 'old'"),
            (
                ",south,1901",
                ",south,1901,x",
                ": line 4 has 7 cells, the other rows have 6",
            ),
            (
                "region",
                "Thicknes",
                ": column Thicknes is not a key of an arch; did you mean",
            ),
            (
                ",region",
                ",radius",
                ": line 2: column 'radius' is there twice; give each column",
            ),
            (
                "south,1901",
                "1901",
                ": line 4 has 5 of 6 cells, commas between: 'wide, 12, 1.8",
            ),
            (
                TABLE,
                'id,radius\na,"10,5"\n',
                ": line 2: '10,5' has a comma within a number; write",
            ),
            ("0.6,north", '"[0.6, x]",north', ", arch old: friction[1] = 'x' must be"),
            (
                "0.6,north",
                '"[0.6",north',
                ", column friction: line 1: expected ',' or ']'",
            ),
            (
                "id,radius",
                "id,span",
                ", arch old: span is not a known key; did you mean spans?",
            ),
        ],
    )
    def test_a_bad_table_is_one_message(self, tmp_path, old, new, message):
        with pytest.raises(InputError, match=r"^[^\n]*$") as refusal:
            expand([fleet(tmp_path, TABLE.replace(old, new, 1))])
        assert str(refusal.value).startswith(
            f"arches[0] (fleet): {tmp_path / 'fleet.csv'}{message}"
        )
