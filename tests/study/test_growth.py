"""Studies of all designs on real runs: what is in the cube, and what a study that grows keeps."""

import json

import numpy as np
import pytest
import xarray as xr

import archfrag as af
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.fits import fit_cube
from archfrag.study.file.records import load_record, prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.execute import run_batch
from tests.study.small import TEXT, assert_compliant, small_study, write_at2

DESIGNS = {
    "stripes": "{kind: stripes}",
    "ida": "{kind: ida, checks: 2}",
    "cloud": "{kind: cloud, factor: 2.0}",
}
THIRD = "  - {id: plate, profile: block, width: 0.5, height: 2.0, friction: .inf}\nmotions:"
GROWN = {
    "level": lambda text: text.replace("0.6, 1.2]", "0.6, 0.9, 1.2]"),
    "arch": lambda text: text.replace("motions:", THIRD),
    "record": lambda text: text,
}


def study_of(folder, design, text=TEXT, records=2):
    path = small_study(folder, text + f"design: {DESIGNS[design]}\n")
    time = np.arange(150) * 0.01
    for number in range(2, records):
        wave = 0.2 * np.sin(3 * number * time) * np.sin(np.pi * time / 1.5)
        write_at2(folder / "records" / f"wave{number}.AT2", wave, 0.01)
    return load_study(path)


def cube_of(study, quiet=True):
    """Log and cube of a study made in this process."""
    prepare_motions(study)
    log, _ = run_batch(study, workers=1, quiet=quiet)
    return log, xr.load_dataset(write_cube(study))


@pytest.mark.parametrize("grown", GROWN)
@pytest.mark.parametrize("design", DESIGNS)
def test_a_study_that_grows_and_goes_back_makes_only_the_new_runs(tmp_path, design, grown, capfd):
    before, _ = cube_of(study_of(tmp_path / "grown", design))
    records = 3 if grown == "record" else 2
    text = GROWN[grown](TEXT)
    log, second = cube_of(study_of(tmp_path / "grown", design, text, records), quiet=False)
    # How many runs there will be is shown only where it is known, so that nothing goes back.
    assert ("%" in capfd.readouterr().err) == (design != "ida")
    full, third = cube_of(study_of(tmp_path / "full", design, text, records))
    assert (before["kept"], full["kept"], log["runs"]) == (0, 0, full["runs"])
    xr.testing.assert_identical(second, third)
    if design in ("stripes", "cloud") or grown == "arch":
        assert log["kept"] == before["runs"]
    else:
        assert log["kept"] >= before["runs"] - 4  # checks may be elsewhere
    if grown != "record":
        back, _ = cube_of(study_of(tmp_path / "grown", design))
        assert back["kept"] == back["runs"] == before["runs"]


@pytest.mark.parametrize("design", DESIGNS)
def test_batches_ask_for_the_runs_that_one_asks_for(tmp_path, design):
    study = study_of(tmp_path, design, records=3)
    prepare_motions(study)
    execution = study.execution.model_copy(update={"batches": 3})
    shared = study.model_copy(update={"execution": execution})
    logs = [run_batch(shared, number, quiet=True)[0] for number in range(3)]
    log, _ = run_batch(study, quiet=True)
    assert log["runs"] == log["kept"] == sum(each["runs"] for each in logs)
    assert sum(each["kept"] for each in logs) == 0


@pytest.mark.parametrize("design", ["ida", "cloud"])
def test_cube_of_each_design(tmp_path, design):
    study = study_of(tmp_path, design, records=3)
    log, cube = cube_of(study)
    made = cube["verdict"].values != 4
    note = json.loads(cube.attrs["archfrag_design"])
    assert note["kind"] == design
    assert set(note["arches"]) == {"ring", "slab"}
    assert made.sum() == sum(each["runs"] for each in note["arches"].values()) == log["runs"]
    assert ((cube["status"].values == -1) == ~made).all()
    assert (np.isnan(cube["peak_rotation"].values) == ~made).all()
    assert (cube["steps"].values[~made] == -1).all()
    own = design == "cloud"
    assert cube["verdict"].shape == (2, 3, 1 if own else 3)
    assert cube["intensity"].dims == (("arch", "record", "level") if own else ("level",))
    assert cube["scale_factor"].dims == (("arch",) if own else ()) + ("record", "level")
    if design == "cloud":
        np.testing.assert_allclose(cube["scale_factor"], 2.0, rtol=1e-14)
    pga = cube["record_measure"].sel(measure="PGA")
    reached = (cube["scale_factor"] * pga).broadcast_like(cube["verdict"])
    levels = cube["intensity"].broadcast_like(cube["verdict"])
    np.testing.assert_allclose(reached.values[made], levels.values[made], rtol=1e-12)
    records = prepare_motions(study)
    for arch, record, level in np.argwhere(made)[[0, -1]]:
        place = {"arch": arch, "record": record, "level": level}
        factor = cube["scale_factor"].isel({k: place[k] for k in cube["scale_factor"].dims})
        response = af.simulate(
            study.arches[arch].build(), load_record(study.work, records[record]),
            scale=factor.item(), method="time_stepping", dt=2e-3, follow=2.0,
        )  # fmt: skip
        assert cube["peak_displacement"].isel(place).item() == response.peak_displacement
        assert cube["status"].isel(place).item() == response.status
    if design == "cloud":
        assert set(fit_cube(study)[0]["ring"].more["cloud"]) == {"logistic"}
    assert_compliant(study.folder / "cube.nc", tmp_path)
