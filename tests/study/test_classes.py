"""Classes of arches from the study file to their curves: who meets whom, what growing costs."""

import json
import shutil
from pathlib import Path

import lxml.etree
import lxml.html
import numpy as np
import pandas as pd
import pytest

from archfrag.fragility.counts import Verdict
from archfrag.report.inputs import report_inputs, summary
from archfrag.report.page import render
from archfrag.study.file.records import prepare_motions
from archfrag.study.file.schema import RiskKeys, load_study
from archfrag.study.runs.store import make_plan
from archfrag.study.steps import finish, stale_steps
from tests.study.small import command, made, small_study

TEXT = Path(__file__).with_name("classes.yaml").read_text()
TABLE = "id,width,town/bank\na,0.35,Gera/left\nb,0.45,Gera/right\n"


def write(folder, text=TEXT, table=TABLE):
    (folder / "fleet.csv").write_text(table)
    return small_study(folder, text)


@pytest.fixture(scope="session")
def classes(tmp_path_factory):
    """Treat as read-only."""
    return made(write(tmp_path_factory.mktemp("classes")))


class TestCube:
    def test_arches_with_the_entries_they_are_of_and_what_differs(self, classes):
        ids = [f"slab-{i:04d}" for i in range(1, 5)] + [f"own-{i:04d}" for i in range(1, 5)]
        assert classes.cube["arch"].values.astype(str).tolist() == [*ids, "a", "b", "alone"]
        assert classes.cube["arch_class"].values.astype(str).tolist() == (
            ["slab"] * 4 + ["own"] * 4 + ["fleet"] * 2 + ["alone"]
        )
        found = classes.study.members(2)
        for name in ("width", "height"):
            variable = classes.cube[f"arch_{name}"]
            np.testing.assert_array_equal(variable.values, found.parameters()[name])
            assert variable.attrs["units"] == "m"
        assert classes.cube["arch_width"].values[8:10].tolist() == [0.35, 0.45]
        assert np.isnan(classes.cube["arch_width"].values[10])
        attribute = classes.cube["attribute_town_bank"]
        assert attribute.values.astype(str).tolist() == [""] * 8 + ["Gera/left", "Gera/right", ""]
        assert attribute.attrs["long_name"] == "town/bank of the arch"

    def test_arches_of_a_records_own_meet_no_other(self, classes):
        simulated = (classes.cube["verdict"] != Verdict.NOT_SIMULATED).values
        meets = np.ones((11, 2), bool)
        meets[4:8] = [[True, False], [True, False], [False, True], [False, True]]
        np.testing.assert_array_equal(simulated.all(axis=2), meets)
        np.testing.assert_array_equal(simulated.any(axis=2), meets)
        assert classes.log["runs"] == meets.sum() * 6


def test_arches_and_classes_have_a_curve_each_unless_an_arch_has_one_record(classes):
    assert list(classes.fits["classes"]) == ["slab", "own", "fleet"]
    assert len(classes.fits["arches"]) == 11
    for name in ("slab", "own"):
        assert classes.fits["classes"][name]["curve"]["theta"] > 0.0
    assert "only one record" in classes.fits["fits"]["own-0001"]["none"]


class TestOneCurve:
    """A class has one curve in risk, report and exports: the mean of those of its arches."""

    NAMES = ("slab", "own", "fleet", "alone")

    @staticmethod
    def called(classes, name, *arguments):
        result = command(name, classes.study.folder.parent / "small.yaml", *arguments)
        assert result.exit_code == 0, result.output
        return result

    @pytest.fixture
    def hazard(self, tmp_path):
        path = tmp_path / "hazard.csv"
        path.write_text("PGA [g],rate\n0.01,0.1\n0.1,1e-2\n0.5,8e-4\n3,1e-5\n")
        return path

    def test_its_rate_is_the_mean_of_those_of_its_arches(self, classes, hazard):
        given = "--hazard", hazard, "--json"
        one, every = (
            json.loads(self.called(classes, "risk", *given, *more).stdout)["arches"]
            for more in ((), ("--members",))
        )
        assert tuple(one) == self.NAMES
        assert len(every) == 11 + 3
        assert every["slab"] == one["slab"]
        for name, arches in (("slab", [f"slab-000{i}" for i in range(1, 5)]), ("fleet", "ab")):
            mean = np.mean([every[arch]["rate"] for arch in arches])
            assert one[name]["rate"] == pytest.approx(mean, rel=1e-6)
            assert one[name]["rate_band"][0] < mean < one[name]["rate_band"][1]
            levels = np.mean([every[arch]["rate_by_level"] for arch in arches], axis=0)
            np.testing.assert_allclose(one[name]["rate_by_level"], levels, rtol=1e-6)
        fell = (classes.cube["verdict"].values[:4] == Verdict.COLLAPSED).sum()
        assert sum(part["collapses"] for part in one["slab"]["by_mechanism"]) == fell

    def test_every_export_holds_it_and_no_arch_of_it_unless_asked(self, classes, tmp_path):
        self.called(classes, "export", "--format=csv", "--out", tmp_path)
        stated = pd.read_csv(tmp_path / "classes-parameters.csv").query("limit_state=='collapse'")
        assert tuple(stated["arch"]) == self.NAMES
        stored = classes.fits["classes"]["slab"]["curve"]
        theta, beta = stated.iloc[0][["theta_si", "beta"]]
        assert (theta, beta) == pytest.approx((stored["theta"], stored["beta"]), rel=1e-12)
        self.called(classes, "export", "--format=csv", "--members", "--out", tmp_path / "all")
        every = pd.read_csv(tmp_path / "all" / "classes-curves.csv")
        curves = every.query("limit_state=='collapse'").pivot(index="im", columns="arch")
        curves = curves["probability"]
        members = curves[[f"slab-000{i}" for i in range(1, 5)]].mean(axis=1)
        np.testing.assert_allclose(curves["slab"], members, rtol=1e-9, atol=1e-12)

    def test_report_and_summary_have_one_beta(self, classes, hazard):
        risk = RiskKeys(hazard=str(hazard))
        study = classes.study.model_copy(update={"risk": risk})
        inputs = report_inputs(study)
        page = lxml.html.document_fromstring(render(inputs)[0])
        rows = page.xpath('//table[@aria-label="Rates of collapse"]/tbody/tr/th')
        assert [row.text for row in rows] == [
            "slab, 4 arches", "own, 4 arches", "fleet, 2 arches", "alone"
        ]  # fmt: skip
        slab = summary(inputs)["classes"][0]
        assert slab["curve"]["beta"] == classes.fits["classes"]["slab"]["curve"]["beta"]
        assert slab["curve"]["maximum_likelihood"] is None
        (dispersion,) = page.xpath('//section[@id="class0"]//dl[1]/div[2]/dd[1]')
        assert dispersion.text == f"{slab['curve']['beta']:#.3g}"


class TestGrowing:
    @pytest.fixture
    def copied(self, classes, tmp_path):
        folder = classes.study.folder.parent
        shutil.copytree(folder, tmp_path / "copy")
        return tmp_path / "copy"

    def test_more_samples_run_alone(self, classes, copied):
        grown = made(write(copied, TEXT.replace("samples: 4", "samples: 8")))
        assert (grown.log["runs"], grown.log["kept"]) == (108 + 48, 108)
        names = classes.cube["arch"].values
        for name in ("verdict", "peak_rotation", "arch_width"):
            before = classes.cube[name].set_index(arch="arch").sel(arch=names)
            after = grown.cube[name].set_index(arch="arch").sel(arch=names)
            np.testing.assert_array_equal(before.values, after.values)

    def test_an_attribute_that_changes_makes_the_cube_anew_and_no_run(self, classes, copied):
        study = load_study(write(copied))
        prepare_motions(study)
        plan = make_plan(study)
        for step in ("motions", "batch-0of1", "cube", "fit", "report"):
            finish(study, step)
        assert stale_steps(study)[0] == []
        study = load_study(write(copied, table=TABLE.replace("Gera/left", "Gera/west")))
        assert make_plan(study).digests == plan.digests
        assert stale_steps(study)[0] == ["cube", "fit", "report"]
