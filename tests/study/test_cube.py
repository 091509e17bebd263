"""The cube: complete, and its own study's."""

import json

import numpy as np
import pytest
import xarray as xr

from archfrag.errors import InputError, OutputError
from archfrag.fragility.counts import Verdict
from archfrag.study.answer.cube import build_cube, write_cube
from archfrag.study.answer.fits import fit_cube, fit_text, load_fits
from archfrag.study.files import finite
from archfrag.study.runs.store import COLUMNS, gather


@pytest.fixture(scope="module")
def cube_file(done):
    return write_cube(done.study)


@pytest.fixture
def cube(cube_file):
    with xr.open_dataset(cube_file) as opened:
        yield opened


class TestContent:
    def test_each_run_stands_where_its_part_states(self, done, cube):
        cases, table, _ = gather(done.plan)
        place = tuple(cases[name] for name in ("arch", "record", "place"))
        for name in (*(column.name for column in COLUMNS), "model_time"):
            np.testing.assert_array_equal(cube[name].values[place], table[name])
        assert len(table) == cube["verdict"].size == 12

    def test_runs_that_lost_contact_and_stand_are_counted(self, done):
        (cases, table, notes), shape = gather(done.plan), (2, 2, 3)
        table["verdict"][:] = Verdict.STANDING
        table["verdict"].reshape(shape)[1, 0, 2] = Verdict.COLLAPSED
        table["lost_contact_time"][:] = np.nan
        table["lost_contact_time"].reshape(shape)[1, :, 1:] = 0.5
        cube = build_cube(done.study, done.plan, cases, table, notes)
        assert cube["lost_contact_and_stand"].values.tolist() == [[0, 0, 0], [0, 2, 1]]
        assert cube.attrs["loss_limit"] == "0.5"

    def test_provenance_is_complete_and_knows_neither_time_nor_place(self, done, cube):
        config = json.loads(cube.attrs["archfrag_config"])
        assert config["arches"][1]["friction"] == "inf"
        assert config["intensity"]["levels"] == [0.1, 0.6, 1.2]
        assert json.loads(cube.attrs["archfrag_inputs_sha256"]) == {
            record.source: record.sha256 for record in done.plan.records
        }
        assert {"archfrag", "python", "numpy", "numba"} <= set(
            json.loads(cube.attrs["archfrag_versions"])
        )
        assert cube.attrs["Conventions"] == "CF-1.11"
        everything = json.dumps({key: str(value) for key, value in cube.attrs.items()})
        assert str(done.study.folder) not in everything
        assert "workers" not in everything


class TestFile:
    def test_another_study_and_missing_runs_are_refused(self, copied):
        path = write_cube(copied.study)
        before = path.read_bytes()
        other = copied.study.model_copy(update={"id": "other"})
        with pytest.raises(OutputError) as caught:
            write_cube(other)
        assert str(caught.value) == (
            f"{path}: the cube of study 'small' is in the place of study 'other'; give the "
            "studies different output folders, or move the file"
        )
        assert path.read_bytes() == before
        next(copied.plan.parts.glob("*.npy")).unlink()
        path.unlink()
        with pytest.raises(InputError, match="2 of 12 runs are missing or damaged"):
            write_cube(copied.study)
        assert not path.exists()


class TestFits:
    def test_curves_are_stored_and_read_back_or_reported_why_there_is_none(self, copied):
        write_cube(copied.study)
        fits = fit_cube(copied.study)[0]
        assert set(fits) == {"ring", "slab"}
        answers = load_fits(copied.study)[0]
        for name, fit in fits.items():
            assert finite(answers[name].to_dict()) == finite(fit.to_dict())
            if isinstance(fit.curve, str):
                assert answers[name].curve == fit.curve
                assert fit.curve in fit_text(copied.study, name, fit)
            else:
                assert answers[name].curve.to_dict() == fit.curve.to_dict()

    @pytest.mark.parametrize(
        "content", ['{"fits": []}', '{"fits": {"a": 1}}', "[]", '{"fits": {"a": {}}}', "\0"]
    )
    def test_damaged_fits_are_a_message(self, copied, content):
        (copied.study.folder / "fits.json").write_text(content)
        with pytest.raises(
            InputError, match=r"fits.json: is missing or damaged .*`archfrag fit` makes it"
        ):
            load_fits(copied.study)
