"""Tables of runs and curves: every value where it belongs, in pieces as in one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from archfrag.export import command as tables
from archfrag.fragility.verdicts import Verdict
from tests.export.made import curve_set, lognormal
from tests.report import synthetic

G = 9.80665


@pytest.fixture(scope="module")
def cube_file(tmp_path_factory):
    """Two arches, six records, nine levels; some cells were not simulated; text of records."""
    cube = synthetic.cube(("ring-7", "wall+2"))
    cube["verdict"][1, 2, 3:6] = Verdict.NOT_RUN
    cube["verdict"][0, :, 8] = Verdict.NOT_RUN
    cube["verdict"].attrs["flag_meanings"] = "survived collapsed unfinished failed"
    cube["event"] = ("record", [f"quake, {n // 2}" for n in range(6)])
    cube["record_file"] = ("record", [f"{n}.AT2" for n in range(6)])
    cube["record_measure"] = (("record", "measure"), np.arange(12.0).reshape(6, 2))
    cube["measure_unit"] = ("measure", ["m s-2", "m s-1"])
    cube = cube.assign_coords(measure=["PGA", "PGV"], level=np.arange(9))
    cube["lost_contact_and_stand"] = (("arch", "level"), np.ones((2, 9), int))
    path = tmp_path_factory.mktemp("tables") / "cube.nc"
    cube.to_netcdf(path, encoding={"verdict": {"chunksizes": (2, 4, 9)}})
    return path


@pytest.fixture
def cube(cube_file):
    with xr.open_dataset(cube_file) as opened:
        yield opened


def full(table):
    return pd.concat(table[1], ignore_index=True)


class TestRuns:
    def test_each_run_has_the_values_of_its_cell(self, cube):
        frame = full(tables.runs_table(cube))
        assert len(frame) == 2 * 6 * 9 - 3 - 6
        assert list(frame)[:4] == ["arch", "record", "level", "intensity"]
        for row in frame.to_dict("records"):
            cell = cube.sel(arch=row["arch"], record=row["record"]).isel(
                level=row["level"]
            )
            assert cell["verdict"] != Verdict.NOT_RUN
            for name in (
                "verdict",
                "scale_factor",
                "magnitude",
                "intensity",
                "collapse_time",
            ):
                np.testing.assert_equal(row[name], cell[name].item())
            assert row["model_time_rest"] == cell["model_time"].sel(model="rest")
            assert row["record_measure_PGV"] == cell["record_measure"].sel(
                measure="PGV"
            )
            assert row["event"] == cell["event"]

    def test_nothing_but_long_text_and_counts_is_missing(self, cube):
        columns, pieces = tables.runs_table(cube)
        missing = {str(name) for name in cube.variables} - set(columns)
        assert missing - {
            "model",
            "measure",
            "measure_unit",
            "model_time",
            "record_measure",
        } == {
            "record_file",
            "lost_contact_and_stand",
        }
        assert list(pd.concat(pieces)) == list(columns)
        assert columns["record_measure_PGV"]["unit"] == "m s-1"
        assert columns["verdict"]["codes"]["failed"] == 3
        records = tables.facts_table(cube, "record")
        assert {"record_file", "event", "magnitude"} <= set(records[0])

    def test_runs_each_at_an_intensity_of_its_own(self, cube):
        """As in designs of scattered runs: one level, intensity by arch and record."""
        one = cube.isel(level=[4]).drop_vars(["intensity", "lost_contact_and_stand"])
        own = np.arange(12.0).reshape(2, 6, 1)
        one["intensity"] = (("arch", "record", "level"), own)
        frame = full(tables.runs_table(one))
        assert frame["intensity"].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 9, 10, 11]

    def test_in_pieces_as_in_one(self, cube):
        del cube["verdict"].encoding["chunksizes"]
        pieces = list(tables.runs_table(cube, 1)[1])
        assert [piece["arch"].unique().tolist() for piece in pieces] == [
            ["ring-7"],
            ["wall+2"],
        ]
        columns, whole = tables.runs_table(cube, 20)
        pd.testing.assert_frame_equal(
            pd.concat(pieces, ignore_index=True), full((columns, whole))
        )
        assert columns["intensity"]["unit"] == "m s-2"


def test_points_and_parameters():
    answers = synthetic.answers_of(synthetic.cube(("ring-7", "wall+2")))
    for name, answer in answers.items():
        states = [replace(answer, state=state) for state in ("rocking", "damage")]
        answers[name] = replace(answer, states=tuple(states))
    curves = curve_set()
    points, parameters = tables.curve_tables(
        curves, answers, "g", "m s-2", G, {}
    ).values()
    frame = full(points)
    stated = full(parameters)
    for found in (frame, stated):
        assert len(found.groupby(["arch", "limit_state"])) == 6
    np.testing.assert_allclose(frame["im"] * G, frame["intensity"], rtol=1e-14)
    for row in frame[frame["im"] > 0].iloc[::37].to_dict("records"):
        fit = curves.curves[row["arch"]][row["limit_state"]]
        expected = lognormal(row["intensity"], fit.theta, fit.beta)
        assert row["probability"] == pytest.approx(expected, abs=1e-14)
        assert 0 <= row["lower"] <= row["upper"] <= 1
    np.testing.assert_allclose(stated["theta"] * G, stated["theta_si"], rtol=1e-14)
    assert (stated["theta_lower"] < stated["theta_upper"]).all()
