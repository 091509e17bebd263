"""Classes of arches from the study file to their curves: who meets whom, what growing costs."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr

from archfrag.fragility.counts import Verdict
from archfrag.study.batch import BatchLog, run_batch
from archfrag.study.config import Study, load_study
from archfrag.study.cube import write_cube
from archfrag.study.fits import fit_cube
from archfrag.study.members import members
from archfrag.study.plan import make_plan
from archfrag.study.records import prepare_motions
from archfrag.study.steps import finish, stale_steps
from tests.study.small import in_process, small_study

TEXT = """\
id: classes
title: Classes of arches
output: out
arches:
  - id: slab
    profile: block
    width: 0.4
    height: 2.0
    friction: .inf
    vary:
      samples: 4
      of:
        width: {distribution: normal, mean: 0.4, cov: 0.1}
        height: {distribution: uniform, start: 1.6, stop: 2.4}
      correlation: {width: {height: 0.5}}
  - id: own
    profile: block
    width: 0.4
    height: 2.0
    friction: .inf
    vary:
      samples: 2
      crossed: false
      of: {width: {distribution: normal, mean: 0.4, cov: 0.1}}
  - {id: fleet, table: fleet.csv, profile: block, height: 2.0, friction: .inf}
  - {id: alone, profile: block, width: 0.4, height: 2.0, friction: .inf}
motions:
  files: ["records/*.AT2"]
intensity:
  measure: PGA
  unit: g
  levels: [0.1, 0.3, 0.5, 0.7, 0.9, 1.2]
method: {name: auto, follow: 2.0}
"""
TABLE = "id,width,town/bank\na,0.35,Gera/left\nb,0.45,Gera/right\n"


@dataclass(frozen=True)
class Made:
    """A study with its cube and its curves."""

    study: Study
    log: BatchLog
    cube: xr.Dataset
    fits: dict


def made(path):
    study = load_study(path)
    prepare_motions(study)
    with in_process():
        log = run_batch(study, workers=1, quiet=True)
    with xr.open_dataset(write_cube(study)) as opened:
        cube = opened.load()
    fit_cube(study)
    return Made(study, log, cube, json.loads((study.folder / "fits.json").read_text()))


def write(folder, text=TEXT, table=TABLE):
    (folder / "fleet.csv").write_text(table)
    return small_study(folder, text)


@pytest.fixture(scope="session")
def classes(tmp_path_factory):
    """Treat as read-only."""
    return made(write(tmp_path_factory.mktemp("classes")))


class TestCube:
    def test_arches_and_the_entries_they_are_of(self, classes):
        ids = [f"slab-{i:04d}" for i in range(1, 5)] + [f"own-{i:04d}" for i in range(1, 5)]
        assert classes.cube["arch"].values.astype(str).tolist() == [*ids, "a", "b", "alone"]
        assert classes.cube["arch_class"].values.astype(str).tolist() == (
            ["slab"] * 4 + ["own"] * 4 + ["fleet"] * 2 + ["alone"]
        )

    def test_what_differs_is_there_by_arch(self, classes):
        found = members(classes.study, 2)
        for name, unit in (("width", "m"), ("height", "m")):
            variable = classes.cube[f"arch_{name}"]
            np.testing.assert_array_equal(variable.values, found.parameters()[name])
            assert variable.attrs["units"] == unit
        assert classes.cube["arch_width"].values[8:10].tolist() == [0.35, 0.45]
        assert np.isnan(classes.cube["arch_width"].values[10])

    def test_an_attribute_may_have_any_name(self, classes):
        attribute = classes.cube["attribute_town_bank"]
        assert attribute.values.astype(str).tolist() == [""] * 8 + ["Gera/left", "Gera/right", ""]
        assert attribute.attrs["long_name"] == "town/bank of the arch"

    def test_arches_of_a_records_own_meet_no_other(self, classes):
        simulated = (classes.cube["verdict"] != Verdict.NOT_SIMULATED).values
        meets = np.ones((11, 2), bool)
        meets[4:8] = [[True, False], [True, False], [False, True], [False, True]]
        np.testing.assert_array_equal(simulated.all(axis=2), meets)
        np.testing.assert_array_equal(simulated.any(axis=2), meets)
        assert classes.log.runs == meets.sum() * 6

    def test_a_sample_falls_as_the_arch_of_its_values_does(self, classes):
        """The onset of a slender block is width over height."""
        height = classes.cube["arch_height"].fillna(2.0)
        np.testing.assert_allclose(
            classes.cube["onset_plus"][:10], (classes.cube["arch_width"] / height)[:10], rtol=1e-9
        )


class TestCurves:
    def test_arches_and_classes_have_one_each(self, classes):
        assert list(classes.fits["classes"]) == ["slab", "own", "fleet"]
        assert len(classes.fits["arches"]) == 11
        for name in ("slab", "own"):
            assert classes.fits["classes"][name]["curve"]["theta"] > 0.0

    def test_one_record_for_each_arch_gives_a_class_only(self, classes):
        message = classes.fits["fits"]["own-0001"]["none"]
        assert "only one record" in message


class TestGrowing:
    @pytest.fixture
    def copied(self, classes, tmp_path):
        import shutil

        folder = classes.study.folder.parent
        shutil.copytree(folder, tmp_path / "copy")
        return tmp_path / "copy"

    def test_more_samples_run_alone(self, classes, copied):
        grown = made(write(copied, TEXT.replace("samples: 4", "samples: 8")))
        assert (grown.log.runs, grown.log.kept) == (108 + 48, 108)
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
        assert make_plan(study).digest == plan.digest
        assert stale_steps(study)[0] == ["cube", "fit", "report"]
