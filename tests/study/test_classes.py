"""Classes of arches from the study file to their curves, and what growing costs."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import lxml.etree
import lxml.html
import numpy as np
import pandas as pd
import pytest

from archfrag.fragility.verdicts import Verdict
from archfrag.report.inputs import report_inputs, summary
from archfrag.report.page import render
from archfrag.report.sections import class_sections
from archfrag.study.file.schema import RiskKeys
from archfrag.study.provenance import products
from tests.study.small import command, made, small_study

TEXT = Path(__file__).with_name("classes.yaml").read_text()
HAZARD = "PGA [g],rate\n0.01,0.1\n0.1,1e-2\n0.5,8e-4\n3,1e-5\n"
TABLE = "id,width,town/bank\na,0.35,Gera/left\nb,0.45,Gera/right\n"


def write(folder, text=TEXT):
    (folder / "fleet.csv").write_text(TABLE)
    (folder / "hazard.csv").write_text(HAZARD)
    return small_study(folder, text)


@pytest.fixture(scope="session")
def classes(tmp_path_factory):
    """Treat as read-only."""
    return made(write(tmp_path_factory.mktemp("classes")))


def called(classes, name, *arguments):
    result = command(name, classes.study.folder.parent / "small.yaml", *arguments)
    assert result.exit_code == 0, result.output
    return result


def test_the_cube_has_arches_with_their_entries_and_what_differs(classes):
    ids = [f"slab-{i:04d}" for i in range(1, 5)]
    assert classes.cube["arch"].values.astype(str).tolist() == [*ids, "a", "b", "alone"]
    assert classes.cube["arch_class"].values.astype(str).tolist() == (
        ["slab"] * 4 + ["fleet"] * 2 + ["alone"]
    )
    members = classes.study.members
    for name in ("width", "height"):
        variable = classes.cube[f"arch_{name}"]
        found = [getattr(member.entry, name) for member in members]
        np.testing.assert_array_equal(variable.values, found)
        assert variable.attrs["units"] == "m"
    assert classes.cube["arch_width"].values[4:].tolist() == [0.35, 0.45, 0.4]
    attribute = classes.cube["attribute_town_bank"]
    assert attribute.values.astype(str).tolist() == [""] * 4 + [
        "Gera/left",
        "Gera/right",
        "",
    ]
    assert attribute.attrs["long_name"] == "town/bank of the arch"


def test_every_arch_and_every_class_of_several_has_a_curve(classes):
    assert (classes.cube["verdict"] != Verdict.NOT_RUN).all()
    assert classes.log["runs"] == 7 * 2 * 6
    assert list(classes.fits["classes"]) == ["slab", "fleet"]
    assert len(classes.fits["arches"]) == 7
    assert all(
        classes.fits["classes"][name]["curve"]["theta"] > 0.0
        for name in ("slab", "fleet")
    )


class TestOneCurve:
    """A class has one curve in risk, report and exports: the mean of those of its arches."""

    NAMES = ("slab", "fleet", "alone")
    SLABS = tuple(f"slab-000{i}" for i in range(1, 5))

    def test_its_rate_is_the_mean_of_those_of_its_arches(self, classes):
        given = "--hazard", classes.study.folder.parent / "hazard.csv", "--json"
        one, every = (
            json.loads(called(classes, "risk", *given, *more).stdout)["arches"]
            for more in ((), ("--members",))
        )
        assert tuple(one) == self.NAMES
        assert len(every) == 7 + 2
        assert every["slab"] == one["slab"]
        for name, arches in (("slab", self.SLABS), ("fleet", "ab")):
            mean = np.mean([every[arch]["rate"] for arch in arches])
            assert one[name]["rate"] == pytest.approx(mean, rel=1e-6)
            assert one[name]["rate_band"][0] < mean < one[name]["rate_band"][1]
            levels = np.mean([every[arch]["rate_by_level"] for arch in arches], axis=0)
            np.testing.assert_allclose(one[name]["rate_by_level"], levels, rtol=1e-6)
        text = called(classes, "risk", *given[:2]).stdout
        told = re.findall(
            r"rate of collapse of (the mean curve of its arches|these medians)", text
        )
        assert told == ["the mean curve of its arches"] * 2 + ["these medians"]
        fell = (classes.cube["verdict"].values[:4] == Verdict.COLLAPSED).sum()
        assert sum(part["collapses"] for part in one["slab"]["by_mechanism"]) == fell

    def test_every_export_holds_it_and_no_arch_of_it_unless_asked(
        self, classes, tmp_path
    ):
        called(classes, "export", "--format=csv", "--out", tmp_path)
        stated = pd.read_csv(tmp_path / "classes-parameters.csv").query(
            "limit_state=='collapse'"
        )
        assert tuple(stated["arch"]) == self.NAMES
        stored = classes.fits["classes"]["slab"]["curve"]
        theta, beta = stated.iloc[0][["theta_si", "beta"]]
        assert (theta, beta) == pytest.approx(
            (stored["theta"], stored["beta"]), rel=1e-12
        )
        called(
            classes, "export", "--format=csv", "--members", "--out", tmp_path / "all"
        )
        every = pd.read_csv(tmp_path / "all" / "classes-curves.csv")
        curves = every.query("limit_state=='collapse'").pivot(
            index="im", columns="arch"
        )
        curves = curves["probability"]
        members = curves[[*self.SLABS]].mean(axis=1)
        np.testing.assert_allclose(curves["slab"], members, rtol=1e-9, atol=1e-12)

    def test_report_and_summary_have_one_beta(self, classes):
        risk = RiskKeys(hazard=str(classes.study.folder.parent / "hazard.csv"))
        inputs = report_inputs(classes.study.model_copy(update={"risk": risk}))
        page = lxml.html.document_fromstring(render(inputs)[0])
        rows = page.xpath('//table[@aria-label="Rates of collapse"]/tbody/tr/th')
        figures = {path.name for path in products(classes.study, "report")}
        assert {f"curve-{name}.svg" for name in (*self.NAMES, *self.SLABS)} <= figures
        names = ["slab, 4 arches", "fleet, 2 arches", "alone"]
        assert [row.text for row in rows] == names
        slab = summary(inputs)["classes"][0]
        assert slab["curve"]["beta"] == classes.fits["classes"]["slab"]["curve"]["beta"]
        assert slab["curve"]["maximum_likelihood"] is None
        (dispersion,) = page.xpath('//section[@id="class0"]//dl[1]/div[2]/dd[1]')
        assert dispersion.text == f"{slab['curve']['beta']:#.3g}"


def test_what_is_infinite_has_no_place_where_theta_depends_on_it(classes):
    inputs = report_inputs(classes.study)
    stiffness = [1e10, 2e10, 3e10, np.inf, 1e10, np.inf, np.nan]
    cube = inputs.cube.assign(arch_joints_stiffness=("arch", stiffness))
    slab, fleet = class_sections(replace(inputs, cube=cube))
    assert [
        ">joints stiffness<" in "".join(map(str, page.parts)) for page in (slab, fleet)
    ] == [
        True,
        False,
    ]


def test_more_samples_run_alone(classes, tmp_path):
    copied = shutil.copytree(classes.study.folder.parent, tmp_path / "copy")
    grown = made(write(copied, TEXT.replace("samples: 4", "samples: 8")))
    assert (grown.log["runs"], grown.log["kept"]) == (84 + 48, 84)
    names = classes.cube["arch"].values
    for name in ("verdict", "peak_rotation", "arch_width"):
        after = grown.cube[name].set_index(arch="arch").sel(arch=names)
        np.testing.assert_array_equal(classes.cube[name].values, after.values)
