"""Files for papers: tables beside the report, and what its figures are drawn from."""

import re

import numpy as np
import pandas as pd
import pytest

from archfrag.report.curve_figures import effects_on_theta
from archfrag.report.inputs import RUN_COLUMNS, report_inputs, write_papers
from archfrag.report.run_figures import fractiles, ida_line
from archfrag.study.answer.fits import load_fits
from archfrag.study.file.schema import load_study
from tests.study.small import TEXT, command, small_study

DENSE = TEXT.replace("[0.1, 0.6, 1.2]", "[0.1, 0.2, 0.4, 0.6, 1.2, 2.4]")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = small_study(tmp_path_factory.mktemp("papers"), DENSE)
    done = command("run", path, "--quiet")
    assert done.exit_code == 0, done.output
    return path, path.parent / "out", load_fits(load_study(path))


def test_runs_are_told_in_words_and_in_the_unit_of_the_study(finished):
    _, out, fitted = finished
    cube = fitted.cube
    runs = pd.read_csv(out / "runs.csv")
    # No run still moved from a first shock, and no arch is a bridge: their columns are left out.
    assert len(runs.columns) == len(RUN_COLUMNS) - 4 <= 24
    assert len(runs) == cube["verdict"].size == 24
    words = dict(
        zip(cube["verdict"].flag_values.tolist(), cube["verdict"].flag_meanings.split())
    )
    for row in runs.to_dict("records"):
        levels = cube["intensity"].values / 9.80665
        cell = cube.sel(arch=row["arch"], record=row["record"])
        cell = cell.isel(level=int(np.abs(levels - row["PGA [g]"]).argmin()))
        assert row["verdict"] == words[int(cell["verdict"])].replace("_", " ")
        collapsed = row["verdict"] == "collapsed"
        assert collapsed == (row["collapse_joint"] == int(cell["collapse_joint"]))
        assert np.isnan(row["collapse_joint"]) != collapsed
        assert row["peak_rotation [rad]"] == pytest.approx(
            float(cell["peak_rotation"]), rel=1e-6
        )
    assert {"survived", "collapsed"} <= set(runs["verdict"])


def test_capacities_lie_between_the_levels_that_runs_show(finished):
    _, out, _ = finished
    runs = pd.read_csv(out / "runs.csv")
    table = pd.read_csv(out / "capacities.csv")
    assert list(table) == ["arch", "record", "lower [g]", "upper [g]", "capacity [g]"]
    for _, arch, record, low, high, middle in table.itertuples():
        own = runs[(runs["arch"] == arch) & (runs["record"] == record)]
        fell = own["verdict"] == "collapsed"
        if not fell.any():
            assert np.isnan(high)
            continue
        assert middle == pytest.approx(np.sqrt(low * high), rel=1e-6)
        assert fell[own["PGA [g]"] == high].all()
        assert (own["verdict"] == "survived")[own["PGA [g]"] == low].all()
    assert table["capacity [g]"].notna().any()


def test_the_readme_names_every_file_and_spares_one_of_the_user(finished, tmp_path):
    path, out, _ = finished
    named = {
        line.split()[0].strip("/")
        for line in (out / "README.txt").open()
        if line.strip()
    }
    for entry in out.iterdir():
        assert re.sub("curve-.*", "curve-ARCH.svg", entry.name) in {
            "README.txt",
            *named,
        }
    (tmp_path / "README.txt").write_text("mine")
    write_papers(report_inputs(load_study(path)), tmp_path)
    assert (tmp_path / "README.txt").read_text() == "mine"
    assert (tmp_path / "runs.csv").read_bytes() == (out / "runs.csv").read_bytes()


def test_a_table_that_is_gone_is_made_again(finished):
    path, out, _ = finished
    before = (out / "capacities.csv").read_bytes()
    (out / "capacities.csv").unlink()
    assert "nothing to do" not in command("run", path, "--quiet").output
    assert (out / "capacities.csv").read_bytes() == before


def test_fractiles_end_where_the_capacities_of_the_other_side_are():
    """Of four records one collapses above 1, two above 3 and one never."""
    inf = np.inf
    curves = np.array(
        [[0.4, inf, inf], [0.3, 0.5, inf], [0.2, 0.3, inf], [0.1, 0.2, 0.4]]
    )
    low, median, high = fractiles(curves, np.array([1.4, 2.8, 2.8, inf]))
    assert (low[0].tolist(), low[1]) == ([0.1, 0.2, 0.4], inf)
    assert (median[0].tolist(), median[1]) == ([0.3, 0.5, inf], 2.8)
    assert (high[0].tolist(), high[1]) == ([0.4, inf, inf], 1.4)


def test_an_ida_line_is_flat_at_the_capacity_of_its_record():
    levels = np.array([0.2, 0.4, 0.6])
    row = np.array([1.0, 3.0, np.inf])
    x, y = ida_line(levels, row, 0.5, 9.0)
    assert (x.tolist(), y.tolist()) == (
        [0.0, 1.0, 3.0, 3.0, 9.0],
        [0.0, 0.2, 0.4, 0.5, 0.5],
    )
    x, y = ida_line(levels, np.array([1.0, 3.0, 4.0]), np.inf, 9.0)
    assert (x[-1], y[-1]) == (4.0, 0.6)


def test_effects_on_theta_are_those_of_a_power_law():
    """ln theta = ln 2 + 3 ln a - ln b, so that the regression is exact."""
    logs = np.random.default_rng(4).normal(size=(40, 2))
    theta = 2.0 * np.exp(3.0 * logs[:, 0] - logs[:, 1])
    middle, ends = effects_on_theta(theta, logs)
    mean = logs.mean(axis=0)
    spread = logs.std(axis=0, ddof=1)
    assert middle == pytest.approx(2.0 * np.exp(3.0 * mean[0] - mean[1]))
    assert ends[0] == pytest.approx(
        middle * np.exp([-3.0 * spread[0], 3.0 * spread[0]])
    )
    assert ends[1] == pytest.approx(middle * np.exp([spread[1], -spread[1]]))
