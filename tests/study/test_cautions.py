"""What is stated on the terminal before a curve is used."""

import numpy as np
import pytest
import xarray as xr

from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.study.cube import write_cube
from archfrag.study.fits import design_cautions, scaled_far, study_cautions, undecided

LEVELS = ["1 g", "2 g", "3 g"]


@pytest.mark.parametrize("kind", [Verdict.UNFINISHED, Verdict.SOLVER_FAILURE])
@pytest.mark.parametrize(("lost", "expected"), [(5, False), (6, True)])
def test_more_than_five_per_cent_at_any_level_is_reported(kind, lost, expected):
    verdict = np.zeros((100, 3), dtype=int)
    verdict[:lost, 2] = kind
    message = undecided(count_verdicts(verdict), LEVELS)
    assert bool(message) is expected
    if expected:
        assert "at 1 of 3 levels (most: 6 of 100 at 3 g)" in message


def test_scaling_by_more_than_ten_is_stated_with_the_worst():
    factors = np.array([[1.0, 2.0, 10.0], [4.0, 8.0, 12.0], [5.0, 10.5, 16.0]])
    cube = xr.Dataset(
        {
            "scale_factor": (("record", "level"), factors),
            "verdict": (("arch", "record", "level"), np.zeros((2, 3, 3), int)),
        },
        coords={"record": ["a", "b", "c"]},
    )
    assert scaled_far(cube).startswith("2 of 3 motions are scaled by more than 10 (most: c by 16)")
    cube["verdict"][:, 2, 2] = Verdict.NOT_SIMULATED
    assert "(most: b by 12)" in scaled_far(cube)
    cube["scale_factor"] = cube["scale_factor"].clip(max=10.0)
    assert scaled_far(cube) == ""


def test_of_a_study_they_name_the_arch_and_its_unit(copied):
    path = write_cube(copied.study)
    cube = xr.load_dataset(path)
    cube["verdict"][:] = Verdict.STANDING
    cube.to_netcdf(path)
    (only,) = study_cautions(copied.study)
    assert only.startswith("all records are of one earthquake (Test)")
    cube["verdict"][1, :, 2] = Verdict.UNFINISHED
    cube["scale_factor"][0, 1] = 11.0
    cube.to_netcdf(path)
    first, second, _ = study_cautions(copied.study)
    assert first.startswith("slab: more than 5 % of the runs")
    assert "(most: 2 of 2 at 1.2 g)" in first
    assert "(most: wave0 by 11)" in second


def test_contradictions_of_a_fleet_are_one_message():
    def found(n):
        notes = {f"a{i}": {"checked": 14, "contradictions": 2} for i in range(n)}
        return design_cautions({"arches": {**notes, "fine": {"checked": 14}}})

    assert [text.split(":")[0] for text in found(3)] == ["a0", "a1", "a2"]
    (one,) = found(50)
    assert one.startswith("50 arches: 100 of 700 runs at random contradict")
