"""The cube: complete, CF-conforming, the same bytes from the same parts, small in memory."""

import hashlib
import json
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
import xarray as xr

from archfrag.errors import InputError, OutputError
from archfrag.fragility.counts import Verdict
from archfrag.study.cube import _write, write_cube, write_timings
from archfrag.study.fits import fit_cube, fit_text, load_answers
from archfrag.study.outcome import COLUMNS
from archfrag.study.provenance import finite
from archfrag.study.store import Gathered, Store, read_part, table_type, write_part


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def cube_file(done):
    return write_cube(done.study)


@pytest.fixture
def cube(cube_file):
    with xr.open_dataset(cube_file) as opened:
        yield opened


class TestContent:
    def test_each_run_stands_where_its_part_states(self, done, cube):
        cases = done.plan.rounds().wanted
        store = Store(done.plan.parts)
        seen = 0
        for _, asked, table, _ in store.rows(
            store.places(done.plan.keys(cases, done.plan.factors(cases)))
        ):
            for case, row in zip(cases[asked], table):
                place = {"arch": case["arch"], "record": case["record"], "level": case["place"]}
                for column in COLUMNS:
                    np.testing.assert_array_equal(cube[column.name].isel(place), row[column.name])
                assert cube["model_time"].isel(place).values.tolist() == list(row["model_time"])
                seen += 1
        assert seen == 12

    def test_runs_that_lost_contact_and_stand_are_counted(self, done, tmp_path, monkeypatch):
        gathered = Gathered(done.plan)
        full = gathered.read()
        table, shape = full.table, (2, 2, 3)
        table["verdict"][:] = Verdict.STANDING
        table["verdict"].reshape(shape)[1, 0, 2] = Verdict.COLLAPSED
        table["lost_contact_time"][:] = np.nan
        table["lost_contact_time"].reshape(shape)[1, :, 1:] = 0.5

        def read(arch, stage):
            own = np.flatnonzero(full.cases["arch"] == arch)
            columns = {name: values[own] for name, values in table.items()}
            return replace(full, cases=full.cases[own], table=columns)

        monkeypatch.setattr(gathered, "read", read)
        with netCDF4.Dataset(str(tmp_path / "cube.nc"), "w") as cube:
            _write(cube, done.study, done.plan, gathered)
            assert cube["lost_contact_and_stand"][:].tolist() == [[0, 0, 0], [0, 2, 1]]
            assert cube.loss_limit == "0.5"

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
    def test_writing_again_gives_the_same_bytes(self, copied):
        first = sha256(write_cube(copied.study))
        assert sha256(write_cube(copied.study)) == first
        path = next(copied.plan.parts.glob("*.npy"))
        table = read_part(path)
        table["peak_rotation"] = np.nextafter(table["peak_rotation"], 1.0)
        path.unlink()
        write_part(copied.plan.parts, table)
        assert sha256(write_cube(copied.study)) != first

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
        with pytest.raises(InputError, match="2 of 12 runs of round 1 are missing or damaged"):
            write_cube(copied.study)
        assert not path.exists()

    def test_wall_times_are_beside_the_cube(self, done, cube_file):
        import pandas as pd

        table = pd.read_csv(write_timings(done.study))
        assert table["arch"].tolist() == ["ring"] * 6 + ["slab"] * 6
        assert table["record"].tolist() == (["wave0"] * 3 + ["wave1"] * 3) * 2
        assert (table["stage"] == 0).all()
        assert (table["wall_time"] > 0.0).all()
        with xr.open_dataset(cube_file) as cube:
            np.testing.assert_array_equal(table["steps"], cube["steps"].values.ravel())


@pytest.mark.slow
def test_gathering_a_hundred_thousand_runs_takes_less_than_a_gibibyte(copied, tmp_path):
    import subprocess
    import sys

    base = copied.plan.records[0]
    n_record, n_level = 2000, 25
    records = tuple(replace(base, id=f"r{i}", prepared=f"{i}") for i in range(n_record))
    levels = tuple(float(i + 1) for i in range(n_level))
    plan = replace(copied.plan, folder=str(tmp_path), records=records, levels=levels)
    plan.parts.mkdir(parents=True)
    cases = plan.rounds().wanted
    keys = plan.keys(cases, plan.factors(cases))
    assert len(keys) == 100_000
    table = np.zeros(200, table_type(("one", "other")))
    for some in range(0, len(keys), 200):
        table["key"] = keys[some : some + 200]
        write_part(plan.parts, table)
    plan.save()
    code = (
        "import sys; from pathlib import Path; from archfrag.study.plan import Plan; "
        "from archfrag.study.store import Gathered as G; "
        "from archfrag.study.worker import peak_memory; "
        "steps = G(Plan.load(Path(sys.argv[1]))).read().table['steps']; "
        "assert steps.size == 100_000; print(peak_memory())"
    )
    found = subprocess.run(
        [sys.executable, "-c", code, str(plan.path)], capture_output=True, text=True, check=True
    )
    # What this process itself held: its parent, with kernels just compiled, may hold more.
    assert float(found.stdout) < 2**30 / 1e6


class TestFits:
    def test_curves_are_stored_and_read_back_or_reported_why_there_is_none(self, copied):
        write_cube(copied.study)
        fits = fit_cube(copied.study)
        assert set(fits) == {"ring", "slab"}
        answers = load_answers(copied.study.folder / "fits.json")
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
    def test_damaged_fits_are_a_message(self, tmp_path, content):
        path = tmp_path / "fits.json"
        path.write_text(content)
        with pytest.raises(InputError, match=r"fits.json: is damaged .*`archfrag fit` makes it"):
            load_answers(path)
