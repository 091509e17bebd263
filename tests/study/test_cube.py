"""The cube of a study, curves of its runs, and the cautions about them."""

import contextlib
import json
from dataclasses import replace

import lxml.html
import numpy as np
import pytest
import xarray as xr

from archfrag.errors import FitError, InputError, OutputError
from archfrag.fragility.curve import Curve
from archfrag.fragility.verdicts import Verdict, find_brackets
from archfrag.physics.status import Status
from archfrag.report.inputs import report_inputs
from archfrag.report.page import render
from archfrag.study.answer.cube import _variable, build_cube, open_cube, write_cube
from archfrag.study.answer.curves import ArchRuns, Fitted, dispersion_split
from archfrag.study.answer.fits import (
    arch_cautions,
    cautions_of,
    fit_cube,
    in_unit,
    load_fits,
    record_cautions,
)
from archfrag.study.answer.rates import risk_facts, risk_of, risk_text
from archfrag.study.designs import Ida, Stripes
from archfrag.study.file.schema import load_study
from archfrag.study.hazard import load_hazard
from archfrag.study.provenance import finite
from archfrag.study.runs.store import COLUMNS, VARIABLES, gather, verdicts_of
from tests.study.small import ROOT, TEXT, fitted, made, small_study


@pytest.fixture(scope="module")
def cube(done):
    return xr.load_dataset(write_cube(done.study))


class TestContent:
    def test_each_run_stands_where_its_part_states(self, done, cube):
        cases, table, _ = gather(done.plan)
        place = tuple(cases[name] for name in ("arch", "record", "place"))
        names = {column.name for column in COLUMNS} - {
            "moving_before"
        }  # none came after a shock
        for name in (*names, "model_time"):
            np.testing.assert_array_equal(cube[name].values[place], table[name])
        assert len(table) == cube["verdict"].size == 12

    def test_runs_that_lost_contact_and_stand_are_counted(self, done):
        (cases, table, notes), shape = gather(done.plan), (2, 2, 3)
        table["verdict"][:] = Verdict.SURVIVED
        table["verdict"].reshape(shape)[1, 0, 2] = Verdict.COLLAPSED
        table["lost_contact_time"][:] = np.nan
        table["lost_contact_time"].reshape(shape)[1, :, 1:] = 0.5
        cube = build_cube(done.plan, cases, table, notes)
        assert cube["lost_contact_and_stand"].values.tolist() == [[0, 0, 0], [0, 2, 1]]
        assert cube.attrs["loss_limit"] == "0.5"

    def test_provenance_is_complete_and_knows_neither_time_nor_place(self, done, cube):
        config = json.loads(cube.attrs["archfrag_config"])
        assert config["arches"][1]["friction"] == "inf"
        assert config["intensity"]["levels"] == [0.1, 0.6, 1.2]
        assert json.loads(cube.attrs["archfrag_inputs_sha256"]) == {
            record.file: record.file_sha256 for record in done.plan.records
        }
        assert {"archfrag", "python", "numpy", "numba"} <= set(
            json.loads(cube.attrs["archfrag_versions"])
        )
        assert cube.attrs["Conventions"] == "CF-1.11"
        everything = json.dumps({key: str(value) for key, value in cube.attrs.items()})
        assert str(done.study.folder) not in everything
        assert "workers" not in everything


def test_every_status_has_a_verdict():
    decided = {
        "STANDING": "SURVIVED",
        "COLLAPSED": "COLLAPSED",
        "UNFINISHED": "UNFINISHED",
    }
    verdicts = [Verdict(code).name for code in verdicts_of(np.array(list(Status)))]
    assert verdicts == [decided.get(status.name, "FAILED") for status in Status]


@pytest.mark.parametrize(
    ("shape", "stored"),
    [
        ((2, 2, 3), (2, 2, 3)),
        ((400, 30, 15), (291, 30, 15)),
        ((3, 900, 1000), (1, 131, 1000)),
    ],
)
def test_a_cube_opens_in_chunks_of_up_to_a_megabyte(tmp_path, shape, stored):
    """Of few arches and of many, neither of which dask would like one by one."""
    variable = _variable(VARIABLES["verdict"], np.zeros(shape, np.int8))
    xr.Dataset({"verdict": variable}).to_netcdf(tmp_path / "cube.nc", engine="netcdf4")
    with xr.open_dataset(tmp_path / "cube.nc", chunks={}) as cube:
        assert tuple(sizes[0] for sizes in cube["verdict"].chunks) == stored
        assert int(cube["verdict"].sum().compute()) == 0


def test_another_study_and_missing_runs_are_refused(copied):
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


def test_fits_are_read_back_as_they_were_and_damaged_ones_are_a_message(copied):
    write_cube(copied.study)
    fits = fit_cube(copied.study).arches
    answers = load_fits(copied.study).arches
    assert set(fits) == {"ring", "slab"}
    for name, fit in fits.items():
        assert finite(answers[name].to_dict()) == finite(fit.to_dict())
    for content in (
        '{"fits": []}',
        '{"fits": {"a": 1}}',
        "[]",
        '{"fits": {"a": {}}}',
        "\0",
    ):
        (copied.study.folder / "fits.json").write_text(content)
        with pytest.raises(
            InputError,
            match=r"fits.json: is missing or damaged .*`archfrag fit` makes it",
        ):
            load_fits(copied.study)


@contextlib.contextmanager
def changed_cube(study):
    """Change the cube of a study, which is made if it is not there."""
    path = study.folder / "cube.nc"
    cube = xr.load_dataset(path if path.exists() else write_cube(study))
    yield cube
    cube.to_netcdf(path)


SHIPPED = f"""index: {ROOT / "records" / "index.csv"}
  select: [syn-m55-r005, syn-m55-r030, syn-m60-r020, syn-m65-r005, syn-m65-r050, syn-m70-r020,
    syn-m75-r010, syn-m75-r060]"""


def test_no_unit_of_the_levels_changes_an_answer(tmp_path):
    def written(measure, unit, *levels):
        text = TEXT.replace('files: ["records/*.AT2"]', SHIPPED).replace("PGA", measure)
        text = text.replace("unit: g", f"unit: {unit}").replace(
            "[0.1, 0.6, 1.2]", str([*levels])
        )
        return small_study(tmp_path, text.replace("output: out", f"output: {measure}"))

    def states(fits):
        found = fits["arches"]["ring"]["more"]["limit_states"]["states"]
        return {s["name"]: s["curve"] for s in found if "theta" in s["curve"]}

    in_g = made(written("PGA", "g", 0.4, 1.0, 1.6, 2.2, 2.8)).fits
    for unit, factor in (("m/s2", 9.80665), ("cm/s2", 980.665)):
        levels = [round(factor * level, 6) for level in (0.4, 1.0, 1.6, 2.2, 2.8)]
        found = fitted(load_study(written("PGA", unit, *levels)))  # of the same cube
        assert states(found) == states(in_g)
        assert found["arches"]["ring"]["curve"] == in_g["arches"]["ring"]["curve"]
    in_pgv = made(written("PGV", "cm/s", 32.0, 85.0, 138.0, 190.0, 243.0)).fits
    for fits in (in_g, in_pgv):
        assert set(states(fits)) == {"residual", "rotation", "collapse"}


def test_theta_is_given_with_all_runs_without_verdict_as_collapses_and_as_survivals(
    copied,
):
    def curves_with(verdict):
        with changed_cube(copied.study) as cube:
            cube["verdict"][:] = [[0, 0, 1], [0, 1, 1]]
            cube["verdict"][0, 0, 1] = verdict
        return fit_cube(copied.study).arches

    found = curves_with(Verdict.FAILED)
    assert found["slab"].n_undecided == 0
    ring = found["ring"]
    assert ring.n_undecided == 1
    for end, verdict in zip(ring.extremes, (Verdict.COLLAPSED, Verdict.SURVIVED)):
        assert end.fit_dict() == curves_with(verdict)["ring"].fit_dict()
    assert ring.extremes[0].theta < ring.extremes[1].theta
    text = repr(in_unit(ring, copied.study.intensity))
    assert "1 run has no verdict: the median is" in text


def page_of(study, place):
    page = lxml.html.document_fromstring(render(report_inputs(study))[0])
    return page.xpath(f'string(//section[@id="{place}"])')


@pytest.mark.parametrize(
    ("factor", "records", "reason"),
    [(0.01, "*", "no run collapsed"), (4.0, "wave0*", "only one record")],
)
def test_a_cloud_without_a_curve_has_a_report_that_states_why(
    tmp_path, factor, records, reason
):
    """Its records are as they are: no factor was chosen so that some cause collapse."""
    text = TEXT.replace("levels: [0.1, 0.6, 1.2]", "levels: [1.0]")
    text = text.replace("records/*.AT2", f"records/{records}.AT2")
    path = small_study(tmp_path, f"{text}design: {{kind: cloud, factor: {factor}}}\n")
    shown = page_of(made(path).study, "arch1")
    assert reason in shown
    assert "error in archfrag" not in shown


@pytest.mark.parametrize(("factor", "side"), [(0.01, "above"), (50.0, "below")])
@pytest.mark.parametrize("kind", ["cloud, factor: {}", "stripes", "ida"])
def test_one_outcome_in_all_runs_gives_no_curve_but_a_reason(
    tmp_path, kind, factor, side
):
    text = TEXT.replace("[0.1, 0.6, 1.2]", f"[{0.9 * factor:g}, {1.1 * factor:g}]")
    path = small_study(tmp_path, f"{text}design: {{kind: {kind.format(factor)}}}\n")
    study = made(path).study
    fitted = load_fits(study)
    for answer in fitted.arches.values():
        assert f"nothing bounds theta from {side}: add levels {side}" in answer.reason
        assert not answer.likelihood.fitted
        assert not any(state.fitted for state in answer.states)
    hazard = load_hazard([ROOT / "configs" / "hazard.csv"], "PGA")
    found = risk_facts(risk_of(fitted.cube, fitted.arches, hazard), study)
    assert all("nothing bounds" in each["none"] for each in found["arches"].values())
    assert "no rate, since there is no curve" in risk_text(found)


def test_a_part_that_cannot_be_made_is_left_out(copied, monkeypatch):
    def spoiled(*_):
        raise ValueError("spoiled")

    write_cube(copied.study)
    for name in ("measures_compared", "limit_states"):
        monkeypatch.setattr(f"archfrag.study.answer.curves.{name}", spoiled)
    fitted(copied.study)
    assert page_of(copied.study, "arch0").count("ValueError: spoiled") == 2


@pytest.mark.parametrize("largest", [20.0, 1.5])
def test_dispersion_of_a_class_has_the_parts_of_its_capacities(largest):
    """exp(record + arch): arches that withstand the largest level count too."""
    generator = np.random.default_rng(5)
    arch = 0.2 * generator.standard_normal((30, 1))
    record = 0.4 * generator.standard_normal(60)
    capacity = np.exp(arch + record + 0.1 * generator.standard_normal((30, 60)))
    levels = np.geomspace(0.1, 10.0, 60)
    levels = levels[levels < largest]
    verdict = (levels >= capacity[..., None]).astype(int)
    fits = [Stripes().likelihood(find_brackets(own, levels)) for own in verdict]
    answers = [replace(fit, likelihood=fit) for fit in fits]
    parts = arch.std(ddof=1), np.hypot(record.std(ddof=1), 0.1)
    beta = float(np.hypot(*parts))
    runs = ArchRuns("a", Stripes(), verdict.reshape(-1, levels.size), levels)
    found = dispersion_split(runs, answers, Curve(beta=beta))
    assert found["beta_model"] == pytest.approx(parts[0], rel=0.1)
    assert found["beta_record_to_record"] == pytest.approx(parts[1], rel=0.1)
    assert np.hypot(*found.values()) == pytest.approx(beta, rel=1e-12)
    if largest < 2.0:
        two = ArchRuns("a", Stripes(), verdict[:2].reshape(-1, levels.size), levels)
        with pytest.raises(
            (FitError, InputError), match="one arch has no modelling dispersion"
        ):
            dispersion_split(two, [answers[0], Curve(reason="no curve")], 0.4)


def test_equal_capacities_have_no_parts_of_beta():
    runs = ArchRuns("a", Stripes(), np.tile([0, 1], (4, 1)), np.array([0.4, 0.6]))
    (reason,) = dispersion_split(runs, [Curve(), Curve()], 0.1).values()
    assert reason == "all capacities lie between the same two levels"


def test_cautions_of_a_study_name_the_arch_and_its_unit(copied):
    with changed_cube(copied.study) as cube:
        cube["verdict"][:] = Verdict.SURVIVED
    assert "above 1.2 g" in fit_cube(copied.study).arches["ring"].reason
    none = dict.fromkeys(("ring", "slab"), Curve(reason="no curve"))
    *surviving, last = cautions_of(
        copied.study, Fitted(none, {}, open_cube(copied.study))
    )
    assert [text.split(", the")[0] for text in surviving] == [
        f"{name}: 2 of 2 records cause no collapse up to 1.2 g"
        for name in ("ring", "slab")
    ]
    assert last.startswith("the 2 records are of 1 earthquake (Test), too few")
    with changed_cube(copied.study) as cube:
        cube["verdict"][1, :, 2] = Verdict.UNFINISHED
        cube["scale_factor"][0, 1] = 11.0
    ring, first, second, _ = cautions_of(
        copied.study, Fitted(none, {}, open_cube(copied.study))
    )
    assert ring.startswith("ring: 2 of 2 records cause no collapse")
    assert first.startswith("slab: more than 5 % of the runs")
    assert "(most: 2 of 2 at 1.2 g)" in first
    assert "(most: wave0, by 11)" in second


AGAIN = np.tile(np.array([0, 0, 1, 1], np.int8), (10, 1))
AGAIN[:2, 1:3] = [1, 0]
FLEET = {"a0": {"checked": 14, "contradictions": 2}}
MORE = AGAIN.copy()
MORE[2, 1:3] = [1, 0]
NO_CURVE = Curve(reason="none")
CURVE = Curve(1.3, 0.25, np.eye(2), 0.0, 3, 30, "posterior")


def of_events(count):
    events = [f"e{i % count}" for i in range(24)]
    shape = ("arch", "record", "level"), np.zeros((1, 24, 1))
    return record_cautions(
        xr.Dataset(
            {"event": ("record", events), "verdict": shape, "scale_factor": shape}
        )
    )


def of_arch(verdict, levels=(1.0, 2.0, 3.0, 4.0), curve=NO_CURVE):
    named = [f"{level:g} g" for level in levels]
    return arch_cautions(
        ArchRuns("a", Stripes(), np.array(verdict), np.array(levels)), named, curve
    )


def of_lost(count, kind):
    verdict = np.zeros((100, 3), dtype=int)
    verdict[:, 2] = 1
    verdict[:count, 2] = kind
    return of_arch(verdict, (1.0, 2.0, 3.0))


def of_spacing(beta):
    return of_arch([[0, 1, 1]], (1.0, 1.2, 1.5), replace(CURVE, beta=beta))


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (of_lost(5, Verdict.FAILED), ""),
        (
            of_lost(6, Verdict.FAILED),
            "more than 5 % of the runs are unfinished or failed",
        ),
        (of_arch(AGAIN), ""),
        (of_arch(MORE), "3 of 10 records do not cause"),
        (of_spacing(0.25), ""),
        (of_spacing(0.2), "the levels n"),
        (of_events(4), ""),
        (of_events(3), "the 24 records are of 3 earth"),
        (Ida(kind="ida").cautions(FLEET), "a0: 2 of 14 checks near the border"),
    ],
)
def test_a_caution_begins_where_its_rule_says(found, expected):
    messages = list(found)
    assert [message[: len(expected)] for message in messages] == (
        [expected] if expected else []
    )
