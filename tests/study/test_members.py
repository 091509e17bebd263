"""All arches of a study: samples of one that is not known exactly, and rows of tables."""

import numpy as np
import pytest
import yaml

from archfrag.errors import StabilityError, StudyError
from archfrag.simulate import onset
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import check_buildable, check_standing, expand
from archfrag.study.file.schema import load_study
from tests.study.small import TEXT, small_study

RING = {
    "id": "ring", "profile": "circular", "radius": 10.0, "thickness": 1.5, "embrace": 157.5,
    "voussoirs": 7, "friction": 0.7,
}  # fmt: skip
FRICTION = {"friction": {"distribution": "uniform", "start": 0.6, "stop": 0.8}}


def drawn(vary, count=4, **changed):
    """Each arch that is drawn, and what was drawn for it."""
    given = {**RING, **changed, "vary": {"samples": count, **vary}}
    given = {key: value for key, value in given.items() if value is not None}
    members = expand([ArchEntry.model_validate(given)])
    check_buildable(members)
    return [(member.entry, member.values) for member in members]


def normal(mean, cov, **more):
    return {"distribution": "normal", "mean": mean, "cov": cov, **more}


class TestKeys:
    def test_arches_have_what_was_drawn_and_else_what_the_entry_states(self):
        for number, (arch, values) in enumerate(drawn({"of": FRICTION}), start=1):
            assert arch.id == f"ring-{number:04d}"
            assert arch.vary is None
            assert values == {"friction": arch.friction}
            assert 0.6 < arch.friction < 0.8
            assert (arch.radius, arch.thickness, arch.density) == (10.0, 1.5, 2000.0)
            assert arch.build().n_voussoir == 7

    def test_relative_values_multiply_a_number_or_a_list(self):
        vary = {"of": {"thickness": normal(1.0, 0.05, relative=True)}}
        for arch, values in drawn(vary, 64):
            assert values == {"thickness": arch.thickness}
            assert abs(arch.thickness - 1.5) < 0.3
        own = [0.5, 0.6, 0.7, 0.8, 0.7, 0.6, 0.5, 0.4]
        vary = {"of": {"friction": normal(1.0, 0.1, relative=True)}}
        for arch, values in drawn(vary, friction=own):
            np.testing.assert_allclose(arch.friction, values["friction_factor"] * np.array(own))

    def test_joints_in_degrees_go_with_the_angle_of_embrace(self):
        joints = [0.0, 20.0, 40.0, 60.0, 90.0, 120.0, 140.0, 157.5]
        vary = {"of": {"embrace": normal(150.0, 0.02)}}
        for arch, _ in drawn(vary, joints=joints):
            np.testing.assert_allclose(np.array(arch.joints) / arch.embrace,
                                       np.array(joints) / 157.5, rtol=1e-9)  # fmt: skip
            assert arch.build()


class TestJoints:
    def test_each_joint_has_its_own(self):
        recess = {"distribution": "uniform", "start": 0.0, "stop": 0.05}
        vary = {"joints": {"recess_intrados": recess, "friction": normal(1.0, 0.1)}}
        found = drawn(vary, 256)
        assert found[0][1] == {}
        friction = np.array([arch.friction for arch, _ in found]) / 0.7
        depth = np.array([arch.recess.intrados for arch, _ in found])
        assert friction.shape == depth.shape == (256, 8)
        assert friction.mean() == pytest.approx(1.0, abs=0.01)
        assert friction.std() == pytest.approx(0.1, rel=0.05)
        assert (depth.mean(), depth.max()) == pytest.approx((0.025, 0.05), rel=0.03)
        # Of 56 correlations with a deviation of 1/16 each.
        pairs = np.corrcoef(np.hstack([friction, depth]).T) - np.eye(16)
        assert np.abs(pairs).max() < 0.28
        assert found[0][0].recess.extrados == 0.0

    @pytest.mark.parametrize("profile", ["circular", "segmental"])
    def test_the_springings_stay_where_they_are(self, profile):
        vary = {"joints": {"position": {"distribution": "uniform", "start": -0.2, "stop": 0.2}}}
        end, keys = 157.5, {}
        if profile == "segmental":
            end, keys = 1.0, {"span": 10.0, "rise": 3.0, "radius": None, "embrace": None}
        found = drawn(vary, 16, profile=profile, **keys)
        joints = np.array([arch.joints for arch, _ in found])
        assert np.all(joints[:, [0, -1]] == [0.0, end])
        off = joints / end * 7.0 - np.arange(8)
        assert 0.15 < np.abs(off).max() < 0.2

    def test_a_block_has_one_and_a_column_no_free_end(self):
        vary = {"joints": {"friction": normal(1.0, 0.1)}}
        ring = dict.fromkeys(("radius", "thickness", "embrace", "voussoirs"))
        sides = {side: [[x, 0.0], [x, 1.0], [x, 2.0]]
                 for side, x in (("intrados", 0.0), ("extrados", 0.5))}  # fmt: skip
        block = {"profile": "block", "width": 0.4, "height": 2.0}
        column = {"profile": "from_joints", "free_end": True, **sides}
        for given, count in ((block, 1), (column, 2)):
            assert all(len(arch.friction) == count for arch, _ in drawn(vary, 2, **ring, **given))


class TestRefusals:
    """In one message: where, what was drawn, how many."""

    def refused(self, folder, vary):
        first, rest = TEXT.split("  - {id: ring")[0], TEXT.split("motions:")[1]
        text = first + yaml.safe_dump([{**RING, "vary": vary}]) + "motions:" + rest
        with pytest.raises(StudyError) as refusal:
            load_study(small_study(folder, text))
        return str(refusal.value).removeprefix(f"{folder / 'small.yaml'}: ")

    @pytest.mark.parametrize(
        ("vary", "message"),
        [
            ({"samples": 12, "of": FRICTION}, ".samples = 12 must be a power of two"),
            ({}, "must have a key of or joints"),
            ({"of": {"frictions": FRICTION["friction"]}},
             "sample 1 (frictions = 0.657234): frictions is not a known key; did"),
            ({"of": {"friction": {"distribution": "normal", "cov": 0.1}}}, "n.mean must be given"),
            ({"of": {"friction": {**FRICTION["friction"], "mean": 1.0}}},
             ".of.friction.mean is not a known key; allowed are distribution, start, stop"),
            ({"of": {"friction": normal(0.7, 0.1, sd=0.1)}}, "one of cov and sd"),
            ({"of": {"friction": normal(0.7, 0.1, lower=0.9, upper=0.8)}}, "is cut too far"),
            ({"of": {"dead_load": normal(1.0, 0.1, relative=True)}},
             ".of.dead_load.relative needs a key dead_load of the arch, which it"),
            ({"of": FRICTION, "correlation": {"friction": {"density": 0.5}}},
             ".correlation is not possible: correlation of friction and density = 0.5 must be"),
            ({"joints": {"friction": normal(1.0, 0.1, relative=True)}},
             ".joints.friction.relative cannot be used for joints"),
        ],
        ids=range(10),
    )  # fmt: skip
    def test_keys(self, tmp_path, vary, message):
        assert message in self.refused(tmp_path, {"samples": 4, **vary})

    def test_an_arch_that_cannot_exist_or_has_a_value_that_its_key_does_not_allow(self, tmp_path):
        found = self.refused(tmp_path, {"samples": 8, "of": {"thickness": normal(1.5, 1.0)}})
        assert " of 8 samples, the first is sample " in found
        assert found.count("thickness = -") == 2  # what was drawn, and why it is none
        found = self.refused(tmp_path, {"samples": 2, "of": {"density": normal(2e6, 0.01)}})
        assert found.startswith("arches[0] (ring): sample 1 (density = ")
        assert found.endswith("must be less than or equal to 1000000")

    def test_arches_that_do_not_stand(self):
        vary = {"of": {"thickness": {"distribution": "uniform", "start": 0.4, "stop": 0.9}}}
        given = {**RING, "vary": {**vary, "samples": 8}}
        found = expand([ArchEntry.model_validate(given)])
        thin = [member for member in found if not onset(member.entry.build()).stands]
        assert 1 < len(thin) < 8
        assert max(m.values["thickness"] for m in thin) < 0.75
        with pytest.raises(StabilityError) as refusal:
            check_standing(found)
        first = f"sample {thin[0].number} (thickness = {thin[0].values['thickness']:.6g})"
        assert str(refusal.value).startswith(
            f"arches[0] (ring): {len(thin)} of 8 samples, the first is {first}: does not stand"
        )


DEFAULTS = {
    "id": "fleet", "profile": "circular", "embrace": 157.5, "voussoirs": 7, "friction": 0.7,
}  # fmt: skip
TABLE = """\
# From a survey.
id,radius,thickness,friction,region,built
old,10.0,1.5,0.6,north,1880
wide,12,1.8,,south,1901

late,8.0,1.25,inf,north,
"""


def fleet(folder, text=TABLE, **changed):
    path = folder / "fleet.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ArchEntry.model_validate({**DEFAULTS, "table": str(path), **changed})


class TestTables:
    def test_cells_are_keys_and_the_entry_fills_the_others(self, tmp_path):
        entry = fleet(tmp_path)
        found = expand([entry])
        assert found.ids == ["old", "wide", "late"]
        assert found.classes == ["fleet"] * 3
        assert [arch.friction for arch in found.entries] == [0.6, 0.7, np.inf]
        assert [arch.radius for arch in found.entries] == [10.0, 12.0, 8.0]
        assert {(arch.embrace, arch.voussoirs) for arch in found.entries} == {(157.5, 7)}
        assert found.attributes()["built"] == ["1880", "1901", ""]
        fleet(tmp_path, TABLE.replace("old,10.0", "old,10.25"))  # which is read again
        assert expand([entry]).entries[0].radius == 10.25

    def test_lists_and_a_spreadsheets_full_numbers(self, tmp_path):
        text = '\ufeffid,radius,thickness,voussoirs,friction\r\na,10,1.5,2.0,"[0.5, 0.6, 0.7]"\r\n'
        (arch,) = expand([fleet(tmp_path, text)]).entries
        assert (arch.voussoirs, arch.friction) == (2, [0.5, 0.6, 0.7])

    def test_rows_may_vary_each_on_its_own(self, tmp_path):
        normal = {"distribution": "normal", "mean": 1.0, "cov": 0.05, "relative": True}
        vary = {"samples": 4, "of": {"thickness": normal}}
        found = expand([fleet(tmp_path, vary=vary)])
        assert len(found) == 12
        assert found.ids[:2] == ["old-0001", "old-0002"]
        thickness = np.array([arch.thickness for arch in found.entries])
        np.testing.assert_array_equal(thickness, found.parameters()["thickness"])
        factors = thickness.reshape(3, 4) / [[1.5], [1.8], [1.25]]
        assert np.abs(factors[0] - factors[1]).min() > 1e-6
        alone = "".join(TABLE.splitlines(True)[i] for i in (1, 3))  # whatever other rows there are
        found = expand([fleet(tmp_path, alone, vary=vary)])
        assert [arch.thickness for arch in found.entries] == thickness[4:8].tolist()

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("12,1.8", "12,1.8m", ", arch wide: thickness = '1.8m' must be"),
            ("8.0,1.25", "8.0,", ", arch late: thickness must be given"),
            ("late,8.0", "old,8.0", ": several arches have the id 'old'"),
            ("late,8.0", "l te,8.0", ", arch l te: id = l te must begin with"),
            (",south,1901", ",south,1901,x", ": is not a table in CSV (Error tokenizing data"),
            ("region", "Thicknes", ": column Thicknes is not a key of an arch; did you mean"),
            (TABLE, TABLE.replace(",", ";"), ": must have arches and a column id; commas"),
            ("0.6,north", '"[0.6, x]",north', ", arch old: friction[1] = 'x' must be"),
            ("0.6,north", '"[0.6",north', ", column friction: line 1: expected ',' or ']'"),
            ("id,radius", "id,span", ", arch old: span is not a known key; allowed are "),
        ],
    )
    def test_a_bad_table_is_one_message(self, tmp_path, old, new, message):
        with pytest.raises(StudyError) as refusal:
            expand([fleet(tmp_path, TABLE.replace(old, new, 1))])
        assert str(refusal.value).startswith(
            f"arches[0] (fleet): {tmp_path / 'fleet.csv'}{message}"
        )
        assert "\n" not in str(refusal.value)
