"""What is said on the terminal before a curve is used."""

import numpy as np
import pytest
import xarray as xr

from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.study.cautions import scaled_far, study_cautions, undecided
from archfrag.study.cube import write_cube

LEVELS = ["1 g", "2 g", "3 g"]


@pytest.mark.parametrize("kind", [Verdict.UNFINISHED, Verdict.SOLVER_FAILURE])
@pytest.mark.parametrize(("lost", "said"), [(5, False), (6, True)])
def test_more_than_five_per_cent_at_any_level_is_said(kind, lost, said):
    verdict = np.zeros((100, 3), dtype=int)
    verdict[:lost, 2] = kind
    sentence = undecided(count_verdicts(verdict), LEVELS)
    assert bool(sentence) is said
    if said:
        assert "at 1 of 3 levels (most: 6 of 100 at 3 g)" in sentence


def test_scaling_by_more_than_ten_is_said_with_the_worst():
    factors = np.array([[1.0, 2.0, 10.0], [4.0, 8.0, 12.0], [5.0, 10.5, 16.0]])
    runs = ("arch", "record", "level")
    cube = xr.Dataset(
        {
            "scale_factor": (runs[1:], factors),
            "verdict": (runs, np.zeros((1, 3, 3), np.int8)),
        },
        coords={"record": ["a", "b", "c"]},
    )
    assert scaled_far(cube).startswith("2 of 3 motions are scaled by more than 10 (most: c by 16)")
    cube["verdict"][0, 2, 2] = Verdict.NOT_SIMULATED
    assert "(most: b by 12)" in scaled_far(cube)
    cube["scale_factor"] = cube["scale_factor"].clip(max=10.0)
    assert scaled_far(cube) == ""


def test_of_a_study_they_name_the_arch_and_its_unit(copied):
    path = write_cube(copied.study)
    cube = xr.load_dataset(path)
    cube["verdict"][:] = Verdict.STANDING
    cube.to_netcdf(path)
    assert study_cautions(copied.study) == []
    cube["verdict"][1, :, 2] = Verdict.UNFINISHED
    cube["scale_factor"][0, 1] = 11.0
    cube.to_netcdf(path)
    first, second = study_cautions(copied.study)
    assert first.startswith("slab: more than 5 % of the runs")
    assert "(most: 2 of 2 at 1.2 g)" in first
    assert "(most: wave0 by 11)" in second
