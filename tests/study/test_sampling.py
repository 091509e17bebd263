"""Entries whose arches are drawn, tables of arches, and what a study amounts to with them."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from archfrag.cli import main
from archfrag.errors import StabilityError, StudyError
from archfrag.study.checks import check_arches, check_study
from archfrag.study.config import dump_study, load_study
from archfrag.study.members import members
from archfrag.study.single import arch_of_study
from tests.study.small import TEXT, small_study

VARY = """\
friction: 0.7,
     vary: {samples: 8, of: {thickness: {distribution: normal, mean: 1.5, cov: 0.05},
       friction: {distribution: lognormal, median: 0.7, beta: 0.1, upper: 1.0}}}}
"""
VARIED = TEXT.replace("friction: 0.7}\n", VARY)
TABLE = "  - {id: fleet, table: fleet.csv, profile: segmental, friction: 0.7, thickness: 0.6}\n"
LISTED = TEXT.replace("  - {id: slab", f"{TABLE}  - {{id: slab")
CSV = """\
id,span,rise,voussoirs,thickness,region,year
north,8.0,2.0,9,,Umbria,1870
south,6,1.5,7.0,0.7,"Marche, inland",
"""


def study_of(folder, text, *overrides, table=CSV):
    path = small_study(folder, text)
    (folder / "fleet.csv").write_text(table, encoding="utf-8")
    return load_study(path, overrides)


def refused(folder, text, *overrides, table=CSV):
    with pytest.raises(StudyError) as caught:
        study_of(folder, text, *overrides, table=table)
    return str(caught.value).replace(f"{folder}/", "")


def varied(key, value):
    return f"arches.0.vary.{key}={value}"


class TestDrawnArches:
    def test_samples_stand_in_the_place_of_the_entry(self, tmp_path):
        found = members(study_of(tmp_path, VARIED))
        assert found.ids == [*(f"ring-{i:04d}" for i in range(1, 9)), "slab"]
        assert found.classes == ["ring"] * 8 + ["slab"]
        assert found.of_class() == {"ring": list(range(8)), "slab": [8]}
        values = found.parameters()
        assert list(values) == ["thickness", "friction"]
        for i, entry in enumerate(found.entries[:8]):
            assert entry.vary is None
            built = entry.build()
            assert built.parameters["thickness"] == values["thickness"][i]
            assert np.all(built.chain.friction == values["friction"][i])
        assert np.isnan(values["friction"][8])
        assert values["friction"][:8].max() <= 1.0
        assert len(set(values["thickness"][:8])) == 8
        assert found.meets(3).all()

    def test_the_same_file_gives_the_same_arches_and_so_does_the_resolved_one(self, tmp_path):
        study = study_of(tmp_path, VARIED)
        (tmp_path / "resolved.yaml").write_text(dump_study(study))
        again = load_study(tmp_path / "resolved.yaml")
        assert again == study
        assert members(again) == members(study)
        other = members(study_of(tmp_path, VARIED, varied("seed", 2)))
        assert other.ids == members(study).ids
        assert other.entries[0] != members(study).entries[0]

    def test_more_samples_keep_those_that_were_there(self, tmp_path):
        joints = "arches.0.vary.joints={friction: {distribution: lognormal, median: 1, beta: 0.1}}"
        eight = members(study_of(tmp_path, VARIED, joints)).entries[:8]
        more = members(study_of(tmp_path, VARIED, joints, varied("samples", 16))).entries[:8]
        assert eight == more

    def test_each_record_meets_its_own(self, tmp_path):
        study = study_of(tmp_path, VARIED, varied("crossed", "false"), varied("samples", 3))
        with pytest.raises(StudyError, match="the number of records is not known"):
            members(study)
        two, three = members(study, 2), members(study, 3)
        assert len(two) == 2 * 3 + 1
        np.testing.assert_array_equal(
            two.meets(2), [*[[True, False]] * 3, *[[False, True]] * 3, [True, True]]
        )
        assert two.entries[:6] == three.entries[:6]
        assert [m.record for m in three][:9] == [0, 0, 0, 1, 1, 1, 2, 2, 2]

    def test_relative_values_are_factors_on_lists_too(self, tmp_path):
        each = "[0.5, 0.6, 0.7, 0.7, 0.7, 0.7, 0.6, 0.5]"
        study = study_of(
            tmp_path, VARIED, f"arches.0.friction={each}",
            varied("of", "{friction: {distribution: uniform, start: 0.9, stop: 1.1, "
                         "relative: true}}"),
        )  # fmt: skip
        found = members(study)
        factor = found.parameters()["friction"][0]
        assert 0.9 <= factor <= 1.1
        np.testing.assert_allclose(
            found.entries[0].build().chain.friction, factor * np.array(json.loads(each)), rtol=1e-9
        )

    def test_correlated_if_said(self, tmp_path):
        study = study_of(
            tmp_path, VARIED, varied("samples", 512),
            varied("correlation", "{thickness: {friction: 0.8}}"),
        )  # fmt: skip
        values = members(study).parameters()
        logs = np.log(values["friction"][:512])
        found = np.corrcoef(values["thickness"][:512], logs)[0, 1]
        assert found == pytest.approx(0.8, abs=0.03)


class TestJointsOfOneArch:
    def scattered(self, tmp_path, joints, *overrides):
        text = VARIED.replace("samples: 8,", f"samples: 8, joints: {{{joints}}},")
        return members(study_of(tmp_path, text, *overrides))

    def test_each_joint_is_recessed_by_itself(self, tmp_path):
        found = self.scattered(
            tmp_path, "recess_intrados: {distribution: uniform, start: 0.0, stop: 0.05}"
        )
        depths = np.array([entry.recess.intrados for entry in found.entries[:8]])
        assert depths.shape == (8, 8)
        assert len(set(depths.ravel())) == 64
        assert depths.min() >= 0.0
        assert 0.02 < depths.mean() < 0.03
        built = found.entries[0].build()
        length = np.hypot(*(built.extrados - built.intrados).T)
        np.testing.assert_allclose(length, found.entries[0].thickness - depths[0])

    def test_friction_of_each_joint_is_a_factor_on_that_of_the_arch(self, tmp_path):
        found = self.scattered(
            tmp_path, "friction: {distribution: triangular, start: 0.9, mode: 1, stop: 1.1}"
        )
        for i, entry in enumerate(found.entries[:8]):
            factor = np.array(entry.friction) / found.parameters()["friction"][i]
            assert 0.9 <= factor.min() < factor.max() <= 1.1

    def test_joints_between_the_springings_are_shifted(self, tmp_path):
        found = self.scattered(tmp_path, "position: {distribution: normal, mean: 0.0, sd: 0.1}")
        places = np.array([entry.joints for entry in found.entries[:8]])
        np.testing.assert_array_equal(places[:, [0, -1]], [[0.0, 157.5]] * 8)
        shift = places / (157.5 / 7) - np.arange(8)
        assert 0.05 < shift[:, 1:-1].std() < 0.15

    def test_joints_in_degrees_go_with_the_embrace(self, tmp_path):
        joints = "[0, 20, 45, 65, 90, 110, 140, 157.5]"
        study = study_of(
            tmp_path, VARIED, f"arches.0.joints={joints}",
            varied("of", "{embrace: {distribution: uniform, start: 140, stop: 170}}"),
        )  # fmt: skip
        for entry in members(study).entries[:8]:
            parts = np.array(entry.joints) / entry.embrace
            np.testing.assert_allclose(parts, np.array(json.loads(joints)) / 157.5)
            entry.build()


BAD = {
    "no power of two": (
        (varied("samples", 12),),
        "arches[0].vary.samples: 12 must be a power of two with scheme sobol, such as 8 or 16; "
        "latin_hypercube takes any number",
    ),
    "nothing varies": ((varied("of", "{}"),), "arches[0].vary must have a key of or joints"),
    "unknown distribution": (
        (varied("of.thickness.distribution", "gamma"),),
        "arches[0].vary.of.thickness.distribution = gamma must be one of normal, lognormal, "
        "uniform, triangular",
    ),
    "key of another profile": (
        (varied("of.span", "{distribution: uniform, start: 1, stop: 2}"),),
        "arches[0].vary.of.span: is nothing that varies of the profile circular; allowed are",
    ),
    "whole numbers": (
        (varied("of.voussoirs", "{distribution: uniform, start: 1, stop: 2}"),),
        "arches[0].vary.of.voussoirs: is nothing that varies",
    ),
    "two scatters": (
        (varied("of.thickness.sd", 0.1),),
        "arches[0].vary.of.thickness must have one of cov and sd",
    ),
    "upside down": (
        (varied("of.thickness", "{distribution: uniform, start: 2, stop: 1}"),),
        "arches[0].vary.of.thickness must have stop above start = 2, not 1",
    ),
    "cut to nothing": (
        (varied("of.thickness.lower", 9.0),),
        "arches[0].vary.of.thickness is cut too far: only ",
    ),
    "correlation with what is fixed": (
        (varied("correlation", "{thickness: {radius: 0.5}}"),),
        "arches[0].vary.correlation: correlation of thickness and radius: radius is not one of",
    ),
    "factor on nothing": (
        (varied("of.dead_load", "{distribution: normal, mean: 1, cov: 0.1, relative: true}"),),
        "arches[0].vary.of.dead_load.relative: must have a finite dead_load",
    ),
    "factor on infinity": (
        ("arches.0.friction=inf", varied("of", "{}"),
         varied("joints", "{friction: {distribution: normal, mean: 1, cov: 0.1}}")),
        "arches[0].vary.joints.friction: must have a finite friction to multiply",
    ),
    "a sample that cannot exist": (
        (varied("of.thickness.cov", 3.0),),
        "arches[0] (ring): sample 2 (thickness = -",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_drawn_is_refused_in_one_sentence(tmp_path, case):
    overrides, part = BAD[case]
    sentence = refused(tmp_path, VARIED, *overrides).removeprefix("small.yaml: ")
    assert sentence.startswith(part)


def test_samples_that_do_not_stand_are_counted(tmp_path):
    study = study_of(
        tmp_path, VARIED,
        varied("of.thickness", "{distribution: uniform, start: 0.5, stop: 1.5}"),
    )  # fmt: skip
    with pytest.raises(StabilityError) as caught:
        check_arches(study)
    sentence = str(caught.value)
    assert sentence.startswith("arches[0] (ring): 4 of 8 samples do not stand under their own")
    assert "the first is sample 2 (thickness = 0." in sentence


class TestTables:
    def test_each_row_is_an_arch(self, tmp_path):
        found = members(study_of(tmp_path, LISTED))
        assert found.ids == ["ring", "north", "south", "slab"]
        assert found.classes == ["ring", "fleet", "fleet", "slab"]
        north, south = found.entries[1:3]
        assert (north.span, north.thickness, north.friction) == (8.0, 0.6, 0.7)
        assert (south.voussoirs, south.thickness) == (7, 0.7)
        assert found.attributes() == {
            "region": ["", "Umbria", "Marche, inland", ""], "year": ["", "1870", "", ""],
        }  # fmt: skip
        np.testing.assert_array_equal(found.parameters()["span"], [np.nan, 8.0, 6.0, np.nan])
        assert arch_of_study(tmp_path / "small.yaml", "south").n_voussoir == 7

    def test_an_edited_table_is_read_again(self, tmp_path):
        study = study_of(tmp_path, LISTED)
        assert len(members(study)) == 4
        (tmp_path / "fleet.csv").write_text(CSV + "west,5,1.5,7,,Lazio,1900\n")
        assert members(study).ids[3] == "west"

    def test_rows_are_drawn_independently_and_whatever_other_rows_there_are(self, tmp_path):
        vary = ("arches.1.vary={samples: 4, of: {thickness: {distribution: normal, mean: 1, "
                "cov: 0.05, relative: true}}}")  # fmt: skip
        found = members(study_of(tmp_path, LISTED, vary))
        assert found.ids[1:9] == [f"{n}-{i:04d}" for n in ("north", "south") for i in range(1, 5)]
        assert set(found.classes[1:9]) == {"fleet"}
        factors = found.parameters()["thickness"][1:9]
        assert len(set(factors)) == 8
        assert found.entries[1].thickness == pytest.approx(0.6 * factors[0])
        assert found.attributes()["region"][1] == "Umbria"
        head, north, south = CSV.splitlines(keepends=True)
        swapped = members(study_of(tmp_path, LISTED, vary, table=head + south + north))
        assert swapped.entries[5:9] == found.entries[1:5]

    @pytest.mark.parametrize(
        ("old", "new", "part"),
        [
            (",1.5,7.0", ",9.0,7.0", "arches[1] (fleet): fleet.csv, line 3: rise = 9.0 m is"),
            (",1.5,7.0", ",x,7.0", "fleet.csv, line 3, column rise = x must be a number"),
            (",7.0,", ",7.5,", "fleet.csv, line 3, column voussoirs = 7.5 must be a whole number"),
            ("south", "north", "fleet.csv, line 3, column id: 'north' is the id of line 2 too"),
            ("south", "so uth", "fleet.csv, line 3, column id = so uth must begin with a letter"),
            ("south", "slab", "an arch has the id 'slab', which belongs to arches[1] (fleet)"),
            ("span", "spam", "line 1: column spam is no key of an arch; did you mean span?"),
            ("rise", "span", "fleet.csv, line 1: column span is there twice"),
            ("id,", "name,", "fleet.csv, line 1: a column id is missing"),
            ("8.0,", ",", "fleet.csv, line 2, span is missing"),
            ("inland\",", "inland\"", "fleet.csv, line 3: has 6 cells; it must have 7"),
            ("region", "radius", "fleet.csv, line 2, column radius is no known key"),
            ("6,1.5", "[6,1.5", "fleet.csv, line 3: has"),
        ],
    )  # fmt: skip
    def test_a_bad_row_is_refused_with_line_and_column(self, tmp_path, old, new, part):
        # Ids in the example's first two lines and columns are unique.
        sentence = refused(tmp_path, LISTED, table=CSV.replace(old, new, 1))
        assert part in sentence
        assert sentence.startswith("small.yaml: arches[")

    def test_no_table(self, tmp_path):
        text = LISTED.replace("fleet.csv", "none.csv")
        assert "none.csv: the table cannot be read (there is no such file)" in refused(
            tmp_path, text
        )

    def test_unknown_key_of_a_table(self, tmp_path):
        text = LISTED.replace("thickness: 0.6", "thicknes: 0.6")
        assert "arches[1].thicknes is no known key; did you mean thickness?" in refused(
            tmp_path, text
        )


def test_validate_shows_what_the_entries_amount_to(tmp_path):
    text = VARIED.replace("  - {id: slab", f"{TABLE}  - {{id: slab")
    study = study_of(tmp_path, text)
    found = check_study(study)
    assert (found.arches, found.runs) == (11, 11 * 2 * 3)
    said = CliRunner().invoke(main, ["validate", str(tmp_path / "small.yaml")]).output
    assert "11 arches, 2 records, 3 levels, 66 runs\n" in said
    assert "  ring: 8 arches, thickness 1." in said
    assert "  fleet: 2 arches, span 6 to 8, rise 1.5 to 2, " in said
    assert "2 of region" in said
    answer = CliRunner().invoke(main, ["validate", str(tmp_path / "small.yaml"), "--json"]).output
    assert json.loads(answer)["classes"][0]["ranges"]["thickness"][0] < 1.5


def test_validate_counts_the_runs_of_arches_that_each_record_has_of_its_own(tmp_path):
    study = study_of(tmp_path, VARIED, varied("crossed", "false"), varied("samples", 5))
    found = check_study(study)
    assert (found.arches, found.runs) == (2 * 5 + 1, (2 * 5 + 2) * 3)
